"""Which foot stands on a plate, told when the plate is loaded: no later sample is asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.segments import feet_of
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

LOADED = 20.0
"""Force from which a plate counts as loaded [N]."""

SURE = 0.2
"""Force from which the center of pressure is trusted, as a share of body weight."""

NEAR = 0.35
"""Distance of the center of pressure to a foot's heel or ball beyond which it is nobody's [m]."""


class OnlineFeet:
    """Gives the forces of plates to bodies: to the one named, else to the foot that is nearest when the load begins.

    While the load is small, the center of pressure tells little: the foot is asked for again until the load passes
    `SURE`, and then kept until it ends. A plate that is loaded near no foot acts on no body.

    Parameters
    ----------
    plates : names
    bodies : that the plates act on, "" where the nearest foot is to be found

    Attributes
    ----------
    bodies : on which forces may act, in the order of the wrenches
    nobody : (plates,) samples so far of load near no foot
    up : (3,) against gravity

    Raises
    ------
    BadData : a foot is to be found, and the model has none
    """

    def __init__(self, model: Model, plates: Sequence[str], bodies: Sequence[str]):
        self.plates = tuple(plates)
        named = [one for one in bodies if one]
        feet = feet_of(model) if len(named) < len(bodies) else ()
        if len(named) < len(bodies) and not feet:
            raise BadData(
                f"no body of model '{model.name}' is called a foot: give an external loads file (.xml) that names the "
                "bodies on the plates"
            )
        self.bodies = tuple(dict.fromkeys([*named, *feet]))
        self._owner = np.array([self.bodies.index(one) if one else -1 for one in bodies], np.int64)
        self._sure = np.zeros(len(bodies), np.bool_)
        self._sought = np.array([not one for one in bodies], np.bool_)
        self._tree = compile_tree(model)
        self._feet = [self.bodies.index(one) for one in feet]
        self._numbers = [self._tree.body_index[one] for one in feet]
        # Heel and ball: twice the way from the body's origin to its mass center.
        self._ahead = np.array([2.0 * model.body(one).mass_center for one in feet]).reshape(-1, 3)
        gravity = np.asarray(model.gravity, dtype=np.float64)
        size = float(np.linalg.norm(gravity))
        self.up = -gravity / size if size > 0.0 else np.array([0.0, 1.0, 0.0])
        self._trusted = SURE * size * model.mass
        self.nobody = np.zeros(len(plates), np.int64)

    def given(self, wrenches: Array, coordinates: Array | None) -> Array:
        """Wrenches on the bodies.

        Parameters
        ----------
        wrenches : (samples, plates, 6) moment about the ground's origin and force [N m], [N]
        coordinates : (coordinates,) of the newest pose, None where there is none yet

        Returns
        -------
        (samples, bodies, 6)
        """
        found = np.zeros((len(wrenches), len(self.bodies), 6))
        for plate in range(len(self.plates)):
            if not self._sought[plate]:
                found[:, self._owner[plate]] += wrenches[:, plate]
                continue
            force = np.linalg.norm(wrenches[:, plate, 3:], axis=1)
            loaded = force > LOADED
            edges = np.flatnonzero(np.diff(loaded)) + 1
            for first, stop in zip([0, *edges], [*edges, len(loaded)], strict=True):
                if first == stop:
                    continue
                if not loaded[first]:
                    self._owner[plate], self._sure[plate] = -1, False
                    continue
                if not self._sure[plate] and coordinates is not None:
                    most = first + int(np.argmax(force[first:stop]))
                    nearest = self._nearest(wrenches[most, plate], coordinates)
                    self._owner[plate] = nearest if nearest >= 0 else self._owner[plate]
                    self._sure[plate] = nearest >= 0 and bool(force[most] > self._trusted)
                if self._owner[plate] < 0:
                    self.nobody[plate] += stop - first
                else:
                    found[first:stop, self._owner[plate]] += wrenches[first:stop, plate]
        unknown = np.isnan(wrenches).any(axis=(1, 2))
        found[unknown] = np.nan
        return found

    def _nearest(self, wrench: Array, coordinates: Array) -> int:
        """Number of the body whose heel or ball is nearest to where the force meets the floor, -1 for none."""
        if not np.isfinite(coordinates).all():
            return -1
        moment, force = wrench[:3], wrench[3:]
        lift = float(force @ self.up)
        if abs(lift) < 0.1 * LOADED:
            return -1
        poses = forward_kinematics(self._tree, np.array(coordinates, dtype=np.float64)[None])
        heels = poses.origins[0, self._numbers]
        balls = heels + np.einsum("fij,fj->fi", poses.rotations[0, self._numbers], self._ahead)
        # Where the moment along the floor vanishes, in the plane through the origin.
        center = np.cross(self.up, moment) / lift
        away = np.stack([heels, balls]) - center
        away -= (away @ self.up)[..., None] * self.up
        distances = np.linalg.norm(away, axis=-1).min(axis=0)
        best = int(np.argmin(distances))
        return self._feet[best] if distances[best] <= NEAR else -1

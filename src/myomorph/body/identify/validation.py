"""Checks of inertial parameters.

Motions held out of the fit, and whether every link can be a body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.body.identify.least_squares import Recording
from myomorph.body.shape.points import MassPoints
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.core.model.model import Model
from myomorph.core.model.shown import shown
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.rigid.regressor import base_wrench

# Points (points, 3) in ground [m] -> (points,) whether each is inside the body
Inside = Callable[[Array], np.ndarray]

COMPONENTS = ("Nx", "Ny", "Nz", "Fx", "Fy", "Fz")
"""Of a wrench, in the order of its arrays: moment [N m], then force [N]."""
# How far below 0 rounding may bring an eigenvalue, relative to what is summed up in it
ROUNDING = 1e-9


@read_only
class CrossValidation:
    """The base wrench on a held-out motion, by several models, [D] figure 3.3.

    Attributes
    ----------
    time : (frames,) [s]
    measured : (frames, 6) moment about the base body's origin [N m] and force [N]; NaN where left
        out
    predicted : name to (frames, 6)
    weight : of the body [N]
    """

    time: Array
    measured: Array
    predicted: Mapping[str, Array]
    weight: float

    @property
    def errors(self) -> Mapping[str, Array]:
        """(frames, 6) predicted less measured, by name."""
        return {name: wrench - self.measured for name, wrench in self.predicted.items()}

    def rms(self, name: str) -> Array:
        """Compute the root mean square of the moment's and the force's error vectors.

        Parameters
        ----------
        name : of the model

        Returns
        -------
        (2,) [N m], [N]

        Raises
        ------
        UnknownName : there is no prediction of that name
        """
        check_name("model", name, self.predicted, "the cross-validation")
        error = self.errors[name]
        error = error[np.isfinite(error).all(axis=1)]
        halves = (error[:, :3], error[:, 3:])
        return np.array([np.sqrt(np.mean(np.square(half).sum(axis=1))) for half in halves])

    def table(self) -> Mapping[str, Mapping[str, Array]]:
        """Tabulate the errors of each model by component.

        Returns
        -------
        name to (6,) of "bias" (mean), "mean" (of absolute values), "rms", "peak" [N m], [N], and
            "percent", RMS over body weight [%], of a moment over body weight times 1 m. A model
            without a frame to compare is left out.
        """
        result = {}
        for name, error in self.errors.items():
            if not np.isfinite(error).any():
                continue
            rms = np.sqrt(np.nanmean(np.square(error), axis=0))
            result[name] = {
                "bias": np.nanmean(error, axis=0),
                "mean": np.nanmean(np.abs(error), axis=0),
                "rms": rms,
                "peak": np.nanmax(np.abs(error), axis=0),
                "percent": 100.0 * rms / self.weight,
            }
        return result


def cross_validate(
    models: Mapping[str, Model],
    recording: Recording,
    tissues: Mapping[str, SoftTissue] | None = None,
) -> CrossValidation:
    """Compare measured and predicted base wrench of models that share bodies and joints.

    Parameters
    ----------
    models : by name
    recording : motion with derivatives and wrenches through the same filter, on the same clock
    tissues : soft tissue of models whose masses are for a motion without it, by name

    Returns
    -------
    wrenches over time

    Raises
    ------
    BadData : there is no model, or one has other bodies than the first
    """
    if not models:
        raise BadData("cross-validation needs at least one model")
    first_model = next(iter(models.values()))
    for name, other in models.items():
        if other.body_names != first_model.body_names:
            raise BadData(
                f"model '{name}' has other bodies than the rest: cross-validate models of one"
                " skeleton"
            )
    measured = base_wrench(first_model, recording.motion, recording.wrenches)
    if recording.use is not None:
        measured[~np.asarray(recording.use)] = np.nan
    predicted = {}
    for name, model in models.items():
        tissue = (tissues or {}).get(name)
        moved = recording if tissue is None else recording.moved(tissue.of)
        predicted[name] = frozen_array(
            measured + moved.missing(first_model, inertial_parameters(model))
        )
    return CrossValidation(
        time=recording.motion.time,
        measured=frozen_array(measured),
        predicted=FrozenMap(predicted),
        weight=first_model.mass * float(np.linalg.norm(first_model.gravity)),
    )


@read_only
class LinkConsistency:
    """One link's parameters, as a body.

    Attributes
    ----------
    name : of the link
    mass : [kg]
    center : (3,) mass center in the link's frame [m]; NaN without mass
    second_moments : (3,) principal second moments of mass about the mass center, ascending [kg
        m^2]; a body of positive mass has none below 0, which is the triangle inequality of the
        moments of inertia
    moments : (3,) principal moments of inertia about the mass center, ascending [kg m^2]
    eigenvalues : (4,) of the pseudo-inertia in the link's frame, ascending
    inside : whether the mass center is inside the body; None where nothing shows it
    faults : in words; none in a link that a body can have
    """

    name: str
    mass: float
    center: Array
    second_moments: Array
    moments: Array
    eigenvalues: Array
    inside: bool | None
    faults: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether a body can have these parameters."""
        return not self.faults

    @property
    def massless(self) -> bool:
        """Whether the link has no mass at all, as frames between joints."""
        return self.mass == 0.0


@shown
@dataclass(frozen=True)
class Consistency:
    """The links of a model, as bodies.

    Attributes
    ----------
    links : one a link
    """

    links: tuple[LinkConsistency, ...]

    @property
    def ok(self) -> bool:
        """Whether every link is a body."""
        return all(link.ok for link in self.links)

    @property
    def faulty(self) -> tuple[LinkConsistency, ...]:
        """The links that are not."""
        return tuple(link for link in self.links if not link.ok)

    @property
    def verdict(self) -> str:
        """One sentence."""
        massless = sum(link.massless for link in self.links)
        rest = f"; {massless} without mass" if massless else ""
        if self.ok:
            checked = sum(link.inside is not None for link in self.links)
            where = (
                f", {checked} mass centers inside the body"
                if checked
                else ", mass centers not checked"
            )
            return f"all {len(self.links)} links are physically possible{where}{rest}"
        named = "; ".join(f"'{link.name}': {', '.join(link.faults)}" for link in self.faulty[:3])
        more = f"; and {len(self.faulty) - 3} more" if len(self.faulty) > 3 else ""
        return (
            f"{len(self.faulty)} of {len(self.links)} links are not physically possible:"
            f" {named}{more}{rest}"
        )


def consistency(
    names: Sequence[str],
    parameters: ArrayLike,
    *,
    points: MassPoints | None = None,
    inside: Inside | None = None,
) -> Consistency:
    """Check each link: positive mass, positive definite pseudo-inertia, mass center inside.

    Parameters
    ----------
    names : of the links
    parameters : (links, 10) in the order of [D] eq. 3.4
    points : with the links' poses, to place mass centers in ground: one counts as inside within a
        cell of the grid of a mass point
    inside : tells which points in ground (points, 3) are inside the skin, instead

    Returns
    -------
    one for each link

    Raises
    ------
    BadData : parameters have another shape or a value that is not finite, or points are of other
        links
    """
    table = np.asarray(parameters, float)
    if table.shape != (len(names), 10) or not np.isfinite(table).all():
        raise BadData(f"expected finite parameters ({len(names)}, 10), but got shape {table.shape}")
    within: list[bool | None] = [None] * len(names)
    weighty = np.flatnonzero(table[:, 0] > 0.0)
    if points is not None and len(weighty):
        links = points.links
        if links.names != tuple(names):
            raise BadData(
                f"parameters are of other links, or in another order, than points: {names} and"
                f" {links.names}"
            )
        test = inside or _near(points)
        centers = table[weighty, 1:4] / table[weighty, :1]
        ground = links.origins[weighty] + np.einsum("lij,lj->li", links.rotations[weighty], centers)
        for i, result in zip(weighty, test(ground), strict=True):
            within[i] = bool(result)
    return Consistency(
        tuple(
            _link(*link) for link in zip(names, table, pseudo_inertias(table), within, strict=True)
        )
    )


def _near(points: MassPoints) -> Inside:
    tree = scipy.spatial.cKDTree(points.points)
    reach = np.sqrt(3.0) * points.spacing

    def test(ground: Array) -> np.ndarray:
        return np.asarray(tree.query(ground)[0] <= reach)

    return test


def _link(name: str, row: Array, P: Array, inside: bool | None) -> LinkConsistency:
    """Check one link's parameters.

    Parameters
    ----------
    row : (10,) in the order of [D] eq. 3.4
    P : (4, 4) pseudo-inertia
    inside : whether its mass center is inside the body; None where nothing shows it
    """
    mass = float(row[0])
    eigenvalues = np.linalg.eigvalsh(P)
    faults = []
    if mass > 0.0:
        center = row[1:4] / mass
        around = P[:3, :3] - mass * np.outer(center, center)
        second = np.linalg.eigvalsh(around)
        size = max(np.trace(P[:3, :3]), 0.0)
        if second[0] < -ROUNDING * size:
            faults.append(
                f"no mass can have these moments of inertia (second moment {second[0]:.3g} kg m2)"
            )
        if inside is False:
            faults.append("mass center outside the body")
    else:
        center = np.full(3, np.nan)
        second = np.full(3, np.nan)
        if mass < 0.0:
            faults.append(f"mass {mass:.4g} kg")
        elif row.any():
            faults.append("moments without mass")
    return LinkConsistency(
        name=name,
        mass=mass,
        center=frozen_array(center),
        second_moments=frozen_array(second),
        moments=frozen_array(np.sort(second.sum() - second)),
        eigenvalues=frozen_array(eigenvalues),
        inside=inside,
        faults=tuple(faults),
    )

"""Forces as plates measured them, before they are given to bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Wrenches
from myomorph.core.motion.sync import resample_wrenches

ON_PLATE = 0.9
"""Part of a plate's load whose centers of pressure lie over its outline where this is right."""


@read_only
class PlateForces:
    """What plates measured, and where they lie.

    Attributes
    ----------
    wrenches : one per plate; the body that somebody named, "" where it is not known
    outlines : corners of the plates by name, (4, 3) each in ground [m]; none of a table of forces
    """

    wrenches: Wrenches
    outlines: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))

    def at(self, time: Array, cutoff: float | None) -> PlateForces:
        """Bring the forces to other times, filtered like the motion.

        Parameters
        ----------
        time : (frames,) [s]
        cutoff : low-pass [Hz], None for none

        Returns
        -------
        the same plates, (frames, plates, 3) each

        Raises
        ------
        BadData : the times reach beyond those of the forces
        """
        return replace(self, wrenches=resample_wrenches(self.wrenches, time, cutoff))

    def trusted_outline(self, plate: int, up: Array) -> Array | None:
        """Find the outline of a plate, where its centers of pressure lie over it.

        A plate whose forces were turned to the motion lies elsewhere than its file says.

        Parameters
        ----------
        plate : its number
        up : (3,) unit vector

        Returns
        -------
        (4, 3) [m], None where it is not known
        """
        corners = self.outlines.get(self.wrenches.names[plate])
        if corners is None:
            return None
        load = np.clip(np.nan_to_num(self.wrenches.forces[:, plate] @ up), 0.0, None)
        points = np.nan_to_num(self.wrenches.points[:, plate])
        over = over_outline(points[:, None], corners, up, 0.0)[:, 0]
        return corners if load[over].sum() >= ON_PLATE * load.sum() else None


def over_outline(places: Array, corners: Array, up: Array, margin: float) -> np.ndarray:
    """Return whether places are over a plate, or less than a margin outside its outline.

    Parameters
    ----------
    places : (frames, places, 3) [m]
    corners : (corners, 3), in their order around the plate [m]
    up : (3,) unit vector
    margin : [m]

    Returns
    -------
    (frames, places)
    """
    inside = np.ones(places.shape[:2], np.bool_)
    middle = corners.mean(axis=0)
    for corner, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.cross(other - corner, up)
        normal = normal / np.linalg.norm(normal)
        outwards = normal if (corner - middle) @ normal > 0.0 else -normal
        inside &= (places - corner) @ outwards < margin
    return inside

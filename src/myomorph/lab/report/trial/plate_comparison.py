"""What plates measured, compared with the sum of all contacts on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import ContactForces
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.series import Wrenches
from myomorph.lab.report.trial.report_input import PlateForce

LOADED = 0.03
"""Share of the largest force from which a plate counts as loaded."""


@read_only
class PlateComparison:
    """Contacts that stand on plates together: what was measured and what was estimated of them.

    Attributes
    ----------
    plates : their names
    groups : names of the contacts
    measured, estimated : (frames, 3) in ground, NaN where there is nothing to compare [N]
    """

    plates: tuple[str, ...]
    groups: tuple[str, ...]
    measured: Array
    estimated: Array

    @property
    def compared(self) -> NDArray[np.bool_]:
        """(frames,) whether both are known."""
        both = np.isfinite(self.measured) & np.isfinite(self.estimated)
        return np.asarray(both.any(axis=1))

    def rms(self, direction: Array) -> float:
        """Root mean square of what the estimate is off.

        Parameters
        ----------
        direction : (3,) unit vector along which

        Returns
        -------
        [N], NaN of no frame
        """
        off = ((self.estimated - self.measured) @ direction)[self.compared]
        off = off[np.isfinite(off)]
        return float(np.sqrt(np.mean(off**2))) if len(off) else float("nan")

    def measured_range(self, direction: Array) -> float:
        """Range of what was measured, over the frames compared.

        Parameters
        ----------
        direction : (3,) unit vector along which

        Returns
        -------
        [N], 0 of no frame
        """
        along = (self.measured @ direction)[self.compared]
        along = along[np.isfinite(along)]
        return float(np.ptp(along)) if len(along) else 0.0


def plate_comparisons(
    forces: ContactForces,
    plates: Sequence[PlateForce],
    measured: Wrenches | None,
    bodies: Mapping[str, set[str]],
) -> tuple[PlateComparison, ...]:
    """Compare plates with the sum of the contacts on them, by the contacts that share them.

    Parameters
    ----------
    forces : estimated, at contact sites
    plates : what plates measured of which sites together, where that is known
    measured : forces on bodies, for plates that no entry is of
    bodies : of each group of sites

    Returns
    -------
    one for each set of contacts that were on the same plates at once
    """
    known = plates or (() if measured is None else _by_bodies(forces, measured, bodies))
    of_site = {site.name: site.group for site in forces.sites}
    sets = grouped(
        (tuple(dict.fromkeys(of_site[name] for name in plate.sites if name in of_site)), plate)
        for plate in known
    )
    comparisons = [_comparison(forces, groups, found) for groups, found in sets.items() if groups]
    return tuple(each for each in comparisons if np.isfinite(each.measured).any())


def _comparison(
    forces: ContactForces, groups: tuple[str, ...], plates: Sequence[PlateForce]
) -> PlateComparison:
    """Join entries of the same contacts, each known in frames of its own.

    Parameters
    ----------
    groups : contacts on the plates
    plates : of these contacts
    """
    measured = np.full((len(forces), 3), np.nan)
    for plate in plates:
        measured = np.where(np.isfinite(plate.forces), plate.forces, measured)
    size = np.linalg.norm(np.nan_to_num(measured), axis=1)
    measured[size < LOADED * size.max(initial=0.0)] = np.nan
    members = [index for index, site in enumerate(forces.sites) if site.group in groups]
    touching = np.asarray((forces.contact_activation[:, members] > 0.0).any(axis=1))
    total = forces.contact_force[:, members].sum(axis=1)
    names = dict.fromkeys(
        name for plate in plates for name in plate.name.split(" (")[0].split(" + ")
    )
    return PlateComparison(
        plates=tuple(names),
        groups=groups,
        measured=measured,
        estimated=np.where(touching[:, None], total, np.nan),
    )


def _by_bodies(
    forces: ContactForces, measured: Wrenches, bodies: Mapping[str, set[str]]
) -> tuple[PlateForce, ...]:
    """Plates by the bodies that their forces were put on: contacts of the same body share them."""
    parts: list[tuple[set[int], set[str]]] = []
    for column, body in enumerate(measured.bodies):
        groups = {group for group, names in bodies.items() if body in names}
        if not groups:
            continue
        columns = {column}
        separate = []
        for others, taken in parts:
            if taken & groups:
                columns |= others
                groups |= taken
            else:
                separate.append((others, taken))
        parts = [*separate, (columns, groups)]
    flat = np.nan_to_num(measured.forces)
    return tuple(
        PlateForce(
            name=" + ".join(measured.names[column] for column in sorted(columns)),
            sites=tuple(site.name for site in forces.sites if site.group in groups),
            forces=_at(forces.time, measured.time, flat[:, sorted(columns)].sum(axis=1)),
        )
        for columns, groups in parts
    )


def _at(time: Array, clock: Array, values: Array) -> Array:
    """Columns (samples, 3) at other times, by straight lines between samples; NaN outside."""
    return np.stack(
        [np.interp(time, clock, column, left=np.nan, right=np.nan) for column in values.T], axis=1
    )

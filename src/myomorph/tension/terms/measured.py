"""Forces measured for several sites together, and greatest forces of sites, as terms.

sum_g S_g z_g - sd e = measured,  cost e^2        sum_g n_g z_g - most q = 0,  -1 <= q <= 1
"""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.tension.terms.contacts import ContactTerm
from myomorph.tension.terms.term import LIMIT_COST, Frames, Rows, Term, Unknowns

MEASURED_COST = 1.0
"""Cost of missing a measured force by one standard deviation, in units of the effort a^2 of one muscle."""

COMPONENTS = ("FX", "FY", "FZ", "MX", "MY", "MZ")


class MeasuredTerm(Term):
    """sum ((S f - measured) / sd)^2 of the wrenches that were measured for contacts together, about the origin."""

    def __init__(self, contacts: ContactTerm):
        self._contacts = contacts
        names = [site.name for site in contacts.task.sites]
        self._members = [
            np.flatnonzero(np.isin(contacts.generators.site, [names.index(site) for site in one.sites]))
            for one in contacts.task.measured
        ]

    def rows(self, unknowns: Unknowns) -> Rows:
        """Six rows a wrench: force and moment."""
        measured, first = self._contacts.task.measured, unknowns.of(self._contacts).start
        names = tuple(f"{wrench.name} {label}" for wrench in measured for label in COMPONENTS)
        sd = [s for wrench in measured for s in (*(3 * [wrench.force_sd]), *(3 * [wrench.moment_sd]))]
        columns = [mine for mine in self._members for _ in COMPONENTS]
        row = np.repeat(np.arange(len(names)), [len(column) for column in columns])
        everything = np.concatenate([*columns, np.zeros(0, np.int64)])
        free = np.full(len(names), np.inf)
        none = np.zeros(len(row)), np.zeros(len(names))
        unit, cost = np.array(sd, dtype=np.float64), np.full(len(names), MEASURED_COST)
        return Rows(names, row, first + everything, *none, unit, cost, -free, free, measured=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """What one unit of each amplitude gives; a component that was not measured has none and asks for nothing."""
        contacts, generators = self._contacts, self._contacts.generators
        _, places, pushes, turns = contacts.evaluated(frames)
        amounts = contacts.amounts[frames.part][..., None]
        forces = pushes * amounts
        moments = np.cross(places[:, generators.point], forces) + turns * amounts
        values, target = [np.zeros((len(frames), 0))], np.zeros((len(frames), len(rows)))
        for index, (measured, mine) in enumerate(zip(contacts.task.measured, self._members, strict=True)):
            both = np.concatenate([measured.forces[frames.part], measured.moments[frames.part]], axis=1)
            known = np.isfinite(both)
            target[:, 6 * index : 6 * index + 6] = np.where(known, both, 0.0)
            for i in range(6):
                values.append((moments if i >= 3 else forces)[:, mine, i % 3] * known[:, i, None])
        return np.hstack(values), target


class GreatestForceTerm(Term):
    """|n . f| <= most of every site that has a greatest force: along its cone, or along each axis of ground."""

    def __init__(self, contacts: ContactTerm):
        self._contacts, generators = contacts, contacts.generators
        # Name, greatest force, axis in ground or -1 for the cone's, and generators that take part.
        self._limits = []
        for number, site in enumerate(contacts.task.sites):
            if not np.isfinite(site.cone.most):
                continue
            mine = generators.site == number
            if site.cone.direction is None:
                three = [(f"{site.name} most {axis}", i) for i, axis in enumerate("XYZ")]
            else:
                three, mine = [(f"{site.name} most", -1)], mine & (generators.normal != 0.0)
            self._limits += [(name, site.cone.most, axis, np.flatnonzero(mine)) for name, axis in three]

    def rows(self, unknowns: Unknowns) -> Rows:
        """One row a limit, whose unknown is the share of the greatest force that is used."""
        count, first = len(self._limits), unknowns.of(self._contacts).start
        row = np.repeat(np.arange(count), [len(mine) for *_, mine in self._limits])
        column = np.concatenate([*(mine for *_, mine in self._limits), np.zeros(0, np.int64)])
        unit, one = np.array([most for _, most, _, _ in self._limits], dtype=np.float64), np.ones(count)
        names = tuple(name for name, *_ in self._limits)
        none = np.zeros(len(row)), np.zeros(count)
        return Rows(names, row, first + column, *none, unit, LIMIT_COST * one, -one, one)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force of one unit of each amplitude along the direction that is limited."""
        _, _, pushes, _ = self._contacts.evaluated(frames)
        amounts, normal = self._contacts.amounts[frames.part], self._contacts.generators.normal
        values = [np.zeros((len(frames), 0))]
        for _, _, axis, mine in self._limits:
            along = pushes[:, mine, axis] if axis >= 0 else normal[mine]
            values.append(along * amounts[:, mine])
        return np.hstack(values), np.zeros((len(frames), len(rows)))


def contact_terms(contacts: ContactTerm) -> tuple[Term, ...]:
    """Contacts, with what was measured of them and what limits them, where there is any."""
    result: tuple[Term, ...] = (contacts,)
    if contacts.task.measured:
        result += (MeasuredTerm(contacts),)
    if any(np.isfinite(site.cone.most) for site in contacts.task.sites):
        result += (GreatestForceTerm(contacts),)
    return result

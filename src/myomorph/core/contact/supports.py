"""Steps, rails and seats: what carries a body beside the floor and its plates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.sites import body_sites
from myomorph.core.contact.undetermined import UNDETERMINED
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Contacts, Site, Touch
from myomorph.core.model.findings import Span, spans_of, times_text
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series, Wrenches

Flags = NDArray[np.bool_]
Kind = Literal["step", "rail", "seat"]

HALF = 0.5
"""Share of the time in which a foot has a force of its own, where it counts as measured."""
FOUND = "motion and missing force"
"""Source of contacts with rails."""


@read_only
class Support:
    """Something that is no plate on which a part of the body rests for a while.

    Attributes
    ----------
    contact : group of the sites that rest on it: `foot_r`, `hand_l`, `seat`
    body : of these sites
    kind : what it is taken for
    height : of a step above the floor, 0 of others [m]
    rests : from when to when the part rests [s]
    window : from when to when it can touch at all: of a foot, from the top of its way there to the
        top of its way from there [s]
    unused : names of measured forces that are not used while it rests, as their centers of pressure
        lie beside all feet: they act on a part of what the foot stands on
    """

    contact: str
    body: str
    kind: Kind
    height: float
    rests: Span
    window: Span
    unused: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """What rests on what, and when."""
        high = f" {self.height:.2f} m above the floor" if self.kind == "step" else ""
        return f"'{self.contact}' on a {self.kind}{high} ({times_text((self.rests,))})"


@read_only
class Supports:
    """All that carries a body beside the floor and its plates, as far as it is found.

    Attributes
    ----------
    all : one for each time that a part rests
    alone : whether nothing else is estimated: what rests on the floor beside the plates stays
        unknown
    """

    all: tuple[Support, ...] = ()
    alone: bool = False

    def __bool__(self) -> bool:
        return bool(self.all)

    def raised(self, sites: Sequence[Site], time: Array) -> Array | None:
        """Find heights above the floor of what sites stand on.

        Parameters
        ----------
        sites : of contact
        time : (frames,) [s]

        Returns
        -------
        (frames, sites) [m], None where all stand on the floor
        """
        steps = [support for support in self.all if support.kind == "step"]
        if not steps:
            return None
        result = np.zeros((len(time), len(sites)))
        for step in steps:
            columns = [column for column, site in enumerate(sites) if site.group == step.contact]
            result[np.ix_(_within(time, (step.window,)), np.array(columns, int))] = step.height
        return result

    def sites(self, model: Model, known: Iterable[Site]) -> tuple[Site, ...]:
        """Make sites of hands and seat that rest, but for those that are known already."""
        names = {site.name for site in known}
        missing = dict.fromkeys(
            support.contact
            for support in self.all
            if support.kind != "step" and support.contact not in names
        )
        return body_sites(model, tuple(missing))

    def activated(self, ready: Series, sites: Sequence[Site]) -> Series:
        """Let hands on rails carry, and nothing else where nothing else is estimated.

        Parameters
        ----------
        ready : activations (frames, sites)
        sites : one per column
        """
        values = np.array(ready.values)
        rails = [support for support in self.all if support.kind == "rail"]
        for name in dict.fromkeys(rail.contact for rail in rails):
            windows = [rail.window for rail in rails if rail.contact == name]
            for column, site in enumerate(sites):
                if site.group == name:
                    values[:, column] = _within(ready.time, windows)
        return replace(ready, values=values * self.touching(sites, ready.time))

    def cut(self, contacts: Contacts, sites: Sequence[Site]) -> Contacts:
        """Cut contacts to times at which sites can touch, where nothing else is estimated.

        Parameters
        ----------
        contacts : of all sites
        sites : of contact
        """
        if not self.alone:
            return contacts
        groups = {site.name: site.group for site in sites}
        touches = [
            replace(touch, start=max(touch.start, start), stop=min(touch.stop, stop))
            for touch in contacts.intervals
            for start, stop in self._times(groups[touch.site])
            if max(touch.start, start) <= min(touch.stop, stop)
        ]
        return replace(contacts, intervals=tuple(touches))

    def _times(self, group: str) -> tuple[Span, ...]:
        """Find the times at which a group of sites can touch [s], where nothing else is estimated.

        A foot that no plate carries meanwhile takes part, wherever it stands.
        """
        foot = group.rpartition("_")[0].endswith("foot")
        spans = sorted(
            support.window if support.contact == group else support.rests
            for support in self.all
            if foot or support.contact == group
        )
        joined: list[Span] = []
        for start, stop in spans:
            if joined and start <= joined[-1][1]:
                joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
            else:
                joined.append((start, stop))
        return tuple(joined)

    def touching(self, sites: Sequence[Site], time: Array) -> Flags:
        """Flag times at which sites can touch.

        Parameters
        ----------
        sites : of contact
        time : (frames,) [s]

        Returns
        -------
        (frames, sites)
        """
        if not self.alone:
            return np.ones((len(time), len(sites)), bool)
        result = np.zeros((len(time), len(sites)), bool)
        for column, site in enumerate(sites):
            result[:, column] = _within(time, self._times(site.group))
        return result

    def during(self, time: Array) -> Flags:
        """Flag frames in which contacts are estimated: all, where not only these are.

        Parameters
        ----------
        time : (frames,) [s]

        Returns
        -------
        (frames,)
        """
        if not self.alone:
            return np.ones(len(time), bool)
        return _within(time, [support.window for support in self.all])

    def rail_contacts(self) -> Contacts:
        """Make contacts of hands with what they hold on to."""
        rails = [support for support in self.all if support.kind == "rail"]
        touches = tuple(
            Touch(site=rail.contact, start=rail.window[0], stop=rail.window[1], source=FOUND)
            for rail in rails
        )
        return Contacts(tuple(dict.fromkeys(rail.contact for rail in rails)), touches)

    def used(self, wrenches: Wrenches) -> Wrenches:
        """Leave out measured forces while they act on a part of a step only.

        Parameters
        ----------
        wrenches : at the motion's times

        Returns
        -------
        the same, 0 at the times of such a step
        """
        forces = np.array(wrenches.forces)
        torques = np.array(wrenches.torques)
        for support in self.all:
            frames = _within(wrenches.time, (support.window,))
            for column, name in enumerate(wrenches.names):
                if name in support.unused:
                    forces[frames, column] = 0.0
                    torques[frames, column] = 0.0
        return replace(wrenches, forces=forces, torques=torques) if self._unused else wrenches

    @property
    def sentence(self) -> str:
        """Which forces are estimated, and from which assumption."""
        first = "; ".join(support.sentence for support in self.all[:3])
        more = f" and {len(self.all) - 3} more times" if len(self.all) > 3 else ""
        unused = ", ".join(f"'{name}'" for name in self._unused)
        beside = ""
        if unused:
            beside = f"; {unused} acts on a part of a step, so it is not used meanwhile"
        return (
            f"forces of {first}{more} are estimated from the motion: known forces leave weight that"
            f" acts there, where the part keeps still{beside}"
        )

    def without_estimated(self, wrenches: Wrenches) -> Wrenches:
        """Leave out findings that a load is not known, at times at which it is found.

        Parameters
        ----------
        wrenches : on bodies, at the motion's times
        """
        findings = []
        for finding in wrenches.findings:
            if finding.kind == UNDETERMINED:
                known = _within(wrenches.time, self._found_for(finding.place, wrenches))
                unknown = _within(wrenches.time, finding.times) & ~known
                finding = replace(finding, times=spans_of(wrenches.time, unknown))
                if not finding.times:
                    continue
            findings.append(finding)
        return replace(wrenches, findings=tuple(findings))

    def _found_for(self, foot: str, wrenches: Wrenches) -> list[Span]:
        """Find times at which the load of a foot is found, or its own plate measured it [s].

        Beside a step that presses on a plate in part the load of the other foot is known, too.
        """
        spans = []
        for support in self.all:
            during = _within(wrenches.time, (support.rests,))
            own = [
                column
                for column, name in enumerate(wrenches.names)
                if wrenches.bodies[column] == foot and name not in support.unused
            ]
            sizes = np.linalg.norm(np.nan_to_num(wrenches.forces[during][:, own]), axis=2)
            unmeasured = not (sizes > 0.0).any(axis=1).mean() > HALF
            if foot == support.body or unmeasured or support.unused:
                spans.append(support.window if foot == support.body else support.rests)
        return spans

    @property
    def _unused(self) -> tuple[str, ...]:
        """Names of forces that are not used at times."""
        return tuple(dict.fromkeys(name for support in self.all for name in support.unused))


def _within(time: Array, spans: Iterable[Span]) -> Flags:
    """Flag times (frames,) within some spans [s]."""
    result = np.zeros(len(time), bool)
    for start, stop in spans:
        result |= (time >= start - 1e-9) & (time <= stop + 1e-9)
    return result

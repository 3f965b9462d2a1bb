"""When each foot is on the ground, and how much of that a plate measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.messages import Span
from myomorph.core.model.series import Series
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.analysis.walking import chains, walking_limbs
from myomorph.lab.movements.support_force import Contact, find_contacts, zeroed
from myomorph.lab.report.trial.answer.torque_window import undetermined_spans
from myomorph.lab.report.trial.prepared import Prepared

WHOLE = 0.95
"""A stance is measured where a plate carried the foot for this share of it, ..."""
NONE = 0.05
"""... and not measured where for less than this one; else in part."""


@dataclass(frozen=True, kw_only=True)
class FootStance:
    """A foot on the ground.

    Attributes
    ----------
    side : "right" or "left"
    start, stop : of the stance, within the recording [s]
    measured : stretches of it in which a plate measured the foot's load alone [s]
    """

    side: str
    start: float
    stop: float
    measured: tuple[Span, ...]

    @property
    def share(self) -> float:
        """Share of the stance that was measured."""
        lasting = sum(stop - start for start, stop in self.measured)
        return lasting / (self.stop - self.start)

    @property
    def words(self) -> str:
        """How it was measured."""
        if self.share >= WHOLE:
            return "measured"
        return "not measured" if self.share < NONE else "measured in part"


def foot_stances(prepared: Prepared) -> tuple[FootStance, ...]:
    """Find the stances of both feet by their strides, and what plates measured of each.

    Parameters
    ----------
    prepared : with strides, and forces as measured

    Returns
    -------
    in order of time; none where no foot was seen to step
    """
    strides = prepared.strides
    if strides is None:
        return ()
    found = []
    for limb, strikes in strides.strikes.items():
        side = split_side(limb)[1]
        if side not in SIDES:
            continue
        plates = _measured(prepared, limb)
        lifts = sorted(float(time) for time in strides.lifts.get(limb, ()))
        for start, stop in _stances(sorted(map(float, strikes)), lifts, prepared.span):
            inside = [(max(start, first), min(stop, last)) for first, last in plates]
            measured = tuple((first, last) for first, last in inside if first < last)
            found.append(FootStance(side=side, start=start, stop=stop, measured=measured))
    return tuple(sorted(found, key=lambda stance: stance.start))


def _stances(strikes: list[float], lifts: list[float], span: Span) -> list[Span]:
    """Return from each strike to the lift that follows it, and what the ends of a recording cut."""
    events = sorted([(time, True) for time in strikes] + [(time, False) for time in lifts])
    found = []
    if events and not events[0][1]:
        found.append((span[0], events[0][0]))
    for (time, strikes_now), following in zip(events, [*events[1:], (span[1], False)], strict=True):
        if strikes_now and not following[1]:
            found.append((time, following[0]))
    return [(start, stop) for start, stop in found if start < stop]


def _measured(prepared: Prepared, limb: str) -> list[Span]:
    """Return when a plate measured the load of a foot alone [s]."""
    results = prepared.results
    model = results.model
    force = results.dynamics.measured or _filtered(prepared)
    weight = prepared.weight
    if model is None or force is None or not weight or len(force) < 3:
        return []
    own = chains(model, walking_limbs(model)).get(limb, frozenset())
    columns = [place for place, name in enumerate(force.names) if name in own]
    if not columns:
        return []
    carried = zeroed(force.time, force.values[:, columns].sum(axis=1), weight)
    contacts: tuple[Contact, ...] = find_contacts(force.time, carried, weight)
    found = [(contact.start, contact.stop) for contact in contacts]
    for start, stop in undetermined_spans(prepared, limb):
        found = [part for span in found for part in _without(span, start, stop)]
    return found


def _without(span: Span, start: float, stop: float) -> list[Span]:
    """Cut a stretch out of a span of time [s]."""
    first, last = span
    parts = [(first, min(last, start)), (max(first, stop), last)]
    return [(begin, end) for begin, end in parts if begin < end]


def _filtered(prepared: Prepared) -> Series | None:
    """Vertical forces that torques follow from, of results without measured ones."""
    wrenches = prepared.results.dynamics.wrenches
    if wrenches is None or not wrenches.names:
        return None
    upward = np.nan_to_num(wrenches.forces @ prepared.up)
    names = tuple(dict.fromkeys(wrenches.bodies))
    sums = [upward[:, [body == name for body in wrenches.bodies]].sum(axis=1) for name in names]
    return Series(wrenches.time, names, np.array(sums).T)

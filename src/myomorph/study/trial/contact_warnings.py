"""Warnings about estimated contact forces: what the data leave open, and infeasible contact frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.series import Table
from myomorph.report.trial.given import ForceIntervals, InfeasibleContact
from myomorph.store.progress import progress
from myomorph.store.results import ResultWriter, Stored
from myomorph.tension.certificates import CertificateOptions, ContactIntervals, contact_intervals
from myomorph.tension.problem import TensionProblem
from myomorph.tension.relaxation import relaxation_lines, relaxations
from myomorph.tension.tension import Tension

AT_ONCE = 8
"""Instants between two reports of progress."""


LARGE = 250
"""Muscles from which on solutions near the optimum are not asked for: that takes seconds an instant there."""


@dataclass(frozen=True, eq=False)
class ContactWarnings:
    """Doubts about a solution.

    Attributes
    ----------
    intervals : one for a few instants each
    infeasible : frames whose contacts cannot carry the motion
    lines : the same for runs of frames, one line each
    """

    intervals: tuple[ContactIntervals, ...]
    infeasible: tuple[InfeasibleContact, ...]
    lines: tuple[str, ...]


def contact_warnings(problem: TensionProblem, tension: Tension, instants: int, name: str) -> ContactWarnings:
    """Ask at some instants, evenly spaced, what the data leave open, and of all frames whether contacts carry them.

    Parameters
    ----------
    problem : as `tension_problem` sets it up with contacts, solved
    name : of the recording, for the progress bar
    """
    marked = relaxations(problem, tension)
    near = CertificateOptions.near if len(tension.muscles) <= LARGE else 0.0
    chosen = np.unique(np.linspace(0, len(tension) - 1, min(instants, len(tension))).round().astype(int))
    intervals = []
    with progress(f"{name}: what is left open", len(chosen)) as advance:
        for start in range(0, len(chosen), AT_ONCE):
            part = chosen[start : start + AT_ONCE]
            intervals.append(contact_intervals(problem, tension, part.tolist(), CertificateOptions(near=near)))
            advance(len(part))
    infeasible = tuple(InfeasibleContact(one.time, one.sentence) for one in marked)
    return ContactWarnings(tuple(intervals), infeasible, relaxation_lines(marked))


def put_warnings(writer: ResultWriter, warnings: ContactWarnings) -> None:
    """Intervals and frames that could not be carried, in a result file."""
    writer.sizes("infeasible_contact", len(warnings.infeasible))
    times = np.array([one.time for one in warnings.infeasible], dtype=np.float64)
    writer.put("infeasible_contact_time", ("infeasible_contact",), times, "s", "frame whose contacts are infeasible")
    writer.texts("infeasible_contact_relaxation", "infeasible_contact", [one.relaxation for one in warnings.infeasible])
    if not warnings.intervals:
        return
    writer.names("contact_group", warnings.intervals[0].groups)
    writer.names("axis", ("x", "y", "z"))
    time = np.concatenate([one.time for one in warnings.intervals])
    writer.sizes("interval_time", len(time))
    writer.put("interval_time", ("interval_time",), time, "s", "instants at which it was asked what is left open")
    writer.texts(
        "max_interval_direction", "interval_time", [text for one in warnings.intervals for text in one.sentences]
    )
    three = ("interval_time", "contact_group", "axis")
    for name, meaning in (
        ("low", "least force that the data allow"),
        ("high", "greatest force that the data allow"),
        ("near_low", "least force among solutions near the optimum"),
        ("near_high", "greatest force among solutions near the optimum"),
    ):
        values = np.concatenate([getattr(one, name) for one in warnings.intervals])
        writer.put(f"interval_{name}", three, values, "N", meaning)


def get_intervals(stored: Stored) -> ForceIntervals | None:
    """Intervals of contact forces of a result, or None."""
    values = stored.values
    if "interval_low" not in values:
        return None
    names = stored.names["contact_group"]
    return ForceIntervals(values["interval_time"], names, values["interval_low"], values["interval_high"])


def get_infeasible_contacts(stored: Stored) -> tuple[InfeasibleContact, ...]:
    """Frames of a result that its contacts cannot carry."""
    times = stored.values.get("infeasible_contact_time", ())
    texts = stored.names.get("infeasible_contact_relaxation", ())
    return tuple(InfeasibleContact(float(time), text) for time, text in zip(times, texts, strict=True))


def interval_table(intervals: Sequence[ContactIntervals]) -> Table:
    """Forces with what the data leave open: `<group>_fx`, `<group>_fx_low`, `<group>_fx_high`, ... [N]."""
    time = np.concatenate([one.time for one in intervals])
    parts = [np.concatenate([getattr(one, name) for one in intervals]) for name in ("forces", "low", "high")]
    names = tuple(
        f"{group}_f{axis}{ending}"
        for group in intervals[0].groups
        for axis in "xyz"
        for ending in ("", "_low", "_high")
    )
    values = np.stack(parts, axis=3).reshape(len(time), -1)
    return Table(time, names, values, facts=FrozenMap({"name": "What the data leave open of contact forces"}))

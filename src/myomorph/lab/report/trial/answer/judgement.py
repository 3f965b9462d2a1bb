"""One verdict on a trial: what its results may be used for, by a rule on its checks.

The rule, so that two people get the same verdict:

- Frames that miss their markers (root mean square), or that no pose fits, in more than
  `MOST_FRAMES`; a marker that misses the body by more than its limit over the whole recording (root
  mean square); open loops: do not use.
- No torques, limbs that bear load which nobody measured in more than `MOST_FRAMES`, a residual
  whose root mean square is over its limit, or contacts that cannot carry the motion: angles only.
- No tensions, or frames without an optimal solution, reserves over their limit or muscles stretched
  beyond sense: angles and torques.
- Else everything may be used. Single peaks over a limit are checks of the page, and no verdict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import CONTACTS_OPEN, FEET_BESIDE
from myomorph.core.model.findings import spans_of, times_text
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.message_groups import CauseGroup
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import Quantity, Verdict
from myomorph.lab.report.trial.answer.sentence import NO_BREAK
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.report.trial.tables import MARKER_LARGEST, MARKER_RMS

Use = Literal["everything", "angles and torques", "angles", "nothing"]

USES: Mapping[Use, str] = FrozenMap(
    {
        "everything": "Usable",
        "angles and torques": "Usable for angles and torques",
        "angles": "Usable for angles only",
        "nothing": "Do not use",
    }
)
"""Verdicts in print."""
MOST_FRAMES = 0.05
"""Share of frames that may miss their markers."""
OF_FRAMES = (Quantity.MARKER_RMS, Quantity.NOT_CONVERGED)
OF_LOOPS = (Quantity.LOOP_CLOSURE,)
OF_TORQUES = (
    Quantity.RESIDUAL_FORCE_RMS,
    Quantity.RESIDUAL_MOMENT_RMS,
    Quantity.CONTACT_FORCE_RMS,
    Quantity.CONTACT_MOMENT_RMS,
    Quantity.INFEASIBLE_CONTACT,
)
OF_MUSCLES = (Quantity.NOT_OPTIMAL, Quantity.RESERVES, Quantity.OVERSTRETCHED)

PLAIN: Mapping[Quantity, str] = FrozenMap(
    {
        Quantity.MARKER_RMS: "Markers miss the body",
        Quantity.NOT_CONVERGED: "Frames without a fitting pose",
        Quantity.LOOP_CLOSURE: "A closed loop stays open",
        Quantity.RESIDUAL_FORCE_RMS: "Residual force",
        Quantity.RESIDUAL_MOMENT_RMS: "Residual moment",
        Quantity.CONTACT_FORCE_RMS: "Residual force besides contacts",
        Quantity.CONTACT_MOMENT_RMS: "Residual moment besides contacts",
        Quantity.INFEASIBLE_CONTACT: "Infeasible contact frames",
        Quantity.NOT_OPTIMAL: "Frames without a muscle solution",
        Quantity.RESERVES: "Torque of reserve actuators",
        Quantity.OVERSTRETCHED: "Overstretched muscles",
    }
)
"""Checks in the words of the page."""


@dataclass(frozen=True)
class Judgement:
    """What may be used, and the most severe reason with its number and limit."""

    use: Use
    reason: str

    @property
    def words(self) -> str:
        """The verdict in print."""
        return USES[self.use]


def judged(prepared: Prepared, causes: Sequence[CauseGroup]) -> Judgement:
    """Return the verdict on what was computed, by the rule of this module."""
    found = _nothing(prepared)
    if found is None:
        limited = _of_torques(prepared, causes) or _of_muscles(prepared)
        use, reason = limited or ("everything", _counted(prepared))
        found = Judgement(use, f"{reason}{_exception(prepared)}")
    simulated = any(note.kind == "simulated" for note in prepared.results.head.notes)
    nobody = " Simulated: nobody was measured." if simulated else ""
    return replace(found, reason=f"{found.reason}{nobody}")


def _counted(prepared: Prepared) -> str:
    """Say how many checks passed."""
    judged_ones = [check for check in prepared.verdicts if check.limit is not None]
    over = sum(check.state == "over" for check in judged_ones)
    if over:
        return f"{over} of {len(judged_ones)} checks are over their limits."
    return f"All {len(judged_ones)} checks passed."


def _nothing(prepared: Prepared) -> Judgement | None:
    """Whether not even angles hold, and why."""
    loops = _most_severe(prepared, OF_LOOPS)
    if loops is not None:
        return Judgement("nothing", _reason(loops))
    frames = _most_severe(prepared, OF_FRAMES)
    share = float(np.mean(missed_frames(prepared)))
    if frames is not None and share > MOST_FRAMES:
        many = f"{100.0 * share:.0f}{NO_BREAK}%"
        text = f"{_reason(frames)} In {many} of the frames they do, or no pose fits."
        return Judgement("nothing", text)
    lost = _lost_marker(prepared)
    return Judgement("nothing", lost) if lost else None


def _lost_marker(prepared: Prepared) -> str:
    """Return which marker misses the body over the whole recording, "" for none."""
    fit = prepared.results.kinematics.fit
    if fit is None or not np.isfinite(fit.marker_error).any():
        return ""
    seen = np.isfinite(fit.marker_error)
    total = np.where(seen, fit.marker_error, 0.0) ** 2
    each = np.sqrt(total.sum(axis=0) / np.maximum(seen.sum(axis=0), 1))
    worst = int(np.argmax(each))
    limit = MARKER_LARGEST * prepared.scale
    if each[worst] <= limit:
        return ""
    size = f"{100.0 * each[worst]:.1f}{NO_BREAK}cm (limit {100.0 * limit:.1f}{NO_BREAK}cm)"
    return f"Marker {fit.marker_names[worst]} misses the body by {size}, root mean square."


def _of_torques(prepared: Prepared, causes: Sequence[CauseGroup]) -> tuple[Use, str] | None:
    """Why torques do not hold, None where they do."""
    results = prepared.results
    if results.dynamics.torques is None:
        if results.dynamics.wrenches is None:
            return "angles", "No force was measured, so there are no torques."
        return "angles", "Torques were not computed."
    unknown = max(
        (cause.largest for cause in causes if cause.cause.key == FEET_BESIDE.key), default=0.0
    )
    if unknown > 100.0 * MOST_FRAMES:
        share = f"{unknown:.0f}{NO_BREAK}%"
        return "angles", f"No plate measured the load of a foot in {share} of the time."
    if any(cause.cause.key == CONTACTS_OPEN.key for cause in causes):
        return "angles", "The forces of some contacts are undetermined."
    check = _most_severe(prepared, OF_TORQUES)
    return None if check is None else ("angles", _reason(check))


def _of_muscles(prepared: Prepared) -> tuple[Use, str] | None:
    """Why muscles do not hold although torques do, None where they do."""
    if prepared.results.tension is None:
        return "angles and torques", "Muscle tensions were not computed."
    check = _most_severe(prepared, OF_MUSCLES)
    return None if check is None else ("angles and torques", _reason(check))


def missed_frames(prepared: Prepared) -> Array:
    """Find the frames that miss their markers.

    Parameters
    ----------
    prepared : with the fit of the markers

    Returns
    -------
    (frames,) whether markers are over their limit, or no pose fits; one False without a fit
    """
    fit = prepared.results.kinematics.fit
    if fit is None or not len(fit.motion):
        return np.zeros(1, dtype=bool)
    with np.errstate(invalid="ignore"):
        missed = fit.rms > MARKER_RMS * prepared.scale
    unsolved = np.asarray(fit.seen) & ~np.asarray(fit.converged, dtype=bool)
    return np.asarray(missed | unsolved)


def _exception(prepared: Prepared) -> str:
    """Return a sentence on the few frames that miss their markers, "" where none does."""
    fit = prepared.results.kinematics.fit
    missed = missed_frames(prepared)
    if fit is None or not missed.any():
        return ""
    return f" Not {times_text(spans_of(fit.motion.time, missed))}: markers miss the body there."


def _most_severe(prepared: Prepared, quantities: tuple[Quantity, ...]) -> Verdict | None:
    """Of some checks the one that is most times its limit; None where all passed."""
    over = [
        check
        for check in prepared.verdicts
        if check.quantity in quantities and check.state == "over"
    ]
    return max(over, key=times_over, default=None)


def times_over(check: Verdict) -> float:
    """How many times its limit a value is; infinite where the limit is 0."""
    return check.value / check.limit if check.limit else float("inf")


def _reason(check: Verdict) -> str:
    """Return a failed check with its number, its limit, and where and when it was worst."""
    unit = "%" if "%" in check.unit else check.unit
    limit = "" if not check.limit else f" (limit {number(check.limit)}{NO_BREAK}{unit})"
    value = f"{check.value:.0f}" if unit.startswith("of ") else number(check.value)
    return f"{PLAIN[check.quantity]}: {value}{NO_BREAK}{unit}{limit}."

"""The answer of a trial: result, verdict, causes of doubt, and who was recorded when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.errors import counted
from myomorph.core.model.message_groups import CauseGroup, grouped_messages
from myomorph.core.model.series import Series
from myomorph.lab.analysis.muscle_names import plain_name
from myomorph.lab.report.trial.answer.judgement import Judgement, judged
from myomorph.lab.report.trial.answer.main_result import MainResult
from myomorph.lab.report.trial.answer.movements import main_result
from myomorph.lab.report.trial.answer.sentence import NO_BREAK
from myomorph.lab.report.trial.prepared import Prepared


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What somebody reads first.

    Attributes
    ----------
    result : sentence, curves and poses of the movement; None where nothing moves
    judgement : what may be used, and why
    causes : messages of all steps by their cause, the most severe first
    facts : who, when, which movement, measured by what
    busiest : of each pose the most active muscle with its activation, as "soleus 41 %"; "" where
        none is known
    """

    result: MainResult | None
    judgement: Judgement
    causes: tuple[CauseGroup, ...]
    facts: Mapping[str, str]
    busiest: tuple[str, ...]


def answer_of(prepared: Prepared) -> Answer:
    """Return the answer that a trial gives."""
    causes = grouped_messages(prepared.results.head.warnings)
    judgement = judged(prepared, causes)
    result = main_result(prepared, judgement.use)
    poses = () if result is None else result.poses
    activations = prepared.results.activations
    return Answer(
        result=result,
        judgement=judgement,
        causes=causes,
        facts=_facts(prepared, result),
        busiest=tuple(_busiest(activations, pose.time) for pose in poses),
    )


def judgement_of(prepared: Prepared) -> Judgement:
    """Return the verdict on a trial alone, for tables that need no more of its answer."""
    return judged(prepared, grouped_messages(prepared.results.head.warnings))


def _busiest(activations: Series | None, time: float) -> str:
    """Return the plain name of the muscle that is most active at a time; "" where none is known."""
    if activations is None or not len(activations):
        return ""
    frame = int(np.argmin(np.abs(activations.time - time)))
    values = {
        plain_name(name): float(value)
        for name, value in sorted(
            zip(activations.names, activations.values[frame], strict=True),
            key=lambda pair: np.nan_to_num(pair[1]),
        )
        if np.isfinite(value) and plain_name(name)
    }
    if not values:
        return ""
    name = max(values, key=lambda each: values[each])
    return f"{name} {100.0 * values[name]:.0f}{NO_BREAK}%"


def _facts(prepared: Prepared, result: MainResult | None) -> dict[str, str]:
    """Who, when, movement and instruments, one line each."""
    results = prepared.results
    recorded = results.recorded
    mass = "" if recorded.mass is None else f"{recorded.mass:.1f}{NO_BREAK}kg"
    who = ", ".join(part for part in (recorded.subject, mass) if part) or "not known"
    computed = results.head.date[:10]
    day = f"recorded {recorded.date}" if recorded.date else "day of recording not known"
    facts = {"Who": who, "When": f"{day}; computed {computed}" if computed else day}
    if result is not None:
        facts["Movement"] = f"{result.movement.lower()}, {result.amount}"
    facts["Measured by"] = "; ".join(_instruments(prepared)) or "not known"
    return facts


def _instruments(prepared: Prepared) -> list[str]:
    """Markers with their fit, sensors, plates and EMG."""
    results = prepared.results
    fit = results.kinematics.fit
    words = []
    if fit is not None and fit.marker_names and np.isfinite(fit.marker_error).any():
        rms = 100.0 * float(np.sqrt(np.nanmean(fit.marker_error**2)))
        words.append(f"{len(fit.marker_names)} markers, fit {rms:.1f}{NO_BREAK}cm")
    if fit is not None and fit.sensor_names:
        words.append(f"{len(fit.sensor_names)} inertial sensors")
    plates = len(recorded_plates) if (recorded_plates := results.recorded.plates) else 0
    wrenches = results.dynamics.wrenches
    if plates:
        words.append(counted(plates, "force plate"))
    elif wrenches is not None and len(wrenches.names):
        words.append(f"{len(wrenches.names)} measured forces")
    else:
        words.append("no force plate")
    emg = results.recorded.emg
    if emg is not None:
        words.append(f"EMG of {len(emg.names)} channels")
    return words

"""The low-pass filter of a trial that nobody stated: chosen by the noise of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import HIDDEN, RATES
from myomorph.core.model.errors import counted
from myomorph.core.model.messages import Message
from myomorph.core.model.motion_errors import MotionErrors
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Motion
from myomorph.core.motion.cutoff_choice import CutoffChoice, choose_cutoff
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.noise_evidence import NO_EVIDENCE, NoiseEvidence
from myomorph.core.motion.root_chart import root_chart
from myomorph.core.motion.smoother import SmoothedMotion, smoothed_by
from myomorph.lab.store.settings import Differentiation
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.motion import RecordedMotion
from myomorph.lab.study.inputs.refined import RefinedMotion
from myomorph.lab.study.inputs.session import RecordedSession
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.trial.trial_inputs import TrialInputs

SLOWEST_STEP = 3.0
"""Time from frame to frame from which a motion may be in another unit: 333 Hz in ms [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenFilter:
    """A filter that was chosen already, or is tried in its place.

    As an input of a trial it takes the place of the one that the recording would choose: errors
    that are drawn are not to choose a filter of their own.

    Attributes
    ----------
    choice : by the recording
    factor : of its cutoff
    """

    choice: CutoffChoice
    factor: float = 1.0

    @property
    def cutoff(self) -> float | None:
        """Cutoff [Hz], None for no filter."""
        return None if self.choice.cutoff is None else self.factor * self.choice.cutoff


def chosen_filter(trial: TrialInputs, recorded: Motion) -> ChosenFilter | None:
    """Find the filter of a motion; None where somebody stated one, or the motion was refined."""
    if trial.options[Differentiation].cutoff is not None or trial.get(RefinedMotion) is not None:
        return None
    chosen = trial.get(ChosenFilter)
    if chosen is not None:
        return chosen
    chart = root_chart(trial.model, recorded)
    # Forces and markers are those of the model's own angles.
    evidence = NO_EVIDENCE if chart.pairs else evidence_of(trial, recorded)
    choice = choose_cutoff(chart.motion, trial.model, movement_of(trial), evidence)
    return ChosenFilter(choice=choice)


def evidence_of(trial: TrialInputs, recorded: Motion) -> NoiseEvidence:
    """Find the markers and forces that show the noise of a motion, where they were measured."""
    loads = trial.get(ExternalLoads)
    measured = loads is not None and trial.get(RecordedTorques) is None
    return NoiseEvidence(
        markers=None if trial.get(RecordedMotion) is not None else trial.recording.markers,
        weights=trial.options[InverseKinematicsOptions],
        wrenches=loads.of(recorded) if loads is not None and measured else None,
    )


def movement_of(trial: TrialInputs) -> Movement | None:
    """Find the movement that a trial is of, None where it is not known."""
    session = trial.get(RecordedSession)
    return None if session is None else session.movement.value


def cutoff_of(trial: TrialInputs, recorded: Motion) -> float | None:
    """Find the cutoff for a motion and its forces [Hz], None for none.

    A refined motion is changed only by a lower one.
    """
    chosen = chosen_filter(trial, recorded)
    if chosen is not None:
        return chosen.cutoff
    cutoff = trial.options[Differentiation].cutoff
    refined = trial.get(RefinedMotion)
    if refined is not None and (cutoff is None or cutoff >= refined.cutoff):
        return None
    return cutoff or None


@dataclass(frozen=True, kw_only=True, eq=False)
class Differentiated:
    """A motion with velocities and accelerations, and what is to be said of its gaps.

    Attributes
    ----------
    motion : with derivatives
    errors : that the filter leaves in it, None where they are not known
    notes : of gaps
    """

    motion: Motion
    errors: MotionErrors | None = None
    notes: tuple[Message, ...] = ()


def differentiated(trial: TrialInputs, recorded: Motion) -> Differentiated:
    """Differentiate a motion, by the stated filter or the chosen one.

    Those of a body that turns over are taken in angles that do not jump (`root_chart`).
    """
    chart = root_chart(trial.model, recorded)
    chosen = chosen_filter(trial, recorded)
    if chosen is None:
        motion = differentiate(chart.motion, cutoff_of(trial, recorded))
        return Differentiated(motion=chart.back(motion))
    smoothed = smoothed_by(chart.motion, chosen.choice, chosen.cutoff)
    return Differentiated(
        motion=chart.back(smoothed.motion),
        # Of other angles of a floating body, errors are those of these.
        errors=None if chart.pairs else smoothed.errors,
        notes=(*gap_messages(smoothed), *slow_messages(recorded)),
    )


def slow_messages(recorded: Motion) -> tuple[Message, ...]:
    """Ask for the unit of times that make a motion one of seconds from frame to frame."""
    step = float(np.median(np.diff(recorded.time))) if len(recorded) > 1 else 0.0
    if step < SLOWEST_STEP:
        return ()
    text = (
        f"the frames of the motion are {step:.3g} s apart: are its times in milliseconds? Times are"
        " in seconds; velocities and accelerations follow them"
    )
    return (RATES.message(text, severity="may change results"),)


def gap_messages(smoothed: SmoothedMotion) -> tuple[Message, ...]:
    """Report gaps that were bridged, and what stands beside those that were not."""
    time = smoothed.motion.time
    messages = []
    if smoothed.bridged.any():
        text = f"{counted(int(smoothed.bridged.sum()), 'frame')} without a pose bridged"
        times = spans(time, runs(smoothed.bridged))
        messages.append(HIDDEN.message(text, times=times, severity="good to know"))
    # The ends of a recording are such in every one.
    inside = [
        (start, stop) for start, stop in runs(smoothed.uncertain) if start > 0 and stop < len(time)
    ]
    if inside:
        frames = sum(stop - start for start, stop in inside)
        text = f"beside gaps the accelerations of {counted(frames, 'frame')} are less certain"
        messages.append(HIDDEN.message(text, times=spans(time, inside), severity="good to know"))
    return tuple(messages)


def spans(time: Array, frames: Sequence[tuple[int, int]]) -> list[tuple[float, float]]:
    """Find the times from the first to the last frame of each stretch.

    Parameters
    ----------
    time : (frames,) [s]
    frames : start and stop of each stretch, the stop not included

    Returns
    -------
    [s] of each
    """
    return [(float(time[start]), float(time[stop - 1])) for start, stop in frames]


def with_bridges(recorded: Motion, motion: Motion) -> Motion:
    """Coordinates as recorded, and as smoothed in gaps that were bridged.

    Parameters
    ----------
    recorded : (frames, coordinates), NaN in gaps
    motion : the same as smoothed, or a part of it

    Returns
    -------
    coordinates at the times of `recorded`
    """
    frames = np.searchsorted(recorded.time, motion.time - 1e-9)
    frames = np.minimum(frames, len(recorded) - 1)
    same = np.abs(recorded.time[frames] - motion.time) < 1e-6
    values = recorded.values.copy()
    own = values[frames[same]]
    values[frames[same]] = np.where(np.isfinite(own), own, motion.values[same])
    return replace(recorded, values=values)


@dataclass(frozen=True, kw_only=True)
class FilterByNoise:
    """What a result depends on where nobody stated a cutoff, beside options.

    Attributes
    ----------
    filter_by_noise : movement that decides where the noise is not known, "" where it is not known
    """

    filter_by_noise: str


def filter_key(trial: TrialInputs) -> tuple[FilterByNoise, ...]:
    """List what results of the default filter depend on, nothing where a cutoff was stated."""
    if trial.options[Differentiation].cutoff is not None:
        return ()
    return (FilterByNoise(filter_by_noise=movement_of(trial) or ""),)

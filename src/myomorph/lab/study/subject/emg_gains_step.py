"""The step `emg` of a study.

It finds gains, delay and shape of a subject's EMG channels over all trials of the subject.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial
from myomorph.body.tension.task import added_reserves
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.tension.emg_quantities import CHANNEL_TABLE
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.actuators import floating_joints
from myomorph.lab.store.progress import progress
from myomorph.lab.study.inputs.actuators import Actuators
from myomorph.lab.study.inputs.emg import RecordedEmg
from myomorph.lab.study.inputs.emg_gains import SubjectGains, common_scale, rescaled, write_gains
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.motion import RecordedMotion
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.subject_files import SubjectInputs, recordings_provenance
from myomorph.lab.study.trial.emg_tables import write_channels
from myomorph.lab.study.trial.steps.id import solve_dynamics
from myomorph.lab.study.trial.steps.ik import solve_kinematics
from myomorph.lab.study.trial.trial_inputs import TrialInputs

GAINS = "gains.json"
TRIALS = "trials.csv"


def subject_gains(trials: Sequence[TrialInputs]) -> tuple[SubjectGains, Mapping[str, str]]:
    """Estimate gains of a subject's channels over all trials.

    With them come the reasons why a trial takes no part, by trial ("" for those that take part).
    Envelopes that were scaled to a recording's own largest value are brought to the largest of all
    recordings first.
    """
    parts = {trial.name: _left_out(trial) for trial in trials}
    used = [trial for trial in trials if not parts[trial.name]]
    if not used:
        reasons = "; ".join(f"{name}: {why}" for name, why in parts.items())
        raise BadData(
            f"no trial determines EMG gains ({reasons}): leave the step 'emg' out, or give trials"
            " that do"
        )
    muscles = _muscles(used)
    scale = common_scale([trial.inputs[RecordedEmg].scale for trial in used])
    emg_trials = [_emg_trial(trial, scale) for trial in used]
    first = used[0]
    tension = first.options[TensionOptions]
    beside = first.get(Actuators)
    calibration = calibrate_emg(
        first.model,
        emg_trials,
        muscles,
        first.options[EmgOptions],
        tension,
        added_reserves(first.model, tension) if beside is None else beside.actuators,
        _maxima(used, muscles, scale),
    )
    return SubjectGains(calibration, scale), parts


def _emg_trial(trial: TrialInputs, scale: Mapping[str, float]) -> EmgTrial:
    """Solve a trial for the torques that its EMG is compared with.

    `scale`: what envelopes of each channel are divided by, in all trials.
    """
    recorded_emg = trial.inputs[RecordedEmg]
    motion = trial.get(RecordedMotion)
    with progress(f"{trial.name}: EMG and torques", 1, "trials") as advance:
        recorded = solve_kinematics(trial).fit.motion if motion is None else motion.motion
        dynamics = solve_dynamics(trial, recorded)
        emg = rescaled(recorded_emg.emg, recorded_emg.scale, scale)
        advance(1)
    return EmgTrial(dynamics.motion, dynamics.torques, emg)


def _maxima(
    trials: Sequence[TrialInputs], muscles: Mapping[str, object], scale: Mapping[str, float]
) -> dict[str, float]:
    """Return envelopes of maximum voluntary contractions, of channels that have muscles.

    They are of the same contractions in all trials, in the units that all trials have now.
    """
    return {
        name: maximum * emg.scale.get(name, 1.0) / scale.get(name, 1.0)
        for emg in (trial.inputs[RecordedEmg] for trial in trials)
        for name, maximum in emg.maxima.items()
        if name in muscles
    }


def _left_out(trial: TrialInputs) -> str:
    """Why a trial does not determine gains, "" where it does."""
    recorded = trial.get(RecordedEmg)
    if recorded is None:
        return "no EMG"
    if not recorded.muscles:
        return "no channel's name contains a muscle of the model"
    if trial.get(ContactPlan) is not None:
        return "its contact forces are estimated, so its torques are not known before its tensions"
    forces = trial.get(ExternalLoads) or trial.get(RecordedTorques)
    if forces is None and floating_joints(trial.model):
        return "no external forces"
    return ""


def _muscles(trials: Sequence[TrialInputs]) -> dict[str, tuple[str, ...]]:
    """Muscles of the channels that all trials have."""
    first = trials[0]
    common = dict(first.inputs[RecordedEmg].muscles)
    for trial in trials[1:]:
        channels = trial.inputs[RecordedEmg].muscles
        for channel, names in channels.items():
            if channel in common and tuple(common[channel]) != tuple(names):
                raise BadData(
                    f"EMG channel '{channel}' is of {', '.join(common[channel])} in '{first.name}',"
                    f" but of {', '.join(names)} in '{trial.name}': gains of all trials need the"
                    " same electrodes"
                )
        common = {channel: names for channel, names in common.items() if channel in channels}
    if not common:
        listed = ", ".join(trial.name for trial in trials)
        raise BadData(
            f"no EMG channel is in all of the trials {listed}: gains of all trials need the same"
            " electrodes"
        )
    return common


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    trials = subject.trials()
    gains, parts = subject_gains(trials)
    muscles = _muscles([trial for trial in trials if not parts[trial.name]])
    with output.whole() as folder:
        write_gains(gains, folder / GAINS)
        write_channels(gains.calibration, muscles, folder / CHANNEL_TABLE)
        rows = ((name, "no" if why else "yes", why) for name, why in parts.items())
        write_csv(folder / TRIALS, ("trial", "used", "reason"), rows)


STEP = Step(
    name="emg",
    title="EMG gains over all trials",
    scope="subject",
    tables="emg_gains",
    leaves=FrozenMap({"gains": f"emg_gains/{GAINS}"}),
    run=_run,
    made_from=lambda subject: recordings_provenance(
        "emg", subject, earlier=("ik", "id", "tension")
    ),
)

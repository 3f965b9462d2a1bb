"""What an automatic cutoff decides, and what examining it costs."""

from __future__ import annotations

from myomorph.core.motion.cutoff_choice import CutoffChoice
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.table import settings_of_keys
from myomorph.lab.study.trial.default_filter import ChosenFilter
from myomorph.lab.study.trial.steps import id as inverse_dynamics_step
from myomorph.lab.study.trial.steps.ik import recorded_poses
from myomorph.lab.study.trial.trial_inputs import TrialFiles, open_trial


def opened(arm, cutoff=None):
    files = TrialFiles(
        arm.model, inputs=settings_of_keys({"motion": arm.motion, "loads": arm.loads})
    )
    return open_trial(files, {"id": {} if cutoff is None else {"cutoff": cutoff}})


def test_forces_are_read_and_checked_once(arm):
    trial = opened(arm)
    loads = trial.get(ExternalLoads)
    calls = []

    def counted(motion):
        calls.append(motion)
        return loads.of(motion)

    trial = trial.having(ExternalLoads.on_known_bodies(counted))
    recorded = recorded_poses(trial).recorded
    choice = CutoffChoice(cutoff=6.0, origin="noise", spectra=None)
    trial = trial.having(ChosenFilter(choice=choice))
    dynamics = inverse_dynamics_step.solve_dynamics(trial, recorded)
    effect = inverse_dynamics_step.filter_effect(trial, recorded, dynamics)
    assert effect is not None
    assert len(calls) == 1


def test_a_given_cutoff_is_not_examined(arm):
    trial = opened(arm, cutoff=6.0)
    recorded = recorded_poses(trial).recorded
    dynamics = inverse_dynamics_step.solve_dynamics(trial, recorded)
    assert inverse_dynamics_step.filter_effect(trial, recorded, dynamics) is None

"""Vertical forces as plates measured them, beside the filtered ones that torques follow from."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.lab.store.stored import put_measured_force
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.step.step import StepOutput
from myomorph.lab.study.trial.trial_inputs import TrialInputs


def put_measured(trial: TrialInputs, recorded: Motion, output: StepOutput) -> None:
    """Write the vertical force on each body as measured; nothing where no force was."""
    loads = trial.get(ExternalLoads)
    if loads is None or trial.get(RecordedTorques) is not None:
        return
    span = float(recorded.time[0]), float(recorded.time[-1])
    start, stop = span if trial.time is None else trial.time
    measured = vertical_forces(loads.of(recorded), trial.model)
    inside = (measured.time >= start - 1e-9) & (measured.time <= stop + 1e-9)
    if inside.any() and measured.names:
        put_measured_force(output.writer, measured.frames(inside))


def vertical_forces(wrenches: Wrenches, model: Model) -> Series:
    """Add up the vertical forces on each body.

    Parameters
    ----------
    wrenches : (samples, forces, 3) in ground, as measured [N]
    model : whose vertical counts

    Returns
    -------
    (samples, bodies) [N]; a force on no body is under the name of its plate
    """
    upward = np.nan_to_num(wrenches.forces @ np.asarray(model.up))
    owners = [body or name for name, body in zip(wrenches.names, wrenches.bodies, strict=True)]
    names = tuple(dict.fromkeys(owners))
    sums = np.zeros((len(wrenches.time), len(names)))
    for column, owner in zip(upward.T, owners, strict=True):
        sums[:, names.index(owner)] += column
    return Series(wrenches.time, names, sums)

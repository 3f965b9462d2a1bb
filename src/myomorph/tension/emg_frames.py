"""The balance of some frames of trials with EMG, as full matrices, for the calibration of its channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.series import Emg, Motion, Series
from myomorph.tension.problem import TensionInputs, tension_problem
from myomorph.tension.terms.actuators import default_reserves
from myomorph.tension.terms.contacts import ContactTask

LOUD = 10.0  # How many times the RMS of the torques an unmeasured contact may make of them


@read_only
class TrackedFrames:
    """What the balance of some frames of a trial is made of."""

    time: Array  # (frames,) [s]
    columns: Array  # (frames, rows, muscles) generalized force of one unit of activation [N m or N]
    torques: Array  # (frames, rows) to be balanced [N m or N]
    others: Array  # (frames, rows, others) what else may act, in units of its standard deviation [N m or N]
    emg: Emg  # envelopes, its channels those that are calibrated
    gram: Array  # (muscles, muscles) products of what muscles do at all joints, rows that are left out here included


def few_frames(motion: Motion, torques: Series, every: int) -> tuple[Motion, Series]:
    """Every so many frames of a motion with velocities and what else it has, and of its torques."""
    return motion.frames(slice(None, None, every)), torques.frames(slice(None, None, every))


def tracked_frames(inputs: TensionInputs, emg: Emg, tells: Array, every: int) -> TrackedFrames:
    """Every so many frames, on rows that tell of muscles under EMG; `tells` (muscles, channels) which tells which."""
    few, wanted = few_frames(inputs.motion, inputs.torques, every)
    touching = None if inputs.contacts is None else _thinned(inputs.contacts, slice(None, None, every))
    problem = tension_problem(replace(inputs, motion=few, torques=wanted, contacts=touching))
    balance = problem.balance(0, len(few))
    rows = problem.assembly.coordinate_row
    whole, right = problem.separable.dense(balance.values)[:, rows], balance.right[:, rows]
    count = len(problem.muscles.strength)
    # Frames that are not known (a body not in sight) say nothing of how large the others are.
    known = np.nan_to_num(whole)
    size = np.sqrt(np.mean(right[np.isfinite(right)] ** 2)) + 1e-12
    others = [np.zeros((len(few), len(rows), 0))]
    if problem.contacts is not None:
        amplitudes = whole[:, :, problem.unknowns.of(problem.contacts)]
        largest = np.abs(known[:, :, problem.unknowns.of(problem.contacts)]).max(axis=(0, 1), initial=0.0)
        others.append(amplitudes * (LOUD * size / np.maximum(largest, 1e-12)))
    added = default_reserves(inputs.model) if inputs.actuators is None else inputs.actuators
    names = {actuator.name for actuator in added}
    place = problem.unknowns.of(problem.actuators)
    own = [index for index, name in enumerate(problem.unknowns.names[place]) if name not in names]
    others.append(whole[:, :, place][:, :, own])
    reached = np.abs(known[:, :, :count][:, :, tells.any(axis=1)]).max(axis=(0, 2), initial=0.0) > 0.0
    # Contacts that nobody measured act on all rows at once, so that one row says something of the others.
    kept = reached if touching is None else np.ones(len(rows), dtype=bool)
    acting = np.concatenate(others, axis=2)[:, kept]
    good = np.isfinite(whole[:, kept]).all(axis=(1, 2)) & np.isfinite(right[:, kept]).all(axis=1)
    muscles = known[:, :, :count].reshape(-1, count)
    gram = muscles.T @ muscles
    return TrackedFrames(few.time[good], whole[good][:, kept, :count], right[good][:, kept], acting[good], emg, gram)


def _thinned(contacts: ContactTask, chosen: slice) -> ContactTask:
    """The same contacts at fewer instants."""
    preferred = None if contacts.preferred is None else contacts.preferred[chosen]
    measured = tuple(
        replace(wrench, forces=wrench.forces[chosen], moments=wrench.moments[chosen]) for wrench in contacts.measured
    )
    return replace(contacts, activations=contacts.activations.frames(chosen), preferred=preferred, measured=measured)

"""The force that statics allow in knees, without muscles, beside what implants measured.

Two instrumented knees over their walks, and squats and rises of a person without an implant beside
the range of other people's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension import knee, knee_trials
from benchmarks.accuracy.tension.knee_activities import ACTIVITIES, EXPERT, inputs
from benchmarks.results import Row
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.arrays import Array
from myomorph.core.tension.static_loads import StaticLoads, static_joint_loads

CUTOFF = 6.0
"""Of coordinates and ground forces [Hz]."""


def measure(folder: Path) -> Iterator[Row]:
    """Rows of recordings with a measured force, then of those without."""
    for stride in knee.STRIDES:
        if (folder / knee.STUDY).is_dir():
            model, motion, _ = knee.inputs_of(folder, stride)
            loads = read_external_loads(folder / knee.STUDY / f"{stride}_grf.xml")
            truth, clock = knee.measured(folder, stride)
            found = statics(model, motion, loads)
            yield _compared(stride, found, knee.JOINT, clock, truth[:, 0])
    source = folder / knee_trials.FOLDER
    if (source / knee_trials.GENERAL_MODEL).is_file():
        for trial in knee_trials.TRIALS:
            yield _of_trial(source, trial)
    else:
        print(f"knee_statics: the data folder has no {knee_trials.FOLDER}")
    for activity in ACTIVITIES:
        if (folder / activity.folder).is_dir():
            model, motion, wrenches = inputs(folder, activity, EXPERT)
            standing = wrenches.forces[:, :, 1].sum(axis=1) > 0.9 * model.weight
            found = static_joint_loads(model, motion, wrenches)
            yield _without_implant(activity.name, found, standing) | {
                "maximum in implants [BW]": activity.implants
            }


def statics(model: mm.Model, motion: mm.Motion, loads: mm.Wrenches) -> StaticLoads:
    """Find the forces that statics allow, motion and loads at 6 Hz."""
    moving = mm.differentiate(motion, CUTOFF)
    return static_joint_loads(
        model, moving, mm.resample_wrenches(loads, moving.time, cutoff=CUTOFF)
    )


def _of_trial(source: Path, trial: knee_trials.KneeTrial) -> Row:
    """Compare one of the second man's trials."""
    model = mm.read_model(knee_trials.made_model(source))
    with tempfile.TemporaryDirectory() as work:
        motion = mm.read_motion(knee_trials.write_motion(source, trial, Path(work)), model)
        loads = read_external_loads(knee_trials.write_loads(source, trial, Path(work)))
    inside = (motion.time >= trial.start) & (motion.time <= trial.stop)
    clock, truth = knee_trials.measured(source, trial)
    known = (clock > trial.start + knee_trials.MARGIN) & (clock < trial.stop - knee_trials.MARGIN)
    found = statics(model, motion.frames(inside), loads)
    return _compared(trial.name, found, knee_trials.KNEE, clock[known], truth[known, 0])


def _compared(name: str, found: StaticLoads, joint: str, clock: Array, measured: Array) -> Row:
    """Compare a knee's range with the measured force.

    Parameters
    ----------
    clock, measured : (samples,) instants [s] and force [N]
    """
    place = found.joints.index(joint)
    low = np.interp(clock, found.time, found.static_load_low[:, place]) / found.weight
    high = np.interp(clock, found.time, found.static_load_high[:, place]) / found.weight
    truth = measured / found.weight
    return {
        "recording": name,
        "peak of the minimum force [BW]": float(low.max()),
        "peak of the maximum force [BW]": float(high.max()),
        "measured peak [BW]": float(truth.max()),
        "measured below [%]": 100.0 * float(np.mean(truth < low)),
        "below by, mean [BW]": float(np.maximum(low - truth, 0.0).mean()),
        "measured inside [%]": 100.0 * float(np.mean((truth >= low) & (truth <= high))),
        "measured above [%]": 100.0 * float(np.mean(truth > high)),
    }


def _without_implant(name: str, found: StaticLoads, frames: Array) -> Row:
    """Greatest values of both knees, their mean, in some frames."""
    knees = [place for place, joint in enumerate(found.joints) if "knee" in joint]
    peaks = [
        float((values[frames][:, knees].max(axis=0) / found.weight).mean())
        for values in (found.static_load_low, found.static_load_high)
    ]
    return {
        "recording": name,
        "peak of the minimum force [BW]": peaks[0],
        "peak of the maximum force [BW]": peaks[1],
    }

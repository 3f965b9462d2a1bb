"""Base parameters of 36,000 simulated frames.

Measured are seconds and peak memory of the batch, and frames a second of the recursion. The bodies
are a synthetic tree of the paper's size (53 links, 155 degrees of freedom) and the real one of 80
bodies.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

import myomorph as mm
from benchmarks.speed.timing import clocked, in_own_process
from data_collection import data_folder
from myomorph.body.identify.base import BaseOptions, fit_base
from myomorph.body.identify.base_parameters import base_parameters
from myomorph.body.identify.least_squares import Recording
from myomorph.core.model.functions import linear
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Axis, Coordinate
from myomorph.core.rigid.coordinates import couple_rates_frames
from myomorph.core.rigid.regressor import regressor_blocks
from myomorph.core.rigid.tree import compile_tree
from myomorph.live.sequential import SequentialFit
from trees import floating_tree

FRAMES = 36_000
RATE = 200.0
NOISE = 0.5
SEQUENTIAL = 4_000
EXACT_MOTION = BaseOptions(motion_sd=0.0)


def run() -> list[dict[str, object]]:
    """Return a row for each model, measured in a process of its own so that memory is its alone."""
    names = ("53 links, 155 DOF (synthetic tree)", "80 links, 171 coordinates (real model)")
    return [in_own_process(measure, name) for name in names]


def measure(name: str, frames: int = FRAMES) -> dict[str, object]:
    """Batch and recursion on one model."""
    model = of_the_papers_size() if name.startswith("53") else real_model()
    # Kernels compile first, on a few frames.
    fit_base(model, [simulated(model, 40)], options=EXACT_MOTION)
    given = simulated(model, frames)
    structure = clocked(lambda: base_parameters(model))
    base = structure.result
    batch = clocked(lambda: fit_base(model, [given], base, EXACT_MOTION))
    fit = batch.result
    truth = base.of(other_masses(model))
    fold, cpu_fold = recursion(model, base, given, min(SEQUENTIAL, frames))
    return {
        "model": name,
        "frames": frames,
        "base parameters": len(base),
        "structure [s]": structure.seconds,
        "batch [s]": batch.seconds,
        "batch CPU [s]": batch.cpu,
        "peak [MB]": batch.before + batch.peak,
        "of it the recording and Python before [MB]": batch.before,
        "recursion [frames/s]": fold,
        "recursion [frames/s of CPU]": cpu_fold,
        "within 3 SD": float(np.mean(np.abs(fit.estimate - truth) < 3.0 * fit.sd)),
    }


def recursion(model: mm.Model, base, given: Recording, frames: int) -> tuple[float, float]:
    """Return frames processed in a second, by the clock and by the processor.

    The regressor's rows are there already.
    """
    fit = SequentialFit(model, base, NOISE)
    wrench = np.concatenate([given.wrenches.torques[:, 0], given.wrenches.forces[:, 0]], axis=1)
    seconds = busy = 0.0
    for block in regressor_blocks(model, given.motion, np.zeros(3), 500):
        measured = wrench[block.frames]
        began = time.perf_counter()
        used = time.process_time()
        for rows, one in zip(block.rows, measured, strict=True):
            fit.update(rows, one)
        seconds = seconds + time.perf_counter() - began
        busy = busy + time.process_time() - used
        if fit.frames >= frames:
            break
    return fit.frames / seconds, fit.frames / busy


def of_the_papers_size() -> mm.Model:
    """53 links and 155 degrees of freedom: 6 of the base, 45 joints of three, 7 of two."""
    model = floating_tree(0, 53)
    joints = [model.joints[0]]
    coordinates = list(model.coordinates[:6])
    for i, joint in enumerate(model.joints[1:]):
        names = tuple(f"{joint.name}_{k}" for k in range(3 if i < 45 else 2))
        axes = tuple(
            Axis(kind="rotation", vector=np.eye(3)[k], function=linear(1.0), coordinates=(name,))
            for k, name in enumerate(names)
        )
        joints.append(replace(joint, axes=axes, coordinates=names))
        coordinates += [Coordinate(name) for name in names]
    return replace(model, joints=tuple(joints), coordinates=tuple(coordinates))


def real_model() -> mm.Model:
    """Read the full body of 520 muscles."""
    return mm.read_model(data_folder() / "fullbody-many-muscles" / "cyclistFullBodyMuscle.osim")


def other_masses(model: mm.Model) -> np.ndarray:
    """Return the body that moves: the model's parameters changed by up to a fifth.

    Parameters
    ----------
    model : the generic one

    Returns
    -------
    (bodies, 10) inertial parameters
    """
    return inertial_parameters(model) * np.random.default_rng(1).uniform(
        0.8, 1.2, (len(model.bodies), 10)
    )


def simulated(model: mm.Model, frames: int) -> Recording:
    """Every free coordinate swings by itself; exact derivatives."""
    rng = np.random.default_rng(0)
    tree = compile_tree(model)
    t = np.arange(frames) / RATE
    shape = (frames, len(model.coordinates))
    values = np.tile(tree.defaults, (frames, 1))
    velocities = np.zeros(shape)
    accelerations = np.zeros(shape)
    for j in tree.independent:
        if model.coordinates[j].locked:
            continue
        size = rng.uniform(0.1, 0.4)
        rate = rng.uniform(1.0, 9.0)
        phase = rng.uniform(0.0, 6.0)
        values[:, j] += size * np.sin(rate * t + phase)
        velocities[:, j] = size * rate * np.cos(rate * t + phase)
        accelerations[:, j] = -size * rate**2 * np.sin(rate * t + phase)
    values = tree.coordinates_of(mm.Motion(t, model.coordinate_names, values))
    couple_rates_frames(tree.arrays, values, velocities, accelerations)
    motion = mm.Motion(t, model.coordinate_names, values, velocities, accelerations)
    truth = other_masses(model).ravel()
    wrench = np.empty((frames, 6))
    for block in regressor_blocks(model, motion, np.zeros(3)):
        wrench[block.frames] = block.rows @ truth
    wrench += NOISE * rng.normal(size=wrench.shape)
    zero = np.zeros((frames, 1, 3))
    plate = mm.Wrenches(
        t, ("plate",), (model.body_names[0],), wrench[:, None, 3:], zero, wrench[:, None, :3]
    )
    return Recording(motion, plate)

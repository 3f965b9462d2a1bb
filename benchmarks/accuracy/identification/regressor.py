"""The base-link regressor, base parameters, and the batch and sequential fits.

They are compared with other programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np
import pinocchio as pin
from figaroh_base import figaroh_combination
from test_real_models import middling
from test_regressor import root_forces

import myomorph as mm
from benchmarks.recordings import FORCE_CASES, ForceCase
from benchmarks.speed.identify import RATE, other_masses, simulated
from data_collection import data_folder
from floating import PINOCCHIO_ORDER, mujoco_states, pinocchio_states, root_rates
from mujoco_models import load
from myomorph.body.identify.base import BaseFit, BaseOptions, fit_base
from myomorph.body.identify.base_parameters import base_parameters
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.null_space import (
    held_values,
    numerical_null_space,
    random_states,
    tree_null_space,
)
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import GROUND
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.regressor import (
    base_regressor,
    base_wrench,
    reference_points,
    regressor_blocks,
)
from myomorph.core.rigid.tree import compile_tree
from myomorph.live.sequential import SequentialFit
from opensim_inverse import opensim_torques
from real_models import MODELS
from trees import floating_tree, to_mujoco, to_pinocchio

TREES = 20
NOISE = BaseOptions(moment_noise=2.0, force_noise=5.0, correlated=False, motion_sd=0.0)
"""Noise of the rows that batch and recursion are given alike."""

OPENSIM_MODELS = (
    "c3d-functional-joints/models/wholebody.osim",
    "ceinms-emg-walk/model/gait2392.osim",
    "hamner-run-subject04/unscaled_generic.osim",
)
"""Those without knees that turn about curved axes, whose torques OpenSim gets wrong at speed."""

Row = dict[str, object]
T = TypeVar("T")


def measure_regressor(folder: Path) -> Iterator[Row]:
    """Largest differences of regressor rows, relative to the largest entry of each comparison."""
    floating = [floating_tree(seed) for seed in range(TREES)]
    yield _worst("columns against Pinocchio", floating, _against_pinocchio)
    yield _worst("base wrench against MuJoCo", floating, _against_mujoco)
    models = [_opened(folder, name) for name in MODELS]
    files = {
        folder / name: model
        for name, model in zip(MODELS, models, strict=True)
        if name in OPENSIM_MODELS and model
    }
    yield _worst(
        "forces on the pelvis against OpenSim",
        list(files),
        lambda path: _against_opensim(path, files[path]),
    )
    yield _worst(
        "base wrench against inverse dynamics",
        [one for one in models if one is not None],
        _against_dynamics,
    )


def _worst(what: str, models: list[T], compare: Callable[[T], tuple[float, float]]) -> Row:
    found = [compare(model) for model in models]
    return {
        "comparison": what,
        "models": len(found),
        "largest number": max(largest for _, largest in found),
        "largest difference": max(difference for difference, _ in found),
        "relative": max(difference / largest for difference, largest in found),
    }


def _against_pinocchio(model: mm.Model) -> tuple[float, float]:
    motion = random_states(model, {}, 5)
    theirs, _ = to_pinocchio(model)
    data = theirs.createData()
    rotations = root_rates(model, motion)[0]
    order = np.concatenate([10 * b + PINOCCHIO_ORDER for b in range(len(model.bodies))])
    ours = base_regressor(model, motion)[:, :, order]
    rows = np.empty_like(ours)
    for f, (q, v, a) in enumerate(pinocchio_states(model, motion)):
        base = pin.computeJointTorqueRegressor(theirs, data, q, v, a)[:6]
        rows[f] = np.vstack([rotations[f] @ base[3:], rotations[f] @ base[:3]])
    return float(np.abs(ours - rows).max()), float(np.abs(rows).max())


def _against_mujoco(model: mm.Model) -> tuple[float, float]:
    motion = random_states(model, {}, 5)
    theirs = to_mujoco(model)
    state = mujoco.MjData(theirs)
    rotations = root_rates(model, motion)[0]
    root = theirs.joint("free")
    at = [theirs.joint(joint.name).dofadr[0] for joint in model.joints[1:]]
    position = [theirs.joint(joint.name).qposadr[0] for joint in model.joints[1:]]
    wrench = np.empty((5, 6))
    for f, (q, v, a) in enumerate(mujoco_states(model, motion)):
        state.qpos[root.qposadr[0] : root.qposadr[0] + 7] = q
        state.qvel[root.dofadr[0] : root.dofadr[0] + 6] = v
        state.qacc[root.dofadr[0] : root.dofadr[0] + 6] = a
        state.qpos[position] = motion.values[f, 6:]
        state.qvel[at] = motion.velocities[f, 6:]
        state.qacc[at] = motion.accelerations[f, 6:]
        mujoco.mj_inverse(theirs, state)
        force = state.qfrc_inverse[root.dofadr[0] : root.dofadr[0] + 6]
        wrench[f] = np.concatenate([rotations[f] @ force[3:], force[:3]])
    ours = base_regressor(model, motion) @ inertial_parameters(model).ravel()
    return float(np.abs(ours - wrench).max()), float(np.abs(wrench).max())


def _against_opensim(path: Path, model: mm.Model) -> tuple[float, float]:
    motion = middling(model, 5, 0.01, 2)
    expected = opensim_torques(path, model, *motion_arrays(compile_tree(model), motion))
    ours = root_forces(
        model, motion, base_regressor(model, motion) @ inertial_parameters(model).ravel()
    )
    theirs = expected[:, [model.coordinate_names.index(name) for name in ours.names]]
    return float(np.abs(ours.values - theirs).max()), float(np.abs(theirs).max())


def _against_dynamics(model: mm.Model) -> tuple[float, float]:
    """Return what inverse dynamics leaves for the joints to the ground.

    The base has the regressor's wrench then.
    """
    motion = random_states(model, held_values(model, None), 5)
    wrench = base_regressor(model, motion) @ inertial_parameters(model).ravel()
    points = reference_points(model, motion)[:, None]
    given = mm.Wrenches(
        motion.time,
        ("all",),
        (model.body_names[0],),
        wrench[:, None, 3:],
        points,
        wrench[:, None, :3],
    )
    alone = mm.inverse_dynamics(model, motion)
    held = mm.inverse_dynamics(model, motion, given)
    roots = [name for joint in model.joints if joint.parent == GROUND for name in joint.coordinates]
    return max(float(np.abs(held[name]).max()) for name in roots), float(np.abs(alone.values).max())


def _opened(folder: Path, name: str) -> mm.Model | None:
    return mm.read_model(folder / name) if (folder / name).exists() else None


def measure_base_parameters(folder: Path) -> Iterator[Row]:
    """Compare base parameters by the tree with those by random states.

    The rows show how clearly the latter separate.
    """
    for name in (*MODELS, "MyoFullBody"):
        model = load("MyoFullBody", None)[1] if name == "MyoFullBody" else _opened(folder, name)
        if model is None:
            continue
        held = held_values(model, None)
        size = 10 * len(model.bodies)
        tree = tree_null_space(model)
        numerical = numerical_null_space(model)
        rows = base_regressor(model, random_states(model, held, 50, seed=9)).reshape(-1, size)
        left = (
            np.abs(rows @ (tree.vectors / np.abs(tree.vectors).max(axis=0))).max()
            / np.abs(rows).max()
        )
        yield {
            "model": name,
            "bodies": len(model.bodies),
            "moving coordinates": len(model.coordinates) - len(held) - len(model.couplers),
            "by the tree": size - tree.vectors.shape[1],
            "by random states": size - numerical.vectors.shape[1],
            "smallest pivot that counts": numerical.gap[0],
            "largest that does not": numerical.gap[1],
            "Y v of the tree's null vectors, relative": float(left),
        }


def measure_figaroh() -> Iterator[Row]:
    """Compare FIGAROH's base parameters on random trees, free and bolted down, with ours.

    The rows have their number and span.
    """
    for fixed in (False, True):
        counts = []
        apart = []
        for seed in range(5):
            model = floating_tree(seed)
            base = base_parameters(model, fixed=fixed)
            theirs = figaroh_combination(model, random_states(model, base.held, 200, seed=9))
            ours = np.linalg.qr(base.combination.T)[0]
            left = theirs.T - ours @ (ours.T @ theirs.T)
            counts.append((len(base), len(theirs)))
            apart.append(float(np.abs(left).max() / np.abs(theirs).max()))
        yield {
            "base": "fixed" if fixed else "free",
            "trees": len(counts),
            "our numbers": ", ".join(str(ours) for ours, _ in counts),
            "FIGAROH's": ", ".join(str(theirs) for _, theirs in counts),
            "largest part of FIGAROH's Z outside the span of ours": max(apart),
        }


def measure_sequential(folder: Path) -> Iterator[Row]:
    """Compare the recursion with the batch, in units of the larger of estimate and size."""
    for case in FORCE_CASES:
        if not case.loads or not (folder / case.model).exists():
            continue
        model, given = recording(folder, case)
        batch = fit_base(model, [given], options=NOISE)
        state = _folded(model, batch, given).state()
        scale = np.maximum(np.abs(batch.estimate), batch.size)
        yield {
            "case": case.name,
            "frames": batch.frames,
            "base parameters": len(batch.base),
            "rank": batch.rank,
            "condition": batch.condition,
            "largest difference of an estimate": float(
                (np.abs(state.estimate - batch.estimate) / scale).max()
            ),
            "of a standard deviation": float(np.abs(state.sd / batch.sd - 1.0).max()),
            "batch against LAPACK's least squares": float(
                (np.abs(_dense(model, batch, given) - batch.estimate) / scale).max()
            ),
        }


def _dense(model: mm.Model, batch: BaseFit, given: Recording) -> np.ndarray:
    """(n,) the same estimate from all rows and the prior at once, by singular values."""
    rows = base_regressor(model, given.motion)[:, :, batch.base.columns] / batch.sigma[:, None]
    wrench = base_wrench(model, given.motion, given.wrenches) / batch.sigma
    spread = NOISE.prior * batch.size
    mean = batch.base.of(inertial_parameters(model))
    # In units of the parameters' sizes, so that no singular value is taken for zero.
    A = np.vstack([rows.reshape(-1, len(spread)) * batch.size, np.diag(batch.size / spread)])
    solution = np.linalg.lstsq(A, np.concatenate([wrench.ravel(), mean / spread]), rcond=None)[0]
    return solution * batch.size


def _folded(model: mm.Model, batch: BaseFit, given: Recording) -> SequentialFit:
    fit = SequentialFit(model, batch.base, batch.sigma)
    rows = base_regressor(model, given.motion)
    wrench = base_wrench(model, given.motion, given.wrenches)
    for one, measured in zip(rows, wrench, strict=True):
        fit.update(one, measured)
    return fit


def recording(folder: Path, case: ForceCase) -> tuple[mm.Model, Recording]:
    """Return a model and its recording, both through a low-pass of 6 Hz."""
    model = mm.read_model(folder / case.model)
    motion = mm.read_motion(folder / case.motion, model)
    motion = cut(mm.differentiate(motion, 6.0), case.start, case.end)
    wrenches = mm.resample_wrenches(read_external_loads(folder / case.loads), motion.time, 6.0)
    return model, Recording(motion, wrenches)


def measure_deviations(folder: Path, frames: int = 6000, recordings: int = 5) -> Iterator[Row]:
    """Measure errors in standard deviations on a simulated motion of a real model.

    The noise is white, or filtered.
    """
    model = mm.read_model(folder / "opencap-subject4-multitask/models/manually_scaled.osim")
    base = base_parameters(model)
    given = simulated(model, frames)
    zero = np.zeros((frames, 1, 3))
    clean = np.empty((frames, 6))
    for block in regressor_blocks(model, given.motion, np.zeros(3)):
        clean[block.frames] = block.rows @ other_masses(model).ravel()
    for filtered in (False, True):
        for correlated in (True, False):
            scores = []
            samples = []
            for seed in range(recordings):
                noise = 5.0 * np.random.default_rng(seed).normal(size=clean.shape)
                wrench = clean + (lowpass(noise, RATE, 6.0) if filtered else noise)
                forces = wrench[:, None, 3:]
                torques = wrench[:, None, :3]
                plate = mm.Wrenches(
                    given.motion.time, ("plate",), (model.body_names[0],), forces, zero, torques
                )
                fit = fit_base(
                    model,
                    [Recording(given.motion, plate)],
                    base,
                    BaseOptions(correlated=correlated, motion_sd=0.0),
                )
                scores.append((fit.estimate - base.of(other_masses(model))) / fit.sd)
                samples.append(fit.frames / fit.samples.mean())
            yield {
                "noise": "low-pass filtered at 6 Hz" if filtered else "white",
                "frames count": "as the autocorrelation says" if correlated else "each by itself",
                "frames a sample": float(np.mean(samples)),
                "within 2 SD": float(np.mean(np.abs(scores) < 2.0)),
                "within 3 SD": float(np.mean(np.abs(scores) < 3.0)),
            }


if __name__ == "__main__":
    from benchmarks.__main__ import print_rows

    print_rows(list(measure_regressor(data_folder())))
    print_rows(list(measure_base_parameters(data_folder())))
    print_rows(list(measure_figaroh()))
    print_rows(list(measure_sequential(data_folder())))
    print_rows(list(measure_deviations(data_folder())))

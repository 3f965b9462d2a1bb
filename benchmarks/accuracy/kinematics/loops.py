"""Models that close loops: the constraint, closing it, and inverse kinematics, beside OpenSim."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks import opensim_tools
from benchmarks.accuracy.kinematics.kinematics import markers_at, motion_from_opensim
from benchmarks.recordings import read_markers
from looped import looped_tree, mujoco_constraints, pinocchio_rates
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import (
    close_loops,
    closure,
    closure_jacobian,
    free_coordinates,
    project_rates,
)
from myomorph.core.rigid.tree import compile_tree
from truths.opensim_loops import point_constraint

BONE_PINS = "shoulder-bonepin/subject1_abdbonepin.osim"
SHOULDERS = {
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim": "ABD01",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_2kgWeight.osim": "ABD21",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim": "FLX01",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim": "FLX21",
}
"""The models of the thoracoscapular collection, each with one of its motions."""

POSES = 5
NOISE = 0.002
"""Standard deviation of made markers [m]."""

FRAMES = 100

SAME = 1e-5
"""Costs that differ by a smaller share are the same."""

Row = dict[str, object]


def measure_constraints(folder: Path) -> Iterator[Row]:
    """Gaps and derivatives at random open poses, and how each program closes them."""
    for name in (BONE_PINS, *SHOULDERS):
        if not (folder / name).exists():
            continue
        model = mm.read_model(folder / name)
        tree = compile_tree(model)
        free = free_coordinates(tree)
        c = np.tile(tree.defaults, (POSES, 1))
        c[:, free] += np.random.default_rng(0).normal(scale=0.05, size=(POSES, len(free)))
        gaps, derivatives, assembled = point_constraint(folder / name, model, c)
        ours = closure_jacobian(tree, c)
        found = close_loops(tree, c)
        product = np.einsum("fri,frj->fij", ours, ours) - np.einsum(
            "fri,frj->fij", derivatives, derivatives
        )
        nearer = ((found - c) ** 2).sum(axis=1) / ((assembled - c) ** 2).sum(axis=1)
        lengths = np.linalg.norm(closure(tree, c), axis=1), np.linalg.norm(gaps, axis=1)
        yield {
            "model": name.partition("/")[2],
            "open by [mm]": 1e3 * float(lengths[0].mean()),
            "gap differs by [m]": float(np.abs(lengths[0] - lengths[1]).max()),
            "G^T G differs by": float(np.abs(product).max()),
            "closed to, ours [m]": float(np.abs(closure(tree, found)).max()),
            "closed to, OpenSim [m]": float(np.abs(closure(tree, assembled)).max()),
            "squared distance, ours / OpenSim": float(nearer.mean()),
        }


def measure_trees() -> Iterator[Row]:
    """Compare random trees that a point and a weld close.

    Derivatives are compared with MuJoCo's, projected rates with Pinocchio's.
    """
    for seed in range(3):
        model, closed = looped_tree(seed, kinds=("connect", "weld"))
        ours = np.linalg.svd(
            closure_jacobian(compile_tree(model), closed[None])[0], full_matrices=False
        )[2]
        theirs = np.linalg.svd(mujoco_constraints(model, closed)[1], full_matrices=False)[2]
        outside = np.linalg.norm(theirs - theirs @ ours.T @ ours, 2)
        twin, _ = looped_tree(seed)
        v, a = project_rates(
            compile_tree(twin),
            closed[None],
            *np.random.default_rng(0).normal(size=(2, 1, len(closed))),
        )
        apart = [
            float(np.abs(one - two).max()) for one, two in pinocchio_rates(twin, closed, v[0], a[0])
        ]
        yield {
            "tree": f"random, seed {seed}",
            "coordinates": len(closed),
            "rows": len(ours),
            "sine of the angle between the spaces of G, MuJoCo": float(outside),
            "velocities of tied frames differ by, Pinocchio [m/s or rad/s]": max(apart[:2]),
            "accelerations differ by, Pinocchio": max(apart[2:]),
        }


def measure_inverse_kinematics(folder: Path) -> Iterator[Row]:
    """Measure marker errors, gaps and times of both programs.

    The markers are measured bone pins, and simulated ones of the other models.
    """
    if (folder / BONE_PINS).exists():
        yield _stored(folder)
        for accuracy, end in ((1e-6, 2.0), (1e-9, 1.0)):
            markers, weights = _bone_pins(folder, end)
            path = folder / "shoulder-bonepin/abdbonepin.trc"
            yield _beside(
                f"bone pins, {end:g} s", folder / BONE_PINS, path, markers, weights, accuracy
            )
    for name, trial in SHOULDERS.items():
        if (folder / name).exists():
            with tempfile.TemporaryDirectory() as work:
                markers, weights = _made(folder, name, trial)
                path = Path(work) / "made.trc"
                mm.write_trc(markers, path)
                label = (
                    f"{name.rpartition('/')[2].removesuffix('.osim')}, {trial} (simulated markers)"
                )
                yield _beside(label, folder / name, path, markers, weights, 1e-5)


def _bone_pins(folder: Path, end: float) -> tuple[mm.Markers, dict[str, float]]:
    markers = read_markers(folder / "shoulder-bonepin/abdbonepin.trc")
    return cut(markers, 0.0, end), dict(
        read_ik_tasks(folder / "shoulder-bonepin/setup_ik_abdbonepin.xml").marker_weights
    )


def _made(folder: Path, name: str, trial: str) -> tuple[mm.Markers, dict[str, float]]:
    """Markers of a model in one of its motions, loops closed, with noise."""
    model = mm.read_model(folder / name)
    tree = compile_tree(model)
    motion = mm.read_motion(folder / f"shoulder-thoracoscapular/ik/{trial}.mot", model)
    some = np.linspace(0, len(motion) - 1, 3 * FRAMES).astype(int)[:FRAMES]
    values = close_loops(tree, tree.coordinates_of(motion)[some])
    places = _places(model, model.marker_names, values)
    places += np.random.default_rng(3).normal(scale=NOISE, size=places.shape)
    tasks = read_ik_tasks(folder / "shoulder-thoracoscapular/ik/IK_setup.xml").marker_weights
    weights = {marker: weight for marker, weight in tasks.items() if marker in model.marker_names}
    return mm.Markers(0.01 * np.arange(FRAMES), model.marker_names, places), weights


def _places(model: mm.Model, names: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    tree = compile_tree(model)
    bodies = np.array([tree.body_index[model.marker(name).body] for name in names])
    return forward_kinematics(tree, values).points(
        bodies, np.array([model.marker(name).location for name in names])
    )


def _ours(
    model: mm.Model, markers: mm.Markers, weights: dict[str, float]
) -> tuple[KinematicsFit, float]:
    """Return the fit, and its seconds after a first run that compiles."""
    options = mm.InverseKinematicsOptions(marker_weights=weights, only_weighted=True)
    mm.inverse_kinematics(model, markers, options)
    began = time.perf_counter()
    fit = mm.inverse_kinematics(model, markers, options)
    return fit, time.perf_counter() - began


def _stored(folder: Path) -> Row:
    model = mm.read_model(folder / BONE_PINS)
    markers, weights = _bone_pins(folder, 19.0)
    fit, seconds = _ours(model, markers, weights)
    stored = mm.read_motion(folder / "shoulder-bonepin/std_subject1_abdbonepin_IK.mot", model)
    return _row(
        "bone pins, 19 s, OpenSim's stored result",
        model,
        markers,
        fit,
        stored,
        seconds,
        float("nan"),
    )


def _beside(
    label: str,
    model_path: Path,
    markers_path: Path,
    markers: mm.Markers,
    weights: dict[str, float],
    accuracy: float,
) -> Row:
    model = mm.read_model(model_path)
    fit, seconds = _ours(model, markers, weights)
    span = (float(markers.time[0]), float(markers.time[-1]))
    result = opensim_tools.inverse_kinematics(model_path, markers_path, weights, span, accuracy)
    theirs = motion_from_opensim(model, result)
    return _row(
        f"{label}, OpenSim to {accuracy:g}", model, markers, fit, theirs, seconds, result.seconds
    )


def _row(
    label: str,
    model: mm.Model,
    markers: mm.Markers,
    fit: KinematicsFit,
    theirs: mm.Motion,
    seconds: float,
    opensim_s: float,
) -> Row:
    """Both results on the frames they share, by the same forward kinematics."""
    tree = compile_tree(model)
    rows = np.abs(markers.time[:, None] - theirs.time[None]).argmin(axis=0)
    seen = markers_at(markers, theirs.time).values[
        :, [markers.names.index(name) for name in fit.marker_names]
    ]
    share = fit.marker_weight / fit.marker_weight.sum()
    values = fit.motion.values[rows], tree.coordinates_of(theirs)
    squares = [
        ((_places(model, fit.marker_names, one) - seen) ** 2).sum(axis=2) @ share for one in values
    ]
    turning = [j for j in free_coordinates(tree) if model.coordinates[j].motion == "rotational"]
    apart = np.degrees(np.abs((values[0] - values[1] + np.pi) % (2 * np.pi) - np.pi))[:, turning]
    worst = int(np.argmax(apart.max(axis=0)))
    assert fit.loop_closure_error is not None
    return {
        "case": label,
        "frames": len(theirs),
        "RMSE ours [mm]": 1e3 * float(np.sqrt(squares[0].mean())),
        "RMSE OpenSim [mm]": 1e3 * float(np.sqrt(squares[1].mean())),
        "ours costs no more in frames [%]": 100.0
        * float((squares[0] <= squares[1] * (1.0 + SAME)).mean()),
        "median angle difference [deg]": float(np.median(apart)),
        "largest [deg]": float(apart.max()),
        "of": model.coordinate_names[turning[worst]],
        "converged": float(fit.converged.mean()),
        "open, ours [m]": float(np.abs(closure(tree, values[0])).max()),
        "open, OpenSim [m]": float(np.abs(closure(tree, values[1])).max()),
        "ours [ms/frame]": 1e3 * seconds / len(markers),
        "OpenSim [ms/frame]": 1e3 * opensim_s / len(theirs),
    }


def measure(folder: Path) -> Iterator[Row]:
    """Rows of all tables."""
    yield from measure_constraints(folder)
    yield from measure_trees()
    yield from measure_inverse_kinematics(folder)

"""Interval bounds while frames arrive.

Their parts by themselves, and against the same draws on the whole recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_walk import WALK, Kept, recorded_walk

from myomorph.core.io.sto import read_sto
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.motion.causal import CausalFilter, CausalStream
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics, tracked_markers
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.study.trial.load import load
from myomorph.lab.uncertainty.bodies import Draw, drawn_model
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import GROUPS, Sources
from myomorph.live.chain import LiveChain
from myomorph.live.limits import LimitOptions
from myomorph.live.loop import follow
from myomorph.live.online_errors import SlopeFinder, SlowNoise
from myomorph.live.sources import Replay

NONE = replace(
    Sources(), **{name: 0.0 for names in GROUPS.values() for name in names if name != "skin_time"}
)
DRAWS = 12


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, Markers, Wrenches]:
    model, markers, wrenches = recorded_walk(data)
    return model, cut(markers, 0.5, 1.0), wrenches


def limited(walk: tuple[Model, Markers, Wrenches], sources: Sources) -> Kept:
    model, markers, wrenches = walk
    kept = Kept()
    source = Replay(markers, wrenches, 0.0)
    options = LimitOptions(DRAWS, widened=False)
    follow(LiveChain(model, source, limits=options, sources=sources), source, [kept])
    kept.frames = [one for one in kept.frames if one.limits is not None]
    assert len(kept.frames) > 20
    return kept


def test_derivatives_are_those_of_the_filtered_value() -> None:
    """Of a sine that is long settled."""
    stream = CausalStream(CausalFilter(6.0), 1)
    turn = 2.0 * np.pi * 1.5
    clock = np.arange(0.0, 2.0, 0.001)
    found = []
    for time in clock:
        stream.push(np.array([time]), np.array([[np.sin(turn * time)]]))
        found.append(stream.derivatives(float(time))[:, 0])
    late = np.array(found)[1000:]
    for k in range(3):
        slope = np.gradient(late[:, k], clock[1000:])[5:-5]
        np.testing.assert_allclose(late[5:-5, k + 1], slope, atol=1e-4 * turn ** (k + 1))


def test_slow_noise_has_variance_one_and_the_correlation_of_a_gaussian() -> None:
    noise = SlowNoise(width=0.15, count=4000, seed=3, rate=50.0)
    first = noise.at(5.0)
    then = noise.at(5.2)
    later = noise.at(5.5)
    assert first.std() == pytest.approx(1.0, abs=0.05)
    for other, apart in ((then, 0.2), (later, 0.5)):
        expected = np.exp(-(apart**2) / (4.0 * 0.15**2))
        assert np.mean(first * other) == pytest.approx(expected, abs=0.09)


def test_without_errors_limits_are_the_result(walk: tuple[Model, Markers, Wrenches]) -> None:
    kept = limited(walk, NONE)
    for one in kept.frames:
        assert one.limits is not None
        np.testing.assert_allclose(one.limits.torques[:2], np.stack([one.torques] * 2), atol=1e-6)
        np.testing.assert_allclose(
            one.limits.forces[:2], np.stack([one.tension.forces] * 2), atol=1.0
        )


def _marker_places(model: Model, names: tuple[str, ...], motion: Motion) -> np.ndarray:
    """(frames, markers, 3) of a model's markers in a motion [m]."""
    tree = compile_tree(model)
    marked = [model.marker(name) for name in names]
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_number(marker.body) for marker in marked], np.int64)
    return poses.points(bodies, np.array([marker.location for marker in marked]))


def _drawn_errors(model: Model, markers: Markers, sources: Sources) -> list[np.ndarray]:
    """Return filtered errors (frames, coordinates) of all draws, on the whole recording."""
    motion = inverse_kinematics(model, markers).motion
    names, weights = tracked_markers(model, markers, InverseKinematicsOptions())
    seen = np.isfinite(markers.values[:, [markers.names.index(name) for name in names]]).all(axis=2)
    slopes = SlopeFinder(
        model=model, names=names, weights=weights, options=InverseKinematicsOptions()
    ).at(motion.values, seen)
    filter = CausalFilter(6.0)
    normals = Normals(DRAWS)
    each = []
    for number in range(DRAWS):
        drawn = drawn_model(model, Draw(number, sources, normals))
        shifts = _marker_places(model, names, motion) - _marker_places(drawn, names, motion)
        errors = np.einsum("fcm,fm->fc", slopes, shifts.reshape(len(shifts), -1))
        each.append(filter.motion(Motion(markers.time, motion.names, errors)).values)
    return each


def test_misplaced_markers_and_joints_move_angles_as_on_the_whole_recording(
    walk: tuple[Model, Markers, Wrenches],
) -> None:
    """The same draws by the derivatives of all frames at once, through the same filter."""
    model, markers, _ = walk
    sources = replace(NONE, placement=0.005, joint_center=0.006, joint_axis=0.035)
    kept = limited(walk, sources)
    each = _drawn_errors(model, markers, sources)
    at = np.searchsorted(markers.time, kept.all("time") - 1e-6)
    expected = np.std(each, axis=0, ddof=1)[at]
    found = np.array([one.limits.coordinates[2] for one in kept.frames])  # type: ignore[union-attr]
    moved = expected.mean(axis=0) > 1e-3
    assert moved.sum() > 20
    # Limits are up to 50 ms old.
    np.testing.assert_allclose(found.mean(axis=0)[moved], expected.mean(axis=0)[moved], rtol=0.08)


def test_an_error_of_the_forces_comes_out_as_its_moment(
    walk: tuple[Model, Markers, Wrenches],
) -> None:
    """Torques are linear in the forces: their deviation is the gain's share of what these do."""
    kept = limited(walk, replace(NONE, plate_gain=0.02))
    model = walk[0]
    j = model.coordinate_names.index("pelvis_ty")
    carried = np.array([one.wrenches[:, 4].sum() for one in kept.frames])
    found = np.array([one.limits.torques[2, j] for one in kept.frames])  # type: ignore[union-attr]
    # Each foot has a gain of its own; limits are up to a few frames old.
    assert found.mean() == pytest.approx(0.02 * np.abs(carried).mean(), rel=0.35)
    angles = np.array([one.limits.coordinates[2] for one in kept.frames])  # type: ignore[union-attr]
    assert np.abs(angles).max() == 0.0


def test_the_command_writes_limits_beside_its_tables(
    walk: tuple[Model, Markers, Wrenches], data: Callable[[str], Path], tmp_path: Path, command
) -> None:
    words = [
        "--model",
        data(f"{WALK}/subject_walk_scaled.osim"),
        "--markers",
        data(f"{WALK}/markers_walk.trc"),
    ]
    words += ["--loads", data(f"{WALK}/grf_walk.xml"), "--speed", 0]
    sizes = tmp_path / "sizes.toml"
    sizes.write_text("placement = 0.002\n")
    refused = command("live", *words, "--uncertainty", sizes)
    assert refused.status == 2
    assert "without --draws" in refused.err
    done = command("live", *words, "--uncertainty", sizes, "--draws", 6, "--out", tmp_path / "out")
    assert done.status == 0, done.err
    low = read_sto(tmp_path / "out" / "forces_low.sto")
    values = read_sto(tmp_path / "out" / "forces.sto")
    high = read_sto(tmp_path / "out" / "forces_high.sto")
    known = np.isfinite(low.values).all(axis=1)
    assert known.sum() > 150
    assert low.names == values.names
    assert (low.values[known] <= high.values[known] + 1e-9).all()
    assert (low.values[known] > -1e-6).all()
    spread = load(tmp_path / "out")["live"].uncertainty.spreads["muscle_force"]
    np.testing.assert_allclose(spread.high[known], high.values[known], rtol=1e-4, atol=1e-3)

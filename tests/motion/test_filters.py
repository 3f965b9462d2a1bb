"""Filter and derivatives against OpenSim, and their laws."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import _lowpass_padded, differentiate, lowpass
from myomorph.core.motion.splines import natural_spline
from myomorph.core.motion.sync import cut, resample_wrenches


def test_lowpass_equals_opensim():
    opensim = pytest.importorskip("opensim")
    rng = np.random.default_rng(0)
    frames = 101
    rate = 128.0
    # A step that is a power of two, so that OpenSim takes the samples as they are.
    signal = np.cumsum(rng.normal(size=frames))
    storage = opensim.Storage()
    labels = opensim.ArrayStr()
    labels.append("time")
    labels.append("x")
    storage.setColumnLabels(labels)
    for i, value in enumerate(signal):
        row = opensim.StateVector()
        row.setStates(i / rate, opensim.Vector(1, float(value)))
        storage.append(row)
    storage.pad(frames // 2)
    storage.lowpassIIR(6.0)
    column = opensim.ArrayDouble()
    # From time 0 on: without the extension before it.
    storage.getDataColumn("x", column)
    theirs = np.array([column.get(i) for i in range(frames)])
    np.testing.assert_allclose(lowpass(signal, rate, 6.0), theirs, atol=1e-9)


# In a process of its own: where ezc3d is loaded too, OpenSim does not know its own vectors.
THEIR_SPLINE = """
import json
import sys

import opensim

given = json.load(sys.stdin)
spline = opensim.GCVSpline()
spline.setDegree(given["degree"])
for x, y in zip(given["time"], given["values"]):
    spline.addPoint(x, y)
first = opensim.StdVectorInt()
first.push_back(0)
points = [opensim.Vector(1, x) for x in given["at"]]
values = [spline.calcValue(point) for point in points]
slopes = [spline.calcDerivative(first, point) for point in points]
print(json.dumps({"values": values, "slopes": slopes}))
"""


@pytest.mark.parametrize("degree", [3, 5])
def test_natural_spline_equals_opensim(degree):
    pytest.importorskip("opensim")
    rng = np.random.default_rng(degree)
    time = np.sort(rng.uniform(0, 2, 40))
    values = rng.normal(size=40)
    ours = natural_spline(time, values, degree)
    at = np.linspace(time[0], time[-1], 101)
    given = {
        "degree": degree,
        "time": time.tolist(),
        "values": values.tolist(),
        "at": at.tolist(),
    }
    told = subprocess.run(
        [sys.executable, "-c", THEIR_SPLINE],
        input=json.dumps(given),
        capture_output=True,
        check=True,
        text=True,
    )
    theirs = json.loads(told.stdout.splitlines()[-1])
    scale = np.abs(ours(at)).max()
    np.testing.assert_allclose(ours(at), theirs["values"], atol=1e-6 * scale)
    slopes = np.array(theirs["slopes"])
    np.testing.assert_allclose(ours.derivative()(at), slopes, atol=1e-5 * np.abs(slopes).max())


def test_lowpass_keeps_slow_motion_and_halves_the_cutoff():
    t = np.arange(2000) / 1000.0
    slow = np.sin(2 * np.pi * 0.5 * t)
    at_cutoff = np.sin(2 * np.pi * 20.0 * t)
    np.testing.assert_allclose(lowpass(slow, 1000.0, 20.0), slow, atol=2e-3)
    assert np.abs(lowpass(at_cutoff, 1000.0, 20.0)[500:1500]).max() == pytest.approx(0.5, abs=0.01)


def test_derivatives_of_a_known_motion_and_over_a_gap():
    t = np.arange(200) / 100.0
    values = np.column_stack([np.sin(3 * t), np.cos(2 * t)])
    values[80:90, 1] = np.nan
    motion = differentiate(Motion(t, ("a", "b"), values))
    seen = np.isfinite(values).all(axis=1)
    assert np.isnan(motion.velocities[80:90]).all()
    inside = seen.copy()
    inside[[0, 1, 2, 77, 78, 79, 90, 91, 92, -3, -2, -1]] = False
    np.testing.assert_allclose(motion.velocities[inside, 0], 3 * np.cos(3 * t[inside]), atol=1e-4)
    np.testing.assert_allclose(
        motion.accelerations[inside, 1], -4 * np.cos(2 * t[inside]), atol=1e-2
    )


def wandering(frames=200):
    return np.cumsum(np.random.default_rng(3).normal(size=(frames, 2)), axis=0)


def test_a_filtered_motion_is_that_of_the_filter_and_its_extensions():
    """Also where the recording does not begin at 0 s."""
    rate = 100.0
    cutoff = 6.0
    values = wandering()
    time = 3.0 + np.arange(len(values)) / rate
    found = differentiate(Motion(time, ("a", "b"), values), cutoff)
    np.testing.assert_allclose(found.values, lowpass(values, rate, cutoff), atol=1e-9)
    padded, pad = _lowpass_padded(values, rate, cutoff)
    spline = natural_spline(3.0 + (np.arange(len(padded)) - pad) / rate, padded)
    np.testing.assert_allclose(found.velocities, spline.derivative(1)(time), atol=1e-6)
    np.testing.assert_allclose(found.accelerations, spline.derivative(2)(time), atol=1e-4)


def test_values_at_uneven_times_are_filtered_at_even_ones():
    values = wandering()
    cutoff = 6.0
    time = 3.0 + np.cumsum(np.where(np.arange(len(values)) % 3, 0.01, 0.012))
    found = differentiate(Motion(time, ("a", "b"), values), cutoff)
    even = np.linspace(time[0], time[-1], int(np.ceil(np.ptp(time) / 0.01)) + 1)
    filtered = lowpass(natural_spline(time, values)(even), (len(even) - 1) / np.ptp(time), cutoff)
    expected = natural_spline(even, filtered)
    inside = slice(30, -30)
    np.testing.assert_allclose(found.values[inside], expected(time)[inside], atol=1e-8)
    np.testing.assert_allclose(
        found.velocities[inside], expected.derivative(1)(time)[inside], atol=1e-6
    )


@pytest.mark.parametrize(("uneven", "taken_as_even"), [(0.99e-3, True), (1.01e-3, False)])
def test_steps_that_differ_by_less_than_a_thousandth_are_even(uneven, taken_as_even):
    values = wandering()
    cutoff = 6.0
    steps = np.full(len(values) - 1, 0.01)
    steps[50:100] += 0.01 * uneven
    time = np.concatenate([[3.0], 3.0 + np.cumsum(steps)])
    rate = (len(time) - 1) / (time[-1] - time[0])
    found = differentiate(Motion(time, ("a", "b"), values), cutoff).values
    assert (np.abs(found - lowpass(values, rate, cutoff)).max() < 1e-9) == taken_as_even


def test_too_few_frames_are_refused():
    with pytest.raises(BadData, match="six frames"):
        differentiate(Motion(np.arange(4.0), ("a",), np.zeros((4, 1))))
    with pytest.raises(BadData, match="at least 4"):
        lowpass(np.zeros(3), 100.0, 6.0)


def wrenches_with_unknown_points(frames=50):
    rng = np.random.default_rng(0)
    time = np.arange(frames) / 500.0
    forces, points, torques = np.cumsum(rng.normal(size=(3, frames, 1, 3)), axis=1)
    return Wrenches(
        time=time, names=("plate",), bodies=("foot",), forces=forces, points=points, torques=torques
    )


def test_unknown_centers_of_pressure_leave_the_wrench_alone():
    known = wrenches_with_unknown_points()
    forces = known.forces.copy()
    forces[:10] = 0.0
    torques = known.torques.copy()
    torques[:10] = 0.0
    points = known.points.copy()
    points[:10] = np.nan
    unloaded = Wrenches(
        time=known.time,
        names=known.names,
        bodies=known.bodies,
        forces=forces,
        points=points,
        torques=torques,
    )
    moved = resample_wrenches(unloaded, known.time)
    about_ground = moved.torques + np.cross(np.nan_to_num(moved.points), moved.forces)
    expected = torques + np.cross(np.nan_to_num(points), forces)
    np.testing.assert_allclose(about_ground, expected, atol=1e-12)


def test_forces_that_end_too_early_are_refused():
    wrenches = wrenches_with_unknown_points()
    with pytest.raises(BadData, match="--time"):
        resample_wrenches(wrenches, np.arange(0.0, 1.0, 0.01))


@pytest.mark.parametrize("share", [1.49, 1.51])
def test_forces_are_extended_by_a_step_and_a_half_at_either_end(share):
    step = 1 / 128
    time = np.arange(33) * step
    ones = np.ones((33, 1, 3))
    given = Wrenches(
        time=time, names=("plate",), bodies=("foot",), forces=ones, points=ones, torques=ones
    )
    for wanted in (time[0] - share * step, time[-1] + share * step):
        if share < 1.5:
            assert resample_wrenches(given, np.sort([wanted, time[16]])).forces == pytest.approx(
                1.0
            )
        else:
            with pytest.raises(BadData, match=r"external forces run from 0 to 0\.25 s"):
                resample_wrenches(given, np.sort([wanted, time[16]]))


def test_cut():
    motion = Motion(np.arange(100) / 100.0, ("a",), np.zeros((100, 1)))
    assert len(cut(motion, 0.1, 0.2)) == 11
    with pytest.raises(BadData, match=r"runs from 0 to 0\.99"):
        cut(motion, 5.0, 6.0)


def test_forces_of_a_long_recording_do_not_depend_on_its_far_ends():
    wrenches = wrenches_with_unknown_points(frames=2000)
    time = np.linspace(2.0, 2.1, 23)
    whole = natural_spline(wrenches.time, wrenches.forces, degree=3)(time)
    np.testing.assert_allclose(resample_wrenches(wrenches, time).forces, whole, atol=1e-12)

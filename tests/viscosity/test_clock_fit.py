"""The plate's clock from a swing.

A spherical pendulum is simulated in MuJoCo, rows are by the regressor of its rigid link.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.motion.clocks import ClockOptions
from myomorph.core.motion.splines import natural_spline
from myomorph.swings.viscosity.swings.plate import WrenchFit, wrench_clock

PENDULUM = """
<mujoco><option timestep="0.0005" integrator="RK4"/><worldbody><body>
<joint type="ball" damping="0.05"/>
<inertial pos="0.01 0.02 -0.4" mass="2.5" diaginertia="0.06 0.065 0.01"/>
</body></worldbody></mujoco>
"""
GRAVITY = np.array([0.0, 0.0, -9.81])


def swing(seconds: float = 31.0):
    """Orientations (steps, 3, 3) of a ball pendulum every half millisecond."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    data.qpos[:] = [np.cos(0.5), np.sin(0.5) * 0.8, np.sin(0.5) * 0.6, 0.0]
    data.qvel[:] = [0.3, -0.6, 0.5]
    rotations = np.empty((round(seconds / 0.0005), 3, 3))
    for rotation in rotations:
        mujoco.mj_step(model, data)
        mujoco.mju_quat2Mat(rotation.reshape(-1), data.qpos)
    return 0.0005 * np.arange(len(rotations)), rotations


def _base_rows(time: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return rows (frames, 6, 10) of moment and force on the base.

    Unit mass, first and second moments of mass cause them.
    """
    spline = natural_spline(time, rotations.reshape(len(time), 9))
    r = rotations
    r2 = spline.derivative(2)(time).reshape(-1, 3, 3)
    rows = np.zeros((len(time), 6, 10))
    rows[:, 3:, 0] = GRAVITY
    # Every mass dm at x pulls with g - R'' x; the parameters are the mass and its first and second
    # moments.
    for k in range(3):
        rows[:, 3:, 1 + k] = -r2[:, :, k]
        rows[:, :3, 1 + k] = np.cross(r[:, :, k], GRAVITY)
    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)]
    for column, (i, j) in enumerate(pairs):
        moment = np.cross(r[:, :, i], r2[:, :, j])
        rows[:, :3, 4 + column] = -(
            moment if i == j else moment + np.cross(r[:, :, j], r2[:, :, i])
        )
    return rows


@pytest.fixture(scope="module")
def truth():
    time, rotations = swing()
    rows = _base_rows(time, rotations)
    middle = np.array([0.01, 0.02, -0.4])
    mass = 2.5
    second = np.diag(0.5 * (0.135 - 2 * np.array([0.06, 0.065, 0.01]))) + mass * np.outer(
        middle, middle
    )
    phi = np.concatenate(
        [
            [mass],
            mass * middle,
            [second[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))],
        ]
    )
    return time, rotations, rows @ phi, natural_spline(time, rows @ phi, degree=3)


def _recorded(
    truth,
    offset: float,
    drift: float,
    seed: int,
    force: float = 0.3,
    moment: float = 0.03,
    angle: float = 3e-4,
):
    """Simulate 30 s of frames at 200 Hz with noisy orientations.

    Wrenches are at 2000 Hz on another clock.
    """
    _, rotations, _, spline = truth
    random = np.random.default_rng(seed)
    start = 0.5
    own = np.arange(0, 30, 0.0005)
    there = spline(start + own + offset + drift * own)
    there = there + random.normal(size=there.shape) * np.repeat([moment, force], 3)
    first = round(start / 0.0005)
    frames = rotations[first : first + 60000 : 10]
    turns = angle * random.normal(size=(len(frames), 3))
    cross = np.zeros((len(frames), 3, 3))
    cross[:, 0, 1] = -turns[:, 2]
    cross[:, 0, 2] = turns[:, 1]
    cross[:, 1, 2] = -turns[:, 0]
    noisy = frames + (cross - np.swapaxes(cross, 1, 2)) @ frames
    time = 0.005 * np.arange(len(frames))
    return time, _base_rows(time, noisy), own, there


@pytest.mark.parametrize(("offset", "drift"), [(0.0, 0.0), (0.0123, 40e-6), (-0.2, -120e-6)])
def test_without_noise_the_clock_is_exact(truth, offset, drift):
    clock = wrench_clock(*_recorded(truth, offset, drift, 0, 0.0, 0.0, 0.0))
    assert clock.offset == pytest.approx(offset + drift * clock.epoch, abs=5e-6)
    assert clock.drift == pytest.approx(drift, abs=1e-6)


def test_with_noise_of_a_laboratory_the_clock_is_found_nearly_as_well_as_can_be(truth):
    """0.3 N, 0.03 Nm and 0.3 mrad.

    The root mean square of four runs is compared with the bound from the plate's noise alone.
    """
    time, _, wrench, _ = truth
    slopes = np.gradient(wrench, 0.0005, axis=0)[1000:61000] / np.repeat([0.03, 0.3], 3)
    away = time[1000:61000] - 15.5
    bound = 1.0 / np.sqrt([np.sum(slopes**2), np.sum(slopes**2 * (away**2)[:, None])])
    errors = []
    told = []
    for seed in range(4):
        clock = wrench_clock(*_recorded(truth, 0.0123, 40e-6, seed))
        errors.append((clock.offset - 0.0123 - 40e-6 * clock.epoch, clock.drift - 40e-6))
        told.append((clock.offset_sd, clock.drift_sd))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 1e-4
    assert rms[1] < 5e-6
    assert np.all(rms < 2.5 * bound)
    assert np.all((rms < 2.0 * np.mean(told, axis=0)) & (rms > 0.3 * np.mean(told, axis=0)))


def test_a_plate_tared_with_the_arm_on_it_has_the_same_clock(truth):
    time, rows, own, wrench = _recorded(truth, 0.0123, 40e-6, 3)
    clock = wrench_clock(time, rows, own, wrench)
    tared = wrench_clock(time, rows, own, (wrench - wrench[0]))
    assert tared.offset == pytest.approx(clock.offset, abs=1e-9)
    assert tared.drift == pytest.approx(clock.drift, abs=1e-9)


def test_a_swing_without_motion_is_refused(truth):
    time, rows, own, wrench = _recorded(truth, 0.0, 0.0, 0)
    with pytest.raises(BadData, match="do not explain each other"):
        wrench_clock(
            time,
            np.broadcast_to(rows[:1], rows.shape),
            own,
            wrench,
            WrenchFit(options=ClockOptions(cutoff=3.0)),
        )
    with pytest.raises(BadData, match=r"expected rows \(frames, 6"):
        wrench_clock(time, rows[:, :3], own, wrench)

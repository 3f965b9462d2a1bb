"""Noise of the motion in the regressor.

Its misfit is predicted, and estimates corrected for it are not shrunk by it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.base_parameters import base_parameters, held_in
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.motion_noise import (
    coordinate_noise,
    motion_noise,
    noise_of,
    plus,
    with_noise,
)
from myomorph.body.identify.parts import MAX_NOISE, parts_of, without_noise
from myomorph.core.fit.correlation import correlation_times
from myomorph.core.fit.noise import RecordingNoise
from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.regressor import base_regressor, reference_points

SD = 0.002


def squares_of(table):
    R = np.linalg.qr(table, mode="r")
    return R[:-1, :-1], R[:-1, -1]


def test_noise_in_the_rows_shrinks_least_squares_and_not_the_corrected_ones():
    """Rows whose noise has a third of their own variance.

    Plain estimates shrink to three quarters.
    """
    rng = np.random.default_rng(1)
    n = 4
    count = 40_000
    noise = np.sqrt(1.0 / 3.0)
    x = np.array([3.0, -2.0, 1.0, 0.5])
    true = rng.normal(size=(count, n))
    R, z = squares_of(np.column_stack([true + noise * rng.normal(size=true.shape), true @ x]))
    added = np.zeros((n + 1, n + 1))
    added[:n, :n] = count * noise**2 * np.eye(n)
    np.testing.assert_allclose(np.linalg.solve(R, z), 0.75 * x, atol=0.05)
    for center in (np.zeros(n), np.full(n, 7.0)):
        corrected = np.linalg.lstsq(*without_noise(R, z, added, center))[0]
        np.testing.assert_allclose(corrected, x, atol=0.06)


def test_what_is_noise_alone_leaves_the_data_a_hold_and_the_expected_value():
    """A column of noise alone: its parameter stays near the expected value.

    Its hold is at or above the stored share.
    """
    rng = np.random.default_rng(2)
    count = 4000
    center = np.array([1.0, 5.0])
    true = np.column_stack([rng.normal(size=count), np.zeros(count)])
    R, z = squares_of(
        np.column_stack([true + [0.0, 1.0] * rng.normal(size=true.shape), true @ [2.0, 5.0]])
    )
    added = np.zeros((3, 3))
    added[1, 1] = count
    root, aim = without_noise(R, z, added, center)
    np.testing.assert_allclose(np.linalg.lstsq(root, aim)[0], [2.0, 5.0], atol=0.5)
    least = np.linalg.eigvalsh(root.T @ root) / np.linalg.eigvalsh(R.T @ R)
    assert (least >= 1.0 - MAX_NOISE - 1e-9).all()


@pytest.fixture(scope="module")
def noisy_walk(data):
    """Make a walk whose forces are exactly the model's, measured with noise.

    Returned are model, recording, parts and the effect of noise.
    """
    folder = "opensim-gait-subject01/ref_id"
    model = read_model(data(f"{folder}/subject01.osim"))
    motion = differentiate(
        motion_from_table(read_sto(data(f"{folder}/subject01_walk1_ik.mot")), model), 6.0
    )
    wrench = base_regressor(model, motion) @ inertial_parameters(model).ravel()
    points = reference_points(model, motion)[:, None]
    exact = Wrenches(
        time=motion.time,
        names=("plate",),
        bodies=(model.body_names[0],),
        forces=wrench[:, None, 3:],
        points=points,
        torques=wrench[:, None, :3],
    )
    drawn = noise_of(motion, coordinate_noise(motion, SD, 6.0), np.random.default_rng(5))
    from_noise = plus(motion, drawn)
    recording = with_noise(Recording(from_noise, exact), SD)
    parts = parts_of(model, [recording], base_parameters(model, held=held_in(model, [from_noise])))
    return model, recording, parts, motion_noise(model, [recording], parts)


def test_the_misfit_that_noise_makes_is_foretold(noisy_walk):
    """The true body misfits forces that are exact: by as much as the noise says."""
    model, _, parts, noise = noisy_walk
    truth = inertial_parameters(model)
    np.testing.assert_allclose(noise.misfit(truth), parts.rms(truth), rtol=0.25)


def test_noise_larger_than_the_misfit_is_taken_as_less(noisy_walk):
    model, recording, parts, noise = noisy_walk
    truth = inertial_parameters(model)
    less = noise.at_most(0.5 * noise.misfit(truth), truth)
    assert less.share == pytest.approx(0.5)
    np.testing.assert_allclose(less.misfit(truth), 0.5 * noise.misfit(truth), rtol=1e-9)
    assert noise.at_most(2.0 * noise.misfit(truth), truth) is noise
    # Made anew with half the noise: the same pulls on the mean, draw by draw.
    half = replace(recording, noise=coordinate_noise(recording.motion, 0.5 * SD))
    again = motion_noise(model, [half], parts)
    own = less.scores(parts.rms(truth), truth)
    other = again.scores(parts.rms(truth), truth)
    assert np.linalg.norm(own - other) < 0.2 * np.linalg.norm(other)


def test_drawn_noise_is_as_large_and_as_long_alike_as_stated(noisy_walk):
    """Errors alike over a fifth of a second, and white ones below the filter's cutoff."""
    _, recording, _, _ = noisy_walk
    time = np.arange(0.0, 60.0, 0.01)
    motion = Motion(time, ("hip", "knee", "toes"), np.zeros((len(time), 3)))
    noise = RecordingNoise(
        names=motion.names,
        unit="rad",
        sd=np.array([SD, SD, 0.0]),
        correlation_time=np.array([0.2, 0.1, 0.2]),
        floor=np.array([np.nan, SD, np.nan]),
        gaps=np.zeros(3),
    )
    drawn = noise_of(motion, noise, np.random.default_rng(7), cutoff=6.0)
    np.testing.assert_allclose(drawn.values.std(axis=0), [SD, SD, 0.0], rtol=1e-9)
    times = 0.01 * correlation_times([drawn.values[:, :2]])
    # The filter is no ideal low-pass: white noise through it is alike a fifth longer.
    np.testing.assert_allclose(times, [0.2, 0.12], rtol=0.15)
    power = np.abs(np.fft.rfft(drawn.values[:, 1]))
    fast = np.fft.rfftfreq(len(time), 0.01) > 10.0
    assert power[fast].max() < 0.1 * power.max()
    with pytest.raises(BadData, match="noise of coordinates"):
        noise_of(recording.motion, noise, np.random.default_rng(7))

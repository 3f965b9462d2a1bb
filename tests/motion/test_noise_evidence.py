"""Noise that residuals of markers and measured forces show, on a simulated person."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import scipy

import myomorph as mm
from myomorph.core.fit.spectra import spectra_of
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.model import Marker
from myomorph.core.motion.cutoff_choice import choose_cutoff
from myomorph.core.motion.marker_noise import SHARED, marker_noise
from myomorph.core.motion.noise_evidence import NoiseEvidence
from myomorph.core.motion.plate_noise import plate_noise
from myomorph.core.motion.turns import floating_coordinates
from truths.small_person import person

RATE = 100.0
TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
FREQUENCIES = np.arange(1, 9)  # Of the harmonics of the movement [Hz]


class Recorded(NamedTuple):
    model: mm.Model
    exact: mm.Motion  # With derivatives
    markers: mm.Markers  # Without errors


def waves(model, time, order=0):
    """Coordinates of harmonics that fall off, or a derivative of them."""
    random = np.random.default_rng(7)
    pulses = 2.0 * np.pi * FREQUENCIES
    columns = []
    for coordinate in model.coordinates:
        size = 0.02 if coordinate.motion == "translational" else 0.15
        sizes = size / FREQUENCIES**2.5 * pulses**order
        phases = random.uniform(0.0, 2.0 * np.pi, len(pulses)) + 0.5 * np.pi * order
        columns.append((sizes * np.sin(np.outer(time, pulses) + phases)).sum(axis=1))
    middle = [0.6 if name.endswith("flexion") else 0.0 for name in model.coordinate_names]
    return np.column_stack(columns) + (np.array(middle) if order == 0 else 0.0)


@pytest.fixture(scope="module")
def recorded() -> Recorded:
    model = model_from_mujoco(person(), name="person")
    markers = [
        Marker(f"{body.name}_{number}", body.name, body.mass_center + 0.06 * offset)
        for body in model.bodies
        for number, offset in enumerate(TETRAHEDRON)
    ]
    model = model.with_markers(tuple(markers))
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    exact = mm.Motion(
        time=time,
        names=model.coordinate_names,
        values=waves(model, time),
        velocities=waves(model, time, 1),
        accelerations=waves(model, time, 2),
    )
    return Recorded(model=model, exact=exact, markers=mm.marker_positions(model, exact))


def noisy(markers, noise, seed=0, cutoff=None):
    """Markers with white errors [m], low-passed as a camera's software does."""
    random = np.random.default_rng(seed)
    values = markers.values + noise * random.standard_normal(markers.values.shape)
    if cutoff is not None:
        sections = scipy.signal.butter(2, cutoff / 0.802, fs=RATE, output="sos")
        values = scipy.signal.sosfiltfilt(sections, values, axis=0)
    return replace(markers, values=values)


def forces_of(model, exact):
    """External forces by Newton's law, on the first body."""
    names = [
        name
        for name in floating_coordinates(model)
        if model.coordinate(name).motion == "translational"
    ]
    needed = mm.inverse_dynamics(model, exact)
    forces = np.stack([needed[name] for name in names], axis=1)[:, None]
    nothing = np.zeros_like(forces)
    return mm.Wrenches(exact.time, ("plate",), (model.bodies[0].name,), forces, nothing, nothing)


def torque_error(recorded, motion):
    """Root mean square error of the torques of joints, ends left out [N m]."""
    floating = floating_coordinates(recorded.model)
    turning = [name not in floating for name in recorded.model.coordinate_names]
    truth = mm.inverse_dynamics(recorded.model, recorded.exact).values
    wrong = (mm.inverse_dynamics(recorded.model, motion).values - truth)[20:-20, turning]
    return float(np.sqrt(np.mean(wrong**2)))


def test_motion_without_noise_is_not_filtered(recorded):
    """Up to 8 Hz it looks like noise that was smoothed there; residuals break the tie."""
    motion = mm.inverse_kinematics(recorded.model, recorded.markers).motion
    smoothed = mm.smooth_motion(motion, recorded.model, markers=recorded.markers)
    assert smoothed.cutoff is None
    assert torque_error(recorded, smoothed.motion) < 0.1


def best_error(recorded, motion):
    return min(torque_error(recorded, mm.differentiate(motion, cutoff)) for cutoff in range(2, 20))


def test_noise_that_a_camera_smoothed_shows_in_residuals(recorded):
    markers = noisy(recorded.markers, 0.004, seed=1, cutoff=12.0)
    motion = mm.inverse_kinematics(recorded.model, markers).motion
    smoothed = mm.smooth_motion(motion, recorded.model, markers=markers)
    assert smoothed.cutoff is not None
    # The bound for what all of a segment's skin shares may keep the cutoff below the best.
    assert torque_error(recorded, smoothed.motion) < 1.3 * best_error(recorded, motion)


def test_residuals_show_the_noise_of_coordinates(recorded):
    """Their power, carried to coordinates, is that of the coordinates' own errors."""
    markers = noisy(recorded.markers, 0.003, seed=2)
    motion = mm.inverse_kinematics(recorded.model, markers).motion
    found = marker_noise(recorded.model, motion, markers)
    spectra = spectra_of(motion.values - recorded.exact.values, RATE, found.residuals)
    count = len(motion.names)
    seen = found.power(spectra.columns(slice(count, None)).power) / SHARED
    true = spectra.columns(slice(count)).power
    band = spectra.frequency > 5.0
    ratio = np.median(seen[band].mean(axis=0) / true[band].mean(axis=0))
    assert ratio == pytest.approx(1.0, rel=0.1)


def test_a_marker_that_jumps_is_no_noise(recorded):
    markers = noisy(recorded.markers, 0.003, seed=3)
    motion = mm.inverse_kinematics(recorded.model, markers).motion
    values = markers.values.copy()
    values[100:110, 3] += 0.5
    values[200:205, 8] = np.nan
    jumped = replace(markers, values=values)
    clean = marker_noise(recorded.model, motion, markers).residuals
    found = marker_noise(recorded.model, motion, jumped).residuals
    assert np.abs(found).max() < 2.0 * np.abs(clean).max()


def test_markers_at_other_times_say_nothing(recorded):
    markers = replace(recorded.markers, time=recorded.markers.time + 0.004)
    assert marker_noise(recorded.model, recorded.exact, markers) is None


def test_forces_show_noise_that_looks_like_motion(recorded):
    """Skin that wobbles as one piece at 6 to 9 Hz: no residual shows it, and no plateau does."""
    random = np.random.default_rng(4)
    sections = scipy.signal.butter(2, [6.0, 9.0], "bandpass", fs=RATE, output="sos")
    white = random.standard_normal(recorded.exact.values.shape)
    wobble = scipy.signal.sosfiltfilt(sections, white, axis=0)
    values = recorded.exact.values + 0.006 * wobble / wobble.std(axis=0)
    motion = mm.Motion(recorded.exact.time, recorded.exact.names, values)
    forces = forces_of(recorded.model, recorded.exact)
    alone = mm.smooth_motion(motion, recorded.model)
    measured = mm.smooth_motion(motion, recorded.model, wrenches=forces)
    error = torque_error(recorded, measured.motion)
    assert error < 1.4 * best_error(recorded, motion)
    assert error < torque_error(recorded, alone.motion)
    share = plate_noise(recorded.model, motion, forces)
    wobbles = (share.frequency > 6.5) & (share.frequency < 8.5)
    assert share.share[wobbles].min() > 0.6
    assert share.at(np.array([2.0])) < 0.1


def test_forces_of_an_exact_motion_show_no_noise(recorded):
    forces = forces_of(recorded.model, recorded.exact)
    share = plate_noise(recorded.model, recorded.exact, forces)
    assert share.share[share.frequency < 8.0].max() < 0.05


def test_half_the_weight_says_nothing(recorded):
    forces = forces_of(recorded.model, recorded.exact)
    half = replace(forces, forces=0.5 * forces.forces)
    assert plate_noise(recorded.model, recorded.exact, half) is None


def test_a_choice_names_what_showed_the_noise(recorded):
    markers = noisy(recorded.markers, 0.004, seed=5, cutoff=12.0)
    motion = mm.inverse_kinematics(recorded.model, markers).motion
    choice = choose_cutoff(motion, recorded.model, None, NoiseEvidence(markers=markers))
    assert choice.origin in ("markers", "noise")
    assert choice.sentence.startswith("by the noise")
    assert choose_cutoff(motion, recorded.model, None, NoiseEvidence(markers=markers)) is choice

"""How far all markers lie from their places is seen in the recordings, and intervals take it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.body.calibrate.marker_spread import _Directions
from myomorph.core.model.series import Markers
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure

MARKER_SD = 0.02
NOISE = 1e-3
FRAMES = 40


def test_evidence_of_one_direction_is_the_normal_density_of_its_estimate():
    """Data that show a shift d with the information l: estimates vary by spread^2 + 1 / l."""
    information = np.array([0.3, 5.0])
    shown = np.array([0.7, -1.9])
    # The minimum with the usual prior N(0, 1), and the slope of the data there.
    at = information * shown / (information + 1.0)
    pull = information * (at - shown)
    directions = _Directions(information=information, pull=pull, shift=at)
    spread = np.array([1.0, 0.4, 2.5])
    sd = np.sqrt(spread[:, None] ** 2 + 1.0 / information)
    expected = norm.logpdf(shown, scale=sd).sum(axis=1)
    found = directions.log_evidence(spread)
    np.testing.assert_allclose(np.diff(found), np.diff(expected), atol=1e-12)


def displaced(seed, spread):
    """Make a figure whose markers lie off by `spread` times the usual, and a recording of it."""
    generic = stick_figure()
    free = without_landmarks(generic)
    rng = np.random.default_rng(seed)
    shifts = spread * MARKER_SD * rng.normal(size=(len(free.markers), 3))
    person = free.with_markers(
        tuple(
            replace(marker, location=marker.location + shift)
            for marker, shift in zip(free.markers, shifts, strict=True)
        )
    )
    values = 0.3 * rng.normal(size=(FRAMES, len(person.coordinates)))
    for j, coordinate in enumerate(person.coordinates):
        if coordinate.clamped:
            values[:, j] = -0.8 + np.clip(values[:, j], -0.6, 0.6)
    tree = compile_tree(person)
    bodies = np.array([tree.body_index[marker.body] for marker in person.markers])
    locations = np.array([marker.location for marker in person.markers])
    places = forward_kinematics(tree, values).points(bodies, locations)
    recorded = places + NOISE * rng.normal(size=places.shape)
    return free, person, Markers(np.arange(FRAMES) / 50.0, person.marker_names, recorded)


def without_landmarks(model):
    """Say of no marker that it is on a bony landmark."""
    return model.with_markers(tuple(replace(marker, fixed=False) for marker in model.markers))


@pytest.mark.parametrize("spread", [0.5, 1.5])
def test_intervals_of_markers_follow_how_far_markers_lie_off(spread):
    """Truths by the poses of the figure: the usual distance is another one than theirs."""
    options = CalibrationOptions(
        noise=NOISE,
        marker_sd=MARKER_SD,
        slide_sd=0.0,
        frames=FRAMES,
        independent_frames=FRAMES,
    )
    found_spreads = []
    errors = []
    for seed in range(4):
        generic, person, markers = displaced(seed, spread)
        found = calibrate(generic, [markers], options)
        found_spreads.append(found.marker_spread)
        for marker in found.markers:
            off = marker.location - person.marker(marker.name).location
            errors.append(off / marker.sd)
    # Markers that lie far off are let go one by one, so that the common factor has less to do.
    assert np.sign(np.log(np.mean(found_spreads))) == np.sign(np.log(spread))
    # Lengths, which did not change, have a share in the intervals.
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.3

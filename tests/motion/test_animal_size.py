"""A body and its recording, both made a twentieth as large, move alike.

Nothing assumes the size of a human.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.trc import read_trc
from myomorph.core.model.model import GROUND
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.lengths import coordinate_units, length_unit
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.tree import compile_tree
from stick_figure import person

SMALL = 0.05


def resized(model, factor=SMALL):
    """Return the model so many times as large, with its masses unchanged.

    Its distance to the laboratory's origin is scaled too.
    """
    joints = tuple(
        (
            replace(
                one,
                parent_frame=Transform(
                    one.parent_frame.rotation, factor * one.parent_frame.translation
                ),
            )
            if one.parent == GROUND
            else one
        )
        for one in model.joints
    )
    coordinates = tuple(
        replace(one, default=factor * one.default) if one.motion == "translational" else one
        for one in model.coordinates
    )
    factors = {body: np.full(3, factor) for body in model.body_names}
    return scale(replace(model, joints=joints, coordinates=coordinates), factors)


def seen(markers, factor=SMALL):
    return replace(markers, values=factor * markers.values)


@pytest.fixture(scope="module")
def subject():
    return person()


def test_units_are_metres_for_humans_and_follow_the_size_below(subject):
    tree = compile_tree(subject.generic)
    tiny = compile_tree(resized(subject.generic))
    assert length_unit(tree) == 1.0
    assert set(coordinate_units(tree)) == {1.0}
    unit = length_unit(tiny)
    assert length_unit(compile_tree(resized(tiny.model))) == pytest.approx(SMALL * unit, rel=1e-9)
    slides = np.array([one.motion == "translational" for one in tiny.model.coordinates])
    np.testing.assert_array_equal(coordinate_units(tiny), np.where(slides, unit, 1.0))


def angles(model, markers, posture_weight, *sizes):
    """Angles [rad] and relative marker errors of bodies of several sizes by inverse kinematics."""
    options = InverseKinematicsOptions(posture_weight=posture_weight)
    turning = [k for k, one in enumerate(model.coordinates) if one.motion == "rotational"]
    fits = [
        inverse_kinematics(resized(model, size), seen(markers, size), options) for size in sizes
    ]
    assert all(fit.converged.all() for fit in fits)
    return [
        (fit.motion.values[:, turning], fit.marker_error / size)
        for fit, size in zip(fits, sizes, strict=True)
    ]


def mouse_and_beetle_agree(model, markers):
    for mouse, beetle in zip(*angles(model, markers, 1e-7, SMALL, 0.1 * SMALL), strict=True):
        np.testing.assert_allclose(beetle, mouse, atol=5e-6)


def test_angles_of_a_walk_do_not_depend_on_size(data):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    markers = cut(read_trc(data("rajagopal-walk-emg/markers_walk.trc")).markers, 0.5, 1.0)
    mouse_and_beetle_agree(model, markers)
    # A unit stays one metre for humans of any size: the default pull is not the same share of
    # theirs, but as nothing.
    for human, mouse in zip(*angles(model, markers, 1e-11, 1.0, SMALL), strict=True):
        np.testing.assert_allclose(mouse, human, atol=5e-5)


def test_angles_of_markers_that_come_and_go_do_not_depend_on_size(subject):
    """A pull to the default pose that is nothing for a human must be nothing for a mouse."""
    values = subject.markers.values[:60].copy()
    values[np.random.default_rng(5).uniform(size=values.shape[:2]) < 0.2] = np.nan
    mouse_and_beetle_agree(
        subject.model, Markers(subject.markers.time[:60], subject.markers.names, values)
    )


def test_lengths_and_places_do_not_depend_on_size(subject):
    human = calibrate(resized(subject.generic, 1.0), [seen(subject.markers, 1.0)])
    mouse = calibrate(resized(subject.generic, SMALL), [seen(subject.markers, SMALL)])
    beetle = calibrate(
        resized(subject.generic, (0.1 * SMALL)), [seen(subject.markers, (0.1 * SMALL))]
    )
    assert mouse.converged
    np.testing.assert_array_equal(beetle.frames[0], mouse.frames[0])
    assert beetle.noise == pytest.approx(0.1 * mouse.noise)
    for one, two, three in zip(human.lengths, mouse.lengths, beetle.lengths, strict=True):
        assert three.factor == pytest.approx(two.factor, abs=1e-4), one.length.name
        assert two.factor == pytest.approx(one.factor, abs=max(5e-3, one.sd)), one.length.name
    assert mouse.rms_after == pytest.approx(SMALL * human.rms_after, rel=0.2)
    assert 10.0 * beetle.rms_after == pytest.approx(mouse.rms_after, rel=1e-3)

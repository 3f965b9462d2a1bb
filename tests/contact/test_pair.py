"""Grips are found where two bodies hold together, and momentum tells whether action is reaction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.pair import action_reaction, grip_between
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.inertia import free_object
from myomorph.core.model.join import join_models
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure

HELD = np.array([0.12, -0.03, 0.05])
HOLDS = np.array([-0.02, -0.31, 0.01])


def boxes():
    return join_models(
        {
            "one": free_object("box", 3.0, (0.2, 0.3, 0.4)),
            "two": free_object("box", 5.0, (0.4, 0.3, 0.2)),
        }
    )


def held_boxes(frames=60, noise=0.0):
    """Two boxes that turn about a point of each that stays together."""
    model = boxes()
    random = np.random.default_rng(4)
    time = np.arange(frames) / 50.0
    wave = np.sin(np.outer(time, random.uniform(2, 7, 9)) + random.uniform(0, 6, 9))
    place = 0.3 * wave[:, :3]
    first = 0.6 * wave[:, 3:6]
    second = 0.6 * wave[:, 6:]
    turned = zip(first, second, strict=True)
    other = place + np.array(
        [rotation_from_euler_xyz(a) @ HOLDS - rotation_from_euler_xyz(b) @ HELD for a, b in turned]
    )
    other += noise * random.standard_normal(other.shape)
    return model, Motion(time, model.coordinate_names, np.hstack([place, first, other, second]))


def test_a_grip_is_where_two_bodies_hold_together():
    model, motion = held_boxes()
    grip = grip_between(model, motion, "one_box", "two_box", near=HOLDS + 0.05)
    np.testing.assert_allclose(grip.site.points[0], HOLDS, atol=2e-3)
    np.testing.assert_allclose(grip.place, HELD, atol=2e-3)
    assert grip.apart.max() < 2e-3
    assert (grip.site.body, grip.site.against) == ("one_box", "two_box")


def test_a_grip_does_not_depend_on_where_the_laboratory_is():
    model, motion = held_boxes(noise=0.004)
    moved = motion.values.copy()
    for columns in ((0, 1, 2), (6, 7, 8)):
        moved[:, columns] += np.array([2.0, -1.0, 0.5])
    before = grip_between(model, motion, "one_box", "two_box")
    after = grip_between(model, replace(motion, values=moved), "one_box", "two_box")
    np.testing.assert_allclose(after.site.points, before.site.points, atol=1e-9)
    np.testing.assert_allclose(after.apart, before.apart, atol=1e-9)


def test_bodies_that_move_as_one_hold_where_the_guess_says():
    model, motion = held_boxes()
    still = replace(motion, values=np.repeat(motion.values[:1], len(motion), axis=0))
    guess = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(
        grip_between(model, still, "one_box", "two_box", near=guess).site.points[0],
        guess,
        atol=1e-9,
    )


def test_a_grip_of_what_does_not_exist_is_refused():
    model, motion = held_boxes()
    with pytest.raises(UnknownName, match="unknown body 'one_bix'"):
        grip_between(model, motion, "one_bix", "two_box")
    with pytest.raises(BadData, match="no frame between 7 and 8 s; the motion runs from 0 to"):
        grip_between(model, motion, "one_box", "two_box", span=(7.0, 8.0))


def moving_pair(frames=7):
    figure = stick_figure()
    whole = join_models({"tori": figure, "uke": figure})
    random = np.random.default_rng(2)
    n = len(whole.coordinates)
    time = np.arange(frames) / 100.0
    pace = random.uniform(2, 7, n)
    phase = random.uniform(0, 6, n)
    size = 0.2
    angle = np.outer(time, pace) + phase
    return whole, Motion(
        time,
        whole.coordinate_names,
        size * np.sin(angle),
        velocities=size * pace * np.cos(angle),
        accelerations=-size * pace**2 * np.sin(angle),
    )


def on(bodies, forces, motion, point):
    points = np.broadcast_to(point, forces.shape)
    return Wrenches(
        time=motion.time,
        names=tuple(bodies),
        bodies=tuple(bodies),
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )


def no_wrenches(time):
    """Of no plate."""
    nothing = np.zeros((len(time), 0, 3))
    return Wrenches(time=time, names=(), bodies=(), forces=nothing, points=nothing, torques=nothing)


def test_what_passes_between_two_is_what_their_momentum_tells():
    model, motion = moving_pair()
    pull = np.random.default_rng(5).normal(size=(len(motion), 1, 3)) * 80.0
    place = np.array([0.2, 1.1, 0.3])
    nothing = no_wrenches(motion.time)
    needed = action_reaction(model, motion, ("tori", "uke"), nothing)
    # The floor is made to give what each needs beyond the pull, all of it through one point of one
    # foot.
    floor = needed.passed[:, :, 3:].copy()
    moments = needed.passed[:, :, :3].copy()
    floor[:, 0] -= pull[:, 0]
    floor[:, 1] += pull[:, 0]
    moments[:, 0] -= np.cross(place, pull[:, 0])
    moments[:, 1] += np.cross(place, pull[:, 0])
    plates = Wrenches(
        time=motion.time,
        names=("left", "right"),
        bodies=("tori_foot_r", "uke_foot_l"),
        forces=floor,
        points=np.zeros_like(floor),
        torques=moments,
    )
    found = action_reaction(model, motion, ("tori", "uke"), plates)
    np.testing.assert_allclose(found.passed[:, 0, 3:], pull[:, 0], atol=1e-9)
    np.testing.assert_allclose(found.passed[:, 1, 3:], -pull[:, 0], atol=1e-9)
    assert found.force_error < 1e-9
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-9)


def test_the_residual_of_an_unmeasured_foot_is_the_change_of_momentum():
    model, motion = moving_pair()
    tree = compile_tree(model)
    c = tree.coordinates_of(motion)
    step = 1e-4
    steps = (
        c + k * step * motion.velocities + 0.5 * (k * step) ** 2 * motion.accelerations
        for k in (-1, 0, 1)
    )
    path = [center_of_mass(tree, forward_kinematics(tree, one)) for one in steps]
    acceleration = (path[0] - 2.0 * path[1] + path[2]) / step**2
    nothing = no_wrenches(motion.time)
    found = action_reaction(model, motion, ("tori", "uke"), nothing)
    np.testing.assert_allclose(
        found.residual[:, 3:], model.mass * (acceleration - model.gravity), rtol=1e-4, atol=0.05
    )
    with pytest.raises(UnknownName, match="unknown part 'judge'"):
        action_reaction(model, motion, ("tori", "judge"), nothing)

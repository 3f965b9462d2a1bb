"""What the motion of an object asks of the hands, and when they hold it."""

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.held_objects import FAR, NEAR, find_holds, raised_contacts
from myomorph.core.contact.site_motion import site_motion
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.inertia import free_object
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import floating_tree, swinging
from truths.carried_bodies import needed_wrench

STEP = 0.01


def sliding(name, height, frames=200):
    """Make a free object that only moves up and down, and its motion with exact rates."""
    model = free_object(name, 2.0, (0.2, 0.2, 0.2))
    time = STEP * np.arange(frames)
    values = np.zeros((3, frames, 6))
    values[0, :, 1] = height(time)
    values[1, :, 1] = np.gradient(values[0, :, 1], STEP)
    values[2, :, 1] = np.gradient(values[1, :, 1], STEP)
    return model, Motion(
        time=time,
        names=model.coordinate_names,
        values=values[0],
        velocities=values[1],
        accelerations=values[2],
    )


def test_a_box_that_is_lifted_needs_its_weight_and_its_acceleration():
    model, motion = sliding("box", lambda t: 0.4 * t**2)
    needed = needed_wrench(model, motion, "box")
    assert needed.forces[50, 0] == pytest.approx([0.0, 2.0 * (9.80665 + 0.8), 0.0], abs=1e-6)
    assert needed.points[:, 0, 1] == pytest.approx(motion.values[:, 1])
    assert needed.torques == pytest.approx(0.0, abs=1e-9)


def test_what_is_known_is_taken_off():
    """A floor that carries the weight leaves nothing for the hands.

    One that carries it off the middle leaves a moment.
    """
    model, motion = sliding("box", lambda t: 0.0 * t)
    force = np.zeros((200, 1, 3))
    points = np.zeros((200, 1, 3))
    force[:, 0, 1] = 2.0 * 9.80665
    points[:, 0, 0] = 0.1
    floor = Wrenches(
        time=motion.time,
        names=("floor",),
        bodies=("box",),
        forces=force,
        points=points,
        torques=np.zeros((200, 1, 3)),
    )
    left = needed_wrench(model, motion, "box", floor)
    assert left.forces == pytest.approx(0.0, abs=1e-9)
    assert left.torques[:, 0] == pytest.approx(np.tile([0.0, 0.0, -0.1 * 2.0 * 9.80665], (200, 1)))


@pytest.mark.parametrize("seed", range(3))
def test_the_whole_needs_what_its_momentum_does(seed):
    """The root's wrench is the mass times the center's acceleration less gravity.

    Second differences give the same.
    """
    model = floating_tree(seed)
    motion = swinging(model, 400, 0.001, seed)
    needed = needed_wrench(model, motion, "body0")
    center = center_of_mass(
        compile_tree(model), forward_kinematics(compile_tree(model), motion.values)
    )
    acceleration = (center[2:] - 2.0 * center[1:-1] + center[:-2]) / 0.001**2
    expected = model.mass * (acceleration - model.gravity)
    assert np.abs(needed.forces[1:-1, 0] - expected).max() < 2e-3 * np.abs(expected).max()


def test_its_part_along_a_joint_is_the_joints_torque():
    model = floating_tree(4)
    motion = swinging(model, 30, 0.01, 4)
    torques = inverse_dynamics(model, motion)
    poses = forward_kinematics(compile_tree(model), motion.values)
    for k, body in enumerate(model.body_names[1:], start=6):
        needed = needed_wrench(model, motion, body)
        axis = poses.axis_directions[:, k]
        turning = model.joints[k - 5].axes[0].kind == "rotation"
        along = np.einsum("fi,fi->f", (needed.torques if turning else needed.forces)[:, 0], axis)
        assert along == pytest.approx(torques[f"c{k - 5}"], rel=1e-9, abs=1e-9)


def reaching(arrive=0.5, leave=1.5):
    """Simulate a hand that comes to a box from above, lifts it, and goes away.

    The box is lifted between `arrive` + 0.2 and `leave` - 0.2 s.
    """

    def lifted(t):
        phase = np.clip((t - arrive - 0.2) / (leave - arrive - 0.4), 0.0, 1.0)
        return 0.3 * phase**2 * (3.0 - 2.0 * phase)

    def hand(t):
        return lifted(t) + np.maximum(0.0, arrive - t) + np.maximum(0.0, t - leave) + 0.1

    box, box_motion = sliding("box", lifted)
    palm, palm_motion = sliding("palm", hand)
    parts = {"arm": palm, "thing": box}
    return join_models(parts), join_motions({"arm": palm_motion, "thing": box_motion})


def test_a_hold_lasts_from_arriving_to_leaving():
    model, motion = reaching()
    site = Site("palm", "arm_palm", np.zeros((1, 3)), against="thing_box")
    (touch,) = find_holds(model, motion, (site,)).intervals
    assert touch.surface == "thing_box"
    assert touch.start == pytest.approx(0.5 - NEAR, abs=1.5 * STEP)
    assert touch.stop == pytest.approx(1.5 + FAR, abs=1.5 * STEP)


def test_a_glitch_neither_ends_nor_begins_a_hold(monkeypatch):
    """Two frames of error, in each direction.

    The hand seems away while it holds, and seems there while it does not.
    """
    model, motion = reaching()
    site = Site("palm", "arm_palm", np.zeros((1, 3)), against="thing_box")
    values = np.array(motion.values)
    values[100:102, 0] += 0.3
    values[10:12, 1] = values[11, 7] + 0.1
    seen = replace(motion, values=values)
    assert len(find_holds(model, seen, (site,)).intervals) == 1
    monkeypatch.setattr("myomorph.core.contact.held_objects.SHORTEST", 0.0)
    assert len(find_holds(model, seen, (site,)).intervals) == 3


def test_an_object_that_rests_tells_no_hold(monkeypatch):
    model, motion = reaching(leave=1.5)
    site = Site("palm", "arm_palm", np.zeros((1, 3)), against="thing_box")
    with monkeypatch.context() as changed:
        changed.setattr("myomorph.core.contact.held_objects.MOVING", 9.0)
        with pytest.raises(BadData, match="never faster"):
            find_holds(model, motion, (site,))
    with pytest.raises(BadData, match="against the ground"):
        find_holds(model, motion, (replace(site, against="ground"),))
    with pytest.raises(UnknownName, match="thing_box"):
        needed_wrench(model, motion, "box")


def test_an_object_is_judged_by_its_own_height():
    """A box of 0.2 m next to a tall body has left the floor at a height of one centimeter.

    The threshold is not a tenth of the body.
    """
    box, box_motion = sliding("box", lambda t: 0.1 + np.where(t > 1.0, 0.05 * (t - 1.0), 0.0))
    tall, tall_motion = sliding("body", lambda t: 1.0 + 0.0 * t)
    model = join_models({"tall": tall, "thing": box})
    motion = join_motions({"tall": tall_motion, "thing": box_motion})
    bottom = Site("bottom", "thing_box", np.array([[0.0, -0.1, 0.0]]))
    sole = Site("sole", "tall_body", np.array([[0.0, -1.0, 0.0]]))
    _, ready = raised_contacts(model, motion, bottom, (sole,))
    assert ready[motion.time < 0.99] == pytest.approx(ready[0])
    assert ready[0] > 0.9
    assert np.all(ready[motion.values[:, 7] > 0.11] == 0.0)
    assert site_motion(model, motion, (bottom,)).height == pytest.approx(0.1, abs=0.01)
    assert site_motion(model, motion, (sole, bottom)).height > 0.4

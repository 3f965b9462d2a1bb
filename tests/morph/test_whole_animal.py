"""A skeleton with muscles of one side: the other side, segment masses, protocol markers."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from myomorph.bones.morph.mirror.model import with_other_muscles
from myomorph.bones.morph.species.masses import (
    MarkerTable,
    SegmentShare,
    with_markers_of,
    with_possible_inertias,
    with_segment_shares,
)
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint, PathWrap, WrapObject
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.model.surface import Surface
from myomorph.core.muscles.kinematics import muscle_kinematics

TURNED = axis_rotation(np.array([0.0, 0.6, 0.8]), 0.9)
"""The left thigh's frame lies in another way than the right one's."""


def animal() -> Model:
    """Make a pelvis, x to the right, with two thighs that flex about x."""
    bodies = tuple(
        Body(name=name, mass=mass, mass_center=np.zeros(3), inertia=mass * np.eye(3))
        for name, mass in (("pelvis", 2.0), ("thigh_r", 0.5), ("thigh_l", 0.3))
    )
    still = Transform.identity()
    joints = [
        Joint(
            name="root",
            kind="WeldJoint",
            parent="ground",
            child="pelvis",
            parent_frame=still,
            child_frame=still,
        )
    ]
    for side, x, turn in (("r", 1.0, np.eye(3)), ("l", -1.0, TURNED)):
        seat = Transform(turn, np.array([0.02 * x, 0.0, 0.0]))
        # The child's frame is turned in its joint too, so that both legs flex about the same axis
        # of ground.
        axis = Axis(
            kind="rotation",
            vector=np.array([1.0, 0.0, 0.0]),
            function=linear(1.0),
            coordinates=(f"hip_{side}",),
        )
        flat = Transform(np.eye(3), seat.translation)
        joints.append(
            Joint(
                name=f"hip_{side}",
                kind="CustomJoint",
                parent="pelvis",
                child=f"thigh_{side}",
                parent_frame=flat,
                child_frame=Transform(turn.T, np.zeros(3)),
                axes=(axis,),
                coordinates=(f"hip_{side}",),
            )
        )
    path = Path(
        (
            PathPoint("P1", "pelvis", np.array([0.03, 0.05, 0.02])),
            PathPoint("P2", "thigh_r", np.array([0.01, 0.02, -0.15])),
        ),
        (PathWrap(wrap_object="round_r", method="hybrid", first=-1, last=-1),),
    )
    round_hip = WrapObject(
        name="round_r",
        body="pelvis",
        kind="cylinder",
        pose=Transform(
            axis_rotation(np.array([0.0, 1.0, 0.0]), 0.5 * np.pi), np.array([0.02, 0.03, 0.0])
        ),
        size=(0.012, 0.2),
    )
    return Model(
        name="animal",
        bodies=bodies,
        joints=tuple(joints),
        coordinates=tuple(Coordinate(f"hip_{side}", range=(-1.0, 1.0)) for side in "rl"),
        gravity=np.array([0.0, 0.0, -9.8]),
        muscles=(
            Muscle(
                name="front_r",
                kind="Millard2012EquilibriumMuscle",
                path=path,
                max_isometric_force=9.0,
                optimal_fiber_length=0.02,
                tendon_slack_length=0.1,
            ),
        ),
        wrap_objects=(round_hip,),
    )


def test_the_other_sides_muscle_moves_as_this_one_does():
    """Equal flexion of both legs: equal lengths and moment arms, whatever the body frames."""
    model, notes = with_other_muscles(animal(), "x")
    assert model.muscle_names == ("front_r", "front_l")
    assert model.body_names == animal().body_names
    assert "1 muscles" in notes[0]
    angles = np.linspace(-0.9, 0.9, 7)
    found = muscle_kinematics(
        model,
        Motion(np.arange(7.0), ("hip_r", "hip_l"), np.stack([angles, angles], 1)),
        velocities=False,
    )
    assert found.muscle_length[:, 1] == pytest.approx(found.muscle_length[:, 0], abs=1e-9)
    assert np.ptp(found.muscle_length[:, 0]) > 0.01
    assert found.moment_arm[:, 1, 1] == pytest.approx(found.moment_arm[:, 0, 0], abs=1e-9)
    with pytest.raises(BadModel, match="nothing to mirror"):
        with_other_muscles(model, "x")


def test_a_muscle_whose_name_tells_no_side_is_mirrored_by_its_bodies():
    """The muscle of the right thigh is called without its side, one of the pelvis has none."""
    one = animal()
    (muscle,) = one.muscles
    wrap = replace(one.wrap_objects[0], name="round")
    path = replace(muscle.path, wraps=(replace(muscle.path.wraps[0], wrap_object="round"),))
    middle = replace(
        muscle, name="belly", path=Path((path.points[0], replace(path.points[0], name="P3")))
    )
    nameless = replace(
        one, muscles=(replace(muscle, name="front", path=path), middle), wrap_objects=(wrap,)
    )
    model, _ = with_other_muscles(nameless, "x")
    assert model.muscle_names == ("front", "belly", "front_l")
    assert {name.name for name in model.wrap_objects} == {"round", "round_l"}
    wanted, _ = with_other_muscles(one, "x")
    motion = Motion(np.arange(3.0), ("hip_l",), np.array([[-0.5], [0.0], [0.5]]))
    ours = muscle_kinematics(model, motion, velocities=False).muscle_length[:, -1]
    theirs = muscle_kinematics(wanted, motion, velocities=False).muscle_length[:, -1]
    assert ours == pytest.approx(theirs, abs=1e-12)


def test_inertias_no_bone_can_have_are_replaced():
    """A file's placeholders go; inertias within the bone and unmentioned bodies stay."""
    corners = 0.5 * np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * [0.2, 0.4, 1.0]
    bone = Surface(corners, np.array([[0, 1, 2]]))
    model = animal()
    thigh = model.body("thigh_r")
    unlikely = replace(thigh, inertia=thigh.mass * 2.0**2 * np.eye(3))
    likely = replace(model.body("thigh_l"), inertia=model.body("thigh_l").mass * 0.3**2 * np.eye(3))
    changed = {one.name: one for one in (unlikely, likely)}
    model = replace(model, bodies=tuple(changed.get(one.name, one) for one in model.bodies))
    found, notes = with_possible_inertias(model, {"thigh_r": bone, "thigh_l": bone})
    assert found.body("thigh_r").inertia == pytest.approx(
        thigh.mass / 12.0 * np.diag([1.16, 1.04, 0.2])
    )
    assert found.body("thigh_l").inertia == pytest.approx(likely.inertia)
    assert found.mass == model.mass
    assert "2e+03 mm" in notes[0]
    assert with_possible_inertias(found, {"thigh_r": bone, "thigh_l": bone})[1] == ()


def test_segments_get_their_share_and_the_whole_its_mass():
    share = SegmentShare(
        name="thighs", bodies=("thigh_r", "thigh_l"), share=0.1, interval=(0.05, 0.12)
    )
    found, notes = with_segment_shares(animal(), (share,), 4.0)
    assert found.mass == pytest.approx(4.0)
    assert found.body("thigh_r").mass + found.body("thigh_l").mass == pytest.approx(0.4)
    assert found.body("thigh_r").mass / found.body("thigh_l").mass == pytest.approx(5.0 / 3.0)
    assert found.body("pelvis").inertia == pytest.approx(3.6 * np.eye(3))
    assert "10.0 % of" in notes[0]
    with pytest.raises(BadData, match="nothing is left"):
        with_segment_shares(
            animal(), (share, replace(share, bodies=("pelvis",), share=0.95, interval=(0.9, 0.99)))
        )
    with pytest.raises(UnknownName):
        with_segment_shares(animal(), (replace(share, bodies=("tail",)),))


def test_markers_of_a_protocol_lock_what_they_do_not_show():
    table = MarkerTable(
        name="lab",
        citation="x",
        places={"KNEE": ("thigh_r", (0.0, 0.0, -0.1))},
        moving=("hip_r",),
        start={"hip_r": 0.3},
    )
    model, notes = with_markers_of(animal(), (table,), "lab")
    assert model.marker_names == ("KNEE",)
    assert [one.locked for one in model.coordinates] == [False, True]
    assert model.coordinate("hip_r").default == 0.3
    assert "1 of 2 coordinates" in notes[1]
    with pytest.raises(UnknownName, match="lab"):
        with_markers_of(animal(), (table,), "other")
    with pytest.raises(BadData, match=r"no coordinate fits"):
        with_markers_of(animal(), (replace(table, moving=("knee*",)),), "lab")
    with pytest.raises(UnknownName, match="wing"):
        with_markers_of(
            animal(), (replace(table, places={"TIP": ("wing", (0.0, 0.0, 0.0))}),), "lab"
        )


def test_a_tarsus_is_a_foot_and_a_metatarsus_is_none():
    still = Transform.identity()
    names = ("mouse__RTarsus", "mouse__RTarsus_interim_0", "mouse__RMetatarsus3", "mouse__LTarsus")
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3)) for name in names
    )
    joints = tuple(
        Joint(
            name=name,
            kind="WeldJoint",
            parent="ground",
            child=name,
            parent_frame=still,
            child_frame=still,
        )
        for name in names
    )
    assert feet_of(
        Model(name="mouse", bodies=bodies, joints=joints, coordinates=(), gravity=np.zeros(3))
    ) == ("mouse__RTarsus", "mouse__LTarsus")

"""Muscles of one model on the skeleton of another."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from given_maps import given, poses_of, similar

from myomorph.bones.morph.transfer.model import Graft, graft_muscles, morph_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import UnknownName
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import MovingPathPoint, Muscle, Path, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.muscles.kinematics import muscle_kinematics

GAIT = "ceinms-emg-walk/model/gait2392.osim"
KNEE = "lenhart-knee-contact-walk/lenhart2015.osim"
read = cache(read_osim)


@pytest.mark.parametrize("name", [GAIT, KNEE])
def test_onto_a_morphed_skeleton_is_what_morphing_gives(data, name):
    """Same bones, same coordinates: both ways give one result.

    The ways are muscles on the larger twin's skeleton, and morphing into it.
    """
    model = read(data(name))
    bones = similar(model, 1.2, seed=4)
    whole = morph_model(model, bones)
    graft = graft_muscles(
        model, replace(whole.model, muscles=(), wrap_objects=(), ligaments=(), kept=()), bones
    )
    motion = poses_of(whole.model, 4)
    ours = muscle_kinematics(graft.model, motion, velocities=False).muscle_length
    theirs = muscle_kinematics(whole.model, motion, velocities=False).muscle_length
    np.testing.assert_allclose(ours, theirs, atol=1e-12)
    for one, other in zip(graft.model.muscles, whole.model.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=1e-9)
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=1e-9)
    for one, other in zip(graft.model.ligaments, whole.model.ligaments, strict=True):
        assert one.slack_length == pytest.approx(other.slack_length, rel=1e-9)
    assert not graft.left_out


def test_ligaments_are_written_with_the_forces_that_the_source_keeps(data, tmp_path):
    model = read(data(KNEE))
    bones = similar(model, 1.2, seed=4)
    skeleton = replace(
        morph_model(model, bones).model, muscles=(), wrap_objects=(), ligaments=(), kept=()
    )
    graft = graft_muscles(model, skeleton, bones)
    write_osim(graft.model, tmp_path / "graft.osim")
    again = read_osim(tmp_path / "graft.osim")
    assert len(again.ligaments) == len(model.ligaments)
    for one, other in zip(again.ligaments, graft.model.ligaments, strict=True):
        assert one.slack_length == pytest.approx(other.slack_length)
        for point, same in zip(one.path.points, other.path.points, strict=True):
            np.testing.assert_allclose(point.location, same.location)


def test_muscles_without_a_counterpart_are_left_out_and_named(data):
    model = read(data(GAIT))
    bones = similar(model, 1.0)
    del bones["toes_r"]
    graft = graft_muscles(model, model, bones)
    assert set(graft.left_out) == {"flex_dig_r", "flex_hal_r", "ext_dig_r", "ext_hal_r"}
    assert "'toes_r'" in graft.left_out["flex_dig_r"]
    assert set(graft.model.muscle_names) == set(model.muscle_names) - set(graft.left_out)


def hinge(
    thigh: str, shank: str, coordinate: str, limits: tuple[float, float], sign: float = 1.0
) -> Model:
    axis = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(sign),
        coordinates=(coordinate,),
    )
    knee = Transform(np.eye(3), np.array([0.0, -0.4, 0.0]))
    joints = (
        Joint(
            name="base",
            kind="WeldJoint",
            parent="ground",
            child=thigh,
            parent_frame=Transform.identity(),
            child_frame=Transform.identity(),
        ),
        Joint(
            name="knee",
            kind="PinJoint",
            parent=thigh,
            child=shank,
            parent_frame=knee,
            child_frame=Transform.identity(),
            axes=(axis,),
            coordinates=(coordinate,),
        ),
    )
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=0.01 * np.eye(3))
        for name in (thigh, shank)
    )
    return Model(
        name="leg",
        bodies=bodies,
        joints=joints,
        coordinates=(Coordinate(coordinate, range=limits),),
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def test_the_targets_own_coordinate_moves_points_and_fibers():
    """A knee that bends by 2 rad, with other conventions in each model.

    It goes from -2 to 0 in one, from 0.1 to 2.1 the other way round in the other.
    """
    points = (
        PathPoint("p1", "femur", np.array([0.03, -0.1, 0.0])),
        PathPoint(
            name="p2",
            body="femur",
            location=np.array([0.05, -0.39, 0.0]),
            coordinate="knee_angle",
            range=(-2.0, -0.5),
        ),
        MovingPathPoint(
            name="p3",
            body="tibia",
            functions=(linear(-0.01, 0.04), linear(0.02, -0.05), linear(0.0)),
            coordinates=("knee_angle",) * 3,
        ),
    )
    muscle = Muscle(
        name="vasti",
        kind="Thelen2003Muscle",
        path=Path(points),
        max_isometric_force=1000.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.2,
    )
    source = replace(hinge("femur", "tibia", "knee_angle", (-2.0, 0.0)), muscles=(muscle,))
    target = hinge("thigh", "shank", "flexion", (0.1, 2.1), -1.0)
    # At flexion = 0.1 - knee_angle the shank must lie to the thigh as the tibia to the femur: it is
    # turned by 0.1.
    turn = rotation_from_euler_xyz((0.0, 0.0, 0.1))
    bones = {
        "femur": replace(given("femur", np.eye(3), np.zeros(3)), target_body="thigh"),
        "tibia": replace(given("tibia", turn, np.zeros(3)), target_body="shank"),
    }
    table = {"knee_angle": ("flexion", -1.0, 0.1)}
    graft = graft_muscles(
        source, target, bones, graft=Graft(coordinates=table, postures=({}, {"flexion": 0.1}))
    )
    angles = np.linspace(-1.95, 0.0, 21)
    time = np.arange(21.0)
    ours = muscle_kinematics(
        graft.model, Motion(time, ("flexion",), 0.1 - angles[:, None]), velocities=False
    )
    theirs = muscle_kinematics(
        source, Motion(time, ("knee_angle",), angles[:, None]), velocities=False
    )
    np.testing.assert_allclose(ours.muscle_length, theirs.muscle_length, atol=1e-12)
    np.testing.assert_allclose(ours.moment_arm, -theirs.moment_arm, atol=1e-9)
    change = graft.muscles[0]
    assert (change.fiber, change.tendon) == (pytest.approx(1.0), pytest.approx(1.0))
    np.testing.assert_allclose(change.range_target, change.range_source)


def test_points_of_coordinates_that_the_target_lacks_stand_still():
    source = hinge("femur", "tibia", "knee_angle", (-2.0, 0.0))
    points = (
        PathPoint("p1", "femur", np.array([0.03, -0.1, 0.0])),
        PathPoint(
            name="p2",
            body="femur",
            location=np.array([0.05, -0.39, 0.0]),
            coordinate="knee_angle",
            range=(-2.0, -0.5),
        ),
        MovingPathPoint(
            name="p3",
            body="tibia",
            functions=(linear(-0.01, 0.04), linear(0.02, -0.05), linear(0.0)),
            coordinates=("knee_angle",) * 3,
        ),
    )
    source = replace(
        source,
        muscles=(
            Muscle(
                name="vasti",
                kind="Thelen2003Muscle",
                path=Path(points),
                max_isometric_force=1000.0,
                optimal_fiber_length=0.1,
                tendon_slack_length=0.2,
            ),
        ),
    )
    target = hinge("femur", "tibia", "flexion", (0.0, 2.0), -1.0)
    bones = {body: given(body, np.eye(3), np.zeros(3)) for body in ("femur", "tibia")}
    graft = graft_muscles(
        source,
        target,
        bones,
        graft=Graft(coordinates={}, postures=({"knee_angle": -1.0}, {"flexion": 1.0})),
    )
    assert [one.name for one in graft.model.muscles[0].path.points] == ["p1", "p2", "p3"]
    np.testing.assert_allclose(graft.points[2].target, [0.05, -0.07, 0.0], atol=1e-12)
    assert any("are fixed" in note and "'vasti'" in note for note in graft.notes)
    straight = graft_muscles(source, target, bones, graft=Graft(coordinates={}))
    assert [one.name for one in straight.model.muscles[0].path.points] == ["p1", "p3"]


def test_wrong_names_are_told(data):
    model = read(data(GAIT))
    bone = replace(given("femur_r", np.eye(3), np.zeros(3)), target_body="thigh")
    with pytest.raises(UnknownName, match="thigh"):
        graft_muscles(model, model, {"femur_r": bone})
    with pytest.raises(UnknownName, match="stifle"):
        graft_muscles(
            model,
            model,
            similar(model, 1.0),
            graft=Graft(coordinates={"knee_angle_r": ("stifle", 1.0, 0.0)}),
        )

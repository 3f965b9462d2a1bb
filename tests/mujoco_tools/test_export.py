"""A model in MuJoCo.

Joints, masses, lengths, moment arms and torques are the model's, and the file gives it back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.io.mjcf.write import proper_inertia
from myomorph.core.model.errors import BadFile, BadModel
from myomorph.core.model.functions import linear, simm_spline
from myomorph.core.model.model import Axis, Body, Coordinate, Coupler, Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.hill import hill_forces
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.dynamics import inverse_dynamics, motion_arrays
from myomorph.core.rigid.tree import compile_tree
from myomorph.exchange.mujoco.cams import cams_of
from myomorph.exchange.mujoco.certificate import TOLERANCE
from myomorph.exchange.mujoco.copy import MujocoCopy
from myomorph.exchange.mujoco.export import in_copy, mujoco_model
from myomorph.exchange.mujoco.joints import mujoco_joints, poses_over_ranges
from myomorph.exchange.mujoco.muscle_forces import mujoco_muscles

GAIT = "opensim-gait-subject01/ref_scale/gait2354_simbody.osim"
WALKER = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
POSES = 40
FIBER_AND_TENDON = ("optimal_fiber_length", "tendon_slack_length")


@pytest.fixture(scope="module")
def gait(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("gait") / "gait.xml"
    model = mm.read_model(data(GAIT))
    return model, path, mm.write_mjcf(model, path)


@pytest.mark.parametrize("name", [GAIT, WALKER])
def test_joints_of_mujoco_move_the_paths_as_the_models_do(name, data):
    model = mm.read_model(data(name))
    jointed = mujoco_joints(model)
    coordinates, _ = poses_over_ranges(model, POSES)
    lengths = compile_paths(model).evaluate(coordinates)[0]
    np.testing.assert_allclose(
        compile_paths(jointed).evaluate(in_copy(jointed, model, coordinates))[0],
        lengths,
        atol=1e-12,
    )


def test_each_axis_is_a_coordinates_own(data):
    jointed = mujoco_joints(mm.read_model(data(WALKER)))
    for joint in jointed.joints:
        assert joint.coordinates == tuple(axis.coordinates[0] for axis in joint.axes)
        assert all(np.isclose(np.linalg.norm(axis.vector), 1.0) for axis in joint.axes)


def test_lengths_and_moment_arms_are_certified(gait):
    model, _, certificate = gait
    assert [one.muscle for one in certificate.differences] == list(model.muscle_names)
    beyond = [one for one in certificate.differences if not one.within]
    assert 0 < len(beyond) <= 9
    # Hips that turn by 120 degrees to all sides: the path's point holds on both sides there.
    wide = ("iliacus", "psoas")
    assert all(
        one.length < TOLERANCE for one in certificate.differences if not one.muscle.startswith(wide)
    )
    worst = max(beyond, key=lambda one: max(one.length, one.arm))
    assert (
        f"'{worst.muscle}', length by {1e3 * worst.length:.2f} mm at {worst.length_at[0]}"
        in certificate.lines[0]
    )


def test_masses_and_torques_are_the_models(gait):
    _, _, certificate = gait
    assert abs(certificate.mass) < 1e-7
    assert certificate.torque < 1e-6
    assert certificate.steps


def test_torques_of_the_copy_are_those_of_the_model(gait):
    """The generalized force of a coordinate is that of its axis and its dependent ones.

    They are joined by virtual work.
    """
    model, path, _ = gait
    copied = mujoco_model(model)[0]
    coordinates, _ = poses_over_ranges(model, POSES)
    coordinates = coordinates[-POSES:]
    speeds, accelerations = np.random.default_rng(3).standard_normal((2, *coordinates.shape))
    time = np.arange(POSES, dtype=np.float64)
    motion = Motion(
        time=time,
        names=model.coordinate_names,
        values=coordinates,
        velocities=speeds,
        accelerations=accelerations,
    )
    ours = inverse_dynamics(model, motion).values
    copy = MujocoCopy(path, copied)
    values = motion_arrays(compile_tree(copied), _motion_of_copy(copied, model, motion))
    theirs = dict(zip(copy.simple, copy.generalized_forces(*values).T, strict=True))
    for coupler in reversed(copied.couplers):
        leader = coupler.independents[0]
        slope = coupler.function(values[0][:, copied.coordinate_names.index(leader)], order=1)
        theirs[leader] = theirs[leader] + slope * theirs[coupler.dependent]
    for i, name in enumerate(model.coordinate_names):
        np.testing.assert_allclose(theirs[name], ours[:, i], atol=1e-6)


def _motion_of_copy(copied, model, motion):
    """Return the motion in the copy's coordinates; those that it adds have no rates."""
    there = in_copy(copied, model, motion.values)
    columns = [copied.coordinate_names.index(name) for name in model.coordinate_names]
    velocities = np.zeros(there.shape)
    velocities[:, columns] = motion.velocities
    accelerations = np.zeros(there.shape)
    accelerations[:, columns] = motion.accelerations
    return Motion(
        time=motion.time,
        names=copied.coordinate_names,
        values=there,
        velocities=velocities,
        accelerations=accelerations,
    )


def test_muscles_of_mujoco_pull_as_those_that_were_fitted(gait):
    """MuJoCo puts defaults in the place of parameters that it does not allow, and says nothing."""
    model, path, certificate = gait
    fitted = replace(model, muscles=mujoco_muscles(model))
    random = np.random.default_rng(4)
    shape = 50, len(model.muscles)
    fiber_name, slack_name = FIBER_AND_TENDON
    fiber = np.array([getattr(muscle, fiber_name) for muscle in fitted.muscles])
    slack = np.array([getattr(muscle, slack_name) for muscle in fitted.muscles])
    lengths = slack + fiber * random.uniform(0.4, 1.7, shape)
    speeds = fiber * random.uniform(-8.0, 8.0, shape)
    ours = hill_forces(fitted, lengths, speeds)
    active, passive = MujocoCopy(path, mujoco_joints(model)).muscle_forces(lengths, speeds)
    np.testing.assert_allclose(active, ours.active, atol=1e-6)
    np.testing.assert_allclose(passive, ours.passive, atol=1e-6)
    assert any(
        "differ by up to" in line and "where they move" in line for line in certificate.lines
    )


def test_the_file_gives_the_model_back(gait):
    model, path, _ = gait
    back = mm.read_model(path)
    assert back.source == str(path)
    assert (back.muscle_names, back.coordinate_names, back.marker_names) == (
        model.muscle_names,
        model.coordinate_names,
        model.marker_names,
    )
    assert [muscle.kind for muscle in back.muscles] == [muscle.kind for muscle in model.muscles]
    assert [muscle.parameters for muscle in back.muscles] == [
        muscle.parameters for muscle in model.muscles
    ]
    for ours, theirs in zip(model.bodies, back.bodies, strict=True):
        assert ours.mass == theirs.mass
        np.testing.assert_array_equal(ours.inertia, theirs.inertia)
    coordinates, _ = poses_over_ranges(model, POSES)
    np.testing.assert_array_equal(
        compile_paths(back).evaluate(coordinates)[0], compile_paths(model).evaluate(coordinates)[0]
    )


def test_an_edited_file_is_read_as_mujoco_has_it(gait, tmp_path):
    model, path, certificate = gait
    edited = tmp_path / "edited.xml"
    edited.write_text(path.read_text().replace('timestep="0.001"', 'timestep="0.0005"'))
    back = mm.read_model(edited)
    assert {muscle.kind for muscle in back.muscles} == {"mujoco"}
    assert back.mass == pytest.approx(model.mass, abs=1e-7)
    assert {coupler.independents[0] for coupler in back.couplers} == {
        "knee_angle_r",
        "knee_angle_l",
    }
    coordinates, _ = poses_over_ranges(model, POSES)
    there = np.tile([coordinate.default for coordinate in back.coordinates], (len(coordinates), 1))
    for i, name in enumerate(model.coordinate_names):
        there[:, back.coordinate_names.index(name)] = coordinates[:, i]
    order = [back.muscle_names.index(name) for name in model.muscle_names]
    off = np.abs(
        compile_paths(back).evaluate(there)[0][:, order]
        - compile_paths(model).evaluate(coordinates)[0]
    )
    within = [one.within and one.share == 1.0 for one in certificate.differences]
    assert off[:, within].max() < TOLERANCE


def test_a_damaged_model_in_a_file_is_refused(gait, tmp_path):
    _, path, _ = gait
    text = path.read_text()
    start = text.index(" ", text.index('data="', text.rindex("<custom>"))) + 1
    damaged = tmp_path / "damaged.xml"
    damaged.write_text(text[:start] + "AAAA" + text[start + 4 :])
    with pytest.raises(BadFile, match="damaged"):
        mm.read_model(damaged)


def test_a_spline_is_held_by_a_cam(tmp_path):
    """A slide that follows a hinge by a spline stays on it."""
    x = np.linspace(-2.0, 0.2, 9)
    spline = simm_spline(x, 0.005 * np.random.default_rng(1).standard_normal(9))
    body = Body(
        name="shank",
        mass=3.0,
        mass_center=np.array([0.0, -0.2, 0.0]),
        inertia=np.diag([0.05, 0.01, 0.05]),
    )
    axes = (
        Axis(kind="translation", vector=np.eye(3)[0], function=spline, coordinates=("knee",)),
        Axis(kind="rotation", vector=np.eye(3)[2], function=linear(1.0), coordinates=("knee",)),
    )
    joint = Joint(
        name="joint",
        kind="CustomJoint",
        parent="ground",
        child="shank",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=axes,
        coordinates=("knee",),
    )
    knee = Coordinate("knee", range=(-2.0, 0.2))
    model = Model(
        name="leg",
        bodies=(body,),
        joints=(joint,),
        coordinates=(knee,),
        gravity=np.array([0.0, -9.81, 0.0]),
    )
    path = tmp_path / "leg.xml"
    assert mm.write_mjcf(model, path).torque < 1e-6
    copied, cams, _ = mujoco_model(model)
    assert len(cams) == len(cams_of(mujoco_joints(model))[0]) == 1
    copy = MujocoCopy(path, copied)
    for angle in np.linspace(-1.99, 0.19, 23):
        copy.place(in_copy(copied, model, np.array([[angle]]))[0])
        adr, _ = copy.simple["joint_t0"]
        assert copy.d.qpos[adr] == pytest.approx(float(spline(angle)), abs=5e-5)


def test_an_inertia_that_no_body_has_is_written_as_the_nearest_and_said(arm, tmp_path):
    model = mm.read_model(arm.model)
    bodies = (replace(model.bodies[0], inertia=np.diag([1e-4, 2e-4, 1e-3])), *model.bodies[1:])
    certificate = mm.write_mjcf(replace(model, bodies=bodies), tmp_path / "arm.xml")
    assert any(f"inertia of '{bodies[0].name}'" in line for line in certificate.lines)
    values = np.linalg.eigvalsh(proper_inertia(np.diag([1e-4, 2e-4, 1e-3])))
    assert values[0] + values[1] >= values[2]


def test_an_axis_that_moves_by_two_coordinates_is_refused(data):
    model = mm.read_model(data("shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"))
    with pytest.raises(BadModel, match="moves by two coordinates"):
        mujoco_joints(model)


def test_a_coordinate_that_follows_another_by_a_line_needs_no_cam():
    joints = tuple(
        Joint(
            name=name,
            kind="PinJoint",
            parent="ground",
            child=f"body_{name}",
            parent_frame=Transform.identity(),
            child_frame=Transform.identity(),
            axes=(
                Axis(
                    kind="rotation", vector=np.eye(3)[2], function=linear(1.0), coordinates=(name,)
                ),
            ),
            coordinates=(name,),
        )
        for name in ("a", "b")
    )
    bodies = tuple(
        Body(name=joint.child, mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3))
        for joint in joints
    )
    coupler = Coupler(name="follow", dependent="b", function=linear(2.0, 0.1), independents=("a",))
    model = Model(
        name="two",
        bodies=bodies,
        joints=joints,
        coordinates=(Coordinate("a"), Coordinate("b")),
        gravity=np.zeros(3),
        couplers=(coupler,),
    )
    assert cams_of(mujoco_joints(model)) == ((), ())


def test_the_command_writes_the_model_its_meshes_and_tables(arm, command, tmp_path):
    done = command("export", arm.model, "--mjcf", tmp_path / "arm.xml")
    assert done.status == 0, done.err
    assert "lengths and moment arms" in done.out.splitlines()[0]
    names = {path.name for path in tmp_path.iterdir()}
    assert {"arm.xml", "arm_differences.csv", "arm_curves.csv"} <= names


def test_the_command_refuses_another_ending(arm, command, tmp_path):
    done = command("export", arm.model, "--mjcf", tmp_path / "arm.osim")
    assert done.status == 2
    assert "expected .xml" in done.err


def test_a_segment_that_is_a_thin_rod_is_written_and_named(arm, tmp_path):
    model = mm.read_model(arm.model)
    rod = replace(model.bodies[1], inertia=np.diag([0.013, 0.0, 0.013]))
    thin = replace(model, bodies=(model.bodies[0], rod))
    certificate = mm.write_mjcf(thin, tmp_path / "rod.xml")
    assert certificate.steps
    assert certificate.torque < 1e-6
    (note,) = [note for note in certificate.notes if "thin rod" in note]
    assert f"'{rod.name}'" in note

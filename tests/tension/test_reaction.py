"""Joint reactions: virtual work of all that acts on bodies, frames and points.

Also against OpenSim's reactions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from looped import looped_tree
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import GROUND, Actuator
from myomorph.core.model.paths import Bushing
from myomorph.core.model.segments import joint_labels
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.bushings import bushing_forces
from myomorph.core.rigid.dynamics import inverse_dynamics, joint_wrenches
from myomorph.core.rigid.forward import gathered
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.reaction import (
    joint_reactions,
    of_actuators,
    of_bushings,
    of_muscles,
    of_wrenches,
)
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.terms.actuators import body_directions, compile_body_actuators
from trees import random_rotation, random_tree, swinging

WALK = "rajagopal-walk-emg/"
STUDY = "walk-so-jointload-emg/"


def along_coordinates(tree, c, wrench):
    """Return generalized forces (frames, coordinates) of wrenches on bodies.

    Each coordinate has its own share.
    """
    still = np.zeros_like(c)
    needed = [
        joint_wrenches(tree, c, still, still, one).torques
        for one in (np.zeros_like(wrench), wrench)
    ]
    return needed[0] - needed[1]


@pytest.fixture(scope="module")
def walk(data):
    """Frames of a walk, the plates' forces, and tensions that balance it."""
    model = read_osim(data(WALK + "subject_walk_scaled.osim"))
    whole = differentiate(motion_from_table(read_sto(data(WALK + "coordinates.sto")), model))
    keep = np.linspace(150, 1150, 6).astype(int)
    motion = whole.frames(keep)
    wrenches = resample_wrenches(read_external_loads(data(WALK + "grf_walk.xml")), motion.time)
    return (
        model,
        motion,
        wrenches,
        solve_tension(model, motion, inverse_dynamics(model, motion, wrenches)),
    )


def left_over(model, c, forces):
    """Return the moment (frames,) that OpenSim's paths on several surfaces leave over.

    It is summed over muscles of given tensions. Such a path is pulled along directions that belong
    to points other than where it is pulled; preserved as it is there.
    """
    paths = compile_paths(model)
    pulls, _ = paths.pulls(c)
    net = np.zeros((len(c), len(model.muscles), 6))
    np.add.at(net, (slice(None), paths.pull_muscle), pulls)
    np.testing.assert_allclose(net[..., :3], 0.0, atol=1e-12)
    return (np.linalg.norm(net[..., 3:], axis=2) * np.abs(forces)).sum(axis=1)


def check_virtual_work(model, c, forces):
    """Compare what muscles do on bodies and through moving points with their moment arms."""
    tree = compile_tree(model)
    paths = compile_paths(model)
    pulls, work = paths.pulls(c)
    _, _, arms = paths.evaluate(c)
    wanted = np.zeros_like(c)
    for k in np.flatnonzero(paths.arm_free):
        wanted[:, paths.arm_coordinate[k]] += (arms - work)[:, k] * forces[:, paths.arm_muscle[k]]
    found = gathered(tree, c, along_coordinates(tree, c, of_muscles(paths, pulls, forces)))
    lost = left_over(model, c, forces)
    apart = np.abs(found - wanted)[:, tree.independent].max(axis=1)
    assert (apart <= lost + 1e-9).all()
    return work, lost


def test_muscles_do_on_bodies_what_their_moment_arms_say(walk, data):
    """Virtual work, of points that move in their bodies too.

    Along the whole model's own motion muscles do nothing.
    """
    model, motion, _, tension = walk
    work, lost = check_virtual_work(
        model, compile_tree(model).coordinates_of(motion), tension.muscle_force
    )
    assert lost.max() < 0.5
    for name in (
        "opensim-reference-small/arm26_bounds.osim",
        "opensim-gait-subject01/ref_scale/gait2354_simbody.osim",
    ):
        model = read_osim(data(name))
        tree = compile_tree(model)
        rng = np.random.default_rng(0)
        still = Motion(
            np.arange(4.0),
            model.coordinate_names,
            rng.uniform(-0.3, 0.3, (4, len(model.coordinates))),
        )
        forces = rng.uniform(0.0, 1000.0, (4, len(model.muscles)))
        work, lost = check_virtual_work(model, tree.coordinates_of(still), forces)
        assert lost.max() < 1e-9
    # gait2354 has points that move.
    assert np.abs(work).max() > 1e-3


def test_actuators_and_bushings_do_on_bodies_what_they_do_along_coordinates():
    rng = np.random.default_rng(1)
    model = random_tree(5, 8)
    tree = compile_tree(model)
    c = rng.normal(scale=0.4, size=(3, 8))
    rates = rng.normal(size=(3, 8))
    poses = forward_kinematics(tree, c)
    actuators = _actuators(rng)
    P = compile_body_actuators(tree, actuators)
    entries = np.empty((3, len(P.coordinate)))
    body_directions(tree.arrays, P, c, entries)
    for a in range(len(actuators)):
        force = np.zeros((3, len(actuators)))
        force[:, a] = 2.5
        wanted = np.zeros_like(c)
        here = slice(P.start[a], P.start[a + 1])
        wanted[:, P.coordinate[here]] = 2.5 * entries[:, here]
        found = along_coordinates(tree, c, of_actuators(tree, poses, actuators, force))
        np.testing.assert_allclose(found, wanted, atol=1e-11)
    bush = _bushing(rng)
    found = along_coordinates(tree, c, of_bushings(tree, poses, [bush], rates))
    np.testing.assert_allclose(found, bushing_forces(tree, [bush], c, rates), atol=1e-10)
    np.testing.assert_allclose(of_bushings(tree, poses, [bush], rates).sum(axis=1), 0.0, atol=1e-11)


def _actuators(rng):
    """Return an actuator of each kind on bodies."""
    return [
        Actuator(
            "a", "point", 1.0, body="body3", point=rng.normal(size=3), direction=rng.normal(size=3)
        ),
        Actuator(
            "b", "point", 1.0, body="body6", direction=rng.normal(size=3), direction_is_global=False
        ),
        Actuator(
            "c", "torque", 1.0, body="body4", other_body="body7", direction=rng.normal(size=3)
        ),
        Actuator(
            "d",
            "point_to_point",
            1.0,
            body="body1",
            other_body="body7",
            point=rng.normal(size=3),
            other_point=rng.normal(size=3),
        ),
        Actuator(
            "e",
            "point",
            1.0,
            body="body5",
            point=rng.normal(size=3),
            point_is_global=True,
            direction=rng.normal(size=3),
        ),
    ]


def _bushing(rng):
    pose_1 = Transform(random_rotation(rng), 0.1 * rng.normal(size=3))
    pose_2 = Transform(random_rotation(rng), 0.1 * rng.normal(size=3))
    turning, turning_rate, shifting, shifting_rate = rng.uniform(1.0, 5.0, (4, 3))
    return Bushing(
        name="bush",
        body_1="body1",
        body_2="body6",
        pose_1=pose_1,
        pose_2=pose_2,
        rotational_stiffness=turning,
        rotational_damping=turning_rate,
        translational_stiffness=shifting,
        translational_damping=shifting_rate,
    )


def test_a_reaction_works_on_its_joints_coordinates_only_through_what_acts_there(walk):
    """At the free coordinates the reaction's power is that of the reserves.

    Muscles and plates carry all else.
    """
    model, motion, wrenches, tension = walk
    found = joint_reactions(model, motion, tension, wrenches, frame="ground")
    assert tension.optimal.all()
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    lost = left_over(model, tree.coordinates_of(motion), tension.muscle_force)
    for name in ("hip_flexion_r", "ankle_angle_l", "elbow_flex_r", "lumbar_extension"):
        joint = next(one for one in model.joints if name in one.coordinates)
        k = found.joints.index(joint.name)
        j = model.coordinate_names.index(name)
        given = _acting_along(model, motion, tension, name)
        for frame in range(len(motion)):
            relative = _relative_jacobian(poses, joint, frame)[:, j]
            work = relative @ np.concatenate([found.moments[frame, k], found.forces[frame, k]])
            np.testing.assert_allclose(work, given[frame], atol=1e-5 + lost[frame])


def _acting_along(model, motion, tension, name):
    """Return the force (frames,) of reserves, own actuators and springs along a coordinate."""
    acting = [one.name for one in model.actuators if one.coordinate == name] + [f"reserve_{name}"]
    given = sum(tension.actuator_force[:, tension.reserve_names.index(one)] for one in acting)
    springs = [one for one in model.passive_torques if one.coordinate == name]
    speed = motion.velocities[:, motion.names.index(name)]
    return given + sum(one.total(motion[name], speed) for one in springs)


def _relative_jacobian(poses, joint, frame):
    """Return the Jacobian (6, coordinates) of a joint's child against its parent at the joint."""
    child = poses.tree.body_index[joint.child]
    point = poses.origins[frame, child] + poses.rotations[frame, child] @ (
        joint.child_frame.translation
    )

    def of(body):
        jacobian = poses.jacobian(poses.tree.body_index[body], point)[frame]
        return np.zeros_like(jacobian) if body == GROUND else jacobian

    return of(joint.child) - of(joint.parent)


def test_the_table_has_one_column_a_joint_with_a_plain_name(walk):
    model, motion, wrenches, tension = walk
    loads = joint_reactions(model, motion, tension, wrenches)
    plain = loads.table()
    labelled = loads.table(joint_labels(model))
    for side in ("r", "l"):
        joint = next(
            name for name in loads.joints if name in (f"knee_{side}", f"walker_knee_{side}")
        )
        np.testing.assert_allclose(
            labelled[f"knee_{side}_force"], np.linalg.norm(loads.of(joint), axis=1)
        )
    assert labelled.names[len(loads.joints) :] == plain.names
    assert len(set(labelled.names)) == len(labelled.names)


def test_joints_without_a_word_are_named_after_coordinates_or_bodies(walk):
    model, *_ = walk
    joints = [replace(joint, name=f"j{index}") for index, joint in enumerate(model.joints)]
    labels = joint_labels(replace(model, joints=tuple(joints)))
    assert {"hip_r", "knee_r", "ankle_l"} <= set(labels.values())
    assert labels["j0"] == model.joints[0].child
    assert len(set(labels.values())) == len(labels)


def test_forces_and_motion_agree_on_the_reactions_of_a_balanced_motion(walk):
    model, motion, wrenches, tension = walk
    one = joint_reactions(model, motion, tension, wrenches, accelerations="motion")
    other = joint_reactions(model, motion, tension, wrenches, accelerations="forces")
    # The moment that paths on several surfaces leave over turns the whole model a little.
    np.testing.assert_allclose(one.forces, other.forces, atol=1.0)
    assert np.abs(one.forces).max() > 1000.0


def test_side_and_frame_say_the_same_load(walk):
    model, motion, wrenches, tension = walk
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    joint = next(one for one in model.joints if one.name == "walker_knee_r")
    found = joint_reactions(
        model,
        motion,
        tension,
        wrenches,
        ["walker_knee_r"] * 4,
        ["child", "child", "parent", "child"],
        ["ground", "child", "parent", "pelvis"],
    )
    assert found.frames == ("ground", "tibia_r", "femur_r", "pelvis")
    assert found.bodies == ("tibia_r", "tibia_r", "femur_r", "tibia_r")
    numbers = [tree.body_index[name] for name in found.frames]
    turns = poses.rotations[:, numbers]
    ground = np.einsum("fkij,fkj->kfi", turns, found.forces)
    moments = np.einsum("fkij,fkj->kfi", turns, found.moments)
    points = np.einsum("fkij,fkj->kfi", turns, found.points)
    points = points + np.moveaxis(poses.origins[:, numbers], 1, 0)
    np.testing.assert_allclose(ground[1], ground[0], atol=1e-9)
    np.testing.assert_allclose(ground[3], ground[0], atol=1e-9)
    np.testing.assert_allclose(ground[2], -ground[0], atol=1e-9)
    np.testing.assert_allclose(moments[3], moments[0], atol=1e-9)
    # The same wrench about one point, on the parent with the opposite sign.
    shifted = moments[0] + np.cross(points[0] - points[2], ground[0])
    np.testing.assert_allclose(moments[2], -shifted, atol=1e-9)
    np.testing.assert_allclose(
        found.points[:, 1], np.tile(joint.child_frame.translation, (len(motion), 1)), atol=1e-12
    )
    np.testing.assert_allclose(
        found.points[:, 2], np.tile(joint.parent_frame.translation, (len(motion), 1)), atol=1e-12
    )
    table = found.table()
    assert table.names[:2] == (
        "walker_knee_r_on_tibia_r_in_ground_fx",
        "walker_knee_r_on_tibia_r_in_ground_fy",
    )
    assert table.names[18] == "walker_knee_r_on_femur_r_in_femur_r_fx"
    np.testing.assert_array_equal(
        table["walker_knee_r_on_tibia_r_in_ground_mz"], found.moments[:, 0, 2]
    )


def test_external_forces_pass_through_the_joints_below_them():
    """A still chain in any pose.

    The reaction at the root is the weight less what is applied.
    """
    model = random_tree(3, 6)
    motion = swinging(model, 3, 0.01)
    motion = replace(
        motion, velocities=0.0 * motion.velocities, accelerations=0.0 * motion.accelerations
    )
    rng = np.random.default_rng(0)
    forces, points, torques = rng.normal(scale=20.0, size=(3, 3, 2, 3))
    wrenches = Wrenches(
        time=motion.time,
        names=("one", "two"),
        bodies=("body2", "body5"),
        forces=forces,
        points=points,
        torques=torques,
    )
    found = joint_reactions(model, motion, None, wrenches, ["j0"], frame="ground")
    np.testing.assert_allclose(
        found.forces[:, 0], -model.mass * model.gravity - forces.sum(axis=1), atol=1e-10
    )
    nan = np.where(np.arange(3)[:, None, None] == 1, np.nan, points)
    silent = replace(wrenches, forces=np.where(np.isnan(nan), 0.0, forces), points=nan)
    assert np.isfinite(of_wrenches(compile_tree(model), silent)).all()


def _plates(table, time):
    """Return the forces of both plates at some times, without free torques."""
    at = np.searchsorted(table.time, time - 1e-6)

    def of(quantity):
        return np.stack(
            [
                np.column_stack([table[f"{side}ground_force_{quantity}{x}"][at] for x in "xyz"])
                for side in ("", "1_")
            ],
            1,
        )

    forces = of("v")
    return Wrenches(
        time=time,
        names=("r", "l"),
        bodies=("calcn_r", "calcn_l"),
        forces=forces,
        points=of("p"),
        torques=np.zeros_like(forces),
    )


def test_reactions_of_a_study_with_its_own_forces(data):
    """Uhlrich et al. 2022: reactions of the study's muscle forces.

    The free torques of the plates are left out as there. OpenSim 4.6 on the same files is as far
    from the study's table (made by an earlier version) as this is: 9.7 N.
    """
    model = read_osim(data(STUDY + "Rajagopal_scaled_Sub1_gasAvoid.osim"))
    states = read_sto(data(STUDY + "results_SO/results_states.sto"))
    forces = read_sto(data(STUDY + "results_SO/results_forces.sto"))
    expected = read_sto(data(STUDY + "results_SO/results_JointReaction_JointRxn_ReactionLoads.sto"))
    given = motion_from_table(states, model)
    speeds = {name.split("/")[-2]: states[name] for name in states.names if name.endswith("/speed")}
    motion = replace(
        given,
        velocities=np.column_stack([speeds[name] for name in given.names]),
        accelerations=np.zeros_like(given.values),
    )
    wrenches = _plates(read_sto(data(STUDY + "walking_baseline1_forces.mot")), motion.time)
    reserves = tuple(name for name in forces.names if name.endswith("_reserve"))
    actuators = [
        Actuator(name, "coordinate", 1.0, coordinate=name.removesuffix("_reserve"))
        for name in reserves
    ]
    names = (*model.muscle_names, *reserves)
    used = Series(forces.time, names, np.column_stack([forces[name] for name in names]))
    found = joint_reactions(
        model, motion, used, wrenches, actuators=actuators, accelerations="forces", patella="string"
    )
    found = found.table()
    apart = np.abs(
        found.values - expected.values[:, [expected.names.index(name) for name in found.names]]
    )
    assert set(found.names) == set(expected.names)
    assert apart.max() < 10.0
    assert np.median(apart.max(axis=0)) < 0.001
    assert np.abs(expected["walker_knee_l_on_tibia_l_in_tibia_l_fy"]).max() > 3800.0


def test_what_is_missing_or_unknown_is_named(walk):
    model, motion, wrenches, tension = walk
    with pytest.raises(UnknownName, match="unknown joint 'knee'"):
        joint_reactions(model, motion, tension, wrenches, ["knee"])
    with pytest.raises(UnknownName, match="unknown frame 'femur'"):
        joint_reactions(model, motion, tension, wrenches, ["hip_r"], frame="femur")
    with pytest.raises(BadData, match="there are 'child', 'parent'"):
        joint_reactions(model, motion, tension, wrenches, ["hip_r"], on="both")
    with pytest.raises(BadData, match="names 2 for 1 joints"):
        joint_reactions(model, motion, tension, wrenches, ["hip_r"], frame=["child", "parent"])
    some = Series(motion.time, ("soleus_r",), np.zeros((len(motion), 1)))
    with pytest.raises(UnknownName, match="unknown muscle"):
        joint_reactions(model, motion, some)
    late = replace(tension, time=tension.time + 1.0)
    with pytest.raises(BadData, match="both must have the same times"):
        joint_reactions(model, motion, late)
    unsolved = replace(
        tension, muscle_force=np.where(np.arange(6)[:, None] == 2, np.nan, tension.muscle_force)
    )
    found = joint_reactions(model, motion, unsolved, wrenches, ["hip_r"])
    assert np.isnan(found.forces[2]).all()
    assert np.isfinite(found.forces[[0, 1, 3, 4, 5]]).all()


def test_frames_that_are_missing_stay_missing_and_the_others_stand():
    """A closed loop with a gap in its motion."""
    model, closed = looped_tree(1, kinds=("PointConstraint",), bodies=10)
    values = np.tile(closed, (4, 1))
    whole = Motion(
        time=np.arange(4.0),
        names=model.coordinate_names,
        values=values,
        velocities=0.0 * values,
        accelerations=0.0 * values,
    )
    gap = np.array(values)
    gap[2] = np.nan
    torn = replace(whole, values=gap, velocities=0.0 * gap, accelerations=0.0 * gap)
    for how in ("motion", "forces"):
        one = joint_reactions(model, whole, None, accelerations=how)
        other = joint_reactions(model, torn, None, accelerations=how)
        assert np.isnan(other.forces[2]).all()
        np.testing.assert_allclose(other.forces[[0, 1, 3]], one.forces[[0, 1, 3]], atol=1e-9)

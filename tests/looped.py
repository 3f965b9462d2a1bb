"""Models that close loops: made ones, and those of the data collection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Loop, Marker, Model
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import functional_tree, random_rotation, random_tree, to_mujoco, to_pinocchio

SHOULDERS = (
    "shoulder-bonepin/subject1_abdbonepin.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_2kgWeight.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim",
)


def looped_tree(seed, kinds=("PointConstraint", "WeldConstraint"), functional=False, bodies=30):
    """Make a random tree with a loop of each kind, closed at random coordinates.

    The coordinates are returned too.
    """
    rng = np.random.default_rng(500 + seed)
    model = functional_tree(seed, bodies) if functional else random_tree(seed, bodies)
    closed = rng.normal(scale=0.4, size=(1, len(model.coordinates)))
    tree = compile_tree(model)
    couple_frames(tree.arrays, closed)
    poses = forward_kinematics(tree, closed)
    loops = []
    for i, kind in enumerate(kinds):
        one = len(model.bodies) - i
        two = 2 + i
        world = Transform(random_rotation(rng), rng.normal(size=3))
        loops.append(
            Loop(
                name=f"loop{i}",
                kind=kind,
                body_1=model.bodies[one - 1].name,
                body_2=model.bodies[two - 1].name,
                pose_1=_pose(poses, one).inverse() @ world,
                pose_2=_pose(poses, two).inverse() @ world,
            )
        )
    return replace(model, loops=tuple(loops)), closed[0]


def _pose(poses, body):
    """Of a body in the first frame."""
    return Transform(poses.rotations[0, body], poses.origins[0, body])


def four_bar(crank=0.3, coupler=0.7, rocker=0.6, ground=0.8, kind="PointConstraint"):
    """Make a planar linkage: the crank and the rocker turn on the ground.

    The coupler's end is tied to the rocker's. Rotations are about z; coordinates are crank, coupler
    (relative to the crank) and rocker; each body has four markers.
    """
    still = Transform.identity()
    z = np.eye(3)[2]

    def hinge(name, parent, at):
        axis = Axis(kind="rotation", vector=z, function=linear(1.0), coordinates=(name,))
        return Joint(
            name=name,
            kind="PinJoint",
            parent=parent,
            child=f"{name}_bar",
            parent_frame=Transform(np.eye(3), at),
            child_frame=still,
            axes=(axis,),
            coordinates=(name,),
        )

    joints = (
        hinge("crank", GROUND, np.zeros(3)),
        hinge("coupler", "crank_bar", np.array([crank, 0.0, 0.0])),
        hinge("rocker", GROUND, np.array([ground, 0.0, 0.0])),
    )
    lengths = (crank, coupler, rocker)
    names = ("crank", "coupler", "rocker")
    bodies = tuple(
        Body(
            name=f"{name}_bar",
            mass=1.0,
            mass_center=np.array([0.5 * length, 0.0, 0.0]),
            inertia=0.01 * np.eye(3),
        )
        for name, length in zip(names, lengths, strict=True)
    )
    tie = Loop(
        name="pin",
        kind=kind,
        body_1="coupler_bar",
        body_2="rocker_bar",
        pose_1=Transform(np.eye(3), np.array([coupler, 0.0, 0.0])),
        pose_2=Transform(np.eye(3), np.array([rocker, 0.0, 0.0])),
    )
    markers = tuple(
        Marker(f"{body.name}_{i}", body.name, np.array([0.1 * i, 0.05 * (-1) ** i, 0.02]))
        for body in bodies
        for i in (1, 2, 3)
    )
    coordinates = tuple(
        Coordinate(name, default=value) for name, value in zip(names, (1.0, -0.5, 1.5), strict=True)
    )
    return Model(
        name="four bars",
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        gravity=np.array([0, -9.81, 0]),
        markers=markers,
        loops=(tie,),
    )


def four_bar_angles(turn, crank=0.3, coupler=0.7, rocker=0.6, ground=0.8):
    """Return (frames, 3) coordinates of `four_bar` by the law of cosines, elbow up.

    The crank angles are (frames,).
    """
    end = crank * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    away = np.array([ground, 0.0]) - end
    distance = np.linalg.norm(away, axis=1)
    inner = np.arccos((coupler**2 + distance**2 - rocker**2) / (2 * coupler * distance))
    heading = np.arctan2(away[:, 1], away[:, 0]) + inner
    tip = end + coupler * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    back = np.arctan2(tip[:, 1], tip[:, 0] - ground)
    return np.stack([turn, heading - turn, back], axis=1)


def mujoco_constraints(model, coordinates):
    """Return MuJoCo's errors (rows,) of connects and welds at coordinates (n,).

    Their derivatives (rows, n) are returned too.
    """
    import mujoco

    spec = to_mujoco(replace(model, loops=()), compiled=False)
    for loop in model.loops:
        added = spec.add_equality(name=loop.name, name1=loop.body_1, name2=loop.body_2)
        added.objtype = mujoco.mjtObj.mjOBJ_BODY
        if loop.kind == "connect":
            added.type = mujoco.mjtEq.mjEQ_CONNECT
            added.data[:3] = loop.pose_1.translation
        else:
            added.type = mujoco.mjtEq.mjEQ_WELD
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, (loop.pose_1 @ loop.pose_2.inverse()).rotation.ravel())
            added.data[:3] = loop.pose_2.translation
            added.data[3:6] = loop.pose_1.translation
            added.data[6:10] = quaternion
            added.data[10] = 1.0
    theirs = spec.compile()
    for i, loop in enumerate(model.loops):
        if loop.kind == "connect":
            # MuJoCo finds the second anchor in its own default pose; ours is known.
            theirs.eq_data[i, 3:6] = loop.pose_2.translation
    data = mujoco.MjData(theirs)
    order = [theirs.joint(joint.name).dofadr[0] for joint in model.joints]
    data.qpos[order] = coordinates
    mujoco.mj_forward(theirs, data)
    return data.efc_pos.copy(), data.efc_J.reshape(-1, theirs.nv)[:, order].copy()


def pinocchio_rates(model, coordinates, velocities, accelerations):
    """Return what a point or a weld ties, by Pinocchio.

    It is pairs of velocities, then of accelerations, of both ends.
    """
    import pinocchio as pin

    theirs, ids = to_pinocchio(model)
    ends = [
        [
            theirs.addFrame(
                pin.Frame(
                    loop.name + body,
                    ids[body],
                    pin.SE3(pose.rotation, pose.translation),
                    pin.OP_FRAME,
                )
            )
            for body, pose in ((loop.body_1, loop.pose_1), (loop.body_2, loop.pose_2))
        ]
        for loop in model.loops
    ]
    data = theirs.createData()
    pin.forwardKinematics(theirs, data, coordinates, velocities, accelerations)
    for rate in (pin.getFrameVelocity, pin.getFrameClassicalAcceleration):
        for loop, frames in zip(model.loops, ends, strict=True):
            rows = 6 if loop.kind == "WeldConstraint" else 3
            axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            first, second = frames
            of_first = rate(theirs, data, first, axes).vector[:rows]
            of_second = rate(theirs, data, second, axes).vector[:rows]
            yield of_first, of_second


def markers_of(model, values, noise=0.0, seed=0):
    """Return what cameras see of a model's markers at coordinates (frames, coordinates).

    The rate is 100 frames a second.
    """
    tree = compile_tree(model)
    bodies = np.array([tree.body_index[one.body] for one in model.markers])
    places = forward_kinematics(tree, values).points(
        bodies, np.array([one.location for one in model.markers])
    )
    places = places + np.random.default_rng(seed).normal(scale=noise, size=places.shape)
    return Markers(np.arange(len(values)) * 0.01, model.marker_names, places)

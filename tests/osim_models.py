"""The OpenSim models of the data collection, and their kinematics in plain NumPy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import GROUND, Joint, Model
from myomorph.core.model.paths import MovingPathPoint, PathPoint
from myomorph.core.model.spatial import Transform, axis_rotation

FILES = (
    "bones-landmarks-leg/make-a-leg_final.osim",
    "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim",
    "c3d-functional-joints/models/scaled.osim",
    "c3d-functional-joints/models/wholebody.osim",
    "ceinms-emg-walk/model/gait2392.osim",
    "fullbody-many-muscles/cyclistFullBodyMuscle.osim",
    "hamner-run-subject04/unscaled_generic.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
    "opencap-subject4-multitask/models/manually_scaled.osim",
    "opencap-subject4-multitask/models/unscaled_generic.osim",
    "opensim-gait-subject01/experiment/gait2354_simbody.osim",
    "opensim-gait-subject01/ref_id/subject01.osim",
    "opensim-gait-subject01/ref_ik/subject01_simbody.osim",
    "opensim-gait-subject01/ref_rra/subject01_RRA_adjusted.osim",
    "opensim-gait-subject01/ref_rra/subject01_simbody.osim",
    "opensim-gait-subject01/ref_rra/subject01_simbody_adjusted.osim",
    "opensim-gait-subject01/ref_scale/gait2354_simbody.osim",
    "opensim-gait-subject01/ref_scale/std_subject01_simbody.osim",
    "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim",
    "opensim-reference-small/DoublePendulum3D.osim",
    "opensim-reference-small/SinglePin.osim",
    "opensim-reference-small/arm26.osim",
    "opensim-reference-small/arm26_bounds.osim",
    "opensim-reference-small/double_pendulum.osim",
    "passive-joint-moments/Rajagopal_abductorsModified_PassiveCalibration.osim",
    "passive-joint-moments/Rajagopal_modifiedAbductors.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "rajagopal-walk-emg/subject_walk_scaled.osim",
    "shoulder-bonepin/subject1_abdbonepin.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_2kgWeight.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim",
    "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim",
)


def joint_pose(joint: Joint, values: Mapping[str, float]) -> Transform:
    """Pose of the child in the parent, one axis after another."""
    pose = joint.parent_frame
    for axis in joint.axes:
        function = axis.function
        given = [values[name] for name in axis.coordinates[: function.arity]]
        amount = float(function(*given) if function.arity else function(0.0))
        if axis.kind == "translation":
            pose = pose @ Transform(np.eye(3), amount * axis.vector)
        else:
            turn = axis_rotation(axis.vector, amount)
            pose = pose @ Transform(turn, axis.origin - turn @ axis.origin)
    return pose @ joint.child_frame.inverse()


def body_poses(model: Model, values: Mapping[str, float]) -> dict[str, Transform]:
    """Pose of every body in ground at given coordinates."""
    poses = {GROUND: Transform.identity()}
    for joint in model.joints:
        poses[joint.child] = poses[joint.parent] @ joint_pose(joint, values)
    return poses


def point_place(point: PathPoint | MovingPathPoint, values: Mapping[str, float]) -> Array:
    """Return a path point in its body's frame.

    Parameters
    ----------
    point : fixed or moving
    values : coordinates by name [rad or m]

    Returns
    -------
    (3,) [m]
    """
    if isinstance(point, PathPoint):
        return point.location
    pairs = zip(point.functions, point.coordinates, strict=True)
    return np.array([float(function(values[name] if name else 0.0)) for function, name in pairs])


def random_values(model: Model, seed: int) -> dict[str, float]:
    """Coordinates somewhere in their ranges."""
    random = np.random.default_rng(seed)
    ends = (
        (one.name, max(one.range[0], -1.5), min(one.range[1], 1.5)) for one in model.coordinates
    )
    return {name: random.uniform(min(low, high), high) for name, low, high in ends}

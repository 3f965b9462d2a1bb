"""Inertial sensors where markers are hidden: a right shank and foot that no camera saw."""

import numpy as np

import myomorph as mm

walk = mm.sample("walk")
truth = walk.truth["coordinate_value"]
poses = mm.viewer.bone_poses(walk.model, truth)
hidden = ("RTIB", "RANK", "RMED", "RHEE", "RTOE", "RMT5")
model = walk.model.without(*hidden)
sensors = [mm.OrientationTask(body, body, poses.rotation(body)) for body in ("tibia_r", "calcn_r")]
for what, tasks in (("markers", []), ("markers and two sensors", sensors)):
    options = mm.InverseKinematicsOptions(tasks=tasks)
    knee = mm.inverse_kinematics(model, walk.markers, options).motion["knee_angle_r"]
    error = np.degrees(np.sqrt(np.mean((knee - truth["knee_angle_r"]) ** 2)))
    print(f"{what}: knee {error:.1f}° off")

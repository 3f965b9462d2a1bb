"""Torques while frames arrive, held against those computed afterwards."""

import numpy as np

import myomorph as mm

walk = mm.sample("walk")
frames = list(mm.live_frames(walk.model, walk.markers, walk.loads, speed=0.0))
solved = [frame for frame in frames if frame.state == "solved"]
fit = mm.inverse_kinematics(walk.model, walk.markers)
motion = mm.differentiate(fit.motion, cutoff=walk.cutoff)
loads = mm.resample_wrenches(walk.loads, motion.time, cutoff=walk.cutoff)
knee = mm.inverse_dynamics(walk.model, motion, loads)["knee_angle_r"]
late = np.interp([frame.time - frame.delay for frame in solved], motion.time, knee)
apart = np.sqrt(np.mean((late - [frame.torque("knee_angle_r") for frame in solved]) ** 2))
print(f"{len(solved)} of {len(frames)} frames, knee torque {apart:.1f} N m from afterwards")

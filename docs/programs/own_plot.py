"""A figure of one's own: moments over the stride, with the peak marked."""

import numpy as np

import myomorph as mm

walk = mm.sample("walk")
fit = mm.inverse_kinematics(walk.model, walk.markers)
motion = mm.differentiate(fit.motion, cutoff=walk.cutoff)
loads = mm.resample_wrenches(walk.loads, motion.time, cutoff=walk.cutoff)
torques = mm.inverse_dynamics(walk.model, motion, loads)
curves = torques.strides(mm.walking_strides(walk.model, motion, wrenches=loads))
axes = curves.plot(["hip_flexion", "knee_angle", "ankle_angle"])
push_off = curves.percent[np.argmin(curves.mean("ankle_angle_r"))]
axes[2].axvline(push_off, color="gray", lw=0.8)
axes[2].figure.savefig("moments.png", dpi=120)
print(f"{curves}; push-off at {push_off:.0f} % of the stride")

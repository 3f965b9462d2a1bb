"""Two groups compared over the whole stride."""

import numpy as np

import myomorph as mm


def group(name):
    members = []
    for number in range(1, 5):
        one = mm.sample(name, number)
        motion = mm.inverse_kinematics(one.model, one.markers).motion
        strides = mm.walking_strides(one.model, motion, wrenches=one.loads)
        members.append(mm.groups.member(f"{name} {number}", {"angle": motion.strides(strides)}))
    return mm.groups.Group(name, tuple(members))


knee = mm.groups.compare_groups(group("run"), group("walk")).curve("knee_angle_r")
where = ", ".join(f"{start:.0f} to {stop:.0f}" for start, stop in knee.regions)
more = np.degrees(knee.difference.max())
print(f"knee bends up to {more:.0f}° more, p {knee.least_p:.3f}, at {where} % of the stride")

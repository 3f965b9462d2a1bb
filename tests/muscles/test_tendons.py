"""Tendon lengths, moment arms and speeds of whole MuJoCo models, with MuJoCo as the oracle."""

import numpy as np
import pytest

from mujoco_models import MYO_SIM, State, compiled, load, random_motion
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import muscle_kinematics

mujoco = pytest.importorskip("mujoco")
FRAMES = 4
# A tendon over a sphere and through two pulley branches, with a gear on its muscle.
PULLEYS = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <site name="o" pos="0 0.1 0.5"/><site name="q" pos="0.1 0 0.5"/>
    <geom name="ball" type="sphere" size="0.12" pos="0 0 0.2" contype="0" conaffinity="0"/>
    <body name="one" pos="0 0 0.1"><joint name="j1" axis="1 0 0" range="-1 1"/>\
<geom size="0.05" pos="0 0 -0.2"/>
      <site name="i" pos="0 0.02 -0.1"/><site name="k" pos="0.05 0.1 -0.2"/>
      <body name="two" pos="0 0 -0.3"><joint name="j2" axis="0 1 0" range="-1 1"/>\
<geom size="0.05"/>
        <site name="l" pos="0.1 0 -0.1"/><site name="m" pos="-0.1 0.02 -0.2"/></body></body>
  </worldbody>
  <tendon>
    <spatial name="t"><site site="o"/><geom geom="ball"/><site site="i"/>
      <pulley divisor="2"/><site site="i"/><site site="k"/><site site="l"/>
      <pulley divisor="3"/><site site="q"/><site site="m"/></spatial>
  </tendon>
  <actuator><muscle name="a" tendon="t" gear="1.5" lengthrange="0.5 1.5"/></actuator>
</mujoco>
"""


def tendon_jacobian(m, d):
    """Return the Jacobian (tendons, nv), from MuJoCo's rows.

    It is dense in small models before 3.6, where the pattern moved to the model.
    """
    if not hasattr(m, "ten_J_rownnz") and not mujoco.mj_isSparse(m):
        return np.reshape(d.ten_J, (m.ntendon, m.nv))
    home = m if hasattr(m, "ten_J_rownnz") else d
    values = np.ravel(d.ten_J)
    columns = np.ravel(home.ten_J_colind)
    jacobian = np.zeros((m.ntendon, m.nv))
    for t in range(m.ntendon):
        start = home.ten_J_rowadr[t]
        count = home.ten_J_rownnz[t]
        jacobian[t, columns[start : start + count]] = values[start : start + count]
    return jacobian


def states(m, model, motion):
    d = mujoco.MjData(m)
    for frame in range(len(motion)):
        state = State(model, motion, frame)
        d.qpos[:] = state.qpos
        d.qvel[:] = state.qvel
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        yield frame, state, d


def compare(m, model, motion):
    """Largest differences of lengths [m], moment arms [m/rad] and speeds [m/s]."""
    found = muscle_kinematics(model, motion)
    arms, muscle, coordinate = found.independent()
    driven = [m.actuator(muscle.name).id for muscle in model.muscles]
    tendon = m.actuator_trnid[driven, 0]
    gear = m.actuator_gear[driven, 0]
    couplers = found.paths.tree.arrays
    worst = np.zeros(3)
    for frame, state, d in states(m, model, motion):
        length = np.abs(found.muscle_length[frame] - d.ten_length[tendon] * gear)
        expected = -tendon_jacobian(m, d)[tendon] @ state.basis * gear[:, None]
        _give_to_leaders(expected, couplers, found.coupler_slopes[frame])
        ours = np.zeros_like(expected)
        ours[muscle, coordinate] = arms[frame]
        free = np.ones(expected.shape[1], dtype=bool)
        free[couplers.coupler_coordinate] = False
        moment_arm = np.abs(ours - expected)[:, free]
        speed = np.abs(found.muscle_velocity[frame] - d.ten_velocity[tendon] * gear)
        worst = np.maximum(worst, [length.max(), moment_arm.max(), speed.max()])
    return worst


def _give_to_leaders(arms, couplers, slopes):
    """Add to arms (muscles, coordinates) what MuJoCo gives joints that follow others.

    It reaches the other joint by the equality's slope.
    """
    for k in reversed(range(len(couplers.coupler_coordinate))):
        source = couplers.coupler_source[k, 0]
        follower = couplers.coupler_coordinate[k]
        arms[:, source] += slopes[k, 0] * arms[:, follower]


@pytest.mark.parametrize("name", ["mouse arm", *MYO_SIM, "MyoFullBody"])
def test_lengths_moment_arms_and_speeds_equal_mujoco(name, data):
    m, model = load(name, data)
    length, arm, speed = compare(m, model, random_motion(model, FRAMES, seed=7))
    assert length < 1e-9
    assert arm < 1e-7
    assert speed < 1e-7


def test_pulleys_and_gears():
    m = mujoco.MjModel.from_xml_string(PULLEYS)
    model = model_from_mujoco(m)
    (muscle,) = model.muscles
    assert muscle.path.divisors == pytest.approx((1 / 1.5, 0.0, 2 / 1.5, 2 / 1.5, 0.0, 3 / 1.5))
    assert np.all(compare(m, model, random_motion(model, 30)) < 1e-9)


def test_every_way_around_occurs():
    """The poses above use what they are to test: surfaces wrapped and not, by side and without."""
    m = compiled("myofullbody")
    model = model_from_mujoco(m)
    motion = random_motion(model, FRAMES, seed=7)
    touched = [
        int(np.count_nonzero(d.wrap_obj[: int(d.ten_wrapnum.sum())] >= 0))
        for *_, d in states(m, model, motion)
    ]
    assert min(touched) > 100
    sides = [wrap.side is not None for muscle in model.muscles for wrap in muscle.path.wraps]
    assert any(sides)


def test_moment_arms_are_the_slopes_of_lengths():
    """-dl/dq by central differences, over the couplers of the knees."""
    model = model_from_mujoco(compiled("myolegs"))
    motion = random_motion(model, 2, seed=11)
    found = muscle_kinematics(model, motion, velocities=False)
    h = 1e-6
    for name in ("hip_flexion_r", "knee_angle_r", "ankle_angle_l"):
        j = motion.names.index(name)
        ends = []
        for sign in (-1.0, 1.0):
            values = motion.values.copy()
            values[:, j] += sign * h
            shifted = Motion(motion.time, motion.names, values)
            ends.append(
                muscle_kinematics(model, shifted, velocities=False, moment_arms=False).muscle_length
            )
        slope = (ends[1] - ends[0]) / (2 * h)
        np.testing.assert_allclose(found.moment_arm[:, :, j], -slope, atol=2e-6)

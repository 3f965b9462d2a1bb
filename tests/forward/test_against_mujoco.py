"""Simulations against MuJoCo's integrator."""

from __future__ import annotations

import numpy as np
import pytest
from tests.trees import random_tree, swinging, to_mujoco

from myomorph.forward.simulate import SimulationOptions, simulate

mujoco = pytest.importorskip("mujoco")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tree_falls_alike(seed):
    model = random_tree(seed)
    start = swinging(model, 1, 0.01, seed)
    theirs = to_mujoco(model)
    theirs.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    theirs.opt.timestep = 1e-4
    theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(theirs)
    # MuJoCo orders bodies depth first, ours stand as they were made.
    joints = [
        mujoco.mj_name2id(theirs, mujoco.mjtObj.mjOBJ_BODY, body.name) for body in model.bodies
    ]
    columns = [theirs.jnt_qposadr[theirs.body_jntadr[body]] for body in joints]
    data.qpos[columns] = start.values[0]
    data.qvel[columns] = start.velocities[0]
    for _ in range(3000):
        mujoco.mj_step(theirs, data)
    simulation = simulate(model, start, options=SimulationOptions(seconds=0.3, tolerance=1e-9))
    np.testing.assert_allclose(simulation.motion.values[-1], data.qpos[columns], atol=1e-6)

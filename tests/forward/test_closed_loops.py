"""Closed loops in motion: a linkage in one coordinate, OpenSim's shoulder, MuJoCo, and energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.forward.opensim_manager import opensim_forward
from tests.looped import SHOULDERS, four_bar, four_bar_angles
from tests.trees import to_mujoco

from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import polynomial
from myomorph.core.model.model import Body, Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.loops import close_loops, closure
from myomorph.core.rigid.tree import compile_tree
from myomorph.forward.drives import Drives
from myomorph.forward.shares import shares_of
from myomorph.forward.simulate import SimulationOptions, simulate

TIGHT = SimulationOptions(seconds=0.8, rate=25.0, tolerance=1e-9)
BARS = (0.3, 0.7, 0.6)
GROUND = 0.8


def largest_opening(simulation):
    """Largest closure error of a simulation [m or rad]."""
    tree = compile_tree(simulation.model)
    return float(np.abs(closure(tree, simulation.motion.values)).max())


def crank_alone(seconds, rate):
    """Crank angles (frames,) of `four_bar` by Lagrange's equation in the crank alone."""

    def energies(q, speed):
        """Kinetic and potential energy, all bodies by their positions over the crank."""
        step = 1e-5
        turns = np.array([q - step, q, q + step])
        angles = four_bar_angles(turns)
        absolute = np.stack([angles[:, 0], angles[:, 0] + angles[:, 1], angles[:, 2]], axis=1)
        starts = np.zeros((3, 3, 2))
        starts[:, 1] = BARS[0] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        starts[:, 2, 0] = GROUND
        heading = np.stack([np.cos(absolute), np.sin(absolute)], axis=2)
        centers = starts + 0.5 * np.array(BARS)[None, :, None] * heading
        rates = (centers[2] - centers[0]) / (2.0 * step)
        turning = (absolute[2] - absolute[0]) / (2.0 * step)
        mass = (rates**2).sum() + 0.01 * (turning**2).sum()
        return 0.5 * mass * speed**2, 9.81 * centers[1, :, 1].sum()

    def change(_, state):
        q, speed = state
        step = 1e-4
        half_mass = energies(q, 1.0)[0]
        bent = (energies(q + step, 1.0)[0] - energies(q - step, 1.0)[0]) / (2.0 * step)
        weight = (energies(q + step, 0.0)[1] - energies(q - step, 0.0)[1]) / (2.0 * step)
        return [speed, -(bent * speed**2 + weight) / (2.0 * half_mass)]

    times = np.arange(round(seconds * rate) + 1) / rate
    done = solve_ivp(change, (0.0, seconds), [1.0, 0.0], "DOP853", times, rtol=1e-10, atol=1e-10)
    return done.y[0]


def test_a_linkage_moves_as_its_crank_alone_does():
    angles = four_bar_angles(np.ones(1))
    names = ("crank", "coupler", "rocker")
    start = Motion(np.zeros(1), names, angles, velocities=np.zeros_like(angles))
    simulation = simulate(four_bar(), start, options=TIGHT)
    expected = four_bar_angles(crank_alone(0.8, 25.0))
    np.testing.assert_allclose(simulation.motion.values, expected, atol=1e-6)
    assert largest_opening(simulation) < 1e-11
    assert simulation.energy.largest_share < 1e-7


def welded_four_bar():
    """Make the linkage with a body on the coupler's end that is welded to the rocker.

    Three rows of the weld state what the plane of the hinges does already.
    """
    model = four_bar()
    hinge = model.joints[0]
    tip = Body(name="tip", mass=1e-6, mass_center=np.zeros(3), inertia=1e-9 * np.eye(3))
    axis = replace(hinge.axes[0], coordinates=("tip",))
    joint = Joint(
        name="tip",
        kind="PinJoint",
        parent="coupler_bar",
        child="tip",
        parent_frame=Transform(np.eye(3), np.array([BARS[1], 0.0, 0.0])),
        child_frame=Transform.identity(),
        axes=(axis,),
        coordinates=("tip",),
    )
    weld = replace(model.loops[0], kind="WeldConstraint", body_1="tip", pose_1=Transform.identity())
    default = 1.5 - 1.0 + 0.5
    coordinates = (
        *model.coordinates,
        replace(model.coordinates[0], name="tip", default=default),
    )
    return replace(
        model,
        bodies=(*model.bodies, tip),
        joints=(*model.joints, joint),
        coordinates=coordinates,
        loops=(weld,),
        markers=(),
    )


def test_a_weld_with_rows_that_say_nothing_holds_as_a_pin_does():
    pinned = simulate(four_bar(), options=TIGHT)
    names = (*pinned.motion.names, "tip")
    angles = pinned.motion.values[0]
    tip = angles[2] - angles[0] - angles[1]
    start = Motion(np.zeros(1), names, np.array([[*angles, tip]]), velocities=np.zeros((1, 4)))
    welded = simulate(welded_four_bar(), start, options=TIGHT)
    np.testing.assert_allclose(welded.motion.values[:, :3], pinned.motion.values, atol=1e-4)
    assert largest_opening(welded) < 1e-11
    assert welded.energy.largest_share < 1e-7


def test_a_driven_crank_does_the_work():
    model = four_bar()
    driven = replace(model.coordinates[0], prescribed=polynomial([1.0, 2.0, 0.5]), default=1.0)
    model = replace(model, coordinates=(driven, *model.coordinates[1:]))
    simulation = simulate(model, options=TIGHT)
    crank = simulation.motion["crank"]
    np.testing.assert_allclose(simulation.motion.values, four_bar_angles(crank), atol=1e-8)
    assert np.ptp(crank) > 1.0
    work = simulation.energy.work[:, simulation.energy.names.index("prescribed coordinates")]
    assert np.abs(work).max() > 0.5
    assert simulation.energy.largest_share < 1e-6


def test_a_linkage_is_mujocos_as_far_as_that_holds_its_loops():
    mujoco = pytest.importorskip("mujoco")
    model = four_bar()
    hinges = tuple(replace(joint, kind="rotation") for joint in model.joints)
    spec = to_mujoco(replace(model, joints=hinges, loops=()), compiled=False)
    loop = model.loops[0]
    equality = spec.add_equality(name=loop.name, name1=loop.body_1, name2=loop.body_2)
    equality.type = mujoco.mjtEq.mjEQ_CONNECT
    equality.objtype = mujoco.mjtObj.mjOBJ_BODY
    equality.data[:3] = loop.pose_1.translation
    # As stiff as steps of 20 microseconds allow.
    equality.solref[:] = (1e-4, 1.0)
    equality.solimp[:] = (0.9999, 0.9999, 1e-3, 0.5, 2.0)
    start = close_loops(compile_tree(model), compile_tree(model).defaults[None])
    poses = [(name, start[0, k]) for k, name in enumerate(model.coordinate_names)]
    theirs = spec.compile()
    theirs.opt.timestep = 2e-5
    data = mujoco.MjData(theirs)
    theirs.eq_data[0, :3] = loop.pose_1.translation
    theirs.eq_data[0, 3:6] = loop.pose_2.translation
    for name, value in poses:
        data.joint(name).qpos[0] = value
    for _ in range(round(0.4 / theirs.opt.timestep)):
        mujoco.mj_step(theirs, data)
    options = replace(TIGHT, seconds=0.4)
    motion = Motion(np.zeros(1), model.coordinate_names, start, velocities=np.zeros_like(start))
    simulation = simulate(model, motion, options=options)
    found = [data.joint(name).qpos[0] for name in model.coordinate_names]
    np.testing.assert_allclose(simulation.motion.values[-1], found, atol=1e-3)
    assert np.abs(simulation.motion.values[-1] - start[0]).max() > 0.5


def test_a_shoulder_with_its_loop_falls_as_in_opensim(data, tmp_path):
    pytest.importorskip("opensim")
    path = data(SHOULDERS[2])
    model = read_model(path)
    tree = compile_tree(model)
    closed = close_loops(tree, tree.defaults[None])[0]
    start = {name: (value, 0.0) for name, value in zip(model.coordinate_names, closed, strict=True)}
    theirs, ran = opensim_forward(
        path, tmp_path, changes=["no muscles"], seconds=0.15, rate=20.0, start=start
    )
    ours = read_model(ran)
    motion = Motion(np.zeros(1), tuple(start), closed[None], velocities=np.zeros((1, len(closed))))
    options = SimulationOptions(seconds=0.15, rate=20.0, tolerance=1e-9)
    simulation = simulate(ours, motion, options=options)
    columns = [simulation.motion.names.index(name) for name in theirs["names"]]
    assert np.abs(simulation.motion.values[:, columns] - theirs["values"]).max() < 1e-6
    assert np.abs(simulation.motion.values[-1] - closed).max() > 0.2
    assert largest_opening(simulation) < 1e-11
    assert simulation.energy.largest_share < 1e-6


def test_a_loop_that_is_another_models_is_refused():
    model = four_bar()
    start = Motion(
        np.zeros(1), model.coordinate_names, np.ones((1, 3)), velocities=np.zeros((1, 3))
    )
    with pytest.raises(BadData, match="'pin' open by up to"):
        simulate(model, start)


def test_a_followed_linkage_needs_no_feedback_beyond_its_loops():
    model: Model = four_bar()
    options = replace(TIGHT, seconds=0.4, rate=200.0)
    free = simulate(model, options=options)
    drives = Drives(follow=free.motion, feedback=5.0)
    again = simulate(model, free.motion, drives, options)
    np.testing.assert_allclose(again.motion.values, free.motion.values, atol=1e-6)
    sizes = {share.where: share.sizes for share in shares_of(again, drives)}
    assert sizes["Joints"]["feedback"] < 1e-3

"""Identified damping and stiffness put into a model, its file, and OpenSim's forces."""

from __future__ import annotations

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from myomorph.core.io.mjcf.couplings import write_dampers
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, BadFile, BadModel, UnknownName
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.passive_dynamics import line_viscosity, with_passive_dynamics
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.passive import passive_generalized_forces
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.show.demo.arm import osim_text
from myomorph.swings.viscosity.identified_model import (
    ViscosityValues,
    dampers_of,
    joint_bushing,
)
from truths.coordinate_dampers import JointSpring, coordinate_damping, coordinate_stiffness

SHOULDER = "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"
MJCF = """<mujoco><worldbody><site name="a" pos="0.1 0 0"/><body><joint name="ball" type="ball"/>
<geom size="0.1"/><site name="b" pos="0 0.05 -0.2"/></body></worldbody>
<tendon><spatial name="t"><site site="a"/><site site="b"/></spatial></tendon>
<actuator><muscle name="m" tendon="t" lengthrange="0.1 0.5"/></actuator></mujoco>"""
SCAPULA = ("scapula_abduction", "scapula_elevation", "scapula_upward_rot")


def ball(order="yxy"):
    """Make a limb that rotates about three axes of a base, which itself rotates on the ground."""
    still = Transform.identity()
    lean = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.6, 0.8]),
        function=linear(1.0),
        coordinates=("lean",),
    )
    turns = tuple(
        Axis(
            kind="rotation",
            vector=np.eye(3)["xyz".index(letter)],
            function=linear(1.0),
            coordinates=(f"q{i}",),
        )
        for i, letter in enumerate(order)
    )
    names = tuple(axis.coordinates[0] for axis in turns)
    joints = (
        Joint(
            name="stand",
            kind="PinJoint",
            parent=GROUND,
            child="base",
            parent_frame=still,
            child_frame=still,
            axes=(lean,),
            coordinates=("lean",),
        ),
        Joint(
            name="ball",
            kind="CustomJoint",
            parent="base",
            child="limb",
            parent_frame=still,
            child_frame=still,
            axes=turns,
            coordinates=names,
        ),
    )
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.array([0.0, -0.2, 0.0]), inertia=0.01 * np.eye(3))
        for name in ("base", "limb")
    )
    coordinates = tuple(Coordinate(name) for name in ("lean", *names))
    return Model(
        name="ball",
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        gravity=np.array([0.0, -9.8, 0.0]),
    )


def swung(model, size=0.6, frames=60, seed=0):
    rng = np.random.default_rng(seed)
    n = len(model.coordinates)
    time = np.linspace(0.0, 2.0, frames)
    rate = rng.uniform(2, 5, n)
    phase = rng.uniform(0, 6, n)
    angle = np.outer(time, rate) + phase
    center = np.array([0.1, 0.3, 0.9, -0.4])[:n]
    return Motion(
        time=time,
        names=model.coordinate_names,
        values=center + size * np.sin(angle),
        velocities=size * rate * np.cos(angle),
    )


def turning_against(model, motion, base, limb):
    """Return the angular velocity of a limb against its base along the limb's axes.

    It is by differences of rotations.
    """
    tree = compile_tree(model)
    step = 1e-6
    R = [
        forward_kinematics(tree, motion.values + sign * step * motion.velocities).rotations
        for sign in (-1.0, 1.0)
    ]
    a = tree.body_index[base]
    b = tree.body_index[limb]
    before, after = R
    before = np.swapaxes(before[:, a], 1, 2) @ before[:, b]
    after = np.swapaxes(after[:, a], 1, 2) @ after[:, b]
    return Rotation.from_matrix(np.swapaxes(before, 1, 2) @ after).as_rotvec() / (2 * step)


def test_any_model_gets_a_joint_s_damping_and_its_muscles():
    model = ball("xyz")
    viscosity = ViscosityValues(joint=0.06)
    bushing = dampers_of(model, "base", "limb", viscosity)
    assert not bushing.coordinates
    single = dampers_of(model, "base", "limb", viscosity, by_coordinate=True)
    assert not single.bushings
    assert set(single.coordinates) == {"q0", "q1", "q2"}
    assert all(0.03 < value < 0.09 for value in single.coordinates.values())
    assert single.residual > bushing.residual
    hinge = replace(
        model, joints=(model.joints[0], replace(model.joints[1], axes=model.joints[1].axes[:1]))
    )
    damped = dampers_of(hinge, "base", "limb", viscosity)
    assert damped.coordinates == pytest.approx({"q0": 0.06})


def test_dampers_of_mujoco_act_as_they_should(tmp_path):
    made = tmp_path / "arm.xml"
    damped = tmp_path / "out" / "damped.xml"
    damped.parent.mkdir()
    made.write_text(MJCF, encoding="utf-8")
    write_dampers(made, damped, {"ball": 0.07}, {"m": 30.0})
    compiled = mujoco.MjModel.from_xml_path(str(damped))
    data = mujoco.MjData(compiled)
    data.qvel[:] = [0.3, -0.2, 0.5]
    mujoco.mj_forward(compiled, data)
    expected = -0.07 * data.qvel - 30.0 * data.ten_velocity[0] * data.ten_J.reshape(-1, 3)[0]
    assert data.qfrc_passive == pytest.approx(expected)
    with pytest.raises(BadFile, match="takes no dampers"):
        write_dampers(made, damped, {"elbow": 0.07}, {})


def test_damping_takes_the_joint_s_power():
    """The least-squares dampers take the power that the joint's own damping takes.

    The power is over the motion.
    """
    model = ball()
    motion = swung(model)
    d = np.array([0.05, 0.08, 0.02])
    found = coordinate_damping(model, "base", "limb", d, motion)
    omega = turning_against(model, motion, "base", "limb")
    values = np.array([found.values[name] for name in ("q0", "q1", "q2")])
    taken = (values * motion.velocities[:, 1:] ** 2).sum()
    assert taken == pytest.approx((d * omega**2).sum(), rel=1e-6)
    assert 0.0 < found.residual < 1.0


def test_a_hinge_is_expressed_exactly():
    """Where only one coordinate moves, its damper accounts for all.

    The others have what the joint has at that pose.
    """
    model = ball()
    motion = swung(model)
    alone = np.array([0.0, 0.0, 1.0, 0.0])
    motion = replace(motion, values=motion.values * alone, velocities=motion.velocities * alone)
    found = coordinate_damping(model, "base", "limb", 0.07, motion)
    assert found.values["q1"] == pytest.approx(0.07)
    assert found.still == ("q0", "q2")
    assert found.residual < 1e-12
    stiff = coordinate_stiffness(model, "base", "limb", JointSpring(stiffness=2.0, rest={}), motion)
    assert stiff.values["q1"] == pytest.approx(2.0)
    assert stiff.rest["q1"] == pytest.approx(0.0, abs=1e-9)
    assert stiff.residual < 1e-9


def test_the_matrix_is_that_of_the_joint():
    model = ball()
    motion = swung(model, frames=1)
    found = coordinate_damping(model, "base", "limb", 0.05, motion)
    for j in range(3):
        rates = np.zeros((1, 4))
        rates[0, 1 + j] = 1.0
        omega = turning_against(model, replace(motion, velocities=rates), "base", "limb")
        assert found.matrix[j, j] == pytest.approx(0.05 * (omega**2).sum(), rel=1e-6)


def test_a_bushing_says_what_coordinates_cannot():
    """About y, x, y at a small middle angle the first and last axis coincide.

    Dampers of them fail there.
    """
    model = ball()
    motion = swung(model, size=0.4)
    of_coordinates = coordinate_damping(model, "base", "limb", 0.05, motion)
    found = joint_bushing(model, "base", "limb", 0.05, motion)
    assert found.bushings[0].name == "passive_base_limb"
    assert found.residual < 0.15
    assert found.residual < 0.3 * of_coordinates.residual
    made = with_passive_dynamics(model, bushings=found.bushings)
    omega = turning_against(model, motion, "base", "limb")
    power = (passive_generalized_forces(made, motion).values * motion.velocities).sum(axis=1)
    np.testing.assert_allclose(power, -0.05 * (omega**2).sum(axis=1), rtol=0.3)


def test_small_swings_are_expressed_by_a_bushing_exactly():
    model = ball("xyz")
    motion = swung(model, size=1e-3)
    motion = replace(motion, values=motion.values - motion.values.mean(axis=0))
    assert joint_bushing(model, "base", "limb", (0.03, 0.05, 0.08), motion).residual < 2e-3


def test_a_spring_lies_on_the_joint_s_torque():
    model = ball("xyz")
    motion = swung(model, size=1e-3)
    values = motion.values.copy()
    values[:, 1:] -= values[:, 1:].mean(axis=0)
    found = coordinate_stiffness(
        model,
        "base",
        "limb",
        JointSpring(stiffness=3.0, rest={"lean": 0.5}),
        replace(motion, values=values),
    )
    for name in ("q0", "q1", "q2"):
        assert found.values[name] == pytest.approx(3.0, rel=1e-3)
        assert found.rest[name] == pytest.approx(0.0, abs=1e-4)
    assert found.residual < 0.01


def test_what_cannot_be_is_refused():
    model = ball()
    motion = swung(model)
    with pytest.raises(
        BadData, match=r"viscosity of a joint is -1\.0: expected one number or three"
    ):
        coordinate_damping(model, "base", "limb", -1.0, motion)
    with pytest.raises(BadModel, match="no coordinate turns 'base' against 'base'"):
        joint_bushing(model, "base", "base", 0.1, motion)
    with pytest.raises(UnknownName, match="unknown body 'arm'"):
        coordinate_damping(model, "base", "arm", 0.1, motion)
    with pytest.raises(BadData, match=r"damping of 'q0' is -0\.1"):
        with_passive_dynamics(model, damping={"q0": -0.1})
    with pytest.raises(BadData, match="neutral position is specified for 'q1', but no stiffness"):
        with_passive_dynamics(model, rest={"q1": 0.2})
    with pytest.raises(UnknownName, match="unknown muscle 'none'"):
        with_passive_dynamics(model, viscosity={"none": 1.0})


def test_strands_share_evenly():
    shared = line_viscosity(
        {"A": 300.0, "B": 50.0}, {"A": ("a1", "a2", "a3"), "B": ("b",), "C": ("c",)}
    )
    assert shared == {"a1": 100.0, "a2": 100.0, "a3": 100.0, "b": 50.0}
    with pytest.raises(BadData, match="'D' has no lines"):
        line_viscosity({"D": 1.0}, {"A": ("a",)})
    with pytest.raises(BadData, match="'a' belongs to 'B' and to another muscle"):
        line_viscosity({"A": 1.0, "B": 1.0}, {"A": ("a",), "B": ("a",)})


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.osim"
    path.write_text(osim_text())
    return read_osim(path)


def test_it_survives_a_file_twice(arm, tmp_path):
    model = arm
    path = tmp_path / "thick.osim"
    first, second = model.coordinate_names[:2]
    viscosity = {name: 100.0 + i for i, name in enumerate(model.muscle_names)}
    made = with_passive_dynamics(model, {first: 0.05}, {second: 1.5}, {second: 0.3}, viscosity)
    bushing = joint_bushing(
        model, model.body_names[0], model.body_names[1], 0.1, swung(model)
    ).bushings[0]
    made = with_passive_dynamics(made, bushings=(bushing,))
    motion = swung(made)
    for _ in range(2):
        assert write_osim(made, path) == ()
        read = read_osim(path)
        assert not read.warnings
        assert {one.name: one.viscosity for one in read.muscles} == viscosity
        forces = passive_generalized_forces(read, motion)
        np.testing.assert_allclose(
            forces.values, passive_generalized_forces(made, motion).values, atol=1e-12
        )
        made = read
    # Put in again, it replaces what is there.
    again = with_passive_dynamics(read, {first: 0.2}, bushings=(bushing,))
    assert len(again.passive_torques) == 2
    assert len(again.bushings) == 1
    assert {one.name: one.viscosity for one in again.muscles} == viscosity
    write_osim(again, path)
    reread = read_osim(path)
    assert [one.name for one in reread.passive_torques].count(f"passive_{first}") == 1


def test_a_damper_on_another_path_stays_a_force_of_its_own(arm, tmp_path):
    made = with_passive_dynamics(arm, viscosity={arm.muscle_names[0]: 10.0})
    path = tmp_path / "moved.osim"
    write_osim(made, path)
    text = path.read_text()
    start = text.index("<ExpressionBasedPathForce")
    end = text.index("</location>", start)
    path.write_text(text[:end] + " " + text[end:])
    assert read_osim(path).muscles[0].viscosity == 10.0
    moved = text[:start] + re.sub(r"<location>\S+", "<location>0.5", text[start:], count=1)
    assert moved != text
    path.write_text(moved)
    read = read_osim(path)
    assert read.muscles[0].viscosity == 0.0
    assert [one.kind for one in read.kept] == ["ExpressionBasedPathForce"]
    assert any("the force along its path is left out" in line for line in read.warnings)


def test_opensim_computes_the_same_passive_forces(data, tmp_path):
    """Its inverse dynamics with these forces applied, less that without.

    Springs, bushing and dampers along muscles.
    """
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model = read_osim(data(SHOULDER))
    motion = differentiate(
        motion_from_table(read_sto(data("shoulder-thoracoscapular/ik/FLX01.mot")), model), 3.0
    )
    # Muscles with points that move are left out: OpenSim's force on them does not fit their length.
    straight = [
        one.name
        for one in model.muscles
        if len(one.path.wraps) < 2 and "Latissimus" not in one.name
    ]
    made = with_passive_dynamics(
        model,
        damping=coordinate_damping(model, "scapula", "humerus", 0.05, motion).values,
        stiffness={"shoulder_elv": 1.2},
        viscosity=dict.fromkeys(straight, 400.0),
        bushings=joint_bushing(model, "scapula", "humerus", 0.1, motion).bushings,
    )
    write_osim(made, tmp_path / "made.osim")
    read = read_osim(tmp_path / "made.osim")
    added = [*(one.name for one in read.passive_torques), *(one.name for one in read.bushings)]
    added += [f"{name}_viscosity" for name in straight]
    theirs = _OpenSimForces(opensim, tmp_path / "made.osim", model.coordinate_names, added)
    some = motion.frames(np.array([100, 300, 500]))
    c, rates = values_and_rates(compile_tree(read), some)
    rows = [model.coordinate_names.index(name) for name in SCAPULA]
    for frame in range(len(some)):
        turn = _angular_velocities(*c[frame, rows[:2]])
        speeds = rates[frame].copy()
        speeds[rows] = turn @ speeds[rows]
        given = theirs.at(c[frame], speeds)
        # OpenSim's forces of the scapula belong to its angular velocities.
        given[rows] = turn.T @ given[rows]
        np.testing.assert_allclose(
            passive_generalized_forces(read, some).values[frame],
            given,
            atol=1e-9 * max(1.0, np.abs(given).max()),
        )


def _angular_velocities(x, y):
    """Return the matrix (3, 3) from rates of the scapula's angles to its angular velocity."""
    return np.array(
        [
            [1, 0, np.sin(y)],
            [0, np.cos(x), -np.sin(x) * np.cos(y)],
            [0, np.sin(x), np.cos(x) * np.cos(y)],
        ]
    )


class _OpenSimForces:
    """Generalized forces of some forces of an OpenSim model: torques without them less with."""

    def __init__(self, opensim, path, names, added):
        self._opensim = opensim
        self._model = opensim.Model(str(path))
        self._state = self._model.initSystem()
        muscles = self._model.getMuscles()
        for i in range(muscles.getSize()):
            muscles.get(i).setAppliesForce(self._state, False)
        self._forces = [self._model.getForceSet().get(name) for name in added]
        self._coordinates = [self._model.getCoordinateSet().get(name) for name in names]
        for coordinate in self._coordinates:
            coordinate.setLocked(self._state, False)
        self._solver = opensim.InverseDynamicsSolver(self._model)

    def at(self, values, speeds):
        """Return the forces (coordinates,) in a state of that many values and speeds."""
        for j, coordinate in enumerate(self._coordinates):
            coordinate.setValue(self._state, float(values[j]), False)
            coordinate.setSpeedValue(self._state, float(speeds[j]))
        found = []
        for on in (True, False):
            for force in self._forces:
                force.setAppliesForce(self._state, on)
            self._model.realizeDynamics(self._state)
            zero = self._opensim.Vector(len(values), 0.0)
            found.append(self._solver.solve(self._state, zero).to_numpy().copy())
        return found[1] - found[0]


def test_bushings_make_up_for_what_one_cannot_express(data):
    """Over a wide motion one bushing misses an eighth of the torque, whatever its frames."""
    values = ViscosityValues(joint=0.06)
    dampers = dampers_of(read_osim(data(SHOULDER)), "scapula", "humerus", values)
    assert 1 < len(dampers.bushings) <= 3
    assert dampers.residual < 0.05
    assert len({bushing.name for bushing in dampers.bushings}) == len(dampers.bushings)

"""Muscle tensions of models that close loops, and with viscosity of muscles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.core.model.paths import MovingPathPoint
from myomorph.core.model.series import Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.hill import hill_forces
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.muscles.passive import passive_generalized_forces
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.loops import closed_motion, loop_torques
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.actuators import default_reserves

FOLDER = "shoulder-thoracoscapular"
SCAPULA = ("scapula_abduction", "scapula_elevation", "scapula_upward_rot")


@pytest.fixture(scope="module")
def shoulder(data):
    """Return the shoulder, a few frames of an abduction on its loop, and their torques."""
    model = read_osim(data(f"{FOLDER}/model_cmc/TSM_subject_CMC_noWeight.osim"))
    whole = differentiate(motion_from_table(read_sto(data(f"{FOLDER}/ik/ABD01.mot")), model), 3.0)
    kept = np.array([150, 300, 420])
    motion = whole.frames(kept)
    motion, _ = closed_motion(model, motion)
    return model, motion, inverse_dynamics(model, motion)


def test_which_coordinates_follow_does_not_matter(shoulder):
    """Ranges that are kept make a coordinate rather lead: another choice, the same tensions."""
    model, motion, tau = shoulder
    one = solve_tension(model, motion, tau)
    follow = set(loop_torques(model, motion, tau).dependent)
    other_model = replace(
        model, coordinates=tuple(replace(c, clamped=c.name in follow) for c in model.coordinates)
    )
    assert set(loop_torques(other_model, motion, tau).dependent) != follow
    other = solve_tension(other_model, motion, tau)
    assert one.optimal.all()
    assert set(one.coordinates) != set(other.coordinates)
    np.testing.assert_allclose(one.muscle_force, other.muscle_force, atol=1e-5)
    np.testing.assert_allclose(one.actuator_force, other.actuator_force, atol=1e-7)


def test_muscles_balance_the_power_of_any_closed_motion(shoulder):
    """Virtual work along a motion that keeps loops closed.

    Muscles and reserves give the power of the torques.
    """
    model, motion, tau = shoulder
    tension = solve_tension(model, motion, tau)
    rates = np.random.default_rng(0).normal(size=motion.values.shape)
    rates[:, [c.locked for c in model.coordinates]] = 0.0
    moved, _ = closed_motion(
        model, replace(motion, velocities=rates, accelerations=np.zeros_like(rates))
    )
    lengthening = muscle_kinematics(model, moved).muscle_velocity
    places = [
        model.coordinate_names.index(name.removeprefix("reserve_"))
        for name in tension.reserve_names
    ]
    given = -(tension.muscle_force * lengthening).sum(axis=1)
    given += (tension.actuator_force * moved.velocities[:, places]).sum(axis=1)
    np.testing.assert_allclose(
        given, (tau.values * moved.velocities).sum(axis=1), rtol=1e-6, atol=1e-6
    )


def angular_rates(c, speeds, names):
    """OpenSim's speeds of the scapula, angular velocities, for rates of its angles."""
    rows = [names.index(name) for name in SCAPULA]
    x, y = c[rows[:2]]
    turn = np.array(
        [
            [1, 0, np.sin(y)],
            [0, np.cos(x), -np.sin(x) * np.cos(y)],
            [0, np.sin(x), np.cos(x) * np.cos(y)],
        ]
    )
    turned = speeds.copy()
    turned[rows] = turn @ speeds[rows]
    return turned


def _differs_in_opensim(muscle):
    """Whether OpenSim's force of a muscle may not fit its length."""
    moving = any(isinstance(point, MovingPathPoint) for point in muscle.path.points)
    return moving or len(muscle.path.wraps) > 1


def _at_rest(model, motion):
    """Return the motion's poses and accelerations at rest, its loops closed."""
    locked = np.array([one.locked for one in model.coordinates])
    still = replace(
        motion,
        velocities=np.zeros_like(motion.values),
        accelerations=np.where(locked, 0.0, motion.accelerations),
    )
    return closed_motion(model, still)[0]


def _add_reserves(theirs, reserves):
    import opensim

    for one in reserves:
        made = opensim.CoordinateActuator(one.coordinate)
        made.setName(one.name)
        theirs.addForce(made)


def _pull(forces, state, actuators, frame):
    """Let OpenSim's actuators act with the forces (frames,) of a frame."""
    import opensim

    for name, values in actuators:
        one = opensim.ScalarActuator.safeDownCast(forces.get(name))
        one.overrideActuation(state, True)
        one.setOverrideActuation(state, float(values[frame]))


def test_opensim_moves_as_wanted_under_these_tensions(shoulder, data):
    """OpenSim's forward dynamics returns the accelerations we began from.

    Its loop is closed by its own constraint. The arm is at rest, so that its speeds of the scapula
    need no second derivatives; muscles whose forces in OpenSim do not fit their lengths (moving
    points, two surfaces at once) are switched off in both.
    """
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model, motion, _ = shoulder
    off = {one.name for one in model.muscles if _differs_in_opensim(one)}
    model = replace(
        model, muscles=tuple(replace(one, enabled=one.name not in off) for one in model.muscles)
    )
    still = _at_rest(model, motion)
    # OpenSim's reserves act on its speeds, so the scapula gets none.
    reserves = [one for one in default_reserves(model, 20.0, 1.0) if "scapula" not in one.name]
    tension = solve_tension(
        model, still, inverse_dynamics(model, still), TensionOptions(passive=False), reserves
    )
    assert tension.optimal.all()
    theirs = opensim.Model(str(data(f"{FOLDER}/model_cmc/TSM_subject_CMC_noWeight.osim")))
    _add_reserves(theirs, reserves)
    state = theirs.initSystem()
    names = model.coordinate_names
    coordinates = [theirs.getCoordinateSet().get(name) for name in names]
    forces = theirs.getForceSet()
    for coordinate in coordinates:
        coordinate.setSpeedValue(state, 0.0)
    actuators = [*zip(tension.muscles, tension.muscle_force.T, strict=True)]
    actuators += [*zip(tension.reserve_names, tension.actuator_force.T, strict=True)]
    for frame in range(len(still)):
        for coordinate, value in zip(coordinates, still.values[frame], strict=True):
            coordinate.setValue(state, float(value), False)
        _pull(forces, state, actuators, frame)
        for name in off:
            opensim.Muscle.safeDownCast(forces.get(name)).setAppliesForce(state, False)
        theirs.realizeAcceleration(state)
        np.testing.assert_allclose(
            [coordinate.getAccelerationValue(state) for coordinate in coordinates],
            angular_rates(still.values[frame], still.accelerations[frame], names),
            atol=1e-7,
        )


def test_viscosity_takes_part_like_any_other_force(shoulder):
    model, motion, tau = shoulder
    thick = with_passive_dynamics(model, viscosity=dict.fromkeys(model.muscle_names, 50.0))
    moved = muscle_kinematics(thick, motion)
    hill = hill_forces(thick, moved.muscle_length, moved.muscle_velocity)
    np.testing.assert_allclose(hill.viscous, 50.0 * moved.muscle_velocity)
    for passive in (True, False):
        tension = solve_tension(thick, motion, tau, TensionOptions(passive=passive))
        np.testing.assert_allclose(tension.muscle_viscous_force, 50.0 * moved.muscle_velocity)
        # Taking its torque off by hand leaves the same problem.
        less = passive_generalized_forces(thick, motion)
        same = solve_tension(
            model,
            motion,
            replace(tau, values=tau.values - less.values),
            TensionOptions(passive=passive),
        )
        np.testing.assert_allclose(tension.activation, same.activation, atol=1e-7)
        np.testing.assert_allclose(
            tension.muscle_force - tension.muscle_viscous_force, same.muscle_force, atol=1e-4
        )
    without = solve_tension(thick, motion, tau, TensionOptions(viscous=False))
    assert not without.muscle_viscous_force.any()
    np.testing.assert_array_equal(
        without.muscle_force, solve_tension(model, motion, tau).muscle_force
    )


def test_muscles_that_push_are_named(shoulder):
    model, motion, tau = shoulder
    assert solve_tension(model, motion, tau).pushing == ()
    thick = with_passive_dynamics(model, viscosity={"DeltoideusScapula_M": 1e7})
    found = solve_tension(thick, motion, tau)
    shortens = (muscle_kinematics(thick, motion).muscle_velocity < 0).any(axis=0)
    assert shortens[model.muscle_names.index("DeltoideusScapula_M")]
    assert found.pushing == ("DeltoideusScapula_M",)


def test_a_motion_with_its_loop_open_is_refused(shoulder):
    model, motion, _ = shoulder
    values = motion.values.copy()
    values[:, motion.names.index("clav_prot")] += 0.2
    torques = Series(motion.time, model.coordinate_names, np.zeros_like(values))
    with pytest.raises(BadData, match="PointConstraint 'AC' open by up to"):
        solve_tension(model, replace(motion, values=values), torques)

"""Muscle tensions of whole models.

Against OpenSim's own results, and by the balance they must satisfy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.actuators import read_actuators
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.muscles.hill import hill_forces
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import Tension, TensionOptions, passive_notes

ARM = "opensim-reference-small/"
WALK = "rajagopal-walk-emg/"
SPRING = "opensim-gait-subject01/ref_so_10dof18musc/"
AS_OPENSIM = TensionOptions(min_activation="model", curves="opensim")
"""What OpenSim's static optimization takes, with `EFFORT_ALONE`."""


def frames(motion: Motion, keep) -> Motion:
    """Return some frames of a motion."""
    return motion.frames(keep)


def arm(data) -> tuple[Model, Motion, Series]:
    """Return OpenSim's arm of two coordinates and six muscles, its motion and its torques.

    The motion is filtered at 6 Hz.
    """
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    motion = differentiate(
        motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model), 6.0
    )
    return model, motion, inverse_dynamics(model, motion)


def walk(data, count: int = 12) -> tuple[Model, Motion, Series]:
    """Frames of a walk of the Rajagopal model with coupled knees, and its plates' torques."""
    model = read_osim(data(WALK + "subject_walk_scaled.osim"))
    whole = differentiate(motion_from_table(read_sto(data(WALK + "coordinates.sto")), model))
    motion = frames(whole, np.linspace(150, 1150, count).astype(int))
    wrenches = resample_wrenches(read_external_loads(data(WALK + "grf_walk.xml")), motion.time)
    return model, motion, inverse_dynamics(model, motion, wrenches)


@pytest.mark.parametrize(
    "kind",
    [
        "Thelen2003Muscle",
        "Thelen2003Muscle_Deprecated",
        "Millard2012EquilibriumMuscle",
        "Millard2012AccelerationMuscle",
    ],
)
def test_activations_of_the_arm_are_those_opensim_found(data, kind):
    model, motion, torques = arm(data)
    model = replace(model, muscles=tuple(replace(one, kind=kind) for one in model.muscles))
    expected = read_sto(data(ARM + f"std_{kind}_arm26_bounds_StaticOptimization_activation.sto"))
    found = solve_tension(model, motion, torques, AS_OPENSIM, ())
    assert np.all(found.optimal)
    nearest = np.abs(motion.time[:, None] - expected.time[None]).argmin(axis=0)
    # The files for Millard's classes were made by an older OpenSim: 4.6 itself is up to 0.015 away
    # from them.
    most = 0.02 if kind.startswith("Millard") else 0.005
    inside = slice(3, -3)
    for name in model.muscle_names:
        ours = found.activation[nearest, model.muscle_names.index(name)]
        theirs = expected.values[:, expected.names.index(name)]
        rms = np.sqrt(np.mean((ours - theirs)[inside] ** 2))
        assert rms < most, name


def test_activations_of_walking_with_a_spring_are_those_opensim_found(data, tmp_path):
    model = read_osim(data(SPRING + "subject01_adjusted_spring.osim"))
    expected = read_sto(
        data(SPRING + "std_walk_subject01_ankle_spring_StaticOptimization_activation.sto")
    )
    whole = differentiate(
        motion_from_table(read_sto(data(SPRING + "walk_subject01_Kinematics_q.sto")), model)
    )
    motion = frames(whole, np.abs(whole.time[:, None] - expected.time[None]).argmin(axis=0))
    # The plates' file lies in another folder than the loads' file expects.
    loads = read_external_loads(
        data(SPRING + "externalForces.xml"),
        data("opensim-gait-subject01/ref_rra/subject01_walk1_grf.mot"),
    )
    torques = inverse_dynamics(model, motion, resample_wrenches(loads, motion.time))
    actuators = read_actuators(data(SPRING + "gait10dof_Actuators_weak.xml"), model)
    found = solve_tension(model, motion, torques, AS_OPENSIM, actuators, recruitment=EFFORT_ALONE)
    assert np.all(found.optimal)
    assert found.reserve_names == tuple(one.name for one in actuators)
    columns = [expected.names.index(name) for name in model.muscle_names]
    difference = found.activation - expected.values[:, columns]
    assert np.sqrt(np.mean(difference**2)) < 0.01
    without = solve_tension(
        replace(model, passive_torques=()),
        motion,
        torques,
        AS_OPENSIM,
        actuators,
        recruitment=EFFORT_ALONE,
    )
    assert np.sqrt(np.mean((without.activation - found.activation) ** 2)) > 0.1


def _generalized(model: Model, motion: Motion, tension: Tension, forces: np.ndarray) -> np.ndarray:
    """Return torques of muscle forces and reserves on the balanced coordinates.

    They are by another way than the solver's.
    """
    tree = compile_tree(model)
    kinematics = muscle_kinematics(model, motion)
    total = np.einsum("fm,fmj->fj", forces, kinematics.dense())
    columns = [model.coordinate_names.index(name) for name in tension.coordinates]
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    center = model.body("pelvis").mass_center
    pelvis = tree.body_index["pelvis"]
    for r, name in enumerate(tension.reserve_names):
        force = tension.actuator_force[:, r]
        if name.startswith("residual_"):
            axis = "XYZ".index(name[-1]) + (3 if name[-2] == "F" else 0)
            points = poses.rotations[:, pelvis] @ center + poses.origins[:, pelvis]
            total += force[:, None] * poses.jacobian(pelvis, points)[:, axis]
        else:
            coordinate = name.removeprefix("reserve_")
            known = {one.name: one.coordinate for one in model.actuators}
            total[:, model.coordinate_names.index(known.get(name, coordinate))] += force
    return total[:, columns]


def needed(model: Model, motion: Motion, torques: Series, tension: Tension) -> np.ndarray:
    """Return the torques to balance.

    They are those of inverse dynamics, of coupled coordinates transferred by virtual work.

    Parameters
    ----------
    model : with couplers of one independent coordinate
    motion : of the model
    torques : of inverse dynamics [N m or N]
    tension : for its balanced coordinates

    Returns
    -------
    (frames, balanced coordinates) [N m or N]
    """
    total = {name: np.array(torques[name]) for name in torques.names}
    for coupler in model.couplers:
        (source,) = coupler.independents
        total[source] += coupler.function(motion[source], order=1) * total[coupler.dependent]
    return np.column_stack([total[name] for name in tension.coordinates])


@pytest.mark.parametrize("passive", [True, False])
def test_muscles_and_reserves_together_balance_the_torques(data, passive):
    model, motion, torques = walk(data)
    found = solve_tension(model, motion, torques, TensionOptions(passive=passive))
    assert found.summary() == {
        "optimal": 12,
        "infeasible": 0,
        "not converged": 0,
        "missing input": 0,
        "not determined": 0,
    }
    balanced = _generalized(model, motion, found, found.muscle_force)
    np.testing.assert_allclose(balanced, needed(model, motion, torques, found), atol=1e-5)
    np.testing.assert_allclose(balanced, found.balanced_torque, atol=1e-5)
    kinematics = muscle_kinematics(model, motion)
    assert kinematics.muscle_velocity is not None
    curves = hill_forces(model, kinematics.muscle_length, kinematics.muscle_velocity)
    expected = curves.active * found.activation + (curves.passive if passive else 0.0)
    np.testing.assert_allclose(found.muscle_force, expected, atol=1e-6)
    assert found.equilibrium_residual.max() < 1e-5


def test_a_muscle_that_is_switched_off_does_nothing(data):
    model, motion, torques = walk(data, 3)
    off = model.muscle_names.index("soleus_r")
    muscles = tuple(replace(one, enabled=i != off) for i, one in enumerate(model.muscles))
    found = solve_tension(replace(model, muscles=muscles), motion, torques)
    assert np.all(found.optimal)
    np.testing.assert_array_equal(found.muscle_force[:, off], 0.0)
    np.testing.assert_array_equal(found.activation[:, off], 0.0)


def test_frames_without_input_are_marked_and_the_rest_is_untouched(data):
    model, motion, torques = walk(data, 6)
    whole = solve_tension(model, motion, torques)
    values = np.array(motion.values)
    values[2, motion.names.index("ankle_angle_r")] = np.nan
    broken = Motion(
        motion.time,
        motion.names,
        values,
        velocities=motion.velocities,
        accelerations=motion.accelerations,
    )
    tau = np.array(torques.values)
    tau[4, 3] = np.nan
    found = solve_tension(model, broken, replace(torques, values=tau))
    np.testing.assert_array_equal(found.status, [0, 0, 3, 0, 3, 0])
    kept = [0, 1, 3, 5]
    np.testing.assert_allclose(found.activation[kept], whole.activation[kept], atol=1e-9)
    for values in (found.activation, found.muscle_force, found.actuator_force):
        assert np.all(np.isnan(values[[2, 4]]))


def test_muscles_stretched_beyond_their_strength_are_named(data):
    model, motion, torques = walk(data, 3)
    passive = TensionOptions(passive=True)
    assert solve_tension(model, motion, torques, passive).overstretched == ()
    muscles = tuple(
        (
            replace(one, tendon_slack_length=0.5 * one.tendon_slack_length)
            if one.name == "recfem_l"
            else one
        )
        for one in model.muscles
    )
    short = replace(model, muscles=muscles)
    assert solve_tension(short, motion, torques, passive).overstretched == ("recfem_l",)
    assert solve_tension(short, motion, torques, TensionOptions(passive=False)).overstretched == ()


def test_without_reserves_a_weak_model_is_called_infeasible(data):
    model, motion, torques = arm(data)
    part = frames(motion, slice(20, 40))
    tau = inverse_dynamics(model, part)
    weak = tuple(
        replace(one, max_isometric_force=0.02 * one.max_isometric_force) for one in model.muscles
    )
    weak_model = replace(model, muscles=weak)
    found = solve_tension(weak_model, part, tau, actuators=())
    assert found.summary()["infeasible"] > 0
    assert (found.activation >= found.activation_upper - 1e-6).any()
    held = solve_tension(weak_model, part, tau)
    assert np.all(held.optimal)
    assert np.abs(held.actuator_force).max() > 1.0
    assert len(torques) == len(motion)


def test_the_exponent_and_volumes_change_who_works(data):
    model, motion, torques = walk(data, 4)
    square = solve_tension(model, motion, torques)
    cube = solve_tension(model, motion, torques, TensionOptions(exponent=3.0))
    volume = solve_tension(model, motion, torques, TensionOptions(weights="volume"))
    for one in (cube, volume):
        assert np.all(one.optimal)
        np.testing.assert_allclose(
            _generalized(model, motion, one, one.muscle_force),
            needed(model, motion, torques, one),
            atol=1e-4,
        )
    # A higher exponent spares the muscle that works hardest.
    assert np.all(cube.activation.max(axis=1) < square.activation.max(axis=1) + 1e-6)
    sizes = np.array([one.max_isometric_force * one.optimal_fiber_length for one in model.muscles])
    assert np.sum(volume.activation**2 * sizes) < np.sum(square.activation**2 * sizes)


def test_given_actuators_replace_those_of_the_same_name(data):
    model, motion, torques = walk(data, 2)
    own = model.actuators[0]
    strong = replace(own, optimal_force=500.0)
    reserves = (strong, Actuator("extra", "coordinate", 1.0, coordinate="knee_angle_r_beta"))
    found = solve_tension(model, motion, torques, TensionOptions(), reserves)
    assert found.reserve_names.count(own.name) == 1
    assert found.reserve_names[-1] == "extra"


def test_bad_input_is_refused_by_name(data):
    model, motion, torques = arm(data)
    bare = Motion(motion.time, motion.names, motion.values)
    with pytest.raises(BadData, match="velocities"):
        solve_tension(model, bare, torques)
    with pytest.raises(BadData, match="same times"):
        solve_tension(model, frames(motion, slice(0, 5)), torques)
    elbow_only = Series(torques.time, ("r_elbow_flex",), torques.values[:, 1:])
    with pytest.raises(UnknownName, match="r_shoulder_elev"):
        solve_tension(model, motion, elbow_only)
    lost = Actuator("help", "coordinate", 1.0, coordinate="elbow")
    with pytest.raises(UnknownName, match="elbow"):
        solve_tension(model, motion, torques, actuators=(lost,))
    twice = Actuator("help", "coordinate", 1.0, coordinate="r_elbow_flex")
    with pytest.raises(BadModel, match="two actuators are named 'help'"):
        solve_tension(model, motion, torques, actuators=(twice, twice))
    with pytest.raises(BadModel, match="no muscle"):
        solve_tension(replace(model, muscles=()), motion, torques)
    with pytest.raises(BadData, match="exponent"):
        TensionOptions(exponent=1.0)
    with pytest.raises(BadData, match="weights"):
        TensionOptions(weights="mass")  # type: ignore[arg-type]
    with pytest.raises(BadData, match="reserve"):
        TensionOptions(reserve=0.0)


def test_the_largest_share_of_passive_force_is_told_by_muscle(data):
    model, motion, torques = walk(data, 5)
    without = solve_tension(model, motion, torques)
    assert passive_notes(without) == ()
    np.testing.assert_array_equal(without.muscle_passive_share, 0.0)
    found = solve_tension(model, motion, torques, TensionOptions(passive=True))
    kinematics = muscle_kinematics(model, motion)
    curves = hill_forces(model, kinematics.muscle_length, kinematics.muscle_velocity)
    share = curves.passive / np.array([one.max_isometric_force for one in model.muscles])
    np.testing.assert_allclose(found.muscle_passive_share, share.max(axis=0), atol=1e-9)
    np.testing.assert_array_equal(found.muscle_passive_time, motion.time[share.argmax(axis=0)])
    worst = int(share.max(axis=0).argmax())
    assert share.max() > 0.2
    first, second = passive_notes(found)
    assert "on rigid tendons" in first
    assert f"{model.muscle_names[worst]} {100 * share.max():.0f} %" in second
    assert f"in {int((share.max(axis=0) > 0.2).sum())} of {len(model.muscles)} muscles" in second

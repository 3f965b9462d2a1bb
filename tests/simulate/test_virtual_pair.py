"""The simulated fighters obey the laws of mechanics.

Recordings have the stated errors, and forces are recovered.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from myomorph.core.contact.pair import action_reaction, grip_between
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.join import part_of
from myomorph.core.model.series import Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.muscles.hill import hill_forces
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.show.simulate import pair as made
from myomorph.show.simulate.bout import FEET, GRIPS
from myomorph.show.simulate.fighter import (
    GRIP,
    LAPEL,
    PARTS,
    Build,
    compile_pair,
    fighter_text,
    marker_points,
    segments,
)
from myomorph.show.simulate.pair import PairOptions, pair_sites, virtual_pair
from truths.part_tension import tension_of

CUTOFF = 6.0
EXACT = PairOptions(
    "pull", 0, marker_noise=0.0, strength_error=0.0, emg_gain=0.0, emg_noise=0.0, until=1.0
)


@pytest.fixture(scope="module")
def bout():
    return virtual_pair(EXACT, CUTOFF)


@pytest.fixture(scope="module")
def motion(bout):
    return differentiate(bout.truth.motion, CUTOFF)


def test_newton_holds_for_each_and_for_both(bout, motion):
    every = action_reaction(bout.model, motion, PARTS, bout.truth.wrenches)
    weight = 9.80665 * bout.model.mass
    assert np.sqrt(np.mean(every.passed[:, :, 3:] ** 2)) < 2e-3 * weight
    assert np.sqrt(np.mean(every.passed[:, :, :3] ** 2)) < 2e-3 * weight
    feet = part_of(bout.truth.wrenches, "tori")
    assert [body for body in feet.bodies if body.startswith("foot")] == ["foot_r", "foot_l"]
    grips = np.array([bout.truth.wrenches.names.index(name) for name in GRIPS])
    forces = bout.truth.wrenches.forces
    np.testing.assert_array_equal(forces[:, grips], -forces[:, -2:])


def test_muscles_give_the_torques_that_the_motion_needs(bout, motion):
    torques = inverse_dynamics(bout.model, motion, bout.truth.wrenches)
    arms = muscle_kinematics(bout.model, motion).dense()
    given = np.einsum("fm,fmj->fj", bout.truth.tensions.values, arms)
    joints = [k for k, name in enumerate(bout.model.coordinate_names) if "pelvis" not in name]
    miss = (given - torques.values)[:, joints]
    assert np.sqrt(np.mean(miss**2)) < 0.05 * np.sqrt(np.mean(torques.values[:, joints] ** 2))


def test_tensions_are_those_that_the_model_has_at_the_true_activations(bout, motion):
    kinematics = muscle_kinematics(bout.model, motion)
    forces = hill_forces(bout.model, kinematics.muscle_length, kinematics.muscle_velocity)
    expected = forces.active * bout.truth.activations.values + forces.passive
    true = bout.truth.tensions.values
    assert np.sqrt(np.mean((expected - true) ** 2)) < 0.02 * np.sqrt(np.mean(true**2))


def test_soles_press_within_friction_and_the_sleeve_only_pulls(bout):
    feet = bout.truth.forces.values[:, : len(FEET)]
    sleeve = bout.truth.forces["sleeve"]
    across = np.hypot(feet[..., 0], feet[..., 2])
    assert (feet[..., 1] > 0.0).all()
    assert (across < feet[..., 1]).all()
    assert (sleeve[:, 0] > 0.0).all()


def test_the_joined_model_is_the_pair_that_moved(bout):
    compiled = compile_pair({part: bout.builds[part] for part in PARTS})
    assert compiled.nv == len(bout.model.coordinates)
    assert [compiled.actuator(i).name for i in range(compiled.nu)] == list(bout.model.muscle_names)
    tree = compile_tree(bout.model)
    poses = forward_kinematics(tree, tree.coordinates_of(bout.truth.motion))
    forearm = tree.body_index["tori_forearm_r"]
    fist = poses.points(np.array([forearm]), bout.builds["tori"].size * np.array([GRIP]))[:, 0]
    np.testing.assert_allclose(fist, bout.truth.wrenches.points[:, len(FEET)], atol=1e-9)


def test_the_grip_is_found_from_the_motion_alone(bout):
    size = bout.builds
    grip = grip_between(
        bout.model,
        bout.truth.motion,
        "tori_forearm_r",
        "uke_torso",
        near=size["tori"].size * np.array(GRIP) + 0.03,
    )
    assert grip.apart.max() < 0.02
    np.testing.assert_allclose(grip.site.points[0], size["tori"].size * np.array(GRIP), atol=0.05)
    np.testing.assert_allclose(grip.place, size["uke"].size * LAPEL, atol=0.05)


def solved(bout, motion, formulation, emg=None, sites=None):
    sites = bout.sites if sites is None else sites
    activations = Series(
        motion.time, tuple(one.name for one in sites), np.ones((len(motion), len(sites)))
    )
    task = ContactTask(sites, activations, options=ContactOptions(formulation=formulation))
    torques = inverse_dynamics(bout.model, motion)
    return solve_tension(
        bout.model, motion, torques, TensionOptions(passive=True), contacts=task, emg=emg
    )


def force_errors(bout, found):
    """Root mean square error of each foot's and grip's force [N]."""
    errors = {}
    for name in (*FEET, *GRIPS):
        own = [k for k, site in enumerate(found.contacts.sites) if site.group == name]
        miss = found.contacts.contact_force[:, own].sum(axis=1) - bout.truth.forces[name]
        errors[name] = np.sqrt(np.mean(np.sum(miss**2, axis=1)))
    return errors


def test_exact_emg_brings_every_contact_force_back(bout, motion):
    emg = EmgTarget(bout.emg.names, bout.emg.values)
    together = force_errors(bout, solved(bout, motion, "simultaneous", emg))
    first = force_errors(bout, solved(bout, motion, "sequential", emg))
    for name in (*FEET, *GRIPS):
        assert together[name] < 15.0, name
        assert together[name] < 0.5 * first[name], name


def test_forces_between_the_fighters_are_equal_and_opposite(bout, motion):
    found = solved(bout, motion, "simultaneous")
    loads = found.contacts.wrenches("site")
    torques = inverse_dynamics(bout.model, motion, loads)
    left = action_reaction(bout.model, motion, PARTS, loads)
    residuals = [k for k, name in enumerate(found.reserve_names) if name.startswith("residual_")]
    assert np.abs(found.actuator_force[:, residuals]).max() < 1.0
    assert left.force_error < 1.0
    assert torques.names == bout.model.coordinate_names


@pytest.mark.parametrize("part", PARTS)
def test_each_part_of_the_solution_balances_by_itself(bout, motion, part):
    found = solved(bout, motion, "simultaneous")
    own = tension_of(found, part)
    alone = bout.models[part]
    moved = part_of(motion, part)
    assert own.muscles == alone.muscle_names
    torques = inverse_dynamics(alone, moved, part_of(found.contacts.wrenches(), part))
    given = np.einsum("fm,fmj->fj", own.muscle_force, muscle_kinematics(alone, moved).dense())
    for name in alone.coordinate_names[6:]:
        j = alone.coordinate_names.index(name)
        reserve = own.actuator_force[:, own.reserve_names.index(f"reserve_{name}")]
        np.testing.assert_allclose(
            given[:, j] + reserve, torques[name], atol=1e-4 * np.abs(torques.values).max()
        )
    assert set(own.residual_names) == {
        f"residual_{kind}{axis}_pelvis" for kind in "FM" for axis in "XYZ"
    }
    with pytest.raises(UnknownName, match="unknown part 'judge'"):
        tension_of(found, "judge")


def test_noise_is_as_large_as_stated():
    noisy = virtual_pair(
        replace(EXACT, marker_noise=0.0005, strength_error=0.2, emg_noise=0.02, until=0.6), CUTOFF
    )
    tree = compile_tree(noisy.model)
    poses = forward_kinematics(tree, tree.coordinates_of(noisy.truth.motion))
    bodies = np.array([tree.body_index[one.body] for one in noisy.model.markers])
    exact = poses.points(bodies, np.array([one.location for one in noisy.model.markers]))
    assert np.std(noisy.markers.values - exact) == pytest.approx(0.0005, rel=0.05)
    activations = [
        [one.max_isometric_force for part in PARTS for one in models[part].muscles]
        for models in (noisy.models, noisy.truth.models)
    ]
    assert np.std(np.log(np.divide(*activations))) == pytest.approx(0.2, rel=0.2)
    fit = inverse_kinematics(noisy.model, noisy.markers)
    assert np.sqrt(np.mean((fit.motion.values - noisy.truth.motion.values) ** 2)) < np.deg2rad(0.5)


def test_the_same_seed_gives_the_same_bout():
    short = replace(EXACT, until=0.32)
    one = virtual_pair(short)
    other = virtual_pair(short)
    np.testing.assert_array_equal(one.truth.forces.values, other.truth.forces.values)
    np.testing.assert_array_equal(one.markers.values, other.markers.values)


def test_a_fall_is_said(monkeypatch):
    monkeypatch.setattr(made, "FALLEN", 1e-4)
    with pytest.raises(
        BadData, match=r"a fighter of bout 'pull' 0 falls: a joint is .* take another seed"
    ):
        virtual_pair(replace(EXACT, until=0.32))
    with pytest.raises(UnknownName, match="unknown kind of bout 'throw'"):
        virtual_pair(replace(EXACT, kind="throw"))


def test_a_site_on_a_body_that_does_not_exist_is_refused(bout, motion):
    site = Site("sleeve", "tori_hand_l", np.zeros((1, 3)), against="uke_forearm_r")
    with pytest.raises(UnknownName, match="unknown body 'tori_hand_l'"):
        solved(bout, motion, "simultaneous", sites=(site,))
    site = Site("sleeve", "tori_forearm_l", np.zeros((1, 3)), against="uke_sleeve")
    with pytest.raises(UnknownName, match="unknown body 'uke_sleeve'"):
        solved(bout, motion, "simultaneous", sites=(site,))


def test_a_fighter_weighs_what_the_build_says_and_is_the_same_on_both_sides():
    assert sum(one.share for one in segments()) == pytest.approx(1.0)
    compiled = mujoco.MjModel.from_xml_string(fighter_text("tori", Build(70.0, 1.6)))
    assert compiled.body_mass.sum() == pytest.approx(70.0)
    for name, (body, place) in marker_points().items():
        if "_r_" in name:
            other_body, other = marker_points()[name.replace("_r_", "_l_")]
            assert other_body == body[:-1] + "l"
            np.testing.assert_allclose(other, place * (1.0, 1.0, -1.0))


def test_directed_sites_pull_only(bout):
    cones = {site.name: site.cone for site in pair_sites(bout.builds, directed=True)}
    assert cones["sleeve"].frame == "tori_torso"
    assert cones["lapel"].direction is not None
    assert {site.name: site.cone.direction for site in bout.sites}["lapel"] is None

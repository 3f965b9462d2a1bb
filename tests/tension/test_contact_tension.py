"""Contact forces and tensions in one problem.

Newton's law, other solvers on full matrices, and measured wrenches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from readable import Program, frame_program, solve_program
from walking import SOLE, full, soles, task, walk

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.contacts import Cone, SharedWrench, Site
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.loops import closed_motion
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.solve import solve_contacts, solve_tension
from myomorph.core.tension.tension import TensionOptions, contact_notes, missing_support
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.lab.study.trial.joint_force import carried_tension

FRAMES = slice(150, 1150, 90)


@pytest.fixture(scope="module")
def walker(data):
    """Return a walk with hidden plates: model, motion, the plates' data, torques without them."""
    model, motion, loads = walk(data, FRAMES)
    return model, motion, loads, inverse_dynamics(model, motion)


@pytest.fixture(scope="module")
def hidden(walker):
    """Return the walk's tensions and contact forces, found together."""
    model, motion, _, tau = walker
    return solve_tension(model, motion, tau, contacts=task(model, motion))


def test_contacts_are_found_beside_passive_torques_of_hips(walker):
    """These take the place of passive forces, which the contact problem has else."""
    model, motion, _, tau = walker
    options = TensionOptions(joint_tissue="hips")
    found = solve_tension(model, motion, tau, options, contacts=task(model, motion))
    assert found.contacts is not None
    assert found.options.joint_tissue == "hips"
    assert found.optimal.all()


def _residual(tension, letter: str) -> np.ndarray:
    """Residual force ("F") or moment ("M") on the pelvis (frames, 3)."""
    return np.column_stack(
        [
            tension.actuator_force[:, tension.reserve_names.index(f"residual_{letter}{a}")]
            for a in "XYZ"
        ]
    )


def _acceleration_of_the_center(model, motion: Motion) -> np.ndarray:
    """Second difference of the center of mass along q + v t + a t^2 / 2."""
    tree = compile_tree(model)
    step = 1e-3

    def center(t: float) -> np.ndarray:
        values = motion.values + motion.velocities * t + 0.5 * motion.accelerations * t**2
        moved = Motion(motion.time, motion.names, values)
        return center_of_mass(tree, forward_kinematics(tree, tree.coordinates_of(moved)))

    return (center(step) - 2.0 * center(0.0) + center(-step)) / step**2


def test_contacts_and_residuals_carry_the_body_as_newton_asks(walker, hidden):
    model, motion, _, _ = walker
    mass = sum(body.mass for body in model.bodies)
    wanted = mass * (_acceleration_of_the_center(model, motion) - model.gravity)
    given = hidden.contacts.contact_force.sum(axis=1) + _residual(hidden, "F")
    assert hidden.optimal.all()
    np.testing.assert_allclose(given, wanted, atol=0.02)
    # Residuals are dear enough that contacts carry the weight.
    assert np.abs(_residual(hidden, "F")).max() < 0.01 * np.abs(wanted).max()


def test_much_that_comes_from_nowhere_is_named_with_its_size_and_time(walker, hidden):
    weight = 9.80665 * walker[0].mass
    assert not missing_support(hidden, weight)
    reserves = hidden.actuator_force.copy()
    reserves[7, hidden.reserve_names.index("residual_FX")] += 20.0 * weight
    (finding,) = missing_support(replace(hidden, actuator_force=reserves), weight)
    assert f"at {hidden.time[7]:.2f} s" in finding.text
    assert finding.size == pytest.approx(20.0 * weight / np.sqrt(len(hidden)), rel=0.1)


def test_a_frame_held_from_nowhere_shows_no_loads_of_joints(walker, hidden):
    model = walker[0]
    assert carried_tension(hidden, model) == (hidden, ())
    reserves = hidden.actuator_force.copy()
    reserves[7, hidden.reserve_names.index("residual_FY")] += 0.11 * model.weight
    held, (note,) = carried_tension(replace(hidden, actuator_force=reserves), model)
    lost = np.isnan(held.muscle_force).all(axis=1)
    assert np.flatnonzero(lost).tolist() == [7]
    assert note.times == ((hidden.time[7], hidden.time[7]),)
    assert not np.isnan(held.muscle_force[~lost]).any()


@pytest.mark.parametrize("formulation", ["simultaneous", "sequential"])
def test_the_forces_given_back_as_known_loads_bring_the_same_tensions(walker, formulation):
    """Forces, centers of pressure and free torques are complete.

    With them as external loads nothing changes.
    """
    model, motion, _, _ = walker
    sites = [replace(one, cone=Cone(torsion=0.01)) for one in soles()]
    sites[0] = replace(sites[0], points=[[0.0, 0.0, -0.02], [0.02, 0.0, 0.0], [0.0, 0.01, 0.02]])
    found = solve_tension(
        model,
        motion,
        inverse_dynamics(model, motion),
        contacts=task(model, motion, sites, formulation=formulation),
    )
    for by in ("site", "body"):
        again = solve_tension(
            model, motion, inverse_dynamics(model, motion, found.contacts.wrenches(by))
        )
        np.testing.assert_allclose(again.activation, found.activation, atol=1e-6)
        np.testing.assert_allclose(again.actuator_force, found.actuator_force, atol=1e-5)


@pytest.mark.parametrize("contact_passive", [True, False])
def test_contact_forces_do_not_depend_on_passive_force_and_tensions_follow_their_own(
    walker, contact_passive
):
    model, motion, _, tau = walker
    found = {
        passive: solve_tension(
            model,
            motion,
            tau,
            TensionOptions(passive=passive),
            contacts=task(model, motion, contact_passive=contact_passive),
        )
        for passive in (True, False)
    }
    alone = solve_tension(
        model,
        motion,
        tau,
        TensionOptions(passive=contact_passive),
        contacts=task(model, motion, contact_passive=contact_passive),
    )
    assert np.abs(found[True].muscle_force - found[False].muscle_force).max() > 10.0
    for passive, one in found.items():
        assert one.optimal.all()
        assert one.options.passive is passive
        np.testing.assert_allclose(
            one.contacts.contact_force, alone.contacts.contact_force, atol=1e-6
        )
        loaded = inverse_dynamics(model, motion, one.contacts.wrenches("site"))
        again = solve_tension(model, motion, loaded, TensionOptions(passive=passive))
        np.testing.assert_allclose(again.activation, one.activation, atol=1e-6)


def test_passive_force_beyond_a_muscle_s_strength_is_reported_with_its_name(walker):
    model, motion, _, tau = walker
    short = [
        replace(one, tendon_slack_length=0.9 * one.tendon_slack_length) for one in model.muscles
    ]
    changed = tuple(
        one if one.name == "recfem_r" else own
        for own, one in zip(model.muscles, short, strict=True)
    )
    notes = []
    for one in (model, replace(model, muscles=changed)):
        solution = solve_contacts(TensionInputs(one, motion, tau, contacts=task(one, motion)))[1]
        notes.append(contact_notes(solution.tension))
    assert notes[0] == ()
    assert len(notes[1]) == 1
    assert (
        f"above the maximum isometric force in 1 of {len(model.muscles)} muscles (recfem_r"
        in notes[1][0]
    )
    assert "--no-contact-passive" in notes[1][0]


def test_a_contact_costs_the_same_whatever_number_of_sites_it_is_made_of(walker):
    model, motion, _, tau = walker
    sole = [[x, y, z] for _, (body, (x, y, z)) in SOLE.items() if body == "calcn"]
    one = [Site(f"sole_{side}", f"calcn_{side}", sole, group=f"foot_{side}") for side in "rl"]
    twice = [replace(site, name=f"{site.name}_{k}") for site in one for k in (0, 1, 2)]
    forces = []
    for sites in (one, twice):
        ask = ContactTask(tuple(sites), full(motion, sites), options=ContactOptions(smoothness=0.0))
        found = solve_tension(model, motion, tau, contacts=ask).contacts
        forces.append(
            [
                found.contact_force[:, [s.group == f"foot_{k}" for s in sites]].sum(axis=1)
                for k in "rl"
            ]
        )
    np.testing.assert_allclose(forces[0], forces[1], atol=0.05)


def test_forces_of_hands_and_thorax_pass_a_closed_loop(data):
    model = read_osim(data("shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"))
    whole = differentiate(
        motion_from_table(read_sto(data("shoulder-thoracoscapular/ik/ABD01.mot")), model), 3.0
    )
    keep = np.array([150, 300, 420])
    motion = whole.frames(keep)
    motion, _ = closed_motion(model, motion)
    cone = Cone(direction=[0.0, 1.0, 0.0], frame="thorax", friction=np.inf)
    sites = (
        Site(name="hand", body="hand", points=[[0.0, -0.05, 0.0]], cone=cone, against="thorax"),
        Site("blade", "scapula", [[-0.05, -0.05, 0.0]]),
    )
    ask = ContactTask(sites, full(motion, sites), options=ContactOptions(smoothness=0.0))
    found = solve_tension(model, motion, inverse_dynamics(model, motion), contacts=ask)
    assert found.optimal.all()
    assert np.abs(found.contacts.contact_force).max() > 0.1
    again = solve_tension(
        model, motion, inverse_dynamics(model, motion, found.contacts.wrenches("site"))
    )
    np.testing.assert_allclose(again.activation, found.activation, atol=1e-6)


def _clarabel_solution(problem: Program) -> np.ndarray:
    """Solve the program by an interior-point method for cones."""
    clarabel = pytest.importorskip("clarabel")
    n = len(problem.c)
    H = np.diag(problem.H) if problem.H.ndim == 1 else problem.H
    eye = sp.eye(n, format="csr")
    low = np.isfinite(problem.lower)
    high = np.isfinite(problem.upper)
    rows = sp.csc_matrix(sp.vstack([problem.A, problem.G, -eye[low], eye[high]]))
    right = np.concatenate([problem.b, problem.h, -problem.lower[low], problem.upper[high]])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    equal = len(problem.b)
    cones = [clarabel.ZeroConeT(equal), clarabel.NonnegativeConeT(len(right) - equal)]
    return np.array(
        clarabel.DefaultSolver(sp.csc_matrix(np.triu(H)), problem.c, rows, right, cones, settings)
        .solve()
        .x
    )


def _cost(problem: Program, x: np.ndarray) -> float:
    """1/2 x^T H x + c^T x."""
    return float(
        0.5 * x @ (problem.H * x if problem.H.ndim == 1 else problem.H @ x) + problem.c @ x
    )


def all_kinds_of_sites() -> tuple[Site, ...]:
    """Return the soles with a cone of every kind."""
    sites = list(soles())
    sites[2] = replace(sites[2], cone=Cone(most=100.0, torsion=0.01))
    sites[3] = replace(sites[3], cone=Cone(direction=None, most=80.0, grip=0.1))
    sites[4] = replace(sites[4], cone=Cone(friction=np.inf))
    sites[8] = replace(
        sites[8], cone=Cone(direction=[0.0, 1.0, 0.0], frame="calcn_l", friction=0.0)
    )
    return tuple(sites)


def shared(loads, sites) -> SharedWrench:
    """Return the right plate's wrench about the origin.

    Its vertical force is unknown in every third frame.
    """
    right = [k for k, body in enumerate(loads.bodies) if body.endswith("_r")]
    forces = loads.forces[:, right]
    torques = loads.torques[:, right]
    moments = torques + np.cross(np.nan_to_num(loads.points[:, right]), forces)
    forces = forces.sum(axis=1)
    forces[::3, 1] = np.nan
    return SharedWrench(
        name="plate",
        sites=tuple(s.name for s in sites if s.name.endswith("_r")),
        forces=forces,
        moments=moments.sum(axis=1),
    )


@pytest.mark.parametrize("mode", ["soft", "driven", None])
def test_the_fast_solution_is_that_of_the_readable_program_by_two_solvers(walker, mode):
    pytest.importorskip("piqp")
    model, motion, loads, tau = walker
    sites = all_kinds_of_sites()
    emg = None
    if mode:
        told = np.random.default_rng(0).uniform(0.0, 1.0, (len(motion), 3))
        told[::2, 1] = np.nan
        emg = EmgTarget(("soleus_r", "tibant_l", "gaslat_r"), told, mode)
    ask = task(model, motion, sites, [shared(loads, sites)])
    problem = tension_problem(TensionInputs(model, motion, tau, contacts=ask, emg=emg))
    problem.solve(0, len(motion))
    found = problem.result()
    assert found.optimal.all()
    for frame in range(0, len(motion), 3):
        program = frame_program(problem, frame)
        ours = np.concatenate(
            [
                found.activation[frame],
                found.actuator_force[frame] / problem.actuators.optimal_forces,
                problem.amplitudes[frame],
            ]
        )
        for theirs in (solve_program(program), _clarabel_solution(program)):
            assert program.variables[: len(ours)][-1].startswith(sites[-1].name)
            # Amplitudes at sites of little strength hardly count: forces are compared.
            np.testing.assert_allclose(
                theirs[: len(model.muscles)], ours[: len(model.muscles)], atol=2e-4
            )
            push = (
                problem.contacts.amounts[frame]
                * (theirs[: len(ours)] - ours)[-problem.amplitudes.shape[1] :]
            )
            assert np.abs(push).max() < 0.2
            if mode != "driven":
                assert _cost(program, ours) < _cost(program, theirs) + 1e-5
        assert np.abs(program.A[:, : len(ours)] @ ours - program.b).max() < 1e-5


@pytest.mark.parametrize("exponent", [1.5, 3.0, 5.0])
def test_every_exponent_is_solved_with_contacts(walker, exponent):
    model, motion, _, tau = walker
    ask = task(model, motion, soles(Cone(torsion=0.01)), smoothness=1.0)
    found = solve_tension(model, motion, tau, TensionOptions(exponent=exponent), contacts=ask)
    assert found.optimal.all()
    options = TensionOptions(exponent=exponent)
    again = solve_tension(
        model, motion, inverse_dynamics(model, motion, found.contacts.wrenches("site")), options
    )
    assert again.optimal.all()
    # Rounding of the forces is all that differs, but reserves of a high power near 0 hardly resist
    # it.
    np.testing.assert_allclose(again.activation, found.activation, atol=2e-3)


def test_a_wrench_measured_for_one_foot_is_what_its_sites_carry(walker):
    model, motion, loads, tau = walker
    sites = soles(Cone(torsion=0.02))
    sure = replace(shared(loads, sites), force_sd=0.05, moment_sd=0.02)
    found = solve_tension(model, motion, tau, contacts=task(model, motion, sites, [sure]))
    right = [k for k, site in enumerate(sites) if site.group == "foot_r"]
    carried = found.contacts.contact_force[:, right].sum(axis=1)
    # Where the sole is down as a whole, it can carry any wrench that a plate measures.
    down = np.min(found.contacts.contact_activation[:, right], axis=1) > 0.5
    known = np.isfinite(sure.forces) & down[:, None]
    assert known.any()
    assert np.abs((carried - sure.forces)[known]).max() < 1.0
    assert found.optimal.all()


def test_no_site_carries_more_than_its_most(walker):
    model, motion, _, tau = walker
    sites = soles(Cone(most=150.0))
    found = solve_tension(model, motion, tau, contacts=task(model, motion, sites))
    assert found.optimal.all()
    assert found.contacts.contact_force[..., 1].max() == pytest.approx(150.0, abs=1e-3)
    grips = soles(Cone(direction=None, most=40.0))
    held = solve_tension(model, motion, tau, contacts=task(model, motion, grips))
    assert np.abs(held.contacts.contact_force).max() < 40.0 + 1e-3


def test_forces_stay_in_their_cones_and_away_where_nothing_touches(walker, hidden):
    forces = hidden.contacts.contact_force
    activations = hidden.contacts.contact_activation
    assert np.all(forces[activations == 0.0] == 0.0)
    assert forces[..., 1].min() >= 0.0
    assert np.all(np.hypot(forces[..., 0], forces[..., 2]) <= 0.8 * forces[..., 1] + 1e-9)
    inside = hidden.contacts.contact_point[..., 1][activations > 0.9]
    assert np.ptp(inside) < 0.1


def test_a_frame_that_contacts_cannot_carry_is_marked_and_the_rest_goes_on(walker):
    """Without residuals, a body that has no contact in one frame cannot be carried there."""
    model, motion, _, tau = walker
    sites = soles(Cone(direction=None, grip=0.1))
    activations = np.array(full(motion, sites).values)
    activations[4] = 0.0
    names = tuple(site.name for site in sites)
    helpers = [
        one
        for one in tension_problem(TensionInputs(model, motion, tau)).actuators.actuators
        if one.name.startswith("reserve_")
    ]
    for smoothness in (0.0, 1.0):
        ask = ContactTask(
            sites,
            Series(motion.time, names, activations),
            options=ContactOptions(smoothness=smoothness),
        )
        found = solve_tension(model, motion, tau, actuators=helpers, contacts=ask)
        assert found.summary() == {
            "optimal": len(motion) - 1,
            "infeasible": 1,
            "not converged": 0,
            "missing input": 0,
            "not determined": 0,
        }
        assert found.equilibrium_residual[4] > 100.0


def test_missing_coordinates_do_not_spread(walker):
    model, motion, _, _ = walker
    values = np.array(motion.values)
    values[3, 0] = np.nan
    broken = Motion(
        motion.time,
        motion.names,
        values,
        velocities=motion.velocities,
        accelerations=motion.accelerations,
    )
    ask = task(model, motion)
    whole = solve_tension(model, motion, inverse_dynamics(model, motion), contacts=ask)
    found = solve_tension(model, broken, inverse_dynamics(model, broken), contacts=ask)
    kept = np.arange(len(motion)) != 3
    assert np.isnan(found.contacts.contact_force[3]).all()
    np.testing.assert_allclose(
        found.contacts.contact_force[kept], whole.contacts.contact_force[kept], atol=1e-6
    )


def test_contacts_first_solves_the_equations_of_the_floating_body_alone(walker):
    model, motion, _, tau = walker
    ask = task(model, motion, formulation="sequential")
    found = solve_tension(model, motion, tau, contacts=ask)
    together = tension_problem(TensionInputs(model, motion, tau, contacts=task(model, motion)))
    roots = [name for name in together.assembly.coordinates if name.startswith("pelvis")]
    for frame in (1, 5, 9):
        whole = frame_program(together, frame)
        rows = [whole.rows.index(name) for name in roots]
        # Joints as ideal torques that cost nothing: their equations, and muscles with them, drop
        # out.
        muscles = np.arange(len(whole.c)) < len(model.muscles)
        alone = replace(
            whole,
            A=whole.A[rows] * ~muscles,
            b=whole.b[rows],
            lower=np.where(muscles, 0.0, whole.lower),
        )
        z = _clarabel_solution(alone)[-together.amplitudes.shape[1] :]
        forces = together.contacts.forces_of(
            slice(frame, frame + 1), together.coordinates[frame : frame + 1], z[None]
        )[0]
        np.testing.assert_allclose(found.contacts.contact_force[frame], forces[0], atol=0.1)


def _feet_and_hold():
    """Return the soles of two walkers, and a hand of the first that holds one of the second."""
    feet = [
        replace(
            site, name=f"{who}_{site.name}", body=f"{who}_{site.body}", group=f"{who}_{site.group}"
        )
        for who in ("one", "two")
        for site in soles()
    ]
    hold = Site(
        name="hold",
        body="one_hand_r",
        points=[[0.0, -0.08, 0.0]],
        cone=Cone(direction=None, grip=0.05),
        against="two_hand_l",
    )
    return (*feet, hold)


def test_two_bodies_that_hold_each_other_pass_equal_and_opposite_forces(walker):
    """Two walkers in one tree.

    Each obeys Newton's law with the hold's force on it, and the ground's.
    """
    model, motion = walker[:2]
    part = motion.frames(np.arange(4))
    pair = join_models({"one": model, "two": model})
    together = join_motions({"one": part, "two": part})
    ready = np.hstack([task(model, motion).activations.values[:4]] * 2 + [np.ones((4, 1))])
    # One of them must lean on the other: the feet of the second have no hold.
    ready[:, 12:24] = 0.0
    sites = _feet_and_hold()
    names = tuple(site.name for site in sites)
    ask = ContactTask(
        sites, Series(part.time, names, ready), options=ContactOptions(smoothness=0.0)
    )
    found = solve_tension(pair, together, inverse_dynamics(pair, together), contacts=ask)
    assert found.optimal.all()
    wanted = model.mass * (_acceleration_of_the_center(model, part) - model.gravity)
    passed = found.contacts.of("hold")
    for who, on_it in (("one", passed), ("two", -passed)):
        own = [name.startswith(who) for name in names]
        ground = found.contacts.contact_force[:, own].sum(axis=1)
        letters = [found.reserve_names.index(f"residual_F{a}_{who}_pelvis") for a in "XYZ"]
        np.testing.assert_allclose(
            ground + on_it + found.actuator_force[:, letters], wanted, atol=0.02
        )
    # Residuals take what arms cannot hold.
    assert np.all(passed[:, 1] < -200.0)
    assert found.contacts.wrenches("body").bodies.count("two_hand_l") == 1


def test_a_model_that_does_not_float_has_no_contacts_first(data):
    model = read_osim(data("opensim-reference-small/arm26_bounds.osim"))
    motion = differentiate(
        motion_from_table(
            read_sto(data("opensim-reference-small/arm26_InverseKinematics.mot")), model
        ),
        6.0,
    )
    sites = (Site("hand", "r_ulna_radius_hand", [[0.0, -0.3, 0.0]]),)
    ask = ContactTask(sites, full(motion, sites), options=ContactOptions("sequential"))
    with pytest.raises(BadModel, match="no body that floats"):
        solve_tension(model, motion, inverse_dynamics(model, motion), contacts=ask)


def test_contacts_that_do_not_fit_the_motion_are_refused(walker):
    model, motion, loads, tau = walker
    sites = soles()
    ask = task(model, motion)
    late = Series(motion.time + 0.5, ask.activations.names, ask.activations.values)
    with pytest.raises(BadData, match="same times"):
        solve_tension(model, motion, tau, contacts=replace(ask, activations=late))
    strong = Series(motion.time, ask.activations.names, 2.0 * np.ones_like(ask.activations.values))
    with pytest.raises(BadData, match="expected 0 to 1"):
        solve_tension(model, motion, tau, contacts=replace(ask, activations=strong))
    short = shared(loads, sites)
    short = replace(short, forces=short.forces[1:], moments=short.moments[1:])
    with pytest.raises(BadData, match="'plate' has"):
        solve_tension(model, motion, tau, contacts=replace(ask, measured=(short,)))

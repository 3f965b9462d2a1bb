"""What the data leave indeterminate of contact forces.

Bodies on legs whose intervals are known, HiGHS on a walk, and optimality.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from myomorph.core.contact.sites import foot_sites
from myomorph.core.contact.states import contact_activations, find_contacts
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.contacts import Cone, SharedWrench, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.frames import over_frames
from myomorph.core.tension.certificates import (
    CertificateOptions,
    SolvedFrames,
    axis_words,
    contact_intervals,
    group_functions,
    open_bounds,
    solved_frames,
)
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.reaction import joint_reactions
from myomorph.core.tension.separable import Separable, pattern
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from standing import WEIGHT, block, legs, standing_still
from truths.optimality import cost_slope, optimality

EXACT = CertificateOptions(residual=0.0, reserve=0.0)


def solved(model, motion, task, actuators=(), **more):
    """Return the problem of a motion with contacts, solved, and its solution."""
    inputs = TensionInputs(
        model=model,
        motion=motion,
        torques=inverse_dynamics(model, motion),
        actuators=actuators,
        contacts=task,
    )
    problem = tension_problem(replace(inputs, **more))
    over_frames(problem.solve, len(motion), None, problem.window)
    return problem, problem.result()


def intervals(sites, options=EXACT, measured=(), actuators=(), compliance=0.1):
    model = block()
    motion = standing_still(2)
    task = ContactTask(
        sites=sites,
        activations=Series(motion.time, tuple(one.name for one in sites), np.ones((2, len(sites)))),
        measured=measured,
        options=ContactOptions(compliance=compliance),
    )
    problem, tension = solved(model, motion, task, actuators)
    assert tension.optimal.all()
    return contact_intervals(problem, tension, [1], options)


def test_two_legs_without_friction_are_determined():
    """Levers: the legs stand 0.1 m and 0.3 m beside the mass center."""
    found = intervals(legs([(-0.1, 0.0), (0.3, 0.0)], friction=0.0))
    for group, share in (("leg0", 0.75), ("leg1", 0.25)):
        number = found.groups.index(group)
        force = found.forces[:, number]
        low = found.low[:, number]
        high = found.high[:, number]
        np.testing.assert_allclose(force[0], [0.0, share * WEIGHT, 0.0], atol=1e-6)
        np.testing.assert_allclose(low, force, atol=1e-6)
        np.testing.assert_allclose(high, force, atol=1e-6)
    assert found.sentences == ("contact forces are determined",)


def test_friction_lets_two_legs_press_against_each_other():
    """Along the line between them as far as cones allow; across it they rotate the body."""
    found = intervals(legs([(-0.2, 0.0), (0.2, 0.0)], friction=0.5, edges=4))
    for group in found.groups:
        number = found.groups.index(group)
        low = found.low[:, number]
        high = found.high[:, number]
        np.testing.assert_allclose(low[0], [-0.25 * WEIGHT, 0.5 * WEIGHT, 0.0], atol=1e-5)
        np.testing.assert_allclose(high[0], [0.25 * WEIGHT, 0.5 * WEIGHT, 0.0], atol=1e-5)
    assert found.sentences[0].startswith("shifting force between 'leg0' and 'leg1' along x")


def test_a_table_on_four_legs_rocks():
    """Legs at the corners of a square: F = W / 4 +- t, t up to W / 4.

    At a share s more cost t is up to W / 4 sqrt(s).
    """
    found = intervals(legs([(-0.2, -0.3), (0.2, -0.3), (0.2, 0.3), (-0.2, 0.3)], friction=0.0))
    np.testing.assert_allclose(found.forces[0, :, 1], 0.25 * WEIGHT, rtol=1e-7)
    np.testing.assert_allclose(found.low[0, :, 1], 0.0, atol=1e-6)
    np.testing.assert_allclose(found.high[0, :, 1], 0.5 * WEIGHT, rtol=1e-7)
    np.testing.assert_allclose(found.normal_high[0], 0.5 * WEIGHT, rtol=1e-7)
    reach = 0.25 * WEIGHT * np.sqrt(0.05)
    np.testing.assert_allclose(found.near_high[0, :, 1] - found.forces[0, :, 1], reach, rtol=0.02)
    np.testing.assert_allclose(found.forces[0, :, 1] - found.near_low[0, :, 1], reach, rtol=0.02)
    np.testing.assert_allclose(np.abs(found.direction[0, :, 1]), 0.5, atol=1e-6)
    assert found.direction[0, 0, 1] * found.direction[0, 1, 1] < 0.0
    np.testing.assert_allclose(found.spread[0], 2.0 * reach, rtol=1e-4)
    assert "vertically" in found.sentences[0]


def test_patches_let_weight_wander_as_far_as_their_edges_reach():
    """Two feet 2a apart of half width h.

    One carries up to (a + h) / 2a of the weight, as its pressure goes inwards.
    """
    a = 0.2
    h = 0.05
    feet = tuple(
        Site(
            name=name,
            body="block",
            points=np.array([[x - h, 0.0, 0.0], [x + h, 0.0, 0.0]]),
            cone=Cone(friction=0.0),
        )
        for name, x in (("left", -a), ("right", a))
    )
    found = intervals(feet)
    np.testing.assert_allclose(found.high[0, :, 1], WEIGHT * (a + h) / (2.0 * a), rtol=1e-7)
    np.testing.assert_allclose(found.low[0, :, 1], WEIGHT * (a - h) / (2.0 * a), rtol=1e-7)


def test_what_is_measured_and_what_is_bounded_narrows_the_interval():
    corners = [(-0.2, -0.3), (0.2, -0.3), (0.2, 0.3), (-0.2, 0.3)]
    narrow = legs(corners, friction=0.0, most=0.4 * WEIGHT)
    bounded = intervals(narrow)
    np.testing.assert_allclose(bounded.high[0, :, 1], 0.4 * WEIGHT, rtol=1e-6)
    np.testing.assert_allclose(bounded.low[0, :, 1], 0.1 * WEIGHT, rtol=1e-6)
    told = np.full((2, 3), np.nan)
    told[:, 1] = 0.3 * WEIGHT
    plate = SharedWrench(
        name="plate", sites=("leg0",), forces=told, moments=np.full((2, 3), np.nan), force_sd=4.0
    )
    found = intervals(legs(corners, friction=0.0), measured=(plate,))
    missed = abs(found.forces[0, 0, 1] - 0.3 * WEIGHT)
    reach = max(8.0, missed)
    np.testing.assert_allclose(found.high[0, 0, 1], 0.3 * WEIGHT + reach, rtol=1e-6)
    np.testing.assert_allclose(found.low[0, 0, 1], 0.3 * WEIGHT - reach, rtol=1e-6)
    np.testing.assert_allclose(found.high[0, 1, 1], 0.2 * WEIGHT + reach, rtol=1e-6)


def test_what_residuals_may_give_widens_the_interval():
    """1 % of the weight in force, and as much times 1 m in moment.

    Lever arms of 0.2 m make 2.5 % of it at each leg.
    """
    sites = legs([(-0.2, 0.0), (0.2, 0.0)], friction=0.0)
    found = intervals(sites, CertificateOptions(residual=0.01), actuators=None)
    widest = 0.5 * 0.01 + 0.01 / 0.4
    np.testing.assert_allclose((found.high - found.forces)[0, :, 1], widest * WEIGHT, rtol=0.02)
    alone = intervals(sites, CertificateOptions(residual=0.0), actuators=None)
    assert (alone.high - alone.low)[0, :, 1].max() < 0.01 * WEIGHT


def test_a_site_that_does_not_touch_carries_nothing():
    model = block()
    motion = standing_still(1)
    sites = legs([(-0.2, 0.0), (0.2, 0.0), (0.0, 0.1)], friction=0.0)
    task = ContactTask(
        sites, Series(motion.time, ("leg0", "leg1", "leg2"), np.array([[1.0, 1.0, 0.0]]))
    )
    found = contact_intervals(*solved(model, motion, task), options=EXACT)
    np.testing.assert_array_equal(found.low[0, 2], 0.0)
    np.testing.assert_array_equal(found.high[0, 2], 0.0)


@pytest.fixture(scope="module")
def walk(data) -> tuple[Model, Motion, ContactTask]:
    """Frames of a walk whose plates are hidden, contacts from kinematics."""
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    whole = differentiate(
        motion_from_table(read_sto(data("rajagopal-walk-emg/coordinates.sto")), model), 6.0
    )
    keep = np.arange(200, 1000, 40)
    motion = whole.frames(keep)
    sites = foot_sites(model)
    ready = contact_activations(model, motion, sites, find_contacts(model, motion, sites))
    return model, motion, ContactTask(sites, ready)


def test_intervals_of_a_walk_are_those_of_highs(walk):
    model, motion, task = walk
    problem, tension = solved(model, motion, task, None)
    assert tension.optimal.all()
    options = CertificateOptions()
    found = contact_intervals(problem, tension, None, options)
    assert (found.low <= found.forces + 1e-6).all()
    assert (found.high >= found.forces - 1e-6).all()
    assert (found.near_low <= found.forces + 1e-6).all()
    assert (found.near_high >= found.forces - 1e-6).all()
    # Near the optimum less is open than at all, and nothing else.
    assert (found.near_low >= found.low - 1e-3).all()
    assert (found.near_high <= found.high + 1e-3).all()
    assert (found.near_high - found.near_low).sum() < 0.5 * (found.high - found.low).sum()
    frames = np.arange(0, len(motion), 7)
    dense = solved_frames(problem, tension, frames)
    bounds = np.stack(open_bounds(problem, dense, options), axis=2)
    functions = group_functions(problem, dense, _members(problem, found.groups))
    # Of the three components, then of the normal force
    low = np.concatenate([found.low, found.normal_low[..., None]], axis=2)[frames]
    high = np.concatenate([found.high, found.normal_high[..., None]], axis=2)[frames]
    for k, g, i in np.ndindex(functions.shape[:3]):
        least, most = _extremes(functions[k, g, i], dense.A[k], dense.x[k], bounds[k])
        assert low[k, g, i] == pytest.approx(least, abs=2e-3)
        assert high[k, g, i] == pytest.approx(most, abs=2e-3)


def _members(problem, groups):
    """Return for each group which amplitudes are its own."""
    columns = problem.contacts.generators
    return [np.array([columns.sites[k].group == name for k in columns.site]) for name in groups]


def _extremes(cost, A, x, bounds):
    """Return the least and greatest cost . y with A y = A x within bounds (n, 2), by HiGHS."""
    both = [
        linprog(sign * cost, A_eq=A, b_eq=A @ x, bounds=bounds, method="highs").fun
        for sign in (1.0, -1.0)
    ]
    return both[0], -both[1]


def test_known_activations_narrow_what_is_left_open(walk):
    """EMG of all muscles as an equality leaves less open than physics alone.

    The solution stays inside.
    """
    model, motion, task = walk
    problem, tension = solved(model, motion, task, None)
    free = contact_intervals(problem, tension, None, CertificateOptions(near=0.0))
    told = EmgTarget(model.muscle_names, tension.activation, "driven", slack=0.01)
    problem, tension = solved(model, motion, task, None, emg=told)
    bound = contact_intervals(problem, tension, None, CertificateOptions(near=0.0))
    assert set(free.sentences) == {""}, "what was not asked for is not said to be determined"
    several = (free.high - free.low)[..., 1].min(axis=1) > 50.0
    assert several.any()
    assert (bound.high - bound.low)[several].sum() < 0.5 * (free.high - free.low)[several].sum()
    assert (bound.low <= bound.forces + 1e-6).all()
    assert (bound.high >= bound.forces - 1e-6).all()


def test_solved_frames_are_optima_and_others_are_not(walk):
    model, motion, task = walk
    free = replace(task, options=replace(task.options, smoothness=0.0))
    problem, tension = solved(model, motion, free, None)
    found = optimality(problem, tension)
    assert found.stationarity.max() < 1e-7
    assert found.balance.max() < 1e-8
    assert found.bounds.max() == 0.0
    assert found.complementarity.max() < 1e-9
    moved = np.array(tension.actuator_force)
    moved[:, 0] += 5.0
    spoiled = optimality(problem, replace(tension, actuator_force=moved))
    assert spoiled.stationarity.min() > 1e-3
    assert spoiled.balance.min() > 1e-3


def test_smoothness_takes_part_in_optimality(walk, data):
    """Frames 10 ms apart, of which the cost of each change has its part."""
    model, _, _ = walk
    whole = differentiate(
        motion_from_table(read_sto(data("rajagopal-walk-emg/coordinates.sto")), model), 6.0
    )
    keep = np.arange(400, 500, 10)
    motion = whole.frames(keep)
    sites = foot_sites(model)
    task = ContactTask(
        sites, contact_activations(model, motion, sites, find_contacts(model, motion, sites))
    )
    problem, tension = solved(model, motion, task, None)
    assert optimality(problem, tension).stationarity.max() < 1e-3
    rough, _ = solved(
        model, motion, replace(task, options=replace(task.options, smoothness=0.0)), None
    )
    # The smooth solution is none of the problem without smoothness.
    assert optimality(rough, tension_of(rough, problem, tension)).stationarity.max() > 1e-3


def tension_of(rough, problem, tension):
    """Return a solution as if the other problem had found it."""
    rough.amplitudes[:] = problem.amplitudes
    return tension


def test_reactions_take_contact_forces_along(walk):
    """Contact forces as loads, or together with the tensions, give the same reactions.

    What holds the pelvis in space is what residuals gave.
    """
    model, motion, task = walk
    _, tension = solved(model, motion, task, None)
    one = joint_reactions(model, motion, tension, frame="ground")
    other = joint_reactions(
        model,
        motion,
        replace(tension, contacts=None),
        tension.contacts.wrenches("body"),
        frame="ground",
    )
    np.testing.assert_allclose(one.forces, other.forces, atol=1e-8)
    np.testing.assert_allclose(one.moments, other.moments, atol=1e-8)
    assert np.abs(one.of("ground_pelvis")).max() < 1e-5
    without = joint_reactions(model, motion, replace(tension, contacts=None), frame="ground")
    assert np.linalg.norm(without.of("ground_pelvis"), axis=1).min() > 300.0


def test_what_cannot_be_asked_is_named(walk):
    model, motion, task = walk
    problem, tension = solved(model, motion, task, None)
    with pytest.raises(BadData, match="frame 99 is requested"):
        contact_intervals(problem, tension, [99])
    assert np.isnan(
        contact_intervals(problem, tension, [0], CertificateOptions(near=0.0)).near_low
    ).all()
    bare = tension_problem(TensionInputs(model, motion, inverse_dynamics(model, motion)))
    over_frames(bare.solve, len(motion))
    with pytest.raises(BadData, match="there are no contacts"):
        contact_intervals(bare, bare.result())


@pytest.mark.parametrize("gravity", [9.80665, 1.0, 0.01])
def test_the_axis_of_a_direction_does_not_depend_on_the_strength_of_gravity(gravity):
    up = np.array([0.0, gravity, 0.0])
    assert axis_words(np.array([0.0, 0.8, 0.6]), up) == "vertically"
    assert axis_words(np.array([0.8, 0.6, 0.0]), up) == "along x"
    assert axis_words(np.array([0.0, -0.6, -0.8]), up) == "along z"
    assert axis_words(np.array([0.6, 0.8, 0.0]), np.zeros(3)) == "along y"


def test_slope_and_curvature_of_the_cost_are_its_differences():
    """Below, inside and above the intervals that penalties pull into, stiff and none."""
    x = np.tile(np.linspace(0.1, 0.9, 9), (2, 1))
    h = 1e-5
    none = np.zeros((2, 0))
    shape = pattern(np.zeros(9, np.int64), np.arange(9), (1, 9))
    shared = Separable(
        start=shape.start,
        row=shape.row,
        first=shape.first,
        weight=np.linspace(1.0, 2.0, 9),
        exponent=np.full(9, 3.0),
        lower=np.zeros(9),
        upper=np.ones(9),
    )
    penalties = np.stack([np.full((3, 9), level) for level in (0.35, 0.65)])
    penalties[:, 1] += 0.1
    penalties[:, 2] = [[5.0], [0.0]]
    frames = SolvedFrames(
        frames=np.arange(2),
        A=np.zeros((2, 1, 9)),
        b=none,
        x=x,
        shared=shared,
        penalties=penalties,
        values=none,
        muscles=9,
        controls=0,
        amplitudes=0,
    )
    ahead = frames.cost(x[:, None] + h * np.eye(9))
    behind = frames.cost(x[:, None] + (-h) * np.eye(9))
    np.testing.assert_allclose(cost_slope(frames, x), (ahead - behind) / (2.0 * h), rtol=1e-6)
    ahead = cost_slope(frames, x + h)
    behind = cost_slope(frames, x + (-h))
    np.testing.assert_allclose(frames.curvature(x), (ahead - behind) / (2.0 * h), rtol=1e-6)

"""Joint load and co-contraction as terms.

Compared with joint reactions, sums of moments, and what effort alone gives.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.tension.recruitment import CRITERIA
from benchmarks.accuracy.tension.recruitment import ours as recruited
from walking import walk

from myomorph.body.tension.task import tension_task
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.dynamics import inverse_dynamics, values_and_rates
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.contact_setting import Measurements
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.reaction import joint_reactions
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    RecruitmentOptions,
    joint_load_term,
    recruitment_terms,
)
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.core.tension.terms.co_contraction import CoContractionTerm
from truths.recruitment_programs import solve_program
from truths.recruitment_programs import walk as some_walk

KEEP = slice(150, 1150, 180)


def knee_load(found, model, motion, wrenches):
    reactions = joint_reactions(model, motion, found, wrenches, joints=["walker_knee_r"])
    return np.linalg.norm(reactions.of("walker_knee_r"), axis=1)


def test_rows_of_joint_loads_are_joint_reactions(data):
    """What the rows leave is the force of each joint, as the reactions of the same tensions say."""
    model, motion, wrenches = walk(data, KEEP)
    tau = inverse_dynamics(model, motion, wrenches)
    term = joint_load_term(model, motion, wrenches, 2.0, ("walker_knee_r", "hip_l", "ankle_r"))
    problem = tension_problem(TensionInputs(model, motion, tau, terms=[term]))
    problem.solve(0, len(motion))
    found = problem.result()
    weight = sum(body.mass for body in model.bodies) * np.linalg.norm(model.gravity)
    left = -weight * problem.x[:, -9:].reshape(len(motion), 3, 3)
    expected = joint_reactions(
        model, motion, found, wrenches, joints=term.joints, frame="ground"
    ).forces
    np.testing.assert_allclose(left, expected, atol=1e-3 * weight * 1e-2)
    assert found.optimal.all()


def test_joint_load_falls_with_its_weight_and_effort_rises(data):
    model, motion, wrenches = walk(data, KEEP)
    tau = inverse_dynamics(model, motion, wrenches)
    alone = solve_tension(model, motion, tau, recruitment=EFFORT_ALONE)
    loads = [knee_load(alone, model, motion, wrenches).mean()]
    efforts = [(alone.activation**2).sum()]
    for weight in (1e-7, 0.1, 10.0):
        term = joint_load_term(model, motion, wrenches, weight, ("walker_knee_r",))
        found = solve_tension(model, motion, tau, recruitment=EFFORT_ALONE, terms=[term])
        loads.append(knee_load(found, model, motion, wrenches).mean())
        efforts.append((found.activation**2).sum())
    assert loads[1] == pytest.approx(loads[0], rel=1e-4)
    assert loads[0] > loads[2] * 1.005 > loads[3] * 1.01
    assert efforts[0] < efforts[2] < efforts[3]


def test_co_contraction_is_at_least_what_is_asked_for(data):
    """The weaker side of the ankle, from moment arms and forces alone."""
    model, motion, wrenches = walk(data, KEEP)
    tau = inverse_dynamics(model, motion, wrenches)
    own = _arms_of(model, motion, "ankle_angle_r")
    alone = solve_tension(model, motion, tau, recruitment=EFFORT_ALONE)
    before = _weaker_side(own * alone.muscle_force)
    for level in (0.05, 0.2):
        term = CoContractionTerm(
            model=model, motion=motion, torques=tau, level=level, coordinates=("ankle_angle_r",)
        )
        found = solve_tension(model, motion, tau, recruitment=EFFORT_ALONE, terms=[term])
        assert found.optimal.all()
        weaker = _weaker_side(own * found.muscle_force)
        can = _weaker_side(own * (found.muscle_force / np.maximum(found.activation, 1e-9)))
        use = found.activation.min(axis=1) > 1e-8
        assert (weaker >= before - 1e-3).all()
        if use.any():
            assert (weaker[use] / can[use] > 0.9 * level).all()
    assert weaker.mean() > 2.0 * before.mean() + 1.0


def _arms_of(model, motion, coordinate):
    """Return moment arms (frames, muscles) of a coordinate alone [m]."""
    paths = compile_paths(model)
    values = paths.evaluate(*values_and_rates(compile_tree(model), motion))[2]
    use = np.flatnonzero(paths.arm_coordinate == model.coordinate_names.index(coordinate))
    own = np.zeros((len(motion), len(model.muscles)))
    own[:, paths.arm_muscle[use]] = values[:, use]
    return own


def _weaker_side(torques):
    """Return the smaller of the sums of positive and negative torques (frames, muscles)."""
    return np.minimum(*[np.maximum(sign * torques, 0.0).sum(axis=1) for sign in (1.0, -1.0)])


def test_what_is_asked_wrongly_is_refused(data):
    model, motion, wrenches = walk(data, KEEP)
    tau = inverse_dynamics(model, motion, wrenches)
    with pytest.raises(UnknownName, match="walker_knee_r"):
        joint_load_term(model, motion, wrenches, 1.0, ("walker_kneer",))
    with pytest.raises(UnknownName, match="ankle_angle_r"):
        CoContractionTerm(
            model=model, motion=motion, torques=tau, level=0.1, coordinates=("ankle_angl_r",)
        )
    with pytest.raises(BadData, match="0 to 1"):
        RecruitmentOptions(co_contraction=1.5)
    with pytest.raises(BadData, match="joint_load_joints without joint_load"):
        RecruitmentOptions(joint_load_joints="hip_r")
    told = RecruitmentOptions(joint_load=1.0, joint_load_joints="hip_r, hip_l", co_contraction=0.1)
    load, both = recruitment_terms(model, motion, tau, wrenches, told)
    assert load.joints == ("hip_r", "hip_l")
    assert {"knee_angle_r", "ankle_angle_l"} <= set(both.coordinates)


@pytest.mark.parametrize(
    "name", ["co-contraction 0.1", "co-contraction 0.1, exponent 3", "weights by volume"]
)
def test_frames_of_a_walk_are_recruited_as_conic_programs_say(data, name):
    """Clarabel on full matrices of moment arms.

    The knees of this model lead a patella, whose share counts once.
    """
    data("rajagopal-walk-emg/grf_walk.xml")
    one = some_walk(data("rajagopal-walk-emg/subject_walk_scaled.osim").parents[1])
    found = recruited(one, CRITERIA[name], one.torques)
    assert found.optimal.all()
    for frame in (0, 4, 8):
        np.testing.assert_allclose(
            found.activation[frame], solve_program(one, frame, CRITERIA[name]), atol=1e-4
        )


def test_with_contacts_joint_loads_are_a_cost_of_the_tensions_under_their_forces(data):
    model, motion, wrenches = walk(data, slice(400, 900, 50))
    tau = inverse_dynamics(model, motion)
    setup = (
        model,
        motion,
        tau,
        TensionOptions(),
        default_reserves(model),
        Measurements(motion, wrenches),
    )
    plan = ContactPlan(measured="hidden")
    options = RecruitmentOptions(joint_load=1.0, joint_load_joints="walker_knee_r")
    plain = tension_task(*setup, plan).solved(lambda done: None)[0]
    task = tension_task(*setup, plan, recruitment=options)
    found, solution = task.solved(lambda done: None)
    assert solution is not None
    assert found.optimal.all()
    np.testing.assert_allclose(
        found.contacts.contact_force, plain.contacts.contact_force, atol=1e-9
    )
    loads, carried = task.loads(found)
    term = joint_load_term(model, motion, loads, 1.0, ("walker_knee_r",))
    alone = solve_tension(model, motion, carried, recruitment=EFFORT_ALONE, terms=[term])
    np.testing.assert_allclose(found.activation, alone.activation, atol=1e-6)
    assert (
        knee_load(found, model, motion, None).mean()
        < 0.98 * knee_load(plain, model, motion, None).mean()
    )

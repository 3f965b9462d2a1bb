"""Tensions on elastic tendons: conditions of the optimum, and limits.

Also what happens to bad frames and muscles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from walking import task, walk

import myomorph.core.tension.elastic.problem as elastic
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.fiber_jets import FLOOR, SLACKENED, TONE
from myomorph.core.muscles.hill import compile_hill, muscle_model
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.problem import TensionInputs
from myomorph.core.tension.reaction import joint_reactions
from myomorph.core.tension.recruitment import EFFORT_ALONE, joint_load_term
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.co_contraction import CoContractionTerm
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.core.tension.terms.term import Rows, Term

ARM = "opensim-reference-small/"
DEGROOTE = "DeGrooteFregly2016Muscle"
CLASSES = (DEGROOTE, "Millard2012EquilibriumMuscle", "Thelen2003Muscle")
ELASTIC = TensionOptions(tendons="elastic")
ACTIVE = replace(ELASTIC, passive=False)
"""Without the passive force of fibers."""


def as_class(model: Model, kind: str, **parameters: float) -> Model:
    """Return the model with all muscles of one class."""
    muscles = tuple(replace(one, kind=kind, parameters=parameters) for one in model.muscles)
    return replace(model, muscles=muscles)


def arm(
    data, kind: str = DEGROOTE, count: int = 40, **parameters: float
) -> tuple[Model, Motion, Series]:
    """Frames of OpenSim's arm of two coordinates and six muscles, and their torques."""
    model = as_class(read_osim(data(ARM + "arm26_bounds.osim")), kind, **parameters)
    whole = differentiate(
        motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model), 6.0
    )
    keep = slice(0, 2 * count, 2)
    motion = whole.frames(keep)
    return model, motion, inverse_dynamics(model, motion)


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize("passive", [False, True])
def test_every_class_is_solved_and_certified(data, kind, passive):
    found = solve_tension(*arm(data, kind), replace(ELASTIC, passive=passive))
    assert found.optimal.all()
    assert found.fibers.certificate.residual < 1e-3
    assert found.fibers.certificate.equilibrium < 1e-5
    assert found.equilibrium_residual.max() < 1e-4
    assert (found.activation > found.activation_lower - 1e-9).all()
    assert (found.activation < found.activation_upper + 1e-9).all()
    assert not found.fibers.rigid


def test_fibers_and_tendons_are_as_long_as_the_paths_and_share_their_power(data):
    model, motion, torques = arm(data)
    found = solve_tension(model, motion, torques, ELASTIC)
    H = compile_hill(model)
    paths = muscle_kinematics(model, motion)
    fibers = found.fibers
    along = np.sqrt(fibers.fiber_length**2 - H.height**2)
    tendon = H.tendon * (1.0 + fibers.tendon_strain)
    assert np.allclose(along + tendon, paths.muscle_length, atol=1e-12)
    whole = -found.muscle_force * paths.muscle_velocity
    assert np.allclose(fibers.fiber_power + fibers.tendon_power, whole, atol=1e-9)
    strength = np.array([one.max_isometric_force for one in model.muscles])
    for m, muscle in enumerate(model.muscles):
        assert np.allclose(
            tendon[:, m],
            H.tendon[m]
            * muscle_model(muscle).stretch(muscle)(found.muscle_force[:, m] / strength[m]),
        )


def test_stiffer_tendons_come_nearer_to_rigid_ones(data):
    far = []
    rigid = None
    for strain in (0.2, 0.01):
        model, motion, torques = arm(data, tendon_strain_at_one_norm_force=strain)
        rigid = solve_tension(model, motion, torques)
        found = solve_tension(model, motion, torques, replace(ACTIVE, activation_dynamics=False))
        far.append(np.sqrt(np.mean((found.activation - rigid.activation)[3:-3] ** 2)))
    assert far[1] < 0.4 * far[0]
    assert far[1] < 0.01


def _activations_of_forces(model, time, paths):
    """Return a function of normalized tendon forces (frames, 6) that gives activations between.

    Between frames lengths and speeds of the paths are those of a cubic.
    """
    H = compile_hill(model)
    L = paths.muscle_length
    V = paths.muscle_velocity
    dt = np.diff(time)[:, None]
    middle = 0.5 * (L[1:] + L[:-1]) + dt / 8.0 * (V[:-1] - V[1:])
    speed = 1.5 * np.diff(L, axis=0) / dt - 0.25 * (V[1:] + V[:-1])
    curves = [muscle_model(muscle).curves(muscle) for muscle in model.muscles]
    stretches = [muscle_model(muscle).stretch(muscle) for muscle in model.muscles]

    def activations(f):
        tendon = H.tendon * np.stack(
            [stretch(f[:, m]) for m, stretch in enumerate(stretches)], axis=1
        )
        along = middle - 0.5 * (tendon[1:] + tendon[:-1])
        fiber = np.sqrt(along**2 + H.height**2)
        v = (speed - np.diff(tendon, axis=0) / dt) * along / fiber / H.speed
        factor = np.stack([curves[m].active(fiber[:, m] / H.fiber[m]) for m in range(6)], axis=1)
        pull = 0.5 * (f[1:] + f[:-1]) * fiber / along - TONE
        pull -= 0.25 * SLACKENED**2 / pull
        return pull / (factor * np.maximum(curves[0].velocity(v), 0.0) + FLOOR)

    return activations


def test_a_general_solver_finds_no_less_effort(data):
    model, motion, torques = arm(data, count=10)
    found = solve_tension(model, motion, torques, replace(ACTIVE, activation_dynamics=False))
    force = compile_hill(model).force
    paths = muscle_kinematics(model, motion)
    arms = paths.moment_arm[:, :, [model.coordinate_names.index(one) for one in found.coordinates]]
    share = np.ones((len(motion), 1))
    share[[0, -1]] = 0.5
    activations = _activations_of_forces(model, motion.time, paths)

    def cost(flat):
        f = flat.reshape(len(motion), 6)
        a = activations(f)
        left = found.balanced_torque - np.einsum("kmj,km->kj", arms, f * force)
        outside = np.maximum(a - 1.0, 0.0) ** 2 + np.maximum(-a, 0.0) ** 2
        return (a**2).sum() + (share * left**2).sum() + 1e4 * outside.sum()

    ours = found.muscle_force / force
    other = minimize(
        cost,
        np.full(ours.size, 0.1),
        method="L-BFGS-B",
        bounds=[(1e-3, 2.0)] * ours.size,
        options={"maxiter": 3000, "maxfun": 400000},
    )
    assert cost(ours.ravel()) < 1.01 * other.fun + 1e-3


def test_activation_changes_no_faster_than_it_can(data):
    model, motion, torques = arm(data, "Thelen2003Muscle")
    jumping = Series(
        torques.time,
        torques.names,
        torques.values + 4.0 * (np.arange(len(motion)) % 8 < 4)[:, None],
    )
    free = solve_tension(model, motion, jumping, replace(ELASTIC, activation_dynamics=False))
    bound = solve_tension(model, motion, jumping, ELASTIC)
    dt = np.diff(motion.time)[:, None]

    def excess(a):
        middle = 0.5 * (a[1:] + a[:-1])
        slowest = -middle * (0.5 + 1.5 * middle) / 0.050
        return np.maximum(dt * slowest - np.diff(a, axis=0), 0.0)[1:-1].max()

    assert excess(free.activation) > 0.1
    assert excess(bound.activation) < 0.02


def test_windows_give_what_the_whole_gives(data, monkeypatch):
    model, motion, torques = arm(data, count=50)
    whole = solve_tension(model, motion, torques, ELASTIC)
    monkeypatch.setattr(elastic, "WINDOW", 12)
    monkeypatch.setattr(elastic, "MARGIN", 0.2)
    parts = solve_tension(model, motion, torques, ELASTIC)
    assert parts.optimal.all()
    assert np.array_equal(parts.fibers.transient, whole.fibers.transient)
    assert np.abs(parts.activation - whole.activation).max() < 0.01
    assert np.sqrt(np.mean((parts.activation - whole.activation) ** 2)) < 1e-3


def test_short_gaps_are_bridged_and_long_ones_left_open(data):
    model, motion, torques = arm(data, count=50)
    values = np.array(torques.values)
    values[10:12] = np.nan
    values[25:40] = np.nan
    found = solve_tension(model, motion, Series(torques.time, torques.names, values), ELASTIC)
    whole = solve_tension(model, motion, torques, ELASTIC)
    assert list(np.flatnonzero(found.fibers.bridged)) == [10, 11]
    assert np.isnan(found.activation[25:40]).all()
    assert np.isfinite(found.activation[:25]).all()
    assert (found.status[10:12] == 3).all()
    assert (found.status[25:40] == 3).all()
    assert found.optimal[:10].all()
    assert found.fibers.transient[40]
    assert found.fibers.transient[24]
    assert not found.fibers.transient[12]
    assert np.abs(found.activation[8:14] - whole.activation[8:14]).max() < 0.05


def test_a_muscle_whose_fibers_cannot_reach_gets_a_rigid_tendon(data):
    model, motion, torques = arm(data)
    long = replace(model.muscles[0], tendon_slack_length=model.muscles[0].tendon_slack_length + 0.2)
    model = replace(model, muscles=(long, *model.muscles[1:]))
    found = solve_tension(model, motion, torques, ELASTIC)
    assert [one.muscle for one in found.fibers.unreachable] == [long.name]
    assert found.fibers.unreachable[0].worst <= 0.0
    assert found.fibers.rigid == (long.name,)
    assert found.optimal.all()
    assert (found.fibers.tendon_strain[:, 0] == 0.0).all()


def test_torques_that_no_activation_gives_go_to_reserves(data):
    model, motion, torques = arm(data)
    much = Series(torques.time, torques.names, torques.values + 500.0)
    found = solve_tension(model, motion, much, ELASTIC)
    assert np.abs(found.actuator_force).max() > 200.0
    assert found.equilibrium_residual.max() < 0.1


def test_without_reserves_frames_that_cannot_balance_are_marked(data):
    model, motion, torques = arm(data)
    much = Series(torques.time, torques.names, torques.values + 500.0)
    found = solve_tension(model, motion, much, ELASTIC, actuators=())
    assert not found.optimal.any()
    assert found.equilibrium_residual.max() > 100.0


def test_another_start_ends_at_the_same_place(data):
    found = solve_tension(*arm(data), replace(ELASTIC, second_start=True))
    assert found.fibers.certificate.second_activations < 0.01
    assert found.fibers.certificate.second_forces < 0.01


def test_emg_draws_activations(data):
    model, motion, torques = arm(data)
    plain = solve_tension(model, motion, torques, ELASTIC)
    wanted = np.full((len(motion), 1), 0.3)
    emg = EmgTarget((model.muscles[0].name,), wanted, weight=50.0)
    drawn = solve_tension(model, motion, torques, ELASTIC, emg=emg)
    before = np.abs(plain.activation[5:-5, 0] - 0.3).mean()
    after = np.abs(drawn.activation[5:-5, 0] - 0.3).mean()
    assert after < 0.3 * before


def test_joint_loads_take_part_by_tendon_forces(data):
    """The remainder of the rows is the force of each joint, and it falls.

    It agrees with the reactions of the same tensions.
    """
    model, motion, torques = arm(data)
    term = joint_load_term(model, motion, None, 1e-3)
    problem = elastic.ElasticProblem(
        TensionInputs(model=model, motion=motion, torques=torques, options=ELASTIC, terms=[term])
    )
    problem.solve(0, len(motion))
    found = problem.result()
    assert found.optimal.all()
    assert found.fibers.certificate.residual < 1e-3
    weight = sum(body.mass for body in model.bodies) * np.linalg.norm(model.gravity)
    left = -weight * problem.x[:, -3 * len(term.joints) :].reshape(len(motion), -1, 3)
    loads = joint_reactions(model, motion, found, None, joints=term.joints, frame="ground").forces
    np.testing.assert_allclose(left, loads, atol=1e-3 * np.abs(loads).max())
    plain = solve_tension(model, motion, torques, ELASTIC)
    before = joint_reactions(model, motion, plain, None, joints=term.joints, frame="ground").forces
    assert np.square(loads).sum() < 0.99 * np.square(before).sum()


def test_co_contraction_takes_part_by_tendon_forces(data):
    model, motion, torques = arm(data)
    term = CoContractionTerm(
        model=model, motion=motion, torques=torques, level=0.05, coordinates=("r_elbow_flex",)
    )
    plain = solve_tension(model, motion, torques, ACTIVE, terms=())
    found = solve_tension(model, motion, torques, ACTIVE, terms=([term]))
    assert found.optimal.all()
    assert found.fibers.certificate.residual < 1e-3
    arms = muscle_kinematics(model, motion).moment_arm[
        :, :, model.coordinate_names.index("r_elbow_flex")
    ]
    strength = np.array([one.max_isometric_force for one in model.muscles])

    def weaker(forces):
        return np.minimum(
            *(np.maximum(sign * arms * forces, 0.0).sum(axis=1) for sign in (1.0, -1.0))
        )

    level = weaker(found.muscle_force) / weaker(np.broadcast_to(strength, found.muscle_force.shape))
    assert level[3:-3].min() > 0.9 * 0.05
    assert weaker(found.muscle_force).mean() > weaker(plain.muscle_force).mean() + 1.0


def test_what_elastic_tendons_do_not_take_is_refused(data):
    model, motion, torques = arm(data, count=5)

    class Pair(Term):
        def rows(self, unknowns):
            return Rows.cost("pair", unknowns.row({model.muscles[0].name: 1.0}), 0.1, 1.0)

    with pytest.raises(BadData, match="'pair' has rows on activations"):
        solve_tension(model, motion, torques, ELASTIC, terms=[Pair()])
    with pytest.raises(BadData, match="constant"):
        solve_tension(model, motion, torques, replace(ELASTIC, curves="constant"))
    with pytest.raises(BadData, match="minmax"):
        solve_tension(model, motion, torques, replace(ELASTIC, recruitment="minmax"))
    with pytest.raises(BadData, match="there are 'rigid', 'elastic'"):
        TensionOptions(tendons="stretchy")


@pytest.mark.parametrize("smoothness", [0.0, 1.0])
def test_contacts_take_part(data, smoothness):
    model, motion, _ = walk(data, slice(300, 324, 2))
    torques = inverse_dynamics(model, motion)
    touching = task(model, motion, smoothness=smoothness)
    rigid = solve_tension(model, motion, torques, contacts=touching, recruitment=EFFORT_ALONE)
    found = solve_tension(model, motion, torques, ELASTIC, contacts=touching)
    assert found.contacts is not None
    assert found.equilibrium_residual.max() < 0.1
    up = (
        found.contacts.contact_force[..., 1].sum(axis=1),
        rigid.contacts.contact_force[..., 1].sum(axis=1),
    )
    assert np.abs(up[0] - up[1]).max() < 0.05 * np.abs(up[1]).max()

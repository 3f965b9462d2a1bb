"""Base parameters: what the tree hides, and recovering what it shows."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from figaroh_base import figaroh_combination

from myomorph.body.identify.base import BaseOptions, fit_base
from myomorph.body.identify.base_parameters import (
    BaseParameters,
    base_parameters,
    base_sizes,
    held_in,
    parameter_sizes,
)
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.motion_noise import coordinate_noise, noise_of, plus
from myomorph.body.identify.null_space import (
    SCALE,
    clusters,
    held_values,
    numerical_null_space,
    random_states,
    tree_null_space,
)
from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.functions import linear, polynomial
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.model import Axis, Coordinate, Coupler
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.regressor import base_regressor, base_wrench
from myomorph.core.rigid.tree import compile_tree
from real_models import MODELS
from trees import floating_tree, functional_tree, random_tree, swinging

FREE = tuple(name for name in MODELS if "10dof18musc" not in name and "reference-small" not in name)
LIMITED = tuple(name for name in MODELS if name not in FREE)
EXACT_MOTION = BaseOptions(motion_sd=0.0)


def annihilation(model, vectors, held):
    """Largest entry of Y v over random states that no one has seen, v of largest entry 1."""
    states = random_states(model, held, 40, seed=77)
    rows = base_regressor(model, states).reshape(-1, len(vectors))
    return np.abs(rows @ (vectors / np.abs(vectors).max(axis=0))).max() / np.abs(rows).max()


def chain(*kinds):
    """Make a floating body with one body per joint after another, each of the named kind."""
    model = floating_tree(5, 1 + len(kinds))
    joints = [model.joints[0]]
    coordinates = list(model.coordinates[:6])
    for i, kind in enumerate(kinds):
        names = tuple(
            f"{kind}{i}_{k}" for k in range({"weld": 0, "hinge": 1, "slide": 1, "ball": 3}[kind])
        )
        motion = "translation" if kind == "slide" else "rotation"
        axes = tuple(
            Axis(kind=motion, vector=np.eye(3)[k], function=linear(1.0), coordinates=(name,))
            for k, name in enumerate(names)
        )
        joints.append(replace(model.joints[1 + i], parent=f"body{i}", axes=axes, coordinates=names))
        coordinates += [Coordinate(name) for name in names]
    return replace(model, joints=tuple(joints), coordinates=tuple(coordinates))


@pytest.mark.parametrize(
    ("kind", "hidden"), [("weld", 10), ("slide", 6), ("hinge", 3), ("ball", 1)]
)
def test_each_joint_hides_what_textbooks_say(kind, hidden):
    assert tree_null_space(chain(kind)).vectors.shape == (20, hidden)
    assert len(base_parameters(chain(kind, "hinge", kind))) == 40 - 2 * hidden - 3


@pytest.mark.parametrize("name", FREE)
def test_tree_and_random_states_agree_where_the_base_is_free(data, name):
    model = read_model(data(name))
    tree = tree_null_space(model)
    numerical = numerical_null_space(model)
    assert tree.vectors.shape == numerical.vectors.shape
    assert annihilation(model, tree.vectors, held_values(model, None)) < 1e-9
    assert annihilation(model, numerical.vectors, held_values(model, None)) < 1e-9


def test_tree_and_random_states_agree_on_couplers_of_the_spine_and_shoulders():
    """MyoFullBody: 49 couplers, six vertebrae in one cluster."""
    pytest.importorskip("musclemimic_models")
    from mujoco_models import load

    model = load("MyoFullBody", None)[1]
    tree = compile_tree(model)
    largest = max(clusters(tree, held_values(model, None)), key=lambda cluster: len(cluster.bodies))
    assert len(largest.bodies) == 6
    assert tree_null_space(model).vectors.shape == numerical_null_space(model).vectors.shape
    assert annihilation(model, tree_null_space(model).vectors, held_values(model, None)) < 1e-9


@pytest.mark.parametrize("name", LIMITED)
def test_a_base_that_moves_less_hides_more(data, name):
    """A planar pelvis, or a shoulder on the ground."""
    model = read_model(data(name))
    base = base_parameters(model)
    tree = tree_null_space(model).vectors
    assert base.rank < 10 * len(model.bodies) - tree.shape[1]
    assert annihilation(model, tree, base.held) < 1e-9
    assert 10 * len(model.bodies) - base.rank == numerical_null_space(model).vectors.shape[1]


@pytest.mark.parametrize("seed", range(3))
def test_couplers_across_joints(seed):
    """Splines and couplers that join branches.

    Bodies that share a coordinate are analyzed together.
    """
    model = functional_tree(seed)
    floating = floating_tree(seed)
    model = replace(
        model,
        joints=(floating.joints[0], *model.joints[1:]),
        coordinates=floating.coordinates[:6] + model.coordinates,
    )
    shared = [c for c in clusters(compile_tree(model), {}) if len(c.bodies) > 1]
    assert shared
    assert tree_null_space(model).vectors.shape == numerical_null_space(model).vectors.shape
    assert annihilation(model, tree_null_space(model).vectors, {}) < 1e-9


def test_a_coupler_can_hide_more_than_its_joints_do():
    """Two parallel hinges that turn against each other carry the last body without turning it."""
    model = chain("hinge", "hinge")
    joints = list(model.joints)
    for i in (1, 2):
        turn = replace(joints[i].axes[0], vector=np.array([0.0, 0.0, 1.0]))
        straight = type(joints[i].parent_frame)(np.eye(3), joints[i].parent_frame.translation)
        joints[i] = replace(joints[i], axes=(turn,), parent_frame=straight)
    model = replace(model, joints=tuple(joints))
    coupled = replace(
        model,
        couplers=(
            Coupler(
                name="tie",
                dependent="hinge1_0",
                function=polynomial([0.2, -1.0]),
                independents=("hinge0_0",),
            ),
        ),
    )
    assert tree_null_space(model).vectors.shape[1] == 6
    tree = tree_null_space(coupled)
    assert tree.vectors.shape[1] == numerical_null_space(coupled).vectors.shape[1] > 6
    assert annihilation(coupled, tree.vectors, {}) < 1e-9


@pytest.mark.parametrize(
    "model", [chain("hinge", "ball", "slide"), random_tree(3), functional_tree(1)]
)
def test_base_parameters_give_the_whole_wrench(model):
    base = base_parameters(model)
    states = random_states(model, base.held, 20, seed=5)
    rows = base_regressor(model, states)
    np.testing.assert_allclose(
        rows[:, :, base.columns] @ base.combination, rows, atol=1e-9 * np.abs(rows).max()
    )
    assert np.linalg.matrix_rank(base.combination) == len(base) == base.rank


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_equals_figaroh(seed, fixed):
    """As many base parameters, of the same span, on a free base and on one that is bolted down."""
    pytest.importorskip("figaroh")
    model = floating_tree(seed, 8)
    base = base_parameters(model, fixed=fixed)
    theirs = figaroh_combination(model, random_states(model, base.held, 120, seed=9))
    assert theirs.shape == base.combination.shape
    # The rows of both span the same space.
    ours = np.linalg.qr(base.combination.T)[0]
    left = theirs.T - ours @ (ours.T @ theirs.T)
    assert np.abs(left).max() < 1e-7 * np.abs(theirs).max()


def test_names_can_be_read(data):
    base = base_parameters(read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim")))
    assert base.names[0] == "pelvis m + femur_r m + femur_l m + torso m + 8 more"
    assert len(set(base.names)) == len(base)
    assert base.describe(0).count("+") == 11
    assert not base.never


def test_a_fixed_base_shows_nothing_of_what_never_moves():
    model = chain("hinge", "hinge")
    base = base_parameters(model, fixed=True)
    assert {"body0 I_xx", "body0 I_zx"} <= set(base.never)
    assert not any("body2" in one for one in base.never)
    # A tare on a bolted base takes the whole weight and its moment; on a free one it takes nothing.
    assert base.tared.shape[1] > 0
    assert base_parameters(model).tared.shape[1] == 0
    states = random_states(model, base.held, 20, seed=1)
    wrench = base_regressor(model, states, np.zeros(3))[:, :, base.columns] @ base.tared
    np.testing.assert_allclose(wrench - wrench.mean(axis=0), 0.0, atol=1e-9 * np.abs(wrench).max())


def test_held_coordinates_rest_where_the_motion_has_them():
    model = chain("hinge", "hinge")
    locked = replace(
        model, coordinates=tuple(replace(c, locked=c.name == "hinge0_0") for c in model.coordinates)
    )
    motion = simulated(locked, 60, hold={"hinge0_0": 0.7})
    assert held_in(locked, [motion]) == {"hinge0_0": pytest.approx(0.7)}
    assert held_in(locked, [simulated(locked, 60)]) == {}
    wrong = base_parameters(locked)
    with pytest.raises(BadData, match="hinge0_0"):
        fit_base(locked, [recorded(locked, motion)], wrong)
    assert len(fit_base(locked, [recorded(locked, motion)]).base) == len(wrong)
    with pytest.raises(UnknownName, match="hinge9"):
        base_parameters(model, held={"hinge9": 0.0})


def test_a_model_that_nothing_shows_is_refused():
    still = replace(chain("hinge"), gravity=np.zeros(3))
    with pytest.raises(BadModel, match="no motion"):
        base_parameters(still, held=dict.fromkeys(still.coordinate_names, 0.0))


def simulated(model, frames, seed=0, hold=None):
    """Simulate a smooth motion of a synthetic model, fast enough to excite everything."""
    motion = swinging(model, frames, 0.01, seed)
    values = np.array(motion.values)
    velocities = np.array(motion.velocities)
    accelerations = np.array(motion.accelerations)
    for name, value in (hold or {}).items():
        j = model.coordinate_names.index(name)
        values[:, j] = value
        velocities[:, j] = 0.0
        accelerations[:, j] = 0.0
    return Motion(
        time=motion.time,
        names=motion.names,
        values=values,
        velocities=velocities,
        accelerations=accelerations,
    )


def recorded(model, motion, truth=None, noise=0.0, seed=0):
    """Simulate the wrench that the truth needs, on the first body, with noise [N, N m]."""
    truth = inertial_parameters(model) if truth is None else truth
    wrench = base_regressor(model, motion, np.zeros(3)) @ truth.ravel()
    wrench = wrench + noise * np.random.default_rng(seed).normal(size=wrench.shape)
    zero = np.zeros((len(motion), 1, 3))
    return Recording(
        motion,
        Wrenches(
            time=motion.time,
            names=("all",),
            bodies=(model.bodies[0].name,),
            forces=wrench[:, None, 3:],
            points=zero,
            torques=wrench[:, None, :3],
        ),
    )


def with_offset(recording, offset):
    """Add a constant (6,) moment and force in ground to a recording [N m; N]."""
    wrenches = recording.wrenches
    return replace(
        recording,
        wrenches=replace(
            wrenches,
            forces=wrenches.forces + offset[3:],
            torques=wrenches.torques + offset[:3],
        ),
    )


def other_body(model, seed=0):
    """Inertial parameters a tenth or so away from the model's."""
    rng = np.random.default_rng(seed)
    return inertial_parameters(model) * rng.uniform(0.8, 1.2, (len(model.bodies), 10))


@pytest.fixture(scope="module")
def arm():
    return floating_tree(4, 8)


def test_truth_is_recovered_without_noise(arm):
    truth = other_body(arm)
    fit = fit_base(
        arm,
        [recorded(arm, simulated(arm, 400), truth), recorded(arm, simulated(arm, 300, 1), truth)],
    )
    np.testing.assert_allclose(fit.estimate, fit.base.of(truth), atol=1e-6 * fit.size.max())
    assert fit.frames == 700
    assert fit.identifiable.all()
    assert fit.rank == len(fit.base)


def test_standard_deviations_tell_the_truth(arm):
    """Errors over standard deviations are standard normal: 95 % within 2, few beyond 4."""
    truth = other_body(arm)
    motion = simulated(arm, 1500)
    scores = []
    for seed in range(6):
        given = recorded(arm, motion, truth, noise=0.5, seed=seed)
        fit = fit_base(arm, [given], options=EXACT_MOTION)
        scores.append((fit.estimate - fit.base.of(truth)) / fit.sd)
    scores = np.concatenate(scores)
    assert np.std(scores) == pytest.approx(1.0, abs=0.15)
    assert np.mean(np.abs(scores) < 2.0) > 0.9
    np.testing.assert_allclose(fit.sigma[3:], 0.5, rtol=0.1)


def test_noise_of_the_motion_is_in_standard_deviations(arm):
    """Noise in the regressor pulls at the estimate, towards less, whether or not it is stated."""
    truth = other_body(arm)
    motion = simulated(arm, 800)
    given = recorded(arm, motion, truth, noise=0.5)
    stated = coordinate_noise(motion, 0.002)
    scores = {"stated": [], "not stated": [], "left out": []}
    for seed in range(6):
        error = noise_of(motion, stated, np.random.default_rng(100 + seed))
        seen = Recording(plus(motion, error), given.wrenches)
        fits = {
            "stated": fit_base(arm, [replace(seen, noise=stated)]),
            "not stated": fit_base(arm, [seen]),
            "left out": fit_base(arm, [seen], options=EXACT_MOTION),
        }
        for name, fit in fits.items():
            scores[name].append((fit.estimate - fit.base.of(truth)) / fit.sd)
    sizes = {name: np.sqrt(np.mean(np.square(each))) for name, each in scores.items()}
    assert 0.6 < sizes["stated"] < 1.3
    assert sizes["not stated"] == pytest.approx(sizes["stated"], rel=1e-6)
    assert sizes["left out"] > 1.5


def test_frames_that_repeat_each_other_count_once(arm):
    """Noise held for ten frames: a tenth of the samples are independent.

    Standard deviations still cover the truth.
    """
    truth = other_body(arm)
    motion = simulated(arm, 3000)
    clean = recorded(arm, motion, truth)
    scores = []
    times = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        held = np.repeat(rng.normal(size=(300, 2, 3)), 10, axis=0)
        given = replace(
            clean.wrenches,
            forces=clean.wrenches.forces + held[:, :1],
            torques=clean.wrenches.torques + held[:, 1:] + np.cross(np.zeros(3), held[:, :1]),
        )
        fit = fit_base(arm, [Recording(motion, given)], options=EXACT_MOTION)
        times.append(fit.frames / fit.samples[3:])
        scores.append((fit.estimate - fit.base.of(truth)) / fit.sd)
    np.testing.assert_allclose(np.mean(times), 10.0, rtol=0.3)
    assert 0.7 < np.std(np.concatenate(scores)) < 1.3


def test_rows_hold_the_information_for_standard_parameters(arm):
    truth = other_body(arm)
    given = recorded(arm, simulated(arm, 500), truth, noise=1.0)
    fit = fit_base(arm, [given], options=BaseOptions(correlated=False))
    A, b = fit.rows()
    # The misfit of two sets of parameters differs by as much as over all frames.
    rows = base_regressor(arm, given.motion)
    measured = base_wrench(arm, given.motion, given.wrenches)

    def misfit(parameters):
        return np.square((rows @ parameters.ravel() - measured) / fit.sigma).sum()

    def compact(parameters):
        return np.square(A @ parameters.ravel() - b).sum()

    one = other_body(arm, 1)
    other = other_body(arm, 2)
    assert compact(one) - compact(other) == pytest.approx(misfit(one) - misfit(other), rel=1e-7)


def test_equals_dense_least_squares(arm):
    """All rows and the prior at once, by LAPACK's singular values."""
    given = recorded(arm, simulated(arm, 200), other_body(arm), noise=1.0)
    options = BaseOptions(moment_noise=1.0, force_noise=2.0, correlated=False, motion_sd=0.0)
    fit = fit_base(arm, [given], options=options)
    sigma = np.repeat([1.0, 2.0], 3)
    rows = base_regressor(arm, given.motion)[:, :, fit.base.columns] / sigma[:, None]
    wrench = base_wrench(arm, given.motion, given.wrenches) / sigma
    mean = fit.base.of(inertial_parameters(arm))
    sd = 100.0 * fit.size
    A = np.vstack([rows.reshape(-1, len(sd)), np.diag(1.0 / sd)])
    expected = np.linalg.lstsq(A, np.concatenate([wrench.ravel(), mean / sd]), rcond=None)[0]
    np.testing.assert_allclose(fit.estimate, expected, atol=1e-9 * fit.size.max())
    np.testing.assert_allclose(fit.sd, np.sqrt(np.diag(np.linalg.inv(A.T @ A))), rtol=1e-6)


def test_blocks_do_not_matter(arm):
    given = [recorded(arm, simulated(arm, 333), other_body(arm), noise=0.3)]
    one = fit_base(arm, given, options=BaseOptions(block=50))
    other = fit_base(arm, given, options=BaseOptions(block=4096))
    np.testing.assert_allclose(one.estimate, other.estimate, atol=1e-9 * one.size.max())
    np.testing.assert_allclose(one.sd, other.sd, rtol=1e-6)


def test_frames_that_cannot_be_used_are_counted(arm):
    motion = simulated(arm, 300)
    clean = recorded(arm, motion, other_body(arm))
    forces = np.array(clean.wrenches.forces)
    forces[10:30] = np.nan
    values = np.array(motion.values)
    values[40:45] = np.nan
    use = np.ones(300, bool)
    use[:20] = False
    given = Recording(replace(motion, values=values), replace(clean.wrenches, forces=forces), use)
    fit = fit_base(arm, [given])
    assert dict(fit.left_out) == {
        "left out by the user": 20,
        "motion missing": 5,
        "force missing": 10,
    }
    assert fit.frames == 265
    np.testing.assert_allclose(
        fit.estimate, fit.base.of(other_body(arm)), atol=1e-5 * fit.size.max()
    )
    with pytest.raises(BadData, match=r"no frame can be used .*left out by the user: 300"):
        fit_base(arm, [replace(given, use=np.zeros(300, bool))])


def test_a_tare_is_found_and_told_apart(arm):
    truth = other_body(arm)
    offset = np.array([3.0, -2.0, 4.0, 20.0, -30.0, 10.0])
    given = [with_offset(recorded(arm, simulated(arm, 1000), truth, noise=0.5), offset)]
    fit = fit_base(arm, given)
    assert fit.tare.significant
    np.testing.assert_array_less(np.abs(fit.tare.constant - offset), 5.0 * fit.tare.sd)
    with_tare = fit_base(arm, given, options=BaseOptions(tare=True))
    assert (
        np.mean(np.abs(with_tare.estimate - with_tare.base.of(truth)) < 3.0 * with_tare.sd) > 0.95
    )
    assert not fit_base(
        arm, [recorded(arm, simulated(arm, 1000), truth, noise=0.5)]
    ).tare.significant


def test_a_base_that_is_bolted_down(arm):
    """Only the tare decides whether the weight shows; a base that moves is refused."""
    hold = dict.fromkeys(arm.joints[0].coordinates, 0.25)
    truth = other_body(arm)
    given = [recorded(arm, simulated(arm, 1500, hold=hold), truth, noise=0.5)]
    fit = fit_base(arm, given, options=BaseOptions(fixed=True))
    assert fit.base.held["root_tx"] == 0.25
    assert np.mean(np.abs(fit.estimate - fit.base.of(truth)) < 3.0 * fit.sd) > 0.95
    assert fit.identifiable[0]
    assert fit.carried_mass == pytest.approx(truth[:, 0].sum(), rel=0.05)
    tared = fit_base(arm, given, options=BaseOptions(fixed=True, tare=True))
    assert tared.base.names[0].startswith("body0 m")
    assert not tared.identifiable[0]
    with pytest.raises(BadData, match="'root_tx' moves"):
        fit_base(arm, [recorded(arm, simulated(arm, 50), truth)], options=BaseOptions(fixed=True))


def test_a_weight_that_a_tare_took_away_is_missing(arm):
    """Tared with the body on it, a plate carries nothing on average."""
    motion = simulated(arm, 1500)
    mass = arm.mass
    offset = np.concatenate([np.zeros(3), mass * np.array(arm.gravity)])
    honest = fit_base(arm, [recorded(arm, motion)])
    tared = fit_base(arm, [with_offset(recorded(arm, motion), offset)])
    assert honest.carried_mass == pytest.approx(mass, rel=0.05)
    assert abs(tared.carried_mass) < 0.05 * mass
    assert tared.tare.significant
    np.testing.assert_allclose(tared.tare.constant[3:], offset[3:], atol=1.0)


def test_memory_does_not_grow_with_the_frames(arm):
    """A frame's rows of the regressor are 3.8 kB here.

    A tenth of that is stored: its six residuals and the like.
    """
    most = {}
    for frames in (1000, 4000):
        given = recorded(arm, simulated(arm, frames))
        tracemalloc.start()
        fit_base(arm, [given], base_parameters(arm), BaseOptions(block=256, motion_sd=0.0))
        most[frames] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert (most[4000] - most[1000]) / 3000 < 1000


def test_a_motion_that_excites_nothing_leaves_the_model(arm):
    """At rest only the weight and its moment are identifiable.

    All else stays where the model has it, and is marked.
    """
    hold = dict.fromkeys(arm.coordinate_names, 0.3)
    fit = fit_base(arm, [recorded(arm, simulated(arm, 200, hold=hold), other_body(arm), noise=0.5)])
    assert fit.rank <= 3
    assert fit.identifiable.sum() <= 3
    assert not np.isfinite(fit.condition) or fit.condition > 1e12
    inertias = fit.base.columns % 10 > 3
    np.testing.assert_allclose(
        fit.estimate[inertias],
        fit.base.of(inertial_parameters(arm))[inertias],
        atol=1e-6 * fit.size.max(),
    )


def test_sizes_are_those_of_the_bodies(arm):
    sizes = parameter_sizes(arm)
    assert (sizes > 0.0).all()
    heavier = with_inertial_parameters(arm, 2.0 * inertial_parameters(arm))
    np.testing.assert_allclose(parameter_sizes(heavier), 2.0 * sizes)
    np.testing.assert_allclose(
        base_sizes(heavier, base_parameters(arm)), 2.0 * base_sizes(arm, base_parameters(arm))
    )


def test_bad_options_are_named():
    with pytest.raises(BadData, match="identifiable"):
        BaseOptions(identifiable=0.0)
    given = recorded(random_tree(0), simulated(random_tree(0), 5))
    with pytest.raises(BadData, match="use"):
        replace(given, use=np.ones(3, bool))


def test_larger_terms_of_a_base_parameter_come_first():
    """Terms are sorted by what a body of usual size has of them.

    A tenth of a mass is more than a whole moment of inertia.
    """
    combination = np.zeros((1, 20))
    combination[0, [0, 10, 14, 11]] = 1.0, 0.1, 1.0, 0.5
    base = BaseParameters(
        bodies=("a", "b"),
        columns=np.array([0]),
        combination=combination,
        names=("a m",),
        never=(),
        held={},
        rank=1,
        tared=np.zeros((1, 0)),
    )
    size = {"m": 0.1 * SCALE[0], "m c_x": 0.5 * SCALE[1], "I_xx": 1.0 * SCALE[4]}
    order = sorted(size, key=lambda name: -size[name])
    assert [term.rpartition("b ")[2] for term in base.describe(0).split(" + ")[1:]] == order

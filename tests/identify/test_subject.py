"""The whole identification.

The truth is recovered, real forces are explained better, and unidentifiable parameters are marked.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.base_parameters import base_parameters, held_in
from myomorph.body.identify.determined import MeasuredRows, determined
from myomorph.body.identify.link_prior import LINK_SD, LinkPrior
from myomorph.body.identify.mass_points import MassPointOptions, prior_variances, solve_mass_points
from myomorph.body.identify.parts import parts_of
from myomorph.body.identify.pseudo_inertia import PseudoInertiaOptions, solve_ridge
from myomorph.body.identify.recordings import RecordingOptions, usable
from myomorph.body.identify.sides import sides_of
from myomorph.body.identify.subject import (
    CONIC,
    GENERIC,
    SHAPE,
    IdentificationOptions,
    _far_from_shape,
    identify,
)
from myomorph.body.identify.unseen import thinned
from myomorph.body.identify.validation import cross_validate
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.series import Wrenches
from myomorph.core.rigid.regressor import base_regressor, reference_points
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape

GAIT = "opensim-gait-subject01/ref_id"
MASS = 72.6


@pytest.fixture(scope="module")
def walk(data):
    """Model, its mass points, and a recorded walk with forces (OpenSim's subject01)."""
    model = read_model(data(f"{GAIT}/subject01.osim"))
    model = with_inertial_parameters(model, inertial_parameters(model) * (MASS / model.mass))
    motion = motion_from_table(read_sto(data(f"{GAIT}/subject01_walk1_ik.mot")), model)
    wrenches = read_external_loads(data(f"{GAIT}/subject01_walk1_grf.xml"))
    found = usable(model, motion, wrenches, mass=MASS, options=RecordingOptions(cutoff=6.0))
    points, _, _ = body_points(model, BodyShape(), MASS, BodyOptions(spacing=0.04))
    return model, points, found


def halves(found):
    frames = np.flatnonzero(found.use)
    first = found.use & (np.arange(len(found.use)) < frames[len(frames) // 2])
    return [
        replace(found, recording=replace(found.recording, use=use))
        for use in (first, found.use & ~first)
    ]


def forces_of(model, recording):
    """Return what plates would measure if the body were this model.

    It is one wrench at the base's origin.
    """
    wrench = base_regressor(model, recording.motion) @ inertial_parameters(model).ravel()
    return Wrenches(
        time=recording.motion.time,
        names=("plate",),
        bodies=(model.body_names[0],),
        forces=wrench[:, None, 3:],
        points=reference_points(model, recording.motion)[:, None],
        torques=wrench[:, None, :3],
    )


@pytest.fixture(scope="module")
def real(walk):
    """Masses as they are expected, from half of the walk."""
    model, points, found = walk
    first, second = halves(found)
    expected = IdentificationOptions(masses="expected")
    return model, second, identify(model, [first], points, mass=MASS, options=expected)


@pytest.fixture(scope="module")
def by_default(walk):
    model, points, found = walk
    first, second = halves(found)
    options = IdentificationOptions(compare=False)
    return model, second, identify(model, [first], points, mass=MASS, options=options)


def test_masses_that_are_not_shown_stay_and_the_other_half_is_explained_better(by_default, real):
    """The default: a second of walking shows no single mass; mass centers and inertias do it."""
    model, second, found = by_default
    shape = found.parameters[SHAPE][:, 0]
    kept = found.model
    heaviest = int(np.argmax(shape))
    for index, (body, word) in enumerate(
        zip(kept.bodies, found.mass_evidence.values(), strict=True)
    ):
        if word == "not shown" and index != heaviest:
            assert body.mass == pytest.approx(shape[index], rel=1e-5)
    assert set(found.mass_evidence.values()) == {"not shown"}
    # The expected masses, and how sure they are, are beside them.
    np.testing.assert_allclose(found.expected, real[2].expected, rtol=1e-9)
    np.testing.assert_allclose(found.sd, real[2].sd, rtol=1e-9)
    assert (found.model_error >= found.sd).all()
    interval = found.mass_interval("torso")
    assert interval.low <= interval.value <= interval.high
    models = {"found": kept, GENERIC: with_inertial_parameters(model, found.parameters[GENERIC])}
    check = cross_validate(models, second.recording)
    moment, force = check.rms("found") / check.rms(GENERIC)
    assert moment < 0.85
    assert force < 1.02
    assert found.unseen.ratios[0] < 0.85


def test_the_half_that_was_not_seen_is_explained_better(real):
    model, second, found = real
    models = {name: with_inertial_parameters(model, one) for name, one in found.parameters.items()}
    check = cross_validate(models, second.recording)
    moment, force = check.rms(found.chosen) / check.rms(GENERIC)
    assert moment < 0.8
    assert force < 1.02
    assert check.rms(CONIC)[0] < 0.8 * check.rms(GENERIC)[0]


def test_the_model_is_a_body_of_the_given_mass(real):
    _, _, found = real
    assert found.model.mass == pytest.approx(MASS, abs=1e-6)
    np.testing.assert_allclose(
        inertial_parameters(found.model), found.parameters[found.chosen], atol=1e-9
    )
    assert next(iter(found.parameters)) == found.chosen == "identified, own"
    assert {CONIC, SHAPE, GENERIC} <= set(found.parameters)
    for name in (found.chosen, CONIC):
        assert all(link.eigenvalues[0] > 0.0 for link in found.consistency[name].links)
    assert found.residuals[found.chosen][0] < found.residuals[GENERIC][0]
    assert found.mass_sd in found.tried
    assert np.mean(np.square(found.tried[found.mass_sd] / found.noise)) <= 1.0
    assert not found.unseen.worse
    assert found.unseen.ratios[0] < 0.8


def test_what_the_data_do_not_show_is_marked(real):
    """A second of walking shows the trunk, but not the moments of inertia of a toe."""
    model, _, found = real
    known = found.known
    shares = dict(zip(model.body_names, known.shares, strict=True))
    assert ((known.shares >= 0.0) & (known.shares <= 1.0)).all()
    assert known.shares.sum() <= found.base.rank
    assert known.data.sum() <= known.rank <= found.base.rank
    assert shares["torso"].max() > 0.5
    assert shares["toes_r"][4:].max() < 0.1
    assert {"I_xx", "I_yy", "I_zz"} <= set(found.from_shape["toes_r"])


def test_without_data_nothing_is_shown(walk):
    model, points, _ = walk
    nothing = MeasuredRows(A=np.zeros((1, 10 * len(model.bodies))))
    known = determined(points["own"], nothing, MASS, 0.1)
    np.testing.assert_allclose(known.shares, 0.0, atol=1e-9)
    np.testing.assert_allclose(known.sd, known.prior_sd, rtol=1e-9)
    assert known.rank == 0
    assert not known.data.any()


def test_a_sum_of_two_masses_is_not_two_masses(walk):
    """Exact rows of m1 + m2: rank 1, and neither mass is determined."""
    model, points, _ = walk
    A = np.zeros((1, 10 * len(model.bodies)))
    one = model.body_names.index("femur_r")
    other = model.body_names.index("femur_l")
    A[0, [10 * one, 10 * other]] = 1e6
    known = determined(points["own"], MeasuredRows(A=A), MASS, 0.1)
    assert known.rank == 1
    assert not known.data.any()
    A[0, 10 * other] = 0.0
    known = determined(points["own"], MeasuredRows(A=A), MASS, 0.1)
    assert np.argwhere(known.data).tolist() == [[one, 0]]
    assert known.sd[one, 0] < 1e-3 * known.prior_sd[one, 0]


def _rows(model, recording):
    """Return the rows of the base parameters in units of their noise."""
    base = base_parameters(model, held=held_in(model, [recording.motion]))
    return parts_of(model, [recording], base).rows(np.array([6.0, 20.0]))[0]


def test_intervals_hold_masses_of_many_bodies(walk):
    """Intervals of 90 % for bodies drawn from the points' prior.

    Their walk is real, and noise repeats over some frames.
    """
    few = thinned(walk[1]["own"])
    A = _rows(walk[0], walk[2].recording)
    rng = np.random.default_rng(3)
    options = PseudoInertiaOptions(mass_sd=0.1)
    known = determined(few, MeasuredRows(A=A, samples=4.0), MASS, options.mass_sd)
    center = few.parameters(few.reference)
    spread = np.sqrt(prior_variances(few, MassPointOptions(mass_sd=LINK_SD)))
    inside = np.zeros((60, len(center)))
    for draw in range(60):
        masses = few.reference + spread * rng.normal(size=len(few.reference))
        truth = few.parameters(masses * MASS / masses.sum())
        b = A @ truth.ravel() + np.sqrt(4.0) * rng.normal(size=len(A))
        fit = solve_ridge(A, b, center, mass=MASS, options=options)
        errors = (fit.parameters - truth)[:, 0]
        inside[draw] = np.abs(errors) < half_width(known.sd[:, 0])
    assert 0.85 < np.mean(inside) < 0.95


def test_truth_is_found_again_from_clean_forces(walk):
    """Forces of a body with more trunk and less thigh.

    After 1.2 s of walking its model predicts the other 1.2 s.
    """
    model, points, found = walk
    parameters = inertial_parameters(model)
    torso = model.body_names.index("torso")
    parameters[torso] *= 1.08
    for side in "rl":
        parameters[model.body_names.index(f"femur_{side}")] *= 0.8
    truth = with_inertial_parameters(model, parameters)
    clean = replace(
        found,
        recording=replace(found.recording, wrenches=forces_of(truth, found.recording), finer=None),
    )
    first, second = halves(clean)
    # The motion is exact: no skin carried it.
    exact = IdentificationOptions(compare=False, skin_sd=0.0)
    result = identify(model, [first], points, mass=truth.mass, options=exact)
    models = {
        "identified": result.model,
        GENERIC: with_inertial_parameters(model, result.parameters[GENERIC]),
    }
    check = cross_validate(models, second.recording)
    # Of moment and force
    assert (check.rms("identified") / check.rms(GENERIC) < [0.4, 0.1]).all()
    trunk_mass = inertial_parameters(result.model)[torso, 0]
    assert trunk_mass == pytest.approx(parameters[torso, 0], rel=0.06)
    assert list(result.parameters) == ["identified, own", SHAPE, GENERIC]


def test_links_that_are_alike_are_as_uncertain_as_others(walk):
    """Tying both sides halved what each may differ by, and 90 % intervals held 75 % of masses."""
    model, points, _ = walk
    few = thinned(points["own"])
    shape = few.parameters(few.reference)
    tied = LinkPrior(points=few, mass=MASS, sides=sides_of(model, shape))
    alone = LinkPrior(points=few, mass=MASS)
    shank = 10 * model.body_names.index("tibia_r")
    of_tied = tied.of_people(LINK_SD)[shank, shank]
    assert of_tied == pytest.approx(alone.of_people(LINK_SD)[shank, shank], rel=0.05)
    assert of_tied == pytest.approx((LINK_SD * shape[shank // 10, 0]) ** 2, rel=0.05)
    assert tied.held(LINK_SD)[shank, shank] < 0.6 * of_tied
    # What both have in common may differ by as much, what they do not by little.
    other = 10 * model.body_names.index("tibia_l")
    assert tied.of_people(LINK_SD)[shank, other] > 0.9 * of_tied


def test_cross_validation_of_the_true_model_is_exact(walk):
    model, _, found = walk
    recording = replace(found.recording, wrenches=forces_of(model, found.recording), finer=None)
    check = cross_validate({"true": model}, recording)
    assert np.isnan(check.measured[~found.use]).all()
    np.testing.assert_allclose(check.rms("true"), 0.0, atol=1e-9)
    table = check.table()["true"]
    assert set(table) == {"bias", "mean", "rms", "peak", "percent"}
    assert check.weight == pytest.approx(MASS * 9.80665)
    with pytest.raises(UnknownName, match="'true'"):
        check.rms("false")
    with pytest.raises(BadData, match="other bodies"):
        cross_validate({"a": model, "b": replace(model, bodies=model.bodies[:-1])}, recording)


def test_masses_that_are_hard_to_believe_are_told(walk):
    model, _, _ = walk
    shape = inertial_parameters(model)[:, 0]
    thigh = model.body_names.index("femur_r")
    shank = model.body_names.index("tibia_l")
    masses = shape.copy()
    masses[thigh] = 1.8 * shape[thigh]
    masses[shank] = 0.1 * shape[shank]
    (note,) = _far_from_shape(model, masses, shape, 0.5)
    assert f"2 of {len(shape)} links" in note
    assert (
        f"'femur_r' {masses[thigh]:.2f} kg (shape {shape[thigh]:.2f}; record hip_flexion_r, "
        in note
    )
    assert "record knee_angle_l moving fast" in note
    assert _far_from_shape(model, shape, shape, 0.5) == ()


def test_forces_of_another_moment_gain_nothing(walk):
    """The walk's own forces half a second late."""
    model, points, found = walk
    wrenches = found.recording.wrenches
    shift = 30
    late = replace(
        wrenches,
        **{name: np.roll(getattr(wrenches, name), shift, axis=0) for name in ("forces", "torques")},
    )
    first, _ = halves(replace(found, recording=replace(found.recording, wrenches=late, finer=None)))
    result = identify(
        model, [first], points, mass=MASS, options=IdentificationOptions(compare=False)
    )
    assert "the generic model's masses are kept" in result.notes[0]
    assert result.chosen == GENERIC
    np.testing.assert_array_equal(result.parameters[GENERIC], inertial_parameters(result.model))
    insisted = identify(
        model,
        [first],
        points,
        mass=MASS,
        options=IdentificationOptions(compare=False, if_worse="identified"),
    )
    assert "used because" in insisted.notes[0]
    assert insisted.chosen == insisted.identified == "identified, own"


def test_strength_can_be_given(walk):
    model, points, found = walk
    stiff = identify(
        model,
        [found],
        points,
        mass=MASS,
        options=IdentificationOptions(
            mass_sd=1e-3, method="pseudo-inertia", compare=False, if_worse="identified"
        ),
    )
    assert stiff.chosen == CONIC
    assert list(stiff.tried) == [1e-3]
    np.testing.assert_allclose(
        stiff.parameters[CONIC][:, 0], stiff.parameters[SHAPE][:, 0], rtol=0.02
    )
    with pytest.raises(BadData, match="mass_sd"):
        IdentificationOptions(mass_sd=0.0)
    with pytest.raises(BadData, match="masses is 'all'"):
        IdentificationOptions(masses="all")
    with pytest.raises(BadData, match="mass points"):
        identify(model, [found], {})


def test_the_weights_of_the_paper_can_be_asked_for(walk):
    """[D] eq. 3.10 with W_phi = W_rho = 1: the same masses as from base parameters by hand."""
    model, points, found = walk
    options = IdentificationOptions(
        prior="paper", compare=False, if_worse="identified", motion_sd=0.0
    )
    result = identify(model, [found], points, mass=MASS, options=options)
    parts = parts_of(model, [found.recording], result.base.base)
    # What the walk hardly shows is held at the model's, to within its size.
    R, z = parts.factor(result.noise)
    spread = result.base.size
    mean = result.base.base.of(inertial_parameters(model))
    R = np.vstack([R, np.diag(1.0 / spread)])
    z = np.concatenate([z, mean / spread])
    by_hand = solve_mass_points(
        points["own"],
        result.base.base.combination,
        np.linalg.lstsq(R, z)[0],
        mass=MASS,
        options=MassPointOptions(prior="paper"),
    )
    np.testing.assert_allclose(result.parameters[result.chosen], by_hand.parameters, atol=1e-5)
    with pytest.raises(BadData, match="method 'points'"):
        IdentificationOptions(prior="paper", mass_sd=0.1)


def test_weights_of_the_paper_predict_the_other_half(walk):
    """What half a walk does not excite is no noise of a hundred times its size.

    Eq. 3.10 would fit such noise with masses.
    """
    model, points, found = walk
    first, second = halves(found)
    options = IdentificationOptions(
        prior="paper", compare=False, if_worse="identified", motion_sd=0.0
    )
    result = identify(model, [first], points, mass=MASS, options=options)
    generic = with_inertial_parameters(model, result.parameters[GENERIC])
    check = cross_validate({"paper": result.model, "generic": generic}, second.recording)
    moment, force = check.rms("paper") / check.rms("generic")
    assert moment < 1.0
    assert force < 2.5


def test_weights_of_the_paper_decide_how_far_points_leave_the_shape(walk):
    """A large W_rho preserves the shape; a free total is another mass than the subject's.

    Both exist only with prior "paper".
    """
    model, points, found = walk
    paper = IdentificationOptions(
        prior="paper", compare=False, if_worse="identified", motion_sd=0.0
    )
    shape = points["own"].parameters(points["own"].reference)[:, 0]
    stiff = identify(
        model, [found], points, mass=MASS, options=replace(paper, **({"weight_rho": 1e9}))
    )
    loose = identify(
        model,
        [found],
        points,
        mass=MASS,
        options=replace(paper, **({"weight_phi": 1e3, "keep_mass": False})),
    )
    np.testing.assert_allclose(stiff.parameters[stiff.identified][:, 0], shape, atol=1e-3)
    assert np.abs(loose.parameters[loose.identified][:, 0] - shape).max() > 0.5
    assert abs(loose.parameters[loose.identified][:, 0].sum() - MASS) > 1e-4
    with pytest.raises(BadData, match="prior 'paper'"):
        IdentificationOptions(weight_rho=2.0)

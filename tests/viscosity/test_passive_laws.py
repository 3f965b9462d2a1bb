"""Passive laws: found again, told apart, and swings predicted from their first frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swung_limb import LAWS, LIMB, Setup, law, released, swung

from myomorph.core.fit.correlation import variance_samples
from myomorph.core.model.errors import UnknownName
from myomorph.core.motion.filters import lowpass
from myomorph.swings.viscosity.identification.inertia import InertiaOptions
from myomorph.swings.viscosity.trust.acting import DRY, Bootstrap, acting_law
from myomorph.swings.viscosity.trust.forward import angles_apart, measured_motion, swing_forward
from myomorph.swings.viscosity.trust.law import (
    PassiveLaw,
    PassiveProblem,
    bounded_least_squares,
    hinge_slopes,
    law_columns,
    resistances,
)
from myomorph.swings.viscosity.trust.models import PassiveOptions, compare_passive_laws
from truths.mechanical_joint import JointExperiment, mechanical_joint

AXIS = np.array([0.6, 0.0, 0.8])
QUICK = PassiveOptions(draws=40, held_out=2)


@pytest.fixture(scope="module")
def ball() -> dict:
    return released()


@pytest.mark.parametrize("name", LAWS)
def test_a_swing_is_what_its_law_and_inertia_predict(ball, name):
    recording = ball[name][1]
    predicted = swing_forward(recording, slice(100, 700), LIMB, law(**LAWS[name]))
    measured = measured_motion(recording, slice(100, 700))
    tolerance = 2e-4 if name in ("friction", "muscles") else 2e-5
    assert angles_apart(predicted.rotations, measured.rotations).max() < tolerance
    assert predicted.wrench == pytest.approx(measured.wrench, abs=100 * tolerance)


def test_three_hinges_damp_the_rates_of_their_own_angles():
    random = np.random.default_rng(0)
    angles = random.uniform(-1.0, 1.0, (20, 3))
    speeds = random.standard_normal((20, 3))
    turns = [Rotation.from_rotvec(np.outer(angles[:, i], np.eye(3)[i])) for i in range(3)]
    limb = turns[0] * turns[1] * turns[2]
    # Rates along the limb's axes are what each hinge adds, seen from beyond the hinges after it.
    after = [turns[1] * turns[2], turns[2], Rotation.identity(20)]
    rates = sum(after[i].inv().apply(np.outer(speeds[:, i], np.eye(3)[i])) for i in range(3))
    slopes = hinge_slopes(limb.as_matrix(), np.eye(3)[[0, 2]])
    assert np.einsum("fha,fa->fh", slopes, rates) == pytest.approx(speeds)
    passive = law(hinges=np.array([0.1, 0.2, 0.3]))
    columns = resistances(np.zeros((20, 3)), rates, np.zeros((20, 0, 3)), 0.1, slopes)
    power = np.einsum("fa,fac,c->f", rates, columns, passive.coefficients)
    assert power == pytest.approx(speeds**2 @ [0.1, 0.2, 0.3])


def test_a_hinge_keeps_to_its_axis():
    passive = law(1, viscosity=0.05, stiffness=0.8, rest_moment=0.1)
    recording = swung([passive], [0.9 * AXIS], [np.zeros(3)], Setup(axis=AXIS, muscles=False))[0]
    predicted = swing_forward(recording, slice(0, 800), LIMB, passive)
    measured = measured_motion(recording, slice(0, 800))
    assert angles_apart(predicted.rotations, measured.rotations).max() < 2e-5
    assert np.cross(predicted.rates, AXIS) == pytest.approx(0.0, abs=1e-9)
    assert predicted.wrench == pytest.approx(measured.wrench, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "chosen"),
    [
        ("viscosity", "viscosity"),
        ("axes", "viscosity by axis"),
        ("spring", "viscosity + stiffness"),
        ("friction", "viscosity + coulomb"),
        ("drag", "viscosity + quadratic"),
        ("muscles", "viscosity + muscles"),
        ("hinges", "hinges"),
    ],
)
def test_the_law_that_acted_is_chosen_and_its_coefficients_found(ball, name, chosen):
    comparison = compare_passive_laws(ball[name], QUICK)
    best = comparison.chosen
    assert best.name == chosen
    assert best.law.coefficients == pytest.approx(
        law(**LAWS[name]).coefficients, abs=2e-5, rel=1e-3
    )
    assert best.angle_error < 1e-3
    assert best.angle_error <= comparison.fits[0].angle_error
    kinds = [{term.removesuffix(" by axis") for term in one.terms} for one in comparison.fits]
    acted = set(LAWS[name]) - {"rest_moment"}
    others = [
        one for one, kind in zip(comparison.fits, kinds, strict=True) if acted - kind - {"muscle"}
    ]
    assert others or name == "muscles"
    assert all(one.angle_error > best.angle_error for one in others)


@pytest.mark.parametrize(
    ("name", "form", "friction"),
    [
        ("viscosity", "", ""),
        ("axes", "viscosity by axis", ""),
        ("friction", "viscosity", "against the motion"),
        ("drag", "", ""),
        ("hinges", "hinges", ""),
    ],
)
def test_what_acts_is_found_though_the_inertia_is_off(ball, name, form, friction):
    bare = [
        replace(each, muscles=(), strands=(), lengthening=np.zeros((len(each), 0, 3)))
        for each in ball[name]
    ]
    problem = PassiveProblem.of(bare, 0.1, InertiaOptions())
    inertia = problem.inertia(np.ones(len(problem.sums)))
    off = replace(inertia, parameters=inertia.parameters * np.linspace(0.98, 1.02, 10))
    acting = acting_law(problem, off, (), Bootstrap(draws=20, seed=0))
    if not form:
        assert acting is None
        return
    assert (acting.form, acting.friction) == (form, friction)
    truth = law(**LAWS[name])
    expected = {"axes": truth.viscosity, "friction": truth.viscosity[:1], "hinges": truth.hinges}[
        name
    ]
    values = {kind: each.value for kind, each in acting.coefficients.items() if kind != DRY}
    parts = list(values.values())[1:] or list(values.values())
    assert parts == pytest.approx(expected, rel=0.05)
    if friction:
        assert acting.coefficients[DRY].value == pytest.approx(truth.coulomb, rel=0.1)
    # The torque that is taken off the muscles is the law's own, in rates of the one viscosity.
    resisted = acting.coefficients["viscosity"].value * acting.resisting(bare[0])[bare[0].used]
    assert resisted == pytest.approx(
        -truth.torque(bare[0])[bare[0].used], abs=0.1 * np.ptp(resisted)
    )


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_mujoco_swings_as_predicted(kind):
    joint = mechanical_joint(kind, 0.08, 1.2, seed=3, experiment=JointExperiment(seconds=12.0))
    comparison = compare_passive_laws(joint.exact_swings(), QUICK)
    assert comparison.chosen.name == "viscosity + stiffness"
    assert comparison.chosen.coefficients["viscosity"].value == pytest.approx(0.08, rel=1e-4)
    assert comparison.chosen.coefficients["stiffness"].value == pytest.approx(1.2, rel=1e-4)
    assert comparison.chosen.angle_error < 1e-4
    assert comparison.chosen.force_error < 1e-2


def test_a_spring_that_is_slack_elsewhere_is_found_there():
    rest = [0.1, -0.05, 0.1]
    joint = mechanical_joint(
        "ball", 0.05, 2.0, seed=1, experiment=JointExperiment(rest=rest, seconds=12.0)
    )
    comparison = compare_passive_laws(joint.exact_swings(), QUICK)
    found = comparison.chosen.coefficients
    assert comparison.chosen.name == "viscosity + stiffness"
    assert [found[f"rest angle {axis}"].value for axis in "xyz"] == pytest.approx(rest, abs=1e-4)
    assert found["viscosity"].value == pytest.approx(0.05, rel=1e-3)
    assert comparison.chosen.angle_error < 1e-3
    shown = comparison.prediction
    assert shown is not None
    recording = joint.exact_swings()[0]
    first = int(np.searchsorted(recording.time, shown.time[0]))
    truth = joint.truth.angles(recording.rotations[first : first + len(shown.time)])
    assert shown.measured == pytest.approx(truth, abs=1e-6)
    assert shown.chosen == pytest.approx(truth, abs=2e-3)


def test_a_measured_swing_keeps_to_viscosity_where_that_is_all():
    joint = mechanical_joint("hinge", 0.06, 0.0, seed=5, experiment=JointExperiment(seconds=20.0))
    comparison = compare_passive_laws(joint.swings(), QUICK)
    assert comparison.chosen.name == "viscosity"
    assert comparison.chosen is comparison.fits[0]
    shown = comparison.prediction
    assert shown is not None
    assert shown.chosen.shape == shown.measured.shape == (len(shown.time), 1)
    assert np.abs(shown.chosen - shown.measured).max() < np.deg2rad(0.5)


def test_criteria_count_independent_samples():
    random = np.random.default_rng(1)
    white = [random.standard_normal((4000, 2)) for _ in range(3)]
    assert variance_samples(white) == pytest.approx(24000, rel=0.15)
    smooth = [lowpass(one, 200.0, 8.0) for one in white]
    assert variance_samples(smooth) == pytest.approx(24000 * 2 * 8.0 / 200.0, rel=0.3)


def test_bounded_least_squares_is_optimal():
    random = np.random.default_rng(2)
    groups = law_columns(("viscosity by axis", "coulomb", "quadratic"), 3)[1]
    n = len(groups)
    A = random.standard_normal((50, 12, n))
    b = random.standard_normal((50, 12))
    H = np.swapaxes(A, 1, 2) @ A
    g = np.einsum("dik,di->dk", A, b)
    x, gain = bounded_least_squares(H, g, groups)
    assert (x >= 0.0).all()
    assert gain == pytest.approx(np.einsum("di,di->d", x, g))
    slack = np.einsum("dij,dj->di", H, x) - g
    assert np.abs(slack * x).max() < 1e-8
    assert slack.min() > -1e-8


def test_a_law_is_its_coefficients():
    passive = law(**LAWS["spring"])
    again = PassiveLaw.of(passive.coefficients)
    assert np.array_equal(again.coefficients, passive.coefficients)
    with pytest.raises(UnknownName, match=r"'friction'.*'coulomb'"):
        law_columns(("friction",), 3)

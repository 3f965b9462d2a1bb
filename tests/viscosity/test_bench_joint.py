"""A known mechanical joint on a bench is found as it is, by the command and by the library."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.pseudo_inertia import tangents
from myomorph.lab.cli.program import main
from myomorph.swings.viscosity.identification.excitation import NOT_SHOWN
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.identification.inertia import InertiaOptions, limb_inertia
from myomorph.swings.viscosity.study.joint_law import with_acting
from myomorph.swings.viscosity.study.specimen_step import read_specimen
from myomorph.swings.viscosity.swings.parameter_scale import parameter_scale
from myomorph.swings.viscosity.swings.sums import predicted_rows, swing_sums
from myomorph.swings.viscosity.trust.acting import ActingLaw
from myomorph.swings.viscosity.trust.checks import plate_zero, recording_findings
from myomorph.swings.viscosity.trust.freed import INERTIA_ERROR, inertia_errors
from myomorph.swings.viscosity.trust.models import PassiveOptions, compare_passive_laws
from truths.bench_joint import write_bench
from truths.mechanical_joint import GRAVITY, JointExperiment, mechanical_joint

DAMPING = 0.06
FRICTION = 0.02
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.8, 0.0), (1.0, 1e-5, 0.0))
FEW = PassiveOptions(draws=60)


@pytest.fixture(scope="module", params=AXES, ids=str)
def hinge(request):
    return mechanical_joint(
        "hinge", DAMPING, 0.0, 7, experiment=JointExperiment(seconds=8.0, axis=request.param)
    )


def test_a_hinge_shows_its_limb_whichever_way_its_axis_lies(hinge):
    swings = hinge.swings(8.0)
    for tare in ("known", "loaded", "unknown"):
        limb = limb_inertia(swing_sums(swings), None, InertiaOptions(tare=tare))
        moment = float(np.linalg.norm(hinge.truth.parameters[1:4]))
        assert limb.first_moment == pytest.approx(moment, rel=0.01)
        assert 0.3 * hinge.truth.mass < limb.least_mass < hinge.truth.mass
    found = identify_specimen("hinge", swings, (), options=ViscosityOptions(draws=40)).without
    assert found.viscosity.value == pytest.approx(DAMPING, rel=0.02)
    assert found.mass.value == pytest.approx(hinge.truth.mass, rel=0.01)


def test_the_zero_of_a_plate_under_a_hinge_is_judged_by_what_the_hinge_shows(hinge):
    swings = hinge.swings(8.0)
    zero = plate_zero(swings)
    assert zero.mass == pytest.approx(hinge.truth.mass, rel=0.01)
    assert 0.3 * hinge.truth.mass < zero.least_mass < hinge.truth.mass
    assert recording_findings(swings) == ()
    hanging = np.concatenate([np.zeros(3), hinge.truth.mass * GRAVITY])
    tared = [replace(each, wrench=each.wrench + hanging) for each in swings]
    (found,) = recording_findings(tared)
    assert found.kind == "tare"


def test_a_mass_center_along_the_hinge_is_no_fault_of_the_plate(hinge):
    """It makes a constant moment, level and across the axis; one about the axis is a fault."""
    swings = hinge.swings(8.0)
    aside = np.cross(0.2 * hinge.truth.axis, -GRAVITY)
    moved = [replace(each, wrench=each.wrench + np.append(aside, np.zeros(3))) for each in swings]
    assert recording_findings(moved) == ()
    about = np.append(1.5 * hinge.truth.axis, np.zeros(3))
    (found,) = recording_findings([replace(each, wrench=each.wrench + about) for each in swings])
    assert found.kind == "zero"


def test_a_scale_by_kind_is_the_same_in_all_axes():
    columns = np.random.default_rng(0).standard_normal((50, 10))
    columns[:, 1] = 1e-14
    scale = parameter_scale(np.linalg.norm(columns, axis=0))
    assert np.ptp(scale[1:4]) == 0.0
    assert np.ptp(scale[4:]) == 0.0
    assert (parameter_scale(np.zeros(10)) == 1.0).all()


@pytest.mark.parametrize("friction", [0.0, FRICTION])
def test_a_bench_hinge_comes_back_by_the_command(tmp_path, capsys, friction):
    joint = mechanical_joint(
        "hinge",
        DAMPING,
        0.0,
        21,
        experiment=JointExperiment(seconds=10.0, friction=friction, axis=(0.0, 1.0, 0.0)),
    )
    study = write_bench(joint, tmp_path / "bench")
    assert main(["viscosity", str(study), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    said = capsys.readouterr()
    report = read_specimen(tmp_path / "out" / "01")
    viscosity = report.row["joint_viscosity"]
    assert viscosity.holds(DAMPING)
    assert viscosity.value == pytest.approx(DAMPING, rel=0.03)
    assert ("law: one viscosity with dry friction" in said.out) == bool(friction)
    assert not any("no limb below" in note or "constant moment" in note for note in report.notes)
    assert report.row["mass_muscles_removed"].holds(joint.truth.mass)


@pytest.mark.parametrize("seed", [502, 503, 505, 506])
def test_the_inertia_along_a_bent_limb_is_found_though_friction_holds_it(seed):
    """A limb is no straight cylinder, and what friction lets go about one axis is no noise."""
    experiment = JointExperiment(seconds=8.0, friction=FRICTION, spin=0.0, trials=1)
    joint = mechanical_joint("ball", DAMPING, 0.0, seed, experiment=experiment)
    swings = [replace(each, cutoff=10.0) for each in joint.swings(10.0)]
    sums = swing_sums(swings)
    (rows,) = predicted_rows(swings, sums.frames_of_trials)
    np.testing.assert_array_equal(rows.rows, swings[0].wrench_rows)
    limb = limb_inertia(sums, None, InertiaOptions(tare="known"))
    assert limb.parameters[6] == pytest.approx(joint.truth.parameters[6], rel=0.06)


def test_a_bent_limb_on_a_ball_that_rubs_keeps_its_viscosity():
    """Its inertia along its length was a fifth too small, and the viscosity 8 % with it."""
    experiment = JointExperiment(seconds=12.0, friction=FRICTION)
    joint = mechanical_joint("ball", DAMPING, 0.0, 701, experiment=experiment)
    swings = [replace(each, cutoff=13.0) for each in joint.swings(13.0)]
    acting = compare_passive_laws(swings, FEW).acting
    assert acting is not None
    assert acting.friction == "about each axis"
    assert acting.coefficients["viscosity"].value == pytest.approx(DAMPING, rel=0.03)
    assert acting.coefficients["viscosity"].holds(DAMPING)


def test_errors_of_the_inertia_are_those_of_noise_and_instruments_but_for_its_size():
    """They are drawn from the normal distribution of all, given that the size is right."""
    joint = mechanical_joint("ball", DAMPING, 0.0, 501, experiment=JointExperiment(seconds=8.0))
    limb = limb_inertia(swing_sums(joint.swings(10.0)))
    squares = np.array([0.0, 3.0, 2.0, 1.0, 5.0, 4.0, 0.2, 0.1, 0.3, 0.4])
    errors = inertia_errors(limb, 4.0, squares)
    size = squares * limb.parameters
    np.testing.assert_allclose(errors @ size, 0.0, atol=1e-12)
    by_noise = 4.0 * limb.spread @ limb.spread.T
    changes = INERTIA_ERROR * tangents(limb.parameters[None])[0]
    every = by_noise + changes @ changes.T
    along = every @ size
    given = every - np.outer(along, along) / (size @ along)
    np.testing.assert_allclose(errors.T @ errors, given, atol=1e-9 * np.abs(every).max())


@pytest.mark.parametrize("trials", [1, 3])
def test_friction_that_holds_a_ball_about_some_axes_is_found(trials):
    """What sticks holds any torque up to the friction: only axes that slide tell its size."""
    kind = "ball" if trials > 1 else "hinge"
    joint = mechanical_joint(
        kind,
        DAMPING,
        0.0,
        504,
        experiment=JointExperiment(seconds=12.0, friction=FRICTION, spin=0.0, trials=trials),
    )
    swings = [replace(each, cutoff=10.0) for each in joint.swings(10.0)]
    acting = compare_passive_laws(swings, FEW).acting
    assert acting is not None
    assert acting.friction
    assert acting.coefficients["dry friction"].value == pytest.approx(FRICTION, rel=0.15)
    assert acting.coefficients["viscosity"].value == pytest.approx(DAMPING, rel=0.05)


def test_an_axis_is_no_better_known_than_errors_of_instruments_leave_it():
    joint = mechanical_joint("ball", DAMPING, 0.0, 4, experiment=JointExperiment(seconds=8.0))
    options = ViscosityOptions(draws=40, stiffness=False)
    swings = identify_specimen("ball", joint.swings(10.0), (), options=options)
    condition = swings.without
    wide = tuple(replace(each, low=0.0, high=2.0 * each.value) for each in condition.axis_viscosity)
    axes = (condition.axis_viscosity[0], *wide[1:])
    shared = swings.changed({"without": replace(condition, axis_viscosity=axes)})
    names = ("viscosity", *(f"viscosity {axis}" for axis in "xyz"))
    known = dict.fromkeys(names, replace(condition.viscosity, low=0.059, high=0.061))
    law = ActingLaw(form="viscosity by axis", friction="", coefficients=known, values=np.zeros(17))
    found, _ = with_acting(shared, swings, law, (), 0.95)
    x, y, z = found.without.axis_viscosity
    assert x.high - x.low == pytest.approx(0.002, rel=0.2)
    assert (y, z) == (NOT_SHOWN, NOT_SHOWN) or np.isnan([y.value, z.value]).all()

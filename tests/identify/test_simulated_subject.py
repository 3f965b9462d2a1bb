"""Lengths, marker positions and inertial parameters of a simulated person, recovered.

MuJoCo is the engine.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.accuracy.identification.simulated import (
    CASES,
    Size,
    Trials,
    fitted,
    from_markers,
    standard_of,
)

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.body.identify.base import BaseOptions, fit_base
from myomorph.body.identify.least_squares import Recording as Measured
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.core.model.model import Marker
from myomorph.core.rigid.regressor import base_wrench
from truths.simulated_bodies import TETRAHEDRON
from truths.simulated_engines import TreeEngine
from truths.simulated_subject import (
    Instruments,
    Movement,
    SubjectOptions,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
    step_curves,
)
from truths.simulated_truth import frames_between, joint_distances, moved, predicted
from truths.small_person import person


@pytest.fixture(scope="module")
def trials() -> Trials:
    compiled = person()
    model = model_from_mujoco(compiled, name="person")
    markers = [
        Marker(f"{one.name}_{i}", one.name, one.mass_center + 0.06 * offset)
        for one in model.bodies
        for i, offset in enumerate(TETRAHEDRON)
    ]
    subject = random_subject(model.with_markers(tuple(markers)), SubjectOptions(seed=11))
    engine = TreeEngine(compiled, subject.person)
    names, middles, reaches = middles_and_reaches(subject.person)
    tools = Instruments(rate=100.0)
    exciting = record(
        subject,
        engine,
        Movement(names=names, curves=exciting_curves(middles, reaches), duration=30.0),
        tools,
    )
    steps = step_curves(middles, reaches, 12.0)
    return Trials(
        subject,
        exciting,
        record(
            subject,
            engine,
            Movement(names=names, curves=steps, duration=12.0),
            replace(tools, seed=6),
        ),
    )


def test_the_person_is_possible_and_differs(trials):
    person = trials.subject.person
    generic = trials.subject.generic
    assert np.linalg.eigvalsh(pseudo_inertias(inertial_parameters(person))).min() > 0.0
    distances = joint_distances(person)
    before = joint_distances(generic)
    assert max(abs(distances[pair] - before[pair]) for pair in distances) > 0.01


def test_the_engine_agrees_with_the_regressor(trials):
    one = trials.held_out
    wrench = predicted(
        trials.subject.person, one.motion, one.center, inertial_parameters(trials.subject.person)
    )
    np.testing.assert_allclose(wrench, one.exact_wrench, atol=1e-7)


def test_base_parameters_with_known_kinematics_lie_within_their_deviations(trials):
    one = trials.exciting
    truth = inertial_parameters(trials.subject.person)
    exact_motion = BaseOptions(motion_sd=0.0)
    measured = Measured(one.motion, one.wrenches)
    fit = fit_base(trials.subject.person, [measured], options=exact_motion)
    error = (fit.estimate - fit.base.of(truth)) / fit.sd
    assert np.mean(np.abs(error) < 3.0) >= 0.95
    assert 0.7 < np.sqrt(np.mean(error**2)) < 1.4


def test_lengths_markers_and_masses_are_found_from_markers_and_plate(trials):
    person = trials.subject.person
    found = calibrate(
        trials.subject.generic, [trials.exciting.markers], CalibrationOptions(noise=0.0)
    )
    assert found.converged
    assert found.noise == pytest.approx(0.3e-3, rel=0.1)
    true = joint_distances(person)
    for pair, distance in joint_distances(found.model).items():
        assert distance == pytest.approx(true[pair], abs=2e-3), pair

    fit, both = fitted(found.model, trials)
    seen = both[1].recording
    rotations, origins = frames_between(person, trials.held_out.motion, found.model, seen.motion)
    for marker in found.model.markers:
        b = person.body_names.index(marker.body)
        place = rotations[b] @ person.marker(marker.name).location + origins[b]
        np.testing.assert_allclose(marker.location, place, atol=3e-3, err_msg=marker.name)

    truth = moved(inertial_parameters(person), rotations, origins)
    error = np.abs(fit.estimate - fit.base.of(truth)) / fit.sd
    assert np.mean(error < 3.0) >= 0.95

    center = trials.held_out.center
    measured = base_wrench(found.model, seen.motion, seen.wrenches, center)[seen.use]
    left = [
        np.sqrt(
            np.mean(
                (predicted(found.model, seen.motion, center, table)[seen.use] - measured) ** 2,
                axis=0,
            )
        )
        for table in (standard_of(fit), truth, inertial_parameters(found.model))
    ]
    assert (left[0] < 2.0 * left[1]).all()
    assert (left[0][3:] < 2.0 * trials.held_out.sigma[3:]).all()
    assert np.linalg.norm(left[2]) > 5.0 * np.linalg.norm(left[0])


@pytest.mark.long
def test_full_body_is_found_again():
    pytest.importorskip("musclemimic_models")
    case = next(one for one in CASES if one.name == "MyoFullBody")
    judged = [row for row in from_markers(case, Path(), Size(90.0, 15.0)) if row[2]]
    assert len(judged) > 6
    for name, value, target in judged:
        sign, bound = target.split()
        assert value <= float(bound) if sign == "<=" else value >= float(bound), name

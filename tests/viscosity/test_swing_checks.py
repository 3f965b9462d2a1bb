"""Faults of a swing experiment are named, and a sound one is not accused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swung_limb import GRAVITY, LAWS, LIMB, released

from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.trust.checks import (
    condition_findings,
    plate_zero,
    recording_findings,
)
from truths.mechanical_joint import JointExperiment, mechanical_joint


@pytest.fixture(scope="module")
def sound() -> list:
    return released()["viscosity"]


def _with_constant(recordings: list, constant: np.ndarray) -> list:
    return [replace(one, wrench=one.wrench + constant) for one in recordings]


def test_the_constant_wrench_of_a_sound_plate_is_the_limbs(sound):
    zero = plate_zero(sound)
    assert zero.mass == pytest.approx(LIMB[0], rel=1e-3)
    assert zero.moment == pytest.approx(0.0, abs=1e-3 * zero.own_moment)
    assert zero.least_mass < LIMB[0]
    assert zero.oscillation > np.linalg.norm(LIMB[1:4]) / LIMB[0]
    assert recording_findings(sound) == ()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_plate_tared_with_the_limb_on_it_is_named(sound, side):
    hanging = np.concatenate([np.zeros(3), -LIMB[0] * GRAVITY])
    tared = _with_constant(sound, -hanging)
    if side < 0:
        tared = [replace(one, wrench=-one.wrench, wrench_rows=-one.wrench_rows) for one in tared]
    (found,) = recording_findings(tared)
    assert (found.kind, found.place) == ("tare", "plate")
    assert "with the limb on it" in found.text
    assert "\n" not in found.text
    assert plate_zero(tared).mass == pytest.approx(0.0, abs=1e-3)


def test_the_viscosity_survives_a_hidden_mass(sound):
    tared = _with_constant(sound, np.concatenate([np.zeros(3), LIMB[0] * GRAVITY]))
    found = identify_specimen(
        "hidden", tared, [], options=ViscosityOptions(tare="unknown", draws=20)
    )
    assert found.without is not None
    assert np.isnan(found.without.mass.value)
    assert found.without.viscosity.value == pytest.approx(LAWS["viscosity"]["viscosity"], rel=1e-3)


def test_a_zero_that_is_off_is_named(sound):
    (found,) = recording_findings(_with_constant(sound, np.array([0.0, 0.0, 1.5, 0.0, 0.0, 0.0])))
    assert found.kind == "zero"
    assert "1.50 N m" in found.text


def test_too_few_swings_are_named(sound):
    short = [replace(sound[0], swing=np.where(sound[0].swing < 2, sound[0].swing, -1))]
    assert [one.kind for one in recording_findings(short)] == ["few swings"]


def test_a_swing_too_small_is_named():
    joint = mechanical_joint(
        "ball", 0.03, 0.0, seed=4, experiment=JointExperiment(seconds=10.0, swing=0.004)
    )
    condition = identify_specimen(
        "still", joint.swings(), [], options=ViscosityOptions(draws=60)
    ).without
    assert condition is not None
    (found,) = condition_findings(condition)
    assert (found.kind, found.place) == ("small swing", "swings")


def test_an_axis_that_does_not_turn_is_named():
    joint = mechanical_joint("ball", 0.05, 0.0, seed=4, experiment=JointExperiment(seconds=20.0))
    condition = identify_specimen(
        "wide", joint.swings(), [], options=ViscosityOptions(draws=60)
    ).without
    assert condition is not None
    assert condition_findings(condition) == ()
    doubtful = replace(condition, excited=(True, True, False))
    assert ["'z'" in one.text for one in condition_findings(doubtful)] == [True]
    level = [replace(one, rates=one.rates * [1.0, 1.0, 0.02]) for one in condition.recordings]
    (found,) = condition_findings(replace(condition, recordings=tuple(level)))
    assert (found.kind, found.place) == ("axis", "z")
    assert "axis 'z' is not excited" in found.text


def test_a_limb_that_does_not_explain_the_wrench_is_named(sound):
    noise = np.random.default_rng(0).standard_normal
    seen = [replace(one, wrench=one.wrench + 0.002 * noise(one.wrench.shape)) for one in sound]
    condition = identify_specimen("limb", seen, [], options=ViscosityOptions(draws=20)).without
    assert condition is not None
    assert condition_findings(condition) == ()
    wrong = condition.parameters * np.where(np.arange(10) == 2, 0.85, 1.0)
    (found,) = condition_findings(replace(condition, parameters=wrong))
    assert found.kind == "misfit"

"""Gaits of animals: on a made one, and on mice whose feet are seen over some strides."""

from __future__ import annotations

import numpy as np
import pytest

from made_animal import GAITS, made_animal
from myomorph.lab.analysis.animal_gait import found_gait, limb_phases
from myomorph.lab.analysis.found_movement import found_movement
from myomorph.lab.analysis.seen_body import SeenBody
from myomorph.lab.session.read import read_session

UPRIGHT = np.eye(3)


def body_of(gait: str, fore: bool = True) -> SeenBody:
    """Make the body of an animal in a gait."""
    return SeenBody.of(made_animal(gait, fore), {}, UPRIGHT)


@pytest.mark.parametrize("gait", GAITS)
def test_each_gait_is_found(gait: str) -> None:
    found = found_gait(body_of(gait))
    assert found.value == gait, found
    assert found.origin == "markers"


@pytest.mark.parametrize("gait", GAITS)
def test_phases_are_those_of_the_animal(gait: str) -> None:
    left_hind, right_fore, _, duty = GAITS[gait]
    phases = limb_phases(body_of(gait))
    assert phases is not None
    assert np.exp(2j * np.pi * phases.left_hind) == pytest.approx(
        np.exp(2j * np.pi * left_hind), abs=0.12
    )
    assert np.exp(2j * np.pi * phases.fore) == pytest.approx(
        np.exp(2j * np.pi * right_fore), abs=0.25
    )
    assert phases.duty == pytest.approx(duty, abs=0.06)


@pytest.mark.parametrize("gait", ["trot", "pace"])
def test_without_fore_feet_trot_and_pace_are_not_told_apart(gait: str) -> None:
    found = found_gait(body_of(gait, fore=False))
    assert found.value is None
    assert "look alike" in found.sentence


@pytest.mark.parametrize(
    ("gait", "movement"), [("walk", "walking"), ("trot", "running"), ("gallop", "running")]
)
def test_a_gait_is_a_movement(gait: str, movement: str) -> None:
    found = found_movement(body_of(gait))
    assert found.value == movement
    assert gait in found.sentence


def test_few_strides_show_no_gait() -> None:
    markers = made_animal("walk").frames(slice(0, 90))
    found = found_gait(SeenBody.of(markers, {}, UPRIGHT))
    assert found.value is None
    assert "enough strides" in found.sentence


def test_mice(data) -> None:
    """One goes over some strides; in the others feet are hidden most of the time."""
    session = read_session(data("mouse-gait-c3d-force"))
    sentences = {trial.name: trial.movement.sentence for trial in session.trials}
    assert "walk: the left hind foot strikes 0.5" in sentences["Cage6_none_12_01_26_trial_3"]
    assert "gait not determined" in sentences["Cage6_1L_05_01_26_trial_1"]
    assert {trial.movement.value for trial in session.trials} == {"walking"}

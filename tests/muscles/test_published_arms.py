"""Published moment arms about the knee: which models leave them, and which do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.model import Body, Joint
from myomorph.core.model.scale import scale
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.published_arms import BANDS, TOLERANCE, arm_warnings, knee_arms
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.info.inspect import inspect

RAJAGOPAL = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
WITHIN = (
    RAJAGOPAL,
    "knee-implant-walk/scaled.osim",
    "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim",
    "opencap-subject4-multitask/models/manually_scaled.osim",
)
POLYNOMIAL = "opencap-subject4-multitask/models/unscaled_generic.osim"


@pytest.mark.parametrize("path", WITHIN)
def test_models_in_common_use_lie_in_the_bands(data, path) -> None:
    model = read_osim(data(path))
    assert knee_arms(model)
    assert arm_warnings(model) == ()


def test_the_model_that_comes_along_lies_in_the_bands() -> None:
    pytest.importorskip("myo_sim")
    model, _ = generic_model({})
    found = knee_arms(model)
    assert {arms.band.name for arms in found} == {band.name for band in BANDS}
    assert arm_warnings(model) == ()


def test_a_knee_whose_tibia_slides_away_is_named_with_angle_and_size(data) -> None:
    """The knee's polynomials of this model move the tibia back by 3 cm at 120 degrees."""
    found = arm_warnings(read_osim(data(POLYNOMIAL)))
    assert len(found) == 2
    assert "vaslat_r 7.2 cm at 120° (1.2 to 3.2)" in found[0]
    assert "patellar tendon of walker_knee_r" in found[1]
    assert any("vaslat_r 7.2 cm at 120°" in line for line in inspect(data(POLYNOMIAL)).warnings)


def test_quadriceps_without_a_patellas_lever_are_named_in_deep_flexion(data) -> None:
    """Its quadriceps pull on the tibia itself.

    At 120 degrees their arm is 4.7 cm, within the band when the knee bends less.
    """
    model = read_osim(data("ceinms-emg-walk/model/gait2392.osim"))
    (line,) = arm_warnings(model)
    assert "vas_lat_r 4.7 cm at 120° (1.2 to 3.1)" in line
    arms = next(each for each in knee_arms(model) if each.name == "vas_lat_r")
    assert not arms.beyond[arms.flexion < 60.0].any()


def test_bands_grow_with_the_body(data) -> None:
    model = read_osim(data(RAJAGOPAL))
    small = scale(model, dict.fromkeys(model.body_names, np.full(3, 0.7)))
    assert arm_warnings(small) == ()
    for ours, theirs in zip(knee_arms(small), knee_arms(model), strict=True):
        np.testing.assert_allclose(ours.high, 0.7 * theirs.high)
        np.testing.assert_allclose(ours.arms, 0.7 * theirs.arms, atol=2e-3)


def test_an_arm_within_the_margin_is_no_alarm(data) -> None:
    model = read_osim(data(RAJAGOPAL))
    arms = next(each for each in knee_arms(model) if each.name == "semiten_r")
    for beyond, named in ((0.9 * TOLERANCE, False), (1.1 * TOLERANCE, True)):
        moved = replace(arms, arms=np.where(arms.flexion == 40.0, arms.high + beyond, arms.arms))
        assert bool(moved.text) == named
        assert ("semiten_r" in moved.text and "at 40°" in moved.text) == named


def test_no_person_no_band(data) -> None:
    model = read_osim(data(RAJAGOPAL))
    assert knee_arms(scale(model, dict.fromkeys(model.body_names, np.full(3, 0.1)))) == ()
    assert knee_arms(replace(model, muscles=())) == ()


def test_a_thigh_of_welded_parts_is_as_long_as_one(data) -> None:
    """A knee below the femoral part of an implant, which is welded to the femur."""
    model = read_osim(data(RAJAGOPAL))
    knee = next(joint for joint in model.joints if joint.name == "walker_knee_r")
    part = replace(model.body("patella_r"), name="femoral_component_r", mass=0.0)
    weld = replace(
        knee,
        name="implant_r",
        child=part.name,
        axes=(),
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
    )
    joints: list[Joint] = []
    for joint in model.joints:
        joints += [weld, replace(knee, parent=part.name)] if joint is knee else [joint]
    bodies: list[Body] = []
    for body in model.bodies:
        bodies += [body, part] if body.name == knee.parent else [body]
    welded = replace(model, joints=tuple(joints), bodies=tuple(bodies))

    of_muscles = [arms for arms in knee_arms(model) if arms.band.muscles]
    found = {arms.name: arms for arms in knee_arms(welded)}
    assert of_muscles
    for arms in of_muscles:
        np.testing.assert_allclose(found[arms.name].high, arms.high, rtol=1e-9)

"""The generic model with arms: its legs are those without, its arms weigh and turn as arms do."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.measurements import default_markers
from myomorph.core.motion.protocols import protocols
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analyze.analyze import prepare_request
from myomorph.lab.analyze.arms import have_arms
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest
from truths.made_arms import made_arms

pytest.importorskip("myo_sim")
LABELS = protocols().protocols["rajagopal"].labels


def test_legs_and_trunk_are_those_of_the_model_without_arms() -> None:
    plain = generic_model({}, arms=False)[0]
    whole = generic_model({}, arms=True)[0]
    assert whole.muscle_names[: len(plain.muscles)] == plain.muscle_names
    assert len(whole.muscles) == len(plain.muscles) + 100
    np.testing.assert_allclose(
        default_path_lengths(whole)[: len(plain.muscles)], default_path_lengths(plain), atol=1e-9
    )
    for before, after in zip(plain.bodies, whole.bodies, strict=False):
        assert (before.name, before.mass) == (after.name, after.mass)


def test_every_landmark_of_an_arm_has_a_place_mirrored_on_the_other_side() -> None:
    model, without = generic_model(LABELS, arms=True)
    assert without == ()
    middle = np.array([0.0, 0.0, default_markers(model, ["C7"])[0, 2]])
    for label in ("ACR", "LEL", "MEL", "FAradius", "FAulna", "SJC", "EJC"):
        right, left = default_markers(model, [f"R{label}", f"L{label}"]) - middle
        np.testing.assert_allclose(left, right * (1.0, 1.0, -1.0), atol=2e-3)


def test_a_raised_arm_takes_the_torque_of_its_weight() -> None:
    """Virtual work: the torque of elevation is the slope of the potential energy.

    The center of mass of the whole body gives that energy.
    """
    model, _ = generic_model({}, arms=True)
    tree = compile_tree(model)
    column = model.coordinate_names.index("shoulder_elv_r")

    def coordinates(angle: float) -> np.ndarray:
        values = tree.defaults[None].copy()
        values[0, column] = angle
        return tree.coordinates_of(Motion(np.zeros(1), model.coordinate_names, values))

    def energy(angle: float) -> float:
        poses = forward_kinematics(tree, coordinates(angle))
        return float(-model.mass * model.gravity[1] * center_of_mass(tree, poses)[0, 1])

    angle = np.radians(70.0)
    step = 1e-4
    values = np.tile(coordinates(angle), (3, 1))
    still = np.zeros_like(values)
    torques = inverse_dynamics(
        model,
        Motion(
            time=0.01 * np.arange(3),
            names=model.coordinate_names,
            values=values,
            velocities=still,
            accelerations=still,
        ),
    )
    # The shoulder blade follows, and its torques do work too.
    slopes = (coordinates(angle + step) - coordinates(angle - step))[0] / (2 * step)
    torque = sum(
        torques[name][1] * slope for name, slope in zip(model.coordinate_names, slopes, strict=True)
    )
    assert torque == pytest.approx(
        (energy(angle + step) - energy(angle - step)) / (2 * step), rel=1e-3
    )
    assert 5.0 < torque < 20.0


def test_no_body_turns_harder_than_its_mass_allows() -> None:
    """myo-sim gives bodies of a gram, which only carry axes, 1 kg m^2.

    Shoulders took 90 N m in a slow run.
    """
    plain = generic_model({}, arms=False)[0]
    whole = generic_model({}, arms=True)[0]
    for body in whole.bodies:
        if body.name not in plain.body_names:
            assert np.linalg.eigvalsh(body.inertia).max() <= body.mass * 0.25**2 + 1e-12, body.name


def test_an_elbow_seen_by_its_center_bends_forward() -> None:
    """Turned round at the shoulder, an arm without a marker beside the elbow fits as well."""
    model, _ = generic_model(protocols().protocols["halpe_26"].labels, arms=True)
    arms = made_arms(model, seed=1)
    motion = inverse_kinematics(model, arms.markers).motion
    for side in "rl":
        elbow = motion[f"elbow_flexion_{side}"]
        assert elbow.min() > 0.0
        error = elbow - arms.motion[f"elbow_flexion_{side}"]
        assert np.degrees(np.sqrt(np.mean(error**2))) < 6.0


def test_elbows_go_ten_degrees_beyond_straight() -> None:
    model, _ = generic_model({}, arms=True)
    for side in "rl":
        assert np.degrees(model.coordinate(f"elbow_flexion_{side}").range[0]) == pytest.approx(-10)


def test_arms_need_markers_on_two_segments_of_one(tmp_path) -> None:
    assert have_arms({label: LABELS[label] for label in ("RLEL", "RFAulna")})
    assert not have_arms({label: LABELS[label] for label in ("RLEL", "LFAulna", "RACR")})
    model, _ = generic_model(LABELS)
    labels = tuple(label for label in LABELS if label in model.marker_names)
    places = np.tile(default_markers(model, labels), (20, 1, 1))
    write_trc(Markers(np.arange(20) / 100.0, labels, places), tmp_path / "x.trc")
    prepared = prepare_request(
        AnalyzeRequest((tmp_path / "x.trc",), 70.0, arms=True), tmp_path / "out"
    )
    assert any("no markers show two segments of one (--arms)" in text for text in prepared.assumed)


def test_markers_of_an_arm_alone_move_that_arm_on_a_free_trunk(tmp_path) -> None:
    """A pushing arm, as a laboratory of shoulders labels it.

    No leg has a marker, a muscle or a contact.
    """
    sites = {
        label: site
        for label, site in protocols().protocols["montreal"].labels.items()
        if site.segment != "pelvis"
    }
    model, _ = generic_model(sites, arms=True, alone=True)
    free = {coordinate.name for coordinate in model.coordinates if not coordinate.locked}
    assert {"elbow_flexion_r", "shoulder_elv_r", "pelvis_ty"} <= free
    assert not free & {"elbow_flexion_l", "knee_angle_r", "hip_flexion_l", "lumbar_extension"}
    assert model.mass == pytest.approx(generic_model(sites, arms=True)[0].mass)
    labels = tuple(label for label in sites if label in model.marker_names)
    way = 0.1 * np.linspace(0.0, 1.0, 20)[:, None, None] * np.array([1.0, 0.0, 0.0])
    write_trc(
        Markers(np.arange(20) / 100.0, labels, default_markers(model, labels) + way),
        tmp_path / "x.trc",
    )
    prepared = prepare_request(AnalyzeRequest((tmp_path / "x.trc",), 70.0), tmp_path / "out")
    assert any("No marker is on a leg" in text for text in prepared.assumed)
    assert "contacts" not in prepared.study.read_text()
    written = read_osim(tmp_path / "out" / "generic.osim")
    assert len(written.muscles) == len(model.muscles)
    assert all(muscle.name.endswith("_r") for muscle in written.muscles)

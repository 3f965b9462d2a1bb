import dataclasses

import numpy as np
import pytest

from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.lab.analysis.columns import compared
from myomorph.lab.report.trial import tables
from walker import GRAVITY, Tension, fitted, model, motion


def _flat(time: np.ndarray, force: float) -> Wrenches:
    forces = np.zeros((len(time), 1, 3))
    forces[:, 0, 1] = force
    return Wrenches(
        time=time,
        names=("plate",),
        bodies=("pelvis",),
        forces=forces,
        points=0 * forces,
        torques=0 * forces,
    )


def test_marker_errors_are_held_against_two_and_four_centimeters() -> None:
    movement = motion(model())
    rms, largest, converged = tables.marker_verdicts(fitted(movement, 0.01))
    assert rms.value == pytest.approx(100 * np.sqrt((0.01**2 + 0.03**2) / 2))
    assert (rms.state, rms.limit) == ("over", 2.0)
    assert (largest.value, largest.state, largest.worst) == (pytest.approx(3.0), "ok", "RKNE")
    assert converged.state == "ok"
    assert [one.state for one in tables.marker_verdicts(fitted(movement, 0.014))][:2] == [
        "over",
        "over",
    ]


def test_small_bodies_have_small_limits() -> None:
    cloud = np.zeros((3, 2, 3))
    cloud[:, 1, 0] = 0.085
    scale = tables.body_scale(Markers(np.arange(3.0), ("a", "b"), cloud))
    assert scale == pytest.approx(0.05)
    assert tables.body_scale(Markers(np.arange(3.0), ("a", "b"), 20 * cloud)) == 1.0
    first, *_ = tables.marker_verdicts(fitted(motion(model()), 0.001), scale)
    assert (first.limit, first.state) == (pytest.approx(0.1), "over")


def test_frames_that_did_not_converge_are_counted() -> None:
    fit = fitted(motion(model()))
    flags = np.array(fit.converged)
    flags[[4, 9]] = False
    *_, row = tables.marker_verdicts(dataclasses.replace(fit, converged=flags))
    assert (row.value, row.state, row.time) == (2.0, "over", pytest.approx(0.04))


def test_residuals_follow_hicks() -> None:
    body = model()
    time = np.arange(50) / 50
    values = np.zeros((50, len(body.coordinates)))
    values[10, body.coordinate_names.index("pelvis_tx")] = 30.0
    values[10, body.coordinate_names.index("pelvis_ty")] = 40.0
    values[20, body.coordinate_names.index("pelvis_tilt")] = 12.0
    torques = Series(time, body.coordinate_names, values)
    rows = {
        one.quantity: one
        for one in tables.residual_verdicts(body, torques, _flat(time, 800.0), 1.0)
    }
    peak = rows["Residual force, peak"]
    assert (peak.value, peak.state, peak.time) == (
        pytest.approx(100 * 50 / 800),
        "over",
        pytest.approx(0.2),
    )
    assert rows["Residual force, RMS"].value == pytest.approx(100 * 50 / 800 / np.sqrt(50))
    moment = rows["Residual moment, peak"]
    assert (moment.value, moment.state) == (pytest.approx(100 * 12 / 800), "over")


def test_a_step_beside_the_plates_is_suggested() -> None:
    body = model()
    time = np.arange(10) / 10
    values = np.zeros((10, len(body.coordinates)))
    values[:, body.coordinate_names.index("pelvis_ty")] = 0.9 * body.mass * GRAVITY
    forces = np.zeros((10, 1, 3))
    forces[5, 0, 1] = 700.0
    wrenches = Wrenches(
        time=time,
        names=("plate",),
        bodies=("pelvis",),
        forces=forces,
        points=0 * forces,
        torques=0 * forces,
    )
    peak, *_ = tables.residual_verdicts(
        body, Series(time, body.coordinate_names, values), wrenches, 1.0
    )
    assert "beside the plates" in peak.detail
    peak, *_ = tables.residual_verdicts(
        body, Series(time, body.coordinate_names, values), _flat(time, 600.0), 1.0
    )
    assert "beside the plates" not in peak.detail


RESERVED = ("hip_flexion_r", "knee_angle_r")  # Coordinates of the reserves.


def test_reserves_are_shares_of_the_peak_torque() -> None:
    body = model()
    movement = motion(body)
    tension = Tension(body, movement.time)
    torques = Series(
        movement.time, body.coordinate_names, np.full((200, len(body.coordinates)), 10.0)
    )
    reserves = Series(movement.time, RESERVED, tension.actuator_force)
    rows = tables.reserve_verdicts(body, torques, reserves)
    assert (rows[0].worst, rows[0].value, rows[0].state) == (
        "knee_angle_r",
        pytest.approx(20.0),
        "over",
    )
    driven = tables.reserve_verdicts(body, torques, reserves, ("hip_flexion_r",))
    assert (driven[0].worst, driven[0].state) == ("hip_flexion_r", "ok")
    assert (driven[1].worst, driven[1].state) == ("knee_angle_r", "note")


def test_saturated_muscles_are_named() -> None:
    activations = np.full((10, 3), 0.5)
    activations[3:6, 1] = 1.0
    activations[8] = np.nan
    (row,) = tables.saturation_verdicts(("a", "b", "c"), activations, np.ones(3), np.arange(10.0))
    assert (row.value, row.state, row.worst, row.time) == (1.0, "over", "b", 3.0)
    assert "30.0 % of frames" in row.detail


def test_gaps_and_ranges_are_told() -> None:
    values = np.zeros((10, 2, 3))
    values[2:5, 1] = np.nan
    (gap,) = tables.gap_verdicts(Markers(np.arange(10.0), ("a", "b"), values))
    assert (gap.value, gap.worst, gap.time, gap.state) == (pytest.approx(30.0), "b", 2.0, "note")
    body = model()
    beyond = np.array(motion(body).values)
    beyond[7, body.coordinate_names.index("hip_flexion_l")] = 2.5
    (row,) = tables.range_verdicts(body, Motion(motion(body).time, body.coordinate_names, beyond))
    assert (row.worst, row.state, row.time) == ("hip_flexion_l", "over", pytest.approx(0.07))


def test_an_estimate_is_compared_where_both_are_known() -> None:
    time = np.linspace(0.0, 1.0, 101)
    truth = Series(time, ("a", "b"), np.stack([np.sin(6 * time), time], axis=1))
    estimate = Series(
        time[10:90],
        ("b", "a", "c"),
        np.stack([time + 0.5, np.sin(6 * time) * 1.0, time], axis=1)[10:90],
    )
    first, second = compared(estimate, truth)
    assert (first.name, first.rmse, first.correlation) == (
        "a",
        pytest.approx(0.0, abs=1e-12),
        pytest.approx(1.0),
    )
    assert (second.name, second.rmse, second.worst) == ("b", pytest.approx(0.5), pytest.approx(0.5))

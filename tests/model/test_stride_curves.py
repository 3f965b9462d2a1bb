"""Curves over strides that strides, events or times mark, each over those of its own foot."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm

TIME = np.linspace(0.0, 6.0, 601)
PERIOD = 1.2
LATE = 0.6


def angles():
    """Two knees that bend as sines of the stride: the left half a stride later."""
    phase = 2.0 * np.pi * TIME / PERIOD
    left = 2.0 * np.pi * (TIME - LATE) / PERIOD
    values = np.stack([np.sin(phase), np.sin(left), TIME], axis=1)
    return mm.Series(TIME, ("knee_angle_r", "knee_angle_l", "pelvis_tx"), values)


def strikes():
    return {"right": np.arange(0.0, 6.1, PERIOD), "left": np.arange(LATE, 6.1, PERIOD)}


def test_each_side_is_cut_at_its_own_strikes():
    curves = angles().strides(strikes())
    sine = np.sin(np.linspace(0.0, 2.0 * np.pi, 101))
    assert curves["knee_angle_r"].shape == (5, 101)
    assert curves["knee_angle_l"].shape == (4, 101)
    np.testing.assert_allclose(curves.mean("knee_angle_r"), sine, atol=1e-3)
    np.testing.assert_allclose(curves.mean("knee_angle_l"), sine, atol=1e-3)
    np.testing.assert_allclose(curves.sd("knee_angle_l"), 0.0, atol=1e-3)


def test_a_name_without_a_side_goes_with_the_first_foot():
    curves = angles().strides(strikes())
    assert curves.sides[:2] == ("right", "left")
    np.testing.assert_allclose(curves["pelvis_tx"][:, 0], curves.start[::2][:5], atol=1e-12)


def test_mean_and_deviation_of_all_names_have_their_shapes():
    curves = angles().strides(strikes())
    assert curves.mean().shape == curves.sd().shape == (101, 3)
    np.testing.assert_allclose(curves.mean()[:, 1], curves.mean("knee_angle_l"))
    one = angles().strides({"right": [0.0, PERIOD]})
    assert np.isnan(one.sd("knee_angle_r")).all()


def test_events_of_a_recording_mark_strides():
    events = [
        mm.Event(time, label, side)
        for side, times in strikes().items()
        for time in times
        for label in ("Foot Strike",)
    ]
    events.append(mm.Event(0.3, "Foot Off", "Right"))
    curves = angles().strides(events)
    np.testing.assert_allclose(curves.values, angles().strides(strikes()).values)


def test_strides_of_one_side_are_taken():
    curves = angles().strides(strikes()).of("left")
    assert len(curves) == 4
    assert set(curves.sides) == {"left"}
    with pytest.raises(mm.UnknownName, match="'tail'"):
        curves.of("tail")


def test_a_foot_without_strides_has_no_curve():
    curves = angles().strides({"left": strikes()["left"]})
    assert curves["knee_angle_r"].shape == (0, 101)
    assert np.isnan(curves.mean("knee_angle_r")).all()


@pytest.mark.parametrize("nothing", [None, [], {"right": [1.0]}, 3])
def test_what_marks_no_stride_is_said(nothing):
    with pytest.raises(mm.BadData, match="strikes: "):
        angles().strides(nothing)


def test_an_unknown_curve_is_named():
    with pytest.raises(mm.UnknownName, match="knee_angle_r"):
        angles().strides(strikes())["knee"]


def test_tables_have_plain_columns():
    pytest.importorskip("pandas")
    curves = angles().strides(strikes())
    frame = curves.to_pandas()
    assert list(frame.columns) == list(curves.names)
    assert frame.index.names == ["foot", "stride", "percent"]
    right = frame.loc["right"]["knee_angle_r"].groupby("percent").mean()
    np.testing.assert_allclose(right.to_numpy(), curves.mean("knee_angle_r"))
    dataset = curves.to_xarray()
    assert dataset["values"].dims == ("stride", "percent", "name")
    assert list(dataset["side"].values) == list(curves.sides)


def test_vectors_have_one_column_an_axis():
    loads = mm.Wrenches(
        TIME,
        ("right foot",),
        ("calcn_r",),
        np.ones((601, 1, 3)) * TIME[:, None, None],
        np.zeros((601, 1, 3)),
        np.zeros((601, 1, 3)),
    )
    curves = loads.strides(strikes(), "external_force_vector")
    assert curves.names == ("right foot_x", "right foot_y", "right foot_z")
    assert curves.units == ("N", "N", "N")
    np.testing.assert_allclose(curves.values[0, -1], PERIOD)

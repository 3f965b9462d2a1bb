"""Drawings of curves: what is drawn where, in which unit and color."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.model import plots
from myomorph.lab.study.trial import load as loading

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

TIME = np.linspace(0.0, 3.0, 301)
NAMES = ("pelvis_tx", "knee_angle_r", "knee_angle_l")
KINDS = {"pelvis_tx": "translational", "knee_angle_r": "rotational", "knee_angle_l": "rotational"}


@pytest.fixture(autouse=True)
def closed():
    yield
    matplotlib.pyplot.close("all")


def motion(kinds=KINDS):
    values = np.stack([TIME, np.sin(TIME), np.cos(TIME)], axis=1)
    return mm.Motion(TIME, NAMES, values, motion_kinds=kinds)


def test_sides_of_a_name_share_a_panel_in_their_colors():
    (axes,) = motion().plot(["knee_angle"])
    right, left = axes.lines
    assert (right.get_color(), right.get_linestyle()) == ("#0072b2", "-")
    assert (left.get_color(), left.get_linestyle()) == ("#c25200", "--")
    np.testing.assert_allclose(right.get_ydata(), np.degrees(np.sin(TIME)))
    assert axes.get_ylabel() == "[°]"
    assert axes.get_xlabel() == "time [s]"
    assert axes.get_title(loc="left") == "knee_angle"


def test_colors_are_those_of_the_report():
    from importlib.resources import files

    sheet = (files("myomorph.lab.report") / "templates" / "answer.css").read_text("utf-8")
    light = sheet.split("@media")[0]
    for side in ("right", "left"):
        assert f"--side-{side}: {plots.STYLES[side].color};" in light


def test_lengths_stay_meters_and_what_is_not_known_is_left_as_it_is():
    tx, _ = motion().plot()
    assert tx.get_ylabel() == "[m]"
    np.testing.assert_allclose(tx.lines[0].get_ydata(), TIME)
    (unknown,) = motion(None).plot(["knee_angle_r"])
    assert unknown.get_ylabel() == "[rad or m]"
    np.testing.assert_allclose(unknown.lines[0].get_ydata(), np.sin(TIME))


def test_many_curves_are_drawn_by_their_size():
    names = tuple(f"muscle{k}_{side}" for k in range(20) for side in "rl")
    values = np.sin(TIME)[:, None] * np.repeat(np.arange(20.0), 2)
    drawn = mm.Series(TIME, names, values).plot()
    titles = [axes.get_title(loc="left") for axes in drawn]
    assert titles == [f"muscle{k}" for k in range(8, 20)]


def test_an_unknown_curve_is_named():
    with pytest.raises(mm.UnknownName, match="knee_angle_r"):
        motion().plot(["knee_angel_r"])


def test_axes_that_are_given_are_drawn_into():
    _, axes = matplotlib.pyplot.subplots(1, 2)
    drawn = motion().plot(["pelvis_tx", "knee_angle"], axes=axes)
    assert list(drawn) == list(axes)
    with pytest.raises(mm.BadData, match="2 panels"):
        motion().plot(["pelvis_tx", "knee_angle"], axes=axes[0])


def test_few_strides_are_drawn_each_and_many_have_a_band():
    few = motion().strides({"right": [0.0, 1.0, 2.0]})
    (axes,) = few.plot(["knee_angle_r"])
    assert len(axes.lines) == 3
    assert not axes.collections
    many = motion().strides({"right": np.linspace(0.0, 3.0, 7)})
    (axes,) = many.plot(["knee_angle_r"])
    assert len(axes.lines) == 1
    assert len(axes.collections) == 1
    np.testing.assert_allclose(axes.lines[0].get_ydata(), np.degrees(many.mean("knee_angle_r")))


def test_forces_have_a_panel_an_axis():
    loads = mm.Wrenches(
        TIME,
        ("right foot", "left foot"),
        ("calcn_r", "calcn_l"),
        np.sin(TIME)[:, None, None] * np.ones((301, 2, 3)),
        np.zeros((301, 2, 3)),
        np.zeros((301, 2, 3)),
    )
    drawn = loads.plot(quantity="external_force_vector")
    assert [axes.get_title(loc="left") for axes in drawn] == ["foot_x", "foot_y", "foot_z"]
    assert [len(axes.lines) for axes in drawn] == [2, 2, 2]


def test_intervals_are_bands():
    columns = motion().curve_columns()
    limits = plots.Limits(columns.values - 0.1, columns.values + 0.1)
    (axes,) = plots.plot_over_time(columns, ["knee_angle_r"], limits=limits)
    (band,) = axes.collections
    ends = band.get_paths()[0].vertices[:, 1]
    assert ends.max() == pytest.approx(np.degrees(np.sin(TIME).max() + 0.1))


def test_a_missing_matplotlib_is_named_with_its_extra(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(mm.MyomorphError, match=r"myomorph\[plot\]"):
        motion().plot()


def test_tables_have_plain_columns_and_units():
    pytest.importorskip("pandas")
    frame = motion().to_pandas("coordinate_value")
    assert list(frame.columns) == list(NAMES)
    assert frame.index.name == "time"
    assert frame.attrs["units"] == {"pelvis_tx": "m", "knee_angle_r": "rad", "knee_angle_l": "rad"}
    assert motion().to_pandas().attrs["units"] == frame.attrs["units"]


def test_results_of_a_trial_are_drawn_by_the_same_module():
    assert loading.plot_over_time is plots.plot_over_time

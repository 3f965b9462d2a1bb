"""Values as xarray and pandas hold them: the same numbers under the same names."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from myomorph.core.model.contacts import ContactForces
from myomorph.core.model.errors import BadData, MissingPackage, UnknownName
from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.core.model.surface import Surface, turned_outward
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.muscles.kinematics import MuscleKinematics
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.core.tension.quantities import TENSION
from myomorph.core.tension.tension import Tension

TIME = np.arange(5) / 10.0
VALUES = np.random.default_rng(0).normal(size=(5, 2))
POINTS = np.random.default_rng(1).normal(size=(5, 2, 3))


def test_a_series_has_a_column_a_name():
    pytest.importorskip("xarray")
    frame = Series(TIME, ("a", "b"), VALUES).to_pandas()
    assert list(frame.columns) == ["a", "b"]
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame["b"], VALUES[:, 1])


def test_markers_have_a_column_an_axis():
    pytest.importorskip("xarray")
    markers = Markers(TIME, ("a", "b"), POINTS)
    np.testing.assert_array_equal(markers.to_pandas()["b", "z"], POINTS[:, 1, 2])
    dataset = markers.to_xarray()
    position = dataset["recorded_marker_position"].sel(recorded_marker="a", axis="y")
    np.testing.assert_array_equal(position, POINTS[:, 0, 1])


def test_derivatives_come_where_they_are_known():
    pytest.importorskip("xarray")
    motion = Motion(time=TIME, names=("a", "b"), values=VALUES, velocities=2.0 * VALUES)
    assert set(motion.to_xarray()) == {"coordinate_value", "coordinate_velocity"}
    velocity = motion.to_pandas()["coordinate_velocity", "a"]
    np.testing.assert_array_equal(velocity, 2.0 * VALUES[:, 0])


def test_forces_have_units():
    pytest.importorskip("xarray")
    wrenches = Wrenches(
        time=TIME,
        names=("left", "right"),
        bodies=("foot_l", "foot_r"),
        forces=POINTS,
        points=POINTS,
        torques=POINTS,
    )
    dataset = wrenches.to_xarray()
    assert {name: one.attrs["units"] for name, one in dataset.items()} == {
        "external_force_vector": "N",
        "external_force_point": "m",
        "external_free_torque": "N m",
    }


def test_a_missing_package_is_named_with_its_extra(monkeypatch):
    for name in ("xarray", "pandas", "igl"):
        monkeypatch.setitem(sys.modules, name, None)
    series = Series(TIME, ("a", "b"), VALUES)
    with pytest.raises(MissingPackage, match=r"needs the package 'xarray': .*myomorph\[xarray\]"):
        series.to_xarray()
    with pytest.raises(MissingPackage, match="needs the package 'pandas'"):
        series.to_pandas()
    pillow = Surface(np.eye(3), np.array([[0, 1, 2], [0, 1, 2]]))
    with pytest.raises(MissingPackage, match=r"needs the package 'libigl': .*myomorph\[morph\]"):
        turned_outward(pillow.vertices, pillow.faces)


def test_a_curve_is_found_by_name():
    motion = Motion(time=TIME, names=("a", "b"), values=VALUES, velocities=2.0 * VALUES)
    np.testing.assert_array_equal(motion.curve("coordinate_velocity", "b"), 2.0 * VALUES[:, 1])
    np.testing.assert_array_equal(motion.curve("coordinate_value"), VALUES)


@pytest.mark.parametrize(
    ("labels", "error"),
    [(("coordinate_velocity", "a"), UnknownName), (("coordinate_value", "c"), UnknownName)],
)
def test_a_curve_that_is_not_there_is_said(labels, error):
    with pytest.raises(error):
        Motion(time=TIME, names=("a", "b"), values=VALUES).curve(*labels)


def test_a_curve_has_no_more_labels_than_axes():
    with pytest.raises(BadData, match="axes"):
        Motion(time=TIME, names=("a", "b"), values=VALUES).curve("coordinate_value", "a", "b")


@pytest.mark.parametrize(
    "value", [ContactForces, JointContactForces, KinematicsFit, MuscleKinematics, Tension]
)
def test_results_call_their_numbers_as_files_do(value):
    numbers = [*value.quantities, *TENSION] if value is Tension else value.quantities
    assert all(
        quantity.field == quantity.name
        for quantity in numbers
        if quantity.kind == "number" and quantity.dims[0] == "time"
    )

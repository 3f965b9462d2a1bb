"""Angles whose unit the head of a table does not state, or states wrongly."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, motion_notes, read_sto


@pytest.fixture
def read(arm, tmp_path):
    """Read angles and notes of a table of the arm's coordinates with a line in its head."""
    model = read_osim(arm.model)
    shoulder, elbow = model.coordinate_names

    def motion(values, line=""):
        rows = "\n".join(f"{i / 50:g}\t{a:.6g}\t{b:.6g}" for i, (a, b) in enumerate(values))
        path = tmp_path / "reach.mot"
        path.write_text(
            f"reach\nversion=1\nnRows={len(values)}\nnColumns=3\n{line}endheader\n"
            f"time\t{shoulder}\t{elbow}\n{rows}\n",
            encoding="utf-8",
        )
        table = read_sto(path)
        return motion_from_table(table, model).values, motion_notes(table, model)

    return motion


RADIANS = np.column_stack([np.linspace(0.1, 1.4, 30), np.linspace(0.3, 2.0, 30)])


def test_angles_far_outside_of_their_ranges_are_degrees(read):
    values, (note,) = read(np.degrees(RADIANS))
    np.testing.assert_allclose(values, RADIANS, atol=1e-4)
    assert "taken as degrees" in note
    assert note.severity == "changes results"


def test_angles_within_their_ranges_are_radians(read):
    values, notes = read(RADIANS)
    np.testing.assert_allclose(values, RADIANS, atol=1e-4)
    assert notes == ()


def test_a_head_that_states_the_unit_is_believed(read):
    values, (note,) = read(np.degrees(RADIANS), "inDegrees=no\n")
    np.testing.assert_allclose(values, np.degrees(RADIANS), rtol=1e-5)
    assert "are they degrees?" in note
    values, notes = read(np.degrees(RADIANS), "inDegrees=yes\n")
    np.testing.assert_allclose(values, RADIANS, atol=1e-4)
    assert notes == ()


def test_angles_that_are_neither_are_left_with_a_note(read):
    values, (note,) = read(100.0 * np.degrees(RADIANS))
    np.testing.assert_allclose(values, 100.0 * np.degrees(RADIANS), rtol=1e-5)
    assert "taken as radians" in note


JOINT = """
<CustomJoint name="ground_pelvis"><socket_parent_frame>/ground</socket_parent_frame>
<socket_child_frame>/bodyset/pelvis</socket_child_frame>
<coordinates><Coordinate name="pelvis_ty"/><Coordinate name="knee"/></coordinates>
<SpatialTransform>
<TransformAxis name="rotation3"><coordinates>knee</coordinates><axis>0 0 1</axis>
<LinearFunction><coefficients>1 0</coefficients></LinearFunction></TransformAxis>
<TransformAxis name="translation2"><coordinates>pelvis_ty</coordinates><axis>0 1 0</axis>
<LinearFunction><coefficients>1 0</coefficients></LinearFunction></TransformAxis>
</SpatialTransform></CustomJoint>
"""
RISING = f"""<OpenSimDocument Version="40000"><Model name="rising"><gravity>0 -9.81 0</gravity>
<BodySet><objects><Body name="pelvis"><mass>10</mass><inertia>1 1 1 0 0 0</inertia></Body></objects>
</BodySet><JointSet><objects>{JOINT}</objects></JointSet></Model></OpenSimDocument>"""


@pytest.mark.parametrize(("rise", "named"), [(0.05, True), (0.004, False)])
def test_radians_of_a_body_that_rises_on_the_spot_are_named(tmp_path, rise, named):
    """Legs that turn by a degree lower nobody by centimeters; who sways is not lowered by them."""
    osim = tmp_path / "rising.osim"
    osim.write_text(RISING, encoding="utf-8")
    phase = np.linspace(0.0, 3.0, 40)
    rows = (f"{t:.4g}\t{0.9 + rise * np.sin(t):.6g}\t{0.6 * np.sin(t):.6g}\n" for t in phase)
    path = tmp_path / "rise.mot"
    head = "rise\nversion=1\nnRows=40\nnColumns=3\ninDegrees=yes\nendheader\n"
    path.write_text(f"{head}time\tpelvis_ty\tknee\n{''.join(rows)}", encoding="utf-8")
    notes = motion_notes(read_sto(path), read_osim(osim))
    assert ["are they radians?" in note for note in notes] == ([True] if named else [])

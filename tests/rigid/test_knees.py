"""Knees by the names of their bodies, and the coordinate that bends them."""

from __future__ import annotations

from dataclasses import replace

from myomorph.core.rigid.knees import flexion_coordinate, knee_joints
from stick_figure import stick_figure


def test_a_knee_is_bent_by_its_first_rotation_that_is_not_locked():
    """A knee that slides, twists under lock, and then bends; one that only slides has none."""
    model = stick_figure()
    knee = next(joint for joint in model.joints if joint.child == "tibia_r")
    assert {joint.child for joint in knee_joints(model)} == {"tibia_r", "tibia_l"}
    (bend,) = knee.axes
    names = ("slide", "twist", *knee.coordinates)
    wide = replace(
        knee, axes=tuple(replace(bend, coordinates=(name,)) for name in names), coordinates=names
    )
    hinge = model.coordinate(knee.coordinates[0])
    slide = replace(hinge, name="slide", motion="translational")
    twist = replace(hinge, name="twist", locked=True)
    loose = replace(
        model,
        joints=tuple(wide if joint is knee else joint for joint in model.joints),
        coordinates=(*model.coordinates, slide, twist),
    )
    assert flexion_coordinate(loose, wide) == hinge.name
    assert flexion_coordinate(loose, replace(wide, axes=wide.axes[:2], coordinates=names[:2])) == ""

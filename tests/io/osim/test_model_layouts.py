"""Layouts of OpenSim documents: inner classes, parts as components, coordinates of one name."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import motion_from_table
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Table

CONTACT = """<HuntCrossleyForce name="heel_on_floor">
<HuntCrossleyForce::ContactParametersSet name="contact_parameters"><objects>
<HuntCrossleyForce::ContactParameters><geometry>heel floor</geometry><stiffness>5e7</stiffness>
</HuntCrossleyForce::ContactParameters></objects></HuntCrossleyForce::ContactParametersSet>
</HuntCrossleyForce>"""


def _body(name: str, mass: float) -> str:
    return (
        f'<Body name="{name}"><mass>{mass}</mass><mass_center>0 -0.2 0</mass_center>'
        "<inertia>0.02 0.01 0.02 0 0 0</inertia></Body>"
    )


def _pin(name: str, parent: str, child: str, coordinate: str) -> str:
    return (
        f'<PinJoint name="{name}"><socket_parent_frame>{parent}</socket_parent_frame>'
        f"<socket_child_frame>{name}_child</socket_child_frame><coordinates>"
        f'<Coordinate name="{coordinate}"><range>-2 2</range></Coordinate></coordinates><frames>'
        f'<PhysicalOffsetFrame name="{name}_child"><socket_parent>{child}</socket_parent>'
        "<translation>0 0.25 0</translation></PhysicalOffsetFrame></frames></PinJoint>"
    )


def _muscle(name: str, first: str, second: str) -> str:
    points = "".join(
        f'<PathPoint name="{name}-P{i}"><socket_parent_frame>{frame}</socket_parent_frame>'
        f"<location>0.03 {0.05 * i} 0</location></PathPoint>"
        for i, frame in enumerate((first, second))
    )
    return (
        f'<Millard2012EquilibriumMuscle name="{name}"><GeometryPath name="path"><PathPointSet>'
        f"<objects>{points}</objects></PathPointSet></GeometryPath></Millard2012EquilibriumMuscle>"
    )


def _objects(tag: str, inside: str) -> str:
    return f'<{tag} name="{tag.lower()}"><objects>{inside}</objects></{tag}>'


def _document(inside: str) -> str:
    return (
        '<?xml version="1.0"?><OpenSimDocument Version="40600"><Model name="leg">'
        f"{inside}</Model></OpenSimDocument>"
    )


@pytest.fixture
def read(tmp_path):
    """Read a document with these parts of a model."""

    def model(inside: str):
        path = tmp_path / "leg.osim"
        path.write_text(_document(inside), encoding="utf-8")
        return read_osim(path)

    return model


def _in_sets(forces: str = "", coordinates: tuple[str, str] = ("hip", "knee")) -> str:
    upper, lower = coordinates
    joints = _pin("hip_joint", "/ground", "/bodyset/thigh", upper) + _pin(
        "knee_joint", "/bodyset/thigh", "/bodyset/shank", lower
    )
    return (
        _objects("BodySet", _body("thigh", 7.0) + _body("shank", 3.0))
        + _objects("JointSet", joints)
        + _objects("ForceSet", _muscle("vastus", "/bodyset/thigh", "/bodyset/shank") + forces)
    )


def test_an_inner_class_is_read_and_written_with_its_colons(read, tmp_path):
    model = read(_in_sets(CONTACT))
    assert model.mass == 10.0
    assert model.muscle_names == ("vastus",)
    (warning,) = model.warnings
    assert "heel_on_floor" in warning
    assert "contact force is left out" in warning
    copy = tmp_path / "copy.osim"
    write_osim(model, copy)
    text = copy.read_text(encoding="utf-8")
    assert text.count("<HuntCrossleyForce::ContactParameters>") == 1
    assert text.count("</HuntCrossleyForce::ContactParametersSet>") == 1
    assert ".colons." not in text
    assert read_osim(copy).warnings == model.warnings


def test_colons_do_not_hide_a_file_that_is_cut_off(tmp_path):
    path = tmp_path / "cut.osim"
    path.write_text(_document(_in_sets(CONTACT))[:-300], encoding="utf-8")
    with pytest.raises(BadFile, match="cut off"):
        read_osim(path)


def test_parts_as_components_are_those_of_the_sets(read):
    thigh = "/thigh"
    shank = "/shank"
    components = (
        _body("thigh", 7.0)
        + _body("shank", 3.0)
        + _pin("hip_joint", "/ground", thigh, "hip")
        + _pin("knee_joint", thigh, shank, "knee")
        + _muscle("vastus", thigh, shank)
        + "<CoordinateActuator name='motor'><coordinate>/knee_joint/knee</coordinate>"
        "<optimal_force>5</optimal_force></CoordinateActuator>"
        + "<Marker name='toe'><socket_parent_frame>/shank</socket_parent_frame>"
        "<location>0.1 -0.4 0</location></Marker>"
    )
    model = read(f"<components>{components}</components>")
    other = read(_in_sets())
    assert model.warnings == ()
    assert model.body_names == other.body_names == ("thigh", "shank")
    assert model.coordinate_names == other.coordinate_names
    for joint, same in zip(model.joints, other.joints, strict=True):
        np.testing.assert_array_equal(joint.child_frame.translation, same.child_frame.translation)
    for point, same in zip(model.muscles[0].path.points, other.muscles[0].path.points, strict=True):
        assert point.body == same.body
        np.testing.assert_array_equal(point.location, same.location)
    assert model.actuators[0].coordinate == "knee"
    assert model.markers[0].body == "shank"


def test_parts_left_among_the_components_name_the_moved_ones(read):
    inside = (
        _body("thigh", 7.0)
        + _pin("hip_joint", "/ground", "/thigh", "hip")
        + "<PhysicalOffsetFrame name='sensor'><socket_parent>/thigh</socket_parent>"
        "<translation>0.1 0 0</translation></PhysicalOffsetFrame>"
    )
    model = read(f"<components>{inside}</components>")
    (frame,) = [frame for frame in model.frames if frame.name == "sensor"]
    assert frame.body == "thigh"


def test_coordinates_of_one_name_are_told_apart_by_their_joints(read, tmp_path):
    motor = (
        "<CoordinateActuator name='motor'><coordinate>/jointset/knee_joint/rz</coordinate>"
        "<optimal_force>5</optimal_force></CoordinateActuator>"
    )
    model = read(_in_sets(motor, ("rz", "rz")))
    assert model.coordinate_names == ("rz", "rz_0")
    assert model.joints[1].coordinates == ("rz_0",)
    assert model.actuators[0].coordinate == "rz_0"
    (warning,) = model.warnings
    assert warning == "two coordinates are named 'rz': that of joint 'knee_joint' is called 'rz_0'"
    names = ("/jointset/knee_joint/rz/value", "/jointset/hip_joint/rz/value")
    motion = motion_from_table(Table([0.0, 0.1], names, [[0.2, 0.7], [0.3, 0.8]]), model)
    np.testing.assert_array_equal(motion["rz"], [0.7, 0.8])
    np.testing.assert_array_equal(motion["rz_0"], [0.2, 0.3])
    copy = tmp_path / "copy.osim"
    assert write_osim(model, copy) == ()
    assert read_osim(copy).coordinate_names == model.coordinate_names

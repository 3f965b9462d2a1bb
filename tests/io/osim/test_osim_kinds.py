"""Each joint, frame, function and constraint in a small document, compared with OpenSim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import opensim_oracle
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from osim_models import body_poses, point_place, random_values

pytest.importorskip("opensim")
TIGHT = 1e-9
KINDS = {
    "Free": ("rx", "ry", "rz", "tx", "ty", "tz"),
    "Ball": ("rx", "ry", "rz"),
    "Gimbal": ("rx", "ry", "rz"),
    "Universal": ("rx", "ry"),
    "Planar": ("rz", "tx", "ty"),
    "Slider": ("tx",),
    "Pin": ("rz",),
    "Ellipsoid": ("rx", "ry", "rz"),
    "Scapulothoracic": ("abduction", "elevation", "upward", "winging"),
    "Weld": (),
}
SPLINE = "<x>-2 -1.3 -0.5 0.1 0.8 1.4 2</x><y>0.1 0.5 -0.2 0.3 0.6 0.4 -0.1</y>"
FUNCTIONS = {
    "linear": "<LinearFunction><coefficients>-0.7 0.2</coefficients></LinearFunction>",
    "polynomial": (
        "<PolynomialFunction><coefficients>0.1 -0.3 0.2 0.5</coefficients></PolynomialFunction>"
    ),
    "simm": f"<SimmSpline>{SPLINE}</SimmSpline>",
    "three": "<SimmSpline><x>-1 0 1.5</x><y>0.2 0.1 0.4</y></SimmSpline>",
    "two": "<SimmSpline><x>-1 1.5</x><y>0.2 0.4</y></SimmSpline>",
    "lines": f"<PiecewiseLinearFunction>{SPLINE}</PiecewiseLinearFunction>",
    "multiplied": (
        f"<MultiplierFunction><function><SimmSpline>{SPLINE}</SimmSpline></function>"
        "<scale>-1.7</scale></MultiplierFunction>"
    ),
    "sine": (
        "<Sine><amplitude>0.4</amplitude><omega>1.3</omega><phase>0.2</phase><offset>0.1</offset></Sine>"
    ),
    "gcv": f"<GCVSpline><half_order>3</half_order>{SPLINE}</GCVSpline>",
    "gcv_cubic": f"<GCVSpline><half_order>2</half_order>{SPLINE}</GCVSpline>",
    "step": (
        "<StepFunction><transition_start_time>-0.5</transition_start_time><transition_end_time>0.9"
        "</transition_end_time><start_value>-0.2</start_value><end_value>0.7</end_value></StepFunction>"
    ),
}


def _document(inside: str, version: int = 40600) -> str:
    model = f'<Model name="made">{inside}</Model>'
    return f'<?xml version="1.0"?><OpenSimDocument Version="{version}">{model}</OpenSimDocument>'


def _set(tag: str, inside: str) -> str:
    return f'<{tag} name="{tag.lower()}"><objects>{inside}</objects></{tag}>'


def _numbers(values) -> str:
    return " ".join(repr(float(one)) for one in values)


def _frame(name: str, parent: str, random, inside: str = "") -> str:
    place = random.uniform(-0.4, 0.4, 3)
    turn = random.uniform(-0.5, 0.5, 3)
    return (
        f'<PhysicalOffsetFrame name="{name}">{inside}<socket_parent>{parent}</socket_parent>'
        f"<translation>{_numbers(place)}</translation><orientation>{_numbers(turn)}</orientation></PhysicalOffsetFrame>"
    )


def _body(name: str, random, inside: str = "") -> str:
    center = _numbers(random.uniform(-0.1, 0.1, 3))
    return (
        f'<Body name="{name}">{inside}<mass>1.5</mass><mass_center>{center}</mass_center>'
        "<inertia>0.02 0.03 0.04 0.001 0.002 -0.001</inertia></Body>"
    )


def _coordinate(name: str) -> str:
    return (
        f'<Coordinate name="{name}"><default_value>0.1</default_value><range>-1.4'
        " 1.4</range></Coordinate>"
    )


def _joint(kind: str, name: str, parent: str, child: str, random, inside: str = "") -> str:
    coordinates = "".join(_coordinate(f"{name}_{one}") for one in KINDS.get(kind, ()))
    return (
        f'<{kind}Joint name="{name}"><socket_parent_frame>outboard</socket_parent_frame>'
        f"<socket_child_frame>inboard</socket_child_frame><coordinates>{coordinates}</coordinates>"
        f"<frames>{_frame('outboard', parent, random)}{_frame('inboard', child, random)}</frames>"
        f"{inside}</{kind}Joint>"
    )


def all_joints(path: Path) -> None:
    """Write a chain of all joint classes, ending between nested offset frames, with a muscle."""
    random = np.random.default_rng(3)
    settings = {
        "Ellipsoid": "<radii_x_y_z>0.1 0.2 0.3</radii_x_y_z>",
        "Scapulothoracic": (
            "<thoracic_ellipsoid_radii_x_y_z>0.09 0.18 0.12</thoracic_ellipsoid_radii_x_y_z>"
            "<scapula_winging_axis_origin>0.05 -0.02</scapula_winging_axis_origin>"
            "<scapula_winging_axis_direction>0.6</scapula_winging_axis_direction>"
        ),
    }
    tube = (
        '<WrapCylinder name="tube"><radius>0.02</radius><length>0.3</length><translation>0.01 0.02'
        " 0.03</translation><xyz_body_rotation>0.3 0.2"
        " 0.1</xyz_body_rotation><quadrant>+x</quadrant></WrapCylinder>"
    )
    inner = {
        "Gimbal": (
            _frame("inner", "..", random) + _frame("outer", "/bodyset/after_gimbal/inner", random)
        ),
        "Slider": _frame("side", "..", random, _set("WrapObjectSet", tube)),
    }
    bodies = ""
    joints = ""
    parent = "/ground"
    for kind in KINDS:
        name = f"after_{kind.lower()}"
        bodies += _body(
            name, random, f"<components>{inner[kind]}</components>" if kind in inner else ""
        )
        joints += _joint(
            kind,
            f"{kind.lower()}_joint",
            parent,
            f"/bodyset/{name}",
            random,
            settings.get(kind, ""),
        )
        parent = f"/bodyset/{name}"
    bodies += _body("last", random)
    joints += (
        "<PinJoint"
        ' name="between"><socket_parent_frame>/bodyset/after_gimbal/outer</socket_parent_frame>'
        f"<socket_child_frame>/bodyset/last</socket_child_frame><coordinates>{_coordinate('q')}</coordinates></PinJoint>"
    )
    places = (
        "/ground",
        "/bodyset/after_ball",
        "/bodyset/after_gimbal/outer",
        "/bodyset/after_slider/side",
        "/bodyset/last",
    )
    markers = "".join(
        f'<Marker name="m{i}"><socket_parent_frame>{place}</socket_parent_frame>'
        f"<location>{_numbers(random.uniform(-1, 1, 3))}</location></Marker>"
        for i, place in enumerate(places)
    )
    points = "".join(
        f'<PathPoint name="p{i}"><socket_parent_frame>{place}</socket_parent_frame>'
        f"<location>{_numbers(random.uniform(-0.3, 0.3, 3))}</location></PathPoint>"
        for i, place in enumerate(places[1:])
    )
    muscle = (
        f'<Thelen2003Muscle name="long"><GeometryPath name="path">{_set("PathPointSet", points)}'
        + _set(
            "PathWrapSet",
            '<PathWrap name="w"><wrap_object>tube</wrap_object><range>2 4</range></PathWrap>',
        )
        + "</GeometryPath></Thelen2003Muscle>"
    )
    sets = (("BodySet", bodies), ("JointSet", joints), ("MarkerSet", markers), ("ForceSet", muscle))
    path.write_text(_document("".join(_set(tag, inside) for tag, inside in sets)))


def all_functions(path: Path) -> None:
    """Write custom joints that rotate by a coordinate and slide by each kind of function of it."""
    random = np.random.default_rng(4)
    bodies = ""
    joints = ""
    for kind, function in FUNCTIONS.items():
        axes = ""
        for name, axis in zip(
            ("rotation1", "rotation2", "rotation3"), ("0 0.6 0.8", "1 0 0", "0 -1 0"), strict=True
        ):
            inside = f"<coordinates>{kind}</coordinates>" if name == "rotation1" else ""
            amount = "<LinearFunction/>" if inside else "<Constant><value>0.2</value></Constant>"
            axes += (
                f'<TransformAxis name="{name}">{inside}<axis>{axis}</axis>'
                f"<function>{amount}</function></TransformAxis>"
            )
        axes += (
            f'<TransformAxis name="translation2"><coordinates>{kind}</coordinates><axis>0 1'
            f" 0</axis><function>{function}</function></TransformAxis>"
        )
        bodies += _body(f"body_{kind}", random)
        spatial = f"<SpatialTransform>{axes}</SpatialTransform>"
        joint = _joint(
            "Custom", f"joint_{kind}", "/ground", f"/bodyset/body_{kind}", random, spatial
        )
        joints += joint.replace(
            "<coordinates></coordinates>", f"<coordinates>{_coordinate(kind)}</coordinates>", 1
        )
    constraints = (
        '<CoordinateCouplerConstraint name="half"><coupled_coordinates_function>'
        "<LinearFunction><coefficients>3"
        " 0.1</coefficients></LinearFunction></coupled_coordinates_function>"
        "<independent_coordinate_names>linear</independent_coordinate_names>"
        "<dependent_coordinate_name>simm</dependent_coordinate_name><scale_factor>0.5</scale_factor>"
        "</CoordinateCouplerConstraint><WeldConstraint"
        ' name="held"><socket_frame1>one</socket_frame1>'
        f"<socket_frame2>two</socket_frame2><frames>{_frame('one', '/bodyset/body_sine', random)}"
        f"{_frame('two', '/bodyset/body_step', random)}</frames></WeldConstraint>"
        '<PointConstraint name="tied"><socket_body_1>/ground</socket_body_1><location_body_1>1 2'
        " 3</location_body_1>"
        "<socket_body_2>/bodyset/body_two</socket_body_2></PointConstraint>"
        "<CoordinateCouplerConstraint"
        ' name="off"><isEnforced>false</isEnforced><coupled_coordinates_function>'
        "<LinearFunction/></coupled_coordinates_function><independent_coordinate_names>linear</independent_coordinate_names>"
        "<dependent_coordinate_name>three</dependent_coordinate_name></CoordinateCouplerConstraint>"
    )
    sets = (("BodySet", bodies), ("JointSet", joints), ("ConstraintSet", constraints))
    path.write_text(_document("".join(_set(tag, inside) for tag, inside in sets)))


def backwards(path: Path) -> None:
    """Joints whose parent in the file is further from the ground than their child."""
    random = np.random.default_rng(5)
    bodies = "".join(_body(name, random) for name in ("a", "b"))
    joints = _joint("Gimbal", "first", "/bodyset/a", "/ground", random)
    joints += _joint("Planar", "second", "/bodyset/b", "/bodyset/a", random)
    path.write_text(_document(_set("BodySet", bodies) + _set("JointSet", joints)))


def floating(path: Path) -> None:
    """Write a body without a joint.

    OpenSim 4.6 cannot open one where other bodies have joints.
    """
    path.write_text(_document(_set("BodySet", _body("loose", np.random.default_rng(6)))))


OLD = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="30000"><Model name="reversed"><BodySet><objects>
<Body name="ground"><Joint/></Body>
<Body name="rod"><mass>1</mass><mass_center>0 0.1 0</mass_center>
 <inertia_xx>0.1</inertia_xx><inertia_yy>0.1</inertia_yy><inertia_zz>0.1</inertia_zz>
 <Joint><CustomJoint name="turned"><parent_body>ground</parent_body>
  <location_in_parent>0.1 0.2 0.3</location_in_parent>\
<orientation_in_parent>0.2 0 0.4</orientation_in_parent>
  <location>0 0.5 0</location><orientation>0 0.25 0</orientation>
  <CoordinateSet><objects>
   <Coordinate name="turn"><motion_type>rotational</motion_type><range>-3 3</range></Coordinate>
   <Coordinate name="bend"><range>-3 3</range></Coordinate>
   <Coordinate name="slide"><range>-3 3</range></Coordinate>
  </objects></CoordinateSet>
  <reverse>true</reverse>
  <SpatialTransform>
   <TransformAxis name="rotation1"><coordinates>turn</coordinates><axis>0 0 1</axis>
    <function><LinearFunction><coefficients>1 0</coefficients></LinearFunction></function>\
</TransformAxis>
   <TransformAxis name="rotation2"><coordinates>bend</coordinates><axis>0 1 0</axis>
    <function><LinearFunction><coefficients>-1 0</coefficients></LinearFunction></function>\
</TransformAxis>
   <TransformAxis name="rotation3"><axis>1 0 0</axis>
    <function><Constant><value>0.3</value></Constant></function></TransformAxis>
   <TransformAxis name="translation1"><coordinates>slide</coordinates><axis>1 0 0</axis>
    <function><NaturalCubicSpline><x>-1 0 1 2</x><y>0.2 0 0.1 0.4</y></NaturalCubicSpline>\
</function></TransformAxis>
   <TransformAxis name="translation2"><axis>0 1 0</axis>
    <function><Constant><value>0</value></Constant></function></TransformAxis>
   <TransformAxis name="translation3"><axis>0 0 1</axis>
    <function><Constant><value>0</value></Constant></function></TransformAxis>
  </SpatialTransform>
 </CustomJoint></Joint>
</Body>
<Body name="bob"><mass>1</mass><mass_center>0 0 0</mass_center>
 <inertia_xx>0.1</inertia_xx><inertia_yy>0.1</inertia_yy><inertia_zz>0.1</inertia_zz>
 <Joint><PinJoint name="hook"><parent_body>rod</parent_body>
  <location_in_parent>0 -0.5 0</location_in_parent>\
<orientation_in_parent>0 0 0</orientation_in_parent>
  <location>0 0.2 0</location><orientation>0.1 0.2 0.3</orientation><reverse>true</reverse>
  <CoordinateSet><objects><Coordinate name="swing"><range>-3 3</range></Coordinate></objects>\
</CoordinateSet>
 </PinJoint></Joint>
</Body>
</objects></BodySet></Model></OpenSimDocument>
"""


def reversed_old(path: Path) -> None:
    """Joints of a document before 4.0 that carry `reverse`."""
    path.write_text(OLD)


def old_sockets(path: Path) -> None:
    """Write the chain of joints with sockets spelt as shortly before 4.0."""
    all_joints(path)
    root = etree.parse(path).getroot()
    root.set("Version", "30516")
    for element in root.iter(etree.Element):
        if element.tag.startswith("socket_"):
            element.tag += "_connectee_name"
    path.write_bytes(etree.tostring(root))


def old_connectors(path: Path) -> None:
    """Write the chain of joints with connectors, as between 3.3 and 4.0."""
    all_joints(path)
    root = etree.parse(path).getroot()
    root.set("Version", "30507")
    for element in list(root.iter(etree.Element)):
        if not element.tag.startswith("socket_"):
            continue
        parent = element.getparent()
        connectors = parent.find("connectors")
        if connectors is None:
            connectors = etree.SubElement(parent, "connectors")
        name = element.tag.removeprefix("socket_")
        kind = "Connector_Frame_" if name == "parent" else "Connector_PhysicalFrame_"
        connector = etree.SubElement(connectors, kind, name=name)
        etree.SubElement(connector, "connectee_name").text = element.text
        parent.remove(element)
    path.write_bytes(etree.tostring(root))


MAKERS = {
    one.__name__: one
    for one in (
        all_joints,
        all_functions,
        backwards,
        floating,
        reversed_old,
        old_sockets,
        old_connectors,
    )
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kinds")
    files = {}
    for name, make in MAKERS.items():
        files[name] = folder / f"{name}.osim"
        make(files[name])
        files[f"written {name}"] = folder / f"written_{name}.osim"
        assert write_osim(read_osim(files[name]), files[f"written {name}"]) == ()
    return files, opensim_oracle.ask(files, folder)


@pytest.mark.parametrize("name", [*MAKERS, *(f"written {name}" for name in MAKERS)])
def test_kinds_agree_with_opensim(name, answers):
    files, facts = answers
    fact = facts[name]
    assert not isinstance(fact, str), fact
    model = read_osim(files[name])
    assert set(fact["coordinates"]) == set(model.coordinate_names)
    for one in model.coordinates:
        assert fact["coordinates"][one.name][-1] == one.motion
    for pose in fact["poses"]:
        ours = body_poses(model, pose["coordinates"])
        for body, (rotation, origin) in pose["bodies"].items():
            assert np.allclose(ours[body].rotation, rotation, rtol=0, atol=TIGHT), body
            assert np.allclose(ours[body].translation, origin, rtol=0, atol=TIGHT), body
        for marker in model.markers:
            place = ours[marker.body].apply(marker.location)
            assert np.allclose(place, pose["markers"][marker.name], rtol=0, atol=TIGHT), marker.name
        for muscle in model.muscles:
            for point, place in zip(muscle.path.points, pose["points"][muscle.name], strict=True):
                ours_place = ours[point.body].apply(point_place(point, pose["coordinates"]))
                assert np.allclose(ours_place, place, rtol=0, atol=TIGHT), point.name


@pytest.mark.parametrize("name", MAKERS)
def test_muscle_lengths_survive_writing(name, answers):
    _, facts = answers
    for before, after in zip(facts[name]["poses"], facts[f"written {name}"]["poses"], strict=True):
        assert after["lengths"] == pytest.approx(before["lengths"], abs=TIGHT)


def test_a_wrap_object_on_an_offset_frame_is_placed_in_its_body(answers):
    files, _ = answers
    model = read_osim(files["all_joints"])
    (tube,) = model.wrap_objects
    side = next(frame for frame in model.frames if frame.name == "side")
    assert tube.body == side.body == "after_slider"
    assert np.allclose(
        tube.pose.translation, side.pose.apply((0.01, 0.02, 0.03)), rtol=0, atol=1e-15
    )


def test_constraints_become_couplers_and_loops(answers):
    files, _ = answers
    model = read_osim(files["all_functions"])
    (coupler,) = model.couplers
    assert (coupler.dependent, coupler.independents) == ("simm", ("linear",))
    assert float(coupler.function(0.4)) == pytest.approx(0.5 * (3.0 * 0.4 + 0.1))
    weld, point = model.loops
    assert (weld.body_1, weld.body_2, weld.kind) == ("body_sine", "body_step", "WeldConstraint")
    assert (point.body_1, point.body_2) == ("ground", "body_two")
    assert np.array_equal(point.pose_1.translation, (1, 2, 3))
    assert [one.name for one in model.kept] == ["off"]


def test_a_body_without_a_joint_floats_as_in_opensim(answers):
    files, facts = answers
    model = read_osim(files["floating"])
    assert any("'loose'" in line for line in model.warnings)
    joint = next(one for one in model.joints if one.child == "loose")
    assert (joint.name, joint.kind, joint.parent) == ("free_loose", "FreeJoint", "ground")
    assert joint.coordinates == tuple(facts["floating"]["coordinates"])


def test_random_values_stay_in_range(answers):
    files, _ = answers
    model = read_osim(files["reversed_old"])
    for name, value in random_values(model, 0).items():
        low, high = model.coordinate(name).range
        assert low <= value <= high

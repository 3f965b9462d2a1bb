"""Damaged, hostile and impossible OpenSim files: one clear line, quickly."""

from __future__ import annotations

import time

import numpy as np
import pytest
from lxml import etree

from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.parsing.xml import read_xml
from myomorph.core.model.errors import BadFile, BadModel, MyomorphError, UnknownName

ROD = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000">
 <Model name="rod">
  <defaults><Thelen2003Muscle name="default"><min_control>0.02</min_control><Af>0.4</Af>\
</Thelen2003Muscle></defaults>
  <BodySet name="bodyset"><objects>
   <Body name="rod"><mass>1.5</mass><mass_center>0 0.5 0</mass_center>\
<inertia>1 1 1 0 0 0</inertia></Body>
  </objects></BodySet>
  <JointSet name="jointset"><objects>
   <PinJoint name="pin">
    <socket_parent_frame>/ground</socket_parent_frame><socket_child_frame>/bodyset/rod</socket_child_frame>
    <coordinates><Coordinate name="angle"><range>-2 2</range></Coordinate></coordinates>
   </PinJoint>
  </objects></JointSet>
  <ForceSet name="forceset"><objects>
   <Thelen2003Muscle name="pull">
    <GeometryPath name="path">
     <PathPointSet><objects>
      <PathPoint name="a"><socket_parent_frame>/ground</socket_parent_frame>\
<location>0 1 0</location></PathPoint>
      <ConditionalPathPoint name="b"><socket_parent_frame>/bodyset/rod</socket_parent_frame>\
<location>0 0 0</location>
       <socket_coordinate>/jointset/pin/angle</socket_coordinate><range>-1 1</range>\
</ConditionalPathPoint>
     </objects></PathPointSet>
    </GeometryPath>
   </Thelen2003Muscle>
   <CoordinateActuator name="motor"><coordinate>angle</coordinate></CoordinateActuator>
  </objects></ForceSet>
 </Model>
</OpenSimDocument>
"""


@pytest.fixture
def rod(tmp_path):
    """Return a function that reads the document with some text replaced."""

    def read(*replaced):
        text = ROD
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "rod.osim"
        path.write_text(text)
        return read_osim(path)

    return read


def test_the_document_itself_is_fine(rod):
    model = rod()
    assert model.mass == 1.5
    assert model.warnings == ()


def test_values_of_the_defaults_section_count(rod):
    (muscle,) = rod().muscles
    assert muscle.min_activation == 0.02
    assert muscle.parameters["Af"] == 0.4
    (own,) = rod(('name="pull">', 'name="pull"><Af>0.7</Af>')).muscles
    assert own.parameters["Af"] == 0.7


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<mass>1.5", "<mass>nan", ("line 6", "Body 'rod'", "'mass'", "finite")),
        ("<mass>1.5", "<mass>1e999", ("Body 'rod'", "finite")),
        ("<mass>1.5</mass>", "", ("Body 'rod'", "no mass")),
        ("<mass>1.5", "<mass>heavy", ("Body 'rod'", "'heavy'", "numbers")),
        ("<mass>1.5", "<mass>-1", ("body 'rod'", "-1 kg")),
        ("<mass_center>0 0.5 0", "<mass_center>0 0.5", ("2 numbers", "expected 3")),
        ("<range>-2 2", "<range>-2", ("Coordinate 'angle'", "expected 2")),
        (
            "/bodyset/rod</socket_child",
            "/bodyset/stick</socket_child",
            ("unknown frame '/bodyset/stick'", "'rod'"),
        ),
        ("/jointset/pin/angle", "/jointset/pin/angel", ("unknown coordinate 'angel'", "'angle'")),
        (
            "<coordinate>angle",
            "<coordinate>angel",
            ("unknown coordinate 'angel'", "'motor'", "'angle'"),
        ),
        ('<PinJoint name="pin">', '<HingeJoint name="pin">', ("tag", "line")),
        ('Version="40000"', 'Version="new"', ("Version is 'new'",)),
        ('Version="40000"', 'Version="10500"', ("version 10500", "OpenSim 3.3")),
        ('<Model name="rod">', '<Modell name="rod">', ("line",)),
        ('name="pull">', 'name="pull"><appliesForce>maybe</appliesForce>', ("'maybe'",)),
    ],
)
def test_one_line_says_what_and_where(rod, tmp_path, old, new, words):
    with pytest.raises(MyomorphError) as error:
        rod((old, new))
    text = str(error.value)
    assert "\n" not in text
    assert str(tmp_path / "rod.osim") in text
    for word in words:
        assert word in text


def test_unknown_classes_are_refused_by_name(rod):
    with pytest.raises(BadModel, match=r"joint 'pin' is a RubberJoint: expected one of .*PinJoint"):
        rod(("<PinJoint", "<RubberJoint"), ("</PinJoint", "</RubberJoint"))
    with pytest.raises(BadModel, match="path point 'b' is a FancyPathPoint"):
        rod(("ConditionalPathPoint", "FancyPathPoint"))


def test_forces_that_are_not_built_are_kept_and_told(rod):
    model = rod(("CoordinateActuator", "JetEngine"))
    (kept,) = model.kept
    assert (kept.kind, kept.name, kept.room) == ("JetEngine", "motor", "ForceSet")
    assert model.warnings == ("JetEngine 'motor': kept but not modelled, its force is left out",)


def test_a_model_without_mass_is_read_with_a_warning(rod):
    model = rod(("<mass>1.5", "<mass>0"))
    assert model.mass == 0
    assert model.warnings == ("all bodies have zero mass: the model moves, but has no dynamics",)


def test_a_joint_that_closes_a_loop_is_cut_and_welded(rod):
    second = """<PinJoint name="again"><socket_parent_frame>/ground</socket_parent_frame>
     <socket_child_frame>/bodyset/rod</socket_child_frame></PinJoint></objects></JointSet>"""
    model = rod(("</objects></JointSet>", second))
    assert model.body_names == ("rod", "rod_slave_0")
    (loop,) = model.loops
    assert (loop.kind, loop.body_1, loop.body_2) == ("WeldConstraint", "rod", "rod_slave_0")
    assert model.coordinate_names == ("angle", "again_coord_0")
    assert any("'again' closes a loop" in line for line in model.warnings)


def test_two_wrap_objects_of_one_name_the_first_is_meant(rod):
    tube = (
        "<WrapObjectSet><objects><WrapSphere"
        ' name="ball"><radius>{}</radius></WrapSphere></objects></WrapObjectSet>'
    )
    model = rod(
        ("<BodySet", f'<Ground name="ground">{tube.format(0.1)}</Ground><BodySet'),
        ('<Body name="rod">', f'<Body name="rod">{tube.format(0.2)}'),
        (
            "</GeometryPath>",
            "<PathWrapSet><objects><PathWrap><wrap_object>ball</wrap_object></PathWrap></objects></PathWrapSet></GeometryPath>",
        ),
    )
    assert [one.name for one in model.wrap_objects] == ["ground/ball", "rod/ball"]
    assert model.muscles[0].path.wraps[0].wrap_object == "ground/ball"


def test_a_frame_that_stands_on_itself_is_refused(rod):
    frames = """<components>
     <PhysicalOffsetFrame name="f"><socket_parent>/bodyset/rod/g</socket_parent>\
</PhysicalOffsetFrame>
     <PhysicalOffsetFrame name="g"><socket_parent>/bodyset/rod/f</socket_parent>\
</PhysicalOffsetFrame></components>"""
    with pytest.raises(BadFile, match="its own parent"):
        rod(('<Body name="rod">', f'<Body name="rod">{frames}'))


def test_every_truncation_is_refused_with_its_line(data, tmp_path):
    content = data("opensim-reference-small/arm26.osim").read_bytes()
    path = tmp_path / "cut.osim"
    end = content.rindex(b"</OpenSimDocument>")
    for length in np.linspace(0, end, 120).astype(int):
        path.write_bytes(content[:length])
        with pytest.raises(BadFile) as error:
            read_osim(path)
        assert "\n" not in str(error.value)
        assert length == 0 or "line" in str(error.value)


def test_whatever_is_missing_or_odd_only_our_errors_come(data, tmp_path):
    content = data("bones-landmarks-leg/make-a-leg_final.osim").read_bytes()
    path = tmp_path / "mutilated.osim"
    random = np.random.default_rng(11)
    refusals = []
    for i in range(150):
        root = etree.fromstring(content)
        elements = list(root.iter(etree.Element))[2:]
        element = elements[random.integers(len(elements))]
        if i % 3 == 0:
            element.getparent().remove(element)
        elif i % 3 == 1:
            element.text = ("", "nan", "-1", "1e400", "many", "1 2", "/no/such/path", "../..")[
                random.integers(8)
            ]
        else:
            element.tag = elements[random.integers(len(elements))].tag
        path.write_bytes(etree.tostring(root))
        try:
            read_osim(path)
        except MyomorphError as error:
            refusals.append(str(error))
    assert 10 < len(refusals) < 140
    assert not any("\n" in text for text in refusals)


def test_entity_bombs_are_refused_at_once(tmp_path):
    path = tmp_path / "bomb.osim"
    levels = ""
    for i in range(12):
        ten = f"&l{i};" * 10
        levels += f'<!ENTITY l{i + 1} "{ten}">'
    bomb = (
        '<?xml version="1.0"?><!DOCTYPE Model [<!ENTITY l0'
        f' "ha">{levels}]><OpenSimDocument>&l12;</OpenSimDocument>'
    )
    start = time.monotonic()
    for content in (bomb.encode(), bomb.encode("utf-16")):
        path.write_bytes(content)
        with pytest.raises(BadFile, match="entities"):
            read_osim(path)
    assert time.monotonic() - start < 5


def test_external_entities_are_not_fetched(tmp_path):
    (tmp_path / "secret.txt").write_text("42")
    path = tmp_path / "outside.osim"
    path.write_text(
        '<!DOCTYPE Model SYSTEM "secret.txt"><OpenSimDocument'
        ' Version="40000"><Model/></OpenSimDocument>'
    )
    model = read_osim(path)
    assert model.bodies == ()


def test_slips_of_careless_editors_are_overlooked_as_opensim_does(rod, tmp_path, data):
    path = tmp_path / "careless.osim"
    slips = (("<Model name", "<!-- a -- b -->\n<Model name"), ("<Body name", "\x01<Body name"))
    content = ROD
    for old, new in slips:
        content = content.replace(old, new)
    path.write_text(content)
    model = read_osim(path)
    assert model.body_names == ("rod",)
    assert "not well-formed" in model.warnings[0]
    latin = read_osim(data("shoulder-bonepin/subject1_abdbonepin.osim"))
    assert "line 5" in latin.warnings[0]
    tasks = read_xml(data("opensim-gait-subject01/ref_ik/gait2354_IK_Tasks.xml"))
    assert len(list(tasks.root.iter("IKMarkerTask"))) > 20


def test_files_that_are_not_there_or_something_else(tmp_path):
    (tmp_path / "leg.osim").write_text(ROD)
    with pytest.raises(BadFile, match=r"no such file; its folder has 'leg\.osim'"):
        read_osim(tmp_path / "log.osim")
    with pytest.raises(BadFile, match=r"the folder '.*nowhere' does not exist"):
        read_osim(tmp_path / "nowhere" / "leg.osim")
    with pytest.raises(BadFile, match=r"expected \.osim or \.xml"):
        read_model(tmp_path / "leg.txt")
    (tmp_path / "folder.osim").mkdir()
    with pytest.raises(BadFile, match="cannot be read"):
        read_osim(tmp_path / "folder.osim")
    (tmp_path / "loads.osim").write_text(
        '<OpenSimDocument Version="40000"><ExternalLoads/></OpenSimDocument>'
    )
    with pytest.raises(BadFile, match="holds <ExternalLoads>; expected an OpenSim model"):
        read_osim(tmp_path / "loads.osim")
    (tmp_path / "image.osim").write_bytes(bytes(range(256)) * 40)
    with pytest.raises(BadFile):
        read_osim(tmp_path / "image.osim")


def test_mesh_names_are_kept_as_text_and_never_opened(rod):
    mesh = (
        "<attached_geometry><Mesh"
        ' name="m"><mesh_file>../../etc/passwd</mesh_file></Mesh></attached_geometry>'
    )
    model = rod(('<Body name="rod">', f'<Body name="rod">{mesh}'))
    assert model.bodies[0].meshes[0].file == "../../etc/passwd"


def test_unknown_wrap_object_lists_those_that_exist(rod):
    wrap = (
        "<PathWrapSet><objects><PathWrap><wrap_object>boll</wrap_object></PathWrap></objects>"
        "</PathWrapSet>"
    )
    ball = (
        "<WrapObjectSet><objects><WrapSphere"
        ' name="ball"><radius>1</radius></WrapSphere></objects></WrapObjectSet>'
    )
    with pytest.raises(UnknownName, match=r"unknown wrap object 'boll'.*'ball'"):
        rod(
            ("</GeometryPath>", f"{wrap}</GeometryPath>"),
            ('<Body name="rod">', f'<Body name="rod">{ball}'),
        )


def test_documents_of_the_future_are_read_with_a_warning(rod):
    (warning,) = rod(('Version="40000"', 'Version="50000"')).warnings
    assert "50000 is newer than OpenSim 4.6" in warning


def test_other_units_are_told(rod):
    (warning,) = rod(("<BodySet", "<length_units>millimeters</length_units><BodySet")).warnings
    assert warning == "length_units is 'millimeters': read as meters, as OpenSim does"


def test_a_surface_without_size_wraps_nothing(rod):
    ball = (
        "<WrapObjectSet><objects><WrapSphere"
        ' name="ball"><radius>{}</radius></WrapSphere></objects></WrapObjectSet>'
    )
    model = rod(('<Body name="rod">', f'<Body name="rod">{ball.format(0)}'))
    assert not model.wrap_objects[0].active
    assert model.warnings == ("wrap object 'ball' has no size: nothing wraps around it",)
    with pytest.raises(BadFile, match="WrapSphere 'ball': has size"):
        rod(('<Body name="rod">', f'<Body name="rod">{ball.format(-1)}'))

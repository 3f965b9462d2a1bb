"""What is written reads back as the same model, and OpenSim opens what came from MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

import opensim_oracle
from conftest import DATA
from myomorph.core.io.mjcf.read import read_mjcf
from myomorph.core.io.osim.document import Document, Node, legal
from myomorph.core.io.osim.functions import (
    natural_spline,
    read_function,
    smooth_step,
    write_function,
)
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadModel
from myomorph.core.model.functions import (
    PiecewisePolynomial,
    SineProduct,
    constant,
    linear,
    piecewise_linear,
    polynomial,
    simm_spline,
)
from myomorph.core.model.model import Body, Model
from myomorph.core.model.paths import PassiveTorque
from osim_models import FILES, body_poses, random_values

# What a written file says differently by its nature: where it is, and where meshes hang in it.
OWN = {Model: {"source", "warnings", "kept", "frames"}, Body: {"meshes"}}
MUJOCO = {
    "mouse arm": "mouse-arm-muscles/akira_muscle.xml",
    "mouse": "mouse-skeleton-keypoints/mouse_with_meshes.xml",
    "rat": "rat-keypoints/rodent.xml",
}


def differences(one, other, where=""):
    """Fields in which two values differ, numbers beyond rounding."""
    if is_dataclass(one) and type(one) is type(other):
        if isinstance(one, PiecewisePolynomial):
            return [] if _same_function(one, other) else [where]
        return _field_differences(one, other, where)
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        return _part_differences(one, other, where)
    if isinstance(one, Mapping) and set(one) == set(other):
        return [
            line for key in one for line in differences(one[key], other[key], f"{where}[{key}]")
        ]
    if isinstance(one, (np.ndarray, float)):
        return [] if _near(one, other) else [f"{where}: {one} and {other}"]
    return [] if one == other else [f"{where}: {one!r} and {other!r}"]


def _part_differences(one, other, where):
    """Parts of two tuples of one length that differ."""
    return [
        line
        for i, (a, b) in enumerate(zip(one, other, strict=True))
        for line in differences(a, b, f"{where}[{getattr(a, 'name', i)}]")
    ]


def _field_differences(one, other, where):
    """Fields of two dataclasses of one type that differ."""
    skipped = OWN.get(type(one), set())
    return [
        line
        for field in fields(one)
        if field.name not in skipped
        for line in differences(
            getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}"
        )
    ]


def _near(one, other):
    return np.shape(one) == np.shape(other) and np.allclose(one, other, rtol=1e-13, atol=1e-14)


def _meshes(body):
    return sorted(
        (
            one.file,
            one.shape,
            *one.scale,
            *np.round((*one.pose.translation, *one.pose.rotation.flat), 12) + 0.0,
        )
        for one in body.meshes
    )


def _same_function(one, other):
    x = np.linspace(-4, 4, 101)
    return isinstance(other, PiecewisePolynomial) and np.allclose(
        one(x), other(x), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("name", FILES)
def test_reading_what_was_written_gives_the_same_model(name, data, tmp_path):
    model = read_osim(data(name))
    assert write_osim(model, tmp_path / "written.osim") == ()
    again = read_osim(tmp_path / "written.osim")
    assert differences(model, again) == []
    assert [_meshes(body) for body in again.bodies] == [_meshes(body) for body in model.bodies]
    assert {(one.kind, one.name) for one in again.kept} == {
        (one.kind, one.name) for one in model.kept
    }
    assert {frame.name for frame in model.frames} <= {frame.name for frame in again.frames}


@pytest.fixture(scope="module")
def from_mujoco(tmp_path_factory):
    """Models from MuJoCo files, as written, with what OpenSim says of them."""
    pytest.importorskip("opensim")
    folder = tmp_path_factory.mktemp("mujoco")
    models = {}
    files = {}
    warnings = {}
    for name, file in MUJOCO.items():
        if (DATA / file).exists():
            models[name] = read_mjcf(DATA / file)
            files[name] = folder / f"{name}.osim"
            warnings[name] = write_osim(models[name], files[name])
    return models, files, warnings, opensim_oracle.ask(files, folder)


@pytest.mark.parametrize("name", MUJOCO)
def test_opensim_moves_mujoco_s_bodies_as_we_do(name, from_mujoco):
    models, files, _, facts = from_mujoco
    if name not in models:
        pytest.skip(f"needs the data set '{MUJOCO[name].split('/')[0]}'")
    model = models[name]
    fact = facts[name]
    assert not isinstance(fact, str), fact
    assert fact["mass"] == pytest.approx(model.mass, abs=1e-12)
    again = read_osim(files[name])
    for pose in fact["poses"]:
        values = {one: pose["coordinates"][legal(one)] for one in model.coordinate_names}
        ours = body_poses(model, values)
        written = body_poses(again, pose["coordinates"])
        for body in model.body_names:
            rotation, origin = pose["bodies"][legal(body)]
            for place in (ours[body], written[legal(body)]):
                assert np.allclose(place.rotation, rotation, rtol=0, atol=1e-9), body
                assert np.allclose(place.translation, origin, rtol=0, atol=1e-9), body


def test_what_opensim_cannot_hold_is_said(from_mujoco):
    models, _, warnings, _ = from_mujoco
    if "mouse arm" not in models:
        pytest.skip("needs the data set 'mouse-arm-muscles'")
    text = "\n".join(warnings["mouse arm"])
    assert "written as Millard2012EquilibriumMuscle: their force will differ" in text


def test_joints_about_several_anchors_become_chains(from_mujoco):
    models, _, warnings, facts = from_mujoco
    if "rat" not in models:
        pytest.skip("needs the data set 'rat-keypoints'")
    assert any("'scapula_L': written as 3 joints" in line for line in warnings["rat"])
    assert {"scapula_L_link_0", "scapula_L_link_1"} <= set(facts["rat"]["bodies"])


@pytest.fixture
def pendulum(data):
    return read_osim(data("opensim-reference-small/double_pendulum.osim"))


def test_names_that_opensim_refuses_are_repaired_or_refused(pendulum, tmp_path):
    renamed = replace(pendulum, name="two rods", markers=())
    assert write_osim(renamed, tmp_path / "a.osim") == ()
    coordinates = tuple(replace(one, name=f"{one.name}/x") for one in pendulum.coordinates)
    joints = tuple(
        replace(
            joint,
            coordinates=tuple(f"{one}/x" for one in joint.coordinates),
            axes=tuple(
                replace(axis, coordinates=tuple(f"{one}/x" for one in axis.coordinates))
                for axis in joint.axes
            ),
        )
        for joint in pendulum.joints
    )
    odd = replace(pendulum, coordinates=coordinates, joints=joints, actuators=())
    (warning,) = write_osim(odd, tmp_path / "b.osim")
    assert "2 names" in warning
    assert read_osim(tmp_path / "b.osim").coordinate_names == tuple(
        legal(one.name) for one in coordinates
    )
    twins = (replace(coordinates[0], name="q 1"), replace(coordinates[1], name="q_1"))
    with pytest.raises(BadModel, match="'q 1' and 'q_1' would have one name"):
        write_osim(replace(odd, coordinates=twins), tmp_path / "c.osim")


def test_a_failed_write_leaves_nothing_and_spoils_nothing(pendulum, tmp_path, monkeypatch):
    path = tmp_path / "model.osim"
    write_osim(pendulum, path)
    before = path.read_bytes()

    def fail(*_arguments, **_options):
        raise OSError("disk full")

    monkeypatch.setattr("myomorph.core.io.osim.write.etree.tostring", fail)
    with pytest.raises(OSError, match="disk full"):
        write_osim(replace(pendulum, name="other"), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_kept_parts_are_put_back_and_old_layouts_left_out_by_name(data, tmp_path):
    model = read_osim(
        data("opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim")
    )
    spring = next(one for one in model.kept if one.kind == "CoordinateLimitForce")
    off = replace(
        spring,
        text=spring.text.replace("<coordinate>", "<isDisabled>true</isDisabled><coordinate>"),
    )
    controller = replace(spring, kind="PrescribedController", name="old", room="ControllerSet")
    warnings = write_osim(
        replace(model, kept=(off, controller, *(one for one in model.kept if one.room == "Model"))),
        tmp_path / "out.osim",
    )
    assert warnings == (
        "PrescribedController 'old' is left out: its layout is of document version 30000",
    )
    root = etree.parse(tmp_path / "out.osim").getroot()
    (back,) = root.iter("CoordinateLimitForce")
    assert back.get("name") == spring.name
    assert back.findtext("appliesForce") == "false"
    assert back.find("isDisabled") is None
    assert root.findtext("Model/credits") is not None


@pytest.mark.parametrize(
    "function",
    [
        linear(-1.5, 0.25),
        polynomial([0.1, 0.2, -0.3, 0.4]),
        PiecewisePolynomial(np.array([0.7]), np.array([[0.1, 0.2, 0.3]])),
        SineProduct(factor=0.3, frequencies=np.array([1.2]), phases=np.array([0.4]), offset=0.5),
        smooth_step(-0.5, 0.9, 0.7, -0.2),
    ],
)
def test_a_written_function_reads_back(function):
    assert _off(function) < 1e-13


@settings(max_examples=60)
@given(
    kind=st.sampled_from(
        [simm_spline, piecewise_linear, *(partial(natural_spline, half=half) for half in (2, 3))]
    ),
    steps=st.lists(st.floats(0.05, 1.0), min_size=6, max_size=12),
    seed=st.integers(0, 1000),
)
def test_written_splines_read_back(kind, steps, seed):
    x = np.cumsum(steps) - 2.0
    y = np.random.default_rng(seed).normal(size=len(x))
    assert _off(kind(x, y)) < 1e-8 * max(
        1.0, float(np.abs(kind(x, y)(np.linspace(-4, 12, 400))).max())
    )


def test_pieces_that_opensim_lacks_are_sampled_with_a_warning():
    odd = PiecewisePolynomial(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 1.0], [1.0, 2.0, -1.0]]))
    warnings = []
    holder = etree.Element("function")
    write_function(holder, odd, "joint 'a'", warnings)
    assert len(warnings) == 1
    assert "joint 'a': written as a spline through 401 points" in warnings[0]


def _off(function):
    """Largest difference between a function and what is read of it once written."""
    holder = etree.Element("function")
    warnings = []
    write_function(holder, function, "test", warnings)
    assert warnings == []
    document = Document(None, 40600, holder)
    (element,) = holder
    again = read_function(Node(element, document), Node(holder, document))
    x = np.linspace(-4, 12, 400)
    return float(np.max(np.abs(function(x) - again(x))))


def test_passive_torques_are_written_as_springs_where_they_are_linear(pendulum, tmp_path):
    name = pendulum.coordinate_names[0]
    spring = PassiveTorque(
        name="tissue", coordinate=name, torque=linear(-3.0, 0.6), damping=constant(0.25)
    )
    curved = PassiveTorque(
        name="odd", coordinate=name, torque=polynomial([0.0, -1.0, -1.0]), damping=constant(0.0)
    )
    warnings = write_osim(
        replace(pendulum, passive_torques=(spring, curved)), tmp_path / "out.osim"
    )
    assert warnings == (
        "passive torque 'odd' is left out: it is not a linear spring with constant damping",
    )
    (again,) = read_osim(tmp_path / "out.osim").passive_torques
    assert (again.name, again.coordinate) == ("tissue", name)
    for q in (-1.0, 0.0, 2.0):
        assert float(again.torque(q)) == pytest.approx(float(spring.torque(q)), abs=1e-15)
        assert float(again.damping(q)) == 0.25


def test_random_values_of_a_written_model_give_the_same_poses(data, tmp_path):
    model = read_osim(data("shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim"))
    write_osim(model, tmp_path / "out.osim")
    again = read_osim(tmp_path / "out.osim")
    values = random_values(model, 3)
    before = body_poses(model, values)
    after = body_poses(again, values)
    assert all(
        np.allclose(before[name].translation, after[name].translation, rtol=0, atol=1e-14)
        for name in before
    )

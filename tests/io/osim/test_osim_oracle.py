"""Every OpenSim model of the data, as read and as written again, against OpenSim itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import opensim_oracle
from conftest import DATA
from myomorph.core.io.osim.document import read_document
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.spatial import Transform, euler_xyz_from_rotation
from myomorph.lab.analyze.generic_model import generic_model
from osim_models import FILES, body_poses, point_place

pytest.importorskip("opensim")
TIGHT = 1e-9


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """OpenSim's facts of the originals ("file") and of the models we wrote ("written/file")."""
    folder = tmp_path_factory.mktemp("oracle")
    files = {}
    for i, name in enumerate(FILES):
        path = DATA / name
        if path.exists():
            files[name] = _loadable(path, folder / f"{i}_{path.name}")
            files[f"written/{name}"] = folder / f"written_{i}_{path.name}"
            write_osim(read_osim(files[name]), files[f"written/{name}"])
    return files, opensim_oracle.ask(files, folder)


def _loadable(path: Path, copy: Path) -> Path:
    """Return the file itself, or a copy of it that OpenSim 4.6 does not refuse.

    lenhart2015 has contacts of a class that OpenSim does not have; arm26 has muscles with a minimum
    activation and control that OpenSim 4 no longer allows.
    """
    if path.stem not in ("lenhart2015", "arm26"):
        return path
    root = etree.parse(path).getroot()
    for element in list(root.iter()):
        if str(element.tag).startswith("Smith2018"):
            element.getparent().remove(element)
        elif element.tag in ("minimum_activation", "min_control"):
            element.text = "0.01"
    copy.write_bytes(etree.tostring(root))
    return copy


@pytest.fixture(params=FILES)
def pair(request, answers):
    """Read a model with our reader, and OpenSim's answers on the same file."""
    files, facts = answers
    if request.param not in files:
        pytest.skip(f"needs the data set '{request.param.split('/')[0]}'")
    fact = facts[request.param]
    assert not isinstance(fact, str), fact
    return _as_opensim_reads_it(files[request.param]), fact


@cache
def _as_opensim_reads_it(path: Path) -> Model:
    model = read_osim(path)
    return _rounded(model) if read_document(path, (), "").document.version < 30500 else model


def _rounded(model: Model) -> Model:
    """Round the model as OpenSim does with documents before 4.0.

    It converts inertias and joint frames as text of six digits.
    """

    def six(values):
        return np.vectorize(lambda one: float(f"{one:.6g}"))(values)

    def frame(pose):
        return Transform.from_euler_xyz(
            six(euler_xyz_from_rotation(pose.rotation)), six(pose.translation)
        )

    return replace(
        model,
        bodies=tuple(replace(one, inertia=six(one.inertia)) for one in model.bodies),
        joints=tuple(
            replace(one, parent_frame=frame(one.parent_frame), child_frame=frame(one.child_frame))
            for one in model.joints
        ),
    )


def test_bodies_are_as_heavy(pair):
    model, fact = pair
    assert set(model.body_names) == set(fact["bodies"])
    for body in model.bodies:
        mass, center, inertia = fact["bodies"][body.name]
        assert body.mass == mass
        assert np.array_equal(body.mass_center, center)
        assert np.allclose(body.inertia, inertia, rtol=0, atol=1e-12)
    assert np.array_equal(model.gravity, fact["gravity"])


def test_coordinates_have_the_same_settings_and_order(pair):
    model, fact = pair
    assert model.coordinate_names == tuple(fact["coordinates"])
    for one in model.coordinates:
        settings = (one.default, one.default_speed, *one.range, one.clamped, one.locked, one.motion)
        assert settings == fact["coordinates"][one.name], one.name


def test_everything_is_in_the_same_place(pair):
    model, fact = pair
    for pose in fact["poses"]:
        values = pose["coordinates"]
        ours = body_poses(model, values)
        for name, (rotation, origin) in pose["bodies"].items():
            assert np.allclose(ours[name].rotation, rotation, rtol=0, atol=TIGHT), name
            assert np.allclose(ours[name].translation, origin, rtol=0, atol=TIGHT), name
        assert set(pose["markers"]) == set(model.marker_names)
        for marker in model.markers:
            place = ours[marker.body].apply(marker.location)
            assert np.allclose(place, pose["markers"][marker.name], rtol=0, atol=TIGHT), marker.name
        for muscle in model.muscles:
            theirs = pose["points"][muscle.name]
            assert len(theirs) == len(muscle.path.points)
            for point, place in zip(muscle.path.points, theirs, strict=True):
                assert np.allclose(
                    ours[point.body].apply(point_place(point, values)), place, rtol=0, atol=TIGHT
                )


def test_muscles_have_the_same_parameters_and_wraps(pair):
    model, fact = pair
    assert set(model.muscle_names) == set(fact["muscles"])
    for muscle in model.muscles:
        theirs = fact["muscles"][muscle.name]
        assert muscle.kind == theirs["kind"]
        assert muscle.enabled == theirs["enabled"]
        numbers = (
            muscle.max_isometric_force,
            muscle.optimal_fiber_length,
            muscle.tendon_slack_length,
            muscle.pennation_at_optimal,
            muscle.max_contraction_velocity,
            muscle.min_activation,
            muscle.max_activation,
        )
        assert numbers == theirs["numbers"], muscle.name
        for name, value in muscle.parameters.items():
            text = theirs["parameters"].get(name)
            if text is not None:
                # OpenSim prints six digits.
                assert value == pytest.approx(
                    float({"true": 1, "false": 0}.get(text, text)), rel=1e-5
                ), name
        surfaces = {one.name: one for one in model.wrap_objects}
        ours = [
            (
                one.wrap_object.rsplit("/", 1)[-1],
                surfaces[one.wrap_object].body,
                one.method,
                one.first,
                one.last,
            )
            for one in muscle.path.wraps
        ]
        assert ours == [
            (name, body, method.lower(), *ends) for name, body, method, *ends in theirs["wraps"]
        ]


@pytest.mark.parametrize("name", FILES)
def test_what_we_write_opensim_takes_for_the_original(name, answers):
    files, facts = answers
    if name not in files:
        pytest.skip(f"needs the data set '{name.split('/')[0]}'")
    original = facts[name]
    written = facts[f"written/{name}"]
    assert not isinstance(written, str), written
    # OpenSim itself rounds what it converts from documents before 4.0 to six digits.
    old = read_document(files[name], (), "").document.version < 30500
    tolerance = 1e-6 if old else TIGHT
    assert written["mass"] == pytest.approx(original["mass"], abs=TIGHT)
    assert set(written["actuators"]) == set(original["actuators"])
    assert written["coordinates"] == original["coordinates"]
    for before, after in zip(original["poses"], written["poses"], strict=True):
        for body, (rotation, origin) in before["bodies"].items():
            assert np.allclose(after["bodies"][body][0], rotation, rtol=0, atol=tolerance)
            assert np.allclose(after["bodies"][body][1], origin, rtol=0, atol=tolerance)
        for marker, place in before["markers"].items():
            assert np.allclose(after["markers"][marker], place, rtol=0, atol=tolerance)
        for muscle, length in before["lengths"].items():
            assert after["lengths"][muscle] == pytest.approx(length, abs=tolerance), muscle
    for muscle, theirs in original["muscles"].items():
        for key in ("kind", "numbers", "enabled", "parameters"):
            assert written["muscles"][muscle][key] == theirs[key], (muscle, key)


def test_the_generic_model_opens_in_opensim(tmp_path):
    """Its muscles may be less active than OpenSim's classes allow by default."""
    pytest.importorskip("myo_sim")
    model, _ = generic_model(FrozenMap({}), 1.8, 70.0)
    write_osim(model, tmp_path / "generic.osim")
    facts = opensim_oracle.ask({"generic": tmp_path / "generic.osim"}, tmp_path)["generic"]
    assert not isinstance(facts, str), facts

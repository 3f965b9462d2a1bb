"""Species tables out of files.

Also a man's leg muscles on a mouse's skeleton as files of both have them.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.morph.species.counterparts import Posed
from myomorph.bones.study.morph_files import source_bones
from myomorph.bones.study.morphing import MorphSettings, write_morphed
from myomorph.bones.study.species_morphing import (
    SpeciesFiles,
    read_species,
    species_files,
    species_tables,
)
from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.study.inputs.reading import open_model
from opensim_oracle import ask

OWN = """
[frames]
source = { proximal = "+y", anterior = "+x", right = "+z" }
target = { proximal = "+z", anterior = "+y", right = "+x" }
[[bone]]
sources = ["femur"]
targets = ["thigh"]
landmarks = [{ name = "top", rule = "farthest", toward = { proximal = 1 } }]
"""


def test_the_table_of_man_and_mouse_is_whole():
    assert set(species_tables()) >= {"human-mouse", "human-mouse-arm"}
    table = read_species("human-mouse")
    assert {one.targets[0] for one in table.bones} >= {
        "mouse",
        "mouse__RFemur",
        "mouse__RTibia",
        "mouse__RTarsus",
    }
    assert table.homologous("semimem_r") == ("SM",)
    assert table.homologous("sart_r") == ()
    named = [name for one in table.muscles for name in one.sources]
    assert len(named) == len(set(named))
    for bone in table.bones:
        names = [rule.name for rule in bone.landmarks]
        assert len(names) == len(set(names)), bone.sources


@pytest.mark.parametrize("name", ["human-mouse", "human-mouse-arm"])
def test_tables_name_what_the_models_have(data, name):
    pytest.importorskip("myo_sim")
    leg = data("rajagopal-walk-emg/subject_walk_scaled.osim")
    source = read_model("myo-sim:myoarm") if name.endswith("arm") else open_model(leg)
    target = open_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    table = read_species(name)
    joints = [rule for bone in table.bones for rule in bone.landmarks if rule.rule == "joint"]
    ours = [n for bone in table.bones for n in (*bone.sources, *bone.transferred)] + [
        one.source_joint for one in joints
    ]
    theirs = [n for bone in table.bones for n in bone.targets] + [
        one.target_joint for one in joints
    ]
    assert set(ours) | set(table.missing) <= set(source.body_names)
    assert set(theirs) | set(table.extra) <= set(target.body_names)
    for pair in table.coordinates:
        low, high = target.coordinate(pair.target).range
        ends = [pair.factor * one + pair.offset for one in source.coordinate(pair.source).range]
        assert max(low, min(ends)) < min(high, max(ends)), pair.source
    assert {one for pair in table.muscles for one in pair.sources} <= set(source.muscle_names)


def test_the_forearms_lie_alike_in_man_and_mouse(data):
    """The radius lies on the thumb's side of the ulna's end.

    That side is its right, in the postures of the table.
    """
    pytest.importorskip("myo_sim")
    source = read_model("myo-sim:myoarm")
    target = open_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    table = read_species("human-mouse-arm")
    (bone,) = [one for one in table.bones if "radius_r" in one.sources]
    for model, posture, frame, radius, ulna, up in (
        (
            source,
            table.posture,
            table.frames(bone)[0],
            "radius_r",
            "ulna_r",
            table.source_frame.axes[0],
        ),
        (
            target,
            table.target_posture,
            table.frames(bone)[1],
            *(bone.targets),
            "mouse__RUlna",
            table.target_frame.axes[0],
        ),
    ):
        bones = source_bones(model)
        posed = Posed(model, posture)
        ends = []
        for name in (radius, ulna):
            vertices = bones[name].vertices
            height = vertices @ np.array(up)
            ends.append(
                posed.within(name, radius).apply(
                    vertices[height < np.quantile(height, 0.05)].mean(axis=0)
                )
            )
        across = frame.axes @ (ends[0] - ends[1])
        assert across[2] > 2.0 * np.abs(across[1]), radius


def test_a_table_of_ones_own(tmp_path):
    (tmp_path / "cat.toml").write_text(OWN)
    table = read_species(tmp_path / "cat.toml")
    assert table.name == "cat"
    assert table.source_frame.axes[0] == pytest.approx([0.0, 1.0, 0.0])
    assert table.bones[0].landmarks[0].toward == {"proximal": 1}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("farthest", "nearest"), "no rule 'nearest'"),
        (('right = "+x"', 'right = "-x"'), "mirrored"),
        (('proximal = "+z"', 'proximal = "up"'), "expected an axis"),
        (("sources =", "bones ="), "'bones'"),
        (("proximal = 1 }", "upward = 1 }"), "no direction 'upward'"),
        (("[frames]", "[frame]"), "'frame'"),
        (("[frames]", "[unlike]\nattachments = 4\n[frames]"), "share from 0 to 1"),
        (("[frames]", "[scaling]\nfactor = 1\n[frames]"), "the scaling has 'factor'"),
    ],
)
def test_a_bad_table_is_named(tmp_path, change, told):
    (tmp_path / "cat.toml").write_text(OWN.replace(*change))
    with pytest.raises(BadData, match=told) as error:
        read_species(tmp_path / "cat.toml")
    assert "cat.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_table_tells_which_there_are(tmp_path):
    with pytest.raises(BadFile, match="human-mouse"):
        read_species("human-cat")
    for raw in (b"name = '\xff'", b"a = " + 100_000 * b"["):
        (tmp_path / "cat.toml").write_bytes(raw)
        with pytest.raises(BadFile, match="not TOML"):
            read_species(tmp_path / "cat.toml")
    (tmp_path / "cat.toml").write_text("[frames")
    with pytest.raises(BadFile, match="not TOML"):
        read_species(tmp_path / "cat.toml")


def test_the_tables_come_with_the_package():
    assert (files("myomorph.bones.morph") / "data" / "human_mouse.toml").is_file()


def table_bodies() -> list[str]:
    """Bodies of both hindlimbs."""
    return [name for one in read_species("human-mouse").masses for name in one.bodies]


@pytest.mark.long
def test_a_mouse_gets_a_mans_arms(data):
    """Both arms' muscles, with forces by the leg's scaling.

    Those of bones that the skeleton is missing are named.
    """
    pytest.importorskip("myo_sim")
    given = SpeciesFiles(
        Path("myo-sim:myoarm"),
        data("mouse-skeleton-keypoints/mouse_with_meshes.xml"),
        "human-mouse-arm",
        mirror=True,
    )
    assert given.sources()[0].name == "myo-sim:myoarm"
    morphed, _ = species_files(given, MorphSettings.of({}))
    model = morphed.morph.model
    law = read_species("human-mouse-arm").scaling
    ours = {name for name in model.muscle_names if not name.endswith("_l")}
    assert ours >= {"DELT2", "DELT3", "TRIlong", "BIClong", "BRA", "SUBSC", "FCU", "PT"}
    assert set(model.muscle_names) == ours | {f"{name}_l" for name in ours}
    assert "DELT1" not in ours
    # As unsure as species are unlike: of a humerus of 13 mm more than 5.
    assert all(
        one.within > 5e-3 for one in morphed.morph.points if one.target_body == "mouse__RHumerus"
    )
    assert any(
        one.within is not None and np.isfinite(one.within).any() for one in morphed.checks.arms
    )
    man = read_model("myo-sim:myoarm")
    lengths = {
        one: model.muscle(one).optimal_fiber_length / man.muscle(one).optimal_fiber_length
        for one in ours
    }
    (size,) = {round(length / law.fiber, 9) for length in lengths.values()}
    assert 0.03 < size < 0.08
    for one in ours:
        force = law.force * size**2 * man.muscle(one).max_isometric_force
        assert model.muscle(one).max_isometric_force == pytest.approx(force, rel=1e-6)
        assert model.muscle(f"{one}_l").max_isometric_force == model.muscle(one).max_isometric_force


@pytest.mark.long
def test_a_mouse_gets_a_mans_muscles(data, tmp_path):
    given = SpeciesFiles(
        data("rajagopal-walk-emg/subject_walk_scaled.osim"),
        data("mouse-skeleton-keypoints/mouse_with_meshes.xml"),
        geometry=data("bones-opensim-rajagopal/Geometry"),
        mirror=True,
        mass=0.025,
        protocol="mouse-gait",
    )
    morphed, bones = species_files(given, MorphSettings(match=MatchOptions(features="landmarks")))
    model = morphed.morph.model
    assert len(model.muscles) == 80
    assert all(name.endswith("_l") for name in morphed.morph.left_out)
    assert model.mass == pytest.approx(0.025)
    legs = sum(body.mass for name in table_bodies() for body in (model.body(name),))
    assert 0.07 < legs / model.mass < 0.1
    assert {"RightKNEE", "LeftKNEE", "TAIL"} <= set(model.marker_names)
    assert not model.coordinate("mouse__LKnee_flexion").locked
    assert model.coordinate("mouse__RBPhalange3_flexion").locked
    assert model.muscle("recfem_r").max_isometric_force == pytest.approx(
        4.162 * (0.025 / 0.0205) ** (2 / 3), rel=1e-3
    )
    for muscle, change in zip(model.muscles[:40], morphed.morph.muscles, strict=True):
        # All of a rat's adductor magnus ends near the knee, so that paths of its short parts shrink
        # less than bones do.
        most = 0.2 if muscle.name.startswith("addmag") else 0.1
        assert 0.03 < change.path < most, muscle.name
        assert {point.body for point in muscle.path.points} <= set(model.body_names)
    for name in ("ehl_r", "fhl_r"):
        # The skeleton counts toes from the outer side: the first is its fifth.
        assert model.muscle(name).path.points[-1].body == "mouse__RBPhalange5"
    write_morphed(morphed, tmp_path / "mouse.osim", tmp_path / "mouse_morph", bones)
    back = read_osim(tmp_path / "mouse.osim")
    assert (tmp_path / back.body("mouse__RFemur").meshes[0].file).is_file()
    pytest.importorskip("opensim")
    found = ask({"mouse": tmp_path / "mouse.osim"}, tmp_path)["mouse"]
    assert isinstance(found, dict), found
    assert len(found["muscles"]) == 80
    assert all(
        np.isfinite(length) and length > 0.0 for length in found["poses"][0]["lengths"].values()
    )

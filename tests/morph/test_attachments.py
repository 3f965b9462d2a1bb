"""Attachments along a shaft: where a species table has them, on the bone, and never so that a path doubles back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from myomorph.model.errors import BadData
from myomorph.morph.registration.smooth import MatchOptions
from myomorph.morph.shapes.surface_points import Shape
from myomorph.morph.species.counterparts import Posed
from myomorph.morph.species.maps import species_bones
from myomorph.morph.species.table_rows import Attachment
from myomorph.study.subject.morph_files import source_bones
from myomorph.study.subject.species_morphing import read_species
from myomorph.study.trial.inputs import open_model


def test_vasti_begin_where_a_rodents_do(data):
    geometry = Path(data("bones-opensim-rajagopal/Geometry"))
    man = open_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    mouse = open_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    table = read_species("human-mouse")
    femur = next(one for one in table.bones if one.sources[0] == "femur_r")
    wanted = (
        Attachment(("vaslat_r",), "first", "femur_r", 0.11),
        # Its next point is at two thirds of the thigh.
        Attachment(("vasmed_r",), "first", "femur_r", 0.95),
    )
    table = replace(table, bones=(femur,), attachments=wanted)
    surfaces = source_bones(man, geometry, []), source_bones(mouse, None, [])
    found = species_bones(man, surfaces[0], mouse, surfaces[1], table, match=MatchOptions(features="landmarks"))
    joints = Posed(mouse, table.target_posture).joints("mouse__RFemur")
    hip, knee = joints["mouse__RFemur"], joints["mouse__RTibia"]

    def share(muscle: str) -> float:
        point = found.source.muscle(muscle).path.points[0]
        place = found.bones[point.body].map.apply(point.location)
        assert abs(Shape(surfaces[1]["mouse__RFemur"]).signed(place[None])[0]) < 2e-4
        return float((place - hip) @ (knee - hip) / ((knee - hip) @ (knee - hip)))

    assert share("vaslat_r") == pytest.approx(0.11, abs=0.03)
    assert man.muscle("vaslat_r").path.points[0].location == pytest.approx(
        found.source.muscle("vaslat_r").path.points[0].location
    )
    assert found.source.muscle("vasmed_r").path.points[0].body == "femur_r"
    assert any("double back: vasmed_r" in one for one in found.notes)


def test_an_attachment_off_the_bone_is_refused():
    with pytest.raises(BadData, match="vaslat_r"):
        Attachment(("vaslat_r",), "first", "femur_r", 11.0)

"""Attachments of a relative, through its landmarks to the bone.

A path never doubles back.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.morph.species.attachments import Attachment, RelativeBone
from myomorph.bones.morph.species.counterparts import Posed, Skeleton
from myomorph.bones.morph.species.maps import SpeciesOptions, species_bones
from myomorph.bones.morph.transfer.body_transfer import Transfer
from myomorph.bones.study.morph_files import source_bones
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.model.errors import BadData
from myomorph.core.surfaces.surface_points import Shape
from myomorph.lab.study.inputs.reading import open_model


@pytest.fixture(scope="module")
def femora(data):
    """Read a man's model and a mouse's with their bones.

    The species table has the femur alone.
    """
    man = open_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    mouse = open_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    table = read_species("human-mouse")
    femur = next(one for one in table.bones if one.sources[0] == "femur_r")
    surfaces = (
        source_bones(man, Path(data("bones-opensim-rajagopal/Geometry"))),
        source_bones(mouse),
    )
    table = replace(table, bones=(femur,), relatives=())

    def bones(*relatives: RelativeBone, straight: tuple[str, ...] = ()):
        wanted = replace(table, relatives=relatives, straight=straight)
        return species_bones(
            Skeleton(man, surfaces[0]),
            Skeleton(mouse, surfaces[1]),
            wanted,
            SpeciesOptions(match=MatchOptions(features="landmarks")),
        )

    return (
        bones,
        surfaces[1]["mouse__RFemur"],
        Posed(mouse, table.target_posture).joints("mouse__RFemur"),
    )


def relative(femora, *attachments: Attachment) -> RelativeBone:
    """Make a relative of the mouse: its own femur, three times as large and rotated.

    The attachment positions are known.
    """
    marks = femora[0]().bones["femur_r"].features
    named = {
        name: tuple(3.0 * at[[2, 0, 1]]) for name, at in zip(marks.names, marks.target, strict=True)
    }
    return RelativeBone("femur_r", named, attachments)


def test_an_attachment_on_a_larger_turned_bone_comes_back(femora):
    bones, surface, joints = femora
    hip = joints["mouse__RFemur"]
    knee = joints["mouse__RTibia"]
    place = Shape(surface).closest((hip + 0.15 * (knee - hip))[None])[0][0]
    one = Attachment(("vaslat_r",), "first", tuple(3.0 * place[[2, 0, 1]]))
    found = bones(relative(femora, one))
    point = found.source.muscle("vaslat_r").path.points[0]
    assert found.bones[point.body].map.apply(point.location) == pytest.approx(place, abs=1e-5)
    assert np.isnan(
        Transfer(found.bones[point.body], point.body).within(point.location[None])
    ).all()


def test_a_path_never_doubles_back(femora):
    bones, _, joints = femora
    # The next point of vastus medialis is at two thirds of the thigh.
    beyond = 3.0 * joints["mouse__RTibia"][[2, 0, 1]]
    found = bones(relative(femora, Attachment(("vasmed_r",), "first", tuple(beyond))))
    assert found.source.muscle("vasmed_r").path.points[0].body == "femur_r"
    assert any("double back: vasmed_r" in one for one in found.notes)


def test_a_straight_muscle_keeps_its_ends_alone(femora):
    before = femora[0](straight=()).source
    after = femora[0](straight=("iliacus_r",)).source
    points = before.muscle("iliacus_r").path.points
    kept = after.muscle("iliacus_r").path.points
    assert len(points) > 2
    assert not after.muscle("iliacus_r").path.wraps
    assert kept == (points[0], points[-1])
    assert after.muscle("psoas_r") == before.muscle("psoas_r")


def test_too_few_landmarks_in_common_are_refused(femora):
    few = replace(relative(femora), landmarks={"head": (0.0, 0.0, 0.0), "elbow": (1.0, 0.0, 0.0)})
    with pytest.raises(BadData, match=r"1 landmarks in common .*head"):
        femora[0](few)


def test_an_attachment_of_another_end_is_refused():
    with pytest.raises(BadData, match="vaslat_r"):
        Attachment(("vaslat_r",), "middle", (0.0, 0.0, 0.0))

"""Digits: one tendon, one ray, and the side of the joint that it passes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from myomorph.bones.morph.species.counterparts import Posed, Ray
from myomorph.bones.morph.species.rays import SidedMap, put_on_rays
from myomorph.bones.morph.transfer.body_transfer import Transfer
from myomorph.bones.study.morph_files import source_bones
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.surfaces.linear_maps import Similarity
from myomorph.lab.study.inputs.reading import open_model


def test_points_keep_their_side_and_the_map_its_derivative():
    turn = axis_rotation(np.array([0.0, 0.6, 0.8]), 0.7)
    whole = Similarity(turn, np.array([0.1, 0.2, 0.3]), 0.5)
    along = np.array([0.6, 0.8, 0.0])
    dorsal = np.array([-0.8, 0.6, 0.0])
    center = whole.apply(np.zeros(3))
    made = SidedMap(whole=whole, center=center, along=along, dorsal=dorsal, ahead=0.02, above=0.01)
    points = np.random.default_rng(0).normal(0.0, 0.1, (40, 3))
    away = made.apply(points) - center
    assert (away @ along).min() >= 0.02 - 1e-12
    assert (away @ dorsal).min() >= 0.01 - 1e-12
    free = ((whole.apply(points) - center) @ along > 0.02) & (
        (whole.apply(points) - center) @ dorsal > 0.01
    )
    assert 0 < free.sum() < len(points)
    assert made.apply(points)[free] == pytest.approx(whole.apply(points)[free])
    step = 1e-6
    slopes = np.stack(
        [
            (made.apply(points + step * e) - made.apply(points - step * e)) / (2 * step)
            for e in np.eye(3)
        ],
        2,
    )
    assert made.jacobian(points) == pytest.approx(slopes, abs=1e-8)


def test_a_muscle_cannot_extend_and_flex():
    with pytest.raises(BadData, match="edl_r"):
        Ray(toe="toe", metatarsal="metatarsal", extensors=("edl_r",), flexors=("edl_r",))


def test_tendons_of_a_mouse_stay_on_their_ray(data):
    """Every tendon of a man's toes on one toe of the mouse.

    They pass behind and in front of its joint, above or below it.
    """
    geometry = Path(data("bones-opensim-rajagopal/Geometry"))
    man = open_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    mouse = open_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    table = read_species("human-mouse")
    bone = next(one for one in table.bones if one.rays)
    posed = (
        Posed(man, table.posture, source_bones(man, geometry)),
        Posed(mouse, table.target_posture, source_bones(mouse)),
    )
    rays = put_on_rays(man, bone, table, posed)
    across = table.target_frame.axes[2]
    for ray in bone.rays:
        for names, sign in ((ray.extensors, 1.0), (ray.flexors, -1.0)):
            for name in names:
                points = [
                    (rays.bones[p.body], p)
                    for p in rays.source.muscle(name).path.points
                    if p.body in rays.bones
                ]
                assert {made.target_body for made, _ in points} == {ray.toe, ray.metatarsal}
                on_toes = [p for p in man.muscle(name).path.points if p.body == "toes_r"]
                assert sum(made.target_body == ray.toe for made, _ in points) == len(on_toes)
                joint = posed[1].joints("mouse")[ray.toe]
                placed = [
                    posed[1].within(m.target_body, "mouse").apply(m.map.apply(p.location))
                    for m, p in points
                ]
                behind = max(
                    i for i, (m, _) in enumerate(points) if m.target_body == ray.metatarsal
                )
                line = placed[behind + 1] - placed[behind]
                from_joint = placed[behind] - joint
                # Turning the toes up shortens what passes above the joint.
                assert sign * np.cross(from_joint, line) @ across < 0.0, name


@pytest.mark.parametrize(
    "source",
    [
        "rajagopal-walk-emg/subject_walk_scaled.osim",
        "rajagopal-walk-emg/raw/Rajagopal2016.osim",
        "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim",
    ],
)
def test_bones_of_a_ray_keep_their_side_and_the_size_of_its_toe(source, data):
    """However many of a bone's points the joint holds back, its side is found.

    They flatten the nearest affine map until its determinant is noise: a generic man was refused as
    the other side's.
    """
    man = open_model(data(source))
    mouse = open_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    geometry = Path(data("bones-opensim-rajagopal/Geometry"))
    table = read_species("human-mouse")
    bone = next(one for one in table.bones if one.rays)
    posed = (
        Posed(man, table.posture, source_bones(man, geometry)),
        Posed(mouse, table.target_posture, source_bones(mouse)),
    )
    rays = put_on_rays(man, bone, table, posed)
    assert len(rays.bones) == 2 * 2 * len(bone.rays)
    for made in rays.bones.values():
        transfer = Transfer(made, made.target_body)
        assert transfer.volume == pytest.approx(made.whole.scale**3)
        np.testing.assert_allclose(transfer.linear, made.whole.scale * made.whole.rotation)

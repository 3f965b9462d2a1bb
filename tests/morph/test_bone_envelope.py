"""An envelope has the volume that is asked for, does not depend on size, and knows whose soft tissue is whose."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from boxed_leg import BONES, HALF, LENGTH, box, grown, leg
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.surface import Surface
from myomorph.morph.checks.penetration import Solid
from myomorph.morph.shapes.envelope import grow_envelope, soft_tissue_of

BALL = trimesh.creation.icosphere(3, 0.1)
RADIUS = 0.1


def ball():
    """A ball in the thigh's frame."""
    return {"thigh": Surface(np.array(BALL.vertices), np.array(BALL.faces))}


@pytest.mark.parametrize("soft_tissue", [0.05, 0.2])
def test_soft_tissue_on_a_ball_is_a_larger_ball(soft_tissue):
    found = grow_envelope(leg(), ball(), soft_tissue=soft_tissue, cells=48)
    # The faceted ball is a little smaller than a round one.
    radius = (0.75 / np.pi * BALL.volume) ** (1.0 / 3.0) + 2.0 * soft_tissue * RADIUS
    assert found.volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(found.surface.vertices, axis=1), radius, rtol=0.015)
    solid = Solid(found.surface)
    assert not solid.open
    assert solid.turned == 0.0


@pytest.mark.parametrize("size", [1.0, 0.04])
def test_the_soft_tissue_follows_from_the_volume_whatever_the_size(size):
    bones = {name: Surface(one.vertices * size, one.faces) for name, one in BONES.items()}
    model = grown(leg(), size)
    found = grow_envelope(model, bones, volume=0.012 * size**3)
    # Boxes have many places at one distance, which are all inside or all outside.
    assert found.volume == pytest.approx(0.012 * size**3, rel=0.01)
    assert found.soft_tissue["thigh"] == pytest.approx(found.soft_tissue["shank"])
    assert found.soft_tissue["thigh"] == pytest.approx(
        grow_envelope(leg(), BONES, volume=0.012).soft_tissue["thigh"], rel=1e-6
    )
    assert sum(found.volumes.values()) == pytest.approx(found.volume)
    # Both boxes are alike, and so is what surrounds them.
    assert found.volumes["thigh"] == pytest.approx(found.volumes["shank"], rel=0.1)


def test_soft_tissue_is_as_thick_as_masses_ask_for():
    model, density = leg(), 1050.0
    soft_tissue = soft_tissue_of(model, BONES, density)
    found = grow_envelope(model, BONES, volume=12.0 / density, soft_tissue=soft_tissue)
    assert density * found.volumes["thigh"] == pytest.approx(8.0, rel=0.05)
    assert density * found.volumes["shank"] == pytest.approx(4.0, rel=0.05)
    assert soft_tissue["thigh"] > soft_tissue["shank"]


def test_bodies_around_a_belly_have_a_common_hull():
    bones = BONES | {"shank": Surface(BONES["shank"].vertices + [0.3, 0.0, 0.0], BONES["shank"].faces)}
    apart = grow_envelope(leg(), bones, soft_tissue=0.02)
    joined = grow_envelope(leg(), bones, soft_tissue=0.02, together=[("thigh", "shank")])
    assert joined.volume > 2.0 * apart.volume
    assert min(joined.volumes.values()) > 0.3 * joined.volume


def test_between_two_bones_a_place_belongs_to_the_one_that_is_nearer_for_its_size():
    """Upright bones of lengths 0.4 and 0.2 m, 0.3 m apart: two thirds of the way across are the larger one's."""
    bones = {"thigh": box(0.0), "shank": box(0.0, length=0.2)}
    bones["shank"] = Surface(bones["shank"].vertices + [0.3 + 2.0 * HALF, LENGTH, 0.0], bones["shank"].faces)
    found = grow_envelope(leg(), bones, soft_tissue=0.001, together=[("thigh", "shank")])
    across = found.points[:, 0] - HALF
    middle = (np.abs(found.points[:, 1]) < 0.08) & (np.abs(across - 0.2) > 2.0 * found.spacing) & (across < 0.29)
    assert middle.sum() > 1000
    np.testing.assert_array_equal(found.owner[middle], np.where(across[middle] < 0.2, 0, 1))


def test_what_cannot_be_is_named():
    with pytest.raises(BadData, match="no bone"):
        grow_envelope(leg(), {})
    with pytest.raises(BadData, match="the bones alone fill"):
        grow_envelope(leg(), BONES, volume=1e-4)
    with pytest.raises(BadData, match="times the usual soft tissue"):
        grow_envelope(leg(), BONES, volume=1.0)
    with pytest.raises(UnknownName, match="tail"):
        grow_envelope(leg(), {"tail": BONES["thigh"]})
    flat = Surface(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2]]))
    with pytest.raises(BadData, match="'thigh' is flat"):
        grow_envelope(leg(), {"thigh": flat})

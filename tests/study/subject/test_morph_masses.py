"""Masses of a morphed model: nothing is lost, and every body is possible.

A model that only grew keeps its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from boxed_leg import grown, leg, morph_of
from myomorph.bones.study.morph_masses import with_morphed_masses
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.core.model.model import Body
from myomorph.core.model.surface import Surface


@pytest.fixture
def morph():
    source = leg()
    return morph_of(source, grown(source, 1.1), 1.1)


def test_masses_that_the_maps_carried_stay_in_their_proportion(morph):
    found, notes = with_morphed_masses(morph, 20.0)
    assert found.mass == pytest.approx(20.0, rel=1e-10)
    for body, before in zip(found.bodies, morph.model.bodies, strict=True):
        share = 20.0 / morph.model.mass
        assert body.mass == pytest.approx(share * before.mass)
        np.testing.assert_allclose(body.mass_center, before.mass_center, atol=1e-12)
        np.testing.assert_allclose(body.inertia, share * before.inertia, atol=1e-12)
    assert notes == ("masses are the source's, carried by the bones' maps, 20 kg together",)


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_a_skin_is_filled_with_mass_points(size):
    source = leg()
    morph = morph_of(source, grown(source, size), size)
    tube = trimesh.creation.cylinder(radius=0.06 * size, height=0.86 * size, sections=64)
    upright = trimesh.transformations.rotation_matrix(np.pi / 2.0, [1.0, 0.0, 0.0])
    tube.apply_transform(upright)
    tube.apply_translation([0.0, -0.41 * size, 0.0])
    found, notes = with_morphed_masses(
        morph, 12.0 * size**3, Surface(np.array(tube.vertices), np.array(tube.faces))
    )
    assert found.mass == pytest.approx(12.0 * size**3, rel=1e-10)
    assert (np.linalg.eigvalsh(pseudo_inertias(inertial_parameters(found))) > 0.0).all()
    middle = (
        sum(
            body.mass * (body.mass_center + np.array([0.0, down * size, 0.0]))
            for body, down in zip(found.bodies, (0.0, -0.4), strict=True)
        )
        / found.mass
    )
    np.testing.assert_allclose(middle, [0.0, -0.41 * size, 0.0], atol=0.002 * size)
    assert any("mass points inside the skin" in note for note in notes)


def test_what_cannot_be_is_named(morph):
    with pytest.raises(BadData, match="a mass of -1 kg"):
        with_morphed_masses(morph, -1.0)
    light = replace(
        morph.model,
        bodies=tuple(
            Body(name=one.name, mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3)))
            for one in morph.model.bodies
        ),
    )
    with pytest.raises(BadData, match="no masses to carry over"):
        with_morphed_masses(replace(morph, model=light), 10.0)


@pytest.mark.parametrize("mass", [None, 12.0])
def test_a_skin_that_holds_another_body_is_refused(morph, mass):
    room = trimesh.creation.box([2.0, 3.0, 2.0])
    with pytest.raises(BadData, match=r"the skin holds 1\d\.?\d? m\^3, .* are expected"):
        with_morphed_masses(morph, mass, Surface(np.array(room.vertices), np.array(room.faces)))


def test_a_skin_that_is_elsewhere_is_refused(morph):
    ball = trimesh.creation.icosphere(2, 0.3)
    away = Surface(np.array(ball.vertices) + [2.0, 0.0, 0.0], np.array(ball.faces))
    with pytest.raises(BadData, match="not where model 'boxes' stands"):
        with_morphed_masses(morph, 12.0, away)

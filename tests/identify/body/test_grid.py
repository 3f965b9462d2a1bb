"""Mass points on a grid: volumes by count, equivariance, masses by region."""

from __future__ import annotations

import numpy as np
import pytest
from skins import box, capsule, sphere

from myomorph.body.shape.points import DENSITIES, fill, reference_masses
from myomorph.body.shape.skin import Skin, check_skin, inside
from myomorph.core.model.errors import BadData, UnknownName


@pytest.mark.parametrize(
    ("surface", "volume"),
    [
        (sphere(), 4.0 / 3.0 * np.pi * 0.1**3),
        (box(0.201, 0.301, 0.101), 0.2 * 0.3 * 0.1),
        (capsule(), np.pi * 0.06**2 * 0.4 + 4.0 / 3.0 * np.pi * 0.06**3),
    ],
)
def test_volume_by_count(surface, volume):
    points = fill(check_skin(surface), 0.005)
    assert len(points) * 0.005**3 == pytest.approx(volume, rel=0.01)


def test_the_points_are_all_of_the_grid_that_are_inside():
    skin = check_skin(capsule())
    spacing = 0.0183
    steps = (np.arange(-18, 18) + 0.5) * spacing
    every = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = every[inside(skin, every)]
    np.testing.assert_allclose(fill(skin, spacing), expected, atol=1e-12)


def test_a_skin_moved_by_whole_spacings_has_the_same_points_moved():
    skin = check_skin(sphere())
    by = np.array([3, -7, 11]) * 0.004
    np.testing.assert_allclose(
        fill(skin.moved(np.eye(3), by), 0.004), fill(skin, 0.004) + by, atol=1e-12
    )


def test_an_open_skin_is_filled_too():
    whole = check_skin(sphere())
    open_ = Skin(
        type(whole.surface)(whole.surface.vertices, whole.surface.faces[20:]), watertight=False
    )
    assert len(fill(open_, 0.01)) == pytest.approx(len(fill(whole, 0.01)), rel=0.02)


def test_spacings_that_cannot_be():
    skin = check_skin(box())
    for spacing, words in ((0.0, "above 0"), (2.0, "no point"), (1e-4, "wider spacing")):
        with pytest.raises(BadData, match=words):
            fill(skin, spacing)


def test_reference_masses_are_even_or_by_density():
    points = fill(check_skin(box()), 0.02)
    assert reference_masses(points, 70.0) == pytest.approx(np.full(len(points), 70.0 / len(points)))
    regions = np.where(points[:, 1] > 0.0, "upper_trunk", "thigh")
    masses = reference_masses(points, 70.0, regions)
    assert masses.sum() == pytest.approx(70.0)
    ratio = masses[regions == "thigh"][0] / masses[regions == "upper_trunk"][0]
    assert ratio == pytest.approx(DENSITIES["thigh"] / DENSITIES["upper_trunk"])
    with pytest.raises(UnknownName, match="region 'tail'"):
        reference_masses(points, 70.0, np.full(len(points), "tail"))
    with pytest.raises(BadData, match="above 0"):
        reference_masses(points, 0.0)

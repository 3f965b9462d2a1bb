"""A residual map shows where a surface lies outside another, and where inside."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from myomorph.core.model.surface import Surface
from myomorph.lab.report.charts.pictures import residual_map


def pictures(drawn):
    """Return the pictures (height, width, 4) in 0..1; the last is the scale."""
    return [
        imread(io.BytesIO(base64.b64decode(one))) for one in re.findall(r"base64,([^\"]+)", drawn)
    ]


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(3, 0.1)
    mesh.apply_scale([1.0, 2.0, 0.7])
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64))


def test_outside_is_red_and_inside_blue(ball):
    top = np.where(ball.vertices[:, 1] > 0.0, 1e-3, -1e-3)
    first, second, scale = pictures(residual_map("b", "mm", ball, top))
    for one in (first, second):
        solid = one[..., 3] > 0.9
        redness = (one[..., 0] - one[..., 2]) * solid
        upper = redness[: len(one) // 3].sum()
        lower = redness[-(len(one) // 3) :].sum()
        assert upper * lower < 0.0
        assert abs(upper + lower) < 0.5 * abs(upper)
    assert scale[0, 0, 2] > scale[0, 0, 0]
    assert scale[0, -1, 0] > scale[0, -1, 2]


def test_the_scale_holds_95_percent(ball):
    distances = np.linspace(-1.0, 1.0, len(ball.vertices)) * 2e-3
    drawn = residual_map("bone <1>", "mm", ball, distances)
    reach = 1e3 * np.percentile(np.abs(distances), 95.0)
    assert f">{reach:.2f}<" in drawn
    assert "bone &lt;1&gt;" in drawn


def test_a_picture_is_as_long_as_the_surface(ball):
    (one, *_) = pictures(residual_map("b", "mm", ball, np.zeros(len(ball.vertices))))
    rows = np.flatnonzero((one[..., 3] > 0.5).any(axis=1))
    columns = np.flatnonzero((one[..., 3] > 0.5).any(axis=0))
    assert np.ptp(rows) / np.ptp(columns) == pytest.approx(2.0, rel=0.03)

"""A surface in colors of how far each place lies from the surface it was fitted to, from two sides."""

from __future__ import annotations

from html import escape

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.surface import Surface
from myomorph.report.charts.axis import number
from myomorph.report.charts.chart import heading
from myomorph.report.scene.image import Bytes, data_uri, png
from myomorph.report.scene.raster import Canvas, View
from myomorph.report.scene.shapes import normals

WIDTH, HEIGHT = 330, 250
PICTURE = 180
"""Height of the pictures in the drawing's units."""
SHRINK = 2
LEVELS = 15
"""Colors; each is drawn over the same depth."""
FILL = 0.92
ANCHORS = ((0.13, 0.35, 0.62), (0.88, 0.87, 0.84), (0.70, 0.16, 0.14))
"""Inside, on and outside the other surface."""


def residual_map(title: str, told: str, surface: Surface, distances: Array) -> str:
    """The drawing, with its scale of colors [mm]: 95 % of the places lie within it.

    Parameters
    ----------
    told : what stands behind the title
    distances : (vertices,) positive outside [m]
    """
    reach = max(float(np.percentile(np.abs(distances), 95.0)), 1e-9)
    views = [_picture(surface, distances / reach, axes) for axes in _sides(surface.vertices)]
    parts = [
        f'<svg class="chart map" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title, True)}">',
        heading(title, told),
    ]
    widths = [PICTURE * image.shape[1] / image.shape[0] for image in views]
    shrink = min(1.0, 0.46 * WIDTH / max(widths))
    for middle, image, width in zip((0.27 * WIDTH, 0.73 * WIDTH), views, widths, strict=True):
        wide, tall = shrink * width, shrink * PICTURE
        place = f'x="{middle - wide / 2:.1f}" y="{22 + (PICTURE - tall) / 2:.1f}"'
        parts.append(f'<image href="{data_uri(png(image))}" {place} width="{wide:.1f}" height="{tall:.1f}"/>')
    bar = np.zeros((1, 256, 4), dtype=np.uint8)
    bar[0, :, :3] = 255 * _color(np.linspace(-1.0, 1.0, 256))
    bar[..., 3] = 255
    left, y = WIDTH / 2 - 80, HEIGHT - 34
    parts.append(
        f'<image href="{data_uri(png(bar))}" x="{left:g}" y="{y}" width="160" height="8" preserveAspectRatio="none"/>'
    )
    for at, value in ((0.0, -reach), (80.0, 0.0), (160.0, reach)):
        parts.append(f'<text class="tick x" x="{left + at:g}" y="{y + 20}">{number(1e3 * value)}</text>')
    parts.append("</svg>")
    return "".join(parts)


def _sides(vertices: Array) -> list[Array]:
    """Two views (3, 3) with the longest way upright, along the two shorter ways."""
    _, _, ways = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    up, second = ways[0], ways[1]
    third = np.cross(second, up)
    return [np.stack([second, up, third]), np.stack([-third, up, second])]


def _picture(surface: Surface, levels: Array, axes: Array) -> Bytes:
    """(height, width, 4) pixels of the surface in the colors of levels (vertices,), -1 to 1."""
    seen = surface.vertices @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = FILL * 2.0 * PICTURE / max(float(high[1] - low[1]), 1e-9)
    width = int(np.ceil(scale * (high[0] - low[0]) / FILL)) + 2
    center = axes.T @ (0.5 * (low + high))
    canvas = Canvas(View(axes, center, scale * SHRINK, width * SHRINK, 2 * PICTURE * SHRINK))
    shading = normals(surface)
    of_face = np.clip(levels[surface.faces].mean(axis=1), -1.0, 1.0)
    index = np.minimum((0.5 * (of_face + 1.0) * LEVELS).astype(np.int64), LEVELS - 1)
    for level in np.unique(index):
        color = _color(np.array([(2.0 * level + 1.0) / LEVELS - 1.0]))[0]
        canvas.surface(surface.vertices, shading, surface.faces[index == level], color)
    return canvas.picture(SHRINK)


def _color(levels: Array) -> Array:
    """(n, 3) in 0..1."""
    return np.stack([np.interp(levels, (-1.0, 0.0, 1.0), one) for one in zip(*ANCHORS, strict=True)], axis=1)

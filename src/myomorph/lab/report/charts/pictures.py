"""Charts that hold pictures: the body over time or in colors, surfaces in colors of a residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.surface import Surface
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.marks import Box, drawing, image, mark, text
from myomorph.lab.report.charts.tracks import LEFT, RIGHT, WIDTH, Backdrop
from myomorph.lab.report.scene.image import Bytes, data_uri, png
from myomorph.lab.report.scene.pictures import Picture, pictures, proportion
from myomorph.lab.report.scene.raster import Canvas, View
from myomorph.lab.report.scene.scene import Scene
from myomorph.lab.report.scene.shapes import normals

TALL = 176.0
PIXELS = 270
FOOT = 20.0
GAP = 10.0
MIN_PICTURES = 4
OVERLAP = 1.06

MAP_WIDTH = 330
MAP_HEIGHT = 250
PICTURE = 180  # Height of the pictures of a residual map, in the drawing's own units.
SHRINK = 2
LEVELS = 15  # Colors; each is drawn over the same depth.
FILL = 0.92
# Inside, on and outside the other surface.
ANCHORS = ((0.13, 0.35, 0.62), (0.88, 0.87, 0.84), (0.70, 0.16, 0.14))


def even_times(span: tuple[float, float], count: int) -> tuple[float, ...]:
    """Middles of `count` equal parts of a span [s]: pictures there stand over their own times."""
    return tuple(
        float(time) for time in span[0] + (np.arange(count) + 0.5) / count * (span[1] - span[0])
    )


def fitting(scene: Scene, max_count: int, view: str = "oblique") -> int:
    """How many pictures of this scene fill a strip, between `MIN_PICTURES` and `max_count`."""
    count = (WIDTH - RIGHT - LEFT) / (TALL * proportion(scene, view))
    return int(np.clip(count, min(MIN_PICTURES, max_count), max_count))


def picture_strip(scene: Scene, behind: Backdrop, view: str = "oblique") -> str:
    """Draw the scene's frames side by side as an `<svg>` element.

    Each is tied to its time on the axis below.
    """
    count = len(scene.time)
    room = OVERLAP * (WIDTH - RIGHT - LEFT) / count
    drawn = pictures(scene, (PIXELS, max(40, int(room / TALL * PIXELS))), views=(view,))
    tall = max(picture.height for picture in drawn) * TALL / PIXELS
    wide = max(picture.width for picture in drawn) * TALL / PIXELS
    height = tall + FOOT
    area = behind.frame(0.0, height)
    parts = [behind.behind(area)]
    at = area.x.at(scene.time)
    middles = pictures_beside(at, wide / OVERLAP, LEFT, WIDTH - RIGHT)
    for i, (picture, middle) in enumerate(zip(drawn, middles, strict=True)):
        time = number(float(scene.time[i]), 0.01)
        parts.append(
            image(
                picture.address,
                Box(x=middle - wide / 2, y=0.0, width=wide, height=tall),
                f"The body at {time} s",
            )
        )
        parts.append(
            mark("path", "zero", d=f"M{middle:.1f} {height - 7:.1f}L{at[i]:.1f} {height:.1f}")
        )
        parts.append(text(middle, height - 10, f"{time} s", "tick x"))
    return drawing(
        "strip-row", f"The body at {count} instants", (WIDTH, round(height, 1)), *parts, unit=None
    )


def pictures_beside(wanted: Array, wide: float, left: float, right: float) -> Array:
    """Find the positions nearest to those wanted, in least squares, for pictures side by side.

    Parameters
    ----------
    wanted : (pictures,) middles, in rising order [px]
    wide : distance of two middles [px]
    left, right : borders [px]

    Returns
    -------
    (pictures,) middles, `wide` apart and within the borders [px]
    """
    apart = wide * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []
    for place in wanted - apart:
        mean = float(place)
        count = 1
        while blocks and blocks[-1][0] > mean:
            before, several = blocks.pop()
            mean = (several * before + count * mean) / (several + count)
            count = several + count
        blocks.append((mean, count))
    middles = np.repeat([mean for mean, _ in blocks], [count for _, count in blocks])
    low = left + wide / 2
    high = right - wide / 2 - apart[-1]
    return np.clip(middles, min(low, high), max(low, high)) + apart


def nearest_frames(time: np.ndarray, good: np.ndarray, wanted: Sequence[float]) -> list[int]:
    """Find the good frames nearest to the wanted times, each once, in order of time.

    Parameters
    ----------
    time : (frames,) [s]
    good : indices of the frames to choose from
    wanted : times [s]

    Returns
    -------
    Indices of frames
    """
    return sorted({int(good[int(np.argmin(np.abs(time[good] - at)))]) for at in wanted})


@read_only
class Scale:
    """Colors of pictures, and what they stand for.

    Attributes
    ----------
    palette : (256, 3) colors
    ends : words along them
    """

    palette: Bytes
    ends: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class RowLook:
    """How a row of pictures looks.

    Attributes
    ----------
    unit : of the title; None for no title
    width : of the chart at most [px]
    """

    unit: str | None = None
    width: float = 560.0


def picture_row(
    title: str,
    drawn: Sequence[Picture],
    labels: Sequence[str] = (),
    scale: Scale | None = None,
    look: RowLook | None = None,
) -> str:
    """Draw pictures side by side, with labels or a scale of their colors below.

    Parameters
    ----------
    title : of the chart
    drawn : the pictures
    labels : one per picture
    scale : of their colors; None for none
    look : title and width

    Returns
    -------
    The chart as an `<svg>` element
    """
    wide = sum(picture.width for picture in drawn)
    tall = max(picture.height for picture in drawn)
    look = look or RowLook()
    width = min(float(WIDTH), max(look.width, wide + GAP * len(drawn)))
    shrink = min(1.0, (width - GAP * len(drawn)) / wide)
    gap = (width - shrink * wide) / len(drawn)
    top = 0.0 if look.unit is None else 20.0
    bottom = top + shrink * tall
    parts = []
    x = 0.5 * gap
    for i, picture in enumerate(drawn):
        w = shrink * picture.width
        h = shrink * picture.height
        parts.append(
            image(picture.address, Box(x=x, y=top + 0.5 * (shrink * tall - h), width=w, height=h))
        )
        parts.append(text(x + w / 2, bottom + 14, labels[i], "tick x") if labels else "")
        x += w + gap
    if scale is not None:
        bar = data_uri(png(np.arange(256, dtype=np.uint8)[None], scale.palette))
        parts.append(color_scale(bar, width / 2 - 110, bottom + 14.0, (220.0, 9.0), scale.ends))
    below = (18 if labels else 0) + (46 if scale is not None else 0)
    return drawing("body", title, (round(width), round(bottom + below)), *parts, unit=look.unit)


def color_scale(
    bar: str, x: float, y: float, size: tuple[float, float], words: Sequence[str]
) -> str:
    """Draw a bar of colors with words in even steps below it."""
    steps = zip(np.linspace(0.0, size[0], len(words)), words, strict=True)
    below = (text(x + at, y + 14 + size[1] * 2 / 3, word, "tick x") for at, word in steps)
    return image(bar, Box(x=x, y=y, width=size[0], height=size[1]), stretch=True) + "".join(below)


def residual_map(title: str, unit: str, surface: Surface, distances: Array) -> str:
    """Draw a surface, from two sides, in colors of its distance to the surface it was fitted to.

    Parameters
    ----------
    title : of the chart
    unit : of the title
    surface : that was fitted
    distances : (vertices,) positive outside [m]; the scale of colors [mm] holds 95 % of them

    Returns
    -------
    The chart as an `<svg>` element
    """
    reach = max(float(np.percentile(np.abs(distances), 95.0)), 1e-9)
    # Two views with the longest way upright, along the two shorter ways.
    up, second = np.linalg.svd(
        surface.vertices - surface.vertices.mean(axis=0), full_matrices=False
    )[2][:2]
    third = np.cross(second, up)
    sides = np.stack([second, up, third]), np.stack([-third, up, second])
    views = [_surface_pixels(surface, distances / reach, axes) for axes in sides]
    widths = [PICTURE * view.shape[1] / view.shape[0] for view in views]
    shrink = min(1.0, 0.46 * MAP_WIDTH / max(widths))
    parts = []
    for middle, pixels, width in zip(
        (0.27 * MAP_WIDTH, 0.73 * MAP_WIDTH), views, widths, strict=True
    ):
        wide = shrink * width
        tall = shrink * PICTURE
        parts.append(
            image(
                data_uri(png(pixels)),
                Box(x=middle - wide / 2, y=22 + (PICTURE - tall) / 2, width=wide, height=tall),
            )
        )
    bar = np.zeros((1, 256, 4), dtype=np.uint8)
    bar[0, :, :3] = 255 * _residual_color(np.linspace(-1.0, 1.0, 256))
    bar[..., 3] = 255
    words = [number(1e3 * value) for value in (-reach, 0.0, reach)]
    parts.append(
        color_scale(data_uri(png(bar)), MAP_WIDTH / 2 - 80, MAP_HEIGHT - 34.0, (160.0, 8.0), words)
    )
    return drawing("map", title, (MAP_WIDTH, MAP_HEIGHT), *parts, unit=unit)


def _surface_pixels(surface: Surface, levels: Array, axes: Array) -> Bytes:
    """(height, width, 4) pixels of the surface in the colors of levels (vertices,), -1 to 1."""
    seen = surface.vertices @ axes.T
    low = seen.min(axis=0)
    high = seen.max(axis=0)
    scale = FILL * 2.0 * PICTURE / max(float(high[1] - low[1]), 1e-9)
    width = int(np.ceil(scale * (high[0] - low[0]) / FILL)) + 2
    center = axes.T @ (0.5 * (low + high))
    canvas = Canvas(
        View(
            axes=axes,
            center=center,
            scale=scale * SHRINK,
            width=width * SHRINK,
            height=2 * PICTURE * SHRINK,
        )
    )
    shading = normals(surface)
    of_face = np.clip(levels[surface.faces].mean(axis=1), -1.0, 1.0)
    index = np.minimum((0.5 * (of_face + 1.0) * LEVELS).astype(np.int64), LEVELS - 1)
    for level in np.unique(index):
        color = _residual_color(np.array([(2.0 * level + 1.0) / LEVELS - 1.0]))[0]
        canvas.surface(surface.vertices, shading, surface.faces[index == level], color)
    return canvas.picture(SHRINK)


def _residual_color(levels: Array) -> Array:
    """(n, 3) in 0..1."""
    return np.stack(
        [np.interp(levels, (-1.0, 0.0, 1.0), channel) for channel in zip(*ANCHORS, strict=True)],
        axis=1,
    )

"""Pictures of the body along a time axis: muscles colored by activation, forces as arrows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number
from myomorph.report.charts.tracks import LEFT, RIGHT, WIDTH, Backdrop
from myomorph.report.scene.image import data_uri
from myomorph.report.scene.pictures import pictures, proportion
from myomorph.report.scene.scene import Scene

TALL = 176.0
PIXELS = 270
FOOT = 20.0
FEWEST = 4
OVERLAP = 1.06


def even_times(span: tuple[float, float], count: int) -> tuple[float, ...]:
    """Middles of `count` equal parts of a span [s]: pictures there stand over their own times."""
    return tuple(float(one) for one in span[0] + (np.arange(count) + 0.5) / count * (span[1] - span[0]))


def fitting(scene: Scene, most: int, view: str = "oblique") -> int:
    """How many pictures of this scene fill a strip, between `FEWEST` and `most`."""
    return int(np.clip((WIDTH - RIGHT - LEFT) / (TALL * proportion(scene, view)), min(FEWEST, most), most))


def picture_strip(scene: Scene, behind: Backdrop, view: str = "oblique") -> str:
    """The scene's frames side by side as an `<svg>` element, each tied to its time on the axis below."""
    count = len(scene.time)
    room = OVERLAP * (WIDTH - RIGHT - LEFT) / count
    drawn = pictures(scene, PIXELS, max(40, int(room / TALL * PIXELS)), views=(view,))
    tall = max(one.height for one in drawn) * TALL / PIXELS
    height = tall + FOOT
    frame = behind.frame(0.0, height)
    parts = [
        f'<svg class="chart strip-row" viewBox="0 0 {WIDTH} {height:.1f}" role="img" aria-label="The body at '
        f'{count} instants">',
        *behind.behind(frame),
    ]
    wide = max(one.width for one in drawn) * TALL / PIXELS
    places = pictures_beside(frame.x(scene.time), wide / OVERLAP, LEFT, WIDTH - RIGHT)
    for i, (one, middle) in enumerate(zip(drawn, places, strict=True)):
        time = number(float(scene.time[i]), 0.01)
        parts.append(
            f'<image href="{data_uri(one.image)}" x="{middle - wide / 2:.1f}" y="0" width="{wide:.1f}" '
            f'height="{tall:.1f}"><title>The body at {time} s</title></image>'
        )
        at = float(frame.x(float(scene.time[i])))
        parts.append(f'<path class="zero" d="M{middle:.1f} {height - 7:.1f}L{at:.1f} {height:.1f}"/>')
        parts.append(f'<text class="tick x" x="{middle:.1f}" y="{height - 10:.1f}">{time} s</text>')
    return "".join([*parts, "</svg>"])


def pictures_beside(wanted: Array, wide: float, left: float, right: float) -> Array:
    """Places as near to those wanted (ascending) as can be, in least squares, `wide` apart and within the borders."""
    apart = wide * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []
    for one in wanted - apart:
        mean, count = float(one), 1
        while blocks and blocks[-1][0] > mean:
            before, several = blocks.pop()
            mean, count = (several * before + count * mean) / (several + count), several + count
        blocks.append((mean, count))
    found = np.repeat([mean for mean, _ in blocks], [count for _, count in blocks])
    low, high = left + wide / 2, right - wide / 2 - apart[-1]
    return np.clip(found, min(low, high), max(low, high)) + apart


def nearest_frames(time: np.ndarray, good: np.ndarray, wanted: Sequence[float]) -> list[int]:
    """Of the good frames those nearest to the wanted times, each once, in order of time."""
    found = {int(good[int(np.argmin(np.abs(time[good] - one)))]) for one in wanted}
    return sorted(found)

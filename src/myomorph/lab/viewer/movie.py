"""A movie of results: the body beside its curves, as a file that needs no program to be seen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, from_extra
from myomorph.lab.report.trial.answer.pose_pictures import FULL, ramp_color
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.viewer.movie_body import BodyPainter
from myomorph.lab.viewer.movie_charts import FAINT, SHRINK, ChartPainter, ChartPlace
from myomorph.lab.viewer.movie_curves import movie_charts
from myomorph.lab.viewer.movie_file import Pictures, check_movie_file, write_movie_file
from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.lab.viewer.replay_scene import COLORS

if TYPE_CHECKING:
    from PIL.Image import Image

RATE = 20.0
"""Pictures a second [Hz]."""
MAX_SECONDS = 20.0
"""A longer movie ends here, unless its length is given."""
LONGEST = 120.0
MIN_SIZE = 120
MAX_SIZE = 3840
TEXT = 16
TEXT_WIDTH = 760
"""Size of the letters, at which width of the movie [pixels]."""
CHARTS = 0.54
"""Share of the width that charts have."""
STEPS = 64
"""Colors of the scale of activations."""


Watch = Callable[[str, int], AbstractContextManager[Callable[[float], None]]]


@contextmanager
def _unwatched(title: str, count: int) -> Iterator[Callable[[float], None]]:
    yield lambda drawn: None


@dataclass(frozen=True, kw_only=True)
class MovieOptions:
    """How a movie looks.

    Attributes
    ----------
    size : width and height [pixels]
    time : part of the recording, its begin and end [s]; all of it by default
    seconds : that the movie lasts; by default as long as the recording at that speed
    speed : 1 as it was, 0.5 half as fast; by default 1, or what `seconds` ask for
    curves : up to three, by name, as `movie_charts` takes them
    """

    size: tuple[int, int] = (760, 420)
    time: tuple[float, float] | None = None
    seconds: float | None = None
    speed: float | None = None
    curves: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not all(MIN_SIZE <= pixels <= MAX_SIZE for pixels in self.size):
            raise BadData(f"size {self.size}: expected {MIN_SIZE} to {MAX_SIZE} pixels")
        if self.seconds is not None and not 0.0 < self.seconds <= LONGEST:
            raise BadData(f"seconds {self.seconds:g}: expected more than 0, at most {LONGEST:g}")
        if self.speed is not None and not 0.0 < self.speed < np.inf:
            raise BadData(f"speed {self.speed:g}: expected more than 0")


AS_RECORDED = MovieOptions()


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class MovieClock:
    """When each picture of a movie is.

    Attributes
    ----------
    times : (pictures,) of the recording [s]
    speed : of the movie, 1 as it was
    cut : whether the recording goes on
    """

    times: Array
    speed: float
    cut: bool

    @property
    def seconds(self) -> float:
        """How long the movie lasts [s]."""
        return len(self.times) / RATE


def draw_movie(
    results: ReportInput, out: Path, options: MovieOptions, watch: Watch = _unwatched
) -> MovieClock:
    """Write a movie of results.

    Parameters
    ----------
    results : with a motion
    out : file to write, as GIF, WebP or PNG by its ending
    options : how it looks
    watch : is told how far it is: a title and the number of pictures, then pictures just drawn

    Returns
    -------
    the times of its pictures

    Raises
    ------
    BadData : a curve or a time is not in the results
    BadFile : the file cannot be written
    MissingPackage : Pillow is not installed
    """
    check_movie_file(out)
    _ = from_extra("view", "PIL.Image", "pillow")
    body = PlayedBody(results)
    clock = movie_clock(body.time, options)
    pages = MoviePages(body, clock.times, options)
    pictures = Pictures(draw=pages.picture, count=len(clock.times), seconds=1.0 / RATE)
    with watch(f"drawing {out.name}", pictures.count) as advance:
        write_movie_file(out, pictures, advance)
    return clock


def movie_clock(time: Array, options: MovieOptions) -> MovieClock:
    """Find the times of all pictures.

    Parameters
    ----------
    time : (frames,) of the recording [s]
    options : part, length and speed

    Returns
    -------
    times of pictures that end before the recording does, so that a loop closes

    Raises
    ------
    BadData : the part is not in the recording
    """
    start, end = options.time or (float(time[0]), float(time[-1]))
    if not time[0] - 1e-6 <= start < end <= time[-1] + 1e-6:
        raise BadData(
            f"time {start:g} to {end:g}: the recording goes from {time[0]:g} to {time[-1]:g} s"
        )
    length = end - start
    speed = options.speed
    if speed is None:
        speed = 1.0 if options.seconds is None else length / options.seconds
    seconds = min(length / speed, options.seconds or MAX_SECONDS)
    count = max(round(seconds * RATE), 1)
    cut = seconds < length / speed - 1e-9
    times = np.asarray(start + np.arange(count) * speed / RATE, dtype=np.float64)
    return MovieClock(times=times, speed=speed, cut=cut)


class MoviePages:
    """Pictures of a movie: charts on the left, the body on the right, a key below.

    Parameters
    ----------
    body : with its results
    times : (pictures,) of the recording [s]
    options : size and curves
    """

    def __init__(self, body: PlayedBody, times: Array, options: MovieOptions):
        width, height = options.size
        self._body = body
        self._times = times
        self._size = options.size
        self._text = max(round(TEXT * width / TEXT_WIDTH), 8)
        frames = [body.frame_at(float(time)) for time in times]
        each, self._which = np.unique(frames, return_inverse=True)
        charts = movie_charts(body, options.curves)
        self._left = round(CHARTS * width) if charts else 0
        self._high = height - 2 * self._text
        room = (width - self._left, self._high)
        self._painter = BodyPainter(body, each.tolist(), room)
        self._charts: ChartPainter | None = None
        if charts and len(times) > 1:
            place = ChartPlace(
                span=(float(times[0]), float(times[-1])),
                size=(self._left, self._high),
                text=self._text,
            )
            self._charts = ChartPainter(charts, body.time, place)
        self._key = self._drawn_key()

    def picture(self, number: int) -> Image:
        """Draw one picture of the movie."""
        page: Image = from_extra("view", "PIL.Image", "pillow").new("RGB", self._size, "white")
        page.paste(self._painter.picture(int(self._which[number])), (self._left, 0))
        if self._charts is not None:
            page.paste(self._charts.picture(float(self._times[number])), (0, 0))
        page.paste(self._key, (0, self._high))
        return page

    def _drawn_key(self) -> Image:
        """Draw what the colors mean, and whose results these are."""
        text = self._text * SHRINK
        width = self._size[0] * SHRINK
        height = (self._size[1] - self._high) * SHRINK
        strip: Image = from_extra("view", "PIL.Image", "pillow").new(
            "RGB", (width, height), "white"
        )
        drawing = from_extra("view", "PIL.ImageDraw", "pillow").Draw(strip)
        font = from_extra("view", "PIL.ImageFont", "pillow").load_default(text)
        middle = height // 2
        x = 0.1 * text
        if self._body.results.tension is not None:
            words = "muscle activation: 0"
            drawing.text((x, middle), words, FAINT, font, anchor="lm")
            x += font.getlength(words) + 0.4 * text
            x = _draw_scale(drawing, x, middle, text)
            drawing.text((x, middle), f"{FULL:g} or more", FAINT, font, anchor="lm")
            x += font.getlength(f"{FULL:g} or more") + 1.5 * text
        for layer, ends in (("measured", self._body.measured), ("estimated", self._body.estimated)):
            if np.isfinite(ends).any():
                color = COLORS[layer]
                x = _draw_arrow(drawing, x, middle, text, color)
                drawing.text((x, middle), f"force, {layer}", color, font, anchor="lm")
                x += font.getlength(f"force, {layer}") + 1.5 * text
        reduced: Image = strip.reduce(SHRINK)
        return reduced


def _draw_scale(drawing: Any, x: float, middle: float, text: float) -> float:
    """Draw the colors of activations; return where they end [pixels]."""
    half = 0.4 * text
    step = 5.0 * text / STEPS
    for number in range(STEPS):
        channels = ramp_color("light", FULL * number / (STEPS - 1))
        color = tuple(np.round(255 * channels).astype(int).tolist())
        drawing.rectangle((x, middle - half, x + step, middle + half), color)
        x += step
    return x + 0.4 * text


def _draw_arrow(
    drawing: Any, x: float, middle: float, text: float, color: tuple[int, int, int]
) -> float:
    """Draw an arrow that points up; return where its name begins [pixels]."""
    half = 0.5 * text
    drawing.line([(x, middle + half), (x, middle - 0.2 * text)], color, round(0.14 * text))
    head = [(x - 0.25 * text, middle - 0.1 * text), (x + 0.25 * text, middle - 0.1 * text)]
    drawing.polygon([*head, (x, middle - half)], color)
    return x + 0.5 * text

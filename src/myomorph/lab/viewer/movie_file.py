"""A movie as a file: GIF, animated WebP, or PNG that moves."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from myomorph.core.model.errors import BadFile, from_extra
from myomorph.lab.report.scene.pictures import DRAWERS

if TYPE_CHECKING:
    from PIL.Image import Image

ENDINGS = (".gif", ".webp", ".png")
COLORS = 200
"""Colors of a GIF. Fewer make a smaller file; one of 256 has to stay free for what stands still."""
QUALITY = 85
"""Of a WebP, up to 100."""
SAMPLES = 10
"""Frames that a GIF's colors are chosen by."""
WHITE = 236
"""Of pixels whose darkest channel is lighter no color is made: they are near the background, which
has to stay white."""


def check_movie_file(path: Path) -> None:
    """Raise `BadFile` where no movie can be written under a name."""
    if path.suffix.lower() not in ENDINGS:
        raise BadFile(
            path, f"is no movie: its name ends in '{path.suffix}'", f"expected {', '.join(ENDINGS)}"
        )
    if path.is_dir() or not path.parent.is_dir():
        raise BadFile(
            path, f"cannot be written: folder '{path.parent}' does not exist", "make it first"
        )


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Pictures of a movie, drawn when they are needed.

    Attributes
    ----------
    draw : draws one of them, by its number
    count : how many there are
    seconds : that each is shown
    """

    draw: Callable[[int], Image]
    count: int
    seconds: float


def write_movie_file(path: Path, pictures: Pictures, advance: Callable[[float], None]) -> None:
    """Draw pictures and write them as a movie that begins again at its end.

    Parameters
    ----------
    path : with one of `ENDINGS`
    pictures : at least one
    advance : called with the number of pictures just drawn

    Raises
    ------
    BadFile : the file cannot be written
    """
    gif = path.suffix.lower() == ".gif"
    encoded: Callable[[Image], Image] = _with_colors(pictures) if gif else _as_it_is
    draw = pictures.draw
    frames = []
    with ThreadPoolExecutor(DRAWERS) as pool:
        for frame in pool.map(lambda number: encoded(draw(number)), range(pictures.count)):
            frames.append(frame)
            advance(1.0)
    options: dict[str, Any] = {
        "duration": round(1000.0 * pictures.seconds),
        "loop": 0,
        "save_all": True,
    }
    # Pillow takes from these what the format knows.
    options |= {"optimize": gif, "quality": QUALITY}
    try:
        frames[0].save(path, append_images=frames[1:], **options)
    except OSError as error:
        raise BadFile(path, f"cannot be written ({error.strerror or error})") from None


def _as_it_is(frame: Image) -> Image:
    return frame


def _with_colors(pictures: Pictures) -> Callable[[Image], Image]:
    """Return what gives every picture of a movie the same few colors.

    What stands still then has the same color in all, and costs nothing.
    """
    image = from_extra("view", "PIL.Image", "pillow")
    numbers = np.unique(np.linspace(0, pictures.count - 1, SAMPLES).astype(int))
    samples = [np.asarray(pictures.draw(number)) for number in numbers.tolist()]
    pixels = np.concatenate([sample.reshape(-1, 3) for sample in samples])
    drawn = pixels[pixels.min(axis=1) < WHITE]
    side = int(np.sqrt(len(drawn)))
    square = image.fromarray(drawn[: side * side].reshape(side, side, 3))
    found = square.quantize(COLORS - 1, method=image.Quantize.MAXCOVERAGE).getpalette()
    palette = image.new("P", (1, 1))
    palette.putpalette([255, 255, 255, *found[: 3 * (COLORS - 1)]])
    return lambda frame: frame.quantize(palette=palette, dither=image.Dither.NONE)

"""A movie as a file: GIF, animated WebP, or PNG that moves."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from myomorph.core.model.errors import BadFile, from_extra
from myomorph.lab.report.scene.pictures import DRAWERS
from myomorph.lab.store.progress import progress

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


def write_movie_file(
    path: Path, picture: Callable[[int], Image], count: int, seconds: float
) -> None:
    """Draw pictures and write them as a movie that begins again at its end.

    Parameters
    ----------
    path : with one of `ENDINGS`
    picture : draws one of them, by its number
    count : of pictures
    seconds : that each is shown

    Raises
    ------
    BadFile : the file cannot be written
    """
    gif = path.suffix.lower() == ".gif"
    encoded: Callable[[Image], Image] = _with_colors(picture, count) if gif else _as_it_is
    frames = []
    with progress(f"drawing {path.name}", count) as advance, ThreadPoolExecutor(DRAWERS) as pool:
        for frame in pool.map(lambda number: encoded(picture(number)), range(count)):
            frames.append(frame)
            advance(1.0)
    options: dict[str, Any] = {"duration": round(1000.0 * seconds), "loop": 0, "save_all": True}
    # Pillow takes from these what the format knows.
    options |= {"optimize": gif, "quality": QUALITY}
    try:
        frames[0].save(path, append_images=frames[1:], **options)
    except OSError as error:
        raise BadFile(path, f"cannot be written ({error.strerror or error})") from None


def _as_it_is(frame: Image) -> Image:
    return frame


def _with_colors(picture: Callable[[int], Image], count: int) -> Callable[[Image], Image]:
    """Return what gives every picture of a movie the same few colors.

    What stands still then has the same color in all, and costs nothing.
    """
    image = from_extra("view", "PIL.Image", "pillow")
    numbers = np.unique(np.linspace(0, count - 1, SAMPLES).astype(int))
    pixels = np.concatenate([np.asarray(picture(int(n))).reshape(-1, 3) for n in numbers])
    drawn = pixels[pixels.min(axis=1) < WHITE]
    side = int(np.sqrt(len(drawn)))
    square = image.fromarray(drawn[: side * side].reshape(side, side, 3))
    found = square.quantize(COLORS - 1, method=image.Quantize.MAXCOVERAGE).getpalette()
    palette = image.new("P", (1, 1))
    palette.putpalette([255, 255, 255, *found[: 3 * (COLORS - 1)]])
    return lambda frame: frame.quantize(palette=palette, dither=image.Dither.NONE)

"""Files that belong to a recording by their names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from myomorph.core.io.formats import trial_format

MARKERS = (
    "markers_",
    "marker_",
    "_markers",
    "_marker",
    "_trc",
    "_ik",
    "ik_",
    "_coordinates",
    "_motion",
)
TABLE_ENDINGS = (".mot", ".sto")


def plain_stem(recording: Path) -> str:
    """Return a recording's name without its ending, and without "markers" before or after it."""
    stem = recording.stem
    for part in MARKERS:
        if part.endswith("_") and stem.lower().startswith(part):
            stem = stem[len(part) :]
        elif part.startswith("_") and stem.lower().endswith(part):
            stem = stem[: -len(part)]
    return stem or recording.stem


def is_alone(recording: Path) -> bool:
    """Return whether there is no other recording in its folder.

    Files beside it then belong to it whatever their names are.
    """
    return (
        sum(trial_format(file) is not None for file in recording.parent.iterdir() if file.is_file())
        == 1
    )


def companion(
    recording: Path, words: Sequence[str], endings: Sequence[str], alone: bool = False
) -> Path | None:
    """Find the file that belongs to a recording by its stem, None where there is none.

    With STEM the recording's name (and the same without "markers"), and WORD one of `words`, the
    first of these that exists beside it: STEM_WORD, WORD_STEM, and STEM where it counts alone; by
    the order of the endings.
    """
    stems = dict.fromkeys((recording.stem, plain_stem(recording)))
    for ending in endings:
        for stem in stems:
            names = [name for word in words for name in (f"{stem}_{word}", f"{word}_{stem}")]
            for name in (*names, stem) if alone else names:
                path = recording.with_name(name + ending)
                if path.is_file():
                    return path
    return None

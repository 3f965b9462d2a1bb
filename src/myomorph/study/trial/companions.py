"""Which files of forces and EMG belong to a recording, by the rule of names."""

from __future__ import annotations

from pathlib import Path

MARKERS = ("markers_", "marker_", "_markers", "_marker", "_trc")
LOADS = ("grf", "GRF", "external_loads", "external_forces", "externalforces", "ExternalLoads", "loads", "forces")
EMG = ("emg", "EMG", "electromyography", "envelopes")


def plain_stem(markers: Path) -> str:
    """A recording's name without its ending, and without "markers" before or after it."""
    stem = markers.stem
    for part in MARKERS:
        if part.endswith("_") and stem.lower().startswith(part):
            stem = stem[len(part) :]
        elif part.startswith("_") and stem.lower().endswith(part):
            stem = stem[: -len(part)]
    return stem or markers.stem


def companion(markers: Path, kind: str) -> Path | None:
    """The file of forces ("loads") or EMG ("emg") that belongs to a recording, by its stem, or None.

    With STEM the recording's name (and the same without "markers"), and WORD one of `LOADS` or `EMG`, the
    first of these that exists beside it: STEM_WORD, WORD_STEM, STEM; forces first as an external loads file
    (.xml), then as a table (.mot, .sto); EMG as a table (.sto, .mot), and never STEM alone.
    """
    words, endings = (LOADS, (".xml", ".mot", ".sto")) if kind == "loads" else (EMG, (".sto", ".mot"))
    stems = dict.fromkeys((markers.stem, plain_stem(markers)))
    for ending in endings:
        for stem in stems:
            names = [name for word in words for name in (f"{stem}_{word}", f"{word}_{stem}")]
            if kind == "loads":
                names.append(stem)
            for name in names:
                path = markers.with_name(name + ending)
                if path.is_file():
                    return path
    return None

"""What `calibrate` wrote beside a model: how well it knows the model's lengths and marker positions."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from myomorph.identify.refine.body_prior import KnownBody
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.provenance import Source
from myomorph.motion.lengths import Length, lengths_of
from myomorph.store.results import file_source

LENGTHS, MARKERS = "lengths.csv", "markers.csv"
SAME = 1e-4
"""Distance by which a length or a marker may differ from the tables and still be theirs [m]."""


def calibration_folder(model_file: Path) -> Path | None:
    """The folder of tables that `calibrate` wrote beside a model, None where there is none."""
    beside = [model_file.with_name(f"{model_file.stem}_calibration")]
    if model_file.name == "calibrated.osim":
        beside.append(model_file.with_name("calibration"))
    return next((one for one in beside if all((one / name).is_file() for name in (LENGTHS, MARKERS))), None)


def calibration_sources(model_file: Path) -> list[Source]:
    """The tables by their hashes, nothing where there are none."""
    folder = calibration_folder(model_file)
    return [] if folder is None else [file_source("calibration", folder / name) for name in (LENGTHS, MARKERS)]


def known_body(model_file: Path, model: Model) -> KnownBody | None:
    """Standard deviations that a calibration left of a model, None where none wrote it.

    Lengths and markers that are elsewhere now, since the model was changed, are left out.

    Parameters
    ----------
    model_file : that the tables lie beside
    """
    folder = calibration_folder(model_file)
    if folder is None:
        return None
    lengths: dict[str, float] = {}
    rows = _rows(folder / LENGTHS)
    for one in lengths_of(model):
        row = next((row for row in rows if _is_of(row, one)), None)
        # Across a segment and in a last one, the extent depends on markers, which calibration moves.
        moved = row is not None and one.between_joints and abs(one.extent - float(row["found_m"])) > SAME
        if row is not None and not (one.along and moved):
            lengths[one.name] = float(row["factor_sd"]) / float(row["factor"])
    markers: dict[str, tuple[float, float, float]] = {}
    places = {one.name: one.location for one in model.markers}
    for row in _rows(folder / MARKERS):
        x, y, z = (float(row[f"{axis}_m"]) for axis in "xyz")
        place = places.get(row["marker"])
        if place is not None and max(abs(place[0] - x), abs(place[1] - y), abs(place[2] - z)) < SAME:
            markers[row["marker"]] = (float(row["x_sd_m"]), float(row["y_sd_m"]), float(row["z_sd_m"]))
    return KnownBody(FrozenMap(lengths), FrozenMap(markers)) if lengths or markers else None


def _is_of(row: Mapping[str, str], length: Length) -> bool:
    """Whether a row is of this length; calibrated symmetrically, right and left have one row."""
    same_axis = row["length"][-1] == length.name[-1]
    return row["length"] == length.name or (same_axis and length.segment in row["bodies"].split())


def _rows(path: Path) -> list[Mapping[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))

"""The force plates a C3D file describes: corners, origin, channels and calibration in SI units."""

from __future__ import annotations

import re

import numpy as np

from myomorph.io.c3d.raw import RawC3d
from myomorph.model.arrays import Array
from myomorph.model.series import PlateRecording

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6, 5: 8, 6: 12, 7: 8, 11: 8, 12: 8, 21: 6}
FORCE_UNITS = {"n": 1.0, "nt": 1.0, "newton": 1.0, "newtons": 1.0, "kn": 1000.0, "lb": 4.4482216, "lbf": 4.4482216}
LOADED = 50.0  # A plate that carries more is loaded [N]
LENGTH_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "meters": 1.0, "meter": 1.0}


def plate_recordings(raw: RawC3d, meters: float, notes: list[str]) -> tuple[PlateRecording, ...]:
    """Force plates of the file; one that is described in part only is left out with a warning."""
    group = "FORCE_PLATFORM" if "FORCE_PLATFORM" in raw.groups else "FORCE_PLATEFORM"
    used, kinds = raw.numbers(group, "USED"), raw.numbers(group, "TYPE")
    count = min(int(used[0]) if len(used) and np.isfinite(used[0]) else len(kinds), len(kinds))
    if count <= 0:
        return ()
    if not raw.analog.size:
        notes.append(f"the file describes {count} force plates, but holds no analog samples")
        return ()
    plates = []
    for index in range(count):
        plate = _plate(raw, group, index, int(kinds[index]), meters, notes)
        if plate is not None:
            plates.append(plate)
    return tuple(plates)


def _plate(raw: RawC3d, group: str, index: int, kind: int, meters: float, notes: list[str]) -> PlateRecording | None:
    name = f"plate_{index + 1}"
    corners = raw.numbers(group, "CORNERS")[12 * index : 12 * index + 12]
    origin = raw.numbers(group, "ORIGIN")[3 * index : 3 * index + 3]
    columns = _columns(raw, group, index, kind)
    if len(corners) < 12 or len(origin) < 3:
        notes.append(f"force plate {index + 1} was left out: the file holds no corners or no origin for it")
        return None
    if columns is None:
        notes.append(f"force plate {index + 1} was left out: its channels are not among the analog channels")
        return None
    corners = corners.reshape(4, 3) * meters
    if (
        not np.isfinite(corners).all()
        or np.linalg.norm(np.cross(corners[0] - corners[1], corners[0] - corners[3])) == 0
    ):
        notes.append(f"force plate {index + 1} was left out: its corners span no surface")
        return None
    labels, units = raw.texts("ANALOG", "LABELS"), raw.texts("ANALOG", "UNITS")
    samples = np.where(np.isfinite(raw.analog[:, columns]), raw.analog[:, columns], np.nan)
    calibration = _calibration(raw, group, index, meters) if kind == 4 else None
    if kind == 4 and calibration is None:
        notes.append(f"force plate {index + 1} is of type 4 without a calibration matrix: taken as calibrated")
        kind = 2
    if kind in (1, 2, 3):
        texts = [units[column] if column < len(units) else "" for column in columns]
        samples = samples * _factors(kind, texts, meters, name, notes)
        if kind == 2 and _in_millimeters(samples, corners):
            notes.append(
                f"moments of {name}, in '{texts[3]}' by the file, put its force far off the plate: taken as N mm"
            )
            samples[:, 3:] *= 1e-3
    polynomial = raw.numbers(group, "FPCOPPOLY")[12 * index : 12 * index + 12]
    return PlateRecording(
        name=name,
        kind=kind,
        corners=corners,
        origin=np.where(np.isfinite(origin), origin, 0.0) * meters,
        channels=samples,
        channel_names=tuple(labels[column] if column < len(labels) else "" for column in columns),
        calibration=calibration,
        center_polynomial=polynomial.reshape(2, 6) if kind == 3 and len(polynomial) == 12 else None,
    )


def _columns(raw: RawC3d, group: str, index: int, kind: int) -> list[int] | None:
    """Columns of the analog samples that belong to the plate, or None."""
    shape, channels = raw.shape(group, "CHANNEL"), raw.numbers(group, "CHANNEL")
    size = int(shape[0]) if len(shape) == 2 else len(channels)
    wanted = CHANNELS.get(kind, size)
    mine = channels[size * index : size * index + size][:wanted].astype(int) - 1
    if len(mine) < wanted or not wanted or (mine < 0).any() or (mine >= raw.analog.shape[1]).any():
        return None
    return list(mine)


def _calibration(raw: RawC3d, group: str, index: int, meters: float) -> Array | None:
    """Matrix (6, 6) from channels to force [N] and moment [N m]; the file stores it by columns."""
    values = raw.numbers(group, "CAL_MATRIX")[36 * index : 36 * index + 36]
    if len(values) < 36 or not np.isfinite(values).all() or not values.any():
        return None
    matrix: Array = values.reshape(6, 6, order="F").copy()
    if any(text.upper() == "BYROW" for text in raw.texts(group, "MATRIX_STORE")):
        matrix = matrix.T.copy()
    matrix[3:] *= meters
    return matrix


def _factors(kind: int, units: list[str], meters: float, name: str, notes: list[str]) -> Array:
    """Factor of each channel to N, N m or m."""
    forces = 8 if kind == 3 else 3
    factors = np.ones(len(units))
    unknown = set()
    for column, text in enumerate(units):
        letters = re.sub(r"[^a-z]", "", text.lower())
        if column < forces:
            factors[column] = FORCE_UNITS.get(letters, 1.0)
            if letters not in FORCE_UNITS:
                unknown.add(text)
        elif kind == 1 and column < 5:
            factors[column] = LENGTH_UNITS.get(letters, meters)
        else:
            length = next((LENGTH_UNITS[letters[cut:]] for cut in (1, 6, 7) if letters[cut:] in LENGTH_UNITS), meters)
            factors[column] = length
    if unknown:
        notes.append(f"the channels of {name} are in '{', '.join(sorted(unknown))}': taken as newtons")
    return factors


def _in_millimeters(samples: Array, corners: Array) -> bool:
    """Whether moments (samples, 6) are N mm though the file says N m: the force's distance from the middle of a loaded
    plate, mostly many plates away, is within it then.
    """
    pressing, moments = np.abs(samples[:, 2]), np.linalg.norm(samples[:, 3:5], axis=1)
    loaded = pressing > max(LOADED, 0.5 * np.nanmax(pressing, initial=0.0))
    away = np.median(moments[loaded] / pressing[loaded]) if loaded.any() else 0.0
    reach = np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()
    return bool(away > 10.0 * reach and 1e-3 * away < reach)

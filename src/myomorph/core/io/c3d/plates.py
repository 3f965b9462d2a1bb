"""Force plates of C3D files: corners, origin, channels and calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.io.c3d.raw import RawC3d
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import PLATES, UNITS
from myomorph.core.model.force_units import (
    FORCE_UNITS,
    LENGTH_UNITS,
    letters_of,
    moment_factor,
)
from myomorph.core.model.messages import Message
from myomorph.core.model.series import PlateRecording

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6, 5: 8, 6: 12, 7: 8, 11: 8, 12: 8, 21: 6}
"""Count of channels by the C3D type of a plate."""
USUAL_EDGES = (0.15, 4.0)  # Of force plates and treadmills [m].
MAX_ORIGIN = 1.0  # Distance of a plate's sensors from the middle of its surface [m].
PLATE_UNITS = {"mm": 1e-3, "m": 1.0, "cm": 1e-2, "in": 0.0254}  # In order of preference [m].
MIN_LOAD = 50.0  # A plate that carries more is loaded [N].


@dataclass(frozen=True, kw_only=True)
class _PlateParameters:
    """Parameters of one plate.

    Attributes
    ----------
    raw : parameters and analog samples of the file
    group : name of the group that describes plates
    index : of the plate, from 0
    kind : C3D type of the plate
    meters : unit of its corners [m]
    sensor_meters : unit of its origin, and of moments by its matrix [m]
    """

    raw: RawC3d
    group: str
    index: int
    kind: int
    meters: float
    sensor_meters: float

    @property
    def number(self) -> int:
        """Number of the plate, from 1."""
        return self.index + 1

    @property
    def name(self) -> str:
        """Name of the plate in the wrenches that are read."""
        return f"plate_{self.number}"

    def numbers(self, parameter: str, count: int) -> Array:
        """Read the plate's share of a parameter that holds so many numbers for each plate."""
        begin = count * self.index
        return self.raw.numbers(self.group, parameter)[begin : begin + count]

    def columns(self) -> list[int] | None:
        """Find the columns of the analog samples that belong to the plate.

        Returns
        -------
        indices from 0 in the order of the plate's channels; None where one is not among the samples
        """
        shape = self.raw.shape(self.group, "CHANNEL")
        stated = len(self.raw.numbers(self.group, "CHANNEL"))
        count_per_plate = int(shape[0]) if len(shape) == 2 else stated
        count = CHANNELS.get(self.kind, count_per_plate)
        columns = self.numbers("CHANNEL", count_per_plate)[:count].astype(int) - 1
        if len(columns) < count or count == 0:
            return None
        if (columns < 0).any() or (columns >= self.raw.analog.shape[1]).any():
            return None
        return list(columns)

    def calibration(self) -> Array | None:
        """Read the matrix from channels to force and moment.

        Returns
        -------
        (6, 6) from channels to force [N] and moment [N m]; None where there is none that is finite
        """
        values = self.numbers("CAL_MATRIX", 36)
        if len(values) < 36 or not np.isfinite(values).all() or not values.any():
            return None
        matrix: Array = values.reshape(6, 6, order="F").copy()
        if any(text.upper() == "BYROW" for text in self.raw.texts(self.group, "MATRIX_STORE")):
            matrix = matrix.T.copy()
        matrix[3:] *= self.sensor_meters
        return matrix

    def center_polynomial(self) -> Array | None:
        """Read the polynomial that corrects the center of pressure, (2, 6); of type 3 alone."""
        values = self.numbers("FPCOPPOLY", 12)
        if self.kind != 3 or len(values) != 12:
            return None
        return values.reshape(2, 6)


def plate_recordings(
    raw: RawC3d, meters: float, notes: list[Message]
) -> tuple[PlateRecording, ...]:
    """Read the force plates of the file; one that is described only in part is left out.

    Parameters
    ----------
    raw : parameters and analog samples
    meters : the file's unit of length [m]
    notes : gets a warning for each plate that was left out, and for units that were assumed

    Returns
    -------
    corners (4, 3) and origin (3,) [m] of each, channels (samples, channels) in [N, N m, m] for
    types 1 to 3, else as stored
    """
    group = "FORCE_PLATFORM" if "FORCE_PLATFORM" in raw.groups else "FORCE_PLATEFORM"
    kinds = raw.numbers(group, "TYPE")
    count = len(kinds)
    used = raw.numbers(group, "USED")
    if len(used) and np.isfinite(used[0]):
        count = min(int(used[0]), count)
    if count <= 0:
        return ()
    if not raw.analog.size:
        notes.append(
            PLATES.message(f"the file describes {count} force plates, but holds no analog samples")
        )
        return ()
    corner_meters = _plate_unit(raw.numbers(group, "CORNERS"), meters, notes)
    # Corners may be in another unit than all else.
    origins = np.abs(np.nan_to_num(raw.numbers(group, "ORIGIN")))
    near = origins.max(initial=0.0) * corner_meters <= MAX_ORIGIN
    sensor_meters = corner_meters if near else meters
    plates = []
    for index in range(count):
        parameters = _PlateParameters(
            raw=raw,
            group=group,
            index=index,
            kind=int(kinds[index]),
            meters=corner_meters,
            sensor_meters=sensor_meters,
        )
        plate = _plate(parameters, notes)
        if plate is not None:
            plates.append(plate)
    return tuple(plates)


def unit_of_plates(raw: RawC3d) -> str:
    """Guess the unit of length of a file by the size of its plates.

    Parameters
    ----------
    raw : parameters of the file

    Returns
    -------
    the first of `PLATE_UNITS` in which the plates have the size of plates; "" where none does
    """
    for group in ("FORCE_PLATFORM", "FORCE_PLATEFORM"):
        edges = _edges(raw.numbers(group, "CORNERS"))
        for unit, meters in PLATE_UNITS.items():
            if len(edges) and _are_usual(edges * meters):
                return unit
    return ""


def _plate_unit(corners: Array, meters: float, notes: list[Message]) -> float:
    """Return the unit of length of the plates [m], another one where they cannot be in the file's.

    Parameters
    ----------
    corners : (12 plates,) as the file has them
    meters : the file's unit of length [m]
    notes : gets a warning where another unit is taken
    """
    edges = _edges(corners)
    if not len(edges) or _are_usual(edges * meters):
        return meters
    for unit, other in PLATE_UNITS.items():
        if _are_usual(edges * other):
            longest = float(edges.max())
            notes.append(
                UNITS.message(
                    f"force plates would be {longest * meters:.3g} m long in the file's unit of"
                    f" length: their corners were taken as {unit}",
                    severity="may change results",
                )
            )
            return other
    return meters


def _edges(corners: Array) -> Array:
    """Lengths of the edges of all plates (edges,), in the file's unit; those of no length left out.

    Parameters
    ----------
    corners : (12 plates,) as the file has them
    """
    whole = corners[: 12 * (len(corners) // 12)].reshape(-1, 4, 3)
    lengths = np.linalg.norm(whole - np.roll(whole, 1, axis=1), axis=2).ravel()
    return lengths[np.isfinite(lengths) & (lengths > 0.0)]


def _are_usual(edges: Array) -> bool:
    """Return whether all edges [m] are as long as those of plates can be."""
    low, high = USUAL_EDGES
    return bool((edges >= low).all() and (edges <= high).all())


def _plate(parameters: _PlateParameters, notes: list[Message]) -> PlateRecording | None:
    """Read one force plate, None where corners, origin or channels are not usable.

    Parameters
    ----------
    parameters : of the plate
    notes : gets a warning for what was left out or assumed
    """
    raw = parameters.raw
    left_out = f"force plate {parameters.number} was left out"
    corner_values = parameters.numbers("CORNERS", 12)
    origin = parameters.numbers("ORIGIN", 3)
    if len(corner_values) < 12 or len(origin) < 3:
        notes.append(
            PLATES.message(
                f"{left_out}: the file holds no corners or no origin for it", place=parameters.name
            )
        )
        return None
    columns = parameters.columns()
    if columns is None:
        notes.append(
            PLATES.message(
                f"{left_out}: its channels are not among the analog channels", place=parameters.name
            )
        )
        return None
    corners = corner_values.reshape(4, 3) * parameters.meters
    if not _spans_surface(corners):
        notes.append(
            PLATES.message(f"{left_out}: its corners span no surface", place=parameters.name)
        )
        return None

    kind = parameters.kind
    calibration = parameters.calibration() if kind == 4 else None
    if kind == 4 and calibration is None:
        notes.append(
            PLATES.message(
                f"force plate {parameters.number} is of type 4 without a calibration matrix: taken"
                " as calibrated"
            )
        )
        kind = 2
    channels = np.where(np.isfinite(raw.analog[:, columns]), raw.analog[:, columns], np.nan)
    if kind in (1, 2, 3):
        units = _texts_of(columns, raw.texts("ANALOG", "UNITS"))
        channels = channels * _factors(kind, units, parameters, notes)
        if kind == 2 and _moments_in_millimeters(channels, corners):
            notes.append(
                UNITS.message(
                    f"moments of {parameters.name}, in '{units[3]}' by the file, put forces far off"
                    " the plate: taken as N mm"
                )
            )
            channels[:, 3:] *= 1e-3
    return PlateRecording(
        name=parameters.name,
        kind=kind,
        corners=corners,
        origin=np.where(np.isfinite(origin), origin, 0.0) * parameters.sensor_meters,
        channels=channels,
        channel_names=_texts_of(columns, raw.texts("ANALOG", "LABELS")),
        calibration=calibration,
        center_polynomial=parameters.center_polynomial(),
    )


def _spans_surface(corners: Array) -> bool:
    """Return whether corners (4, 3) are finite and no two edges of the first are parallel."""
    if not np.isfinite(corners).all():
        return False
    normal = np.cross(corners[0] - corners[1], corners[0] - corners[3])
    return bool(np.linalg.norm(normal) != 0)


def _texts_of(columns: Sequence[int], texts: Sequence[str]) -> tuple[str, ...]:
    """Pick the texts of columns, "" where the file has none."""
    return tuple(texts[column] if column < len(texts) else "" for column in columns)


def _factors(
    kind: int, units: Sequence[str], parameters: _PlateParameters, notes: list[Message]
) -> Array:
    """Find the factor of each channel of a plate to N, N m or m.

    Parameters
    ----------
    kind : C3D type of the plate, which says what each channel is
    units : text of each channel
    parameters : of the plate; its unit of length holds where a channel's text names none
    notes : gets a warning where units of forces are unknown

    Returns
    -------
    (channels,)
    """
    force_count = 8 if kind == 3 else 3
    factors = np.ones(len(units))
    unknown = set()
    for column, text in enumerate(units):
        letters = letters_of(text)
        if column < force_count:
            factors[column] = FORCE_UNITS.get(letters, 1.0)
            if letters not in FORCE_UNITS:
                unknown.add(text)
        elif kind == 1 and column < 5:
            # A plate of type 1 measures the center of pressure.
            factors[column] = LENGTH_UNITS.get(letters, parameters.meters)
        else:
            named = moment_factor(text)
            factors[column] = parameters.meters if named is None else named
    if unknown:
        texts = ", ".join(sorted(unknown))
        notes.append(
            UNITS.message(
                f"the channels of {parameters.name} are in '{texts}': taken as newtons",
                severity="good to know",
            )
        )
    return factors


def _moments_in_millimeters(channels: Array, corners: Array) -> bool:
    """Return whether moments are in N mm although the file says N m.

    The distance of the force from the middle of the loaded plate, its moment over the vertical
    force, then is many plates away, and within the plate in N mm.

    Parameters
    ----------
    channels : (samples, 6) force [N] and moment [N m as stated]
    corners : (4, 3) of the plate [m]
    """
    vertical = np.abs(channels[:, 2])
    moments = np.linalg.norm(channels[:, 3:5], axis=1)
    loaded = vertical > max(MIN_LOAD, 0.5 * np.nanmax(vertical, initial=0.0))
    if not loaded.any():
        return False
    distance = np.median(moments[loaded] / vertical[loaded])
    to_corners = np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()
    return bool(distance > 10.0 * to_corners and 1e-3 * distance < to_corners)

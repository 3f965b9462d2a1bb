"""Recordings as files that faults are put into: C3D with plates, and TRC with a table of forces.

Files are read and written by ezc3d and by NumPy, so that no reader under test has a part in the
fault.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array

VERTICAL = 2
"""Row of the vertical force among the channels of a plate of type 2 or 4."""
MATRIX_TYPE = 4
"""Of plates whose channels a matrix turns into forces."""
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""A quarter of a turn about y, which is up in tables of forces."""
LOADED = 30.0
"""Force from which a plate is loaded [N]."""


class Capture(ABC):
    """A recording in memory, as its files have it.

    Attributes
    ----------
    labels : of the points
    points : (frames, points, 3) in the unit of the file, NaN where hidden
    unit : of lengths, as the file says
    rate : of frames, as the file says [Hz]
    up : axis of the points that is vertical
    """

    labels: list[str]
    points: Array
    unit: str
    rate: float
    up: int

    @property
    @abstractmethod
    def plates(self) -> int:
        """Number of plates."""

    @abstractmethod
    def used_plate(self) -> int:
        """Find the plate that carries most."""

    @abstractmethod
    def drop_plate(self, plate: int) -> None:
        """Leave a plate out."""

    @abstractmethod
    def exchange_plates(self, first: int, second: int) -> None:
        """Connect two plates the wrong way round."""

    @abstractmethod
    def turn_plate(self, plate: int, quarters: int) -> None:
        """Turn a plate by quarters about its vertical."""

    @abstractmethod
    def scale_plate(self, plate: int, factor: float) -> None:
        """Multiply forces and moments of a plate."""

    @abstractmethod
    def add_force(self, plate: int, force: Sequence[float]) -> None:
        """Add a vertical force that goes in a line from a first value to a last one [N]."""

    @abstractmethod
    def scale_places(self, factor: float) -> None:
        """Multiply what specifies where forces act."""

    @abstractmethod
    def delay_forces(self, seconds: float) -> None:
        """Let forces come later [s]."""

    @abstractmethod
    def change_rate(self, factor: float) -> None:
        """Write another rate of the forces into the file."""

    @abstractmethod
    def write(self, folder: Path) -> tuple[Path, ...]:
        """Write the recording, the file of markers first."""

    @property
    def emg(self) -> Mapping[str, Array]:
        """Channels (samples,) that may be EMG, changed in place."""
        return {}

    def rename_emg(self, names: Mapping[str, str]) -> None:
        """Give channels other names; raises `LookupError` where there are none."""
        raise LookupError(f"the recording has no channel of EMG: {', '.join(names)}")


class C3dCapture(Capture):
    """A C3D file, by ezc3d."""

    def __init__(self, path: Path) -> None:
        # It cannot be loaded beside OpenSim's module.
        import ezc3d

        self.file: Any = ezc3d.c3d(str(path))
        point = self.file["parameters"]["POINT"]
        self.labels = list(point["LABELS"]["value"])
        self.points = np.array(self.file["data"]["points"][:3].transpose(2, 1, 0))
        self.unit = point["UNITS"]["value"][0]
        self.rate = float(point["RATE"]["value"][0])
        self.analogs = np.array(self.file["data"]["analogs"][0])
        self.up = 2
        self.platform = self.file["parameters"].get("FORCE_PLATFORM")

    @property
    def plates(self) -> int:
        """See `Capture`."""
        return 0 if self.platform is None else int(self.platform["USED"]["value"][0])

    def _rows(self, plate: int) -> Array:
        """Numbers of a plate's channels."""
        return np.asarray(self.platform["CHANNEL"]["value"][:, plate]).astype(int) - 1

    def used_plate(self) -> int:
        """See `Capture`."""
        lifts = [np.abs(self.analogs[self._rows(k)[VERTICAL]]).sum() for k in range(self.plates)]
        return int(np.argmax(lifts))

    def drop_plate(self, plate: int) -> None:
        """See `Capture`."""
        count = self.plates
        for name in ("TYPE", "CORNERS", "ORIGIN", "CHANNEL", "CAL_MATRIX"):
            entry = self.platform.get(name)
            if entry is not None and np.shape(entry["value"])[-1] == count:
                entry["value"] = np.delete(np.asarray(entry["value"]), plate, axis=-1)
        self.platform["USED"]["value"] = np.array([count - 1])

    def exchange_plates(self, first: int, second: int) -> None:
        """See `Capture`."""
        channels = np.array(self.platform["CHANNEL"]["value"])
        channels[:, [first, second]] = channels[:, [second, first]]
        self.platform["CHANNEL"]["value"] = channels

    def turn_plate(self, plate: int, quarters: int) -> None:
        """See `Capture`."""
        corners = np.array(self.platform["CORNERS"]["value"])
        corners[:, :, plate] = np.roll(corners[:, :, plate], quarters, axis=1)
        self.platform["CORNERS"]["value"] = corners

    def scale_plate(self, plate: int, factor: float) -> None:
        """See `Capture`."""
        self.analogs[self._rows(plate)] *= factor

    def add_force(self, plate: int, force: Sequence[float]) -> None:
        """See `Capture`."""
        lift = self.analogs[self._rows(plate)[VERTICAL]]
        # Whichever sign the plate has, the force presses as feet do.
        sign = np.sign(lift[np.argmax(np.abs(lift))])
        lift += sign * np.linspace(force[0], force[-1], len(lift)) / self._gain(plate)

    def _gain(self, plate: int) -> float:
        """Newtons of the vertical channel's unit: plates of type 4 have a matrix of them."""
        if int(self.platform["TYPE"]["value"][plate]) != MATRIX_TYPE:
            return 1.0
        return float(abs(self.platform["CAL_MATRIX"]["value"][VERTICAL, VERTICAL, plate]))

    def scale_places(self, factor: float) -> None:
        """See `Capture`."""
        self.platform["CORNERS"]["value"] = factor * np.array(self.platform["CORNERS"]["value"])

    def delay_forces(self, seconds: float) -> None:
        """See `Capture`."""
        samples = round(seconds * self.rate * self.analogs.shape[1] / len(self.points))
        rows = np.concatenate([self._rows(plate) for plate in range(self.plates)])
        later = np.clip(np.arange(self.analogs.shape[1]) - samples, 0, self.analogs.shape[1] - 1)
        self.analogs[rows] = self.analogs[rows][:, later]

    def change_rate(self, factor: float) -> None:
        """See `Capture`."""
        # Both rates: their ratio says how many samples a frame has.
        self.rate *= factor
        analog = self.file["parameters"]["ANALOG"]["RATE"]
        analog["value"] = factor * np.asarray(analog["value"])

    @property
    def emg(self) -> Mapping[str, Array]:
        """See `Capture`."""
        of_plates = {int(row) for plate in range(self.plates) for row in self._rows(plate)}
        names = self.file["parameters"]["ANALOG"]["LABELS"]["value"]
        return {name: self.analogs[row] for row, name in enumerate(names) if row not in of_plates}

    def rename_emg(self, names: Mapping[str, str]) -> None:
        """See `Capture`."""
        labels = self.file["parameters"]["ANALOG"]["LABELS"]
        labels["value"] = [names.get(name, name) for name in labels["value"]]

    def write(self, folder: Path) -> tuple[Path, ...]:
        """See `Capture`."""
        path = folder / "trial.c3d"
        point = self.file["parameters"]["POINT"]
        point["LABELS"]["value"] = self.labels
        point["UNITS"]["value"] = [self.unit]
        point["RATE"]["value"] = np.array([self.rate])
        whole = np.ones((4, *self.points.transpose(2, 1, 0).shape[1:]))
        whole[:3] = self.points.transpose(2, 1, 0)
        self.file["data"]["points"] = whole
        self.file["data"]["analogs"] = self.analogs[None]
        self.file.write(str(path))
        return (path,)


@dataclass(frozen=True, kw_only=True)
class ForceColumns:
    """Columns of one force in a table.

    Attributes
    ----------
    force, point : numbers of three columns each
    torque : the same, None where the table has none
    """

    force: slice
    point: slice
    torque: slice | None = None


def columns_at(force: int, point: int, torque: int | None = None) -> ForceColumns:
    """Columns of one force by the first of each three."""
    return ForceColumns(
        force=slice(force, force + 3),
        point=slice(point, point + 3),
        torque=None if torque is None else slice(torque, torque + 3),
    )


class TableCapture(Capture):
    """A TRC file, or a C3D file without plates, with a table of forces."""

    def __init__(self, path: Path, table: Path, forces: Sequence[ForceColumns]) -> None:
        self.markers = C3dCapture(path) if path.suffix == ".c3d" else None
        if self.markers is None:
            self._read_trc(path)
        else:
            self.labels = self.markers.labels
            self.points = self.markers.points
            self.unit = self.markers.unit
            self.rate = self.markers.rate
            self.up = 2
        text = table.read_text(encoding="utf-8", errors="replace").splitlines()
        last = next((k for k, line in enumerate(text) if "endheader" in line.lower()), None)
        first = 0 if last is None else last + 2
        self.head = text[:first]
        self.separator = "," if table.suffix == ".csv" else "\t"
        rows = (line.replace(",", " ").split() for line in text[first:] if line.strip())
        self.rows = np.array([[float(cell) for cell in row] for row in rows])
        self.forces = list(forces)
        self.ending = table.suffix

    def _read_trc(self, path: Path) -> None:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        facts = dict(zip(lines[1].split(), lines[2].split(), strict=False))
        self.unit = facts["Units"]
        self.rate = float(facts["DataRate"])
        self.up = 1
        self.labels = [name.strip() for name in lines[3].split("\t")[2:] if name.strip()]
        width = 2 + 3 * len(self.labels)
        body = [line.split("\t") for line in lines[5:] if line.strip()]
        cells = [[*row[:width], *[""] * (width - len(row))] for row in body]
        values = np.array(
            [[float(cell) if cell.strip() else np.nan for cell in row] for row in cells]
        )
        self.time = values[:, 1]
        self.points = values[:, 2:].reshape(len(values), len(self.labels), 3)

    @property
    def plates(self) -> int:
        """See `Capture`."""
        return len(self.forces)

    def used_plate(self) -> int:
        """See `Capture`."""
        return int(np.argmax([np.abs(self.rows[:, one.force]).sum() for one in self.forces]))

    def drop_plate(self, plate: int) -> None:
        """See `Capture`."""
        gone = self.forces.pop(plate)
        parts = [gone.force, gone.point, *([] if gone.torque is None else [gone.torque])]
        columns = [column for part in parts for column in range(part.start, part.stop)]
        self.rows = np.delete(self.rows, columns, axis=1)
        if self.head:
            names = self.head[-1].split("\t")
            self.head[-1] = "\t".join(
                name for column, name in enumerate(names) if column not in columns
            )
            self.head = [
                f"nColumns={self.rows.shape[1]}" if line.startswith("nColumns") else line
                for line in self.head
            ]

    def exchange_plates(self, first: int, second: int) -> None:
        """See `Capture`."""
        for part in ("force", "torque"):
            one = getattr(self.forces[first], part)
            other = getattr(self.forces[second], part)
            if one is not None and other is not None:
                kept = self.rows[:, one].copy()
                self.rows[:, one] = self.rows[:, other]
                self.rows[:, other] = kept

    def turn_plate(self, plate: int, quarters: int) -> None:
        """See `Capture`."""
        columns = self.forces[plate]
        turn = np.linalg.matrix_power(QUARTER, quarters)
        loaded = np.linalg.norm(self.rows[:, columns.force], axis=1) > LOADED
        points = self.rows[:, columns.point]
        center = 0.5 * (points[loaded].min(axis=0) + points[loaded].max(axis=0))
        self.rows[:, columns.force] = self.rows[:, columns.force] @ turn.T
        self.rows[:, columns.point] = (points - center) @ turn.T + center

    def scale_plate(self, plate: int, factor: float) -> None:
        """See `Capture`."""
        columns = self.forces[plate]
        self.rows[:, columns.force] *= factor
        if columns.torque is not None:
            self.rows[:, columns.torque] *= factor

    def add_force(self, plate: int, force: Sequence[float]) -> None:
        """See `Capture`."""
        columns = range(self.forces[plate].force.start, self.forces[plate].force.stop)
        up = columns[self._up_of_forces()]
        self.rows[:, up] += np.linspace(force[0], force[-1], len(self.rows))

    def _up_of_forces(self) -> int:
        """Which component of the forces carries the body."""
        sums = [np.abs(self.rows[:, one.force]).sum(axis=0) for one in self.forces]
        return int(np.argmax(np.sum(sums, axis=0)))

    def scale_places(self, factor: float) -> None:
        """See `Capture`."""
        for columns in self.forces:
            self.rows[:, columns.point] *= factor

    def delay_forces(self, seconds: float) -> None:
        """See `Capture`."""
        self.rows[:, 0] += seconds

    def change_rate(self, factor: float) -> None:
        """See `Capture`."""
        start = self.rows[0, 0]
        self.rows[:, 0] = start + (self.rows[:, 0] - start) / factor

    def write(self, folder: Path) -> tuple[Path, ...]:
        """See `Capture`."""
        table = folder / f"trial_grf{self.ending}"
        lines = [self.separator.join(f"{cell:.9g}" for cell in row) for row in self.rows]
        table.write_text("\n".join([*self.head, *lines]) + "\n", encoding="utf-8")
        if self.markers is None:
            return self._write_trc(folder / "trial.trc"), table
        self.markers.labels = self.labels
        self.markers.points = self.points
        self.markers.unit = self.unit
        return (*self.markers.write(folder), table)

    def _write_trc(self, path: Path) -> Path:
        frames, count, _ = self.points.shape
        numbers = f"{self.rate:g}\t{self.rate:g}\t{frames}\t{count}\t{self.unit}"
        head = [
            f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
            "\tOrigNumFrames",
            f"{numbers}\t{self.rate:g}\t1\t{frames}",
            "Frame#\tTime\t" + "\t\t\t".join(self.labels) + "\t\t",
            "\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(count) for axis in "XYZ"),
        ]
        rows = []
        for frame, (time, places) in enumerate(zip(self.time, self.points, strict=True)):
            cells = ("" if np.isnan(cell) else f"{cell:.9g}" for cell in places.ravel())
            rows.append(f"{frame + 1}\t{time:.6f}\t" + "\t".join(cells))
        path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
        return path

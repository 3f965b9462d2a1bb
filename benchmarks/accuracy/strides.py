"""Strikes and lifts of feet from markers alone against force plates; strides of a mouse on a belt of known speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.analysis.phases import contacts
from myomorph.analysis.strides import Limb, find_strides
from myomorph.contact.plates import force_plates, wrenches_from_plates
from myomorph.io.c3d.read import read_c3d
from myomorph.io.loads import read_external_loads
from myomorph.io.qualisys_mat import read_qualisys_mat
from myomorph.io.trc import read_trc
from myomorph.model.arrays import Array
from myomorph.model.series import Markers, Wrenches

Row = dict[str, object]
NEAR = 0.15
"""A strike of the markers this near to one of a plate is the same [s]."""


@dataclass(frozen=True)
class Walk:
    """A walk over plates and its markers: heels, toes and pelvis."""

    name: str
    file: str
    heels: tuple[str, str]
    toes: tuple[str, str]
    pelvis: tuple[str, ...]
    loads: str = ""
    up: str = "z"


DELAWARE = (("RCAL", "LCAL"), ("RMT2", "LMT2"), ("RASI", "LASI"))
GAIT = (("RHEE", "LHEE"), ("RTOE", "LTOE"), ("SACR",))
WALKS = (
    Walk("walking2", "c3d-opensim-walking/walking2.c3d", *DELAWARE),
    Walk("walking5", "c3d-opensim-walking/walking5.c3d", *DELAWARE),
    Walk("test_walking", "c3d-opensim-walking/test_walking.c3d", *DELAWARE),
    Walk("HC002D", "c3d-gait-plugingait/HC002D/Straight/HC002D06.c3d", *GAIT),
    Walk("HC030A, a child", "c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d", *GAIT),
    Walk(
        "Rajagopal",
        "rajagopal-walk-emg/markers_walk.trc",
        ("R.Heel", "L.Heel"),
        ("R.Toe", "L.Toe"),
        ("R.ASIS", "L.ASIS"),
        "rajagopal-walk-emg/grf_walk.xml",
        "y",
    ),
    Walk(
        "gait2354",
        "opensim-gait-subject01/experiment/subject01_walk1.trc",
        ("R.Heel", "L.Heel"),
        ("R.Toe.Tip", "L.Toe.Tip"),
        ("R.ASIS", "L.ASIS"),
        "opensim-gait-subject01/experiment/subject01_walk1_grf.xml",
        "y",
    ),
    Walk(
        "OpenCap subject 4",
        "opencap-subject4-multitask/markers/walking1.trc",
        ("r_calc", "L_calc"),
        ("r_toe", "L_toe"),
        ("r.ASIS", "L.ASIS"),
        "opencap-subject4-multitask/grf/walking1_external_forces.xml",
        "y",
    ),
)


def recorded(folder: Path, walk: Walk) -> tuple[Markers, Wrenches, Array]:
    """Markers, plates and up."""
    up = np.eye(3)["xyz".index(walk.up)]
    if walk.loads:
        markers = read_trc(folder / walk.file).markers
        assert markers is not None
        return markers, read_external_loads(folder / walk.loads), up
    trial = force_plates(read_c3d(folder / walk.file))
    assert trial.markers is not None
    return trial.markers, wrenches_from_plates(trial.plates, trial.plate_time), up


def measure(folder: Path) -> Iterator[Row]:
    """A row for every walk, and one for all."""
    every: tuple[list[float], list[float]] = ([], [])
    for walk in WALKS:
        strikes, lifts, speed = errors(folder, walk)
        every[0].extend(strikes)
        every[1].extend(lifts)
        yield {"recording": walk.name} | _told(strikes, lifts) | {"speed [m/s]": speed}
    yield {"recording": "all"} | _told(*every) | {"speed [m/s]": ""}


def _told(strikes: list[float], lifts: list[float]) -> Row:
    row: Row = {}
    for name, found in (("strikes", strikes), ("lifts", lifts)):
        values = 1000.0 * np.array(found)
        row[name] = len(values)
        row[f"{name}, median [ms]"] = float(np.median(values)) if len(values) else float("nan")
        row[f"{name}, largest [ms]"] = float(values[np.argmax(np.abs(values))]) if len(values) else float("nan")
    return row


def errors(folder: Path, walk: Walk) -> tuple[list[float], list[float], float]:
    """Times from markers less those of the plates [s], strikes and lifts, and the speed [m/s]."""
    markers, plates, up = recorded(folder, walk)
    limbs = [Limb(side, (heel,), (toe,)) for side, heel, toe in zip("rl", walk.heels, walk.toes, strict=True)]
    found = find_strides(markers, limbs, walk.pelvis, up)
    vertical = np.nan_to_num(plates.forces @ up)
    weight = float(np.percentile(vertical.sum(axis=1), 90.0))
    strikes, lifts = [], []
    for k in range(len(plates.names)):
        for start, stop in contacts(plates.time, vertical[:, k], 0.03 * weight, 0.1):
            limb = _foot(markers, limbs, plates, k, (start + stop) // 2)
            for events, at, inside, errors_ in (
                (found.strikes[limb], plates.time[start], start > 0, strikes),
                (found.lifts[limb], plates.time[stop], stop < len(plates) - 1, lifts),
            ):
                if inside and len(events) and np.abs(events - at).min() < NEAR:
                    errors_.append(float(events[np.argmin(np.abs(events - at))] - at))
    speeds = [one.speed for one in found.strides]
    return strikes, lifts, float(np.median(speeds)) if speeds else float("nan")


def measure_mouse(folder: Path) -> Iterator[Row]:
    """Strides of a mouse on a belt at 15 m/min, by its ankles and by its knees."""
    trial = read_qualisys_mat(folder / "mouse-markers-treadmill/treadmill_15m_per_min.mat")
    assert trial.markers is not None
    for joint in ("ankle", "knee"):
        limbs = [Limb(f"hind_{side[0]}", (f"{side}_{joint}",)) for side in ("right", "left")]
        for told in (None, 0.25):
            found = find_strides(
                trial.markers,
                limbs,
                ("left_hip", "right_hip"),
                np.array([0.0, 0.0, 1.0]),
                direction=np.array([1.0, 0.0, 0.0]),
                ground_speed=told,
            )
            for limb in limbs:
                own = found.of(limb.name)
                seen = float(np.isfinite(trial.markers[limb.points[0]][:, 0]).mean())
                row: Row = {"feet by": f"{joint}, {limb.name[-1]}", "frames seen [%]": 100.0 * seen}
                row["belt"] = "specified" if told else "estimated"
                row["belt speed [m/s]"] = -found.ground_speed
                row["strides"] = len(own)
                for name, attribute, factor in (
                    ("duration [ms]", "duration", 1e3), ("length [mm]", "length", 1e3), ("duty factor", "duty", 1.0),
                ):  # fmt: skip
                    values = factor * np.array([getattr(one, attribute) for one in own])
                    row[name] = float(np.nanmedian(values)) if len(values) else float("nan")
                yield row


def _foot(markers: Markers, limbs: list[Limb], plates: Wrenches, k: int, middle: int) -> str:
    """The foot whose heel and toes are nearest to a plate's center of pressure."""
    frame = int(np.argmin(np.abs(markers.time - plates.time[middle])))
    point = plates.points[middle, k]

    def away(limb: Limb) -> float:
        places = np.array([markers[name][frame] for name in (*limb.points, *limb.lifting)])
        return float(np.linalg.norm(np.nan_to_num(places, nan=1e3).mean(axis=0) - point))

    return min(limbs, key=away).name

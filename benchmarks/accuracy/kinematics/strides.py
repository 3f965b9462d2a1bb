"""Foot strike and foot off from markers alone against force plates.

Strides of a mouse on a belt of known speed are compared too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.recordings import RECORDINGS, read_markers
from myomorph.core.contact.plates import force_plates, wrenches_from_plates
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.qualisys_mat import read_qualisys_mat
from myomorph.core.model.arrays import Array
from myomorph.core.motion.sync import cut
from myomorph.lab.analysis.cycles import over_cycles
from myomorph.lab.analysis.phases import contacts
from myomorph.lab.analysis.strides import Stride
from myomorph.lab.analysis.walking import walking_strides

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


def _delaware(name: str) -> Walk:
    return Walk(
        name=name,
        file=f"c3d-opensim-walking/{name}.c3d",
        heels=("RCAL", "LCAL"),
        toes=("RMT2", "LMT2"),
        pelvis=("RASI", "LASI"),
    )


def _gait(name: str, file: str) -> Walk:
    return Walk(
        name=name,
        file=f"c3d-gait-plugingait/{file}",
        heels=("RHEE", "LHEE"),
        toes=("RTOE", "LTOE"),
        pelvis=("SACR",),
    )


def _read(
    name: str,
    recording: str,
    heels: tuple[str, str],
    toes: tuple[str, str],
    pelvis: tuple[str, str],
) -> Walk:
    files = RECORDINGS[recording]
    return Walk(
        name=name,
        file=files.markers,
        heels=heels,
        toes=toes,
        pelvis=pelvis,
        loads=files.loads,
        up="y",
    )


WALKS = (
    _delaware("walking2"),
    _delaware("walking5"),
    _delaware("test_walking"),
    _gait("HC002D", "HC002D/Straight/HC002D06.c3d"),
    _gait("HC030A, a child", "HC030A/Straight/HC030A05.c3d"),
    _read("Rajagopal", "rajagopal", ("R.Heel", "L.Heel"), ("R.Toe", "L.Toe"), ("R.ASIS", "L.ASIS")),
    _read(
        "gait2354",
        "gait2354",
        ("R.Heel", "L.Heel"),
        ("R.Toe.Tip", "L.Toe.Tip"),
        ("R.ASIS", "L.ASIS"),
    ),
    _read(
        "OpenCap subject 4",
        "opencap-walk",
        ("r_calc", "L_calc"),
        ("r_toe", "L_toe"),
        ("r.ASIS", "L.ASIS"),
    ),
)


GOING = {
    "walk, Rajagopal": RECORDINGS["rajagopal"],
    "walk, gait2354": RECORDINGS["gait2354"],
    "run at 2 m/s, Hamner": RECORDINGS["run-2"],
    "run at 5 m/s, Hamner": RECORDINGS["run-5"],
}
"""Model, markers and forces of recordings with whole strides on plates; the runner's model is
calibrated.
"""
SECONDS = 4.0
"""Of a recording at most."""
BESIDE = 0.08
"""A recording of a single stride begins so much before it and ends so much after [s]."""


def recorded(folder: Path, walk: Walk) -> tuple[mm.Markers, mm.Wrenches, Array]:
    """Read markers and plates of a walk.

    Parameters
    ----------
    folder : of the collection
    walk : to read

    Returns
    -------
    Markers; wrenches; (3,) the unit vector that points up
    """
    up = np.eye(3)["xyz".index(walk.up)]
    if walk.loads:
        return read_markers(folder / walk.file), read_external_loads(folder / walk.loads), up
    trial = force_plates(read_c3d(folder / walk.file))
    assert trial.markers is not None
    return trial.markers, wrenches_from_plates(trial.plates, trial.plate_time), up


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for every walk, and one for all."""
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
        row[f"{name}, largest [ms]"] = (
            float(values[np.argmax(np.abs(values))]) if len(values) else float("nan")
        )
    return row


def errors(folder: Path, walk: Walk) -> tuple[list[float], list[float], float]:
    """Return times from markers less those of the plates.

    They are those of foot strikes and of foot offs [s]. The speed [m/s] is returned with them.
    """
    markers, plates, up = recorded(folder, walk)
    limbs = [
        mm.Limb(side, (heel,), (toe,))
        for side, heel, toe in zip("rl", walk.heels, walk.toes, strict=True)
    ]
    found = mm.find_strides(markers, limbs, walk.pelvis, up)
    vertical = np.nan_to_num(plates.forces @ up)
    weight = float(np.percentile(vertical.sum(axis=1), 90.0))
    strikes = []
    lifts = []
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
        limbs = [mm.Limb(f"hind_{side[0]}", (f"{side}_{joint}",)) for side in ("right", "left")]
        for ground_speed in (None, 0.25):
            found = mm.find_strides(
                trial.markers,
                limbs,
                ("left_hip", "right_hip"),
                np.array([0.0, 0.0, 1.0]),
                direction=np.array([1.0, 0.0, 0.0]),
                ground_speed=ground_speed,
            )
            for limb in limbs:
                own = found.of(limb.name)
                seen = float(np.isfinite(trial.markers[limb.points[0]][:, 0]).mean())
                row: Row = {"feet by": f"{joint}, {limb.name[-1]}", "frames seen [%]": 100.0 * seen}
                row["belt"] = "specified" if ground_speed else "estimated"
                row["belt speed [m/s]"] = -found.ground_speed
                row["strides"] = len(own)
                for name, attribute, factor in (
                    ("duration [ms]", "duration", 1e3),
                    ("length [mm]", "length", 1e3),
                    ("duty factor", "duty", 1.0),
                ):
                    values = factor * np.array([getattr(one, attribute) for one in own])
                    row[name] = float(np.nanmedian(values)) if len(values) else float("nan")
                yield row


def _foot(
    markers: mm.Markers, limbs: list[mm.Limb], plates: mm.Wrenches, k: int, middle: int
) -> str:
    """Return the foot whose heel and toes are nearest to a plate's center of pressure."""
    frame = int(np.argmin(np.abs(markers.time - plates.time[middle])))
    point = plates.points[middle, k]

    def away(limb: mm.Limb) -> float:
        places = np.array([markers[name][frame] for name in (*limb.points, *limb.lifting)])
        return float(np.linalg.norm(np.nan_to_num(places, nan=1e3).mean(axis=0) - point))

    return min(limbs, key=away).name


def measure_duty(folder: Path) -> Iterator[Row]:
    """Compare duty factors and peaks over strides with the plates' own.

    They are computed by plates, without them, and of a single stride.
    """
    for name, files in GOING.items():
        model = mm.read_model(folder / files.model)
        markers = read_markers(folder / files.markers)
        markers = cut(markers, markers.time[0], markers.time[0] + SECONDS)
        if "run" in name:
            model = mm.calibrate(model, [markers], mm.CalibrationOptions(frames=60)).model
        fit = mm.inverse_kinematics(model, markers)
        wrenches = mm.read_loads(folder / files.loads, model, fit.motion)
        weight = (
            float(np.nanmean(_vertical(wrenches).sum(axis=1))) if "run" in name else model.weight
        )
        steps = [
            (body, *step)
            for body in dict.fromkeys(wrenches.bodies)
            for step in _steps(wrenches, body, weight)
        ]
        shown = [one for one in steps if markers.time[0] <= one[1] and one[3] <= markers.time[-1]]
        own = np.array([(lift - start) / (stop - start) for _, start, lift, stop, _ in shown])
        row: Row = {
            "recording": name,
            "strides on plates": len(shown),
            "duty factor by plates": float(np.mean(own)),
        }
        row["peak by plates [BW]"] = float(np.mean([one[4] for one in shown])) / weight
        by_plates = walking_strides(model, fit.motion, fit, wrenches=wrenches)
        alone = walking_strides(model, fit.motion, fit)
        for label, found in (("strides", by_plates), ("strides without plates", alone)):
            strides = () if found is None else found.strides
            row[f"{label}: duty factor"] = (
                float(np.nanmean([one.duty for one in strides])) if strides else float("nan")
            )
            row[f"{label}: peak over curves [BW]"] = _peak(strides, wrenches) / weight
        yield row | _of_one(model, fit.motion, wrenches, shown[0], weight)


def _of_one(
    model: mm.Model,
    motion: mm.Motion,
    wrenches: mm.Wrenches,
    step: tuple[str, float, float, float, float],
    weight: float,
) -> Row:
    """Return the same where a recording holds one stride only."""
    body, start, lift, stop, peak = step
    short = cut(motion, start - BESIDE, stop + BESIDE)
    row: Row = {
        "one stride by plates: duty factor, peak [BW]": (
            f"{(lift - start) / (stop - start):.3f}, {peak / weight:.2f}"
        )
    }
    for label, plates in (("one stride", wrenches), ("one stride without plates", None)):
        found = walking_strides(model, short, wrenches=plates)
        strides = [] if found is None else [one for one in found.strides if one.limb == body]
        duties = ", ".join(f"{one.duty:.3f}" for one in strides) or "no stride"
        row[f"{label}: duty factor, peak [BW]"] = (
            f"{duties}, {_peak(strides, wrenches) / weight:.2f}"
        )
    return row


def _vertical(wrenches: mm.Wrenches) -> Array:
    return np.nan_to_num(wrenches.forces[:, :, 1])


def _steps(
    wrenches: mm.Wrenches, body: str, weight: float
) -> list[tuple[float, float, float, float]]:
    """Return each stride of a foot that the plates show whole.

    It is foot strike, foot off, next foot strike [s] and greatest force [N].
    """
    own = [k for k, one in enumerate(wrenches.bodies) if one == body]
    force = _vertical(wrenches)[:, own].sum(axis=1)
    found = contacts(wrenches.time, force, 0.03 * weight, 0.1)
    time = wrenches.time
    return [
        (float(time[a]), float(time[b]), float(time[c]), float(force[a : b + 1].max()))
        for (a, b), (c, _) in pairwise(found)
        if a > 0
    ]


def _peak(strides: Sequence[Stride], wrenches: mm.Wrenches) -> float:
    """Return the greatest vertical force of the mean curve over strides [N].

    Each foot's force is over its own, and the result is the mean of both feet.
    """
    peaks = []
    for limb in dict.fromkeys(one.limb for one in strides):
        own = [k for k, one in enumerate(wrenches.bodies) if one == limb]
        if own:
            force = mm.Series(
                wrenches.time, (limb,), _vertical(wrenches)[:, own].sum(axis=1)[:, None]
            )
            spans = [(one.start, one.stop) for one in strides if one.limb == limb]
            peaks.append(float(np.nanmean(over_cycles(force, spans).values, axis=0).max()))
    return float(np.mean(peaks)) if peaks else float("nan")

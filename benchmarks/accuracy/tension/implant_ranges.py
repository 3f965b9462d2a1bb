"""Knees and hips in squats, rises and walks of a person without an implant, beside implants.

Forces come by `myomorph tension` with an expert's model, each with the interval of draws and, in
knees, the range that statics allow. Measured are the means of five persons with knee implants
(Kutzner et al. 2010) and of ten with hip implants (Bergmann et al. 2016).
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.hip import PUBLISHED
from benchmarks.accuracy.tension.knee import command
from benchmarks.accuracy.tension.knee_activities import (
    ACTIVITIES,
    OPENCAP,
    Activity,
    feet_under,
)
from benchmarks.results import Row
from myomorph.core.io.loads import read_external_loads, write_external_loads
from myomorph.core.model.arrays import Array

MODEL = f"{OPENCAP}/models/manually_scaled.osim"
SPANS = {"squats1": (0.5, 6.0), "STS1": (0.5, 5.0), "walking1": (0.1, 1.2)}
"""Part of each recording that is used [s]."""
OF_HIPS = {"STS1": "rising", "walking1": "walking"}
"""Activity of the hips' implants, by recording."""
DRAWS = 60
STANDING = 0.9
"""Share of the weight on the feet from which a frame counts: a seat is not measured."""


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces of a recording in body weights.

    Attributes
    ----------
    tables : estimate, and low and high by draws
    statics : least and greatest by statics
    weight : of the body [N]
    standing : (frames,) whether feet carry the body
    """

    tables: tuple[mm.Table, mm.Table, mm.Table]
    statics: tuple[mm.Table, mm.Table]
    weight: float
    standing: Array

    def at_peak(self, label: str, joint: str) -> Row:
        """Greatest force of a joint, with its limits and range there."""
        column = f"{label}_force"
        found, low, high = [table[column] / self.weight for table in self.tables]
        # Frames that nothing known carries have no loads.
        frame = int(np.nanargmax(np.where(self.standing, found, -1.0)))
        row: Row = {
            "peak force [BW]": float(found[frame]),
            "90 % from [BW]": float(low[frame]),
            "90 % to [BW]": float(high[frame]),
        }
        for name, table in zip(("minimum", "maximum"), self.statics, strict=True):
            known = joint in table.names
            value = float(table[joint][frame]) / self.weight if known else ""
            row[f"{name} by statics [BW]"] = value
        return row


def measure(folder: Path) -> Iterator[Row]:
    """Rows by activity and joint, the two legs apart."""
    for activity in ACTIVITIES:
        if activity.file not in SPANS:
            continue
        if not (folder / activity.folder).is_dir():
            print(f"{activity.name}: the recording '{activity.folder}' is absent")
            continue
        loads = _loads(folder, activity)
        for side in "rl":
            measured: object = activity.implants
            row = loads.at_peak(f"knee_{side}", f"walker_knee_{side}")
            yield _row(activity.name, f"knee, {side}", row, measured)
            if activity.file in OF_HIPS:
                size, spread, *_ = PUBLISHED[OF_HIPS[activity.file]]
                row = loads.at_peak(f"hip_{side}", f"hip_{side}")
                yield _row(activity.name, f"hip, {side}", row, 0.01 * size) | {
                    "SD of implants [BW]": 0.01 * spread
                }


def _row(activity: str, joint: str, row: Row, measured: object) -> Row:
    """One row, with whether the mean of implants lies inside the interval."""
    low = float(str(row["90 % from [BW]"]))
    high = float(str(row["90 % to [BW]"]))
    return {
        "activity": activity,
        "joint": joint,
        **row,
        "implants, mean [BW]": measured,
        "mean inside": bool(low <= float(str(measured)) <= high),
    }


def _loads(folder: Path, activity: Activity) -> Loads:
    """Run `tension` with draws on a recording."""
    here = folder / activity.folder
    model = mm.read_model(folder / MODEL)
    motion_file = here / f"ik_manual_scaling/{activity.file}_ik.mot"
    motion = mm.read_motion(motion_file, model)
    given = read_external_loads(here / f"grf/{activity.file}_external_forces.xml")
    at_frames = mm.resample_wrenches(given, motion.time, cutoff=None)
    feet = feet_under(model, motion, at_frames)
    tables, statics = _tension(folder / MODEL, motion_file, replace(given, bodies=feet))
    time = tables[0].time
    carried = np.interp(time, motion.time, np.nan_to_num(at_frames.forces[:, :, 1]).sum(axis=1))
    return Loads(
        tables=tables,
        statics=statics,
        weight=model.weight,
        standing=np.asarray(carried > STANDING * model.weight),
    )


def _tension(
    model: Path, motion: Path, wrenches: mm.Wrenches
) -> tuple[tuple[mm.Table, mm.Table, mm.Table], tuple[mm.Table, mm.Table]]:
    """Run `tension`; return loads of joints with limits, and least and greatest by statics."""
    span = next(span for name, span in SPANS.items() if motion.name.startswith(name))
    with tempfile.TemporaryDirectory() as work:
        home = Path(work)
        write_external_loads(wrenches, home / "loads.sto", home / "loads.xml")
        (home / "sizes.toml").write_text("contributions = 0\n", encoding="utf-8")
        files = ("--model", model, "--motion", motion, "--loads", home / "loads.xml")
        ways = ("--reactions", "child", "--contact-points", "auto", "--time")
        draws = ("--draws", DRAWS, "--uncertainty", home / "sizes.toml")
        out = home / "out"
        command("tension", *files, *ways, *span, *draws, "--out", out)
        loads = [mm.read_sto(out / f"joint_reactions{end}.sto") for end in ("", "_low", "_high")]
        statics = [mm.read_sto(out / f"static_load_{end}.sto") for end in ("low", "high")]
    return (loads[0], loads[1], loads[2]), (statics[0], statics[1])

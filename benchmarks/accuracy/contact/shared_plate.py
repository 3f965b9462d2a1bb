"""A walk over one plate: what two plates measured is joined, shared by the command, and compared.

Of each foot the force that its own plate measured is the truth, which the command never reads.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.errors import rms
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, table_from_motion
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Table, Wrenches
from myomorph.core.motion.sync import resample_wrenches

Row = dict[str, object]

WALK = "rajagopal-walk-emg"
CUTOFF = 6.0
LOADED = 0.02
"""Share of the weight above which a plate carries a foot."""
FEET = {"right": "r", "left": "l"}


def measure(folder: Path) -> Iterator[Row]:
    """Errors of each foot's force, while it is alone on the plate and while both are."""
    home = folder / WALK
    model = mm.read_model(home / "subject_walk_scaled.osim")
    whole = motion_from_table(mm.read_sto(home / "coordinates.sto"), model)
    motion = mm.Motion(whole.time[::10], whole.names, whole.values[::10])
    loads = read_external_loads(home / "grf_walk.xml")
    with tempfile.TemporaryDirectory(prefix="shared_plate_") as name:
        work = Path(name)
        mm.write_sto(table_from_motion(motion, model), work / "walk.mot")
        mm.write_sto(joined(loads), work / "plate.sto")
        words = ["tension", "--model", str(home / "subject_walk_scaled.osim")]
        words += ["--motion", str(work / "walk.mot"), "--cutoff", f"{CUTOFF:g}"]
        words += ["--loads", str(work / "plate.sto"), "--contacts", "auto"]
        command(*words, "--measured", "shared", "--out", str(work / "out"))
        found = mm.read_sto(work / "out" / "contact_groups.sto")
    yield from compared(found, resample_wrenches(loads, motion.time, CUTOFF), model.weight)


def joined(loads: Wrenches) -> Table:
    """Sum of all forces as the table of one plate, its center of pressure on the floor."""
    force = np.nan_to_num(loads.forces)
    moment = np.nan_to_num(loads.torques) + np.cross(np.nan_to_num(loads.points), force)
    force = force.sum(axis=1)
    moment = moment.sum(axis=1)
    firm = force[:, 1] > 20.0
    upwards = np.where(firm, force[:, 1], 1.0)
    center = np.stack([moment[:, 2], np.zeros(len(force)), -moment[:, 0]], axis=1)
    center = np.where(firm[:, None], center / upwards[:, None], 0.0)
    torque = moment - np.cross(center, force)
    names = [f"plate_{kind}{axis}" for kind in ("force_v", "force_p", "torque_") for axis in "xyz"]
    return Table(loads.time, tuple(names), np.hstack([force, center, torque]))


def compared(found: Table, true: Wrenches, weight: float) -> Iterator[Row]:
    """Rows of both feet, by how many feet stood on the plate.

    Parameters
    ----------
    found : forces of contacts (frames, columns) [N]
    true : what each foot's plate measured, at the motion's times
    weight : of the body [N]
    """
    forces = {side: _of_foot(true, side) for side in FEET.values()}
    forces = {
        side: np.stack([np.interp(found.time, true.time, axis) for axis in force.T], axis=1)
        for side, force in forces.items()
    }
    loaded = {side: force[:, 1] > LOADED * weight for side, force in forces.items()}
    for words, side in FEET.items():
        other = loaded["l" if side == "r" else "r"]
        off = np.stack([found[f"foot_{side}_f{axis}"] for axis in "xyz"], axis=1) - forces[side]
        for state, frames in (("alone", ~other), ("with the other", other)):
            chosen = loaded[side] & frames
            yield {
                "foot": words,
                "on the plate": state,
                "frames": int(chosen.sum()),
                "vertical, RMS [N]": rms(off[chosen, 1]),
                "largest [N]": float(np.abs(off[chosen, 1]).max(initial=0.0)),
                "fore-aft, RMS [N]": rms(off[chosen, 0]),
                "lateral, RMS [N]": rms(off[chosen, 2]),
            }


def _of_foot(true: Wrenches, side: str) -> Array:
    """Sum of what plates measured of a foot (samples, 3) [N]."""
    columns = [index for index, body in enumerate(true.bodies) if body.endswith(f"_{side}")]
    return np.nan_to_num(true.forces[:, columns]).sum(axis=1)

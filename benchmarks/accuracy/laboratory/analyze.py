"""`myomorph analyze` on recordings of many laboratories.

The tables have what it took, and joint moments next to each set's own. Nothing is written by hand:
each row is one command on raw files, with the body's mass. The generic model (myo-sim's legs and
trunk) is another one than those of the references, so the moments are those of other bodies with
other axes.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms_known
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.cli import main

Row = dict[str, object]
JOINTS = ("hip_flexion", "knee_angle", "ankle_angle")
NAMES = {"hip_flexion": "hip", "knee_angle": "knee", "ankle_angle": "ankle"}
CUTOFF = 6.0
"""Of references that are computed here from a set's own angles and model [Hz]."""
STANCE = 0.05
"""Share of body weight on a foot from which on its moments are compared."""
Reference = Callable[[Path, float], mm.Series]


@dataclass(frozen=True)
class Case:
    """A recording of the collection.

    `files`: as typed, below the collection; `options`: as typed besides `--mass`; a text that ends
    in .c3d, .trc or .osim is a file of the collection; `trial`: whose results are compared, as its
    folder is called; `reference`: the set's own moments, positive as those of OpenSim's Rajagopal
    model; None for none; `source`: of that reference, in words; `begins`: frame of the recording at
    which the reference's times begin at 0; None where both have one clock.
    """

    name: str
    files: tuple[str, ...]
    mass: float
    trial: str
    options: tuple[str, ...] = ()
    reference: Reference | None = None
    source: str = "none"
    begins: int | None = None


def plug_in_gait(path: str) -> Reference:
    """Moments that Plug-in Gait left in a C3D file [N mm/kg], as joint torques [N m]."""

    def found(folder: Path, mass: float) -> mm.Series:
        trial = mm.read_recording(folder / path)
        points = trial.other_points
        # Plug-in Gait: extension of hip and knee and plantar flexion are positive, as external
        # moments' reactions.
        signs = {
            "hip_flexion": ("HipMoment", -1.0),
            "knee_angle": ("KneeMoment", -1.0),
            "ankle_angle": ("AnkleMoment", -1.0),
        }
        columns = {
            f"{joint}_{side.lower()}": sign * 1e-3 * mass * points[f"{side}{name}"][:, 0]
            for joint, (name, sign) in signs.items()
            for side in "RL"
        }
        return mm.Series(points.time, tuple(columns), np.column_stack(list(columns.values())))

    return found


def opensim_table(path: str, signs: dict[str, float] | None = None) -> Reference:
    """Moments of a table that OpenSim or a program like it wrote."""

    def found(folder: Path, mass: float) -> mm.Series:
        table = mm.read_sto(folder / path)
        columns = {}
        for joint in JOINTS:
            for side in "rl":
                title = f"{joint}_{side}_moment"
                if title in table.names:
                    columns[f"{joint}_{side}"] = (signs or {}).get(joint, 1.0) * table[title]
        return mm.Series(table.time, tuple(columns), np.column_stack(list(columns.values())))

    return found


def own_dynamics(
    model: str,
    motion: str,
    loads: str,
    sides: str = "rl",
    joints: Mapping[str, str] = FrozenMap({}),
) -> Reference:
    """Return moments of a set's own model and angles, by our inverse dynamics.

    It agrees with OpenSim's. `sides`: of the legs whose forces the loads hold; `joints`: what the
    set's model calls a joint.
    """

    def found(folder: Path, mass: float) -> mm.Series:
        body = mm.read_model(folder / model)
        angles = mm.differentiate(mm.read_motion(folder / motion, body), cutoff=CUTOFF)
        forces = mm.read_loads(folder / loads, body, angles)
        torques = mm.inverse_dynamics(
            body, angles, mm.resample_wrenches(forces, angles.time, cutoff=CUTOFF)
        )
        names = {
            f"{joint}_{side}": f"{joints.get(joint, joint)}_{side}"
            for joint in JOINTS
            for side in sides
        }
        return mm.Series(
            torques.time, tuple(names), np.column_stack([torques[name] for name in names.values()])
        )

    return found


GAIT = "c3d-gait-plugingait"
KNEE = "knee-implant-walk"
LENHART = "lenhart-knee-contact-walk"
CASES = (
    Case(
        name="Plug-in Gait, first person",
        files=(f"{GAIT}/HC030A/Straight/HC030A05.c3d",),
        mass=45.8,
        trial="HC030A05",
        reference=plug_in_gait(f"{GAIT}/HC030A/Straight/HC030A05.c3d"),
        source="Plug-in Gait's, in the file",
    ),
    Case(
        name="Plug-in Gait, second person",
        files=(f"{GAIT}/HC002D/Straight/HC002D06.c3d",),
        mass=0.0,
        trial="HC002D06",
        reference=plug_in_gait(f"{GAIT}/HC002D/Straight/HC002D06.c3d"),
        source="Plug-in Gait's, in the file",
    ),
    Case(
        name="Rajagopal walk",
        files=("rajagopal-walk-emg/markers_walk.trc",),
        mass=85.27,
        trial="walk",
        options=("--static", "rajagopal-walk-emg/raw/static_walk_1.trc"),
        reference=opensim_table("rajagopal-walk-emg/id_walk.sto"),
        source="OpenSim, Rajagopal's model",
    ),
    Case(
        name="gait2354 walk",
        files=("opensim-gait-subject01/experiment/subject01_walk1.trc",),
        mass=72.6,
        trial="subject01_walk1",
        options=(),
        reference=opensim_table(
            "opensim-gait-subject01/ref_id/std_subject01_InverseDynamics.sto", {"knee_angle": -1.0}
        ),
        source="OpenSim, gait2354",
    ),
    Case(
        name="OpenCap laboratory: walk, sit to stand, drop jump",
        files=("opencap-subject4-multitask",),
        mass=62.6,
        trial="walking1",
        options=(),
        reference=own_dynamics(
            "opencap-subject4-multitask/models/manually_scaled.osim",
            "opencap-subject4-multitask/ik_manual_scaling/walking1_ik.mot",
            "opencap-subject4-multitask/grf/walking1_external_forces.xml",
        ),
        source="an expert's model and angles",
    ),
    Case(
        name="Lenhart walk",
        files=("lenhart-knee-contact-walk/motion/overground_17.trc",),
        mass=62.0,
        trial="overground_17",
        options=(),
        # COMAK's own knee moment leaves out what ligaments and contact of its model bear: it is no
        # net moment.
        reference=own_dynamics(
            f"{LENHART}/lenhart2015.osim",
            f"{LENHART}/reference_comak/overground_17_ik.mot",
            f"{LENHART}/motion/overground_17_ext_loads.xml",
            "r",
            {"hip_flexion": "hip_flex", "knee_angle": "knee_flex", "ankle_angle": "ankle_flex"},
        ),
        source="published model and angles (right leg)",
    ),
    Case(
        name="instrumented knee, C3D",
        files=(f"{KNEE}/walk1.c3d",),
        mass=75.0,
        trial="walk1",
        options=("--emg-side", "left"),
        reference=own_dynamics(
            f"{KNEE}/scaled.osim", f"{KNEE}/walk1_ik.mot", f"{KNEE}/walk1_grf.xml", "l"
        ),
        # Its first frame is where the distance between the heels is the same in the TRC and the C3D
        # file, to 0.001 mm.
        source="published model and angles (left leg)",
        begins=7,
    ),
    Case(
        name="Hamner run, 5 m/s",
        files=("hamner-run-subject04/run500/markers.trc",),
        mass=82.0,
        trial="run500",
    ),
    Case(
        name="Hamner run, 2 m/s",
        files=("hamner-run-subject04/run200/markers.trc",),
        mass=82.0,
        trial="run200",
    ),
    Case(
        name="OpenSim's C3D walk",
        files=("c3d-opensim-walking/walking2.c3d",),
        mass=70.0,
        trial="walking2",
    ),
    Case(
        name="functional trial, knee",
        files=("c3d-functional-joints/functional_trials/right_knee.c3d",),
        mass=70.0,
        trial="right_knee",
        options=("--static", "c3d-functional-joints/static_lower_body.c3d"),
    ),
    Case(
        name="box lift, forces without a heading",
        files=("lifting-box-15kg/stoop1.c3d",),
        mass=81.68,
        trial="stoop1",
        options=(
            "--height",
            "1.73",
            "--force-columns",
            "time,-,-,-,-,-,-,Fx2,Fy2,Fz2,COPx2,COPy2,COPz2",
            # The table counts from another start than the recording, by which it was cut.
            "--force-shift",
            "-12.4",
        ),
    ),
)


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each command.

    It has what was typed, what was found, and moments next to the set's own.
    """
    for case in CASES:
        mass = case.mass or c3d_mass(folder / case.files[0])
        typed = ["analyze", *case.files, "--mass", f"{mass:g}", *case.options]
        with tempfile.TemporaryDirectory() as name:
            out = Path(name) / "out"
            started = time.monotonic()
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
                status = main([*_paths(typed, folder), "--out", str(out), "--workers", "1"])
            seconds = time.monotonic() - started
            results = mm.load(out) if status == 0 else {}
            yield {
                "recording": case.name,
                "typed": " ".join(Path(one).name if "/" in one else one for one in typed),
                "protocol": _protocol(printed.getvalue()),
                "trials": len(results),
                **_trial_columns(results, case, folder, mass),
                "reference": case.source,
                "assumptions": printed.getvalue().count("\n  "),
                "time [s]": seconds,
            }


def _trial_columns(
    results: Mapping[str, mm.TrialResult], case: Case, folder: Path, mass: float
) -> Row:
    """Return the columns of the case's trial: errors of markers, and moments next to the set's."""
    found = next((one for key, one in results.items() if Path(key).name == case.trial), None)
    agreement = {}
    if found is not None and case.reference is not None:
        agreement = _agreement(found, case, folder, mass)
    error = float("nan")
    if found is not None and found.fit is not None:
        error = 1e3 * rms_known(found.fit.marker_error)
    row: Row = {"markers, RMS [mm]": error}
    row |= {f"{NAMES[joint]}, r": agreement.get(joint, ("", ""))[0] for joint in JOINTS}
    row |= {f"{NAMES[joint]}, RMS [N m/kg]": agreement.get(joint, ("", ""))[1] for joint in JOINTS}
    return row


UNKNOWN = ("OpenSim's C3D walk", "functional trial, knee")
"""Recordings whose sets say no mass."""


def measure_weighing(folder: Path) -> Iterator[Row]:
    """Yield a row for each recording without `--mass`: its plates' weight and the set's mass."""
    for case in CASES:
        stated = case.mass or c3d_mass(folder / case.files[0])
        typed = ["analyze", *case.files, *case.options, "--prepare"]
        said = io.StringIO()
        with (
            tempfile.TemporaryDirectory() as name,
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
        ):
            main([*_paths(typed, folder), "--out", str(Path(name) / "out")])
        line = next(
            (line for line in said.getvalue().splitlines() if line.startswith("  Mass ")), ""
        )
        weighed = float(line.split()[1]) if line else float("nan")
        known = case.name not in UNKNOWN
        yield {
            "recording": case.name,
            "mass of the set [kg]": stated if known else float("nan"),
            "weighed [kg]": weighed,
            "difference [%]": 100.0 * (weighed / stated - 1.0) if known else float("nan"),
            "how": line.partition(" weigh it ")[2].partition(" (--mass)")[0] or "refused",
        }


def c3d_mass(path: Path) -> float:
    """Return the mass that Vicon's programs leave in a C3D file [kg]."""
    # Only of this benchmark: the package's reader leaves such parameters alone.
    import ezc3d

    groups = ezc3d.c3d(str(path))["parameters"]
    value = groups["PROCESSING"]["Bodymass"]["value"]
    return float(np.ravel(value)[0])


def _paths(typed: list[str], folder: Path) -> list[str]:
    return [
        str(folder / one) if (folder / one).exists() and one != "analyze" else one for one in typed
    ]


def _protocol(text: str) -> str:
    """Return the protocol that the command reports."""
    after = text.partition("marker protocol ")[2]
    return after.partition(";")[0] if after else "common names"


def _agreement(
    found: mm.TrialResult, case: Case, folder: Path, mass: float
) -> dict[str, tuple[float, float]]:
    """Return correlation and root mean square difference [N m/kg], by joint.

    Only frames count in which the foot is on a plate.
    """
    assert case.reference is not None
    torques = found.torques
    wrenches = found.wrenches
    if torques is None or wrenches is None:
        return {}
    reference = case.reference(folder, mass)
    clock = reference.time if case.begins is None else reference.time + torques.time[case.begins]
    pairs: dict[str, list[tuple[Array, Array]]] = {joint: [] for joint in JOINTS}
    for side in "rl":
        stance = _vertical_at(wrenches, side, clock) > STANCE * 9.81 * mass
        for joint in JOINTS:
            name = f"{joint}_{side}"
            if name not in reference.names or name not in torques.names:
                continue
            ours = np.interp(clock, torques.time, torques[name], left=np.nan, right=np.nan)
            theirs = reference[name]
            used = stance & np.isfinite(ours) & np.isfinite(theirs)
            if used.sum() > 10:
                pairs[joint].append((ours[used], theirs[used]))
    return {joint: _likeness(own, mass) for joint, own in pairs.items() if own}


def _vertical_at(wrenches: mm.Wrenches, side: str, clock: Array) -> Array:
    """Return the vertical force (samples,) on the bodies of a side at times, 0 outside [N]."""
    columns = [k for k, body in enumerate(wrenches.bodies) if body.endswith(f"_{side}")]
    vertical = np.zeros(len(wrenches))
    if columns:
        vertical = wrenches.forces[:, columns, 1].sum(axis=1)
    return np.interp(clock, wrenches.time, vertical, left=0.0, right=0.0)


def _likeness(pairs: Sequence[tuple[Array, Array]], mass: float) -> tuple[float, float]:
    """Return correlation and root mean square difference [N m/kg] of both sides together."""
    ours = np.concatenate([one for one, _ in pairs])
    theirs = np.concatenate([other for _, other in pairs])
    return float(np.corrcoef(ours, theirs)[0, 1]), rms_known(ours - theirs) / mass

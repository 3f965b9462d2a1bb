"""Muscle tensions without passive force against OpenSim's static optimization, on the same frames.

OpenSim gets every coordinate: where one is missing, AnalyzeTool 4.6 takes accelerations from the
wrong columns.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import myomorph as mm
from benchmarks.opensim_static import (
    AnalyzeInputs,
    StaticOptions,
    StaticResult,
    static_optimization,
    write_actuators,
)
from benchmarks.recordings import RECORDINGS, read_torques
from myomorph.core.io.osim.actuators import read_actuators
from myomorph.core.io.sto import table_from_motion
from myomorph.core.model.model import Actuator
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import default_reserves


@dataclass(frozen=True)
class TensionCase:
    """A model, a motion and loads, every `interval`-th frame of [start, end] seconds.

    `loads`: an external loads file, or a table of forces with `feet`; `feet`: (body, force, point,
    torque) name beginnings of each force in the table; `actuators`: an actuator file; "" for
    default reserves, "none" for nothing; `kind`: class that all muscles are turned into, "" for
    their own.
    """

    name: str
    model: str
    motion: str
    loads: str = ""
    feet: tuple[tuple[str, str, str, str], ...] = ()
    start: float = 0.0
    end: float = 1.0
    interval: int = 1
    cutoff: float | None = None
    actuators: str = ""
    kind: str = ""


FEET = (
    ("calcn_r", "ground_force_v", "ground_force_p", "ground_torque_"),
    ("calcn_l", "1_ground_force_v", "1_ground_force_p", "1_ground_torque_"),
)
LEFT_FIRST = (
    ("calcn_l", "l_ground_force_v", "l_ground_force_p", "l_ground_torque_"),
    ("calcn_r", "ground_force_v", "ground_force_p", "ground_torque_"),
)
GAIT10 = "opensim-gait-subject01/ref_so_10dof18musc/"


def _case(
    name: str, recording: str, span: tuple[float, float], interval: int, **more: Any
) -> TensionCase:
    files = RECORDINGS[recording]
    case = TensionCase(
        name=name,
        model=files.model,
        motion=files.motion,
        loads=files.loads,
        start=span[0],
        end=span[1],
        interval=interval,
    )
    return replace(case, **more)


CASES = (
    *(
        _case(f"arm26, 6 {kind}", "arm26", (0.0, 1.0), 4, cutoff=6.0, actuators="none", kind=kind)
        for kind in (
            "Thelen2003Muscle",
            "Thelen2003Muscle_Deprecated",
            "Millard2012EquilibriumMuscle",
            "Millard2012AccelerationMuscle",
        )
    ),
    replace(
        _case("walk, 18 muscles, ankle spring", "gait10", (0.5, 1.3), 20, feet=LEFT_FIRST),
        loads="opensim-gait-subject01/ref_rra/subject01_walk1_grf.mot",
        actuators=f"{GAIT10}gait10dof_Actuators_weak.xml",
    ),
    _case("walk, Rajagopal, 80 muscles", "rajagopal", (0.6, 1.6), 50),
    _case(
        "treadmill walk, 80 muscles, no arms", "treadmill", (10.9, 11.7), 3, feet=FEET, cutoff=6.0
    ),
    _case(
        "treadmill walk, gait2392, 92 muscles",
        "gait2392",
        (10.0, 11.2),
        10,
        feet=LEFT_FIRST,
        cutoff=6.0,
    ),
    _case("walk, OpenCap, 80 muscles", "opencap-walk", (0.3, 1.2), 6, cutoff=6.0),
)

LOADS = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><ExternalLoads name="loads"><objects>{entries}</objects>
<datafile>{data}</datafile></ExternalLoads></OpenSimDocument>
"""
ENTRY = """<ExternalForce name="{body}_force"><applied_to_body>{body}</applied_to_body>
<force_expressed_in_body>ground</force_expressed_in_body><point_expressed_in_body>ground</point_expressed_in_body>
<force_identifier>{force}</force_identifier><point_identifier>{point}</point_identifier>
<torque_identifier>{torque}</torque_identifier></ExternalForce>
"""


@dataclass(frozen=True)
class Prepared:
    """A case with files that both programs read."""

    case: TensionCase
    model: mm.Model
    model_path: Path
    motion: mm.Motion
    motion_path: Path
    loads: Path | None
    actuators: tuple[Actuator, ...]
    actuator_path: Path | None


def prepare(folder: Path, case: TensionCase, work: Path) -> Prepared:
    """Model, complete motion, loads and actuators of a case, as values and as files in `work`."""
    model_path = folder / case.model
    if case.kind:
        text = model_path.read_text().replace("Thelen2003Muscle", case.kind)
        model_path = work / "model.osim"
        model_path.write_text(text)
    model = mm.read_model(model_path)
    given = mm.read_motion(folder / case.motion, model)
    motion = mm.Motion(
        given.time, model.coordinate_names, compile_tree(model).coordinates_of(given)
    )
    motion_path = work / "motion.sto"
    mm.write_sto(table_from_motion(motion, model, degrees=False), motion_path)
    loads = folder / case.loads if case.loads else None
    if case.feet:
        entries = (ENTRY.format(body=b, force=f, point=p, torque=t) for b, f, p, t in case.feet)
        loads = work / "loads.xml"
        loads.write_text(LOADS.format(entries="".join(entries), data=folder / case.loads))
    actuators: tuple[Actuator, ...] = ()
    path: Path | None = None
    if case.actuators and case.actuators != "none":
        path = folder / case.actuators
        actuators = read_actuators(path, model)
    elif not case.actuators:
        actuators = default_reserves(model, 10.0, 100.0)
        path = work / "actuators.xml"
        write_actuators(actuators, path)
    return Prepared(
        case=case,
        model=model,
        model_path=model_path,
        motion=motion,
        motion_path=motion_path,
        loads=loads,
        actuators=actuators,
        actuator_path=path,
    )


def ours(prepared: Prepared, at: np.ndarray | None = None) -> Tension:
    """Return our tensions.

    Parameters
    ----------
    prepared : the case
    at : (samples,) times whose nearest frames are solved [s], None for all frames of the case

    Returns
    -------
    Tensions
    """
    case = prepared.case
    whole = mm.differentiate(prepared.motion, case.cutoff)
    if at is None:
        keep = np.flatnonzero((whole.time >= case.start) & (whole.time <= case.end))
    else:
        keep = np.abs(whole.time[:, None] - at[None]).argmin(axis=0)
    motion = whole.frames(keep)
    torques = read_torques(prepared.loads, prepared.model, motion)
    return mm.solve_tension(
        prepared.model,
        motion,
        torques,
        mm.TensionOptions(min_activation="model", curves="opensim"),
        prepared.actuators,
        recruitment=EFFORT_ALONE,
    )


def theirs(prepared: Prepared) -> StaticResult:
    """OpenSim's static optimization of the case."""
    case = prepared.case
    inputs = AnalyzeInputs(
        model=prepared.model_path,
        motion=prepared.motion_path,
        loads=prepared.loads,
        actuators=prepared.actuator_path,
        cutoff=-1.0 if case.cutoff is None else case.cutoff,
    )
    options = StaticOptions(interval=case.interval, tolerance=1e-5)
    return static_optimization(inputs, case.start, case.end, options)


def measure_case(folder: Path, case: TensionCase) -> dict[str, object]:
    """Return distances of activations and reserves.

    The row has milliseconds per frame from coordinates to activations too.
    """
    with tempfile.TemporaryDirectory() as work:
        prepared = prepare(folder, case, Path(work))
        reference = theirs(prepared)
        found = ours(prepared, reference.time)
        ours(prepared)
        began = time.perf_counter()
        frames = len(ours(prepared))
        seconds = time.perf_counter() - began
    columns = [reference.names.index(name) for name in found.muscles]
    difference = found.activation - reference.activations[:, columns]
    rms = np.sqrt(np.mean(difference**2, axis=0))
    helpers = [reference.names.index(name) for name in found.reserve_names]
    apart = np.abs(found.actuator_force - reference.forces[:, helpers])
    return {
        "case": case.name,
        "frames": len(reference.time),
        "RMS of activations": float(np.sqrt(np.mean(difference**2))),
        "worst muscle's RMS": float(rms.max()),
        "worst muscle": found.muscles[int(rms.argmax())],
        "largest difference": float(np.abs(difference).max()),
        "difference of reserves, 95 % [N, N m]": float(np.percentile(apart, 95))
        if apart.size
        else 0.0,
        "optimal": float(found.optimal.mean()),
        "ours [ms/frame]": 1e3 * seconds / frames,
        "OpenSim [ms/frame]": 1e3 * reference.seconds / len(reference.time),
    }


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Rows of all cases."""
    for case in CASES:
        yield measure_case(folder, case)

"""OpenSim's MocoInverse on elastic tendons, with fitted paths.

Muscles, motion and loads are the same as ours. It takes many minutes, so its results are stored in
a folder outside the repository (the environment variable `MYOMORPH_MOCO_RESULTS`, else a folder in
the system's temporary one) and read from there by later calls.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim

from myomorph.core.model.arrays import Array

WELDED = ("subtalar_r", "subtalar_l", "mtp_r", "mtp_l", "radius_hand_r", "radius_hand_l")
"""Joints that OpenSim's own example welds; with them MocoInverse's first derivative is not a
number.
"""

RESERVE = 1.0
RESIDUAL = 10.0
"""Optimal forces [N m], [N], as ours by default."""

MESH = 0.02
TOLERANCE = 1e-3
"""Mesh interval [s], and convergence and constraint tolerance of OpenSim's own examples."""


@dataclass(frozen=True)
class MocoFound:
    """What MocoInverse found.

    `activations`, `forces`: (times, muscles), the latter normalized tendon forces; `model`: file of
    the model that it solved, but with paths around bones instead of the functions fitted to them,
    which Myomorph does not read; `seconds`: of the solution alone; `success`: whether its solver
    converged.
    """

    time: Array
    muscles: tuple[str, ...]
    activations: Array
    forces: Array
    model: Path
    seconds: float
    iterations: int
    success: bool


def moco_inverse(folder: Path, start: float, end: float, dynamics: bool = False) -> MocoFound:
    """Solve `rajagopal-walk-emg` from `start` to `end` [s] by MocoInverse, or read earlier results.

    `folder`: of the recording; `dynamics`: whether activations follow excitations; the cost is then
    that of excitations.
    """
    kept = os.environ.get("MYOMORPH_MOCO_RESULTS")
    root = Path(kept) if kept else Path(tempfile.gettempdir()) / "myomorph-moco"
    controls = "excitations" if dynamics else "activations"
    place = root / f"rajagopal-{start:g}-{end:g}-{controls}"
    if not (place / "found.json").exists():
        place.mkdir(parents=True, exist_ok=True)
        _solve(folder, place, start, end, dynamics)
    return _read(place)


def _solve(folder: Path, place: Path, start: float, end: float, dynamics: bool) -> None:
    _model(folder, dynamics, functions=False).process().printToXML(str(place / "model.osim"))
    processor = _model(folder, dynamics)
    model = processor.process()
    inverse = opensim.MocoInverse()
    inverse.setModel(processor)
    table = opensim.TableProcessor(str(folder / "coordinates.sto"))
    table.append(opensim.TabOpLowPassFilter(6))
    inverse.setKinematics(table)
    inverse.set_kinematics_allow_extra_columns(True)
    inverse.set_initial_time(start)
    inverse.set_final_time(end)
    inverse.set_mesh_interval(MESH)
    inverse.set_convergence_tolerance(TOLERANCE)
    inverse.set_constraint_tolerance(TOLERANCE)
    began = time.perf_counter()
    # OpenSim's objects go with those that own them: each is kept.
    whole = inverse.solve()
    solution = whole.getMocoSolution()
    seconds = time.perf_counter() - began
    success = solution.success()
    if solution.isSealed():
        solution.unseal()
    solution.write(str(place / "solution.sto"))
    muscles = [muscle.getName() for muscle in model.getMuscles()]
    kind = solution.getState if dynamics else solution.getControl
    ending = "/activation" if dynamics else ""
    activations = np.column_stack(
        [kind(f"/forceset/{name}{ending}").to_numpy() for name in muscles]
    )
    forces = np.column_stack(
        [
            solution.getState(f"/forceset/{name}/normalized_tendon_force").to_numpy()
            for name in muscles
        ]
    )
    np.savez(
        place / "found.npz", time=solution.getTimeMat(), activations=activations, forces=forces
    )
    facts = {
        "muscles": muscles,
        "seconds": seconds,
        "iterations": solution.getNumIterations(),
        "success": success,
    }
    (place / "found.json").write_text(json.dumps(facts), encoding="utf-8")


def _model(folder: Path, dynamics: bool, functions: bool = True) -> object:
    """Return the recording's model with De Groote's muscles without passive force.

    MocoInverse can solve that.
    """
    processor = opensim.ModelProcessor(str(folder / "subject_walk_scaled.osim"))
    welded = opensim.StdVectorString()
    for name in WELDED:
        welded.append(name)
    parts = [
        opensim.ModOpReplaceJointsWithWelds(welded),
        opensim.ModOpReplaceMusclesWithDeGrooteFregly2016(),
        opensim.ModOpIgnorePassiveFiberForcesDGF(),
        opensim.ModOpTendonComplianceDynamicsModeDGF("implicit"),
        opensim.ModOpAddExternalLoads(str(folder / "grf_walk.xml")),
        opensim.ModOpAddResiduals(RESIDUAL, RESIDUAL),
        opensim.ModOpAddReserves(RESERVE),
    ]
    if functions:
        paths = str(folder / "subject_walk_scaled_FunctionBasedPathSet.xml")
        parts.append(opensim.ModOpReplacePathsWithFunctionBasedPaths(paths))
    if not dynamics:
        parts.append(opensim.ModOpIgnoreActivationDynamics())
    for one in parts:
        processor.append(one)
    return processor


def _read(place: Path) -> MocoFound:
    facts = json.loads((place / "found.json").read_text(encoding="utf-8"))
    with np.load(place / "found.npz") as kept:
        return MocoFound(
            time=np.array(kept["time"]),
            muscles=tuple(facts["muscles"]),
            activations=np.array(kept["activations"]),
            forces=np.array(kept["forces"]),
            model=place / "model.osim",
            seconds=facts["seconds"],
            iterations=facts["iterations"],
            success=facts["success"],
        )

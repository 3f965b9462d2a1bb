"""Joint reactions against OpenSim's analysis, Pinocchio and a published study.

They are computed from the same tensions and from ours.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import myomorph as mm
from benchmarks.accuracy.tension.tension import ENTRY, FEET, LOADS
from benchmarks.errors import rms
from benchmarks.opensim_static import write_actuators
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.actuators import read_actuators
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Actuator
from myomorph.core.rigid.dynamics import joint_wrenches, motion_arrays
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.reaction import JointReactions
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.emg import EmgTarget
from trees import random_tree, to_pinocchio

Row = dict[str, object]

STUDY = "walk-so-jointload-emg"
MODEL = f"{STUDY}/Rajagopal_scaled_Sub1_gasAvoid.osim"
REACTIONS = f"{STUDY}/results_SO/results_JointReaction_JointRxn_ReactionLoads.sto"
PENDULUMS = (
    ("SinglePin", ""),
    ("SinglePin", "_FrameKeyword"),
    ("DoublePendulum3D", ""),
    ("DoublePendulum3D", "_FrameKeyword"),
)
JOINTS = (
    "hip_l",
    "walker_knee_l",
    "patellofemoral_l",
    "ankle_l",
    "hip_r",
    "walker_knee_r",
    "patellofemoral_r",
    "ankle_r",
)
OWN = ("lumbar_ext", "lumbar_bend", "lumbar_rot")
SETUP = """<?xml version="1.0"?><OpenSimDocument Version="40000"><AnalyzeTool name="so">\
<model_file>{model}</model_file>
<replace_force_set>false</replace_force_set><force_set_files>{actuators}</force_set_files>
<results_directory>{results}</results_directory><initial_time>{start}</initial_time><final_time>{stop}</final_time>
<solve_for_equilibrium_for_auxiliary_states>false</solve_for_equilibrium_for_auxiliary_states>
<AnalysisSet name="Analyses"><objects><JointReaction name="JR"><on>true</on>\
<step_interval>{step}</step_interval>
<forces_file>forces.sto</forces_file><joint_names>ALL</joint_names><apply_on_bodies>child</apply_on_bodies>
<express_in_frame>child</express_in_frame></JointReaction></objects></AnalysisSet>
<external_loads_file>{loads}</external_loads_file><{motion_kind}_file>{motion}</{motion_kind}_file></AnalyzeTool>
</OpenSimDocument>"""


def apart(found: mm.Table, wanted: mm.Table) -> tuple[float, float, float]:
    """Largest wanted force, largest difference of a force [N] and of a moment [N m]."""
    columns = [wanted.names.index(name) for name in found.names]
    frames = min(len(found), len(wanted))
    reference = wanted.values[:frames, columns]
    difference = np.abs(found.values[:frames] - reference)
    force = np.array([name[-2] == "f" for name in found.names])
    moment = np.array([name[-2] == "m" for name in found.names])
    return (
        float(np.abs(reference[:, force]).max()),
        float(difference[:, force].max()),
        float(difference[:, moment].max()),
    )


def measure_same(folder: Path) -> Iterator[Row]:
    """Compare loads of the same tensions and motion."""
    yield from _pendulums(folder)
    yield _in_opensim("walk, 80 muscles, the study's tensions", partial(write_study, folder))
    yield _in_opensim("walk, 18 muscles, spring, random tensions", partial(write_spring, folder))
    yield _trees()


def _row(
    case: str, against: str, frames: int, joints: int, found: mm.Table, wanted: mm.Table
) -> Row:
    size, force, moment = apart(found, wanted)
    return {
        "case": case,
        "against": against,
        "frames": frames,
        "joints": joints,
        "largest force [N]": size,
        "difference of forces, maximum [N]": force,
        "difference of moments, maximum [N m]": moment,
    }


def _pendulums(folder: Path) -> Iterator[Row]:
    from myomorph.exchange.opensim.run import run_tool

    for model, setup in PENDULUMS:
        here = folder / "opensim-reference-small"
        with tempfile.TemporaryDirectory() as work:
            for source in here.glob(f"{model}*"):
                (Path(work) / source.name).write_bytes(source.read_bytes())
            result = run_tool(Path(work) / f"{model}_Setup_JointReaction{setup}.xml")
            found = mm.read_sto(result.written[0])
        wanted = mm.read_sto(here / f"std_{model}_JointReaction_ReactionLoads{setup}.sto")
        yield _row(
            f"{model}{setup}",
            "table that comes with OpenSim",
            len(found),
            len(found.names) // 9,
            found,
            wanted,
        )


def write_study(folder: Path, work: Path) -> tuple[Path, Path]:
    """Two setups on the study's states and forces, one that writes to `ours`, one to `theirs`."""
    forces = mm.read_sto(folder / STUDY / "results_SO/results_forces.sto")
    # OpenSim reads as many columns as the model has actuators: none of other things may stand
    # before them.
    keep = [
        k for k, name in enumerate(forces.names) if not name.startswith(("calcn", "patellofemoral"))
    ]
    names = tuple(forces.names[k] for k in keep)
    values = np.hstack([forces.values[:, keep], np.zeros((len(forces), len(OWN)))])
    mm.write_sto(replace(forces, names=(*names, *OWN), values=values), work / "forces.sto")
    write_actuators(study_reserves(names), work / "actuators.xml")
    write_loads(folder, work, torques=False)
    states = folder / STUDY / "results_SO/results_states.sto"
    about = {
        "actuators": "actuators.xml",
        "loads": "loads.xml",
        "start": 10.9,
        "stop": 11.7,
        "step": 1,
    }
    return _setups(work, model=folder / MODEL, motion_kind="states", motion=states, **about)


def write_spring(folder: Path, work: Path) -> tuple[Path, Path]:
    """Write the same for a walk of 18 muscles with an ankle's spring and residual actuators.

    All have random forces.
    """
    here = folder / "opensim-gait-subject01/ref_so_10dof18musc"
    model_path = here / "subject01_adjusted_spring.osim"
    actuators = here / "gait10dof_Actuators_weak.xml"
    model = read_osim(model_path)
    helpers = tuple(one.name for one in (*model.actuators, *read_actuators(actuators, model)))
    rng = np.random.default_rng(0)
    clock = np.linspace(0.5, 1.3, 9)
    pulls = np.abs(rng.normal(scale=200.0, size=(9, len(model.muscles))))
    pushes = rng.normal(scale=10.0, size=(9, len(helpers)))
    mm.write_sto(
        mm.Table(clock, (*model.muscle_names, *helpers), np.hstack([pulls, pushes])),
        work / "forces.sto",
    )
    motion = here / "walk_subject01_Kinematics_q.sto"
    about = {"actuators": actuators, "loads": "", "start": 0.5, "stop": 1.3, "step": 10}
    return _setups(work, model=model_path, motion_kind="coordinates", motion=motion, **about)


def _setups(work: Path, **values: object) -> tuple[Path, Path]:
    setups = work / "ours.xml", work / "theirs.xml"
    for path in setups:
        path.write_text(SETUP.format(results=path.stem, **values))
    return setups


def study_reserves(names: tuple[str, ...]) -> list[Actuator]:
    """Return the study's reserves, which act on coordinates, the pelvis's too."""
    ending = "_reserve"
    return [
        Actuator(one, "coordinate", 1.0, coordinate=one.removesuffix(ending))
        for one in names
        if one.endswith(ending)
    ]


def write_loads(folder: Path, work: Path, torques: bool) -> Path:
    """Write the plates' forces as external loads, with or without their free torques."""
    entries = (
        ENTRY.format(body=b, force=f, point=p, torque=t if torques else "") for b, f, p, t in FEET
    )
    path = work / "loads.xml"
    path.write_text(
        LOADS.format(entries="".join(entries), data=folder / STUDY / "walking_baseline1_forces.mot")
    )
    return path


def _in_opensim(case: str, write: Callable[[Path], tuple[Path, Path]]) -> Row:
    import opensim

    from myomorph.exchange.opensim.run import run_tool

    opensim.Logger.setLevelString("Off")
    with tempfile.TemporaryDirectory() as work:
        ours, theirs = write(Path(work))
        tool = opensim.AnalyzeTool(str(theirs))
        tool.run()
        run_tool(ours)
        found = mm.read_sto(Path(work) / "ours" / "so_JR_ReactionLoads.sto")
        wanted = mm.read_sto(Path(work) / "theirs" / "so_JR_ReactionLoads.sto")
    return _row(case, "OpenSim 4.6", len(found), len(found.names) // 9, found, wanted)


class _TreeForces(NamedTuple):
    """Joint forces on a random tree: the largest [N], and differences of forces and moments."""

    largest: float
    force: float
    moment: float


def _trees() -> Row:
    """Pinocchio's joint forces on a random tree with forces on all bodies."""
    found = [_tree_forces(seed) for seed in range(6)]
    return {
        "case": "6 random trees of 12 bodies",
        "against": "Pinocchio",
        "frames": 6,
        "joints": 12,
        "largest force [N]": max(one.largest for one in found),
        "difference of forces, maximum [N]": max(one.force for one in found),
        "difference of moments, maximum [N m]": max(one.moment for one in found),
    }


def _tree_forces(seed: int) -> _TreeForces:
    model = random_tree(seed)
    rng = np.random.default_rng(seed)
    motion = mm.Motion(
        np.zeros(1), model.coordinate_names, *rng.normal(size=(3, 1, len(model.coordinates)))
    )
    tree = compile_tree(model)
    applied = rng.normal(scale=20.0, size=(1, len(tree.arrays.parent), 6))
    found = joint_wrenches(tree, *motion_arrays(tree, motion), applied)
    theirs = _pinocchio_wrenches(model, motion, applied[0])
    bodies = [tree.body_index[body.name] for body in model.bodies]
    forces = np.array([one.linear for one in theirs])
    moments = np.array([one.angular for one in theirs])
    return _TreeForces(
        largest=float(np.abs(forces).max()),
        force=float(np.abs(found.forces[0, bodies] - forces).max()),
        moment=float(np.abs(found.moments[0, bodies] - moments).max()),
    )


def _pinocchio_wrenches(model: mm.Model, motion: mm.Motion, applied: Array) -> list[pin.Force]:
    """Return the wrench that each body's joint carries, in ground.

    `applied`: (bodies of the tree, 6) forces and moments about the ground's origin.
    """
    tree = compile_tree(model)
    theirs, ids = to_pinocchio(model)
    data = theirs.createData()
    pin.forwardKinematics(theirs, data, motion.values[0])
    external = pin.StdVec_Force()
    for _ in range(theirs.njoints):
        external.append(pin.Force.Zero())
    for body in model.bodies:
        wrench = applied[tree.body_index[body.name]]
        external[ids[body.name]] = data.oMi[ids[body.name]].actInv(
            pin.Force(wrench[:3], wrench[3:])
        )
    pin.rnea(
        theirs, data, motion.values[0], motion.velocities[0], motion.accelerations[0], external
    )
    joints = [ids[body.name] for body in model.bodies]
    return [data.oMi[joint].act(data.f[joint]) for joint in joints]


@dataclass(frozen=True)
class Line:
    """One way to get tensions for the study's motion."""

    name: str
    options: mm.TensionOptions
    emg: bool


LINES = (
    Line("ours, no EMG", mm.TensionOptions(), False),
    Line("ours, no EMG, with passive force", mm.TensionOptions(passive=True), False),
    Line("ours, EMG of 7 muscles as soft target", mm.TensionOptions(), True),
)


def study_motion(folder: Path, model: mm.Model) -> mm.Motion:
    """Return the study's frames, its coordinates filtered at 6 Hz by us."""
    whole = mm.differentiate(mm.read_motion(folder / STUDY / "results_ik.sto", model), 6.0)
    wanted = mm.read_sto(folder / REACTIONS).time
    at = np.abs(whole.time[:, None] - wanted).argmin(axis=0)
    assert whole.velocities is not None
    assert whole.accelerations is not None
    return mm.Motion(
        wanted, whole.names, whole.values[at], whole.velocities[at], whole.accelerations[at]
    )


def study_emg(folder: Path, time: Array) -> EmgTarget:
    """Return the study's envelopes as activations; what its filter made negative is 0.

    Parameters
    ----------
    folder : of the collection
    time : (frames,) [s]

    Returns
    -------
    Target at these times
    """
    table = mm.read_sto(folder / STUDY / "EMG_allMuscles.sto")
    values = np.column_stack([np.interp(time, table.time, column) for column in table.values.T])
    return EmgTarget(
        tuple(name.removesuffix("_activation") for name in table.names), np.clip(values, 0.0, 1.0)
    )


def run_line(folder: Path, line: Line) -> tuple[Tension, JointReactions]:
    """Tensions of a line and the loads of joints they make, on children in their axes."""
    model = mm.read_model(folder / MODEL)
    motion = study_motion(folder, model)
    with tempfile.TemporaryDirectory() as work:
        wrenches: mm.Wrenches = mm.resample_wrenches(
            read_external_loads(write_loads(folder, Path(work), torques=False)), motion.time
        )
    torques = mm.inverse_dynamics(model, motion, wrenches)
    emg = study_emg(folder, motion.time) if line.emg else None
    tension = mm.solve_tension(model, motion, torques, line.options, emg=emg)
    return tension, mm.joint_reactions(model, motion, tension, wrenches, JOINTS)


def measure_tensions(folder: Path) -> Iterator[Row]:
    """Tensions and activations of every line beside the study's, and beside EMG."""
    forces = mm.read_sto(folder / STUDY / "results_SO/results_forces.sto")
    states = mm.read_sto(folder / STUDY / "results_SO/results_states.sto")
    emg = study_emg(folder, forces.time)
    theirs = np.column_stack([states[f"/forceset/{name}/activation"] for name in emg.muscles])
    yield {
        "tensions": "the study's",
        "frames": len(forces),
        "activations and EMG, mean correlation": mean_correlation(theirs, emg.activations),
        "activations and EMG, RMS": rms(theirs - emg.activations),
        "tensions and the study's, correlation of all": "",
        "tensions and the study's, RMS [N]": "",
        "optimal": "",
    }
    for line in LINES:
        tension, _ = run_line(folder, line)
        reference = np.column_stack([forces[name] for name in tension.muscles])
        ours = tension.activation[:, [tension.muscles.index(name) for name in emg.muscles]]
        yield {
            "tensions": line.name,
            "frames": len(tension),
            "activations and EMG, mean correlation": mean_correlation(ours, emg.activations),
            "activations and EMG, RMS": rms(ours - emg.activations),
            "tensions and the study's, correlation of all": float(
                np.corrcoef(tension.muscle_force.ravel(), reference.ravel())[0, 1]
            ),
            "tensions and the study's, RMS [N]": rms(tension.muscle_force - reference),
            "optimal": float(tension.optimal.mean()),
        }


def measure_loads(folder: Path) -> Iterator[Row]:
    """Compare loads of joints of every line with the study's.

    They are sizes of forces in body weights.
    """
    model = read_osim(folder / MODEL)
    weight = model.mass * float(np.linalg.norm(model.gravity))
    table = mm.read_sto(folder / REACTIONS)
    found = {line.name: run_line(folder, line)[1] for line in LINES}
    for joint in JOINTS:
        roots = [
            name
            for name in table.names
            if name.startswith(f"{joint}_on_") and name[-2:] in ("fx", "fy", "fz")
        ]
        theirs = np.column_stack([table[name] for name in roots]) / weight
        size = np.linalg.norm(theirs, axis=1)
        for name, one in found.items():
            ours = one.of(joint) / weight
            yield {
                "joint": joint,
                "tensions": name,
                "frames": len(one),
                "the study's peak [BW]": float(size.max()),
                "peak [BW]": float(np.linalg.norm(ours, axis=1).max()),
                "correlation of sizes": float(
                    np.corrcoef(np.linalg.norm(ours, axis=1), size)[0, 1]
                ),
                "RMS of components [BW]": rms(ours - theirs),
            }


def mean_correlation(one: Array, other: Array) -> float:
    """Return the mean over columns of the correlation over time.

    Parameters
    ----------
    one, other : (frames, columns)

    Returns
    -------
    -1 to 1
    """
    return float(np.mean([np.corrcoef(a, b)[0, 1] for a, b in zip(one.T, other.T, strict=True)]))

"""Forces on models that close loops against OpenSim 4.6.

Compared are moment arms, inverse dynamics and static optimization.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import opensim

import myomorph as mm
from benchmarks import opensim_tools
from benchmarks.accuracy.tension.passive import TRUNK
from benchmarks.opensim_static import (
    AnalyzeInputs,
    StaticOptions,
    static_optimization,
    write_actuators,
)
from myomorph.core.model.paths import MovingPathPoint, Muscle
from myomorph.core.muscles.coupled_arms import loop_couplings, loop_groups
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.bushings import angular_velocities
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.loops import close_loops, closed_motion, loop_torques
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.terms.actuators import default_reserves

FOLDER = "shoulder-thoracoscapular"
MODELS = ("model_cmc/TSM_subject_CMC_{}Weight.osim", "model_rmr/TSM_subject_{}Weight.osim")
TRIALS = ("ABD01", "FLX01", "SHRUG01")
BONEPIN = (
    "shoulder-bonepin/subject1_abdbonepin.osim",
    "shoulder-bonepin/std_subject1_abdbonepin_IK.mot",
)
SCAPULA = ("scapula_abduction", "scapula_elevation", "scapula_upward_rot")
CUTOFF = 3.0
POSES = 4
STEP = 1e-5


def _moved(model: mm.Model, path: Path) -> mm.Motion:
    recorded = mm.read_motion(path, model)
    return closed_motion(model, mm.differentiate(recorded, CUTOFF))[0]


@dataclass
class ArmCounts:
    """What comparing moment arms found, in metres.

    `same`: greatest difference where OpenSim's forces of the path fit its length; `moving`, `two`:
    greatest difference where they do not: a point that moves, two surfaces at once; `slope`:
    greatest difference of ours from the slope of length, over at most one surface that is no
    ellipsoid; `rough`: the same of the other paths, which OpenSim's rules do not make shortest.
    """

    pairs: int = 0
    same: float = 0.0
    moving: float = 0.0
    two: float = 0.0
    slope: float = 0.0
    rough: float = 0.0

    def put_difference(self, muscle: Muscle, wrapped: int, off: float) -> None:
        """Count the difference from OpenSim [m] of a path with some points on wrap objects."""
        if any(isinstance(point, MovingPathPoint) for point in muscle.path.points):
            self.moving = max(self.moving, off)
        elif wrapped > 2:
            self.two = max(self.two, off)
        else:
            self.same = max(self.same, off)

    def put_slope(self, surfaces: Sequence[str], off: float) -> None:
        """Count the difference from the slope of length [m] of a path over kinds of surfaces."""
        if len(surfaces) > 1 or "ellipsoid" in surfaces:
            self.rough = max(self.rough, off)
        else:
            self.slope = max(self.slope, off)


def measure_arms(folder: Path) -> Iterator[dict[str, object]]:
    """Compare moment arms of all muscles about all coordinates.

    The slope of length along the coupled motion is compared too.
    """
    if not (folder / FOLDER).exists():
        return
    opensim.Logger.setLevelString("Off")
    for name in (form.format(weight) for form in MODELS for weight in ("no", "2kg")):
        path = folder / FOLDER / name
        model = mm.read_model(path)
        tree = compile_tree(model)
        poses = []
        for trial in TRIALS:
            values = tree.coordinates_of(mm.read_motion(folder / FOLDER / f"ik/{trial}.mot", model))
            poses.append(values[np.linspace(20, len(values) - 20, POSES).astype(int)])
        found = _compare_arms(path, tree, close_loops(tree, np.vstack(poses)))
        yield {
            "model": Path(name).stem,
            "poses": POSES * len(TRIALS),
            "pairs": found.pairs,
            "difference [mm]": 1e3 * found.same,
            "over two surfaces [mm]": 1e3 * found.two,
            "points that move [mm]": 1e3 * found.moving,
            "ours from the slope of length [mm]": 1e3 * found.slope,
            "over ellipsoids or two surfaces [mm]": 1e3 * found.rough,
        }


def _compare_arms(path: Path, tree: Tree, c: np.ndarray) -> ArmCounts:
    model = tree.model
    motion = mm.Motion(np.arange(len(c)) * 1.0, model.coordinate_names, c)
    arms = mm.muscle_kinematics(model, motion, velocities=False).moment_arm
    slopes = _slopes(tree, c)
    kinds = {one.name: one.kind for one in model.wrap_objects}
    theirs = opensim.Model(str(path))
    state = theirs.initSystem()
    coordinates = [theirs.getCoordinateSet().get(name) for name in model.coordinate_names]
    found = ArmCounts()
    for frame in range(len(c)):
        for coordinate, value in zip(coordinates, c[frame], strict=True):
            coordinate.setValue(state, float(value), False)
        theirs.realizePosition(state)
        for i, muscle in enumerate(model.muscles):
            geometry = theirs.getMuscles().get(muscle.name).getGeometryPath()
            given = np.array([geometry.computeMomentArm(state, one) for one in coordinates])
            wrapped = _wrapped_points(geometry.getCurrentPath(state))
            found.pairs += len(coordinates)
            found.put_difference(muscle, wrapped, float(np.abs(given - arms[frame, i]).max()))
            surfaces = [kinds[wrap.wrap_object] for wrap in muscle.path.wraps]
            found.put_slope(surfaces, float(np.abs(arms[frame, i] + slopes[frame, i]).max()))
    return found


def _wrapped_points(path: opensim.AbstractPathPointArray) -> int:
    """Count the points of a path that lie on wrap objects."""
    return sum(path.get(k).getConcreteClassName() == "PathWrapPoint" for k in range(path.getSize()))


def _slopes(tree: Tree, c: np.ndarray) -> np.ndarray:
    """Return the slope of length along each coordinate's coupled motion, by differences.

    It has the shape (frames, muscles, coordinates).
    """
    n = c.shape[1]
    along = np.tile(np.eye(n), (len(c), 1, 1))
    for group in loop_groups(tree):
        couplings = loop_couplings(tree, group, c)
        along[:, group.coordinates] = 0.0
        for place, row in enumerate(group.leading):
            along[:, group.coordinates, group.coordinates[row]] = couplings[:, place]
    paths = compile_paths(tree.model)
    slopes = np.empty((len(c), len(tree.model.muscles), n))
    for j in range(n):
        ends = []
        for sign in (1.0, -1.0):
            moved = c + sign * STEP * along[:, j]
            couple_frames(tree.arrays, moved)
            ends.append(paths.evaluate(moved)[0])
        slopes[:, :, j] = (ends[0] - ends[1]) / (2.0 * STEP)
    return slopes


def measure_torques(folder: Path) -> Iterator[dict[str, object]]:
    """Inverse dynamics against OpenSim's solver with its own speeds, and against its tool."""
    cases = [(f"{FOLDER}/{MODELS[0].format('no')}", f"{FOLDER}/ik/{trial}.mot") for trial in TRIALS]
    cases += [
        (f"{FOLDER}/{MODELS[0].format('2kg')}", f"{FOLDER}/ik/{trial}.mot")
        for trial in ("ABD21", "FLX21")
    ]
    cases.append(BONEPIN)
    for model_path, motion_path in cases:
        if not (folder / model_path).exists():
            continue
        model = mm.read_model(folder / model_path)
        motion = _moved(model, folder / motion_path)
        torques = mm.inverse_dynamics(model, motion)
        folded = loop_torques(model, motion, torques)
        tool = _tool(folder / model_path, model, motion)
        false = loop_torques(model, motion, replace(torques, values=tool)).torques.values
        shoulder = [
            k
            for k, name in enumerate(folded.torques.names)
            if name in ("plane_elv", "shoulder_elv")
        ]
        yield {
            "motion": Path(motion_path).stem,
            "frames": len(motion),
            "dependent": ", ".join(folded.dependent),
            "OpenSim's solver, its speeds [N m]": _solver(
                folder / model_path, model, motion, torques.values
            ),
            "OpenSim's tool [N m]": float(np.abs(tool - torques.values).max()),
            "tool, at the elevation of the arm [N m]": float(
                np.abs(false - folded.torques.values)[:, shoulder].max()
            ),
            "greatest torque there [N m]": float(np.abs(folded.torques.values[:, shoulder]).max()),
        }


def _tool(path: Path, model: mm.Model, motion: mm.Motion) -> np.ndarray:
    """(frames, coordinates) of OpenSim's InverseDynamicsTool, springs of the model left out.

    The tool differentiates the filtered coordinates that it is given with the same splines as ours.
    """
    from myomorph.core.io.sto import table_from_motion, write_sto

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "q.mot"
        write_sto(
            table_from_motion(mm.Motion(motion.time, motion.names, motion.values), model), file
        )
        bare = Path(folder) / "bare.osim"
        theirs = opensim.Model(str(path))
        theirs.updForceSet().clearAndDestroy()
        theirs.printToXML(str(bare))
        found = opensim_tools.inverse_dynamics(
            bare, file, None, float(motion.time[0]), float(motion.time[-1])
        )
    names = [name.rsplit("_", 1)[0] for name in found.names]
    return found.values[:, [names.index(name) for name in model.coordinate_names]]


def _solver(path: Path, model: mm.Model, motion: mm.Motion, torques: np.ndarray) -> float:
    """Return the greatest difference from InverseDynamicsSolver [N m or N].

    Angular velocities of the scapula are known.
    """
    names = model.coordinate_names
    theirs = opensim.Model(str(path))
    theirs.updForceSet().clearAndDestroy()
    state = theirs.initSystem()
    named = theirs.getCoordinateSet()
    solver = opensim.InverseDynamicsSolver(theirs)
    rows = [names.index(name) for name in SCAPULA]
    moving = _scapular_speeds(model, motion, rows)
    worst = 0.0
    for name in names:
        named.get(name).setLocked(state, False)
    for frame in np.linspace(0, len(motion) - 1, 10).astype(int):
        for j, name in enumerate(names):
            named.get(name).setValue(state, float(moving.values[frame, j]), False)
            named.get(name).setSpeedValue(state, float(moving.speeds[frame, j]))
        theirs.realizeVelocity(state)
        udot = opensim.Vector.createFromMat(moving.accelerations[frame])
        found = solver.solve(state, udot).to_numpy().copy()
        found[rows] = moving.turns[frame].T @ found[rows]
        worst = max(worst, float(np.abs(found - torques[frame]).max()))
    return worst


@dataclass(frozen=True, kw_only=True, eq=False)
class _ScapularMotion:
    """A motion by OpenSim's speeds, those of the scapula its angular velocity.

    Attributes
    ----------
    values : (frames, coordinates) [rad or m]
    speeds : (frames, coordinates) [rad/s or m/s]
    accelerations : (frames, coordinates) [rad/s^2 or m/s^2]
    turns : (frames, 3, 3) angular velocity of the scapula per rate of its coordinates
    """

    values: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray
    turns: np.ndarray


def _scapular_speeds(model: mm.Model, motion: mm.Motion, rows: list[int]) -> _ScapularMotion:
    """Return a motion by OpenSim's speeds.

    Of the scapula, with the rates q' of its coordinates, u = N q' and u' = N q'' + N' q'. N' is a
    central difference along the motion.
    """
    assert motion.velocities is not None
    assert motion.accelerations is not None
    columns = [motion.names.index(name) for name in model.coordinate_names]
    c = motion.values[:, columns]
    rates = motion.velocities[:, columns]
    changes = motion.accelerations[:, columns]
    turns = angular_velocities(c[:, rows[0]], c[:, rows[1]])
    ahead = angular_velocities(*(c[:, rows[:2]] + STEP * rates[:, rows[:2]]).T)
    behind = angular_velocities(*(c[:, rows[:2]] - STEP * rates[:, rows[:2]]).T)
    turning = (ahead - behind) / (2.0 * STEP)
    speeds = rates.copy()
    accelerations = changes.copy()
    for frame in range(len(motion)):
        turn = turns[frame]
        speeds[frame, rows] = turn @ rates[frame, rows]
        accelerations[frame, rows] = (
            turn @ changes[frame, rows] + turning[frame] @ rates[frame, rows]
        )
    return _ScapularMotion(values=c, speeds=speeds, accelerations=accelerations, turns=turns)


def measure_static(folder: Path) -> Iterator[dict[str, object]]:
    """Compare static optimization of two poses of an abduction.

    OpenSim's constraint stands against our null space.
    """
    path = folder / FOLDER / MODELS[0].format("no")
    if not path.exists():
        return
    model = mm.read_model(path)
    recorded = folder / FOLDER / "ik/ABD01.mot"
    actuators = tuple(
        replace(one, optimal_force=TRUNK) if "ground" in one.name else one
        for one in default_reserves(model, 1.0, 10.0)
    )
    with tempfile.TemporaryDirectory() as scratch:
        reserves = Path(scratch) / "reserves.xml"
        write_actuators(actuators, reserves)
        inputs = AnalyzeInputs(model=path, motion=recorded, actuators=reserves, cutoff=CUTOFF)
        theirs = static_optimization(inputs, 2.55, 3.0, StaticOptions(interval=1000))
    motion = mm.differentiate(mm.read_motion(recorded, model), CUTOFF)
    frames = np.searchsorted(motion.time, theirs.time - 1e-6)
    some = replace(motion.frames(frames), time=theirs.time)
    ours = mm.solve_tension(
        model,
        some,
        mm.inverse_dynamics(model, some),
        mm.TensionOptions(min_activation="model", curves="opensim"),
        actuators,
    )
    columns = [theirs.names.index(name) for name in ours.muscles]
    controls = [theirs.names.index(name) for name in (*ours.muscles, *ours.reserve_names)]
    strength = np.array([one.optimal_force for one in actuators])
    for frame in range(len(some)):
        mine = float(
            (ours.activation[frame] ** 2).sum()
            + ((ours.actuator_force[frame] / strength) ** 2).sum()
        )
        yield {
            "time [s]": float(theirs.time[frame]),
            "effort": f"{mine:.5f}",
            "OpenSim's effort": f"{float((theirs.activations[frame, controls] ** 2).sum()):.5f}",
            "greatest difference of force [N]": float(
                np.abs(theirs.forces[frame, columns] - ours.muscle_force[frame]).max()
            ),
            "greatest force [N]": float(ours.muscle_force[frame].max()),
            "OpenSim's time a frame [s]": theirs.seconds / len(some),
        }

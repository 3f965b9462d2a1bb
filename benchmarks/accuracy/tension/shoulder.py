"""Force in the glenohumeral joint of an arm abduction.

Our settings are compared with OpenSim's static optimization.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.passive import TRUNK
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Actuator
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import closed_motion
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import default_reserves

MODEL = "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"
MOTION = "shoulder-thoracoscapular/ik/ABD01.mot"
JOINT = "GlenoHumeral"
CUTOFF = 3.0
ANGLES = (30.0, 60.0, 90.0, 120.0)
"""Between the humerus and the thorax, on the way up [deg]."""

ARM = 0.05
"""Mass of an arm over that of the body (Winter 2009): the model has no legs, and the man's weight
is not told.
"""

SETTINGS: Mapping[str, mm.TensionOptions] = {
    "default": mm.TensionOptions(),
    "elastic tendons": mm.TensionOptions(tendons="elastic"),
    "activations from the model's minimum": mm.TensionOptions(min_activation="model"),
    "min/max": mm.TensionOptions(recruitment="minmax"),
    "exponent 3": mm.TensionOptions(exponent=3.0),
    "with passive force": mm.TensionOptions(passive=True),
    "elastic tendons, no passive force": mm.TensionOptions(passive=False, tendons="elastic"),
    "with passive force, model's minimum (the default before)": mm.TensionOptions(
        passive=True, min_activation="model"
    ),
}


@dataclass(frozen=True, eq=False)
class Abduction:
    """The recording.

    `frames`: in which the arm passes `ANGLES`; `weight`: of the man, from his arm's mass [N].
    """

    model: mm.Model
    motion: mm.Motion
    actuators: tuple[Actuator, ...]
    frames: tuple[int, ...]
    weight: float


def abduction(folder: Path) -> Abduction:
    """Return the motion with its loop closed, and reserves of 1 N m.

    Those of the trunk, which has no muscles, are as large as it takes.
    """
    model = mm.read_model(folder / MODEL)
    motion, _ = closed_motion(
        model, mm.differentiate(mm.read_motion(folder / MOTION, model), CUTOFF)
    )
    actuators = tuple(
        replace(one, optimal_force=TRUNK) if "ground" in one.name else one
        for one in default_reserves(model, 1.0, 10.0)
    )
    tree = compile_tree(model)
    turned = forward_kinematics(tree, tree.coordinates_of(motion)).rotations
    up = turned[:, tree.body_index["thorax"], :, 1]
    along = turned[:, tree.body_index["humerus"], :, 1]
    angle = np.degrees(np.arccos(np.clip(np.einsum("fi,fi->f", up, along), -1.0, 1.0)))
    frames = tuple(
        int(np.flatnonzero((angle[:-1] < one) & (angle[1:] >= one))[0]) + 1 for one in ANGLES
    )
    arm = sum(model.body(name).mass for name in ("humerus", "ulna", "radius", "hand"))
    return Abduction(
        model=model,
        motion=motion,
        actuators=actuators,
        frames=frames,
        weight=arm / ARM * float(np.linalg.norm(model.gravity)),
    )


def measure_shoulder(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for OpenSim's static optimization and for every setting of ours."""
    if not (folder / MODEL).exists():
        return
    one = abduction(folder)
    torques = mm.inverse_dynamics(one.model, one.motion)
    ours = {
        name: mm.solve_tension(one.model, one.motion, torques, options, one.actuators)
        for name, options in SETTINGS.items()
    }
    some = one.motion.frames(list(one.frames))
    few = mm.solve_tension(
        one.model, some, mm.inverse_dynamics(one.model, some), None, one.actuators
    )
    theirs = replace(few, muscle_force=_of_opensim(folder, one, few))
    yield {
        "tensions": "OpenSim's static optimization",
        **_row(one, _force(one, some, theirs), theirs.muscle_force),
    }
    for name, tension in ours.items():
        frames = list(one.frames)
        force = _force(one, one.motion, tension)
        yield {"tensions": name, **_row(one, force[frames], tension.muscle_force[frames])}


def _row(one: Abduction, force: Array, forces: Array) -> dict[str, object]:
    row: dict[str, object] = {
        f"{angle:.0f} deg [N]": float(size) for angle, size in zip(ANGLES, force, strict=True)
    }
    at = ANGLES.index(90.0)
    return row | {
        "90 deg [BW]": float(force[at]) / one.weight,
        "all muscles, 90 deg [N]": float(forces[at].sum()),
    }


def _force(one: Abduction, motion: mm.Motion, tension: Tension) -> Array:
    """Size of the joint's force (frames,) [N]."""
    found = mm.joint_reactions(
        one.model, motion, tension, None, joints=(JOINT,), actuators=one.actuators
    )
    return np.linalg.norm(found.forces[:, 0], axis=1)


def _of_opensim(folder: Path, one: Abduction, few: Tension) -> Array:
    """(frames, muscles) tensions by AnalyzeTool at single instants, with the same reserves."""
    # OpenSim is wanted here alone.
    from benchmarks.opensim_static import (
        AnalyzeInputs,
        StaticOptions,
        static_optimization,
        write_actuators,
    )

    found = []
    with tempfile.TemporaryDirectory() as scratch:
        reserves = Path(scratch) / "reserves.xml"
        write_actuators(one.actuators, reserves)
        inputs = AnalyzeInputs(
            model=folder / MODEL, motion=folder / MOTION, actuators=reserves, cutoff=CUTOFF
        )
        options = StaticOptions(interval=1000)
        for time in few.time:
            result = static_optimization(inputs, time, time + 0.005, options)
            found.append(result.forces[0, [result.names.index(name) for name in few.muscles]])
    return np.array(found)

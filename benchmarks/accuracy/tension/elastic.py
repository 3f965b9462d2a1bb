"""Elastic tendons against MocoInverse and fiber dynamics.

Measured is also how solutions change with the frame rate.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.interpolate import CubicSpline

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.accuracy.tension.tension import CASES, TensionCase, prepare
from benchmarks.errors import rms
from benchmarks.opensim_forward import PathMotion, SliderMuscles, forward_forces
from benchmarks.opensim_moco import RESERVE, RESIDUAL, MocoFound, moco_inverse
from benchmarks.recordings import read_torques
from benchmarks.speed.elastic import stride, tiled, with_degroote
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Actuator
from myomorph.core.tension.tension import Tension

RATE = 100.0
"""Frames a second that are solved."""

FINER = 4
"""Steps of the fine collocation in one step."""

FINE_CASES = (
    "arm26, 6 Millard2012EquilibriumMuscle",
    "walk, Rajagopal, 80 muscles",
    "walk, OpenCap, 80 muscles",
)
FINE_SECONDS = 0.5
"""How much of each recording is solved with fine steps too."""

WALK = "rajagopal-walk-emg"
SPAN = (0.6, 1.4)
"""Of the walk that MocoInverse solves [s]: both plates are trusted there."""

ARM_CLASSES = ("Thelen2003Muscle", "Millard2012EquilibriumMuscle")
OURS = mm.TensionOptions(tendons="elastic", min_activation="model")
"""With passive force of fibers, which OpenSim's fiber dynamics always have."""

ALIKE = mm.TensionOptions(
    tendons="elastic",
    min_activation="model",
    passive=False,
    activation_dynamics=False,
    reserve=RESERVE,
    residual=RESIDUAL,
)
"""As MocoInverse is set up: no passive force, activations as controls."""


FINE_OPTIONS = mm.TensionOptions(tendons="elastic")


def thinned(motion: mm.Motion, start: float, end: float) -> mm.Motion:
    """Frames from `start` to `end` [s] at `RATE`, or every frame of a slower recording."""
    step = max(1, round(1.0 / (RATE * float(np.median(np.diff(motion.time))))))
    keep = np.flatnonzero((motion.time >= start - 1e-9) & (motion.time <= end + 1e-9))[::step]
    return motion.frames(keep)


def forward_rows(folder: Path) -> Iterator[dict[str, object]]:
    """Put solved activations into OpenSim's fiber dynamics.

    The rows have how far its tendon forces are from the solved ones.
    """
    arm = next(one for one in CASES if one.kind == "Thelen2003Muscle")
    for kind in ARM_CLASSES:
        yield _forward_row(folder, replace(arm, name=f"arm26, 6 {kind}", kind=kind))
    for case in CASES:
        if case.name in ("walk, Rajagopal, 80 muscles", "treadmill walk, gait2392, 92 muscles"):
            yield _forward_row(folder, case)


def _forward_row(folder: Path, case: TensionCase) -> dict[str, object]:
    with tempfile.TemporaryDirectory() as work:
        prepared = prepare(folder, case, Path(work))
        motion = thinned(
            mm.differentiate(prepared.motion, case.cutoff or 6.0), case.start, case.end
        )
        torques = read_torques(prepared.loads, prepared.model, motion)
        found = mm.solve_tension(prepared.model, motion, torques, OURS, prepared.actuators)
        return {
            "case": case.name,
            **forward_distances(prepared.model, prepared.model_path, motion, found),
        }


def fine_rows(folder: Path) -> Iterator[dict[str, object]]:
    """Compare solutions at 100 frames a second with those of steps four times finer.

    They are of the same curves of motion.
    """
    for name in FINE_CASES:
        case = next(one for one in CASES if one.name == name)
        with tempfile.TemporaryDirectory() as work:
            prepared = prepare(folder, case, Path(work))
            whole = mm.differentiate(prepared.motion, case.cutoff or 6.0)
            fine = _resampled(
                whole, case.start, min(case.end, case.start + FINE_SECONDS), FINER * RATE
            )
            torques = read_torques(prepared.loads, prepared.model, fine)
            yield {
                "case": name,
                **fine_distances(prepared.model, fine, torques, prepared.actuators),
            }


def fine_distances(
    model: mm.Model, motion: mm.Motion, torques: mm.Series, actuators: Sequence[Actuator] | None
) -> dict[str, object]:
    """Return distances between solutions for all frames of a motion and for one in `FINER` of them.

    The ends are left out.
    """
    assert motion.velocities is not None
    assert motion.accelerations is not None
    each = slice(None, None, FINER)
    rates = (motion.velocities[each], motion.accelerations[each])
    coarse = mm.Motion(motion.time[each], motion.names, motion.values[each], *rates)
    given = mm.Series(torques.time[each], torques.names, torques.values[each])
    one = mm.solve_tension(model, coarse, given, FINE_OPTIONS, actuators)
    # Every frame of the finer steps is solved, which Myomorph else does not with so many.
    with mock.patch("myomorph.core.tension.elastic.windows.solved_every", return_value=1):
        other = mm.solve_tension(model, motion, torques, FINE_OPTIONS, actuators)
    assert one.fibers is not None
    assert other.fibers is not None
    inside = ~one.fibers.transient
    strength = np.array([muscle.max_isometric_force for muscle in model.muscles])
    a = (one.activation - other.activation[each])[inside]
    f = ((one.muscle_force - other.muscle_force[each]) / strength)[inside]
    return {
        "muscles": len(one.muscles),
        "frames": f"{len(coarse)}, {len(motion)}",
        "optimal": float(one.optimal.mean()),
        "optimal, fine": float(other.optimal.mean()),
        "RMS of activations": rms(a),
        "RMS of tendon forces / F0": rms(f),
        "worst muscle": one.muscles[int(np.argmax(np.mean(a**2, axis=0)))],
        "iterations": f"{one.fibers.certificate.steps}, {other.fibers.certificate.steps}",
    }


def _resampled(motion: mm.Motion, start: float, end: float, rate: float) -> mm.Motion:
    """Return the motion at a rate [1/s], on the cubics through its frames."""
    curve = CubicSpline(motion.time, motion.values)
    at = start + np.arange(int((end - start) * rate) // FINER * FINER + 1) / rate
    return mm.Motion(at, motion.names, curve(at), curve(at, 1), curve(at, 2))


def forward_distances(
    model: mm.Model, model_path: Path, motion: mm.Motion, found: Tension
) -> dict[str, object]:
    """Return distances of tendon forces.

    They are relative to the maximum isometric forces, and to the forces themselves.
    """
    fibers = found.fibers
    assert fibers is not None
    columns = [m for m, name in enumerate(found.muscles) if name not in fibers.rigid]
    names = tuple(found.muscles[m] for m in columns)
    strength = np.array([model.muscle(name).max_isometric_force for name in names])
    paths = mm.muscle_kinematics(model, motion)
    sliders = SliderMuscles(model_path, names)
    ours = found.muscle_force[:, columns]
    start = np.where(sliders.forces_state, ours[0] / strength, fibers.fiber_length[0, columns])
    moving = PathMotion(
        time=motion.time,
        lengths=paths.muscle_length[:, columns],
        speeds=paths.muscle_velocity[:, columns],
    )
    middle = between_frames(found.activation[:, columns])
    theirs = forward_forces(sliders, moving, middle, start)
    inside = ~fibers.transient
    off = (theirs - ours)[inside]
    worst = int(np.argmax(np.sqrt(np.mean((off / strength) ** 2, axis=0))))
    return {
        "muscles": len(names),
        "frames": len(motion),
        "optimal": float(found.optimal.mean()),
        "RMS / F0": rms(off / strength),
        "RMS / RMS of forces": rms(off) / rms(ours[inside]),
        "worst muscle": names[worst],
        "worst muscle's RMS / F0": rms(off[:, worst] / strength[worst]),
    }


def between_frames(activations: Array) -> Array:
    """Return activations between frames, of which those at the frames are the means.

    What elastic tendons are solved for lies between frames; the first and the last frame have the
    nearest.

    Parameters
    ----------
    activations : (frames, muscles)

    Returns
    -------
    (frames - 1, muscles)
    """
    middle = np.empty_like(activations[1:])
    middle[0] = activations[0]
    for k in range(1, len(middle)):
        middle[k] = 2.0 * activations[k] - middle[k - 1]
    assert np.abs(middle[-1] - activations[-1]).max() < 1e-6
    return middle


def moco_rows(folder: Path) -> Iterator[dict[str, object]]:
    """Compare with MocoInverse on the same muscles, motion and loads, with fitted paths."""
    recording = folder / WALK
    yield compare_moco(recording, moco_inverse(recording, *SPAN))


def compare_moco(
    recording: Path, theirs: MocoFound, options: mm.TensionOptions = ALIKE
) -> dict[str, object]:
    """Distances at MocoInverse's times away from the ends, and seconds of both."""
    model = mm.read_model(theirs.model)
    whole = mm.differentiate(mm.read_motion(recording / "coordinates.sto", model), 6.0)
    motion = thinned(whole, float(theirs.time[0]), float(theirs.time[-1]))
    torques = read_torques(recording / "grf_walk.xml", model, motion)
    # The model has its reserves already.
    mm.solve_tension(model, motion, torques, options, ())
    began = time.perf_counter()
    found = mm.solve_tension(model, motion, torques, options, ())
    seconds = time.perf_counter() - began
    fibers = found.fibers
    assert fibers is not None
    elastic = [name for name in found.muscles if name not in fibers.rigid]
    columns = [found.muscles.index(name) for name in elastic]
    other = [theirs.muscles.index(name) for name in elastic]
    strength = np.array([model.muscle(name).max_isometric_force for name in elastic])
    at = motion.time[~fibers.transient]

    def on_ours(values: Array) -> Array:
        return np.column_stack([np.interp(at, theirs.time, values[:, k]) for k in other])

    a = found.activation[np.ix_(~fibers.transient, columns)] - on_ours(theirs.activations)
    f = found.muscle_force[np.ix_(~fibers.transient, columns)] / strength - on_ours(theirs.forces)
    return {
        "muscles": len(elastic),
        "frames": len(motion),
        "optimal": float(found.optimal.mean()),
        "RMS of activations": rms(a),
        "RMS of tendon forces / F0": rms(f),
        "worst muscle": elastic[int(np.argmax(np.mean(a**2, axis=0)))],
        "ours [s]": seconds,
        "MocoInverse converged": "yes" if theirs.success else "no",
        "MocoInverse [s]": theirs.seconds,
        "times as fast": theirs.seconds / seconds,
    }


DEFAULT = mm.TensionOptions(tendons="elastic")
FROM_MINIMUM = mm.TensionOptions(tendons="elastic", min_activation="model")
LONG = 9.0
LONGEST = 60.0
"""Lengths of walks that are their stride again and again, with the model's curves and De Groote's
[s].
"""
SLOW = 200.0
FAST = 1000.0
SHORT = 0.5
"""Rates of one motion [Hz], and how much of it is solved [s]."""
APART = (f"activations from {SLOW:g} Hz, RMS", f"forces from {SLOW:g} Hz, RMS / F0")
RUN_CUTOFF = 15.0
RUN_SECONDS = (0.3, 1.3)
"""Filter of the run [Hz], and the part of it that is solved [s]."""


def convergence_rows(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each recording.

    It has frames, how many are optimal, most iterations, and the residual of optimality conditions.
    """
    model, motion, torques = stride()
    yield _row("walk, Rajagopal, 80 muscles", mm.solve_tension(model, motion, torques, DEFAULT))
    long = tiled(motion, torques, LONG)
    yield _row(
        f"the same stride again and again, {LONG:g} s", mm.solve_tension(model, *long, DEFAULT)
    )
    longest = tiled(motion, torques, LONGEST)
    yield _row(
        f"the same, {LONGEST:g} s, De Groote's curves",
        mm.solve_tension(with_degroote(model), *longest, DEFAULT),
    )
    slow = mm.solve_tension(model, *resampled(motion, torques, SLOW), DEFAULT)
    fast = mm.solve_tension(model, *resampled(motion, torques, FAST), DEFAULT)
    yield _row(f"walk at {SLOW:g} Hz", slow)
    yield _row(f"walk at {FAST:g} Hz", fast) | apart(model, slow, fast)
    case = next(one for one in CASES if "gait2392" in one.name)
    with tempfile.TemporaryDirectory() as work:
        found = prepare(folder, case, Path(work))
        motion = mm.differentiate(found.motion, case.cutoff or 6.0)
        keep = np.flatnonzero((motion.time >= case.start - 1e-9) & (motion.time <= case.end + 1e-9))
        motion = motion.frames(keep)
        loads = None if found.loads is None else mm.read_loads(found.loads, found.model, motion)
        torques = _torques(found.model, motion, loads)
        tension = mm.solve_tension(found.model, motion, torques, FROM_MINIMUM, found.actuators)
    yield _row(f"{case.name}, activations from the model's minimum", tension)
    yield _row("run at 2 m/s, unscaled generic model, 92 muscles", _run(folder))


def resampled(motion: mm.Motion, torques: mm.Series, rate: float) -> tuple[mm.Motion, mm.Series]:
    """Return the beginning of a motion and its torques at another rate, by splines."""
    time = np.arange(motion.time[20], motion.time[20] + SHORT, 1.0 / rate)
    curve = CubicSpline(motion.time, motion.values)
    values = (curve(time), curve(time, 1), curve(time, 2))
    return mm.Motion(time, motion.names, *values), mm.Series(
        time, torques.names, CubicSpline(torques.time, torques.values)(time)
    )


def apart(model: mm.Model, slow: Tension, fast: Tension) -> dict[str, object]:
    """Root mean square differences at the times that both have."""
    every = round(FAST / SLOW)
    count = min(len(slow), len(fast.activation[::every]))
    strength = np.array([one.max_isometric_force for one in model.muscles])
    difference = slow.activation[:count] - fast.activation[::every][:count]
    forces = (slow.muscle_force[:count] - fast.muscle_force[::every][:count]) / strength
    return dict(
        zip(APART, (float(np.sqrt(np.mean(one**2))) for one in (difference, forces)), strict=True)
    )


def _run(folder: Path) -> Tension:
    home = folder / "hamner-run-subject04"
    model = mm.read_model(home / "unscaled_generic.osim")
    markers = mm.read_recording(home / "run200" / "markers.trc").markers
    assert markers is not None
    whole = mm.differentiate(mm.inverse_kinematics(model, markers).motion, cutoff=RUN_CUTOFF)
    first, last = RUN_SECONDS
    first = whole.time[0] + first
    last = whole.time[0] + last
    motion = whole.frames(np.flatnonzero((whole.time >= first) & (whole.time <= last)))
    feet = {"R_ground_force_": "calcn_r", "L_ground_force_": "calcn_l"}
    loads = mm.read_loads(home / "run200" / "grf.mot", model, motion, feet)
    return mm.solve_tension(model, motion, _torques(model, motion, loads), DEFAULT)


def _torques(model: mm.Model, motion: mm.Motion, loads: mm.Wrenches | None) -> mm.Series:
    return mm.inverse_dynamics(
        model, motion, None if loads is None else mm.resample_wrenches(loads, motion.time)
    )


def _row(name: str, found: Tension) -> dict[str, object]:
    assert found.fibers is not None
    certificate = found.fibers.certificate
    return {
        "recording": name,
        "frames": len(found),
        "optimal": int(found.optimal.sum()),
        "maximum iterations": certificate.steps,
        "KKT residual": certificate.residual,
        **dict.fromkeys(APART, ""),
    }


ULTRASOUND = "gastrocnemius-ultrasound-walk"
FASCICLES = "med_gas_l"
"""Strides of one walker: a model, and of each stride coordinates, torques, and the muscle's
fascicles [mm].
"""


def fascicle_rows(folder: Path) -> Iterator[dict[str, object]]:
    """Compare fibers by our commands with fascicles by ultrasound, which they do not get.

    There are no rows without the recording.
    """
    home = folder / ULTRASOUND
    for path in sorted(home.glob("*_US.mot")):
        measured = mm.read_sto(path)
        stem = path.stem.removesuffix("_US")
        words = ("--model", home / "model.osim", "--motion", path.with_stem(f"{stem}_IK"))
        with tempfile.TemporaryDirectory() as name:
            elastic = Path(name) / "elastic"
            rigid = Path(name) / "rigid"
            loads = ("--torques", path.with_stem(f"{stem}_ID"), "--tendons", "elastic")
            command("tension", *words, *loads, "--out", elastic)
            command("muscles", *words, "--out", rigid)
            fibers = mm.read_sto(elastic / "fiber_lengths.sto")
            lengths = mm.read_sto(rigid / "lengths.sto")
        muscle = mm.read_model(home / "model.osim").muscle(FASCICLES)
        across = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
        on_slack = np.hypot(lengths[FASCICLES] - muscle.tendon_slack_length, across)
        both = {"elastic": (fibers.time, fibers[FASCICLES]), "rigid": (lengths.time, on_slack)}
        for tendons, found in both.items():
            ours = 1e3 * np.interp(measured.time, *found)
            truth = measured[FASCICLES]
            yield {
                "stride": stem,
                "tendons": tendons,
                "mean, ultrasound [mm]": float(truth.mean()),
                "ours [mm]": float(ours.mean()),
                "range, ultrasound [mm]": float(np.ptp(truth)),
                "range, ours [mm]": float(np.ptp(ours)),
                "RMS [mm]": rms(ours - truth),
                "RMS about the means [mm]": float(np.std(ours - truth)),
                "r": float(np.corrcoef(ours, truth)[0, 1]),
            }

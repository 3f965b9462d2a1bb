"""Whether tensions on elastic tendons converge: long and fast recordings, passive force, many frames a second."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

import myomorph as mm
from benchmarks.accuracy.tension import CASES, prepare
from benchmarks.speed.elastic import stride, tiled, with_degroote
from myomorph.motion.sync import take_frames
from myomorph.tension.tension import Tension

DEFAULT = mm.TensionOptions(tendons="elastic")
PASSIVE = mm.TensionOptions(tendons="elastic", min_activation="model", passive=True)
LONG, LONGEST = 9.0, 60.0
"""Lengths of walks that are their stride again and again, with the model's curves and De Groote's [s]."""
SLOW, FAST, SHORT = 200.0, 1000.0, 0.5
"""Rates of one motion [Hz], and how much of it is solved [s]."""
APART = (f"activations from {SLOW:g} Hz, RMS", f"forces from {SLOW:g} Hz, RMS / F0")
RUN_CUTOFF, RUN_SECONDS = 15.0, (0.3, 1.3)
"""Filter of the run [Hz], and the part of it that is solved [s]."""


def convergence_rows(folder: Path) -> Iterator[dict[str, object]]:
    """A row a recording: frames, how many are optimal, most iterations, and the residual of optimality conditions."""
    model, motion, torques = stride()
    yield _row("walk, Rajagopal, 80 muscles", mm.solve_tension(model, motion, torques, DEFAULT))
    long = tiled(motion, torques, LONG)
    yield _row(f"the same stride again and again, {LONG:g} s", mm.solve_tension(model, *long, DEFAULT))
    longest = tiled(motion, torques, LONGEST)
    yield _row(
        f"the same, {LONGEST:g} s, De Groote's curves", mm.solve_tension(with_degroote(model), *longest, DEFAULT)
    )
    slow, fast = (mm.solve_tension(model, *resampled(motion, torques, rate), DEFAULT) for rate in (SLOW, FAST))
    yield _row(f"walk at {SLOW:g} Hz", slow)
    yield _row(f"walk at {FAST:g} Hz", fast) | apart(model, slow, fast)
    case = next(one for one in CASES if "gait2392" in one.name)
    with tempfile.TemporaryDirectory() as work:
        found = prepare(folder, case, Path(work))
        motion = mm.differentiate(found.motion, case.cutoff or 6.0)
        keep = np.flatnonzero((motion.time >= case.start - 1e-9) & (motion.time <= case.end + 1e-9))
        motion = take_frames(motion, keep)
        loads = None if found.loads is None else mm.read_loads(found.loads, found.model, motion)
        torques = _torques(found.model, motion, loads)
        tension = mm.solve_tension(found.model, motion, torques, PASSIVE, found.actuators)
    yield _row(f"{case.name}, passive force", tension)
    yield _row("run at 2 m/s, unscaled generic model, 92 muscles", _run(folder))


def resampled(motion: mm.Motion, torques: mm.Series, rate: float) -> tuple[mm.Motion, mm.Series]:
    """The beginning of a motion and its torques at another rate, by splines."""
    time = np.arange(motion.time[20], motion.time[20] + SHORT, 1.0 / rate)
    curve = CubicSpline(motion.time, motion.values)
    values = (curve(time), curve(time, 1), curve(time, 2))
    return mm.Motion(time, motion.names, *values), mm.Series(
        time, torques.names, CubicSpline(torques.time, torques.values)(time)
    )


def apart(model: mm.Model, slow: Tension, fast: Tension) -> dict[str, object]:
    """Root mean square differences at the times that both have."""
    every = round(FAST / SLOW)
    count = min(len(slow), len(fast.activations[::every]))
    strength = np.array([one.max_isometric_force for one in model.muscles])
    difference = slow.activations[:count] - fast.activations[::every][:count]
    forces = (slow.forces[:count] - fast.forces[::every][:count]) / strength
    return dict(zip(APART, (float(np.sqrt(np.mean(one**2))) for one in (difference, forces)), strict=True))


def _run(folder: Path) -> Tension:
    home = folder / "hamner-run-subject04"
    model = mm.read_model(home / "unscaled_generic.osim")
    markers = mm.read_recording(home / "run200" / "markers.trc").markers
    assert markers is not None
    whole = mm.differentiate(mm.inverse_kinematics(model, markers).motion, cutoff=RUN_CUTOFF)
    first, last = (whole.time[0] + one for one in RUN_SECONDS)
    motion = take_frames(whole, np.flatnonzero((whole.time >= first) & (whole.time <= last)))
    feet = {"R_ground_force_": "calcn_r", "L_ground_force_": "calcn_l"}
    loads = mm.read_loads(home / "run200" / "grf.mot", model, motion, feet)
    return mm.solve_tension(model, motion, _torques(model, motion, loads), DEFAULT)


def _torques(model: mm.Model, motion: mm.Motion, loads: mm.Wrenches | None) -> mm.Series:
    return mm.inverse_dynamics(model, motion, None if loads is None else mm.resample_wrenches(loads, motion.time))


def _row(name: str, found: Tension) -> dict[str, object]:
    assert found.fibers is not None
    certificate = found.fibers.certificate
    return {
        "recording": name,
        "frames": len(found),
        "optimal": int(found.optimal.sum()),
        "most iterations": certificate.steps,
        "KKT residual": certificate.residual,
        **dict.fromkeys(APART, ""),
    }

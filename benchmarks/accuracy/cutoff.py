"""The low-pass filter that a motion gets by default, judged by measured ground forces that it does not see."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.cases import FORCE_CASES, ForceCase
from myomorph.io.loads import read_external_loads
from myomorph.motion.automatic_cutoff import automatic_cutoff
from myomorph.tension.terms.actuators import floating_joints

FIXED = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 30.0)
"""Cutoffs that the automatic one is compared with [Hz]."""

LOADED = 20.0
"""Vertical force from which somebody stands on the plates [N]."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Force that has to hold the pelvis, by cutoff of the motion; ground forces are not filtered."""
    for case in FORCE_CASES:
        if not case.loads:
            continue
        model = mm.read_model(folder / case.model)
        recorded = mm.read_motion(folder / case.motion, model)
        measured = read_external_loads(folder / case.loads)
        chosen = automatic_cutoff(recorded)
        at = {cutoff: _residual(case, model, recorded, measured, cutoff) for cutoff in (None, *FIXED, chosen)}
        best = min(FIXED, key=at.__getitem__)
        yield {
            "recording": case.name,
            "frames": len(recorded),
            "automatic cutoff [Hz]": "none" if chosen is None else f"{chosen:.2g}",
            "residual force, automatic [N]": at[chosen],
            "without a filter [N]": at[None],
            "at 6 Hz [N]": at[6.0],
            "at the best cutoff [N]": at[best],
            "best cutoff [Hz]": best,
        }


def _residual(
    case: ForceCase, model: mm.Model, recorded: mm.Motion, measured: mm.Wrenches, cutoff: float | None
) -> float:
    """Root mean square of the force on the floating joint over frames on the plates [N]."""
    motion = mm.differentiate(recorded, cutoff)
    loads = mm.resample_wrenches(measured, motion.time)
    torques = mm.inverse_dynamics(model, motion, loads)
    names = [name for joint in floating_joints(model) for name in joint.coordinates]
    held = [torques[name] for name in names if model.coordinate(name).motion == "translational"]
    used = (motion.time >= case.start) & (motion.time <= case.end)
    used &= np.abs(loads.forces[:, :, 1]).sum(axis=1) > LOADED
    return float(np.sqrt(np.mean(np.sum(np.square(held), axis=0)[used])))

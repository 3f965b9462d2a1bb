"""What the defaults of muscle tensions were chosen by: activations beside EMG that took no part, of every setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.emg import WALKS, Walk
from benchmarks.accuracy.emg_faults import implant
from benchmarks.accuracy.knee import STRIDES
from myomorph.model.arrays import Array
from myomorph.motion.emg_delay import USUAL, channel_means, fit_gains, shifted
from myomorph.tension.recruitment import RecruitmentOptions, recruitment_terms
from myomorph.tension.tension import Tension

SECONDS = 8.0
"""Of each walk: some strides, so that the table is made in a minute."""

EFFORT = RecruitmentOptions(0.0)
SETTINGS: Mapping[str, mm.TensionOptions] = {
    "effort alone": mm.TensionOptions(),
    "with passive force": mm.TensionOptions(passive=True),
    "activations from the model's minimum": mm.TensionOptions(min_activation="model"),
    "curves of the rigid tendon": mm.TensionOptions(curves="rigid-tendon"),
    "no curves": mm.TensionOptions(curves="constant"),
    "exponent 1.5": mm.TensionOptions(exponent=1.5),
    "exponent 3": mm.TensionOptions(exponent=3.0),
    "exponent 4": mm.TensionOptions(exponent=4.0),
    "exponent 10": mm.TensionOptions(exponent=10.0),
    "min/max": mm.TensionOptions(recruitment="minmax"),
    "weights by volume": mm.TensionOptions(weights="volume"),
    "weights by strength": mm.TensionOptions(weights="strength"),
}


LOADS: Mapping[str, RecruitmentOptions] = {
    f"loads of {joints}, {weight:g}": RecruitmentOptions(weight, joints)
    for joints, weights in (("knees", (0.01, 0.02, 0.05)), ("all", (0.02,)))
    for weight in weights
}
"""Costs beside the effort; that of knees with 0.02 is the default."""
BIARTICULAR = ("recfem", "rect_fem", "gas")
"""How names of muscles begin, or hold, whose silence is a test of its own."""
SILENT = 0.4
"""The share of a channel's samples that count as silence, its smallest."""


def measure_settings(folder: Path) -> Iterator[dict[str, object]]:
    """A row for every walk and setting; no setting sees EMG, and the delay is the same for all."""
    for walk in (*(make(folder) for make in WALKS), *(implant(folder, stride) for stride in STRIDES)):
        start, stop = walk.tested
        walk = replace(walk, tested=(start, min(stop, start + SECONDS)))
        motion, torques = walk.part(walk.tested)
        emg = _measured(walk, motion.time)
        wrenches = mm.resample_wrenches(walk.wrenches, motion.time)
        asked = {name: (options, EFFORT) for name, options in SETTINGS.items()}
        asked |= {name: (mm.TensionOptions(), loads) for name, loads in LOADS.items()}
        for name, (options, costs) in asked.items():
            terms = recruitment_terms(walk.model, motion, torques, wrenches, costs)
            found = mm.solve_tension(walk.model, motion, torques, options, terms=terms)
            fits = {channel: _fit(found, walk, channel, emg[channel]) for channel in walk.channels}
            r, rms = zip(*fits.values(), strict=True)
            both = [channel for channel in fits if _is_biarticular(walk, channel)]
            yield {
                "walk": walk.name,
                "setting": name,
                "frames": len(found),
                "channels": len(r),
                "correlation with EMG, mean": float(np.mean(r)),
                "least": float(np.min(r)),
                "RMS from EMG, mean": float(np.mean(rms)),
                "correlation, biarticular": float(np.mean([fits[channel][0] for channel in both])),
                "activation of these in silence": float(
                    np.mean([_in_silence(found, walk, channel, emg[channel]) for channel in both])
                ),
                "largest activation, mean": float(np.nanmax(found.activations, axis=1).mean()),
                "tension of all muscles, mean [kN]": float(found.forces.sum(axis=1).mean()) / 1e3,
                "not optimal": int((~found.optimal).sum()),
            }


def _measured(walk: Walk, time: Array) -> dict[str, Array]:
    """Each channel over its largest value, by the usual delay later."""
    moved = shifted(walk.emg, time, np.full(len(walk.emg.names), USUAL))
    return {name: moved[:, walk.emg.names.index(name)] / np.nanmax(walk.emg[name]) for name in walk.channels}


def _fit(found: Tension, walk: Walk, channel: str, measured: Array) -> tuple[float, float]:
    """Correlation of the channel's muscles, and RMS once they are scaled to fit best."""
    predicted = channel_means({channel: walk.channels[channel]}, found.muscles, found.activations)[:, 0]
    use = np.isfinite(predicted) & np.isfinite(measured)
    scale, _ = fit_gains(predicted[use, None], measured[use, None])
    rms = float(np.sqrt(np.mean((scale[0] * predicted[use] - measured[use]) ** 2)))
    moves = np.std(predicted[use]) > 1e-9
    # A channel whose muscles never work follows nothing.
    return float(np.corrcoef(predicted[use], measured[use])[0, 1]) if moves else 0.0, rms


def _is_biarticular(walk: Walk, channel: str) -> bool:
    return all(any(part in muscle for part in BIARTICULAR) for muscle in walk.channels[channel])


def _in_silence(found: Tension, walk: Walk, channel: str, measured: Array) -> float:
    """Mean activation of a channel's muscles where its EMG is least."""
    predicted = channel_means({channel: walk.channels[channel]}, found.muscles, found.activations)[:, 0]
    return float(predicted[measured < np.nanquantile(measured, SILENT)].mean())

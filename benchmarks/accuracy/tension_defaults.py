"""What the defaults of muscle tensions were chosen by: activations beside EMG that took no part, of every setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.emg import WALKS, Walk
from myomorph.model.arrays import Array
from myomorph.motion.emg_delay import USUAL, channel_means, fit_gains, shifted
from myomorph.tension.tension import Tension

SECONDS = 8.0
"""Of each walk: some strides, so that the table is made in a minute."""

SETTINGS: Mapping[str, mm.TensionOptions] = {
    "default": mm.TensionOptions(),
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


def measure_settings(folder: Path) -> Iterator[dict[str, object]]:
    """A row for every walk and setting; no setting sees EMG, and the delay is the same for all."""
    for make in WALKS:
        walk = make(folder)
        start, stop = walk.tested
        walk = replace(walk, tested=(start, min(stop, start + SECONDS)))
        motion, torques = walk.part(walk.tested)
        emg = _measured(walk, motion.time)
        for name, options in SETTINGS.items():
            found = mm.solve_tension(walk.model, motion, torques, options)
            r, rms = zip(*(_fit(found, walk, channel, emg[channel]) for channel in walk.channels), strict=True)
            yield {
                "walk": walk.name,
                "setting": name,
                "frames": len(found),
                "channels": len(r),
                "correlation with EMG, mean": float(np.mean(r)),
                "least": float(np.min(r)),
                "RMS from EMG, mean": float(np.mean(rms)),
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
    return float(np.corrcoef(predicted[use], measured[use])[0, 1]), rms

"""Faults put into clean EMG of walks: channels exchanged by name, and channels that are noise."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.emg import WALKS, Walk
from benchmarks.accuracy.tension.knee import CHANNELS, CUTOFF, STRIDES, STUDY, inputs_of, raw_emg
from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial, swapped_channels
from myomorph.core.model.arrays import Array
from myomorph.core.motion.emg_activation import channel_means, shifted
from myomorph.core.motion.emg_checks import noise_faults
from myomorph.core.tension.emg_targets import EmgOptions

Row = dict[str, object]

DIFFERENT = 0.3
"""Correlation of two envelopes below which their muscles work at different times."""
RATE = 1000.0
"""Of the noise that stands for raw EMG [Hz]."""


def measure(folder: Path) -> Iterator[Row]:
    """Clean channels that are called faulty, and faults that are found, of each walk."""
    yield from map(_row, (make(folder) for make in WALKS))


def measure_unseen(folder: Path) -> Iterator[Row]:
    """Measure the same of walks that no threshold of the checks was set with."""
    yield from map(_row, (implant(folder, stride) for stride in STRIDES))


def _row(walk: Walk) -> Row:
    return {"walk": walk.name, "channels": len(walk.channels)} | _swaps(walk) | _noise(walk)


def implant(folder: Path, stride: str) -> Walk:
    """Return a stride of the man with an instrumented knee.

    It is one stride, so that it is calibrated and tested alike.
    """
    model, motion, wrenches = inputs_of(folder, stride)
    motion = mm.differentiate(motion, CUTOFF)
    emg = mm.envelopes(raw_emg(folder, stride))
    torques = mm.inverse_dynamics(model, motion, wrenches)
    span = (float(motion.time[0]), float(motion.time[-1]))
    return Walk(
        name=f"{STUDY}, {stride}",
        model=model,
        motion=motion,
        torques=torques,
        wrenches=wrenches,
        emg=emg,
        channels=CHANNELS,
        calibrated=span,
        tested=span,
        every=2,
    )


class _Swap(NamedTuple):
    """Two channels that were exchanged.

    Attributes
    ----------
    found : they are named
    other : other ones are named instead
    different : they work at different times
    """

    found: bool
    other: bool
    different: bool


def _swaps(walk: Walk) -> Row:
    """Exchange each pair of channels that are no noise; the delay is the clean recording's."""
    names = tuple(name for name in walk.channels if name not in _noisy(walk))
    motion, torques = walk.part(walk.calibrated)
    trial = EmgTrial(motion=motion, torques=torques, emg=walk.emg)
    delay = calibrate_emg(walk.model, [trial], walk.channels, EmgOptions(weight=10.0)).delays[0]
    motion, torques = walk.part(walk.tested)
    alone = mm.solve_tension(walk.model, motion, torques)
    activations = channel_means(
        {name: walk.channels[name] for name in names}, alone.muscles, alone.activation
    )
    columns = [walk.emg.names.index(name) for name in names]
    clean = shifted(walk.emg, motion.time, np.full(len(walk.emg.names), delay))[:, columns]
    swaps = list(_exchanged(clean, activations))
    different = [swap for swap in swaps if swap.different]
    found = sum(swap.found for swap in swaps)
    found_different = sum(swap.found for swap in different)
    return {
        "pairs called exchanged in the clean recording": len(swapped_channels(clean, activations)),
        "exchanged pairs found": f"{found} of {len(swaps)}",
        "of those that work at different times": f"{found_different} of {len(different)}",
        "another pair named": sum(swap.other for swap in swaps),
    }


def _exchanged(clean: Array, activations: Array) -> Iterator[_Swap]:
    """Exchange each pair of clean channels (frames, channels)."""
    alike = np.atleast_2d(np.corrcoef(clean[np.isfinite(clean).all(axis=1)].T))
    for i, j in itertools.combinations(range(clean.shape[1]), 2):
        order = np.arange(clean.shape[1])
        order[[i, j]] = j, i
        named = swapped_channels(clean[:, order], activations)
        found = any({one.first, one.second} == {i, j} for one in named)
        yield _Swap(
            found=found, other=bool(named) and not found, different=bool(alike[i, j] < DIFFERENT)
        )


def _noise(walk: Walk) -> Row:
    """Each channel replaced by noise of its mean."""
    emg = _some_emg(walk)
    clean = _noisy(walk)
    found = 0
    for k, name in enumerate(walk.channels):
        if name in clean:
            continue
        column = emg.names.index(name)
        values = emg.values.copy()
        values[:, column] = _envelope_of_noise(emg.time, k) * values[:, column].mean()
        faults = noise_faults(mm.Emg(emg.time, emg.names, values), tuple(walk.channels))
        found += {one.channel for one in faults} == {name, *clean}
    return {
        "channels called noise in the clean recording": ", ".join(clean) or 0,
        "channels of noise found": f"{found} of {len(walk.channels) - len(clean)}",
    }


def _some_emg(walk: Walk) -> mm.Emg:
    span = walk.tested
    use = (walk.emg.time >= span[0]) & (walk.emg.time <= min(span[1], span[0] + 5.0))
    return mm.Emg(walk.emg.time[use], walk.emg.names, walk.emg.values[use])


def _noisy(walk: Walk) -> list[str]:
    """Channels that are called noise in the recording as it is."""
    return [one.channel for one in noise_faults(_some_emg(walk), tuple(walk.channels))]


def _envelope_of_noise(time: Array, seed: int) -> Array:
    """Envelope of white noise at times (samples,), its mean 1."""
    clock = np.arange(time[0] - 1.0, time[-1] + 1.0, 1.0 / RATE)
    raw = mm.Series(clock, ("noise",), np.random.default_rng(seed).standard_normal((len(clock), 1)))
    found = np.interp(time, clock, mm.envelopes(raw)["noise"])
    return np.asarray(found / found.mean())

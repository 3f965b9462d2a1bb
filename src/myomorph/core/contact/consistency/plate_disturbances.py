"""What electricity adds to the signals of force plates: hum of the mains, and single samples.

Hum is a line in the spectrum of a channel, at 50 or 60 Hz or at twice or three times as much, far
above what lies beside it. A spike is one sample that leaves both its neighbours, which agree.
Neither changes what the plate measures at the frequencies of movement, so that both are said only.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import PLATES
from myomorph.core.model.findings import Finding

HUM = "hum"
SPIKES = "spikes"
"""Kinds of findings."""
MAINS = (50.0, 60.0)
"""Frequencies of the mains [Hz]."""
TIMES = (1, 2, 3)
"""Multiples of it at which hum lies."""
NEAR = 0.7
"""Distance of a line from these frequencies, at most [Hz]."""
BESIDE = (2.5, 12.0)
"""Distances of the frequencies that a line is compared with [Hz]."""
SHARP = 8.0
"""Amplitude of a line over the typical one beside it."""
LOUD = 0.01
"""Amplitude of a line from which it is said, over the weight."""
SHORTEST = 0.8
"""Length of a signal that shows lines [s]."""
DENSE = 400.0
"""Rate from which on a single sample is no motion [Hz]."""
HIGH = 0.08
"""Height of a spike over its neighbours, over the weight."""
ALONE = 0.3
"""Part of it by which the neighbours differ, at most."""
SHARPER = 6.0
"""Height over that of all but a hundredth of the samples."""


def disturbances(
    name: str, force: Array, time: Array, *, weight: float, vertical: int
) -> Iterator[Finding]:
    """Find hum and spikes in the vertical force of a plate.

    Parameters
    ----------
    name : of the plate
    force : (samples, 3) [N]
    time : (samples,) evenly spaced [s]
    weight : of the body [N]
    vertical : number of the vertical axis

    Yields
    ------
    a finding of hum or none, and one of spikes or none
    """
    if len(time) < 5:
        return
    rate = 1.0 / float(np.median(np.diff(time)))
    yield from _hum(name, force[:, vertical], rate, weight)
    if rate >= DENSE:
        yield from _spikes(name, force[:, vertical], time, weight)


def _hum(name: str, force: Array, rate: float, weight: float) -> Iterator[Finding]:
    """Find the loudest line of the mains in a force (samples,)."""
    if len(force) < SHORTEST * rate:
        return
    window = np.hanning(len(force))
    amplitudes = 2.0 * np.abs(np.fft.rfft((force - force.mean()) * window)) / window.sum()
    frequencies = np.fft.rfftfreq(len(force), 1.0 / rate)
    loudest = (0.0, 0.0)
    for mains in MAINS:
        for count in TIMES:
            away = np.abs(frequencies - count * mains)
            line = float(amplitudes[away <= NEAR].max(initial=0.0))
            around = amplitudes[(away > BESIDE[0]) & (away < BESIDE[1])]
            sharp = len(around) > 0 and line > SHARP * float(np.median(around))
            if sharp and count * mains < 0.5 * rate:
                loudest = max(loudest, (line, count * mains))
    amplitude, frequency = loudest
    if amplitude > LOUD * weight:
        text = PLATES.message(
            f"force '{name}' hums with {amplitude:.0f} N at {frequency:.0f} Hz, as the mains do: a"
            " low-pass filter takes it off, but where a foot comes and goes is less sharp; look at"
            " the plate's grounding",
            size=amplitude,
            severity="good to know",
        )
        yield Finding(HUM, name, text)


def _spikes(name: str, force: Array, time: Array, weight: float) -> Iterator[Finding]:
    """Find single samples of a force (samples,) that leave both neighbours."""
    above = force[1:-1] - 0.5 * (force[:-2] + force[2:])
    apart = np.abs(force[2:] - force[:-2])
    size = np.abs(above)
    high = max(HIGH * weight, SHARPER * float(np.quantile(size, 0.99)))
    found = np.flatnonzero((size > high) & (apart < ALONE * size)) + 1
    if len(found):
        first = float(time[found[0]])
        text = PLATES.message(
            f"force '{name}' has {len(found)} samples that stand alone, by up to"
            f" {size[found - 1].max():.0f} N, the first at {first:.3f} s: a low-pass filter spreads"
            " them; export the recording again, or look at the plate's cable",
            size=float(size[found - 1].max()),
        )
        spans = tuple((float(time[index]), float(time[index])) for index in found)
        yield Finding(SPIKES, name, text, times=spans)

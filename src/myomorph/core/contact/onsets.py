"""Onsets in one channel of sound: when something begins to sound, and how loud.

An onset is where the energy in several bands rises together over what was heard before; its first
arrival is the sample at which the variance of the signal changes (Maeda 1985), to a fraction of a
millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Sound

HOP = 0.001
"""Step of short-time energies [s]."""
AHEAD = 0.005
BEHIND = 0.025
APART = 0.001
"""Energy of the next 5 ms is held against that of 25 ms that ended 1 ms ago [s]."""
WINDOW = 0.006
"""Time either side of an onset in which its first arrival is looked for [s]."""
SLOWEST = 2000.0
"""Rate down to which a signal is thinned [Hz]."""
LEARNT = 0.03
ORDER = 24
"""Time before that from which linear prediction is fitted [s], and its order."""
QUIET = 0.005
"""Time before an onset in which the loudness before is taken [s]."""
BLOCK = 0.002
"""Time for which one linear prediction is used [s]."""
LOWEST = 50.0
"""Frequency below which all is left out [Hz]."""
RISE = 1.2
"""Least rise of the energy that was not foreseen, its natural logarithm: 1.2 is 5 dB."""
THRESHOLD = 4.0
"""The same in standard deviations that noise alone would have."""
REST = 0.05
"""Least time between two impacts of one instrument [s]."""
HEARD = 0.02
"""Time over which the energy of an impact is taken [s]."""


@dataclass(frozen=True)
class Onset:
    """One arrival in one channel.

    Attributes
    ----------
    time : at the microphone [s]
    energy : sum of the squared signal over `HEARD`, background taken off [full scale^2 s]
    background : the same of what was heard before
    """

    channel: str
    time: float
    energy: float
    background: float


@read_only
class Heard:
    """One channel without rumble, at its own rate and thinned by 4 as often as that holds drums.

    Attributes
    ----------
    levels : signal (samples,) and rate [Hz]; soft impacts on a large drum show in the slow ones
        only
    start : time of the first sample [s]
    """

    channel: str
    levels: tuple[tuple[Array, float], ...]
    start: float


def listen(sound: Sound, channel: str) -> Heard:
    """Prepare one channel: rumble filtered out, and thinned by 4 as often as drums allow.

    The filter is causal, so that nothing comes before its cause.

    Parameters
    ----------
    sound : as recorded
    channel : name of it
    """
    lowest = min(LOWEST, 0.4 * sound.rate)
    high = scipy.signal.butter(2, lowest, "highpass", fs=sound.rate, output="sos")
    signal = scipy.signal.sosfilt(high, sound[channel].astype(np.float64))
    levels = [(signal, sound.rate)]
    while levels[-1][1] / 4.0 >= SLOWEST:
        levels.append((scipy.signal.resample_poly(levels[-1][0], 1, 4), levels[-1][1] / 4.0))
    return Heard(channel, tuple(levels), sound.start)


def onsets(heard: Heard) -> tuple[Onset, ...]:
    """Find arrivals in one channel, whatever instrument they come from.

    Parameters
    ----------
    heard : the prepared channel

    Returns
    -------
    arrivals with their energies, in the order of time
    """
    signal, rate = heard.levels[0]
    hops = int(len(signal) / rate / HOP)
    if hops < 100:
        return ()
    table = np.array([_excess(signal, rate, hops) for signal, rate in heard.levels])
    results: list[Onset] = []
    for peak in _peaks(table.sum(axis=0)):
        # The fastest level that shows it has the time best.
        signal, rate = heard.levels[int(np.argmax(table[:, peak] >= 0.5 * table[:, peak].max()))]
        time = heard.start + _first_arrival(signal, round(peak * HOP * rate), rate) / rate
        if results and time - results[-1].time < 0.5 * REST:
            continue
        energy, background = energy_after(heard, time)
        if energy > 0.0:
            results.append(
                Onset(channel=heard.channel, time=time, energy=energy, background=background)
            )
    return tuple(results)


def _peaks(excess: Array) -> NDArray[np.int64]:
    """Hops (peaks,) at which an excess (hops,) is largest for a while.

    Where nothing has been learnt yet everything is unforeseen, and at the end too little is heard.
    """
    excess[: round(LEARNT / HOP)] = 0.0
    excess[-round(AHEAD / HOP) :] = 0.0
    width = 2 * round(0.5 * REST / HOP) + 1
    largest = scipy.ndimage.maximum_filter1d(excess, width)
    return np.flatnonzero((excess > 0.0) & (excess == largest))


def energy_after(heard: Heard, time: float) -> tuple[float, float]:
    """Measure the energy of what begins at a time, without what was heard before.

    In the slowest level, what still rings is foreseen by linear prediction and taken off wave by
    wave; of what lies above it, the mean power of the time `QUIET` before.

    Parameters
    ----------
    heard : the prepared channel
    time : at which it begins [s]

    Returns
    -------
    the energy, and that of what was heard before [full scale^2 s]
    """
    signal, rate = heard.levels[0]
    slow, slow_rate = heard.levels[-1]
    since = time - heard.start
    energy, before = _powers(signal, rate, since, HEARD)
    low, low_before = _powers(slow, slow_rate, since, HEARD)
    new, rings = _without_ringing(slow, slow_rate, since)
    # A prediction that runs away is worse than none.
    if new < low:
        low_before = rings
    else:
        new = low - low_before
    above = 0.0
    if len(heard.levels) > 1:
        above = max(energy - low - max(before - low_before, 0.0), 0.0)
    return new + above, before


def _without_ringing(signal: Array, rate: float, since: float) -> tuple[float, float]:
    """Energy of a stretch without what still rings, and that of the ringing.

    Parameters
    ----------
    signal : (samples,)
    since : when the stretch begins [s]
    """
    first = round(since * rate)
    gap = max(round(APART * rate), 1)
    learnt = max(int(LEARNT * rate), 8 * ORDER)
    past = signal[max(first - gap - learnt, 0) : max(first - gap, 0)]
    length = min(int(HEARD * rate), len(signal) - first)
    rings = _foreseen(past, gap + length)[gap:]
    new = float(np.sum((signal[first : first + length] - rings) ** 2)) / rate
    return new, float(np.sum(rings**2)) / rate


def _powers(signal: Array, rate: float, since: float, length: float) -> tuple[float, float]:
    """Energy of a stretch, and that of one as long by the power of the time `QUIET` before.

    Parameters
    ----------
    signal : (samples,)
    since, length : when the stretch begins, and how long it is [s]
    """
    first = round(since * rate)
    count = int(length * rate)
    gap = max(round(0.0002 * rate), 1)
    earlier = signal[max(first - gap - int(QUIET * rate), 0) : max(first - gap, 0)]
    before = float(np.mean(earlier**2)) * length if len(earlier) else 0.0
    return float(np.sum(signal[max(first, 0) : max(first + count, 0)] ** 2)) / rate, before


def _foreseen(past: Array, count: int) -> Array:
    """Continue a signal (samples,) by linear prediction, by silence where it is short.

    Returns
    -------
    (count,)
    """
    if len(past) < 4 * ORDER:
        return np.zeros(count)
    weights = _prediction(past)
    result: Array = np.concatenate([past[-ORDER:], np.zeros(count)])
    for index in range(ORDER, len(result)):
        result[index] = weights @ result[index - ORDER : index]
    return result[ORDER:]


def _prediction(past: Array) -> Array:
    """Weights (ORDER,) of earlier samples in the linear prediction that fits a stretch best."""
    rows = np.lib.stride_tricks.sliding_window_view(past, ORDER + 1)
    gram = rows[:, :-1].T @ rows[:, :-1]
    gram[np.diag_indices(ORDER)] += 1e-6 * np.trace(gram) / ORDER + 1e-300
    return np.linalg.solve(gram, rows[:, :-1].T @ rows[:, -1]).astype(np.float64)


def _excess(signal: Array, rate: float, hops: int) -> Array:
    """Excess of the rise of unforeseen energy over its threshold (hops,).

    The rise is log(energy ahead / energy behind), both with the quiet of the whole recording added.

    Parameters
    ----------
    signal : (samples,)
    hops : number of steps of `HOP`
    """
    ahead = round(AHEAD / HOP)
    behind = round(BEHIND / HOP)
    apart = round(APART / HOP)
    here = np.arange(hops)
    first = np.maximum(here - apart - behind, 0)
    last = np.maximum(here - apart, 0)
    stop = np.minimum(here + ahead, hops)
    marks = np.minimum(np.round(np.arange(hops + 1) * HOP * rate).astype(np.int64), len(signal))
    power = np.diff(np.concatenate([[0.0], np.cumsum(_innovation(signal, rate) ** 2)])[marks])
    # Digital silence is not infinitely far below a impact.
    quiet = max(float(np.quantile(power, 0.1)), 1e-7 * float(power.max()), 1e-300)
    summed = np.concatenate([[0.0], np.cumsum(power)])
    after = (summed[stop] - summed[here]) / np.maximum(stop - here, 1)
    before = (summed[last] - summed[first]) / np.maximum(last - first, 1)
    rise = np.log((after + quiet) / (before + quiet))
    # Noise of so many independent samples alone moves the logarithm by this much.
    spread = np.sqrt(2.0 / (AHEAD * rate) + 2.0 / (BEHIND * rate))
    return np.maximum(rise - max(RISE, THRESHOLD * spread), 0.0)


def _innovation(signal: Array, rate: float) -> Array:
    """Rest of a signal that linear prediction does not foresee, by blocks.

    Each block has a model of the `LEARNT` before it. Ringing drums and hum are foreseen, a new
    impact is not (Glover, Lazzarini and Timoney 2011).

    Parameters
    ----------
    signal : (samples,)

    Returns
    -------
    (samples,)
    """
    block = max(int(BLOCK * rate), 1)
    learnt = max(int(LEARNT * rate), 8 * ORDER)
    count = len(signal) // block
    padded = np.concatenate([np.zeros(learnt), signal[: count * block]])
    result = np.zeros(len(signal))
    pasts = np.lib.stride_tricks.sliding_window_view(padded, learnt)[::block]
    reaches = np.lib.stride_tricks.sliding_window_view(padded[learnt - ORDER :], block + ORDER)[
        ::block
    ]
    for first in range(0, count, 512):
        chunk = slice(first, min(first + 512, count))
        weights = _predictions(pasts[chunk])
        rows = np.lib.stride_tricks.sliding_window_view(reaches[chunk], ORDER + 1, axis=1)
        rest = rows[..., -1] - np.einsum("kbo,ko->kb", rows[..., :-1], weights)
        result[chunk.start * block : chunk.stop * block] = rest.reshape(-1)
    return result


def _predictions(pasts: Array) -> Array:
    """Find for each past the weights that predict the next sample, from its autocorrelation.

    Parameters
    ----------
    pasts : (blocks, samples)

    Returns
    -------
    (blocks, ORDER) weights of the last samples, the earliest first
    """
    length = pasts.shape[1]
    size = scipy.fft.next_fast_len(length + ORDER + 1, real=True)
    power = np.abs(scipy.fft.rfft(pasts * np.hanning(length), size, axis=1)) ** 2
    alike = scipy.fft.irfft(power, size, axis=1)[:, : ORDER + 1]
    alike[:, 0] = alike[:, 0] * (1.0 + 1e-9) + 1e-300
    lags = np.abs(np.subtract.outer(np.arange(ORDER), np.arange(ORDER)))
    weights: Array = np.linalg.solve(alike[:, lags], alike[:, 1:, None])[:, ::-1, 0]
    return weights


def _first_arrival(signal: Array, near: int, rate: float) -> int:
    """Sample at which something new begins, around the sample `near`.

    An autoregressive model of what was heard before takes off whatever still rings (Sleeman and van
    Eck 1999); the arrival is where the variance of the rest changes: the i of least

        i log(var before) + (n - i) log(var after)

    Parameters
    ----------
    signal : (samples,)
    """
    reach = int(WINDOW * rate)
    learnt = max(int(LEARNT * rate), 8 * ORDER)
    first = max(near - reach, 0)
    last = min(near + 2 * reach, len(signal))
    part = _unforeseen(signal[max(first - learnt, 0) : last], first - max(first - learnt, 0))
    # What follows the loudest sample is the instrument's own ringing, and shows nothing of its
    # beginning.
    part = part[: int(np.argmax(np.abs(part))) + 2]
    n = len(part)
    if n < 16:
        return first + n - 2
    sums = np.cumsum(part**2)
    index = np.arange(4, n)
    tiny = 1e-12 * sums[-1] + 1e-300
    before = sums[index - 1] / index + tiny
    after = (sums[-1] - sums[index - 1]) / (n - index) + tiny
    return first + int(index[np.argmin(index * np.log(before) + (n - index) * np.log(after))])


def _unforeseen(signal: Array, known: int) -> Array:
    """Rest of a signal that a linear prediction of its first samples does not predict.

    Parameters
    ----------
    signal : (samples,)
    known : number of samples that it is fitted to

    Returns
    -------
    (samples - known,)
    """
    if known < 4 * ORDER:
        return signal[known:]
    later = np.lib.stride_tricks.sliding_window_view(signal[known - ORDER :], ORDER + 1)
    return later[:, -1] - later[:, :-1] @ _prediction(signal[:known])

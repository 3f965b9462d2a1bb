"""Faults of EMG, each named with its channel and its time before it reaches a muscle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import EMG
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Emg, Series

# Time without any change after which a raw channel is dead [s]: muscle and amplifier are never that
# quiet
DEAD = 0.05
DEAD_ENVELOPE = 0.5  # The same for an envelope [s]
# Samples in a row at a channel's largest or smallest value that mean a saturated amplifier
CLIPPED = 3
CLIPPED_SHARE = 0.001  # Part of the samples that must be so
MEDIAN_FREQUENCY = (25.0, 350.0)
"""Range of the median frequency of surface EMG at its true rate [Hz], wide: 50 to 150 in most
muscles.
"""

# Part of a channel's largest value below which it is negative, and not only ripples of a filter
NEGATIVE = 0.01
CLIPPED_ENVELOPE = 0.05
"""Time that an envelope stands at its largest value when it was cut there [s]; one of 6 Hz turns in
a few ms.
"""

FAST = 20.0  # Frequency that no envelope reaches [Hz]: raw EMG begins there
FAST_SHARE = 0.1  # Share of a channel's variance above it that shows that it is none
BEYOND_ONE = 1.5  # Envelopes beyond this are no share of a maximum
BURSTS = 5.0
STEADY = 3.0
"""95th over 10th percentile of an envelope: from which on a channel has bursts, and below which it
has none. Muscles of six walks have 3.3 and more, electrodes that were on nobody or hummed 2.7 and
less.
"""

LONG_ENOUGH = 1.0  # Length of a recording in which muscles that move a body burst [s]


@dataclass(frozen=True)
class EmgFault:
    """One thing wrong with a channel.

    Attributes
    ----------
    channel : name
    kind : dead, clipped, unknown, negative, large, fast, copy, rate or noise
    start, stop : of the fault [s]
    text : for the user
    """

    channel: str
    kind: str
    start: float
    stop: float
    text: str

    @property
    def message(self) -> Message:
        """Its text with its cause."""
        return EMG.message(self.text, place=self.channel, times=((self.start, self.stop),))


def raw_faults(raw: Series) -> tuple[EmgFault, ...]:
    """Find faults of raw EMG: dead or clipped channels, unknown samples, a rate that is wrong.

    Parameters
    ----------
    raw : (samples, channels) in any unit

    Returns
    -------
    faults, channel by channel
    """
    faults: list[EmgFault] = []
    for name, column in zip(raw.names, raw.values.T, strict=True):
        faults += _unknown(raw, name, column)
        if not np.isfinite(column).any():
            continue
        dead = _dead(raw, name, column, DEAD)
        faults += dead
        if not dead:
            faults += [*_clipped(raw, name, column), *_off_rate(raw, name, column)]
    return tuple(faults)


def envelope_faults(emg: Emg) -> tuple[EmgFault, ...]:
    """Find faults of envelopes: unknown, negative, far over 1, dead or cut stretches, copies.

    Parameters
    ----------
    emg : (samples, channels) [-]

    Returns
    -------
    faults, channel by channel
    """
    faults: list[EmgFault] = []
    for name, column in zip(emg.names, emg.values.T, strict=True):
        faults += _unknown(emg, name, column)
        known = np.isfinite(column)
        if not known.any():
            continue
        negative = known & (column < -NEGATIVE * np.abs(column[known]).max())
        if negative.any():
            what = (
                f"is negative in {_share(negative)}, down to {column[negative].min():.3g}; taken"
                " as 0"
            )
            faults.append(_fault(emg, name, "negative", negative, what))
        large = known & (column > BEYOND_ONE)
        if large.any():
            what = (
                f"reaches {column[large].max():.3g}: an envelope is a share of a maximum;"
                " normalise it"
            )
            faults.append(_fault(emg, name, "large", large, what))
        dead = _dead(emg, name, column, DEAD_ENVELOPE)
        faults += dead or [*_cut(emg, name, column), *_fast(emg, name, column)]
        before = emg.values[:, : emg.names.index(name)].T
        twin = next(
            (
                index
                for index, other in enumerate(before)
                if np.array_equal(other, column, equal_nan=True)
            ),
            None,
        )
        if twin is not None:
            faults.append(_fault(emg, name, "copy", known, f"is a copy of '{emg.names[twin]}'"))
    return tuple(faults)


def without_faults(emg: Emg, faults: Iterable[EmgFault]) -> Emg:
    """Remove faults: NaN where a channel is dead or clipped, 0 where it is negative.

    Parameters
    ----------
    emg : (samples, channels) [-]
    faults : of its channels

    Returns
    -------
    (samples, channels), 0 or more [-]
    """
    values = np.maximum(emg.values, 0.0)
    for fault in faults:
        if fault.kind in ("dead", "clipped"):
            during = (emg.time >= fault.start - 1e-9) & (emg.time <= fault.stop + 1e-9)
            values[during, emg.names.index(fault.channel)] = np.nan
    return replace(emg, values=values)


def noise_faults(emg: Emg, channels: Iterable[str] | None = None) -> tuple[EmgFault, ...]:
    """Find channels whose envelope hardly changes while others burst.

    They hold noise or hum, or their electrode is on no muscle. A contraction that is held looks the
    same, so that nothing is reported where no channel bursts.

    Parameters
    ----------
    emg : envelopes (samples, channels) [-]
    channels : to look at; None looks at all

    Returns
    -------
    faults, none for recordings shorter than a second
    """
    if len(emg) < 2 or emg.time[-1] - emg.time[0] < LONG_ENOUGH:
        return ()
    rises = {}
    for name in emg.names if channels is None else channels:
        known = emg[name][np.isfinite(emg[name])]
        if len(known) and np.ptp(known) > 0.0:
            low, high = np.percentile(known, [10.0, 95.0])
            rises[name] = float(high / max(low, 1e-9 * high))
    if max(rises.values(), default=0.0) < BURSTS:
        return ()
    highest = max(rises, key=lambda name: rises[name])
    return tuple(
        EmgFault(
            channel=name,
            kind="noise",
            start=float(emg.time[0]),
            stop=float(emg.time[-1]),
            text=(
                f"EMG channel '{name}' is noise throughout: its envelope rises to {rise:.1f} times"
                f" its rest only ('{highest}': {min(rises[highest], 999.0):.0f} times)"
            ),
        )
        for name, rise in rises.items()
        if rise < STEADY
    )


def refuse_unfit(emg: Emg, time: Array, channels: Iterable[str] | None = None) -> None:
    """Refuse EMG that no step can use with a motion.

    Parameters
    ----------
    emg : envelopes (samples, channels) [-]
    time : (frames,) of the motion [s]
    channels : that are used; None for all

    Raises
    ------
    BadData : no time in common, or every used channel is unknown throughout
    """
    start = float(time[0])
    stop = float(time[-1])
    if not len(emg) or emg.time[-1] <= start or emg.time[0] >= stop:
        has = f"runs from {emg.time[0]:g} to {emg.time[-1]:g} s" if len(emg) else "has no samples"
        raise BadData(
            f"EMG {has}, the motion from {start:g} to {stop:g} s: they have no time in common"
        )
    used = tuple(channels) if channels is not None else emg.names
    if used and not any(np.isfinite(emg[name]).any() for name in used):
        channels = ", ".join(repr(name) for name in used)
        raise BadData(f"no EMG channel has a value, of {channels}")


def rate_against(emg: Series, time: Array) -> str:
    """Compare a recording's length with the motion's, which may show that its rate is wrong.

    A recording that is a whole number of times (2 ... 10) as long or as short as the motion, to 2
    %, and starts with it, was probably sampled at another rate than is declared.

    Parameters
    ----------
    emg : at its declared rate (samples, channels)
    time : (frames,) of the motion [s]

    Returns
    -------
    a sentence, "" where nothing looks wrong
    """
    length = float(emg.time[-1] - emg.time[0])
    other = float(time[-1] - time[0])
    if min(length, other) <= 0.0 or abs(emg.time[0] - time[0]) > 0.1 * other:
        return ""
    ratio = length / other
    nearest = round(ratio) if ratio > 1.0 else 1.0 / round(1.0 / ratio)
    if not (2.0 <= max(nearest, 1.0 / nearest) <= 10.0 and abs(ratio / nearest - 1.0) <= 0.02):
        return ""
    return (
        f"EMG lasts {length:.3g} s at its {emg.rate:.4g} Hz, the motion {other:.3g} s: its rate is"
        f" probably {emg.rate * ratio:.4g} Hz"
    )


def _unknown(series: Series, name: str, column: Array) -> list[EmgFault]:
    """Report samples that are NaN in a channel (samples,)."""
    unknown = ~np.isfinite(column)
    if not unknown.any():
        return []
    what = "has no known value" if unknown.all() else f"is unknown in {_share(unknown)}"
    return [_fault(series, name, "unknown", unknown, what)]


def _dead(series: Series, name: str, column: Array, least: float) -> list[EmgFault]:
    """Find stretches without any change.

    Parameters
    ----------
    series : with the times
    name : of the channel
    column : (samples,)
    least : shortest stretch that counts [s]
    """
    steps = np.diff(column)
    still = np.concatenate(
        [[False], np.isfinite(steps) & (np.abs(steps) <= 1e-12 * np.nanmax(np.abs(column)))]
    )
    result = []
    for first, end in runs(still):
        start = float(series.time[max(first - 1, 0)])
        stop = float(series.time[end - 1])
        if stop - start >= least:
            whole = (
                " throughout" if stop - start >= 0.99 * (series.time[-1] - series.time[0]) else ""
            )
            text = (
                f"EMG channel '{name}' does not change from {start:.3f} to {stop:.3f} s{whole}:"
                " dead"
            )
            result.append(EmgFault(channel=name, kind="dead", start=start, stop=stop, text=text))
    return result


def _clipped(series: Series, name: str, column: Array) -> list[EmgFault]:
    """Report a channel (samples,) that stands at its largest or smallest value too often."""
    at = np.zeros(len(column), dtype=bool)
    for edge in (np.nanmax(column), np.nanmin(column)):
        for first, end in runs(column == edge):
            if end - first >= CLIPPED:
                at[first:end] = True
    if at.mean() < CLIPPED_SHARE:
        return []
    what = f"stands at its largest or smallest value in {_share(at)}: the amplifier clips"
    return [_fault(series, name, "clipped", at, what)]


def _cut(emg: Emg, name: str, column: Array) -> list[EmgFault]:
    """Find stretches in which an envelope (samples,) stands at its largest value."""
    result = []
    for first, end in runs(column == np.nanmax(column)):
        if emg.time[end - 1] - emg.time[first] >= CLIPPED_ENVELOPE and end - first >= CLIPPED:
            at = np.zeros(len(column), dtype=bool)
            at[first:end] = True
            result.append(
                _fault(
                    emg,
                    name,
                    "clipped",
                    at,
                    f"stands at its largest value, {column[first]:.3g}: clipped",
                )
            )
    return result


def fast_share(column: Array, rate: float) -> float:
    """Compute the share of a channel's variance above 20 Hz.

    Parameters
    ----------
    column : (samples,), NaN counted as the mean
    rate : [Hz]

    Returns
    -------
    [-]; nan where it is too short or slow to show
    """
    if len(column) < 64 or rate <= 2.0 * FAST or not np.isfinite(column).any():
        return float("nan")
    changes = np.nan_to_num(column - np.nanmean(column)) * np.hanning(len(column))
    power = np.abs(np.fft.rfft(changes)) ** 2
    return float(
        power[np.fft.rfftfreq(len(changes), 1.0 / rate) > FAST].sum() / max(power.sum(), 1e-300)
    )


def _fast(emg: Emg, name: str, column: Array) -> list[EmgFault]:
    """Report a channel (samples,) too fast for an envelope: rectified only, or raw."""
    share = fast_share(column, emg.rate)
    if not share > FAST_SHARE:
        return []
    what = (
        f"has {100.0 * share:.0f} % of its variance above {FAST:g} Hz: rectified or raw with an"
        " offset, no envelope"
    )
    return [_fault(emg, name, "fast", np.ones(len(column), dtype=bool), what)]


def _off_rate(series: Series, name: str, column: Array) -> list[EmgFault]:
    """Report a median frequency outside what surface EMG has.

    The declared rate is wrong then, or this is an envelope.

    Parameters
    ----------
    column : (samples,)
    """
    # Brings SciPy: loaded only where it is needed.
    if len(column) < 256:
        return []
    signal = np.nan_to_num(column - np.nanmean(column))
    frequencies, power = scipy.signal.welch(signal, series.rate, nperseg=min(len(signal), 1024))
    # Below 10 Hz cables move; a slow rate or an envelope has nothing else.
    heard = frequencies >= 10.0
    share = power[heard].sum() / max(power.sum(), 1e-300)
    summed = np.cumsum(np.where(heard, power, 0.0))
    median = float(frequencies[np.searchsorted(summed, 0.5 * summed[-1])]) if share > 0.05 else 0.0
    low, high = MEDIAN_FREQUENCY
    if low <= median <= high:
        return []
    what = (
        f"has a median frequency of {median:.0f} Hz at its {series.rate:.4g} Hz: the rate is wrong,"
        " or it is no raw EMG"
    )
    return [_fault(series, name, "rate", np.ones(len(column), dtype=bool), what)]


def _share(flags: np.ndarray) -> str:
    return f"{int(flags.sum())} of {len(flags)} samples"


def _fault(series: Series, name: str, kind: str, where: np.ndarray, what: str) -> EmgFault:
    """Describe a fault.

    Parameters
    ----------
    series : with the times
    name : of the channel
    kind : of the fault
    where : (samples,) whether a sample has it; reported from the first to the last
    what : is wrong, for the text
    """
    places = np.flatnonzero(where)
    start = float(series.time[places[0]])
    stop = float(series.time[places[-1]])
    return EmgFault(
        channel=name,
        kind=kind,
        start=start,
        stop=stop,
        text=f"EMG channel '{name}' {what} ({start:.3f} to {stop:.3f} s)",
    )

"""Two recordings with clocks of their own: offset and drift found from what both recorded.

A clock is a line: time on the reference clock = t + offset + drift (t - epoch). What the reference
recorded explains what the other recorded, linearly, once both are on one clock,

    other(t) = rows(t) phi + noise,

so offset and drift are those that leave the least, with phi solved for wherever they are (variable
projection, Golub and Pereyra 1973). A signal that both recorded is the case of one column and a
constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.causes import CLOCKS
from myomorph.core.model.errors import BadData
from myomorph.core.model.join import clock_difference
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.clock_lags import (
    Recorded,
    Reference,
    Refined,
    compare,
    drift_of_pieces,
    likely_lags,
    main_frequency,
    refine,
)
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.splines import natural_spline

SeriesKind = TypeVar("SeriesKind", bound=Series)
Timed = TypeVar("Timed", bound=Series | Wrenches)

PERIODS = 4.0
"""A low-pass filter at that multiple of the recording's main frequency keeps a swing and its
harmonics, and little of the noise that differentiated markers bring.
"""

SIGNIFICANT = 3.0  # Standard deviations above which a drift is named
# Another offset whose residuals are at most this many times as large makes the offset doubtful
AMBIGUOUS = 1.1


@dataclass(frozen=True)
class ClockOptions:
    """Options of the search for offset and drift.

    Attributes
    ----------
    search : largest offset either way [s]
    drift : estimate a drift as well as the offset
    cutoff : low-pass of both recordings before they are compared [Hz]; None takes `PERIODS` times
        the main frequency of the other recording
    window : length of the pieces whose lags give the first drift [s]
    block : residuals further apart than that are independent, for the standard deviations [s]
    """

    search: float = 2.0
    drift: bool = True
    cutoff: float | None = None
    window: float = 5.0
    block: float = 1.0

    def __post_init__(self) -> None:
        for name in ("search", "cutoff", "window", "block"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise BadData(f"{name} is {value:g}: expected above 0")


@read_only
class Clock:
    """A line that maps another recording's clock to the reference's.

        time on the reference clock = t + offset + drift (t - epoch)

    Attributes
    ----------
    offset : added at `epoch` [s]
    drift : added for every second after it [s/s]
    epoch : on the other's clock, the middle of what both cover, where offset and drift are
        independent [s]
    covariance : (2, 2) of offset and drift [s^2, s, 1]; zero for a clock that is specified
    length : of what both cover [s]
    explained : share of the variance of that signal which the reference explains best [-]
    cutoff : of the filter through which they were compared [Hz]
    notes : a drift that is significant, another offset that fits nearly as well
    """

    offset: float = 0.0
    drift: float = 0.0
    epoch: float = 0.0
    covariance: Array = field(default_factory=lambda: np.zeros((2, 2)))
    length: float = 0.0
    explained: float = float("nan")
    cutoff: float = float("nan")
    notes: tuple[Message, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, covariance=(2, 2))

    @property
    def offset_sd(self) -> float:
        """Standard deviation of the offset at `epoch` [s]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def drift_sd(self) -> float:
        """Standard deviation of the drift [s/s]."""
        return float(np.sqrt(self.covariance[1, 1]))

    def times(self, time: Array) -> Array:
        """Convert times of the other clock to the reference clock.

        Parameters
        ----------
        time : of any shape [s]

        Returns
        -------
        of the same shape [s]
        """
        return time + self.offset + self.drift * (time - self.epoch)

    def apply(self, series: Timed) -> Timed:
        """Put the other recording's samples at the times that the reference clock shows.

        Parameters
        ----------
        series : of the other recording

        Returns
        -------
        the same samples on the reference clock
        """
        changes: dict[str, Any] = {"time": self.times(series.time)}
        return replace(series, **changes)


def resample(series: SeriesKind, time: Array) -> SeriesKind:
    """Resample a steady recording without gaps by natural cubic splines.

    Where the new rate is below 0.9 of the old one a low-pass at 0.4 of the new rate comes first, so
    that nothing fast is mistaken for something slow (aliasing).

    Parameters
    ----------
    series : at a steady rate, without NaN
    time : (frames,) new times [s]

    Returns
    -------
    the same kind of series at `time`, NaN more than half a sample outside the recording

    Raises
    ------
    BadData : values are not finite, or there are too few of them
    """
    rate = series.rate
    wanted = (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else np.inf
    values = lowpass(series.values, rate, 0.4 * wanted) if wanted < 0.9 * rate else series.values
    resampled = natural_spline(series.time, values, degree=3)(
        np.clip(time, series.time[0], series.time[-1])
    )
    resampled[(time < series.time[0] - 0.5 / rate) | (time > series.time[-1] + 0.5 / rate)] = np.nan
    changes: dict[str, Any] = {"time": time, "values": resampled}
    return replace(series, **changes)


def fit_clock(  # page: two recordings, with what is used of them
    time: Array,
    rows: Array,
    other_time: Array,
    other: Array,
    options: ClockOptions | None = None,
    used: np.ndarray | None = None,
) -> Clock:
    """Fit the clock of a recording that is linear in what the reference recorded.

        other = rows phi,   phi unknown

    The offset starts where the lagged recordings explain each other best, the drift from the lags
    of pieces; Gauss-Newton on both follows, each signal weighted by its residual. The standard
    deviations come from the residuals block by block, so that filtered noise and errors of the
    model count for what they are.

    Source: Golub and Pereyra 1973 (variable projection).

    Parameters
    ----------
    time : (frames,) of the reference [s]
    rows : (frames, signals, parameters) of the reference; frames with NaN are not used
    other_time : (samples,) on the other's clock [s]
    other : (samples, signals) of the other recording
    options : search range, drift, filter; see `ClockOptions`
    used : (frames,) whether a frame is used; None uses all

    Returns
    -------
    clock of the other recording

    Raises
    ------
    BadData : shapes do not match, a recording is short or unsteady, the other has NaN, or the
        recordings do not explain each other at any offset within the search range
    """
    options = options or ClockOptions()
    slow = PERIODS * main_frequency(time, other_time, other)
    cutoff = options.cutoff or slow
    reference = Reference(time=time, rows=rows, used=used)
    recorded = Recorded(time=other_time, values=other)
    compared = compare(reference, recorded, cutoff)
    # Candidates are looked for where the noise of differentiation is least.
    slowly = compared if slow >= cutoff else compare(reference, recorded, slow)
    fits = []
    for lag in likely_lags(slowly, options.search):
        start = np.array([lag, 0.0])
        if options.drift:
            start = drift_of_pieces(slowly, start, options.window)
        fits.append(refine(compared, start, options.drift, options.block))
    fits.sort(key=lambda fit: fit.misfit)
    best = fits[0]
    notes = _warnings(fits)
    # The way there is s = t + a + b (t - middle); a clock is the way back.
    a, b = best.lag
    turn = np.diag([-1.0 / (1.0 + b), -1.0 / (1.0 + b) ** 2])
    clock = Clock(
        offset=float(-a),
        drift=float(-b / (1.0 + b)),
        epoch=float(compared.middle + a),
        covariance=turn @ best.covariance @ turn,
        length=best.length,
        explained=best.explained,
        cutoff=cutoff,
    )
    if abs(clock.drift) > max(SIGNIFICANT * clock.drift_sd, 1e-6):
        notes.append(
            CLOCKS.message(
                f"the clocks drift: {1e6 * clock.drift:.1f} ± {1e6 * clock.drift_sd:.1f} ppm,"
                f" {1e3 * abs(clock.drift) * clock.length:.2f} ms over {clock.length:.0f} s;"
                " corrected",
                severity="good to know",
            )
        )
    return replace(clock, notes=tuple(notes))


def _warnings(refineds: list[Refined]) -> list[Message]:
    """Describe another offset that leaves hardly more than the best, if there is one."""
    best = refineds[0]
    for other in refineds[1:]:
        if (
            other.misfit < AMBIGUOUS * best.misfit
            and abs(other.lag[0] - best.lag[0]) > 10 * best.timing_sd
        ):
            return [
                CLOCKS.message(
                    f"an offset of {-other.lag[0]:.3f} s leaves only"
                    f" {other.misfit / best.misfit:.3f} times what {-best.lag[0]:.3f} s leaves (a"
                    " swing repeats itself): narrow the search if the second is wrong"
                )
            ]
    return []


def on_one_clock(
    parts: Mapping[str, SeriesKind],
) -> tuple[dict[str, SeriesKind], tuple[Message, ...]]:
    """Resample several parts to the times of that with the highest rate, over what all cover.

    Times are taken as they are: clocks that count from different instants have to be brought
    together first (`fit_clock`). A resampled motion has no velocities: differentiate it again.

    Parameters
    ----------
    parts : motions or markers by name

    Returns
    -------
    the parts on one clock, and notes on what was resampled or cut

    Raises
    ------
    BadData : the parts have no time in common
    """
    if not clock_difference(parts):
        return dict(parts), ()
    names = list(parts)
    start = max(names, key=lambda name: parts[name].time[0])
    end = min(names, key=lambda name: parts[name].time[-1])
    begin = parts[start].time[0]
    stop = parts[end].time[-1]
    if stop <= begin:
        raise BadData(
            f"'{end}' ends at {stop:g} s and '{start}' begins at {begin:g} s: no time in common; do"
            " their clocks start at the same instant?"
        )
    fastest = max(names, key=lambda name: parts[name].rate)
    times = parts[fastest].time
    slack = 0.01 * float(np.median(np.diff(times)))
    times = times[(times >= begin - slack) & (times <= stop + slack)]
    shifted = {}
    notes = []
    for name, part in parts.items():
        shifted[name] = _at(part, times)
        if name != fastest:
            notes.append(
                CLOCKS.message(
                    f"'{name}' ({part.rate:.4g} Hz) is resampled to the times of '{fastest}'"
                    f" ({parts[fastest].rate:.4g} Hz)",
                    severity="good to know",
                )
            )
        lost = len(part) - int(
            ((part.time >= times[0] - slack) & (part.time <= times[-1] + slack)).sum()
        )
        if lost:
            notes.append(
                CLOCKS.message(
                    f"'{name}' loses {lost} of {len(part)} frames, from before {begin:g} or after"
                    f" {stop:g} s",
                    severity="good to know",
                )
            )
    return shifted, tuple(notes)


def _at(series: SeriesKind, time: Array) -> SeriesKind:
    """Interpolate columns at other times.

    Columns without gaps follow splines, others straight lines between neighbors that are both seen.

    Parameters
    ----------
    series : of any kind
    time : (frames,) [s]
    """
    if isinstance(series, Motion):
        series = replace(series, velocities=None, accelerations=None)
    if np.isfinite(series.values).all():
        return resample(series, time)
    flat = series.values.reshape(len(series), -1)
    columns = [np.interp(time, series.time, column) for column in flat.T]
    return replace(
        series, time=time, values=np.array(columns).T.reshape(len(time), *series.values.shape[1:])
    )

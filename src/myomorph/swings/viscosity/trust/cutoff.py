"""The low-pass filter of a swing: its cutoff, and what the results make of others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import welch

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.motion.filters import lowpass
from myomorph.swings.viscosity.identification.condition import solve_blocks
from myomorph.swings.viscosity.identification.identify import ViscosityOptions
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import swing_sums
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen

SCANNED = (3.0, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0)  # Cutoffs whose results are compared [Hz].
MIN_CUTOFF = 4.0
MAX_CUTOFF = 20.0  # Between which a cutoff is chosen [Hz].
# Share of the examined frequencies, the upper ones, where residuals are taken for noise alone.
NOISY = 0.5
ABOVE = 4.0  # How far a spectrum must rise above its noise to count as motion.
WRENCH = ("moment x", "moment y", "moment z", "force x", "force y", "force z")


@dataclass(frozen=True)
class FilterOptions:
    """The low-pass of motion and wrench.

    Attributes
    ----------
    cutoff : cutoff frequency of the low-pass filter of motion and wrench [Hz]; by default chosen by
        residual analysis of the recordings
    """

    cutoff: float | None = None

    def __post_init__(self) -> None:
        if self.cutoff is not None and not self.cutoff > 0.0:
            raise BadData(f"cutoff of motion and wrench is {self.cutoff:g} Hz: expected above 0")


@read_only
class Residuals:
    """Residual analysis of one signal (Winter 2009, section 3.4.4.3).

    Attributes
    ----------
    name : of the signal
    cutoffs : (n,) [Hz]
    residual : (n,) root mean square of signal less filtered signal
    noise : what the straight line through the upper cutoffs says at 0 Hz
    cutoff : lowest at which the residual is no more than that: as much signal is lost as noise is
        let through [Hz]
    band : highest frequency at which the spectrum stands above that of the noise [Hz]
    """

    name: str
    cutoffs: Array
    residual: Array
    noise: float
    cutoff: float
    band: float


class CutoffChoice(NamedTuple):
    """A cutoff for motion and wrench.

    Attributes
    ----------
    cutoff : the highest that any signal asks for, within `MIN_CUTOFF` and `MAX_CUTOFF` [Hz]
    reason : in words
    """

    cutoff: float
    reason: str


def residual_analysis(name: str, parts: Sequence[Array], rate: float) -> Residuals:
    """Find residual and spectrum of one signal over cutoffs to a fifth of its rate.

    Parameters
    ----------
    name : of the signal
    parts : (frames,) each, unbroken
    rate : [Hz]

    Returns
    -------
    the analysis

    Raises
    ------
    BadData : no part lasts 2 s
    """
    parts = [part - part.mean() for part in parts if len(part) >= 2.0 * rate]
    if not parts:
        raise BadData(
            f"the cutoff of '{name}' needs 2 s without gaps at once: record longer, or give a"
            " cutoff"
        )
    cutoffs = rate / 200.0 * np.arange(1.0, 41.0)
    square = [
        sum(np.square(part - lowpass(part, rate, fc)).sum() for part in parts) for fc in cutoffs
    ]
    residual = np.sqrt(np.array(square) / sum(len(part) for part in parts))
    upper = cutoffs > NOISY * cutoffs[-1]
    noise = max(float(np.polyfit(cutoffs[upper], residual[upper], 1)[1]), float(residual[-1]))
    cutoff = float(cutoffs[residual <= noise][0])
    length = min(int(4.0 * rate), min(len(part) for part in parts))
    spectra = [welch(part, rate, "hann", length) for part in parts]
    frequency = spectra[0][0]
    power = np.average([p for _, p in spectra], axis=0, weights=[len(part) for part in parts])
    above = frequency[power > ABOVE * noise**2 / (0.5 * rate)]
    return Residuals(
        name=name,
        cutoffs=cutoffs,
        residual=residual,
        noise=noise,
        cutoff=cutoff,
        band=float(above.max(initial=0.0)),
    )


def choose_cutoff(conditions: Sequence[TrackedSpecimen]) -> CutoffChoice:
    """Choose one cutoff for motion and wrench of all conditions.

    A difference between conditions is then not the filter's. A low-pass leaves an equation as it is
    as long as both its sides pass the same filter; what it may not do is bend the motion, from
    which the sides are made by products. So the cutoff is the highest that the residual analysis of
    any joint coordinate or component of the wrench asks for.

    Parameters
    ----------
    conditions : tracked

    Raises
    ------
    BadData : there is no trial, or none is long enough
    """
    tracked = [trial for condition in conditions for trial in condition.trials]
    if not tracked:
        raise BadData("no trial of the swinging limb is given")
    names = (*conditions[0].specimen.joint_coordinates, *WRENCH)
    columns = zip(
        *(np.hstack([trial.motion.values, trial.wrench]).T for trial in tracked), strict=True
    )
    signals = []
    for name, column in zip(names, columns, strict=True):
        parts = [
            values[start:stop] for values in column for start, stop in runs(np.isfinite(values))
        ]
        signals.append(residual_analysis(name, parts, tracked[0].motion.rate))
    return choice_of(signals)


def choice_of(signals: Sequence[Residuals]) -> CutoffChoice:
    """Choose the cutoff that the most demanding of the signals asks for.

    Parameters
    ----------
    signals : analysed
    """
    most = max(signals, key=lambda signal: signal.cutoff)
    cutoff = float(np.clip(most.cutoff, MIN_CUTOFF, MAX_CUTOFF))
    limit = "" if cutoff == most.cutoff else f", kept within {MIN_CUTOFF:g} and {MAX_CUTOFF:g} Hz"
    asked = (
        f"residual analysis asks for {most.cutoff:g} Hz in '{most.name}'{limit}, for less in all"
        " others"
    )
    spectrum = f"the spectrum of '{most.name}' stands above its noise up to {most.band:.2g} Hz"
    reason = f"cut-off {cutoff:g} Hz: {asked}; {spectrum}"
    return CutoffChoice(cutoff, reason)


def scan_cutoffs(
    recordings_at: Callable[[float], Sequence[SwingRecording]],
    cutoffs: Sequence[float] = SCANNED,
    options: ViscosityOptions | None = None,
) -> Array:
    """Identify a condition at other cutoffs.

    Parameters
    ----------
    recordings_at : recordings by cutoff [Hz]
    cutoffs : [Hz]
    options : of the identification

    Returns
    -------
    (cutoffs, 3) mass [kg], distance of the mass center from the joint [m] and one viscosity
    [N m s/rad]; NaN where a cutoff leaves nothing to identify
    """
    options = options or ViscosityOptions()
    rows = np.full((len(cutoffs), 3), np.nan)
    for row, cutoff in zip(rows, cutoffs, strict=True):
        with suppress(MyomorphError):
            row[:] = _identified(recordings_at(cutoff), options)
    return rows


def _identified(recordings: Sequence[SwingRecording], options: ViscosityOptions) -> Array:
    """Mass, mass center and viscosity, without what intervals take."""
    sums = swing_sums(recordings, options.block, options.min_relative_speed)
    whole = solve_blocks(sums, np.ones(len(sums)), options, options.stiffness is not False)
    return np.array([whole.inertia.mass, whole.inertia.com, whole.joint.one])

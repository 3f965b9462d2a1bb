"""Joint torques of motions whose noise and filters are known: the default, fixed cutoffs, before.

Real motions are made smooth and taken as truth, as splines of fifth degree. Noise, resampling by
splines, filters of cameras and gaps are put in by scipy. Motions and seeds of the rows "kept apart"
were not looked at while the model was made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

import myomorph as mm
from benchmarks.accuracy.kinematics.white_noise_cutoff import white_noise_cutoff
from benchmarks.recordings import RECORDINGS, read_markers
from myomorph.core.model.arrays import Array, runs
from myomorph.core.motion.turns import floating_coordinates

FIXED = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 14.0, 17.0, 20.0, 25.0, 30.0)
NOISES = (0.5, 3.0)  # Standard deviations [mrad], and of translations [mm]
WORKING_SEEDS = (0,)
KEPT_SEEDS = (211, 307)
LONG = 30.0  # Of long walks [s]
Row = dict[str, object]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """A recorded motion that is made smooth.

    Attributes
    ----------
    recording : of `RECORDINGS`
    cutoff : of the filter that makes it smooth [Hz]
    rate : of the frames that are made of it [Hz]
    start, stop : what is used of it [s]
    kept : whether it was kept apart
    long : whether it is used for long walks alone
    """

    recording: str
    cutoff: float
    rate: float = 100.0
    start: float = 0.0
    stop: float = 1e9
    kept: bool = False
    long: bool = False


TRUTHS = (
    Truth(recording="implant-1", cutoff=12.0),
    Truth(recording="opencap-walk", cutoff=12.0),
    Truth(recording="run-2", cutoff=20.0),
    Truth(recording="opencap-jump", cutoff=20.0),
    Truth(recording="shoulder", cutoff=8.0, stop=4.0),
    Truth(recording="gait2354-dynamics", cutoff=12.0, kept=True),
    Truth(recording="implant-3", cutoff=12.0, kept=True),
    Truth(recording="gait2392", cutoff=12.0, start=5.0, stop=9.0, kept=True),
    Truth(recording="treadmill", cutoff=12.0, start=2.0, stop=6.0, kept=True),
    Truth(recording="lenhart", cutoff=12.0, kept=True),
    Truth(recording="run-5", cutoff=20.0, rate=200.0, kept=True),
    Truth(recording="opencap-rise", cutoff=8.0, stop=5.0, kept=True),
    Truth(recording="gait2392", cutoff=12.0, start=5.0, stop=5.0 + LONG, long=True),
    Truth(recording="treadmill", cutoff=12.0, start=2.0, stop=2.0 + LONG, kept=True, long=True),
)


@dataclass(frozen=True, kw_only=True)
class Variant:
    """What is done to a motion.

    Attributes
    ----------
    name : of the row
    coloured : noise is an autoregression of 0.9 a frame, else white
    splined : frames for each one that was recorded
    smoothed : low-pass of the camera's software, both ways [Hz]; 0 for none
    empty_every : every so many frames one is empty; 0 for none
    empty : frames in a row that are empty in the middle
    frames : that are left in the middle; 0 for all
    travel : speed added to the first translation [m/s]
    noise_share : of the noise; 0 for none
    wobble : noise whose power falls as 1 / f, as of skin, from 1 Hz on
    software : another smoothing of the recording: "Savitzky-Golay", or "spline" of least
        cross-validated error; "" for none
    lost : share of the frames that are lost, up to five in a row
    long : of walks of half a minute
    """

    name: str
    coloured: bool = False
    splined: int = 1
    smoothed: float = 0.0
    empty_every: int = 0
    empty: int = 0
    frames: int = 0
    travel: float = 0.0
    noise_share: float = 1.0
    wobble: bool = False
    software: str = ""
    lost: float = 0.0
    long: bool = False


VARIANTS = (
    Variant(name="white"),
    Variant(name="AR 0.9", coloured=True),
    Variant(name="splined x2", splined=2),
    Variant(name="splined x2, AR", splined=2, coloured=True),
    Variant(name="splined x10", splined=10),
    Variant(name="smoothed at 12 Hz", smoothed=12.0),
    Variant(name="smoothed at 15 Hz", smoothed=15.0),
    Variant(name="smoothed at 20 Hz", smoothed=20.0),
    Variant(name="smoothed at 30 Hz", smoothed=30.0),
    Variant(name="smoothed at 20 Hz, AR", smoothed=20.0, coloured=True),
    Variant(name="smoothed by Savitzky and Golay", software="Savitzky-Golay"),
    Variant(name="smoothed by a spline", software="spline"),
    Variant(name="1/f, as skin wobbles", wobble=True),
    Variant(name="a tenth of the frames lost", lost=0.1),
    Variant(name="30 s on a belt", long=True),
    Variant(name="30 s over ground", long=True, travel=1.3),
    Variant(name="one empty frame in 29", empty_every=29),
    Variant(name="one empty frame", empty=1),
    Variant(name="5 empty frames", empty=5),
    Variant(name="clip of 20 frames", frames=20),
    Variant(name="clip of 60 frames", frames=60),
    Variant(name="travel of 1.3 m/s", travel=1.3),
    Variant(name="no noise", noise_share=0.0),
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A motion with errors, and the torques without."""

    model: mm.Model
    recorded: mm.Motion
    filled: mm.Motion
    torques: Array
    turning: np.ndarray

    def error(self, motion: mm.Motion) -> float:
        """Root mean square error of the torques at joints in frames that have one [N m]."""
        found = mm.inverse_dynamics(self.model, motion).values[:, self.turning]
        return float(np.sqrt(np.nanmean((found - self.torques) ** 2)))


def by_default(case: Case) -> mm.Motion:
    """Smooth as the product does by default."""
    return mm.smooth_motion(case.recorded, case.model).motion


def as_before(case: Case) -> mm.Motion:
    """Filter as the product did before: cut in two at every gap."""
    return mm.differentiate(case.recorded, white_noise_cutoff(case.recorded))


def at_six(case: Case) -> mm.Motion:
    """Filter at 6 Hz, gaps filled."""
    return mm.differentiate(case.filled, 6.0)


RULES: dict[str, Callable[[Case], mm.Motion]] = {
    "default": by_default,
    "before": as_before,
    "6 Hz": at_six,
}


def measure(folder: Path) -> Iterator[Row]:
    """Errors over those of the best fixed cutoff, by variant, for motions and seeds kept apart."""
    yield from table(folder, kept=True, seeds=KEPT_SEEDS)


def table(folder: Path, *, kept: bool, seeds: tuple[int, ...]) -> Iterator[Row]:
    """Rows by variant, the last of all together."""
    motions = {truth: opened(folder, truth) for truth in TRUTHS if truth.kept == kept}
    together: list[dict[str, float]] = []
    for variant in VARIANTS:
        errors = []
        for motion in (one for truth, one in motions.items() if truth.long == variant.long):
            for noise in NOISES if variant.noise_share else NOISES[:1]:
                errors += [
                    errors_of(motion.recorded(variant, 1e-3 * noise, seed)) for seed in seeds
                ]
        together += errors
        yield {"recorded as": variant.name} | summary(errors)
    yield {"recorded as": "all"} | summary(together)


def errors_of(case: Case) -> dict[str, float]:
    """Errors of each rule, and of the best fixed cutoff [N m]."""
    errors = {name: case.error(rule(case)) for name, rule in RULES.items()}
    fixed = [case.error(mm.differentiate(case.filled, cutoff)) for cutoff in (*FIXED, None)]
    return errors | {"best fixed": min(fixed)}


def summary(errors: list[dict[str, float]]) -> Row:
    """Geometric means and worst of ratios to the best fixed cutoff."""
    row: Row = {"cases": len(errors)}
    best = np.array([error["best fixed"] for error in errors])
    row["best fixed [N m]"] = float(np.exp(np.log(best).mean()))
    for name in RULES:
        ratios = np.array([error[name] for error in errors]) / best
        row[name] = float(np.exp(np.log(ratios).mean()))
        row[f"{name}, worst"] = float(ratios.max())
    ours = np.array([error["default"] for error in errors])
    former = np.array([error["before"] for error in errors])
    row["worse than before by a tenth"] = int((ours > 1.1 * former).sum())
    return row


@dataclass(frozen=True, kw_only=True)
class Smooth:
    """A smooth motion that is taken as truth.

    Attributes
    ----------
    model, names : the body and the coordinates that move
    spline : of the coordinates over time, from 0 on
    duration : [s]
    rate : of the frames [Hz]
    """

    model: mm.Model
    names: tuple[str, ...]
    spline: scipy.interpolate.BSpline
    duration: float
    rate: float

    def recorded(self, variant: Variant, noise: float, seed: int) -> Case:
        """Make a recording of it, with noise of a standard deviation [rad or m]."""
        coarse = np.arange(0.0, self.duration, 1.0 / self.rate)
        travel = self._travel(variant)
        values = self._noisy(coarse, variant, noise, seed) + coarse[:, None] * travel
        time = np.linspace(0.0, coarse[-1], variant.splined * (len(coarse) - 1) + 1)
        if variant.splined > 1:
            values = scipy.interpolate.CubicSpline(coarse, values)(time)
        if variant.smoothed:
            # Both ways halve the power of a pass at a frequency 0.802 of that where one does.
            fast = variant.smoothed / 0.802
            sections = scipy.signal.butter(2, fast, fs=1.0 / (time[1] - time[0]), output="sos")
            values = scipy.signal.sosfiltfilt(sections, values, axis=0)
        values = _smoothed(variant, time, values)
        half = variant.frames // 2 or len(time)
        middle = slice(max(len(time) // 2 - half, 0), len(time) // 2 + half)
        time = time[middle]
        values = values[middle].copy()
        values[_empty(variant, len(time), seed)] = np.nan
        return self._case(time, values, travel)

    def _travel(self, variant: Variant) -> Array:
        """Speeds (coordinates,) that are added [m/s]."""
        slides = [self.model.coordinate(name).motion == "translational" for name in self.names]
        travel = np.zeros(len(self.names))
        travel[np.flatnonzero(slides)[:1]] = variant.travel
        return travel

    def _noisy(self, time: Array, variant: Variant, noise: float, seed: int) -> Array:
        """Coordinates (frames, coordinates) with noise on those that move."""
        true = self.spline(time)
        moves = np.ptp(true, axis=0) > 1e-9
        random = np.random.default_rng(seed)
        errors = _noise(random, true.shape, variant.coloured)
        if variant.wobble:
            errors = _wobble(random, true.shape, self.rate)
        return np.asarray(true + noise * variant.noise_share * errors * moves)

    def _case(self, time: Array, values: Array, travel: Array) -> Case:
        """Put a recording (frames, coordinates) beside the torques without errors."""
        exact = mm.Motion(
            time=time,
            names=self.names,
            values=self.spline(time) + time[:, None] * travel,
            velocities=self.spline(time, 1) + travel,
            accelerations=self.spline(time, 2),
        )
        floating = floating_coordinates(self.model)
        turning = np.array(
            [
                each.motion == "rotational" and each.name not in floating
                for each in self.model.coordinates
            ]
        )
        return Case(
            model=self.model,
            recorded=mm.Motion(time, self.names, values),
            filled=mm.Motion(time, self.names, _filled(time, values)),
            torques=mm.inverse_dynamics(self.model, exact).values[:, turning],
            turning=turning,
        )


def opened(folder: Path, truth: Truth) -> Smooth:
    """Open a recording and make its motion smooth."""
    files = RECORDINGS[truth.recording]
    model = mm.read_model(folder / files.model)
    if files.motion:
        motion = mm.read_motion(folder / files.motion, model)
    else:
        motion = mm.inverse_kinematics(model, read_markers(folder / files.markers)).motion
    seen = np.isfinite(motion.values).all(axis=1)
    seen &= (motion.time >= truth.start) & (motion.time <= truth.stop)
    start, stop = max(runs(seen), key=lambda run: run[1] - run[0])
    time = motion.time[start:stop]
    even = np.linspace(time[0], time[-1], len(time))
    values = scipy.interpolate.CubicSpline(time, motion.values[start:stop])(even)
    rate = (len(time) - 1) / (time[-1] - time[0])
    if truth.cutoff < 0.45 * rate:
        sections = scipy.signal.butter(4, truth.cutoff, fs=rate, output="sos")
        values = scipy.signal.sosfiltfilt(sections, values, axis=0)
    return Smooth(
        model=model,
        names=motion.names,
        spline=scipy.interpolate.make_interp_spline(even - even[0], values, k=5),
        duration=float(even[-1] - even[0]),
        rate=truth.rate,
    )


def _noise(random: np.random.Generator, shape: tuple[int, int], coloured: bool) -> Array:
    """Noise of variance 1, white or alike from frame to frame by 0.9."""
    white = random.standard_normal(shape)
    if not coloured:
        return white
    white[1:] *= np.sqrt(1.0 - 0.9**2)
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -0.9], white, axis=0))


def _wobble(random: np.random.Generator, shape: tuple[int, int], rate: float) -> Array:
    """Noise of variance 1 whose power falls as 1 / f from 1 Hz on; steady below."""
    frequency = np.fft.rfftfreq(shape[0], 1.0 / rate)
    gain = 1.0 / np.sqrt(np.maximum(frequency, 1.0))
    white = np.fft.rfft(random.standard_normal(shape), axis=0)
    noise = np.fft.irfft(gain[:, None] * white, shape[0], axis=0)
    return np.asarray(noise / noise.std(axis=0))


def _smoothed(variant: Variant, time: Array, values: Array) -> Array:
    """Smooth values (frames, coordinates) as another laboratory's software does."""
    if variant.software == "Savitzky-Golay":
        window = 2 * round(0.07 / (time[1] - time[0])) + 1
        return np.asarray(scipy.signal.savgol_filter(values, window, 3, axis=0))
    if variant.software == "spline":
        moving = np.ptp(values, axis=0) > 1e-9
        smooth = values.copy()
        for column in np.flatnonzero(moving):
            spline = scipy.interpolate.make_smoothing_spline(time, values[:, column])
            smooth[:, column] = spline(time)
        return smooth
    return values


def _empty(variant: Variant, frames: int, seed: int) -> np.ndarray:
    """Mark the frames (frames,) that are empty."""
    empty = np.zeros(frames, bool)
    random = np.random.default_rng(1000 + seed)
    while empty.mean() < variant.lost:
        # The ends stay, as a clip would be cut there.
        start = int(random.integers(5, max(frames - 10, 6)))
        empty[start : start + int(random.integers(1, 6))] = True
    if variant.empty_every:
        empty[variant.empty_every // 2 :: variant.empty_every] = True
    empty[frames // 2 : frames // 2 + variant.empty] = True
    return empty


def _filled(time: Array, values: Array) -> Array:
    """Fill gaps as programs of cameras do, by a cubic spline through all that was seen."""
    seen = np.isfinite(values).all(axis=1)
    if seen.all():
        return values
    return np.asarray(scipy.interpolate.CubicSpline(time[seen], values[seen])(time))

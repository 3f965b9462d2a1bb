"""How long steps will take: by an earlier run of the study, else by what this machine has learned, else by a table."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from myomorph.study.plan.subject_tables import declared, study_steps
from myomorph.study.run.learned_times import RUN, TRIAL, Sample, read_samples, settings_key, times_file

RATES = Path(__file__).with_name("step_rates.csv")
"""What steps took on the machine of the benchmark, `python -m benchmarks rates`."""

BEGINS, EACH = 4.0, 0.1
"""What a run takes besides its steps, on the machine of the rates: to begin and to write the study's page, and for each
trial there [s]."""

STARTS = 1.0
"""Of that, what passes before the run knows the time [s]."""

OPENS = 0.3
"""What a trial takes besides its steps there [s]."""

NEAREST = 9
"""Samples of this machine that count: those whose frames and models are the most alike, the latest of these first."""

COMPILES = {False: 18.0, True: 43.0}
"""What compiling the kernels takes there once, without and with those of muscles [s]."""

REFERENCE = 3.0e-3
"""Seconds of `_work` there."""

COLUMNS = ("step", "coordinates", "muscles", "seconds", "seconds_per_frame")


@dataclass(frozen=True)
class ModelSize:
    """What the time of a step depends on."""

    coordinates: int
    muscles: int


@dataclass(frozen=True)
class Expected:
    """A time that a step will take.

    Attributes
    ----------
    seconds : None where nothing tells
    measured : an earlier run on this machine tells, rather than another machine
    """

    seconds: float | None
    measured: bool


@dataclass(frozen=True)
class _Timing:
    """What a step took in an earlier run."""

    subject: str
    trial: str
    step: str
    frames: int
    seconds: float


class StepTimes:
    """Times of an earlier run, of this machine, and rates for steps that neither did.

    Parameters
    ----------
    timings : table of an earlier run (subject, trial, step, frames, seconds, compiled), which need not exist
    learned : times of all runs on this machine, see `Learning`; None for no such table
    """

    def __init__(self, timings: Path | None = None, learned: Path | None = None):
        self._timings = [] if timings is None else _read_timings(timings)
        self._last = {(timing.subject, timing.trial, timing.step): timing for timing in self._timings}
        self._rates = _read_rates()
        self._learned: dict[str, list[Sample]] = {}
        for sample in reversed(read_samples(learned)):
            self._learned.setdefault(sample.step, []).append(sample)
        self._each = {
            step: _median(one.seconds / one.frames for one in self._of(step) if one.frames) for step in study_steps()
        }
        self._whole = {step: _median(one.seconds for one in self._of(step) if not one.frames) for step in study_steps()}

    @classmethod
    def here(cls, timings: Path) -> StepTimes:
        """Of a folder of results, and of this machine."""
        return cls(timings, times_file())

    def _of(self, step: str) -> list[_Timing]:
        return [timing for timing in self._timings if timing.step == step]

    def expected(
        self,
        subject: str,
        trial: str,
        step: str,
        frames: int | None,
        size: ModelSize | None,
        settings: Mapping[str, object] | None = None,
        first: bool = False,
    ) -> Expected:
        """The time of a step of a trial, or of a subject's own (`trial` "").

        Parameters
        ----------
        frames : None where it is not known
        size : of the model, None where it is not known
        settings : of the step
        first : whether its process has done nothing before
        """
        last = self._last.get((subject, trial, step))
        if last is not None:
            share = frames / last.frames if frames and last.frames else 1.0
            return Expected(last.seconds * share, True)
        each, whole = self._each.get(step), self._whole.get(step)
        if each is not None and frames is not None:
            return Expected(each * frames, True)
        if whole is not None:
            return Expected(whole, True)
        guessed = self._guess(step, frames, size)
        here = self._by_machine(step, frames, size, settings_key(settings or {}), first)
        if here is not None:
            return here
        return Expected(None if guessed is None else self.speed * guessed, False)

    def _by_machine(
        self, step: str, frames: int | None, size: ModelSize | None, settings: str, first: bool
    ) -> Expected | None:
        """By how many times as long as the table says this machine took for the most alike of its samples."""
        known = self._learned.get(step, [])
        own = [one for one in known if one.settings == settings]
        # Other settings may change a time many times over: they tell less than nothing but a guess.
        told = bool(own)
        found = [one for one in own if bool(one.first) == first] or own or known
        if not found or frames is None:
            return None
        wanted = math.log(max(frames, 1))
        muscles = size.muscles if size is not None else 0

        def unlike(sample: Sample) -> float:
            return abs(math.log(max(sample.frames, 1)) - wanted) + abs(math.log((1 + sample.muscles) / (1 + muscles)))

        nearest = sorted(found, key=unlike)[:NEAREST]
        here = self._guess(step, frames, size)
        ratios = []
        for one in nearest:
            there = self._guess(step, one.frames, ModelSize(one.coordinates, one.muscles))
            if here is not None and there:
                ratios.append(here * one.seconds / there)
            else:
                ratios.append(one.seconds * max(frames, 1) / max(one.frames, 1))
        return Expected(_median(ratios), told)

    def opens(self, frames: int | None, first: bool) -> float:
        """What a trial takes besides its steps [s]."""
        known = self._learned.get(TRIAL, [])
        found = [one for one in known if bool(one.first) == first] or known
        if not found:
            return OPENS * self.speed
        wanted = math.log(max(frames or 1, 1))
        nearest = sorted(found, key=lambda one: abs(math.log(max(one.frames, 1)) - wanted))[:NEAREST]
        return _median(one.seconds for one in nearest) or 0.0

    @cached_property
    def speed(self) -> float:
        """How many times as long as on the machine of the rates a step takes here, by a short piece of work."""
        return min(max(min(_work() for _ in range(20)) / REFERENCE, 0.3), 5.0)

    def begins(self, trials: int) -> float:
        """What a run takes besides its trials [s]."""
        usual = BEGINS - STARTS + EACH * trials
        known = self._learned.get(RUN, [])[:NEAREST]
        ratio = _median(one.seconds / (BEGINS - STARTS + EACH * one.frames) for one in known)
        return STARTS * self.speed + usual * (self.speed if ratio is None else ratio)

    def compiles(self, muscles: bool) -> float:
        """What the first run on this machine takes longer [s]; 0 where the kernels are there already.

        Parameters
        ----------
        muscles : whether steps need those of muscles, too
        """
        # Brings Numba: a study that is only read starts without.
        from myomorph.study.trial.ahead import cached, motion_cached

        there = motion_cached() and (not muscles or cached() or cached(frozenset({"surfaces"})))
        return 0.0 if there else COMPILES[muscles] * self.speed

    def _guess(self, step: str, frames: int | None, size: ModelSize | None) -> float | None:
        """By the rates of the models whose sizes are next."""
        rates = self._rates.get(step)
        if not rates or frames is None or size is None:
            return None
        own = getattr(size, declared(step).grows_with)
        sizes, fixed, each = (np.array(column) for column in zip(*rates, strict=True))
        # Beyond the largest the time is taken to grow with the size.
        beyond = max(own / sizes[-1], 1.0) if sizes[-1] > 0 else 1.0
        return float(np.interp(own, sizes, fixed) + np.interp(own, sizes, each) * frames * beyond)


def _work() -> float:
    """Seconds of a piece of work as steps and reports do it most: numbers into text, and tables."""
    started, found = time.perf_counter(), dict[str, int]()
    for i in range(4000):
        text = f"{0.37 * i:.4g}"
        found[text] = found.get(text, 0) + len(text)
    ",".join(sorted(found))
    return time.perf_counter() - started


def _median(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.median(found)) if found else None


def _read_timings(path: Path) -> list[_Timing]:
    """Lines of a table of times; what is damaged, as by a run that was cut off, is passed over."""
    result = []
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream):
                try:
                    frames, seconds = int(row["frames"]), float(row["seconds"])
                    compiled = row.get("compiled") == "1"
                except (KeyError, TypeError, ValueError):
                    continue
                # What was compiled once is not compiled again.
                if math.isfinite(seconds) and seconds >= 0.0 and not compiled:
                    result.append(_Timing(row["subject"], row["trial"], row["step"], frames, seconds))
    except (OSError, UnicodeDecodeError, csv.Error):
        return []
    return result


def _read_rates() -> dict[str, list[tuple[float, float, float]]]:
    """Size, seconds and seconds a frame by step, in the order of sizes."""
    found: dict[str, list[tuple[float, float, float]]] = {}
    with RATES.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            size = float(row[declared(row["step"]).grows_with])
            found.setdefault(row["step"], []).append((size, float(row["seconds"]), float(row["seconds_per_frame"])))
    return {step: sorted(rates) for step, rates in found.items()}


def in_words(seconds: float) -> str:
    """A time as one would say it: "0.4 s", "12 s", "3 min 20 s", "2 h 5 min"."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min"


def together(times: Sequence[Expected]) -> Expected:
    """The sum of times; None where nothing tells one of them."""
    known = [time.seconds for time in times if time.seconds is not None]
    return Expected(sum(known) if len(known) == len(times) else None, all(time.measured for time in times))

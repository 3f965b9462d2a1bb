"""What steps took on this machine, kept in the user's cache folder: a dry run of any study learns from it."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from myomorph.rigid.kernels import kernel_folder
from myomorph.store.outcome import Key, Outcome
from myomorph.study.plan.plan import Plan

VARIABLE = "MYOMORPH_STEP_TIMES"
"""Names another file, or none where it is empty."""

FILE = "step_times.csv"
MAX_SAMPLES = 3000
"""Lines that are kept, the last ones."""

TRIAL, RUN = "(trial)", "(run)"
"""In the place of a step: what a trial takes besides its steps, and a run besides its trials."""


@dataclass(frozen=True)
class Sample:
    """What a step took once.

    Attributes
    ----------
    settings : of the step, as `settings_key` has them
    coordinates, muscles : of the model, 0 where it is not known
    frames : of the trial, or of all trials of a subject's own step; of a run the count of its trials
    first : whether its process had done no job before, so that it also loaded programs and kernels
    """

    step: str
    settings: str
    coordinates: int
    muscles: int
    frames: int
    first: int
    seconds: float


NAMES = tuple(field.name for field in fields(Sample))


def times_file() -> Path | None:
    """Where times of this machine are kept; None where they are not to be."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named) if named else None
    return kernel_folder().parent / FILE


def settings_key(settings: Mapping[str, object]) -> str:
    """Settings of a step in a few letters, "" where there are none."""
    if not settings:
        return ""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def read_samples(path: Path | None) -> list[Sample]:
    """Lines of the file in their order; damaged ones are passed over."""
    samples: list[Sample] = []
    if path is None:
        return samples
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream):
                with suppress(KeyError, TypeError, ValueError):
                    coordinates, muscles, frames, first = (int(row[name]) for name in NAMES[2:6])
                    seconds = float(row["seconds"])
                    if math.isfinite(seconds) and seconds >= 0.0:
                        size = (coordinates, muscles, frames, first)
                        samples.append(Sample(row["step"], row["settings"], *size, seconds))
    except (OSError, UnicodeDecodeError, csv.Error):
        return []
    return samples


def keep_samples(path: Path | None, samples: Sequence[Sample]) -> None:
    """Add lines to the file; that it cannot be written stops nothing."""
    if path is None or not samples:
        return
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        known = read_samples(path)
        if path.is_file() and known and len(known) + len(samples) <= MAX_SAMPLES:
            with path.open("a", encoding="utf-8", newline="") as stream:
                stream.write(_lines(samples))
            return
        kept = [*known, *samples][-MAX_SAMPLES // 2 :]
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        temporary.write_text(",".join(NAMES) + "\n" + _lines(kept), encoding="utf-8")
        os.replace(temporary, path)


def _lines(samples: Iterable[Sample]) -> str:
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerows([*astuple(sample)[:-1], f"{sample.seconds:.4g}"] for sample in samples)
    return text.getvalue()


@dataclass
class Learning:
    """Hears what jobs took, and keeps it at the end of a run that was not interrupted.

    Jobs during which kernels were compiled tell nothing about steps, and are left out.

    Attributes
    ----------
    side : jobs that run side by side
    sizes : coordinates and muscles of the models that were read, by file
    """

    plan: Plan
    side: int
    sizes: dict[Path, tuple[int, int]] = field(default_factory=dict)
    compiled: set[Key] = field(default_factory=set)
    _before: dict[Key, int] = field(default_factory=dict)
    _first: set[Key] = field(default_factory=set)
    _begun: float = field(default_factory=time.monotonic)

    @cached_property
    def _file(self) -> Path | None:
        return times_file()

    def started(self, key: Key) -> None:
        """A job begins."""
        if len(self._before) < self.side:
            self._first.add(key)
        self._before[key] = _kernels()

    def ended(self, outcome: Outcome) -> None:
        """A job has ended."""
        if self._before.get(outcome.key, -1) != _kernels() and outcome.key in self._before:
            self.compiled.add(outcome.key)

    def keep(self, outcomes: Mapping[Key, Outcome]) -> None:
        """Keep what the run took, all its jobs and tables done."""
        if self._file is None or any(one.error for one in outcomes.values()):
            return
        wall = time.monotonic() - self._begun
        samples = [sample for outcome in outcomes.values() for sample in self._samples(outcome, outcomes)]
        spent = [one.seconds for one in outcomes.values()]
        if samples and not self.compiled:
            work = max(sum(spent) / max(min(self.side, len(spent)), 1), max(spent, default=0.0))
            samples.append(Sample(RUN, "", 0, 0, len(self.plan.trials), 1, max(wall - work, 0.0)))
        keep_samples(self._file, samples)

    def _samples(self, outcome: Outcome, outcomes: Mapping[Key, Outcome]) -> list[Sample]:
        if not outcome.timed or outcome.key in self.compiled or outcome.key not in self._before:
            return []
        settings: Any = self.plan.settings_of(outcome.subject, outcome.trial)
        frames = outcome.frames
        if not outcome.trial:
            frames = sum(one.frames for key, one in outcomes.items() if key[0] == outcome.subject and key[1])
        models = [trial.model for trial in self.plan.trials if trial.subject == outcome.subject]
        # A model that the subject's own steps make has the size of the one it was made of.
        size = next(
            (self.sizes[model] for model in models if model in self.sizes), next(iter(self.sizes.values()), (0, 0))
        )
        first = int(outcome.key in self._first)
        result = [
            Sample(step, settings_key(settings.get(step, {})), *size, frames, first, seconds)
            for step, seconds in outcome.timed
        ]
        rest = outcome.seconds - sum(seconds for _, seconds in outcome.timed)
        if outcome.trial and not outcome.reused:
            result.append(Sample(TRIAL, "", *size, frames, first, max(rest, 0.0)))
        return result


def _kernels() -> int:
    """How many files the kernels on disk have."""
    try:
        return sum(1 for one in os.scandir(kernel_folder()) if one.name.endswith(".nbc"))
    except OSError:
        return 0

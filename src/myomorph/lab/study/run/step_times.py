"""What steps took on this machine, stored in the user's cache folder.

A dry run reads how long a run takes.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from statistics import median_high

from myomorph.core.io.parsing.cells import csv_records
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import grouped
from myomorph.lab.store.outcome import Key, Outcome
from myomorph.lab.study.run.work import Work

VARIABLE = "MYOMORPH_STEP_TIMES"  # Names another file, or none where it is empty.

FILE = "step_times.csv"
MAX_SAMPLES = 3000  # Lines that are kept, the last ones.

MAX_COUNTED = 9  # Samples that count, the latest.


@dataclass(frozen=True)
class Sample:
    """What a step with settings (as `settings_key`) took once.

    It took so long for so many muscles, 0 without a model, and frames.
    """

    step: str
    settings: str
    muscles: int
    frames: int
    seconds: float


NAMES = tuple(column.name for column in fields(Sample))


def times_file() -> Path | None:
    """Where times of this machine are kept; None where they are not to be."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named) if named else None
    return kernel_folder().parent / FILE


def settings_key(settings: Mapping[str, object]) -> str:
    """Return settings of a step in a few letters, "" where there are none."""
    if not settings:
        return ""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def read_samples(path: Path | None) -> list[Sample]:
    """Lines of the file in their order; damaged ones are passed over."""
    samples: list[Sample] = []
    with suppress(OSError, UnicodeDecodeError, BadData):
        for row in csv_records(
            "" if path is None else path.read_text(encoding="utf-8").splitlines()
        ):
            with suppress(KeyError, TypeError, ValueError):
                muscles = int(row["muscles"])
                frames = int(row["frames"])
                seconds = float(row["seconds"])
                if math.isfinite(seconds) and seconds >= 0.0:
                    samples.append(
                        Sample(
                            step=row["step"],
                            settings=row["settings"],
                            muscles=muscles,
                            frames=frames,
                            seconds=seconds,
                        )
                    )
    return samples


def keep_samples(path: Path | None, samples: Sequence[Sample]) -> None:
    """Add lines to the file; that it cannot be written stops nothing."""
    if path is None or not samples:
        return
    kept = [*read_samples(path), *samples][-MAX_SAMPLES:]
    with suppress(OSError, BadFile):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_csv(path, NAMES, map(astuple, kept), digits=4)


class StepTimes:
    """Times of steps as this machine has learned them.

    They are in a table at `path`, None for no such table.
    """

    def __init__(self, path: Path | None):
        samples = reversed(read_samples(path))
        self._samples = grouped(
            ((sample.step, sample.settings, sample.muscles), sample) for sample in samples
        )

    def expected(
        self, step: str, settings: Mapping[str, object], muscles: int, frames: int | None
    ) -> float | None:
        """Return the seconds that a step takes.

        They are None where it never ran here with such settings and muscles, or frames are unknown.
        """
        samples = self._samples.get((step, settings_key(settings), muscles), [])[:MAX_COUNTED]
        if not samples or frames is None:
            return None
        return median_high(sample.seconds / max(sample.frames, 1) for sample in samples) * max(
            frames, 1
        )


@dataclass
class Learning:
    """Observer that notes what jobs took, and stores it after a whole run.

    Jobs during which kernels were compiled do not count.
    """

    works: Mapping[Key, Work]
    muscles: dict[Path, int] = field(default_factory=dict)
    compiled: set[Key] = field(default_factory=set)
    _before: dict[Key, int] = field(default_factory=dict)

    def started(self, key: Key) -> None:
        """Note that a job begins."""
        self._before[key] = _kernels()

    def ended(self, outcome: Outcome) -> None:
        """Note that a job has ended."""
        if outcome.key in self._before and self._before[outcome.key] != _kernels():
            self.compiled.add(outcome.key)

    def keep(self, outcomes: Iterable[Outcome]) -> None:
        """Keep what the run took, all its jobs done."""
        outcomes = list(outcomes)
        if not any(outcome.error for outcome in outcomes):
            keep_samples(
                times_file(), [sample for outcome in outcomes for sample in self._samples(outcome)]
            )

    def _samples(self, outcome: Outcome) -> list[Sample]:
        work = self.works.get(outcome.key)
        if work is None or outcome.key in self.compiled or outcome.key not in self._before:
            return []
        frames = work.frames() if outcome.timed else None
        if frames is None:
            return []
        muscles = 0 if work.model is None else self.muscles.get(work.model, 0)
        return [
            Sample(
                step=step,
                settings=settings_key(work.settings.get(step, {})),
                muscles=muscles,
                frames=frames,
                seconds=seconds,
            )
            for step, seconds in outcome.timed
        ]


def _kernels() -> int:
    """Time at which a kernel was last stored on disk [ns]; 0 where none was."""
    folder = kernel_folder()
    return folder.stat().st_mtime_ns if folder.is_dir() else 0


def in_words(seconds: float) -> str:
    """Return a time as one would say it: "0.4 s", "12 s", "3 min 20 s", "2 h 5 min"."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if minutes else f"{rest} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min"

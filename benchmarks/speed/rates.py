"""What a step of a study costs on this machine, by the size of the model: the table that a dry run guesses with.

Each recording goes through its steps whole and in a part, one thread each as in a worker of a study; the two times are
a fixed part and seconds a frame. The table is written into the package.
"""

from __future__ import annotations

import csv
import io
import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import myomorph as mm
from benchmarks.recordings import RECORDINGS, Recording
from data_collection import data_folder
from myomorph.study.run.expected_time import COLUMNS, RATES
from myomorph.study.subject.subject_files import SubjectFiles
from myomorph.study.subject.subjects import prepare_subject
from myomorph.study.trial.open_trial import open_trial
from myomorph.study.trial.run_trial import run_trial
from myomorph.study.trial.trial_files import TrialFiles

STEPS = ("ik", "id", "muscles", "tension", "report")
OWN = ("calibrate", "identify")
ROUNDS = 5


@dataclass(frozen=True)
class _Case:
    """A recording, whole and in a part [s]."""

    files: Recording
    whole: tuple[float, float]
    part: tuple[float, float]


CASES = (
    _Case(RECORDINGS["gait2354"], (0.0, 2.5), (0.5, 1.2)),
    _Case(RECORDINGS["rajagopal"], (0.0, 100.0), (0.5, 1.2)),
)


def run() -> list[dict[str, object]]:
    """A row for each model and step; also writes the table of the package."""
    os.environ["MYOMORPH_THREADS"] = "1"
    rows = [row for case in CASES for row in _rows(case)]
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(
        {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in one.items()} for one in rows
    )
    RATES.write_text(text.getvalue(), encoding="utf-8", newline="\n")
    return rows


def _rows(case: _Case) -> list[dict[str, object]]:
    model_path, markers, loads = (
        data_folder() / name for name in (case.files.model, case.files.markers, case.files.loads)
    )
    model = mm.read_model(model_path)
    files = TrialFiles(model_path, "rate", "rate", markers, loads=loads, mass=model.mass)
    taken: dict[str, list[tuple[int, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for span in (case.part, case.whole):
            one = replace(files, time=span)
            for step, (frames, seconds) in _fastest(one, model, Path(folder)).items():
                taken.setdefault(step, []).append((frames, seconds))
    rows = []
    for step, ((few, short), (many, long)) in taken.items():
        # On a busy machine the part may have taken as long as the whole.
        rate = max((long - short) / (many - few), 0.5 * long / many)
        size: dict[str, object] = {"coordinates": len(model.coordinate_names), "muscles": len(model.muscles)}
        rows.append({"step": step} | size | {"seconds": max(short - rate * few, 0.0), "seconds_per_frame": rate})
    return rows


def _fastest(files: TrialFiles, model: mm.Model, folder: Path) -> dict[str, tuple[int, float]]:
    """Frames and the shortest seconds of each step."""
    best: dict[str, tuple[int, float]] = {}
    for _ in range(ROUNDS):
        outcome = run_trial(open_trial(files, {}, model), STEPS, folder / "trial", True)
        if outcome.error:
            raise RuntimeError(outcome.error)
        subject = SubjectFiles("rate", files.model, files.mass, trials=(files,))
        made = prepare_subject(
            subject, ("calibrate", "identify"), {"identify": {"spacing": 0.01}}, folder / "own", True
        )
        for step, seconds in (*outcome.timed, *made.timed):
            best[step] = min(best.get(step, (outcome.frames, seconds)), (outcome.frames, seconds))
    return best

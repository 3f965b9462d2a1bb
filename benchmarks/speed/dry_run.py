"""What a dry run expects beside what the run then takes, of ten studies: guessed, learned from others, run again.

`python -m benchmarks dry_run`: each study is run twice by `myomorph run` in a process of its own, with kernels compiled
before. Expected times are those before the first run on a machine (`guess`), those that the other studies taught
(`learned`, so that none is judged by itself), and those of the same folder (`again`). `--first` adds one study on a
machine without kernels, whose compile time is said apart.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import myomorph as mm
from benchmarks.recordings import RECORDINGS
from data_collection import data_folder
from myomorph.study.run.dry_run import DryRun, dry_run
from myomorph.study.run.learned_times import VARIABLE

WORKERS = 1
LIMIT = 0.5
"""By so much of what a run took may it differ."""

TRIAL = """model = '{{data}}/{files.model}'
{mass}trials = [{{{{markers = '{{data}}/{files.markers}', loads = '{{data}}/{files.loads}'}}}}]
"""
WALK = TRIAL.format(files=RECORDINGS["rajagopal"], mass="")
GAIT = TRIAL.format(files=RECORDINGS["gait2354"], mass="mass = 72.6\n")

KNEE = """model = '{data}/knee-implant-walk/nominal.osim'
[[subject.trials]]
markers = '{data}/knee-implant-walk/walk1.trc'
loads = '{data}/knee-implant-walk/walk1_grf.xml'
[[subject.trials]]
markers = '{data}/knee-implant-walk/walk3.trc'
loads = '{data}/knee-implant-walk/walk3_grf.xml'
"""


@dataclass(frozen=True)
class Study:
    """A study of the benchmark.

    Attributes
    ----------
    subject : its lines of the subject's table
    steps : of all trials
    options : further tables
    copies : subjects of the same recording
    """

    name: str
    subject: str
    steps: str
    options: str = ""
    copies: int = 1

    def text(self, data: Path) -> str:
        """The study file."""
        own = self.subject.format(data=data)
        steps = ", ".join(f'"{one}"' for one in self.steps.split())
        subjects = [f'[[subject]]\nname = "s{k}"\nsteps = [{steps}]\n{own}' for k in range(self.copies)]
        return "\n".join([f'[study]\nname = "{self.name}"', *subjects, self.options])


STUDIES = (
    Study("angles of a walk", WALK, "ik"),
    Study("angles, torques", GAIT, "ik id"),
    Study("torques, report", WALK, "ik id report"),
    Study("muscle paths", GAIT, "ik muscles"),
    Study("tensions", GAIT, "ik id muscles tension"),
    Study("tensions of 80 muscles, report", WALK + "time = [0.45, 1.8]\n", "ik id muscles tension report"),
    Study("calibrated", GAIT, "calibrate ik id"),
    Study("masses", GAIT, "ik identify id", "[options.identify]\nspacing = 0.01\n"),
    Study("four subjects", WALK, "ik id tension", copies=4),
    Study("two walks, report", KNEE, "ik id tension report"),
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument("--first", action="store_true", help="also a study on a machine without kernels")
    parser.add_argument("--only", default="", help="name of a single study")


def run(first: bool = False, only: str = "") -> list[dict[str, object]]:
    """A row a study, and a row that counts."""
    chosen = [one for one in STUDIES if not only or one.name == only]
    with tempfile.TemporaryDirectory() as made:
        home, data = Path(made), data_folder()
        for k, one in enumerate(chosen):
            (home / f"{k}.toml").write_text(one.text(data), encoding="utf-8")
        # Kernels are compiled, and files are in memory, before anything is timed.
        _timed(home / f"{len(chosen) - 1}.toml", home / "warm", home / "warm.csv")
        rows = [_twice(one, home, k) for k, one in enumerate(chosen)]
        for k, row in enumerate(rows):
            _learned(row, home, k, len(chosen))
        if first:
            rows.append(_first(home, chosen))
    return [*rows, _count(rows)]


def _twice(one: Study, home: Path, k: int) -> dict[str, object]:
    """A guess, the first run, what is then expected of the same folder, and the second run."""
    study, out, times = home / f"{k}.toml", home / f"out{k}", home / f"times{k}.csv"
    guess = _expected(study, home / "none", home / "no.csv").lasts
    real = _timed(study, out, times)
    again = _expected(study, out, times, fresh=True).lasts
    second = _timed(study, out, times, "--fresh")
    row: dict[str, object] = {"study": one.name, "guess [s]": guess, "first run [s]": real}
    return row | {"again [s]": again, "second run [s]": second}


def _learned(row: dict[str, object], home: Path, k: int, count: int) -> None:
    """What the other studies teach of this one."""
    table = home / f"others{k}.csv"
    lines: list[str] = []
    for j in range(count):
        path = home / f"times{j}.csv"
        if j != k and path.is_file():
            heading, *rest = path.read_text(encoding="utf-8").splitlines()
            lines = [*(lines or [heading]), *rest]
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    row["learned from the others [s]"] = _expected(home / f"{k}.toml", home / "none", table).lasts


def _first(home: Path, chosen: list[Study]) -> dict[str, object]:
    """A study on a machine without kernels."""
    k = next((j for j, one in enumerate(chosen) if "tension" in one.steps), 0)
    with tempfile.TemporaryDirectory() as cache:
        environment = {"NUMBA_CACHE_DIR": cache}
        code = (
            "import sys; from pathlib import Path; from myomorph.study.plan.plan import read_plan;"
            "from myomorph.study.run.dry_run import dry_run;"
            "found = dry_run(read_plan(Path(sys.argv[1])), Path(sys.argv[2]));"
            "print(found.lasts, found.compiles)"
        )
        command = [sys.executable, "-c", code, str(home / f"{k}.toml"), str(home / "none")]
        told = subprocess.run(
            command, env=os.environ | environment | {VARIABLE: ""}, check=True, capture_output=True, text=True
        )
        lasts, compiles = map(float, told.stdout.split())
        real = _timed(home / f"{k}.toml", home / "cold", home / "cold.csv", environment=environment)
    row: dict[str, object] = {"study": f"{chosen[k].name}, no kernels", "guess [s]": lasts + compiles}
    return row | {"of that compiling [s]": compiles, "first run [s]": real}


def _expected(study: Path, out: Path, times: Path, fresh: bool = False) -> DryRun:
    os.environ[VARIABLE] = str(times)
    return dry_run(mm.read_plan(study), out, fresh, WORKERS)


def _timed(study: Path, out: Path, times: Path, *more: str, environment: dict[str, str] | None = None) -> float:
    """Seconds of `myomorph run`, from the command to its end."""
    command = [sys.executable, "-m", "myomorph", "run", str(study), "--out", str(out), "--workers", str(WORKERS), *more]
    begun = time.perf_counter()
    told = subprocess.run(
        command, env=os.environ | (environment or {}) | {VARIABLE: str(times)}, capture_output=True, text=True
    )
    if told.returncode:
        raise RuntimeError(told.stdout + told.stderr)
    return time.perf_counter() - begun


def _count(rows: list[dict[str, object]]) -> dict[str, object]:
    """How many expected times are within the limit of what the run took."""
    found: dict[str, object] = {"study": f"within {100 * LIMIT:g} %"}
    for name, real in (
        ("guess [s]", "first run [s]"),
        ("learned from the others [s]", "second run [s]"),
        ("again [s]", "second run [s]"),
    ):
        pairs = [(float(str(row[name])), float(str(row[real]))) for row in rows if name in row]
        near = sum(abs(expected - taken) <= LIMIT * taken for expected, taken in pairs)
        found[name] = f"{near} of {len(pairs)}"
    return found

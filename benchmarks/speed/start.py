"""How long a user waits.

Measured are import, the first command on a new machine with compilation, later commands, where
the time of a one-second trial goes, and size on disk.

`python -m benchmarks start [--before REVISION]`: processor times of this checkout next to those of
an earlier revision, in turns.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement

import myomorph
from benchmarks.speed.command_parts import processor_times
from benchmarks.speed.revision import unpack_sources
from benchmarks.speed.study import write_study
from data_collection import data_folder

RUNS = 5
SHORT_TRIALS = 8
SECOND = ("--time", "1", "2")  # Of the walk that is used


class TrialPaths(NamedTuple):
    """Files of one trial."""

    model: Path
    markers: Path
    loads: Path


def installed_size(name: str) -> float:
    """Size of a package's files and of all that it requires without extras [bytes]."""
    left = [(name, "")]
    sizes = {}
    while left:
        one, extra = left.pop()
        if (one.lower(), extra) not in sizes:
            package = importlib.metadata.distribution(one)
            files = [Path(str(package.locate_file(file))) for file in package.files or ()]
            sizes[one.lower(), extra] = (
                0 if extra else sum(file.stat().st_size for file in files if file.is_file())
            )
            for needed in map(Requirement, package.requires or ()):
                if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                    left += [(needed.name, also) for also in ("", *needed.extras)]
    return sum(sizes.values())


def seconds(arguments: list[str], environment: dict[str, str]) -> float:
    """Wall time of one command."""
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments], check=True, env=environment, stdout=subprocess.DEVNULL
    )
    return time.perf_counter() - began


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument(
        "--before", default="", metavar="REVISION", help="the revision to compare commands with"
    )


def run(before: str = "") -> list[dict[str, object]]:
    """Rows of what was waited for and how long."""
    rows: list[dict[str, object]] = [
        {"what": "packages without extras", "MB": 1e-6 * installed_size("myomorph")}
    ]
    with tempfile.TemporaryDirectory() as folder:
        # An empty cache of kernels is what a new machine has; pip compiled the modules when it
        # installed them.
        places = {
            "NUMBA_CACHE_DIR": str(Path(folder) / "cache"),
            "PYTHONPYCACHEPREFIX": str(Path(folder) / "modules"),
            "PYTHONDONTWRITEBYTECODE": "",
        }
        environment = {**os.environ, **places}
        seconds(["-m", "compileall", "-q", str(Path(myomorph.__file__).parent)], environment)
        imports = [seconds(["-c", "import myomorph"], environment) for _ in range(RUNS)]
        rows.append({"what": "python -c 'import myomorph'", "seconds": statistics.median(imports)})
        command = ["-m", "myomorph"]
        helps = [seconds([*command, "--help"], environment) for _ in range(RUNS)]
        rows.append({"what": "myomorph --help", "seconds": statistics.median(helps)})
        model = _trial_files(Path(folder)).model
        infos = [seconds([*command, "info", str(model)], environment) for _ in range(RUNS)]
        rows.append(
            {"what": "myomorph info MODEL, nothing compiled", "seconds": statistics.median(infos)}
        )
        demo = [*command, "demo", "--out"]
        first = seconds([*demo, str(Path(folder) / "first")], environment)
        rows.append({"what": "myomorph demo, first time (compiles)", "seconds": first})
        later = [seconds([*demo, str(Path(folder) / f"later{i}")], environment) for i in range(3)]
        rows.append({"what": "myomorph demo, later", "seconds": statistics.median(later)})
        trees = {"": Path(__file__).parents[2]}
        if before:
            earlier = Path(folder) / "earlier"
            earlier.mkdir()
            unpack_sources(before, earlier)
            trees[", before"] = earlier
        rows += _parts_of_commands(Path(folder), places, trees)
        rows += _cold_studies(Path(folder), trees)
    return rows


def _trial_files(folder: Path) -> TrialPaths:
    """Return a walk of the data collection, else the small bundled example."""
    walk = data_folder() / "rajagopal-walk-emg"
    if walk.is_dir():
        return TrialPaths(
            model=walk / "subject_walk_scaled.osim",
            markers=walk / "markers_walk.trc",
            loads=walk / "grf_walk.xml",
        )
    home = folder / "example"
    home.mkdir(exist_ok=True)
    example = myomorph.example_files(home)
    return TrialPaths(model=example.model, markers=example.markers, loads=example.loads)


def _parts_of_commands(
    folder: Path, places: Mapping[str, str], trees: Mapping[str, Path]
) -> list[dict[str, object]]:
    """Processor times of the commands of a one-second trial."""
    files = _trial_files(folder)
    model = ["--model", str(files.model)]
    motion = str(folder / "motion.mot")
    loaded = [*model, "--motion", motion, "--loads", str(files.loads)]
    commands = {
        "info MODEL": ["info", str(files.model)],
        "info RECORDING": ["info", str(files.markers)],
        "ik": ["ik", *model, "--markers", str(files.markers), *SECOND, "--out", motion],
        "id --cutoff 6": ["id", *loaded, "--cutoff", "6", "--out", str(folder / "id6.sto")],
        "id": ["id", *loaded, "--out", str(folder / "id.sto")],
        "muscles": ["muscles", *model, "--motion", motion, "--out", str(folder / "muscles")],
        "tension": ["tension", *loaded, "--cutoff", "6", "--out", str(folder / "tension")],
    }
    environments = {
        name: {**places, "PYTHONPATH": str(path / "src")} for name, path in trees.items()
    }
    rows: list[dict[str, object]] = []
    for (name, version), parts in processor_times(commands, environments, RUNS).items():
        total = sum(parts.values())
        rows.append({"what": f"{name}{version}", "processor seconds": total, **parts})
    return rows


def _cold_studies(folder: Path, trees: Mapping[str, Path]) -> list[dict[str, object]]:
    """Measure a study of short trials on a machine where nothing is compiled, by workers."""
    (folder / "study").mkdir()
    study = write_study(folder / "study", SHORT_TRIALS)
    rows: list[dict[str, object]] = []
    for workers in (1, 2, 4):
        for version, path in trees.items():
            home = folder / f"cold {workers}{version}"
            environment = {
                **os.environ,
                "NUMBA_CACHE_DIR": str(home / "cache"),
                "PYTHONPATH": str(path / "src"),
            }
            command = ["-m", "myomorph", "run", str(study), "--workers", str(workers)]
            before = os.times()
            elapsed = seconds([*command, "--out", str(home / "results")], environment)
            after = os.times()
            spent = after.children_user - before.children_user
            spent += after.children_system - before.children_system
            what = f"{SHORT_TRIALS} short trials, nothing compiled, {workers} workers{version}"
            rows.append({"what": what, "seconds": elapsed, "processor seconds": spent})
    return rows

"""Speed of this checkout against a revision.

Functions and whole commands of both run in turns, by processor time.

`python -m benchmarks revision --before REVISION [--rounds N] [--save]`. The revision is unpacked
into a temporary folder. Functions run on one thread in a process of each, the least of six times
counting, commands in a process each with kernels compiled before; then medians over the rounds.
What a command does by default may have changed.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import resource
import statistics
import subprocess
import sys
import tarfile
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from data_collection import data_folder

ROOT = Path(__file__).resolve().parents[2]
WALK = "--model subject_walk_scaled.osim --motion coordinates.sto --loads grf_walk.xml --cutoff 6"
COMMANDS = {
    "ik": "ik --model subject_walk_scaled.osim --markers markers_walk.trc --out OUT/walk.mot",
    "tension": f"tension {WALK} --out OUT",
    "tension --contacts auto": f"tension {WALK} --contacts auto --out OUT",
    "tension --tendons elastic": f"tension {WALK} --tendons elastic --out OUT",
    "tension --draws 20": f"tension {WALK} --draws 20 --out OUT",
    "identify": f"identify {WALK} --mass 85.27 --out OUT/identified.osim",
    "refine": (
        "refine --model subject_walk_scaled.osim --markers markers_walk.trc --loads grf_walk.xml"
        " --mass 85.27 --out OUT/refined.osim"
    ),
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument(
        "--before", required=True, metavar="REVISION", help="the revision to compare with"
    )
    parser.add_argument("--rounds", type=int, default=3, help="turns of each")


def unpack_sources(revision: str, folder: Path) -> None:
    """Put the sources of a revision into a folder, as `src` there."""
    archive = subprocess.run(
        ["git", "archive", revision, "src"], cwd=ROOT, capture_output=True, check=True
    ).stdout
    packed = folder / "archive.tar"
    packed.write_bytes(archive)
    with tarfile.open(packed) as files:
        files.extractall(folder, filter="data")


def run(before: str, rounds: int = 3) -> list[dict[str, object]]:
    """Return a row for each function and command.

    It has processor seconds before and now, and now over before.
    """
    with tempfile.TemporaryDirectory() as folder:
        unpack_sources(before, Path(folder))
        taken: dict[tuple[str, str], list[float]] = defaultdict(list)
        for turn in range(rounds + 1):
            for which, tree in (("before", Path(folder)), ("now", ROOT)):
                seconds = _functions(tree, Path(folder)) | {
                    f"myomorph {name}": _command(command, tree, Path(folder))
                    for name, command in COMMANDS.items()
                }
                for what, value in seconds.items():
                    taken[what, which] += [value] if turn else []  # The first turn compiles.
    medians = {key: statistics.median(values) for key, values in taken.items()}
    whats = list(dict.fromkeys(what for what, _ in medians))
    return [
        {
            "what": what,
            f"{before} [s]": medians[what, "before"],
            "now [s]": medians[what, "now"],
            "now / before": medians[what, "now"] / medians[what, "before"],
        }
        for what in whats
    ]


def _environment(tree: Path, folder: Path) -> dict[str, str]:
    """Return the variables under which a tree runs.

    It runs with its own kernels and compiled modules, and on one thread.
    """
    threads = dict.fromkeys(("MYOMORPH_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    kernels = str(folder / ("kernels now" if tree == ROOT else "kernels before"))
    places = {"NUMBA_CACHE_DIR": kernels, "PYTHONPYCACHEPREFIX": str(folder / "modules")}
    return {
        **os.environ,
        **threads,
        **places,
        "PYTHONDONTWRITEBYTECODE": "",
        "PYTHONPATH": f"{tree / 'src'}:{ROOT / 'tests'}",
    }


def _functions(tree: Path, folder: Path) -> dict[str, float]:
    program = [sys.executable, __file__, str(data_folder() / "rajagopal-walk-emg")]
    return json.loads(
        subprocess.run(
            program, env=_environment(tree, folder), check=True, capture_output=True
        ).stdout
    )


def _command(command: str, tree: Path, folder: Path) -> float:
    """Processor seconds of a command; where it fails its last lines are raised."""
    with tempfile.TemporaryDirectory(dir=folder) as out:
        program = [sys.executable, "-m", "myomorph", *command.replace("OUT", out).split()]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        walk = data_folder() / "rajagopal-walk-emg"
        done = subprocess.run(
            program, cwd=walk, env=_environment(tree, folder), capture_output=True, text=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"myomorph {command}: {(done.stderr or done.stdout)[-400:]}")
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def functions(folder: Path) -> dict[str, float]:
    """Return the least processor seconds of public functions that every revision has.

    They are of the package on the path.
    """
    import myomorph as mm

    model = mm.read_model(folder / "subject_walk_scaled.osim")
    markers = mm.read_recording(folder / "markers_walk.trc").markers
    raw = mm.read_motion(folder / "coordinates.sto", model)
    motion = mm.differentiate(raw, cutoff=6.0)
    loads = mm.resample_wrenches(mm.read_loads(folder / "grf_walk.xml", model, motion), motion.time)
    torques = mm.inverse_dynamics(model, motion, loads)
    rigid = mm.TensionOptions(passive=False)
    elastic = mm.TensionOptions(passive=False, tendons="elastic")
    # Older revisions have no such costs in Python.
    known = "recruitment" in inspect.signature(mm.solve_tension).parameters
    alone = {"recruitment": mm.tension.RecruitmentOptions(joint_load=0.0)} if known else {}
    tension = mm.solve_tension(model, motion, torques, rigid, **alone)
    works = {
        "inverse_kinematics": lambda: mm.inverse_kinematics(model, markers),
        "calibrate": lambda: mm.calibrate(model, [markers]),
        "differentiate": lambda: mm.differentiate(raw, cutoff=6.0),
        "inverse_dynamics": lambda: mm.inverse_dynamics(model, motion, loads),
        "muscle_kinematics": lambda: mm.muscle_kinematics(model, motion),
        "solve_tension": lambda: mm.solve_tension(model, motion, torques, rigid, **alone),
        "solve_tension, elastic tendons": lambda: mm.solve_tension(model, motion, torques, elastic),
        "joint_reactions": lambda: mm.joint_reactions(model, motion, tension, loads),
    }
    return {what: min(_processor(work) for _ in range(6)) for what, work in works.items()}


def _processor(work: object) -> float:
    before = time.process_time()
    work()
    return time.process_time() - before


if __name__ == "__main__":
    print(json.dumps(functions(Path(sys.argv[1]))))

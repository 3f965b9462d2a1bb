"""Through how many files a recording passes while it is opened, and while its steps run.

A trial is run (`ik`, `id`, `muscles`, `tension`), and a specimen that swings is identified, in a
process that is watched: every call of a function of the package counts its file. Two ways of
counting:

- all: every file of which a function is called;
- carried: files of which a function is given a value that holds the recording, or what its files
  held as a whole (`CARRIED`); arrays and numbers computed from these are no inputs any more.

A stay is a stretch of functions in one file, in the order in which functions are called for the
first time; a return is a stay in a file that had been left. Methods that Python calls by itself
(`__post_init__`) and parts of expressions are no functions here.

The making of a report is left out: it is made of results. The trial is a walk with plates where the
data collection is there, else the small example that comes along; the specimen is simulated.

`python -m benchmarks trial_path [--before REVISION]`: this checkout, compared with a revision if
one is named. A count by reading the code, which stood here before, cannot follow functions that
are found in tables.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from benchmarks.speed.revision import unpack_sources
from data_collection import data_folder

ROOT = Path(__file__).parents[1]
CARRIED = (
    "TrialFiles",
    "TrialInputs",
    "Opening",
    "Opened",
    "OptionSet",
    "ByType",
    "Trial",
    "Model",
    "SpecimenTable",
    "_Specimen",
    "SpecimenFiles",
    "SwingFiles",
    "StudyFolder",
    "StudyOptions",
    "OpenedSpecimen",
    "Specimen",
    "SwingTrial",
    "TrackedSpecimen",
    "Prepared",
)
TRIAL = {
    "opens": ("open_trial", "open_motion_trial"),
    "runs": ("run_trial", "run_steps"),
    "step tension": ("trial/steps/tension.py:_run",),
}
SWINGS = {
    "swings: reads the study file": ("read_viscosity_plan",),
    "swings: opens and tracks": ("study/specimen.py:_opened",),
    "swings: identifies": ("identify_conditions",),
}
"""Phases by the functions with which they begin, of a file where others have that name too."""
WALK = {"model": "subject_walk_scaled.osim", "markers": "markers_walk.trc", "loads": "grf_walk.xml"}
REPORT = ("write_report", "report_folder", "_report")

WATCHED = """
import json, sys, threading
from pathlib import Path
import myomorph as mm

carried, trial, swings, report, folder = json.loads(sys.argv[1])
root = str(Path(mm.__file__).parent)
phases, begun = {}, []
order = {(phase, way): {} for phase in trial | swings for way in ("all", "carried")}

def phase_of(code):
    if code.co_name in report:
        return "report"
    names = code.co_name, f"{code.co_filename}:{code.co_name}"
    for phase, starts in phases.items():
        if any(names[0] == start or ":" in start and names[1].endswith(start) for start in starts):
            return phase

def watch(frame, event, value):
    code = frame.f_code
    if not code.co_filename.startswith(root) or event not in ("call", "return"):
        return
    phase = phase_of(code)
    if event == "return":
        if phase and begun and begun[-1] == phase:
            begun.pop()
        return
    if phase:
        begun.append(phase)
    if not begun or begun[-1] == "report":
        return
    arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    held = any(type(frame.f_locals.get(name)).__name__ in carried for name in arguments)
    function = code.co_filename, code.co_name, code.co_firstlineno
    # A step is a part of the run of its trial.
    inner = [begun[-1]] + ["runs"] * (begun[-1] == "step tension")
    for each in inner:
        order[each, "all"].setdefault(function)
        if held:
            order[each, "carried"].setdefault(function)

folder = Path(folder)
if not (folder / "study.toml").exists():
    example = mm.example_files(folder)
    (folder / "study.toml").write_text(
        f'[study]\\nname = "example"\\n[[subject]]\\nname = "s01"\\n'
        f'model = "{example.model.name}"\\nmass = 4.0\\n'
        f'trials = ["{example.markers.name}"]\\nsteps = ["ik", "id", "muscles", "tension"]\\n')
plan = mm.read_plan(folder / "study.toml")
recordings = mm.viscosity.ShoulderStudyOptions(seconds=6.0, trials=2, raw=(3,))
shoulder = mm.write_shoulder_study(folder / "swings", (3,), recordings)
sys.setprofile(watch)
threading.setprofile(watch)
phases.update(trial)
mm.run_study(plan, folder / "out")
phases.clear()
phases.update(swings)
mm.viscosity.run_viscosity(mm.viscosity.read_viscosity_plan(shoulder), folder / "swung")
sys.setprofile(None)
watched = [
    [*key, [[name[len(root) + 1 :], function] for name, function, _ in functions]]
    for key, functions in order.items()
]
print("WATCHED" + json.dumps(watched))
"""


def count(tree: Path) -> list[dict[str, object]]:
    """Count files, stays and returns of a checkout, in a row for each phase and way of counting."""
    with tempfile.TemporaryDirectory() as folder:
        _write_study(Path(folder))
        watched = json.dumps([CARRIED, TRIAL, SWINGS, REPORT, folder])
        environment = os.environ | {"PYTHONPATH": str(tree / "src")}
        command = [sys.executable, "-c", WATCHED, watched]
        printed = subprocess.run(
            command, env=environment, check=True, stdout=subprocess.PIPE, text=True
        ).stdout
    line = next(line for line in printed.splitlines() if line.startswith("WATCHED"))
    rows: list[dict[str, object]] = []
    for phase, way, functions in json.loads(line.removeprefix("WATCHED")):
        files = {name for name, _ in functions}
        rooms = Counter("/".join(Path(name).parts[:-1][:2]) for name in files)
        text = ", ".join(f"{room} {number}" for room, number in sorted(rooms.items()))
        stays = _stays(functions)
        rows.append(
            {
                "what": phase,
                "counted": way,
                "files": len(files),
                "stays": len(stays),
                "returns": len(stays) - len(set(stays)),
                "by room": text,
            }
        )
    return rows


def _stays(functions: Sequence[tuple[str, str]]) -> list[str]:
    """List files in the order in which their functions (file, name) are called for the first time.

    Functions one after another in one file are one stay.
    """
    files = [file for file, name in functions if not name.startswith(("<", "__"))]
    return [file for number, file in enumerate(files) if number == 0 or files[number - 1] != file]


def _write_study(folder: Path) -> None:
    """Write a study of one walk; none where the data collection is absent."""
    walk = data_folder() / "rajagopal-walk-emg"
    if not walk.is_dir():
        return
    files = {key: walk / name for key, name in WALK.items()}
    text = [
        "[study]",
        'name = "walk"',
        "[[subject]]",
        'name = "s01"',
        f"model = '{files['model']}'",
        "mass = 85.27",
    ]
    text += ['steps = ["ik", "id", "muscles", "tension"]', "[[subject.trials]]"]
    text += [f"{key} = '{files[key]}'" for key in ("markers", "loads")]
    (folder / "study.toml").write_text("\n".join(text) + "\n", encoding="utf-8")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument(
        "--before", default="", metavar="REVISION", help="a git revision to compare with"
    )


def run(before: str = "") -> list[dict[str, object]]:
    """Return the rows of this checkout, after those of a revision if one is named."""
    now = [{"tree": "now", **row} for row in count(ROOT)]
    if not before:
        return now
    with tempfile.TemporaryDirectory() as folder:
        unpack_sources(before, Path(folder))
        then = [{"tree": before, **row} for row in count(Path(folder))]
    return [*then, *now]

"""Through how many files a trial passes while it is opened, and while its steps run.

A trial is run (`ik`, `id`, `muscles`, `tension`) in a process that is watched: every call of a
function of the package counts its file. Two ways of counting:

- all: every file of which a function is called;
- trial: files of which a function is given a value that holds the trial, or what its files held as
    a whole (`CARRIED`);
  arrays and numbers computed from these are no inputs any more.

The making of a report is left out: it is made of results. The trial is a walk with plates where the
data collection is there, else the small example that comes along.

`python -m benchmarks trial_path [--tree PATH]`; the tree is a checkout of this package, by default
this one. A count by reading the code, which stood here before, cannot follow functions that are
found in tables.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from data_collection import data_folder

CARRIED = (
    "TrialFiles",
    "TrialInputs",
    "Opening",
    "Opened",
    "OptionSet",
    "ByType",
    "Trial",
    "Model",
)
STARTS = {"opens": ("open_trial", "open_motion_trial"), "runs": ("run_trial", "run_steps")}
WALK = {"model": "subject_walk_scaled.osim", "markers": "markers_walk.trc", "loads": "grf_walk.xml"}
REPORT = ("write_report", "report_folder", "_report")

WATCHED = """
import json, sys, threading
from pathlib import Path
import myomorph as mm

carried, starts, report, folder = json.loads(sys.argv[1])
root = str(Path(mm.__file__).parent)
phase_of = {name: phase for phase, names in starts.items() for name in names}
phase_of |= dict.fromkeys(report, "report")
files, phases = {(phase, way): set() for phase in starts for way in ("all", "trial")}, []

def watch(frame, event, value):
    code = frame.f_code
    if not code.co_filename.startswith(root) or event not in ("call", "return"):
        return
    phase = phase_of.get(code.co_name)
    if event == "return":
        if phase and phases and phases[-1] == phase:
            phases.pop()
        return
    if phase:
        phases.append(phase)
    if phases and phases[-1] != "report":
        arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        files[phases[-1], "all"].add(code.co_filename)
        if any(type(frame.f_locals.get(name)).__name__ in carried for name in arguments):
            files[phases[-1], "trial"].add(code.co_filename)

folder = Path(folder)
if not (folder / "study.toml").exists():
    example = mm.example_files(folder)
    (folder / "study.toml").write_text(
        f'[study]\\nname = "example"\\n[[subject]]\\nname = "s01"\\n'
        f'model = "{example.model.name}"\\nmass = 4.0\\n'
        f'trials = ["{example.markers.name}"]\\nsteps = ["ik", "id", "muscles", "tension"]\\n')
plan = mm.read_plan(folder / "study.toml")
sys.setprofile(watch)
threading.setprofile(watch)
mm.run_study(plan, folder / "out")
sys.setprofile(None)
watched = [[*key, sorted(name[len(root) + 1 :] for name in names)] for key, names in files.items()]
print("WATCHED" + json.dumps(watched))
"""


def count(tree: Path) -> list[dict[str, object]]:
    """Files through which a trial passes, one row per phase and way of counting."""
    with tempfile.TemporaryDirectory() as folder:
        _write_study(Path(folder))
        watched = json.dumps([CARRIED, STARTS, REPORT, folder])
        environment = os.environ | {"PYTHONPATH": str(tree / "src")}
        command = [sys.executable, "-c", WATCHED, watched]
        printed = subprocess.run(
            command, env=environment, check=True, stdout=subprocess.PIPE, text=True
        ).stdout
    line = next(line for line in printed.splitlines() if line.startswith("WATCHED"))
    rows: list[dict[str, object]] = []
    for phase, way, files in json.loads(line.removeprefix("WATCHED")):
        rooms = Counter("/".join(Path(name).parts[:-1][:2]) for name in files)
        text = ", ".join(f"{room} {number}" for room, number in sorted(rooms.items()))
        rows.append({"what": phase, "counted": way, "files": len(files), "by room": text})
    return rows


def _write_study(folder: Path) -> None:
    """A study of one walk; none where the data collection is absent."""
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
    """The options of the command line."""
    parser.add_argument(
        "--tree",
        type=Path,
        default=Path(__file__).parents[1],
        help="a checkout; this one by default",
    )


def run(tree: Path) -> list[dict[str, object]]:
    """The rows of a checkout."""
    return count(tree)

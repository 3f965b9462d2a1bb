"""Every setup file of the data collection through `run-tool` and through OpenSim 4.6.

Their tables are compared column by column.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.opensim_tools import read_table
from benchmarks.run_setup import run_in_opensim
from myomorph.exchange.opensim.run import run_tool

ROOM = "p/q/r/s"
"""The setup's folder in the copy, so deep that `../../..` stays inside it."""

COLUMNS = ("tables", "alike", "columns", "median", "worst", "where")
FLOOR = 0.01
"""A column's range counts for no less than this share of the largest of its table."""

OURS = {"InverseKinemtaticsTool": "InverseKinematicsTool"}
GAIT = "opensim-gait-subject01/"
SMALL = "opensim-reference-small/"
RAJAGOPAL = "rajagopal-walk-emg/"
LENHART = "lenhart-knee-contact-walk/"
EXPERIMENT = f"{GAIT}experiment/"


@dataclass(frozen=True)
class Needs:
    """What a setup names and its folder lacks.

    `files`: from the collection to where the setup looks, relative to it; `made`: results of other
    setups of the collection, as OpenSim makes them, in the same folder; `folders`: for results,
    which OpenSim's inverse kinematics does not make; `edits`: in the setup; `expected`: tables of
    the collection that hold the result, by the name of ours, where OpenSim 4.6 gives none.
    """

    files: tuple[tuple[str, str], ...] = ()
    made: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()
    edits: tuple[tuple[str, str], ...] = ()
    expected: tuple[tuple[str, str], ...] = ()


NEEDS = {
    "c3d-functional-joints/models/wholebody.xml": Needs(
        (("c3d-functional-joints/static.trc", "static.trc"),)
    ),
    f"{GAIT}ref_scale/subject01_Setup_Scale.xml": Needs(
        ((f"{EXPERIMENT}subject01_static.trc", "subject01_static.trc"),)
    ),
    f"{EXPERIMENT}subject01_Setup_IK.xml": Needs(made=("gait2354_Setup_Scale.xml",)),
    f"{EXPERIMENT}subject01_Setup_InverseDynamics.xml": Needs(
        made=("gait2354_Setup_Scale.xml", "subject01_Setup_IK.xml")
    ),
    f"{GAIT}ref_so_10dof18musc/staticoptimization_spring_Setup.xml": Needs(
        ((f"{GAIT}ref_rra/subject01_walk1_grf.mot", "subject01_walk1_grf.mot"),)
    ),
    f"{RAJAGOPAL}raw/id_setup_walk.xml": Needs(
        (
            (f"{RAJAGOPAL}subject_walk_scaled.osim", "../CMC/walk/subject_walk_adjusted.osim"),
            (
                f"{RAJAGOPAL}coordinates.sto",
                "../RRA/walk/results_rra_2/rra_walk_2_Kinematics_q.sto",
            ),
            (f"{RAJAGOPAL}raw/grf_walk.mot", "../ExpData/grf_walk.mot"),
        )
    ),
    f"{RAJAGOPAL}raw/ik_setup_walk.xml": Needs(
        (
            (f"{RAJAGOPAL}subject_walk_scaled.osim", "../Scale/subject_scaled_walk.osim"),
            (f"{RAJAGOPAL}raw/motion_capture_walk.trc", "../ExpData/motion_capture_walk.trc"),
        ),
        folders=("results_walk",),
    ),
    f"{RAJAGOPAL}raw/scale_setup_walk.xml": Needs(
        (
            (f"{RAJAGOPAL}subject_walk_scaled.osim", "subject_scaled_walk.osim"),
            (f"{RAJAGOPAL}raw/static_walk_2.trc", "../ExpData/static_walk_2.trc"),
        ),
        edits=(
            ("<output_model_file>subject_scaled_walk.osim", "<output_model_file>placed_walk.osim"),
        ),
    ),
    f"{LENHART}reference_comak/inverse_dynamics_settings.xml": Needs(
        (
            (f"{LENHART}lenhart2015.osim", "../../../models/lenhart2015/lenhart2015.osim"),
            *(
                (f"{LENHART}motion/{name}", f"../../../models/lenhart2015/motion_data/{name}")
                for name in ("overground_17_ext_loads.xml", "overground_17_grf.mot")
            ),
            (f"{LENHART}reference_comak/walking_values.sto", "../results/comak/walking_values.sto"),
        ),
        expected=(
            (
                "walking_inverse_dynamics.sto",
                f"{LENHART}reference_comak/walking_inverse_dynamics.sto",
            ),
        ),
    ),
    f"{SMALL}arm26_Setup_InverseDynamics.xml": Needs(
        expected=(("arm26_InverseDynamics.sto", f"{SMALL}std_arm26_InverseDynamics.sto"),)
    ),
    f"{SMALL}arm26_Setup_StaticOptimization.xml": Needs(
        expected=tuple(
            (
                f"arm26_StaticOptimization_{kind}.sto",
                f"{SMALL}std_Thelen2003Muscle_arm26_StaticOptimization_{kind}.sto",
            )
            for kind in ("activation", "force")
        )
    ),
}


def setups(data: Path) -> list[tuple[str, str]]:
    """Path in the collection and tool of every setup file, found by what it holds."""
    found = []
    for path in sorted(data.rglob("*.xml")):
        tags = re.findall(r"<(\w+)", path.read_text(errors="replace")[:3000])
        root = next((tag for tag in tags if tag not in ("xml", "OpenSimDocument")), "")
        if root.endswith("Tool"):
            found.append((path.relative_to(data).as_posix(), root))
    return found


def copied(data: Path, name: str, needs: Needs, room: Path) -> Path:
    """Copy a setup's folder and the files it needs from elsewhere; return the setup."""
    folder = room / ROOM
    shutil.copytree(data / Path(name).parent, folder, copy_function=shutil.copyfile)
    for source, target in needs.files:
        place = folder / target
        place.parent.mkdir(parents=True, exist_ok=True)
        if source.endswith("coordinates.sto"):
            # OpenSim's inverse dynamics takes plain names of coordinates only: with those of states
            # the model stands.
            text = (data / source).read_text()
            place.write_text(re.sub(r"/jointset/\w+/(\w+)/value", r"\1", text))
        else:
            shutil.copyfile(data / source, place)
    for made in needs.folders:
        (folder / made).mkdir()
    setup = folder / Path(name).name
    setup.chmod(0o644)
    for before, after in needs.edits:
        text = setup.read_text()
        assert before in text, f"{name} has no {before}"
        setup.write_text(text.replace(before, after))
    return setup


def new_files(room: Path, run: Callable[[], str]) -> tuple[list[str], str]:
    """Return files that a run makes or changes in a folder, relative to it, and what it printed."""
    before = {path: path.stat().st_mtime_ns for path in room.rglob("*")}
    said = run()
    after = [
        path
        for path in room.rglob("*")
        if path.is_file() and before.get(path) != path.stat().st_mtime_ns
    ]
    return (
        sorted(path.relative_to(room).as_posix() for path in after if path.name != "opensim.log"),
        said,
    )


def ours(setup: Path) -> str:
    """Run a setup here; return the error where it is refused, "" where not."""
    try:
        run_tool(setup)
    except mm.MyomorphError as error:
        return str(error).replace(str(setup.parent), "").lstrip("/")
    return ""


@dataclass(frozen=True, kw_only=True)
class _Runs:
    """What both programs made of a setup.

    Attributes
    ----------
    ours, theirs : folders
    files, their_files : new files, relative to their folder
    refused, failed : what was printed where a program did not run, "" where it did
    """

    ours: Path
    theirs: Path
    files: Sequence[str]
    their_files: Sequence[str]
    refused: str
    failed: str


def measure_setups(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each setup file: what both programs write, and how it differs."""
    for name, root in setups(data):
        needs = NEEDS.get(name, Needs())
        with tempfile.TemporaryDirectory() as work:
            runs = _run_both(data, name, OURS.get(root, root), needs, Path(work))
            pairs = _pairs(runs)
            against = "OpenSim 4.6"
            if not pairs and needs.expected and not runs.refused:
                pairs = _expected_pairs(data, runs, needs)
                against = "table of the collection"
            written = bool(pairs or runs.their_files)
            row: dict[str, object] = {"setup": name, "tool": root}
            row |= {"files": len(runs.files), "against": against if written else ""}
            row |= dict.fromkeys(COLUMNS, "") | (compared(pairs) if pairs else {})
            row["notes"] = "; ".join(_notes(runs))
        yield row


def _run_both(data: Path, name: str, tool: str, needs: Needs, work: Path) -> _Runs:
    mine = copied(data, name, needs, work / "ours")
    other = copied(data, name, needs, work / "theirs")
    for made in needs.made:
        kind = dict(setups(data))[(Path(name).parent / made).as_posix()]
        for path in (mine, other):
            run_in_opensim(path.parent / made, kind)
    files, refused = new_files(work / "ours", partial(ours, mine))
    their_files, failed = new_files(work / "theirs", partial(run_in_opensim, other, tool))
    return _Runs(
        ours=work / "ours",
        theirs=work / "theirs",
        files=files,
        their_files=their_files,
        refused=refused,
        failed=failed,
    )


def _pairs(runs: _Runs) -> list[tuple[Path, Path, str]]:
    """Return the tables that both programs wrote, with their name."""
    return [
        (runs.ours / one, runs.theirs / one, one)
        for one in runs.files
        if one in runs.their_files and is_table(one)
    ]


def _expected_pairs(data: Path, runs: _Runs, needs: Needs) -> list[tuple[Path, Path, str]]:
    """Return our tables with those of the collection, and their name."""
    given = {target: data / path for target, path in needs.expected}
    named = [(one, Path(one).name) for one in runs.files]
    return [(runs.ours / one, given[target], one) for one, target in named if target in given]


def _notes(runs: _Runs) -> Iterator[str]:
    if runs.refused:
        yield f"refused: {runs.refused}"
    if any(one.endswith(".osim") for one in runs.files):
        yield "models: see ScaleTool"
    if runs.failed:
        yield f"OpenSim: {runs.failed[:110]}"
    missing = [one for one in runs.their_files if one not in runs.files]
    names = [Path(one).name for one in missing if not one.endswith("_controls.xml")]
    if names and runs.files:
        yield f"only OpenSim writes {', '.join(names)}"


def is_table(name: str) -> bool:
    """Whether a file is a table of numbers by its name."""
    return name.endswith((".sto", ".mot"))


def compared(pairs: list[tuple[Path, Path, str]]) -> dict[str, object]:
    """How far apart the tables of pairs of files are, each column by its range."""
    columns = 0
    shares = []
    same = 0
    worst = (0.0, "")
    for mine, other, name in pairs:
        ours = read_table(mine)
        theirs = read_table(other)
        near = same_rows(ours[0], theirs[0])
        same += ours[1] == theirs[1] and len(ours[0]) == len(theirs[0])
        common = [one for one in theirs[1] if one in ours[1]]
        x = ours[2][near[0]][:, [ours[1].index(one) for one in common]]
        y = theirs[2][near[1]][:, [theirs[1].index(one) for one in common]]
        share = apart(x, y)
        shares += list(share)
        columns += len(common)
        k = int(np.argmax(share))
        if share[k] >= worst[0]:
            table = Path(name).stem.split("_", 1)[-1]
            worst = (float(share[k]), f"{table}: {common[k]}")
    return {
        "tables": len(pairs),
        "alike": same,
        "columns": columns,
        "median": float(np.median(shares)),
        "worst": worst[0],
        "where": worst[1],
    }


def same_rows(ours: np.ndarray, theirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of two tables that stand at one time, to a microsecond.

    They are all of them where the tables have as many.

    Parameters
    ----------
    ours : (rows,) times [s]
    theirs : (rows,) times [s]

    Returns
    -------
    (n,) indices into ours, and (n,) into theirs
    """
    if len(ours) == len(theirs):
        return np.arange(len(ours)), np.arange(len(ours))
    near = np.array([int(np.argmin(np.abs(theirs - at))) for at in ours])
    good = np.abs(theirs[near] - ours) < 1e-6
    return np.flatnonzero(good), near[good]


def apart(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the largest difference of every column over the range of the second table's.

    Parameters
    ----------
    x : (rows, columns) of one table
    y : (rows, columns) of the other

    Returns
    -------
    (columns,) relative to the range, which is at least `FLOOR`; inf where one is NaN
    """
    # A pose has no range: its columns count by the largest of them.
    span = (
        np.nanmax(y, axis=0) - np.nanmin(y, axis=0)
        if len(y) > 1
        else np.full(y.shape[1], np.abs(y).max())
    )
    size = max(
        float(np.nanmax(span, initial=0.0)), FLOOR * float(np.nanmax(np.abs(y), initial=0.0)), 1e-12
    )
    span = np.maximum(span, FLOOR * size)
    both = np.isnan(x) == np.isnan(y)
    found: np.ndarray = np.where(
        both.all(axis=0), np.nanmax(np.abs(x - y), axis=0, initial=0.0) / span, np.inf
    )
    return found

"""Messages of `myomorph analyze` on clean walks, and causes that may change a number of the page.

A walk is clean where markers and plates were recorded as they should be: whoever reads the page of
one must not have to search for the warning that counts. One sentence was said for each stretch of
time before messages had causes; these are counted as they were.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.accuracy.laboratory.analyze import GAIT, KNEE, LENHART, c3d_mass
from myomorph.core.model.causes import CONTACTS
from myomorph.core.model.message_groups import CauseGroup, grouped_messages
from myomorph.core.model.messages import Message
from myomorph.lab.cli import main
from myomorph.lab.store.results import read_result, result_files
from myomorph.lab.study.trial.reporting import model_of, report_input

Row = dict[str, object]
MOST = 5
"""Warnings that a clean walk may have."""


@dataclass(frozen=True, kw_only=True)
class CleanWalk:
    """A walk of the data collection.

    Attributes
    ----------
    laboratory : where it was recorded, as far as its set says it
    file : below the collection
    mass : of the set [kg], 0 for that in the file
    static : static trial, "" for one that is found
    span : the part that is used [s], None for all
    """

    laboratory: str
    file: str
    mass: float
    static: str = ""
    span: tuple[float, float] | None = None


VENDORS = "c3d-vendor-samples/C3DSamples"
WALKS = (
    CleanWalk(laboratory="McGill, child", file=f"{GAIT}/HC030A/Straight/HC030A05.c3d", mass=45.8),
    CleanWalk(laboratory="McGill, adult", file=f"{GAIT}/HC002D/Straight/HC002D06.c3d", mass=0.0),
    CleanWalk(
        laboratory="Rajagopal, Stanford",
        file="rajagopal-walk-emg/markers_walk.trc",
        mass=85.27,
        static="rajagopal-walk-emg/raw/static_walk_1.trc",
        span=(0.5, 2.5),
    ),
    CleanWalk(
        laboratory="OpenSim, gait2354",
        file="opensim-gait-subject01/experiment/subject01_walk1.trc",
        mass=72.6,
    ),
    CleanWalk(
        laboratory="OpenCap",
        file="opencap-subject4-multitask/markers/walking1.trc",
        mass=62.6,
        static="opencap-subject4-multitask/markers/static1.trc",
    ),
    CleanWalk(
        laboratory="Lenhart, Wisconsin", file=f"{LENHART}/motion/overground_17.trc", mass=62.0
    ),
    CleanWalk(laboratory="instrumented knee, first walk", file=f"{KNEE}/walk1.c3d", mass=75.0),
    CleanWalk(laboratory="instrumented knee, third walk", file=f"{KNEE}/walk3.c3d", mass=75.0),
    # Sets of the last two state no mass: it is a guess.
    CleanWalk(laboratory="OpenSim's C3D walk", file="c3d-opensim-walking/walking5.c3d", mass=70.0),
    CleanWalk(
        laboratory="vendors' samples, six plates", file=f"{VENDORS}/others/Gait.c3d", mass=70.0
    ),
)


def measure(folder: Path) -> Iterator[Row]:
    """Count, a row a walk, sentences as they were said before, messages, warnings and causes."""
    for walk in WALKS:
        with tempfile.TemporaryDirectory() as name:
            out = Path(name) / "out"
            said = io.StringIO()
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                status = main(typed(walk, folder, out))
            messages = messages_of_trial(out) if status == 0 else ()
        if status:
            raise RuntimeError(f"{walk.file}: {said.getvalue().splitlines()[-1]}")
        row = _row(walk, messages)
        print(f"{walk.laboratory}: {row['sentences before']} to {row['warnings']}", flush=True)
        yield row


def typed(walk: CleanWalk, folder: Path, out: Path) -> list[str]:
    """Return the command on a walk."""
    path = folder / walk.file
    mass = walk.mass or c3d_mass(path)
    words = ["analyze", str(path), "--out", str(out), "--workers", "1", "--mass", f"{mass:g}"]
    if walk.static:
        words += ["--static", str(folder / walk.static)]
    if walk.span is not None:
        words += ["--time", *(f"{second:g}" for second in walk.span)]
    return words


def messages_of_trial(out: Path) -> tuple[Message, ...]:
    """Messages of the only trial's page."""
    (path,) = result_files(out)
    stored = read_result(path)
    return report_input(stored, model_of(stored), drawn=False).head.warnings


def _row(walk: CleanWalk, messages: tuple[Message, ...]) -> Row:
    groups = grouped_messages(messages)
    warnings = [group for group in groups if group.is_warning]
    return {
        "laboratory": walk.laboratory,
        "recording": Path(walk.file).name,
        "sentences before": sum(map(_sentences, messages)),
        "messages": len(messages),
        "warnings": sum(len(group.messages) for group in warnings),
        "causes": len(warnings),
        "change results": _named(warnings, "changes results"),
        "may change results": _named(warnings, "may change results"),
        "at most five": sum(len(group.messages) for group in warnings) <= MOST,
    }


def _sentences(message: Message) -> int:
    """How many sentences a message was: those of contacts had one for each stretch of time."""
    return max(1, len(message.times)) if message.cause.key == CONTACTS.key else 1


def _named(groups: list[CauseGroup], severity: str) -> str:
    return "; ".join(
        f"{group.cause.title} ({len(group.messages)})"
        for group in groups
        if group.severity == severity
    )

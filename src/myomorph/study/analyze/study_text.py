"""The study file that `analyze` writes: what is to be done with which files, and what was assumed, as comments."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

from myomorph.model.frozen_map import FrozenMap
from myomorph.store.settings import ForceOptions
from myomorph.study.inputs.laboratory import AS_RECORDED, Laboratory

SUBJECT = "subject"
STEPS = ("calibrate", "ik", "id", "muscles", "tension", "report")
WIDTH = 118
MARK = "# As it was written: "
"""Before the digest of all lines above, by which a later `analyze` knows that nobody has changed the file."""


@dataclass(frozen=True)
class TrialEntry:
    """A trial of the study file; what is empty is left to the study.

    Attributes
    ----------
    dead : EMG channels without a signal
    assumed : sentences on this recording
    """

    name: str
    markers: Path
    laboratory: Laboratory = AS_RECORDED
    loads: Path | None = None
    emg: Path | None = None
    contacts: str = ""
    dead: tuple[str, ...] = ()
    time: tuple[float, float] | None = None
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class StudyEntries:
    """What the study file says.

    Attributes
    ----------
    command : that wrote it
    labels : recorded label to the model's marker
    emg_muscles : EMG channel to muscles
    draws : with errors in all inputs, None for none
    forces : how tables of forces are laid out, and their clock
    assumed : sentences on all recordings
    """

    name: str
    command: str
    model: Path
    mass: float
    trials: tuple[TrialEntry, ...]
    static: Path | None = None
    static_laboratory: Laboratory = AS_RECORDED
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    emg_side: str = ""
    emg_mvc: tuple[Path, ...] = ()
    tasks: Path | None = None
    steps: tuple[str, ...] = STEPS
    draws: int | None = None
    forces: ForceOptions = field(default_factory=ForceOptions)
    assumed: tuple[str, ...] = ()


def study_text(study: StudyEntries, folder: Path) -> str:
    """The study file, its paths relative to the folder that it lies in."""

    def path(one: Path) -> str:
        return _text(_relative(one, folder))

    lines = [f"# Written by: {' '.join(study.command.split())}", "# Change it as you like; these words run it again:"]
    lines += [f"# myomorph run {_shell(folder / 'study.toml')} --out {_shell(folder)}", "#", "# What was assumed:"]
    for text in study.assumed:
        lines += _comment(text)
    lines += [
        "",
        "[study]",
        f"name = {_text(study.name)}",
        "flat = true",
        "",
        *_forces(study.forces),
        *([] if study.draws is None else ["[uncertainty]", f"draws = {study.draws}", ""]),
        "[[subject]]",
        f"name = {_text(SUBJECT)}",
    ]
    lines += [f"model = {path(study.model)}", f"mass = {study.mass:g}"]
    ups = {one.laboratory.up for one in study.trials} | ({study.static_laboratory.up} if study.static else set())
    up = next(iter(ups)) if len(ups) == 1 else ""
    if up:
        lines.append(f"up = {_text(up)}")
    if study.static is not None:
        lines.append(f"static = {path(study.static)}")
        if study.static_laboratory.turn:
            lines.append(f"static_turn = {study.static_laboratory.turn:g}")
    if study.tasks is not None:
        lines.append(f"tasks = {path(study.tasks)}")
    lines.append(f"steps = [{', '.join(_text(step) for step in study.steps)}]")
    if study.emg_side:
        lines.append(f"emg_side = {_text(study.emg_side)}")
    if study.emg_mvc:
        lines.append(f"emg_mvc = [{', '.join(path(one) for one in study.emg_mvc)}]")
    lines.append("assumed = [")
    lines += [f"  {_text(text)}," for text in study.assumed]
    lines.append("]")
    dead: dict[str, tuple[str, ...]] = {channel: () for trial in study.trials for channel in trial.dead}
    channels = dead | dict(study.emg_muscles)
    for title, table in (
        ("labels", {old: _text(new) for old, new in study.labels.items()}),
        ("emg_muscles", {name: f"[{', '.join(map(_text, names))}]" for name, names in channels.items()}),
    ):
        if table:
            lines += ["", f"[subject.{title}]", *(f"{_text(key)} = {value}" for key, value in table.items())]
    for trial in study.trials:
        lines += ["", "[[subject.trials]]"]
        for text in trial.assumed:
            lines += _comment(text)
        lines += [f"name = {_text(trial.name)}", f"markers = {path(trial.markers)}"]
        if not up and trial.laboratory.up:
            lines.append(f"up = {_text(trial.laboratory.up)}")
        if trial.laboratory.turn:
            lines.append(f"turn = {trial.laboratory.turn:g}")
        for key, file in (("loads", trial.loads), ("emg", trial.emg)):
            if file is not None:
                lines.append(f"{key} = {path(file)}")
        if trial.contacts:
            lines.append(f"contacts = {_text(trial.contacts)}")
        if trial.time is not None:
            lines.append(f"time = [{trial.time[0]:.4g}, {trial.time[1]:.4g}]")
        if trial.assumed:
            lines += ["assumed = [", *(f"  {_text(text)}," for text in trial.assumed), "]"]
    text = "\n".join(lines) + "\n"
    return f"{text}{MARK}{_digest(text)}\n"


def _forces(options: ForceOptions) -> list[str]:
    """Settings of forces that are not the usual ones."""
    usual = ForceOptions()
    changed = {field.name: getattr(options, field.name) for field in fields(options)}
    changed = {name: value for name, value in changed.items() if value != getattr(usual, name)}
    if not changed:
        return []
    values = {name: _text(value) if isinstance(value, str) else f"{value:g}" for name, value in changed.items()}
    return ["[options.id]", *(f"{name} = {value}" for name, value in values.items()), ""]


def is_unchanged(text: str) -> bool:
    """Whether a study file is still as `study_text` made it, so that nothing is lost with it."""
    body, mark, digest = text.rpartition(MARK)
    return bool(mark) and digest.strip() == _digest(body)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _relative(path: Path, folder: Path) -> str:
    """A path as seen from a folder; absolute where they share no drive."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _text(text: str) -> str:
    """A TOML string."""
    plain = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(one if one.isprintable() else " " for one in plain) + '"'


def _shell(path: Path) -> str:
    text = str(path)
    return f'"{text}"' if " " in text else text


def _comment(text: str) -> list[str]:
    """A sentence as comment lines."""
    lines, line = [], "# -"
    for word in text.split():
        if len(line) + 1 + len(word) > WIDTH:
            lines.append(line)
            line = "#  "
        line += f" {word}"
    return [*lines, line]

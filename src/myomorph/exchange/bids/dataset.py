"""A study as a BIDS dataset: recordings of motion and EMG, and results as derivatives.

BIDS specification 1.11 (motion, EMG, derivatives). What a derivative was derived from stands in its
JSON file.
"""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from myomorph import __version__
from myomorph.core.io.c3d.emg import emg_channels
from myomorph.core.io.formats import trial_format
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.errors import BadFile, MissingPackage, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located
from myomorph.core.model.series import Series, Trial, Wrenches
from myomorph.exchange.bids.recording import (
    ENDINGS,
    FORCES,
    MARKERS,
    force_signals,
    marker_signals,
    read_emg,
    read_motion_trial,
    write_emg,
    write_events,
)
from myomorph.exchange.bids.signals import (
    DATASET,
    MOTION,
    facts_of_file,
    read_signals,
    read_tsv,
    write_json,
    write_signals,
    write_tsv,
)
from myomorph.exchange.bids.tables import LOADS, label_of, name_of, result_tables
from myomorph.exchange.causes import DATASETS
from myomorph.lab.convert.axes import turned, vertical
from myomorph.lab.convert.recording import Recording, read_parts
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import Stored, read_result, result_files
from myomorph.lab.study.inputs.emg_files import channels_of
from myomorph.lab.study.inputs.reading import read_recording
from myomorph.lab.study.step.step import large_variables
from myomorph.lab.study.trial.reporting import source_file

VERSION = "1.11.1"  # Of the specification that is written.
DERIVED = Path("derivatives", "myomorph")
PARTICIPANTS = "participants.tsv"
GENERATED = {"Name": "Myomorph", "Version": __version__}
GROUND = "The laboratory's ground in metres, y upwards where the vertical is known"
README = """{name}

Recordings and results of a study, written by Myomorph {version}.

sub-*/motion holds markers (tracksys-markers) and forces (tracksys-forces), sub-*/emg EMG as it \
was recorded.
derivatives/myomorph holds what was computed of them; its JSON files state the step, its \
settings, and the hashes of the
files it was made from. Times count from the first frame; StartTime in JSON files is the time of \
that on the recording's
clock. Authors, licence, devices and how electrodes were placed are not known to the program: \
add them before sharing.
"""


@dataclass(frozen=True)
class BidsTrial:
    """A trial of a dataset as read back.

    Attributes
    ----------
    recording : markers [m], plates [N] and events; None where it has no motion
    emg : raw EMG
    derived : tables of derivatives by the names of their quantities: "coordinate_value" [rad, m],
        "generalized_force" [N m, N], "muscle_force" [N], "external_force",
        "muscle_force_intervals", ..., each with its `channels`, and the `facts` of its JSON file
    """

    recording: Trial | None = None
    emg: Series | None = None
    derived: Mapping[str, Series] = field(default_factory=lambda: FrozenMap({}))


def export_bids(results: Path, out: Path) -> tuple[str, ...]:
    """Write the recordings and results of a study as a dataset of BIDS, whole or not at all.

    The folder to make may exist, but hold nothing. Gives what is written otherwise than it was
    recorded, one line each. Raises `BadFile` where there are no results or the folder holds
    something, `MissingPackage` where there is EMG, and edfio is not installed.

    Source: Gorgolewski et al. 2016; Jeung et al. 2024 (motion).
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadFile(out, "is not an empty folder", "give a new one: a dataset is written whole")
    paths = result_files(results)
    home = results if results.is_dir() else results.parent
    out.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    try:
        dataset = _Dataset(made, _study_name(home), _conditions(home))
        for path in paths:
            dataset.add(
                read_result(path, leave_out=large_variables()), path.parent.relative_to(home).parts
            )
        dataset.finish()
        made.chmod(0o755)
        if out.exists():
            out.rmdir()
        os.replace(made, out)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    return tuple(dataset.notes)


class _Dataset:
    """A dataset that is being written, one trial after the other."""

    def __init__(self, folder: Path, name: str, conditions: Mapping[tuple[str, str], str]):
        self.folder = folder
        self.name = name
        self.conditions = conditions
        self.subjects: dict[str, dict[str, str]] = {}  # by label what participants.tsv states
        self.notes: list[Message] = []
        self._labels: dict[tuple[str, str], str] = {}

    def add(self, stored: Stored, place: tuple[str, ...]) -> None:
        """Write a trial whose results lie at `place` below those of the study.

        The place is subject, session if any, and trial.
        """
        subject = stored.facts.get("subject", "") or (place[0] if place else "1")
        trial = stored.facts.get("trial", "") or stored.path.stem
        label = self._label("subject", subject)
        session = "".join(re.sub(r"[^0-9A-Za-z]", "", part) for part in place[1:-1])
        task = self._label(f"task {label} {session}", trial)
        mass = stored.facts.get("mass", "")
        self.subjects.setdefault(label, {"subject": subject, "mass": ""})
        self.subjects[label]["mass"] = self.subjects[label]["mass"] or mass
        names = [f"sub-{label}", *([f"ses-{session}"] if session else [])]
        stem = "_".join((*names, f"task-{task}"))
        told = {"TaskName": trial}
        if condition := self.conditions.get((subject, trial), ""):
            told["TaskDescription"] = condition
        self._write_recording(stored, Path("/".join(names)), stem, told)
        derived = self.folder.joinpath(DERIVED, *names, "motion")
        derived.mkdir(parents=True, exist_ok=True)
        for table, signals in result_tables(stored):
            whole = replace(signals, facts=told | dict(signals.facts))
            write_signals(
                derived / f"{stem}_tracksys-{table}",
                whole,
                GROUND if table == label_of(LOADS) else "",
            )

    def _label(self, kind: str, name: str) -> str:
        """Letters and digits of a name, with a number behind them where another has the same."""
        if (kind, name) not in self._labels:
            plain = re.sub(r"[^0-9A-Za-z]", "", name) or "x"
            taken = {label.lower() for (other, _), label in self._labels.items() if other == kind}
            numbers = (
                plain if count == 1 else f"{plain}x{count}" for count in range(1, len(taken) + 2)
            )
            self._labels[kind, name] = next(
                label for label in numbers if label.lower() not in taken
            )
        return self._labels[kind, name]

    def _write_recording(
        self, stored: Stored, place: Path, stem: str, told: Mapping[str, Any]
    ) -> None:
        """Raw files of a trial, as far as the files it was made from are still there."""
        recording, emg, notes = _recorded(stored)
        self.notes += located(str(told["TaskName"]), notes)
        motion = self.folder / place / "motion"
        start = None
        if recording.markers is not None:
            motion.mkdir(parents=True, exist_ok=True)
            start = float(recording.markers.time[0])
            write_signals(
                motion / f"{stem}_tracksys-{MARKERS}",
                marker_signals(recording.markers, told),
                GROUND,
            )
        if recording.wrenches is not None and recording.wrenches.names:
            motion.mkdir(parents=True, exist_ok=True)
            start = float(recording.wrenches.time[0]) if start is None else start
            plates = [
                {"Name": plate.name, "Corners": plate.corners.tolist()}
                for plate in recording.plates or ()
            ]
            facts = dict(told) | ({"ForcePlates": plates} if plates else {})
            write_signals(
                motion / f"{stem}_tracksys-{FORCES}",
                force_signals(recording.wrenches, facts),
                GROUND,
            )
        if recording.events and start is not None:
            write_events(motion / stem, recording.events, start)
        if emg is not None:
            home = self.folder / place / "emg"
            home.mkdir(parents=True, exist_ok=True)
            units = getattr(emg, "units", ()) or ("",) * len(emg.names)
            write_emg(home / stem, emg, tuple(unit or "n/a" for unit in units), told)

    def finish(self) -> None:
        """Write what describes the whole."""
        about = {"Name": self.name, "BIDSVersion": VERSION, "GeneratedBy": [GENERATED]}
        write_json(self.folder / DATASET, about | {"DatasetType": "raw"})
        (self.folder / "README").write_text(
            README.format(name=self.name, version=__version__), encoding="utf-8"
        )
        rows = [
            (f"sub-{label}", facts["subject"], facts["mass"])
            for label, facts in sorted(self.subjects.items())
        ]
        write_tsv(self.folder / PARTICIPANTS, ("participant_id", "subject", "mass"), rows)
        columns = {
            "subject": {"Description": "name in the study"},
            "mass": {"Description": "mass of the body", "Units": "kg"},
        }
        write_json(self.folder / "participants.json", columns)
        derived = {
            "Name": f"{self.name}: results",
            "DatasetType": "derivative",
            "SourceDatasets": [{"URL": "../.."}],
        }
        write_json(self.folder / DERIVED / DATASET, about | derived)
        (self.folder / DERIVED / "README").write_text(
            (self.folder / "README").read_text("utf-8"), encoding="utf-8"
        )


def _recorded(stored: Stored) -> tuple[Recording, Series | None, list[Message]]:
    """Read what was recorded from the files that results were derived from.

    y points upwards where the vertical is known. Of files that are gone or have changed, what the
    results hold of them is returned instead.
    """
    sources = {
        source.role: source
        for made in stored.provenance.values()
        for source in made.sources
        if Path(source.name).suffix
    }
    notes: list[Message] = []

    def of(role: str, read: Callable[[Path], Any]) -> Any:
        """Read a source, None where there is none, or no longer."""
        if role not in sources:
            return None
        try:
            return read(source_file(sources[role], stored))
        except MissingPackage:
            raise
        except MyomorphError as error:
            notes.append(DATASETS.message(f"{error}: the dataset has what the results hold"))
            return None

    recording = of("markers", lambda path: read_parts([path])) or Recording("")
    if recording.markers is None:
        recording = replace(
            recording, markers=store.get_markers(stored), events=store.get_events(stored)
        )
    elif vertical(recording) == "z":
        recording = turned(recording, "y", "", "")
    wrenches = of("loads", _wrenches) or recording.wrenches or store.get_wrenches(stored)
    return (
        replace(recording, wrenches=wrenches),
        of("emg", lambda path: _raw_emg(path, stored)),
        notes,
    )


def _wrenches(path: Path) -> Wrenches | None:
    """Read forces of a file of loads, in ground.

    None for a recording with plates, and for steps that measure force.
    """
    if path.suffix.lower() == ".xml":
        return read_external_loads(path)
    if trial_format(path) is not None:
        recording = read_parts([path])
        return (
            turned(recording, "y", "", "") if vertical(recording) == "z" else recording
        ).wrenches
    return read_parts([path]).wrenches


def _raw_emg(path: Path, stored: Stored) -> Series:
    """Channels of a file of EMG; of a C3D file those that are muscle signals."""
    channels = channels_of(path)
    if path.suffix.lower() != ".c3d":
        return channels
    used = stored.names.get("emg_channel", ()) or emg_channels(read_recording(path))
    return channels.columns([channels.names.index(name) for name in used if name in channels.names])


def _study_name(home: Path) -> str:
    """Name of the study that wrote a folder, else the folder's."""
    try:
        return str(
            json.loads((home / "tables_provenance.json").read_text(encoding="utf-8"))["options"][
                "name"
            ]
        )
    except (OSError, ValueError, KeyError, TypeError):
        return home.resolve().name


def _conditions(home: Path) -> dict[tuple[str, str], str]:
    """Condition of each trial, by subject and trial, where the study has some."""
    path = home / "results.csv"
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as stream:
        return {
            (row["subject"], row["trial"]): row.get("condition") or ""
            for row in csv.DictReader(stream)
        }


def read_bids(folder: Path) -> Mapping[str, BidsTrial]:
    """Read trials of a dataset by subject and trial, e.g. "s01/walk1".

    They are recordings, and the derivatives of `export_bids`. Raises `BadFile` where it is no
    dataset of motion or EMG, `MissingPackage` for EMG without edfio.
    """
    if not (folder / DATASET).is_file():
        raise BadFile(
            folder,
            f"is no dataset of BIDS: it has no {DATASET}",
            "give the folder that holds the subjects",
        )
    subjects = _subjects(folder / PARTICIPANTS)
    trials: dict[str, BidsTrial] = {}
    for derived, home in ((False, folder), (True, folder / DERIVED)):
        for path in sorted(home.glob("sub-*/**/*")):
            if path.name.endswith(MOTION) or path.suffix in ENDINGS:
                entities = dict(part.split("-", 1) for part in path.name.split("_") if "-" in part)
                key = _key(path, entities, subjects)
                trial = trials.get(key, BidsTrial())
                if derived:
                    trials[key] = _with_table(trial, name_of(entities["tracksys"]), path)
                else:
                    trials[key] = _with_recording(trial, path)
    if not trials:
        raise BadFile(folder, "holds no motion and no EMG", "expected sub-*/motion or sub-*/emg")
    return FrozenMap(trials)


def _subjects(table: Path) -> dict[str, str]:
    """Read the names of subjects by participant, "sub-01"; none without a table."""
    rows = read_tsv(table) if table.is_file() else ()
    return {row["participant_id"]: row.get("subject", "") for row in rows}


def _key(path: Path, entities: Mapping[str, str], subjects: Mapping[str, str]) -> str:
    """Return the key of a file's trial: subject, session if any, and task.

    `entities`: of the file's name, e.g. "01" by "sub".
    """
    subject = subjects.get(f"sub-{entities['sub']}", "") or entities["sub"]
    session = [entities["ses"]] if "ses" in entities else []
    task = str(facts_of_file(path).get("TaskName", entities["task"]))
    return "/".join((subject, *session, task))


def _with_table(trial: BidsTrial, name: str, path: Path) -> BidsTrial:
    """Add a derived table to a trial."""
    return replace(trial, derived=FrozenMap({**trial.derived, name: read_signals(path)}))


def _with_recording(trial: BidsTrial, path: Path) -> BidsTrial:
    """Add a recording to a trial: EMG, or motion where it has no markers yet."""
    if path.suffix in ENDINGS:
        return replace(trial, emg=read_emg(path))
    if trial.recording is None or trial.recording.markers is None:
        return replace(trial, recording=read_motion_trial(path))
    return trial

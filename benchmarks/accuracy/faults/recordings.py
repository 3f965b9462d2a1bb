"""Two hundred faults put into the files of ten recordings, each through `myomorph analyze`.

A model is fitted to each clean recording by `analyze`; then the faulty files are analyzed with it,
as in a study whose person is known, up to inverse dynamics, or to muscles where channels of EMG are
exchanged. What is said is compared with what is said of the clean recording. Kinds of faults take
turns, so that each is in as many recordings as can have it.

A fault is named by a message of a cause that it has, or by the error that ends the command, with
words that say what it is, and of markers and channels which. Its effect is the largest change of a
joint torque or an angle.

    python -m benchmarks.accuracy.faults.recordings [SEED]

measures all, in about ten minutes of a quiet core, and prints three tables.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import shlex
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.faults.captures import (
    C3dCapture,
    Capture,
    ForceColumns,
    TableCapture,
    columns_at,
)
from benchmarks.accuracy.faults.fault_kinds import ANALYZE, KINDS, Job, Kind, truncate
from benchmarks.accuracy.faults.marker_faults import inner_angles
from benchmarks.accuracy.faults.unseen_faults import typed
from data_collection import data_folder
from myomorph.core.model.arrays import Array
from myomorph.core.model.message_groups import grouped_messages
from myomorph.core.model.messages import OTHER, SEVERITIES, Message
from myomorph.core.model.scale import scale
from myomorph.core.model.severity import ANGLE_ERROR, FORCE_ERROR
from myomorph.core.motion.stretch import skeleton
from myomorph.lab.causes import SESSION
from myomorph.lab.store.settings import Side
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.emg_files import open_emg
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study

Row = dict[str, object]
SEED = 4
"""Of the sizes that are reported; 1 to 3 are those that were worked with."""
PER_RECORDING = 20
CALIBRATE = ("calibrate", *ANALYZE)
TOLERANCE = 1.25
"""A message that the clean recording has too is new where its size has grown by so much."""
OUTCOMES = (
    "named first",
    "corrected",
    "named later",
    "other blamed",
    "silent, harmless",
    "silent, wrong",
)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recording of the data collection.

    Attributes
    ----------
    name : laboratory and movement
    file : markers, below the collection
    mass : of the person [kg]
    table : forces, "" for plates in the file
    forces : columns of the table
    static : standing still, "" for none
    span : the part that is analyzed [s], None for all
    emg_side : of channels whose names have none
    options : as typed besides
    """

    name: str
    file: str
    mass: float
    table: str = ""
    forces: tuple[ForceColumns, ...] = ()
    static: str = ""
    span: tuple[float, float] | None = None
    emg_side: Side = ""
    options: tuple[str, ...] = ()

    def capture(self, folder: Path) -> Capture:
        """Read its files."""
        if self.table:
            return TableCapture(folder / self.file, folder / self.table, self.forces)
        return C3dCapture(folder / self.file)

    def still(self, folder: Path) -> Capture | None:
        """Read its static trial, forces left out."""
        if not self.static:
            return None
        if self.static.endswith(".c3d"):
            return C3dCapture(folder / self.static)
        return TableCapture(folder / self.static, folder / self.table, self.forces)


GAIT = "c3d-gait-plugingait/HC030A"
CAP = "opencap-subject4-multitask"
RUN = "hamner-run-subject04/run200"
LIFT = "lifting-box-15kg"
SIX = (columns_at(1, 4, 13), columns_at(7, 10, 16))
"""Force and point of two plates, then the torques of both."""
NINE = (columns_at(1, 4, 7), columns_at(10, 13, 16))
"""Force, point and torque of a plate, then of the other."""
RECORDINGS = (
    Recording(
        name="child, walk with EMG",
        file=f"{GAIT}/Straight/HC030A05.c3d",
        mass=45.8,
        static=f"{GAIT}/Static/HC030A01.c3d",
    ),
    Recording(
        name="OpenSim's walk", file="c3d-opensim-walking/walking5.c3d", mass=59.4, span=(1.2, 3.6)
    ),
    Recording(
        name="instrumented knee, walk",
        file="knee-implant-walk/walk1.c3d",
        mass=83.0,
        emg_side="left",
    ),
    Recording(
        name="vendor, walk with EMG",
        file="c3d-vendor-samples/C3DSamples/others/Gait.c3d",
        mass=62.9,
    ),
    Recording(
        name="Rajagopal, walk",
        file="rajagopal-walk-emg/markers_walk.trc",
        mass=85.27,
        table="rajagopal-walk-emg/grf_walk.mot",
        forces=NINE,
        static="rajagopal-walk-emg/raw/static_walk_1.trc",
    ),
    Recording(
        name="OpenCap, drop jump",
        file=f"{CAP}/markers/DJ1.trc",
        mass=62.6,
        table=f"{CAP}/grf/DJ1_grf.mot",
        forces=(*NINE, columns_at(19, 22, 25)),
        static=f"{CAP}/markers/static1.trc",
    ),
    Recording(
        name="OpenCap, rising",
        file=f"{CAP}/markers/STS1.trc",
        mass=62.6,
        table=f"{CAP}/grf/STS1_grf.mot",
        forces=(*NINE, columns_at(19, 22, 25)),
        static=f"{CAP}/markers/static1.trc",
        span=(1.0, 5.0),
    ),
    Recording(
        name="Hamner, run",
        file=f"{RUN}/markers.trc",
        mass=82.0,
        table=f"{RUN}/grf.mot",
        forces=SIX,
    ),
    Recording(
        name="lift of a box",
        file=f"{LIFT}/stoop1.c3d",
        mass=81.68,
        table=f"{LIFT}/stoop1_F1Cop1F2Cop2.csv",
        forces=(columns_at(1, 4), columns_at(7, 10)),
        static=f"{LIFT}/neutral.c3d",
        options=("--force-shift", "-12.4"),
    ),
    Recording(
        name="gait2354, walk",
        file="opensim-gait-subject01/experiment/subject01_walk1.trc",
        mass=72.6,
        table="opensim-gait-subject01/experiment/subject01_walk1_grf.mot",
        forces=SIX,
        static="opensim-gait-subject01/experiment/subject01_static.trc",
    ),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Said:
    """What a command printed, and what it found.

    Attributes
    ----------
    messages : in the order in which they are printed
    error : that ended it, "" for none
    torques, angles : (frames, joints) within the body [N m], [rad]; None where there are none
    """

    messages: tuple[Message, ...] = ()
    error: str = ""
    torques: Array | None = None
    angles: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Clean:
    """A recording with nothing put in.

    Attributes
    ----------
    recording : of the collection
    data : folder of the collection
    home : folder with the model that was fitted to it
    said : by the steps that were run
    """

    recording: Recording
    data: Path
    home: Path
    said: dict[tuple[str, ...], Said] = field(default_factory=dict)

    @property
    def model(self) -> Path:
        """The model that was fitted to it."""
        return self.home / "clean" / "calibrated.osim"

    @property
    def skeleton(self) -> Path:
        """The same without muscles and drawings, which is read faster."""
        path = self.home / "skeleton.osim"
        if not path.is_file():
            mm.write_osim(skeleton(mm.read_model(self.model)), path)
        return path

    @property
    def motion(self) -> Path:
        """Its coordinates."""
        (path,) = (self.home / "clean").rglob("coordinates.mot")
        return path

    def job(self) -> Job:
        """Make a job without fault."""
        capture = self.recording.capture(self.data)
        fitted = self.model.is_file()
        known = set(mm.read_model(self.skeleton).marker_names) if fitted else set()
        used = tuple(label for label in capture.labels if label.rpartition(":")[2] in known)
        return Job(
            capture=capture,
            used=tuple(dict.fromkeys(used)),
            emg=self._channels(capture),
            mass=self.recording.mass,
            frames=_frames(capture, self.recording.span),
            second=self.recording.capture(self.data),
            static=self.recording.still(self.data),
        )

    def _channels(self, capture: Capture) -> tuple[str, ...]:
        """Names of channels of EMG that take part in the clean recording."""
        if not self.model.is_file() or not capture.emg:
            return ()
        model = mm.read_model(self.model)
        path = self.data / self.recording.file
        files = EmgFiles(emg=path, emg_side=self.recording.emg_side)
        return tuple(open_emg(files, model).muscles)

    def of_steps(self, job: Job) -> Said:
        """Return the messages on the clean recording by the steps of a job."""
        key = ("id alone",) if job.radians else job.steps
        if key not in self.said:
            clean = self.job()
            clean.steps = job.steps
            name = "clean" if key == CALIBRATE else f"clean {'-'.join(key)}"
            found = dynamics_alone(self, 1.0) if job.radians else analyzed(self, clean, name)
            self.said[key] = found
        return self.said[key]


def _frames(capture: Capture, span: tuple[float, float] | None) -> slice:
    """Frames of a span of time; recordings with one begin at 0."""
    if span is None:
        return slice(0, len(capture.points))
    return slice(round(span[0] * capture.rate), round(span[1] * capture.rate))


def clean_of(folder: Path, home: Path, recording: Recording) -> Clean:
    """Analyze a clean recording, with the generic model fitted to it."""
    own = home / re.sub(r"\W+", "_", recording.name)
    own.mkdir()
    clean = Clean(recording=recording, data=folder, home=own)
    job = clean.job()
    job.steps = CALIBRATE
    if error := clean.of_steps(job).error:
        raise RuntimeError(f"{recording.name}: {error}")
    return clean


def analyzed(clean: Clean, job: Job, name: str) -> Said:
    """Type `analyze` on the files of a job, its steps cut short."""
    folder = clean.home / f"files {name}"
    folder.mkdir()
    out = clean.home / name
    path, *_ = job.capture.write(folder)
    if job.kept < 1.0:
        truncate(path, job.kept)
    words: list[object] = ["analyze", path]
    if name.startswith("a trial of a second person"):
        assert job.second is not None
        other = folder / "other"
        other.mkdir()
        second, *_ = job.second.write(other)
        words.append(second.rename(folder / f"second{second.suffix}"))
    else:
        words += _time_words(clean, job)
    words += ["--mass", f"{job.mass:g}", *_static_words(job, folder)]
    if "calibrate" not in job.steps:
        words += ["--model", _model(clean, job, folder)]
    status, printed = typed(*words, "--prepare", "--out", out)
    assumed = _assumed_messages(printed)
    if status:
        return Said(messages=assumed, error=printed.rpartition("\n")[2])
    return _run(clean, out, job.steps, assumed)


def _time_words(clean: Clean, job: Job) -> list[str]:
    """Words for the part that is analyzed, and others of the recording."""
    span = clean.recording.span
    words = [] if span is None else ["--time", *(f"{second:g}" for second in span)]
    if clean.recording.emg_side:
        words += ["--emg-side", clean.recording.emg_side]
    return [*words, *clean.recording.options]


def _static_words(job: Job, folder: Path) -> list[object]:
    """Words for the static trial, where lengths are found anew."""
    if job.static is None or "calibrate" not in job.steps:
        return []
    own = folder / "static"
    own.mkdir()
    path, *_ = job.static.write(own)
    return ["--static", path.rename(folder / f"static{path.suffix}")]


def _model(clean: Clean, job: Job, folder: Path) -> Path:
    """File of the model, of another size where the job says so."""
    if "muscles" in job.steps:
        return clean.model
    if job.factor == 1.0 and job.mass == clean.recording.mass:
        return clean.skeleton
    model = mm.read_model(clean.skeleton)
    path = folder / "model.osim"
    sizes = {body.name: np.full(3, job.factor) for body in model.bodies}
    # The fit of the model to the person would give it the mass that is typed.
    mm.write_osim(scale(model, sizes, job.mass, preserve_mass_distribution=True), path)
    return path


def _run(clean: Clean, out: Path, steps: Sequence[str], assumed: Sequence[Message]) -> Said:
    """Run the steps of a study that was prepared, in this process."""
    study = out / "study.toml"
    text = re.sub(
        r"(?m)^steps = \[.*\]$", f"steps = {json.dumps(steps)}", study.read_text(encoding="utf-8")
    )
    study.write_text(text, encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        outcomes = run_study(read_plan(study), out)
    messages = [*assumed]
    for outcome in outcomes:
        messages += [
            message for group in grouped_messages(outcome.findings) for message in group.messages
        ]
    error = next((outcome.error for outcome in outcomes if outcome.error), "")
    trials = {} if error else mm.load(out)
    trial = next((one for key, one in trials.items() if "trial" in key), None)
    if trial is None or trial.torques is None or trial.fit is None:
        return Said(messages=tuple(messages), error=error)
    model = mm.read_model(clean.skeleton)
    columns = inner_angles(model, trial.torques.names)
    angles = inner_angles(model, trial.fit.motion.names)
    return Said(
        messages=tuple(messages),
        error=error,
        torques=trial.torques.values[:, columns],
        angles=trial.fit.motion.values[:, angles],
    )


def _assumed_messages(printed: str) -> tuple[Message, ...]:
    """Sentences of `analyze` on who was recorded, and its warnings."""
    lines = [line.strip() for line in printed.splitlines()]
    beginnings = ("WARNING", "The recordings are of", "Markers lie elsewhere")
    return tuple(SESSION.message(line) for line in lines if line.startswith(beginnings))


def dynamics_alone(clean: Clean, factor: float) -> Said:
    """Type `id` on the coordinates of the clean recording, angles multiplied by a factor."""
    path = clean.home / f"coordinates_{factor:.3g}.mot"
    lines = clean.motion.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(_scaled_angles(lines, clean, factor)) + "\n", encoding="utf-8")
    out = path.with_suffix(".sto")
    status, printed = typed("id", "--model", clean.skeleton, "--motion", path, "--out", out)
    if status:
        return Said(error=printed.splitlines()[-1])
    messages = []
    for line in printed.splitlines():
        word, _, text = line.partition(": ")
        if word == "warning":
            messages.append(OTHER.message(text, severity="changes results"))
        elif word == "note":
            messages.append(OTHER.message(text, severity="good to know"))
    return Said(messages=tuple(messages), torques=mm.read_sto(out).values)


def _scaled_angles(lines: Sequence[str], clean: Clean, factor: float) -> Iterator[str]:
    """Lines of a table of coordinates with angles multiplied by a factor."""
    head = next(number for number, line in enumerate(lines) if line.startswith("time"))
    yield from lines[: head + 1]
    coordinates = mm.read_model(clean.skeleton).coordinates
    turning = {one.name for one in coordinates if one.motion == "rotational"}
    factors = np.array([factor if name in turning else 1.0 for name in lines[head].split("\t")])
    for line in lines[head + 1 :]:
        row = factors * np.array(line.split("\t"), dtype=float)
        yield "\t".join(f"{cell:.9g}" for cell in row)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What became of a fault.

    Attributes
    ----------
    recording, kind : names
    fault : its size in words
    outcome : one of `OUTCOMES`
    said : what is new, the first of it
    torque : change of the torque that changes most, as share of the largest; NaN for none
    angle : the largest change of an angle [deg]
    """

    recording: str
    kind: str
    fault: str
    outcome: str
    said: str
    torque: float
    angle: float

    @property
    def row(self) -> Row:
        """Cells of the table of all."""
        return {
            "recording": self.recording,
            "fault": self.kind,
            "size": self.fault,
            "outcome": self.outcome,
            "torques change by [%]": 100.0 * self.torque,
            "angles change by [deg]": self.angle,
            "first message": self.said,
        }


def judged(clean: Clean, job: Job, kind: Kind, found: Said) -> Verdict:
    """Compare the messages on a fault with those on the clean recording."""
    before = clean.of_steps(job)
    torque = _torque_change(before, found)
    angle = _angle_change(before, found)
    wrong = job.matters or not (torque <= FORCE_ERROR and angle <= ANGLE_ERROR)
    new = [message for message in found.messages if _is_new(message, before.messages)]
    warnings = [message for message in new if message.severity != "good to know"]
    named = [message for message in new if _names(message, kind, job)]
    if found.error:
        outcome = "named first" if kind.is_named(found.error, job) else "other blamed"
        said = f"error: {found.error}"
    else:
        outcome = _outcome(named, warnings, wrong)
        shown = warnings or named or new
        said = str(shown[0]) if shown else ""
    return Verdict(
        recording=clean.recording.name,
        kind=kind.name,
        fault=job.said,
        outcome=outcome,
        said=_shortened(said, clean.home),
        torque=torque,
        angle=angle,
    )


def _outcome(named: Sequence[Message], warnings: Sequence[Message], wrong: bool) -> str:
    """Say what became of a fault that did not end the command."""
    if named and warnings and warnings[0] in named:
        return "named first"
    if named:
        return "named later" if warnings or wrong else "corrected"
    if warnings:
        return "other blamed"
    return "silent, wrong" if wrong else "silent, harmless"


def _names(message: Message, kind: Kind, job: Job) -> bool:
    """Whether a message has a cause of the fault, and says where it is."""
    # What `id` prints has no cause beside it.
    known = message.cause.key in kind.causes or message.cause is OTHER
    return known and kind.is_named(str(message), job)


def _is_new(message: Message, before: Sequence[Message]) -> bool:
    """Whether the clean recording has no such message, or a smaller one."""
    for other in before:
        if str(other) == str(message):
            return False
        if other.cause is OTHER and _words(other) != _words(message):
            continue
        if other.cause.key == message.cause.key and _places(other) == _places(message):
            more_severe = SEVERITIES.index(message.severity) < SEVERITIES.index(other.severity)
            grown = abs(message.size or 0.0) > TOLERANCE * abs(other.size or 0.0)
            return more_severe or grown
    return True


def _words(message: Message) -> list[str]:
    """Words without numbers: of a message without a cause they say what it is about."""
    return re.findall(r"[a-z]+", str(message).lower())


def _places(message: Message) -> set[str]:
    """Plates, markers or files that a message names."""
    return set(message.place.split(", "))


def _torque_change(before: Said, after: Said) -> float:
    """Largest change of a torque over that of the largest torque, root mean squares."""
    if before.torques is None or after.torques is None:
        return float("nan")
    if before.torques.shape != after.torques.shape:
        return float("inf")
    largest = np.sqrt(np.nanmean(before.torques**2, axis=0)).max()
    change = np.sqrt(np.nanmean((after.torques - before.torques) ** 2, axis=0)).max()
    return float(change / largest)


def _angle_change(before: Said, after: Said) -> float:
    """Largest root mean square change of an angle [deg]."""
    if before.angles is None or after.angles is None:
        return 0.0
    if before.angles.shape != after.angles.shape:
        return float("inf")
    turns = 2.0 * np.pi
    apart = (after.angles - before.angles + np.pi) % turns - np.pi
    return float(np.degrees(np.sqrt(np.nanmean(apart**2, axis=0)).max()))


def _shortened(text: str, home: Path) -> str:
    """One line without names of temporary folders."""
    line = " ".join(text.replace(f"{home}/", "").split())
    return line if len(line) < 200 else f"{line[:197]}..."


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Messages on all recordings.

    Attributes
    ----------
    verdicts : on the faults
    clean : what is said with nothing put in, by recording
    """

    verdicts: tuple[Verdict, ...]
    clean: Mapping[str, Said]


@cache
def measured(folder: Path, seed: int) -> Measured:
    """Put twenty faults into each recording, and say what became of each."""
    used = Counter[str]()
    found: list[Verdict] = []
    said: dict[str, Said] = {}
    for number, recording in enumerate(RECORDINGS):
        with tempfile.TemporaryDirectory() as name:
            clean = clean_of(folder, Path(name), recording)
            said[recording.name] = clean.said[CALIBRATE]
            found += _of_recording(clean, used, seed, number)
    return Measured(verdicts=tuple(found), clean=said)


def _of_recording(clean: Clean, used: Counter[str], seed: int, number: int) -> Iterator[Verdict]:
    """Put the kinds that were used least into a recording."""
    count = 0
    for index in sorted(range(len(KINDS)), key=lambda index: (used[KINDS[index].name], index)):
        kind = KINDS[index]
        job = clean.job()
        if count == PER_RECORDING:
            return
        if not kind.change(job, np.random.default_rng([seed, number, index])):
            continue
        used[kind.name] += 1
        count += 1
        if job.radians:
            found = dynamics_alone(clean, np.pi / 180.0)
        else:
            found = analyzed(clean, job, re.sub(r"\W+", " ", kind.name))
        verdict = judged(clean, job, kind, found)
        print(shlex.join(map(str, verdict.row.values())), flush=True)
        yield verdict


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What somebody who looked at a clean recording thinks of a warning.

    Attributes
    ----------
    is_right : whether it is so
    why : how that is known
    """

    is_right: bool
    why: str


BESIDE = Judgement(
    is_right=True, why="one foot stands beside the plates for that time, as its markers show"
)
JUDGED: Mapping[tuple[str, str], Judgement] = {
    ("child, walk with EMG", "feet_beside"): BESIDE,
    ("OpenSim's walk", "feet_beside"): BESIDE,
    ("vendor, walk with EMG", "feet_beside"): BESIDE,
    ("Rajagopal, walk", "feet_beside"): BESIDE,
    ("OpenSim's walk", "plate_zero"): Judgement(
        is_right=True, why="the plate reads about 20 N before and after somebody steps on it"
    ),
    ("vendor, walk with EMG", "emg"): Judgement(
        is_right=True, why="the labels of these channels name no muscle"
    ),
    ("child, walk with EMG", "emg"): Judgement(
        is_right=True,
        why="its raw signal never rests: 0.14 V all along, where the left one rises from 0.005 V",
    ),
    ("Hamner, run", "markers"): Judgement(
        is_right=True,
        why="it lies 3 cm to the right of the middle of shoulders and pelvis, in another run too",
    ),
}
"""By recording and cause."""


COLUMNS = ("cause", "severity", "message", "right", "why")


def measure_clean(folder: Path, seed: int = SEED) -> Iterator[Row]:
    """Yield a row for each warning on a clean recording: its text, and whether it is true."""
    for recording, said in measured(folder, seed).clean.items():
        warnings = [group for group in grouped_messages(said.messages) if group.is_warning]
        if not warnings:
            yield dict.fromkeys(("recording", *COLUMNS), "") | {
                "recording": recording,
                "cause": "none",
            }
        for group in warnings:
            judged_by = JUDGED.get((recording, group.cause.key))
            yield {
                "recording": recording,
                "cause": group.cause.title,
                "severity": group.severity,
                "message": _shortened(str(group.messages[0]), Path(recording)),
                "right": "not judged" if judged_by is None else judged_by.is_right,
                "why": "" if judged_by is None else judged_by.why,
            }


def measure(folder: Path, seed: int = SEED) -> Iterator[Row]:
    """Yield a row a kind: in how many recordings it was put, and what became of it."""
    for kind in KINDS:
        of_kind = [one for one in measured(folder, seed).verdicts if one.kind == kind.name]
        counts = Counter(verdict.outcome for verdict in of_kind)
        missed = [one.recording for one in of_kind if one.outcome == "silent, wrong"]
        yield {
            "fault": kind.name,
            "recordings": len(of_kind),
            **{outcome: counts[outcome] for outcome in OUTCOMES},
            "silent and wrong in": ", ".join(missed) or "none",
        }


def measure_all(folder: Path, seed: int = SEED) -> Iterator[Row]:
    """Yield a row for each fault: its size, outcome, effect and first message."""
    for verdict in measured(folder, seed).verdicts:
        yield verdict.row


def main() -> None:
    """Print the tables of a seed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("seed", nargs="?", type=int, default=SEED)
    folder = data_folder()
    seed = parser.parse_args().seed
    for row in (*measure(folder, seed), *measure_all(folder, seed), *measure_clean(folder, seed)):
        print("; ".join(f"{column}: {cell}" for column, cell in row.items()), flush=True)


if __name__ == "__main__":
    main()

"""Faults that markers, plates and body together have to show.

There are 64, as far as a recording can have them, in each of ten recordings of six laboratories.
The same recordings are looked at without any.

Each goes the way of `ik` and `id` with a model that is given: checked inverse kinematics, forces
held against the motion and put on feet, torques. A finding names a fault where its kind is one of
those that the fault has; it blames something else where it is new beside those of the clean
recording and is none of them. "Corrected wrongly": a finding that is none of them changed markers
or forces.

The change of torques is the root mean square change of those of hips, knees and ankles over their
root mean square, in the frames that both have.

    python -m benchmarks.accuracy.faults.consistency [SEED] [RECORDING]

prints every case.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.faults.consistency_faults import Case, Fault, faults
from benchmarks.recordings import RECORDINGS, read_markers
from data_collection import data_folder
from myomorph.core.contact.unloaded import ZERO, zero_messages
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.findings import Finding
from myomorph.core.motion.marker_checks import MarkerCheckOptions, checked_kinematics
from myomorph.core.motion.sync import cut
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.external_forces import ForceFile, on_feet, raw_loads

Row = dict[str, object]
SEED = 12
"""Of the sizes that are reported; those up to 3, and 11, are the ones that were worked with."""
MARGIN = 0.15
"""Time by which forces are recorded longer than markers, at both ends [s]."""
CUTOFF = 6.0
"""Of motion and forces [Hz]."""
CHANGE = "torques change by [%]"
SIZES = (
    (0.2, np.inf, "by 20 % and more, or nothing comes out"),
    (0.05, 0.2, "by 5 to 20 %"),
    (0.0, 0.05, "by less"),
)
"""What faults do to torques with nothing put right."""
OUTCOMES = ("named", "corrected", "refused", "one of several", "something else blamed", "silent")


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recording with a model of its person.

    Attributes
    ----------
    name : laboratory and movement
    files : its name among the recordings of the data collection
    mass : that the plates weigh, where the model is not of the person's mass [kg]
    time : first and last [s], None for all
    early : time by which its forces are early [s]
    apart : whether it was not looked at while the test was made
    """

    name: str
    files: str
    mass: float | None = None
    time: tuple[float, float] | None = None
    early: float = 0.0
    apart: bool = True


RECORDED = (
    Recording(name="Rajagopal, walk", files="rajagopal", apart=False),
    Recording(name="OpenCap, drop jump", files="opencap-jump", apart=False),
    Recording(name="Hamner, run at 2 m/s", files="run-2", mass=82.0, apart=False),
    Recording(name="gait2354, walk", files="gait2354"),
    Recording(name="Lenhart, walk", files="lenhart", mass=73.2),
    Recording(name="instrumented knee, walk 1", files="implant-1", mass=83.0),
    Recording(name="instrumented knee, walk 3", files="implant-3", mass=83.0),
    Recording(name="OpenCap, walk", files="opencap-walk"),
    Recording(name="OpenCap, rising", files="opencap-rise"),
    Recording(name="Hamner, run at 5 m/s", files="run-5", mass=82.0),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What came of a recording.

    Attributes
    ----------
    findings : what was said
    torques : of hips, knees and ankles, None where there are none
    refused : the error that ended it, "" for none
    """

    findings: tuple[Finding, ...] = ()
    torques: mm.Series | None = None
    refused: str = ""


def opened(folder: Path, recording: Recording) -> Case:
    """Open the model, markers and forces of a recording."""
    files = RECORDINGS[recording.files]
    model = mm.read_model(folder / files.model)
    if recording.mass is not None:
        share = recording.mass / model.mass
        model = replace(
            model,
            bodies=tuple(
                replace(body, mass=share * body.mass, inertia=share * body.inertia)
                for body in model.bodies
            ),
        )
    markers = read_markers(folder / files.markers)
    if recording.time is not None:
        markers = cut(markers, *recording.time)
    motion = mm.inverse_kinematics(model, markers).motion
    wrenches = raw_loads(ForceFile(path=folder / files.loads), model, motion).wrenches
    # Forces that are late by less than the margin still cover the motion.
    first = max(float(markers.time[0]), float(wrenches.time[0]) + MARGIN)
    last = min(float(markers.time[-1]), float(wrenches.time[-1]) - MARGIN)
    markers = cut(markers, first, last)
    # What is wrong with the recording itself is put right before anything is put in.
    wrenches = replace(wrenches, time=wrenches.time + recording.early)
    sound = on_feet(wrenches, model, motion)
    return Case(model=model, markers=markers, wrenches=replace(sound, findings=(), notes=()))


def outcome(case: Case, repair: bool = True) -> Outcome:
    """Go the way of `ik` and `id`, with or without corrections."""
    markers = MarkerCheckOptions(repair=repair)
    forces = ForceOptions() if repair else ForceOptions(force_checks="none")
    try:
        checked = checked_kinematics(case.model, case.markers, checks=markers)
        wrenches = on_feet(_with_zeros(case), case.model, checked.fit.motion, forces)
        motion = mm.differentiate(checked.fit.motion, CUTOFF)
        torques = mm.inverse_dynamics(
            case.model, motion, mm.resample_wrenches(wrenches, motion.time, CUTOFF)
        )
    except MyomorphError as error:
        return Outcome(refused=str(error))
    names = [name for name in torques.names if name.startswith(("hip_", "knee_", "ankle_"))]
    columns = [torques.names.index(name) for name in names]
    return Outcome(
        findings=(*checked.findings, *wrenches.findings),
        torques=mm.Series(torques.time, tuple(names), torques.values[:, columns]),
    )


def _with_zeros(case: Case) -> mm.Wrenches:
    """Return the forces with what reading them finds of their zeros."""
    zeros = zero_messages(case.wrenches, np.asarray(case.model.up), case.model.weight)
    findings = tuple(Finding(kind=ZERO, place=zero.place, text=zero) for zero in zeros)
    return replace(case.wrenches, findings=(*case.wrenches.findings, *findings))


def change_of(clean: Outcome, faulty: Outcome) -> float:
    """Relative change of torques, infinite where there are none any more."""
    before = clean.torques
    after = faulty.torques
    assert before is not None
    if after is None:
        return np.inf
    inside = (before.time >= after.time[0]) & (before.time <= after.time[-1])
    resampled = np.column_stack(
        [np.interp(before.time[inside], after.time, column) for column in after.values.T]
    )
    change = resampled - before.values[inside]
    size = float(np.sqrt(np.nanmean(before.values[inside] ** 2)))
    return float(np.sqrt(np.nanmean(change**2))) / size


def new_findings(clean: Outcome, faulty: Outcome) -> list[Finding]:
    """Choose the findings that the clean recording has not."""
    known = {_key(finding) for finding in clean.findings}
    return [item for item in faulty.findings if _key(item) not in known]


def _key(finding: Finding) -> tuple[str, str, int]:
    """Tell findings apart by kind, place, and tenths of a second that they last."""
    lasts = sum(stop - start for start, stop in finding.times)
    return finding.kind, finding.place, round(10.0 * lasts)


def judged(fault: Fault, clean: Outcome, faulty: Outcome) -> tuple[str, list[Finding]]:
    """Return what became of a fault, and the findings that are none of it."""
    new = new_findings(clean, faulty)
    right = [item for item in new if any(part in item.kind for part in fault.accepted)]
    wrong = [item for item in new if item not in right]
    if faulty.refused:
        return "refused", wrong
    if not right:
        return ("something else blamed" if wrong else "silent"), wrong
    if all(item.repaired for item in right):
        return "corrected", wrong
    return ("named" if any(_is_one(item, fault) for item in right) else "one of several"), wrong


def _is_one(finding: Finding, fault: Fault) -> bool:
    """Whether all that a finding names is the fault."""
    kinds = finding.kind.split(" or ")
    return all(any(part in kind for part in fault.accepted) for kind in kinds)


@cache
def all_cases(folder: Path, seed: int = SEED) -> tuple[Row, ...]:
    """Cases of all recordings."""
    return tuple(row for recording in RECORDED for row in cases(folder, recording, seed))


def measure(folder: Path) -> Iterator[Row]:
    """Count outcomes by recordings and by what the faults do to torques."""
    rows = all_cases(folder)
    for apart in (False, True):
        for low, high, words in SIZES:
            chosen = [
                row
                for row in rows
                if row["apart"] is apart and low <= float(str(row[CHANGE])) / 100.0 < high
            ]
            counts = Counter(str(row["outcome"]) for row in chosen)
            named = len(chosen) - counts["silent"] - counts["something else blamed"]
            yield {
                "recordings": "kept apart" if apart else "worked with",
                "torques change": words,
                "faults": len(chosen),
                **{word: counts[word] for word in OUTCOMES},
                "reported [%]": 100.0 * named / max(len(chosen), 1),
                "something else corrected": sum(bool(row["corrected wrongly"]) for row in chosen),
            }


def measure_all(folder: Path) -> Iterator[Row]:
    """Yield every case."""
    for row in all_cases(folder):
        yield {key: value for key, value in row.items() if key != "apart"}


def measure_clean(folder: Path) -> Iterator[Row]:
    """List the findings on the recordings without faults."""
    for recording in RECORDED:
        clean = outcome(opened(folder, recording))
        findings = clean.findings
        yield {
            "recording": recording.name,
            "kept apart": recording.apart,
            "reported": "; ".join(f"{item.kind}: {item}"[:160] for item in findings) or "nothing",
        }


def cases(folder: Path, recording: Recording, seed: int) -> Iterator[Row]:
    """Put every fault into one recording."""
    number = [item.files for item in RECORDED].index(recording.files)
    clean_case = opened(folder, recording)
    clean = outcome(clean_case)
    for fault in faults(np.random.default_rng((seed, number))):
        case = fault.put(clean_case)
        if case is None:
            continue
        faulty = outcome(case)
        word, wrong = judged(fault, clean, faulty)
        # Where nothing was put right, the fault is what changes torques.
        repairs = any(item.repaired for item in faulty.findings)
        bare = outcome(case, repair=False) if repairs else faulty
        yield {
            "recording": recording.name,
            "apart": recording.apart,
            "fault": fault.name,
            "outcome": word,
            CHANGE: 100.0 * change_of(clean, bare),
            "corrected wrongly": "; ".join(sorted({item.kind for item in wrong if item.repaired})),
            "also reported": "; ".join(sorted({item.kind for item in wrong})),
            "refused": faulty.refused[:120],
        }


def main(arguments: Sequence[str]) -> None:
    """Print the cases of some recordings."""
    seed = int(arguments[0]) if arguments else 1
    chosen = arguments[1:] or [item.files for item in RECORDED if not item.apart]
    for recording in RECORDED:
        if recording.files in chosen:
            for row in cases(data_folder(), recording, seed):
                print("|".join(str(value)[:90] for value in row.values()), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

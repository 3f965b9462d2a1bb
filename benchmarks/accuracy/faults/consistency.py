"""Faults that markers, plates and body together have to show.

There are 67, as far as a recording can have them, in each of 17 recordings of eight laboratories.
These and three more are looked at without any.

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
from benchmarks.accuracy.faults.consistency_recordings import RECORDED, Recorded
from data_collection import data_folder
from myomorph.core.contact.unloaded import ZERO, zero_messages
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.findings import Finding
from myomorph.core.motion.marker_checks import MarkerCheckOptions, checked_kinematics
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.external_forces import on_feet

Row = dict[str, object]
SEED = 47
"""Of the sizes that are reported; those up to 3, 11, 12 and 31 were worked with."""
CUTOFF = 6.0
"""Of motion and forces [Hz]."""
CHANGE = "torques change by [%]"
AT = "looked at while the test was made"
LOOKED = {
    "faults": "with these kinds of faults",
    "other sizes": "with faults of other sizes",
    "clean": "without faults",
}
"""What was looked at, by `Recorded.looked`."""
SIZES = (
    (0.2, np.inf, "by 20 % and more, or nothing comes out"),
    (0.05, 0.2, "by 5 to 20 %"),
    (0.0, 0.05, "by less"),
)
"""What faults do to torques with nothing put right."""
OUTCOMES = ("named", "corrected", "refused", "one of several", "something else blamed", "silent")


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
    chosen = (recording for recording in RECORDED if recording.put_in)
    return tuple(row for recording in chosen for row in cases(folder, recording, seed))


def measure(folder: Path) -> Iterator[Row]:
    """Count outcomes by recordings and by what the faults do to torques."""
    rows = all_cases(folder)
    for looked, recordings in LOOKED.items():
        for low, high, words in SIZES:
            chosen = [
                row
                for row in rows
                if row[AT] == looked and low <= float(str(row[CHANGE])) / 100.0 < high
            ]
            counts = Counter(str(row["outcome"]) for row in chosen)
            named = len(chosen) - counts["silent"] - counts["something else blamed"]
            yield {
                AT: recordings,
                "torques change": words,
                "faults": len(chosen),
                **{word: counts[word] for word in OUTCOMES},
                "reported [%]": 100.0 * named / max(len(chosen), 1),
                "something else corrected": sum(bool(row["corrected wrongly"]) for row in chosen),
            }


def measure_all(folder: Path) -> Iterator[Row]:
    """Yield every case."""
    for row in all_cases(folder):
        yield {key: value for key, value in row.items() if key != AT}


def measure_clean(folder: Path) -> Iterator[Row]:
    """List the findings on the recordings without faults."""
    for recording in RECORDED:
        clean = outcome(recording.case(folder))
        findings = clean.findings
        yield {
            "recording": recording.name,
            AT: LOOKED[recording.looked],
            "reported": "; ".join(f"{item.kind}: {item}"[:160] for item in findings) or "nothing",
        }


def cases(folder: Path, recording: Recorded, seed: int) -> Iterator[Row]:
    """Put every fault into one recording."""
    clean_case = recording.case(folder)
    clean = outcome(clean_case)
    for fault in faults(np.random.default_rng((seed, RECORDED.index(recording)))):
        case = fault.put(clean_case)
        if case is None:
            continue
        faulty = outcome(case)
        word, wrong = judged(fault, clean, faulty)
        # Where nothing was put right, the fault is what changes torques.
        corrects = any(item.repaired for item in faulty.findings)
        bare = outcome(case, repair=False) if corrects else faulty
        yield {
            "recording": recording.name,
            AT: recording.looked,
            "fault": fault.name,
            "outcome": word,
            CHANGE: 100.0 * change_of(clean, bare),
            "corrected wrongly": "; ".join(sorted({item.kind for item in wrong if item.repaired})),
            "also reported": "; ".join(sorted({item.kind for item in wrong})),
            "refused": faulty.refused[:120],
        }


def main(arguments: Sequence[str]) -> None:
    """Print the cases of some recordings, by parts of their names."""
    seed = int(arguments[0]) if arguments else 1
    for recording in RECORDED:
        if any(part in recording.name for part in arguments[1:] or [""]):
            for row in cases(data_folder(), recording, seed):
                print("|".join(str(value)[:90] for value in row.values()), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

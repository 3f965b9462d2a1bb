"""Faults of markers in held-out recordings, each through the commands of a user.

No threshold was set with these recordings. The faulty recording is written to a file, `myomorph
analyze --prepare` makes a study of it, whose steps are cut short after inverse kinematics, and
`myomorph run` runs it: protocol, axes, calibration and checks see the fault, as in use.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.faults import unseen_faults
from benchmarks.accuracy.faults.faults import counted
from benchmarks.accuracy.faults.marker_faults import (
    ABOUT_THE_MODEL,
    MARKER_FAULTS,
    MarkerFault,
    called,
    findings_of,
    inner_angles,
    same_angles_word,
    verdict,
)
from benchmarks.accuracy.faults.unseen_faults import GAIT, SAMPLES, through_the_commands
from benchmarks.accuracy.faults.unseen_faults import RAW as OF_FORCES
from benchmarks.accuracy.faults.unseen_faults import Raw as RawForces
from myomorph.core.model.arrays import Array
from myomorph.core.model.findings import Finding
from myomorph.core.model.messages import OTHER
from myomorph.core.motion.marker_checks import checked_kinematics
from myomorph.lab.session.recordings import Recording, bare, look_at
from myomorph.lab.store import results
from myomorph.lab.store.results import get_findings
from myomorph.lab.study.subject.calibrating import FINDINGS as BEFORE
from myomorph.lab.study.trial.steps.ik import FINDINGS

Row = dict[str, object]

MAX_FRAMES = 120
CHOSEN = (
    "a pair swapped throughout",
    "left and right swapped throughout",
    "two limbs swapped",
    "front and back of the pelvis swapped",
    "a pair swapped for a sixth of the frames",
    "a marker 5 cm off",
    "another marker 5 cm off",
    "a marker that jumps for five frames",
    "axis to the side mirrored",
    "another axis up",
    "walking direction turned by 90 degrees",
    "mm for m",
)
"""Of the faults of markers."""

FROM_THE_BEGINNING = tuple(
    name for name in CHOSEN if "sixth" not in name and "jumps" not in name and "mm" not in name
)
"""Those that the commands meet before they know protocol, axes and lengths; each takes them some
seconds.
"""
ALIKE = 0.5
"""Angles of joints that differ by less are those of the clean recording [degrees]."""


@dataclass(frozen=True)
class Raw:
    """A recording as a laboratory has it.

    With it goes one of the same person standing still where `analyze` would find it.
    """

    name: str
    file: str
    static: str = ""


RAW = (
    Raw("OpenSim's walk 2", "c3d-opensim-walking/walking2.c3d"),
    Raw(
        "Plug-in Gait, first person",
        f"{GAIT}/HC030A/Straight/HC030A05.c3d",
        f"{GAIT}/HC030A/Static/HC030A01.c3d",
    ),
    Raw("vendor, functional walk", f"{SAMPLES}/others/FunctionalWalk.c3d"),
    Raw("vendor, flat-foot walk", f"{SAMPLES}/PiG/PiG_Motion-FlatFoot-Full.c3d"),
    Raw("box lift", "lifting-box-15kg/stoop1.c3d", "lifting-box-15kg/neutral.c3d"),
    Raw("stairs", "odd-trc-mot/markers_StairUp3.trc"),
)


@dataclass(frozen=True, eq=False)
class Result:
    """What the commands made of a recording.

    `model`, `motion`: None where a command refused it; `findings`: of the checks, or one of the
    kind "refused" with the last line; `said`: all that was printed.
    """

    model: mm.Model | None
    motion: mm.Motion | None
    findings: tuple[Finding, ...]
    said: str


def injected_after_calibration(folder: Path) -> Iterator[Row]:
    """Put faults of markers into recordings whose model is calibrated before.

    The commands calibrated it on the clean recording.
    """
    cases = [one for one in (calibrated(folder, raw) for raw in OF_FORCES) if one is not None]
    before = [checked_kinematics(model, markers).findings for _, model, markers in cases]
    for fault in (one for one in MARKER_FAULTS if one.name in CHOSEN):
        verdicts = []
        for (name, model, markers), known in zip(cases, before, strict=True):
            faulty = fault.change(model, markers)
            if faulty is None:
                continue
            if fault.kinds:
                word = verdict(fault.kinds, findings_of(model, faulty), known)
            else:
                word = same_angles_word(model, markers, faulty, known)
            verdicts.append((word.split()[0].rstrip(":"), name))
        yield counted(fault.name, verdicts)


def clean_after_calibration(folder: Path) -> Iterator[Row]:
    """List the findings on the same recordings without faults, without facts about the model."""
    for raw in OF_FORCES:
        one = calibrated(folder, raw)
        if one is None:
            continue
        name, model, markers = one
        found = checked_kinematics(model, markers).findings
        yield {
            "recording": name,
            "frames": len(markers),
            "reported": (
                "; ".join(each.text for each in found if each.kind not in ABOUT_THE_MODEL)
                or "nothing"
            ),
        }


@cache
def calibrated(folder: Path, raw: RawForces) -> tuple[str, mm.Model, mm.Markers] | None:
    """Return a name, the model as the commands calibrate it, and markers in its ground.

    The result is None where the commands refuse.
    """
    one, _ = unseen_faults.analyzed(folder, raw)
    return None if one is None else (raw.name, one.model, most_seen(folder / raw.file)[0])


def injected_marker_faults(folder: Path) -> Iterator[Row]:
    """Put faults of markers into held-out recordings.

    The rows count how many were corrected, found and missed.
    """
    for fault in (one for one in MARKER_FAULTS if one.name in FROM_THE_BEGINNING):
        results = [
            (raw.name, result)
            for raw in RAW
            if (result := injected(folder, raw, fault)) is not None
        ]
        others = set().union(*(besides for _, (_, besides) in results))
        row = counted(fault.name, [(word, name) for name, (word, _) in results])
        yield row | {"also reported": ", ".join(sorted(others)) or "nothing"}


def clean_markers(folder: Path) -> Iterator[Row]:
    """List the findings on the same recordings without faults, without facts about the model."""
    for raw in RAW:
        markers, one = clean(folder, raw)
        row: Row = {
            "recording": raw.name,
            "frames": len(markers),
            "static trial": "yes" if raw.static else "no",
        }
        yield row | called(one.findings)


def injected(folder: Path, raw: Raw, fault: MarkerFault) -> tuple[str, set[str]] | None:
    """Return the verdict on a fault, and the kinds of other findings.

    The result is None where the recording cannot have the fault.
    """
    markers, before = clean(folder, raw)
    assert before.model is not None
    known = set(before.model.marker_names)
    chosen = [k for k, name in enumerate(markers.names) if name in known]
    used = replace(
        markers, names=tuple(markers.names[k] for k in chosen), values=markers.values[:, chosen]
    )
    faulty = fault.change(before.model, used)
    if faulty is None:
        return None
    found = analyzed(folder, faulty, raw.static)
    known = {(one.kind, one.place) for one in before.findings}
    new = [
        one
        for one in found.findings
        if (one.kind, one.place) not in known and one.kind not in ABOUT_THE_MODEL
    ]
    named = [one for one in new if one.kind in (*fault.kinds, "refused")]
    besides = {one.kind for one in new} - {*fault.kinds, "refused"}
    if same_angles(before, found):
        return "corrected", besides
    return ("found" if named else "missed"), besides


def same_angles(one: Result, other: Result) -> bool:
    """Whether the angles of all joints but the first are the same."""
    if one.model is None or one.motion is None or other.motion is None:
        return False
    if one.motion.names != other.motion.names or len(one.motion) != len(other.motion):
        return False
    apart: Array = np.abs(one.motion.values - other.motion.values)[
        :, inner_angles(one.model, one.motion.names)
    ]
    return bool(np.degrees(np.nanmax(apart)) < ALIKE)


def most_seen(path: Path) -> tuple[mm.Markers, Recording]:
    """Markers in a model's ground, in the frames that show most of the body."""
    one = look_at(path)
    turned = one.laboratory.trial(one.trial).markers
    assert turned is not None
    names = tuple(bare(name) for name in turned.names)
    on_body = [turned.names.index(name) for name in one.found.sites]
    seen = np.isfinite(turned.values[:, on_body]).all(axis=2).sum(axis=1)
    most = min(MAX_FRAMES, len(turned))
    first = int(np.argmax(np.convolve(seen, np.ones(most), "valid")))
    part = slice(first, first + most)
    return mm.Markers(turned.time[part], names, turned.values[part]), one


@cache
def clean(folder: Path, raw: Raw) -> tuple[mm.Markers, Result]:
    """Markers of a recording, and what becomes of them with nothing put in."""
    markers, _ = most_seen(folder / raw.file)
    found = analyzed(folder, markers, raw.static)
    if found.model is None:
        raise AssertionError(f"{raw.name}: {found.said}")
    return markers, found


def analyzed(folder: Path, markers: mm.Markers, static: str) -> Result:
    """Return the result of `analyze` and `run` on markers."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        out = home / "out"
        mm.write_trc(markers, home / "motion.trc", "m")
        more = ("--static", folder / static) if static else ()
        status, said = through_the_commands(
            out, ("calibrate", "ik"), home / "motion.trc", "--mass", "70", *more
        )
        if status:
            line = said.rpartition("\n")[2]
            return Result(
                model=None,
                motion=None,
                findings=(Finding("refused", "recording", OTHER.message(line)),),
                said=said,
            )
        ((_, trial),) = mm.load(out).items()
        before = out / "calibration" / BEFORE
        findings = (
            results.findings_of(before.read_text(encoding="utf-8")) if before.is_file() else ()
        )
        findings += get_findings(trial.stored, FINDINGS)
        return Result(
            model=mm.read_model(out / "calibrated.osim"),
            motion=trial.motion,
            findings=findings,
            said=said,
        )

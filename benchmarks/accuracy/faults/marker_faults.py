"""Faults of marker recordings put into clean ones.

Counted are those that are found, repaired or missed, and what is reported of clean ones. Each
fault is a function from a model and its markers to faulty markers, in the table `MARKER_FAULTS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.faults.faults import texts_of
from benchmarks.recordings import RECORDINGS
from myomorph.core.model.findings import Finding
from myomorph.core.model.messages import OTHER
from myomorph.core.motion.ik import tracked_markers
from myomorph.core.motion.label_repair import front_pairs, limb_pairs, side_pairs
from myomorph.core.motion.marker_checks import checked_kinematics
from myomorph.lab.study.inputs.reading import fitted_to

Row = dict[str, object]
Change = Callable[[mm.Model, mm.Markers], mm.Markers | None]

MAX_FRAMES = 400
ABOUT_THE_MODEL = ("undetermined", "at its bound")
"""Facts about a model and its marker set, which are no faults of the recording."""


@dataclass(frozen=True)
class MarkerFault:
    """A fault and what names it.

    `kinds`: of findings that name it; () where nothing is to be named, for joint angles come out
    the same; `change`: from clean markers to faulty ones; None where the recording cannot have it.
    """

    name: str
    kinds: tuple[str, ...]
    change: Change


def _files(recording: str) -> tuple[str, str]:
    return RECORDINGS[recording].model, RECORDINGS[recording].markers


SIMBODY = RECORDINGS["gait2354-made"].model
SCALED = {
    "Rajagopal walk": _files("rajagopal"),
    "gait2354 walk": (SIMBODY, RECORDINGS["gait2354"].markers),
    "OpenCap walk": _files("opencap-walk"),
    "OpenCap drop jump": _files("opencap-jump"),
    "OpenCap sit-to-stand": _files("opencap-rise"),
    "knee implant, stride 1": _files("implant-1"),
    "run, generic model": _files("run-5"),
}
"""Recordings that faults are put into: model and markers below the data collection."""
ALSO_CLEAN = {
    "knee implant, stride 3": _files("implant-3"),
    "slow run, generic model": _files("run-2"),
    "Lenhart walk": _files("lenhart"),
    "shoulder, bone pins": _files("bone-pins"),
    "gait2354, standing": (SIMBODY, "opensim-gait-subject01/experiment/subject01_static.trc"),
    "OpenCap, standing": _files("opencap-static"),
    "hip circles": (
        "c3d-functional-joints/models/scaled.osim",
        "c3d-functional-joints/functional_trials/right_knee.c3d",
    ),
}


@cache
def opened(folder: Path, model: str, recording: str) -> tuple[mm.Model, mm.Markers]:
    """Read a model and the first frames of a recording in its ground."""
    body = mm.read_model(folder / model)
    markers = fitted_to(body, mm.read_recording(folder / recording)).markers
    assert markers is not None
    return body, replace(
        markers, time=markers.time[:MAX_FRAMES], values=markers.values[:MAX_FRAMES]
    )


def _used(model: mm.Model, markers: mm.Markers) -> tuple[str, ...]:
    return tracked_markers(model, markers, mm.InverseKinematicsOptions())[0]


def _pairs(model: mm.Model, markers: mm.Markers) -> tuple[tuple[str, str], ...]:
    return side_pairs(_used(model, markers))


def exchanged(
    markers: mm.Markers, pairs: Sequence[tuple[str, str]], span: slice = slice(None)
) -> mm.Markers:
    """Labels of pairs exchanged in some frames."""
    values = np.array(markers.values)
    for one, other in pairs:
        i = markers.names.index(one)
        j = markers.names.index(other)
        values[span, i], values[span, j] = values[span, j].copy(), values[span, i].copy()
    return replace(markers, values=values)


def _middle(markers: mm.Markers) -> slice:
    return slice(len(markers) // 3, len(markers) // 2)


def swapped_pair(which: float, part: bool) -> Change:
    """One pair of markers of the two sides exchanged, throughout or for a sixth of the frames."""

    def change(model: mm.Model, markers: mm.Markers) -> mm.Markers | None:
        pairs = _pairs(model, markers)
        if not pairs:
            return None
        pair = pairs[round(which * (len(pairs) - 1))]
        return exchanged(markers, [pair], _middle(markers) if part else slice(None))

    return change


def swapped_sides(part: bool) -> Change:
    """All markers of the two sides exchanged."""

    def change(model: mm.Model, markers: mm.Markers) -> mm.Markers | None:
        pairs = _pairs(model, markers)
        return (
            exchanged(markers, pairs, _middle(markers) if part else slice(None))
            if len(pairs) > 1
            else None
        )

    return change


def swapped_leg(model: mm.Model, markers: mm.Markers) -> mm.Markers | None:
    """Exchange the markers of the limb that has most with the other side's."""
    limbs = limb_pairs(model, _pairs(model, markers))
    most = max(limbs.values(), key=len, default=())
    return exchanged(markers, most) if len(most) > 1 else None


def front_and_back(model: mm.Model, markers: mm.Markers) -> mm.Markers | None:
    """Front and back of the pelvis exchanged."""
    pairs = front_pairs(model, _pairs(model, markers))
    return exchanged(markers, pairs) if pairs else None


def displaced(which: float, distance: float = 0.05) -> Change:
    """Return a fault: a marker moved towards another one on its body [m]."""

    def change(model: mm.Model, markers: mm.Markers) -> mm.Markers | None:
        used = _used(model, markers)
        body = {name: model.marker(name).body for name in used}
        sided = [one for pair in _pairs(model, markers) for one in pair]
        mates = {
            name: [one for one in used if one != name and body[one] == body[name]] for name in sided
        }
        usable = [name for name in sided if mates[name]]
        if not usable:
            return None
        name = usable[round(which * (len(usable) - 1))]
        towards = markers[mates[name][0]] - markers[name]
        values = np.array(markers.values)
        size = np.linalg.norm(towards, axis=1, keepdims=True)
        values[:, markers.names.index(name)] += distance * towards / size
        return replace(markers, values=values)

    return change


def jumping(frames: int) -> Change:
    """Return a fault: a marker that is 9 cm off for some frames."""

    def change(model: mm.Model, markers: mm.Markers) -> mm.Markers | None:
        values = np.array(markers.values)
        middle = len(markers) // 2
        values[middle : middle + frames, markers.names.index(_used(model, markers)[0])] += [
            0.06,
            0.05,
            -0.04,
        ]
        return replace(markers, values=values)

    return change


def mirrored(axis: int, model: mm.Model, markers: mm.Markers) -> mm.Markers:
    """One axis of the recording mirrored."""
    sign = np.ones(3)
    sign[axis] = -1.0
    return replace(markers, values=markers.values * sign)


def turned(degrees: float, model: mm.Model, markers: mm.Markers) -> mm.Markers:
    """Rotate the recording about the vertical."""
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))
    return replace(markers, values=markers.values @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T)


def far_away(model: mm.Model, markers: mm.Markers) -> mm.Markers:
    """Move the laboratory's origin 30 m away."""
    return replace(markers, values=markers.values + [30.0, 0.0, -12.0])


def other_vertical(model: mm.Model, markers: mm.Markers) -> mm.Markers:
    """Z up in a file whose y is taken to be up."""
    return replace(markers, values=markers.values[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0])


def scaled(factor: float, model: mm.Model, markers: mm.Markers) -> mm.Markers:
    """Numbers in another unit than the file says."""
    return replace(markers, values=factor * markers.values)


def other_spelling(model: mm.Model, markers: mm.Markers) -> mm.Markers:
    """All labels but eight in capitals with an underscore."""
    known = set(_used(model, markers)[:8])
    return replace(
        markers, names=tuple(one if one in known else f"_{one.upper()}" for one in markers.names)
    )


MARKER_FAULTS = (
    MarkerFault("a pair swapped throughout", ("swapped labels",), swapped_pair(0.0, False)),
    MarkerFault("another pair swapped throughout", ("swapped labels",), swapped_pair(0.5, False)),
    MarkerFault(
        "a pair swapped for a sixth of the frames", ("swapped labels",), swapped_pair(1.0, True)
    ),
    MarkerFault(
        "left and right swapped throughout",
        ("swapped labels", "left and right"),
        swapped_sides(False),
    ),
    MarkerFault(
        "left and right swapped for a sixth of the frames", ("swapped labels",), swapped_sides(True)
    ),
    MarkerFault("two limbs swapped", ("swapped labels",), swapped_leg),
    MarkerFault("front and back of the pelvis swapped", ("swapped labels",), front_and_back),
    MarkerFault("a marker 5 cm off", ("displaced marker",), displaced(0.0)),
    MarkerFault("another marker 5 cm off", ("displaced marker",), displaced(0.5)),
    MarkerFault("a third marker 5 cm off", ("displaced marker",), displaced(1.0)),
    MarkerFault("a marker that jumps for one frame", ("jumping marker",), jumping(1)),
    MarkerFault("a marker that jumps for five frames", ("jumping marker",), jumping(5)),
    MarkerFault(
        "axis to the side mirrored", ("mirrored axis", "left and right"), partial(mirrored, 2)
    ),
    MarkerFault("axis forward mirrored", ("mirrored axis", "left and right"), partial(mirrored, 0)),
    MarkerFault("another axis up", ("vertical axis",), other_vertical),
    MarkerFault("walking direction turned by 90 degrees", (), partial(turned, 90.0)),
    MarkerFault("walking direction turned by 180 degrees", (), partial(turned, 180.0)),
    MarkerFault("origin 32 m away", (), far_away),
    MarkerFault("mm for m", ("refused",), partial(scaled, 1e3)),
    MarkerFault("labels spelled otherwise", ("unmatched markers", "near names"), other_spelling),
)
"""What may be wrong with markers."""


def findings_of(model: mm.Model, markers: mm.Markers) -> tuple[Finding, ...]:
    """Return the findings of the checks, or that the recording is refused with a reason."""
    try:
        fitted_to(model, mm.Trial(markers=markers, source="markers.trc"))
    except mm.BadData as error:
        return (Finding("refused", "markers", OTHER.message(str(error))),)
    return checked_kinematics(model, markers).findings


def verdict(kinds: Sequence[str], findings: Sequence[Finding], before: Sequence[Finding]) -> str:
    """Return whether a fault was corrected, found or missed.

    Other findings that the clean recording does not have follow in brackets.
    """
    known = {(one.kind, one.place) for one in before}
    new = [
        one
        for one in findings
        if (one.kind, one.place) not in known and one.kind not in ABOUT_THE_MODEL
    ]
    named = [one for one in new if one.kind in kinds]
    besides = sorted({one.kind for one in new if one.kind not in kinds})
    if not named:
        word = "missed"
    elif all(one.repaired for one in named):
        word = "corrected"
    else:
        word = "found"
    return word + (f" ({', '.join(besides)})" if besides else "")


def injected_marker_faults(folder: Path) -> Iterator[Row]:
    """Faults of markers put into clean recordings: what becomes of each."""
    clean = {name: opened(folder, *files) for name, files in SCALED.items()}
    before = {name: checked_kinematics(*one).findings for name, one in clean.items()}
    for fault in MARKER_FAULTS:
        row: Row = {"fault": fault.name}
        for name, (model, markers) in clean.items():
            faulty = fault.change(model, markers)
            if faulty is None:
                row[name] = "none"
            elif fault.kinds:
                row[name] = verdict(fault.kinds, findings_of(model, faulty), before[name])
            else:
                row[name] = same_angles_word(model, markers, faulty, before[name])
        yield row


def inner_angles(model: mm.Model, names: Sequence[str]) -> list[int]:
    """Which of some coordinates are angles of joints within the body."""
    root = {
        name for joint in model.joints if joint.parent == "ground" for name in joint.coordinates
    }
    return [
        k
        for k, name in enumerate(names)
        if name not in root and model.coordinate(name).motion == "rotational"
    ]


def same_angles_word(
    model: mm.Model, markers: mm.Markers, faulty: mm.Markers, before: Sequence[Finding]
) -> str:
    """Corrected if all joint angles are the clean recording's within 0.1 degrees."""
    found = checked_kinematics(model, faulty)
    clean = checked_kinematics(model, markers).fit.motion.values
    apart = np.degrees(
        np.nanmax(
            np.abs(found.fit.motion.values - clean)[:, inner_angles(model, model.coordinate_names)]
        )
    )
    word = "corrected" if apart < 0.1 else f"missed: {apart:.1f} degrees"
    new = verdict((), found.findings, before)
    return word + new.removeprefix("missed")


def clean_markers(folder: Path) -> Iterator[Row]:
    """List the findings on clean recordings, without facts about the model."""
    recordings: Mapping[str, tuple[str, str]] = SCALED | ALSO_CLEAN
    for name, files in recordings.items():
        found = checked_kinematics(*opened(folder, *files)).findings
        yield {"recording": name, **called(found)}


def called(findings: Sequence[Finding]) -> Row:
    """List the findings on a recording, without facts about the model."""
    about = [finding for finding in findings if finding.kind in ABOUT_THE_MODEL]
    return {
        "reported": texts_of([finding for finding in findings if finding not in about], "nothing"),
        "about the model": (
            "; ".join(f"{finding.kind}: {finding.place}" for finding in about) or "nothing"
        ),
    }


def corrected_angles(folder: Path) -> Iterator[Row]:
    """Joint angles with labels put right, against those of the clean recording."""
    for name in list(SCALED)[:4]:
        model, markers = opened(folder, *SCALED[name])
        clean = checked_kinematics(model, markers).fit.motion.values
        for fault in MARKER_FAULTS:
            faulty = (
                fault.change(model, markers)
                if "swapped" in fault.name or "jumps" in fault.name
                else None
            )
            if faulty is None:
                continue
            found = checked_kinematics(model, faulty)
            if any(one.repaired and one.kind in fault.kinds for one in found.findings):
                wrong = mm.inverse_kinematics(model, faulty).motion.values
                yield {
                    "recording": name,
                    "fault": fault.name,
                    **{
                        what: float(np.degrees(np.nanmax(np.abs(_turns(values - clean, model)))))
                        for what, values in (
                            ("as it is [deg]", wrong),
                            ("corrected [deg]", found.fit.motion.values),
                        )
                    },
                }


def _turns(apart: np.ndarray, model: mm.Model) -> np.ndarray:
    """Differences of angles, whole turns aside."""
    turning = [i for i, one in enumerate(model.coordinates) if one.motion == "rotational"]
    return (apart[:, turning] + np.pi) % (2.0 * np.pi) - np.pi

"""What recordings and tables hold, and what looks wrong with them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.io.c3d.emg import emg_channels
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import HIDDEN, MARKERS, PLATES, READING, UNITS
from myomorph.core.model.errors import counted
from myomorph.core.model.message_groups import grouped_messages
from myomorph.core.model.messages import Message
from myomorph.core.model.segment_poses import SegmentPoses
from myomorph.core.model.series import Markers, Series, Table, Trial
from myomorph.core.motion.crossings import crossings
from myomorph.lab.causes import FILE_SHAPE

SHOWN = 12
SELDOM = 0.2  # Share of positions that are missing above which the parts worth using are told.

POINT = re.compile(r"force.*p[xyz]$", re.IGNORECASE)
ANGLE = re.compile(
    r"flexion|angle|adduction|rotation|tilt|list|bending|elev|pro_sup|/value$|abd|_rot_",
    re.IGNORECASE,
)
NOT_ANGLE = re.compile(
    r"force|torque|moment|activation|fiber|_t[xyz]\b|/speed$|_u$|_acc", re.IGNORECASE
)


def inspect_trial(trial: Trial, kind: str) -> Inspection:
    """Markers, gaps, plates, analog channels and events of a recording."""
    facts: list[tuple[str, str]] = []
    warnings: list[Message] = list(trial.warnings)
    size = float("nan")
    if trial.markers is not None:
        size = _marker_findings(trial.markers, facts, warnings)
    else:
        warnings.append(FILE_SHAPE.message("no markers", severity="good to know"))
    if trial.other_points is not None:
        facts.append(
            (
                "computed quantities",
                f"{len(trial.other_points.names)}: {listed(trial.other_points.names)}",
            )
        )
    if trial.segments is not None:
        facts += _segment_facts(trial.segments)
    if trial.plate_recordings or trial.plates:
        _plate_findings(trial, size, facts, warnings)
    if trial.analog is not None:
        _analog_findings(trial, facts, warnings)
    if trial.events:
        events = [f"{event.side} {event.label} {event.time:.2f}".strip() for event in trial.events]
        facts.append(("events", f"{len(events)}: {', '.join(events)} s"))
    facts += [
        (label, text)
        for label, text in trial.facts.items()
        if label not in ("point rate", "analog rate")
    ]
    return Inspection(kind, tuple(facts), tuple(warnings))


def _segment_facts(segments: SegmentPoses) -> list[tuple[str, str]]:
    """Names, frames and use of segments whose poses a recording holds."""
    rate = (len(segments) - 1) / max(float(np.ptp(segments.time)), 1e-9)
    return [
        ("segments with poses", f"{len(segments.names)}: {listed(segments.names)}"),
        ("frames of segments", f"{len(segments)} at {rate:.4g} Hz"),
        (
            "use",
            "their orientations are taken by `ik --imu` (--imu-bodies SEGMENT=BODY names bodies)",
        ),
    ]


def _marker_findings(
    markers: Markers, facts: list[tuple[str, str]], warnings: list[Message]
) -> float:
    """Facts and warnings of markers; returns the size of the marker cloud [m]."""
    facts.append(("markers", f"{len(markers.names)}: {listed(markers.names)}"))
    facts.append(("frames", _clock(markers)))
    warnings += _time_gaps(markers)
    hidden = np.isnan(markers.values.sum(axis=2))
    share = hidden.mean(axis=0)
    facts.append(
        (
            "missing",
            (
                f"{100 * hidden.mean():.1f} % of positions, {np.count_nonzero(share)} markers with"
                " gaps"
            ),
        )
    )
    never = [name for name, part in zip(markers.names, share, strict=True) if part == 1.0]
    if never:
        warnings.append(HIDDEN.message(f"{len(never)} markers are never seen: {listed(never)}"))
    if SELDOM < hidden.mean() < 1.0:
        facts.append(("most markers seen", _passages(markers)))
    facts += _gaps(markers, hidden)
    seen = np.flatnonzero(~hidden.all(axis=1))
    if not len(seen):
        warnings.append(HIDDEN.message("no marker is ever seen", severity="changes results"))
        return float("nan")
    values = markers.values[seen]
    extent = np.nanmedian(np.nanmax(values, axis=1) - np.nanmin(values, axis=1), axis=0)
    size = float(np.linalg.norm(extent))
    facts.append(("spread", " x ".join(f"{length:.3g}" for length in extent) + " m (x, y, z)"))
    if len(markers.names) > 2:
        warnings += _odd_sizes(size)
    warnings += _jumps(markers, size)
    return size


def _passages(markers: Markers) -> str:
    """Say when most markers are seen."""
    spans = crossings(markers)
    shown = ", ".join(f"{start:.2f} to {end:.2f}" for start, end in spans[:SHOWN])
    more = f", ... ({len(spans)} in all)" if len(spans) > SHOWN else ""
    return f"{shown}{more} s" if spans else "nowhere for long"


def _gaps(markers: Markers, hidden: np.ndarray) -> list[tuple[str, str]]:
    """List the gaps of single markers, the largest first.

    Parameters
    ----------
    hidden : (frames, markers)
    """
    share = hidden.mean(axis=0)
    order = np.argsort(-share, kind="stable")
    gappy = [int(column) for column in order if 0.0 < share[column] < 1.0]
    facts = []
    for index in gappy[:SHOWN]:
        gaps = runs(hidden[:, index])
        longest = max(stop - start for start, stop in gaps) / markers.rate
        text = f"{100 * share[index]:.1f} % in {len(gaps)} gaps, longest {longest:.2f} s"
        facts.append((f"gaps of {markers.names[index]}", text))
    if len(gappy) > SHOWN:
        facts.append(("more gaps", f"in {counted(len(gappy) - SHOWN, 'other marker')}"))
    return facts


def _odd_sizes(size: float) -> list[Message]:
    """Warn of a cloud of markers that is of no body's size [m]."""
    if size > 15.0:
        return [
            UNITS.message(
                f"the markers spread over {size:.0f} m: does the unit in the file match the"
                " positions?"
            )
        ]
    if 0.0 < size < 0.005:
        return [
            UNITS.message(
                f"the markers spread over {1000 * size:.2g} mm: does the unit in the file match the"
                " positions?"
            )
        ]
    return []


def _clock(series: Series) -> str:
    frames = len(series)
    if frames < 2:
        return f"{frames} at {series.time[0]:.4g} s" if frames else "0"
    start = series.time[0]
    stop = series.time[-1]
    return f"{frames} at {series.rate:.4g} Hz, {start:.4g} to {stop:.4g} s ({stop - start:.4g} s)"


def _time_gaps(series: Series) -> list[Message]:
    """Places where frames are missing."""
    steps = np.diff(series.time)
    if len(steps) < 2:
        return []
    median = float(np.median(steps))
    wide = np.flatnonzero(steps > 1.6 * median)
    if len(wide) > 0.2 * len(steps):
        return [
            READING.message(
                f"the time step varies from {steps.min():.3g} to {steps.max():.3g} s: resample"
                " before filtering",
                severity="may change results",
            )
        ]
    lines = [
        READING.message(
            f"{counted(round(steps[step] / median - 1), 'frame')} missing between"
            f" {series.time[step]:.4g} and {series.time[step + 1]:.4g} s",
            severity="may change results",
        )
        for step in wide[:3]
    ]
    return lines + (
        [
            READING.message(
                f"frames are missing at {len(wide) - 3} more places", severity="may change results"
            )
        ]
        if len(wide) > 3
        else []
    )


def _jumps(markers: Markers, size: float) -> list[Message]:
    """Markers that move by a large part of the body from one frame to the next."""
    if len(markers) < 3 or not np.isfinite(size) or size == 0.0:
        return []
    steps = np.linalg.norm(np.diff(markers.values, axis=0), axis=2)
    lines = []
    # A step must also stand out of what the whole cloud does, as in a fast run at a low rate.
    whole = np.nan_to_num(steps)
    common = np.array([np.median(row[row > 0]) if (row > 0).any() else 0.0 for row in whole])
    odd = whole > 0.1 * size + 8.0 * common[:, None]
    for index in np.argsort(-odd.sum(axis=0), kind="stable")[:SHOWN]:
        count = int(odd[:, index].sum())
        if not count:
            break
        frame = int(np.argmax(whole[:, index]))
        lines.append(
            MARKERS.message(
                f"marker '{markers.names[index]}' jumps {counted(count, 'time')}, by"
                f" {whole[frame, index]:.2g} m at {markers.time[frame + 1]:.4g} s"
            )
        )
    return lines


def _plate_findings(
    trial: Trial, size: float, facts: list[tuple[str, str]], warnings: list[Message]
) -> None:
    """Facts and warnings of force plates."""
    total = np.zeros(len(trial.plate_time))
    for plate in trial.plates:
        loaded = np.isfinite(plate.points).all(axis=1)
        x = plate.corners[0] - plate.corners[1]
        y = plate.corners[0] - plate.corners[3]
        normal = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
        pressing = np.abs(plate.forces @ normal)
        total += np.where(loaded, np.nan_to_num(pressing), 0.0)
        peak = float(np.nanmax(pressing)) if np.isfinite(pressing).any() else 0.0
        facts.append(
            (
                plate.name,
                (
                    f"type {plate.kind}, {np.linalg.norm(x):.3g} x {np.linalg.norm(y):.3g} m,"
                    f" loaded {100 * loaded.mean():.0f} % of the time, largest normal force"
                    f" {peak:.4g} N"
                ),
            )
        )
    if not total.any():
        if trial.plates:
            warnings.append(PLATES.message("no force plate carries a load"))
        return
    usual = float(np.median(total[total > 0.5 * np.median(total[total > 0])]))
    facts.append(
        (
            "load",
            (
                f"the plates usually carry {usual:.4g} N in all: {usual / 9.81:.3g} kg, if it is"
                " the whole body"
            ),
        )
    )
    # A body of size h weighs about 22 kg/m^2 h^2 (body mass index), from mice to men.
    if np.isfinite(size) and size > 0 and not 0.1 < usual / (9.81 * 22.0 * size**2) < 10.0:
        warnings.append(
            UNITS.message(
                f"a load of {usual:.3g} N does not fit markers that spread over {size:.2g} m: "
                "check the plates' scale and units"
            )
        )


def _analog_findings(trial: Trial, facts: list[tuple[str, str]], warnings: list[Message]) -> None:
    """Facts and warnings of analog channels."""
    analog = trial.analog
    if analog is None:
        return
    units = sorted({unit for unit in analog.units if unit})
    facts.append(
        (
            "analog",
            (
                f"{len(analog.names)} channels at {analog.rate:.5g} Hz, in"
                f" {', '.join(units) or 'no unit'}"
            ),
        )
    )
    facts.append(("channels", listed(analog.names)))
    emg = emg_channels(trial)
    if emg:
        facts.append(("probably EMG", listed(emg)))
    flat = [
        name for name, column in zip(analog.names, analog.values.T, strict=True) if _flat(column)
    ]
    if flat:
        warnings.append(
            FILE_SHAPE.message(
                f"{len(flat)} analog channels never change: {listed(flat)}", severity="good to know"
            )
        )


def _flat(column: Array) -> bool:
    finite = column[np.isfinite(column)]
    return len(finite) > 1 and bool(finite.max() == finite.min())


def inspect_table(table: Table) -> Inspection:
    """Rows, names, units and oddities of a MOT or STO table."""
    facts = [
        ("columns", f"{len(table.names)}: {listed(table.names)}"),
        ("rows", _clock(table)),
        ("angles", "degrees" if table.in_degrees else "radians, or none"),
    ]
    facts += [(label, text) for label, text in table.facts.items() if text]
    warnings = list(table.warnings)
    warnings += _time_gaps(table)
    missing = np.isnan(table.values).sum(axis=0)
    if missing.any():
        worst = [
            table.names[column]
            for column in np.argsort(-missing, kind="stable")[:SHOWN]
            if missing[column]
        ]
        warnings.append(
            FILE_SHAPE.message(
                f"{missing.sum()} values are NaN ({100 * missing.sum() / table.values.size:.1f} %),"
                f" in {np.count_nonzero(missing)} columns: {listed(worst)}"
            )
        )
    warnings += _unit_warnings(table)
    return Inspection("table", tuple(facts), tuple(warnings))


def _unit_warnings(table: Table) -> list[Message]:
    """Angles whose size does not fit the header, and points of pressure of an unlikely size."""
    result = []
    sizes = np.array(
        [np.max(np.abs(column[np.isfinite(column)]), initial=0.0) for column in table.values.T]
    )
    angles = sizes[
        [bool(ANGLE.search(name)) and not NOT_ANGLE.search(name) for name in table.names]
    ]
    if len(angles) > 4 and table.in_degrees and 0.0 < angles.max() < 2.0 * np.pi:
        result.append(
            UNITS.message("the header says degrees, but no angle exceeds 6.28: are they radians?")
        )
    if len(angles) > 4 and not table.in_degrees and np.median(angles) > 8.0 * np.pi:
        result.append(
            UNITS.message("the header says radians, but many angles exceed 25: are they degrees?")
        )
    reach = max((_reach(table, name) for name in table.names if POINT.search(name)), default=0.0)
    if reach > 50.0:
        result.append(
            UNITS.message(
                f"points of application reach {reach:.4g} under load: are they in millimetres"
                " instead of metres?"
            )
        )
    return result


def _reach(table: Table, name: str) -> float:
    """Find the largest coordinate of a point of application under load.

    Under load the force is more than a tenth of its peak.
    """
    forces = [f"{name[:-2]}v{axis}" for axis in "xyz"]
    point = np.abs(np.nan_to_num(table[name]))
    if not set(forces) <= set(table.names):
        return 0.0
    size = np.abs(np.nan_to_num(np.column_stack([table[force] for force in forces]))).max(axis=1)
    return float(np.max(point[size > 0.1 * size.max()], initial=0.0))


def listed(names: Sequence[str], most: int = 400) -> str:
    """Names in a row, the first ones where there are very many."""
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")


@dataclass(frozen=True)
class Inspection:
    """What a file holds, and what looks wrong with it.

    Attributes
    ----------
    kind : of the file, in words
    facts : label and text, in the order in which they are shown
    warnings : what looks wrong, one line each
    """

    kind: str
    facts: tuple[tuple[str, str], ...]
    warnings: tuple[Message, ...] = ()

    def lines(self) -> list[str]:
        """Write the inspection as text, a fact or a warning a line."""
        width = max((len(label) for label, _ in self.facts), default=0)
        shown = [self.kind, *(f"  {label:<{width}}  {text}" for label, text in self.facts)]
        for group in grouped_messages(self.warnings):
            word = "warning" if group.is_warning else "note"
            shown += [f"  {word}: {line}" for line in group.messages]
        return shown

"""Inverse kinematics that is not wrong in silence: what of a recording of markers may not be believed, and its repair.

Before the fit: markers that jump and labels exchanged for some frames show in time alone. After it: labels exchanged
throughout, a marker beside its place, coordinates held at their bounds or shown by no marker, a body that lies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.findings import Finding
from myomorph.model.model import Model
from myomorph.model.series import Markers
from myomorph.motion.hidden_frames import without_hidden
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics, pose_problem
from myomorph.motion.label_repair import without_swaps
from myomorph.motion.lengths import length_unit
from myomorph.motion.marker_names import name_findings
from myomorph.motion.marker_places import place_findings
from myomorph.motion.marker_steps import Exchange, Steps, edges_of, exchanges, excursions
from myomorph.motion.marker_texts import frames_text, pairs_text, span_of, times_text
from myomorph.motion.pose_checks import pose_findings
from myomorph.motion.sensors.sensor_kinematics import SensorFit
from myomorph.rigid.tree import compile_tree


@dataclass(frozen=True)
class MarkerCheckOptions:
    """Options of the checks of markers.

    Attributes
    ----------
    mend : put right what is evident: exchanged labels, a jumping marker bridged in these frames, frames left empty
        that show too few markers; else it is only reported
    """

    mend: bool = True


@dataclass(frozen=True, eq=False)
class CheckedFit:
    """Inverse kinematics of a recording whose labels were checked.

    Attributes
    ----------
    fit : of the mended recording
    markers : the recording as mended
    findings : what may not be believed, and what was mended
    sensors : what inertial sensors add, None without any
    """

    fit: KinematicsFit
    markers: Markers
    findings: tuple[Finding, ...]
    sensors: SensorFit | None = None


def checked_kinematics(
    model: Model,
    markers: Markers,
    options: InverseKinematicsOptions | None = None,
    checks: MarkerCheckOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> CheckedFit:
    """`inverse_kinematics` of a recording, with findings about its labels and what was mended.

    Parameters
    ----------
    model, markers, options, progress : as for `inverse_kinematics`
    checks : see `MarkerCheckOptions`

    Raises
    ------
    BadData, UnknownName
        as `inverse_kinematics`
    """
    options, checks = options or InverseKinematicsOptions(), checks or MarkerCheckOptions()
    unit = length_unit(compile_tree(model))
    mended, in_time = mended_in_time(model, markers, unit)
    used = mended if checks.mend else markers
    fit = inverse_kinematics(model, used, options, progress)
    used, fit, swapped, _ = without_swaps(model, used, fit, options, checks.mend, unit)
    problem = pose_problem(compile_tree(model), fit.marker_names, fit.weights, options)
    fit, hidden = without_hidden(model, used, fit, problem, checks.mend)
    matched = len(fit.marker_names)
    shared = set(model.marker_names)
    unknown = tuple(name for name in fit.unused_markers if name not in shared)
    findings = [*name_findings(fit.missing_markers, unknown, matched), *swapped]
    findings += [finding if checks.mend else _only_told(finding) for finding in in_time]
    findings += hidden
    # What a body under wrong labels does says nothing more.
    if all(finding.mended for finding in swapped):
        findings += place_findings(model, used, fit, problem, unit)
        findings += pose_findings(model, used, fit, problem, options)
    return CheckedFit(fit, used, tuple(findings))


def _only_told(finding: Finding) -> Finding:
    text = finding.text.split("; mended")[0]
    return replace(finding, text=text, mended=False)


def mended_in_time(model: Model, markers: Markers, unit: float) -> tuple[Markers, tuple[Finding, ...]]:
    """Labels exchanged for some frames put back, and jumping markers bridged there, with what was found.

    Parameters
    ----------
    unit : see `length_unit`
    """
    columns = [i for i, name in enumerate(markers.names) if name in set(model.marker_names)]
    values, findings = np.array(markers.values), list[Finding]()
    names = [markers.names[i] for i in columns]
    edges = edges_of(markers.time, values[:, columns], unit)
    parts: dict[tuple[int, int], list[tuple[str, str]]] = {}
    for exchange in _short_side(exchanges(values[:, columns], edges), len(values)):
        i, j = columns[exchange.first], columns[exchange.second]
        span = slice(exchange.start, exchange.stop)
        values[span, i], values[span, j] = values[span, j].copy(), values[span, i].copy()
        parts.setdefault((exchange.start, exchange.stop), []).append((names[exchange.first], names[exchange.second]))
    findings += [_exchanged(markers, pairs, *part) for part, pairs in parts.items()]
    if findings:
        edges = edges_of(markers.time, values[:, columns], unit)
    findings += _bridged(markers, values, columns, edges)
    return (replace(markers, values=values) if findings else markers), tuple(findings)


def _short_side(exchanges: Sequence[Exchange], frames: int) -> Iterator[Exchange]:
    """Each exchange on the side that is shorter: an odd one at the end may be right there and wrong before."""
    for exchange in exchanges:
        if exchange.stop == frames and exchange.start < frames - exchange.start:
            yield Exchange(exchange.first, exchange.second, 0, exchange.start)
        else:
            yield exchange


def _exchanged(markers: Markers, pairs: Sequence[tuple[str, str]], start: int, stop: int) -> Finding:
    span = span_of(markers.time, start, stop)
    text = (
        f"labels {pairs_text(pairs)} are exchanged {times_text([span])} ({frames_text(stop - start)}): their paths "
        "go on in each other; mended: exchanged back there"
    )
    return Finding("swapped labels", pairs_text(pairs).replace("'", ""), text, (span,), True)


def _bridged(markers: Markers, values: Array, columns: Sequence[int], edges: Sequence[Steps]) -> Iterator[Finding]:
    """Jumping markers, put where their path leads from before to after; at the ends of the recording left out.

    A marker that is left out for some frames lets the pose jump, for no marker fits exactly: a bridge does not.
    """
    jumping: dict[int, list[tuple[int, int, float]]] = {}
    for excursion in excursions(markers.time, edges):
        jumping.setdefault(columns[excursion.marker], []).append((excursion.start, excursion.stop, excursion.size))
    for column, parts in jumping.items():
        name = markers.names[column]
        for start, stop, _ in parts:
            values[start:stop, column] = _bridge(markers.time, values[:, column], start, stop)
        spans = [span_of(markers.time, start, stop) for start, stop, _ in parts]
        worst = max(size for _, _, size in parts)
        count = sum(stop - start for start, stop, _ in parts)
        gone = bool(np.isnan(values[[start for start, _, _ in parts], column]).any())
        jump = (
            f"marker '{name}' jumps by up to {100 * worst:.1f} cm and back {times_text(spans)} ({frames_text(count)})"
        )
        how = "left out there" if gone else "bridged there from the frames around"
        yield Finding("jumping marker", name, f"{jump}; mended: {how}", tuple(spans), True)


def _bridge(time: Array, path: Array, start: int, stop: int) -> Array:
    """(stop - start, 3) a cubic from the frames before to those after; NaN where these are missing."""
    if start < 2 or stop > len(path) - 2:
        return np.full((stop - start, 3), np.nan)
    t0, t1 = time[start - 1], time[stop]
    span = t1 - t0
    slope0 = span * (path[start - 1] - path[start - 2]) / (t0 - time[start - 2])
    slope1 = span * (path[stop + 1] - path[stop]) / (time[stop + 1] - t1)
    u = ((time[start:stop] - t0) / span)[:, None]
    before = (1.0 + 2.0 * u) * (1.0 - u) ** 2 * path[start - 1] + u * (1.0 - u) ** 2 * slope0
    after = u**2 * (3.0 - 2.0 * u) * path[stop] + u**2 * (u - 1.0) * slope1
    return np.asarray(before + after)

"""Inverse kinematics that is not wrong in silence: what of a recording of markers may not be believed, and its repair.

Before the fit: markers that jump and labels exchanged for some frames show in time alone. After it: labels exchanged
throughout, a marker beside its place, coordinates held at their bounds or shown by no marker, a body that lies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array, runs
from myomorph.model.findings import Finding
from myomorph.model.model import Model
from myomorph.model.series import Markers
from myomorph.motion.hidden_frames import without_hidden
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics, marker_arrays
from myomorph.motion.lengths import length_unit
from myomorph.motion.marker_names import name_findings
from myomorph.motion.marker_places import place_findings
from myomorph.motion.marker_steps import Exchange, Steps, edges_of, exchanges, excursions
from myomorph.motion.marker_swaps import MIRRORED, SIDES, Solve, Swap, find_swap
from myomorph.motion.pose_checks import pose_findings
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

MOST_SWAPS = 4
"""Exchanges of labels that are looked for one after the other."""

WORSE = 1.3
"""A part of a recording whose labels are exchanged has errors of the two markers larger by this factor at least."""


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
    """

    fit: KinematicsFit
    markers: Markers
    findings: tuple[Finding, ...]


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
    used, fit, swapped = _without_swaps(model, used, fit, options, checks, unit)
    arrays = marker_arrays(compile_tree(model), fit.marker_names, fit.weights, options)
    fit, hidden = without_hidden(model, used, fit, arrays, checks.mend)
    matched = len(fit.marker_names)
    shared = set(model.marker_names)
    unknown = tuple(name for name in fit.unused_markers if name not in shared)
    findings = [*name_findings(fit.missing_markers, unknown, matched), *swapped]
    findings += [one if checks.mend else _only_told(one) for one in in_time]
    findings += hidden
    # What a body under wrong labels does says nothing more.
    if all(one.mended for one in swapped):
        findings += place_findings(model, used, fit, arrays, unit)
        findings += pose_findings(model, used, fit, arrays, options)
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
    values, found = np.array(markers.values), list[Finding]()
    names = [markers.names[i] for i in columns]
    edges = edges_of(markers.time, values[:, columns], unit)
    parts: dict[tuple[int, int], list[tuple[str, str]]] = {}
    for one in _short_side(exchanges(values[:, columns], edges), len(values)):
        i, j = columns[one.first], columns[one.second]
        span = slice(one.start, one.stop)
        values[span, i], values[span, j] = values[span, j].copy(), values[span, i].copy()
        parts.setdefault((one.start, one.stop), []).append((names[one.first], names[one.second]))
    found += [_exchanged(markers, pairs, *part) for part, pairs in parts.items()]
    if found:
        edges = edges_of(markers.time, values[:, columns], unit)
    found += _bridged(markers, values, columns, edges)
    return (replace(markers, values=values) if found else markers), tuple(found)


def _short_side(found: Sequence[Exchange], frames: int) -> Iterator[Exchange]:
    """Each exchange on the side that is shorter: an odd one at the end may be right there and wrong before."""
    for one in found:
        if one.stop == frames and one.start < frames - one.start:
            yield Exchange(one.first, one.second, 0, one.start)
        else:
            yield one


def _exchanged(markers: Markers, pairs: Sequence[tuple[str, str]], start: int, stop: int) -> Finding:
    span = _span(markers.time, start, stop)
    text = (
        f"labels {_pairs(pairs)} are exchanged {_when([span])} ({_frames(stop - start)}): their paths go on in each "
        "other; mended: exchanged back there"
    )
    return Finding("swapped labels", _pairs(pairs).replace("'", ""), text, (span,), True)


def _pairs(pairs: Sequence[tuple[str, str]], most: int = 3) -> str:
    """The first pairs of labels."""
    more = f" and {len(pairs) - most} other pairs" if len(pairs) > most else ""
    return ", ".join(f"'{one}' and '{other}'" for one, other in pairs[:most]) + more


def _bridged(markers: Markers, values: Array, columns: Sequence[int], edges: Sequence[Steps]) -> Iterator[Finding]:
    """Jumping markers, put where their path leads from before to after; at the ends of the recording left out.

    A marker that is left out for some frames lets the pose jump, for no marker fits exactly: a bridge does not.
    """
    jumping: dict[int, list[tuple[int, int, float]]] = {}
    for one in excursions(markers.time, edges):
        jumping.setdefault(columns[one.marker], []).append((one.start, one.stop, one.size))
    for column, parts in jumping.items():
        name = markers.names[column]
        for start, stop, _ in parts:
            values[start:stop, column] = _bridge(markers.time, values[:, column], start, stop)
        spans = [_span(markers.time, start, stop) for start, stop, _ in parts]
        worst = max(size for _, _, size in parts)
        count = sum(stop - start for start, stop, _ in parts)
        gone = bool(np.isnan(values[[start for start, _, _ in parts], column]).any())
        jump = f"marker '{name}' jumps by up to {100 * worst:.1f} cm and back {_when(spans)} ({_frames(count)})"
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


def _without_swaps(
    model: Model,
    markers: Markers,
    fit: KinematicsFit,
    options: InverseKinematicsOptions,
    checks: MarkerCheckOptions,
    unit: float,
) -> tuple[Markers, KinematicsFit, tuple[Finding, ...]]:
    """Labels exchanged that the fit shows, put back where they are not of the whole body."""
    found: list[Finding] = []
    for _ in range(MOST_SWAPS):
        names = fit.marker_names
        columns = [markers.names.index(name) for name in names]
        observed = markers.values[:, columns]
        swap = find_swap(
            model, names, observed, fit.errors, _placed(model, fit), _solver(model, markers, names, options), unit
        )
        if swap is None:
            break
        values = np.array(markers.values)
        values[:, columns] = swap.applied(observed, swap.columns(names))
        exchanged = replace(markers, values=values)
        other = inverse_kinematics(model, exchanged, options)
        with np.errstate(invalid="ignore"):
            wrong = _smooth(other.rms < 0.8 * fit.rms)
        if not wrong.any():
            break
        # A mirrored recording is not mended: its forces would have to be mirrored too, along an axis that markers hide.
        sure = swap.name != MIRRORED and (swap.certain or wrong.mean() < 0.5)
        finding = _swap_finding(swap, markers, wrong, fit, other, sure and checks.mend)
        found.append(finding)
        if not finding.mended:
            break
        if wrong.mean() > 0.9:
            wrong[:] = True
        markers = replace(markers, values=np.where(wrong[:, None, None], values, markers.values))
        fit = other if wrong.all() else inverse_kinematics(model, markers, options)
    return markers, fit, tuple(found)


def _smooth(flags: np.ndarray) -> np.ndarray:
    """Flags without runs of one or two frames."""
    found = np.array(flags)
    for value in (True, False):
        for start, stop in runs(found == value):
            if stop - start < 3 and start > 0 and stop < len(found):
                found[start:stop] = not value
    return found


def _swap_finding(
    swap: Swap, markers: Markers, wrong: np.ndarray, fit: KinematicsFit, other: KinematicsFit, mended: bool
) -> Finding:
    spans = [] if wrong.mean() > 0.9 else [_span(markers.time, start, stop) for start, stop in runs(wrong)]
    before, after = (100 * float(np.nanmedian(one.rms[wrong])) for one in (fit, other))
    when = _when(spans) if spans else "throughout"
    fits = f"root mean square error {before:.1f} cm, {after:.1f} cm exchanged"
    if swap.name in (SIDES, MIRRORED) and not (swap.certain and swap.name == SIDES):
        fits = fits.replace("exchanged", "otherwise")
        sides = "the labels of the two sides are swapped (give a map with --labels)"
        mirrored = "one axis of the recording is mirrored (turn its sign, in the forces too)"
        why = mirrored if swap.certain else f"either {sides}, or {mirrored}"
        text = f"left and right are exchanged {when}: {fits}; {why}"
        return Finding("mirrored axis" if swap.certain else "left and right", "all markers", text, tuple(spans))
    labels = _pairs(swap.pairs)
    what = f"labels {labels}" if len(swap.pairs) == 1 else f"labels of {swap.name} ({labels})"
    text = f"{what} are exchanged {when}: {fits}" + ("; mended: exchanged back there" if mended else "")
    return Finding("swapped labels", labels.replace("'", ""), text, tuple(spans), mended)


def _placed(model: Model, fit: KinematicsFit) -> Array:
    """(frames, markers, 3) where the model has its markers [m]."""
    tree = compile_tree(model)
    marked = [model.marker(name) for name in fit.marker_names]
    poses = forward_kinematics(tree, np.nan_to_num(fit.motion.values))
    bodies = np.array([tree.body_index[one.body] for one in marked])
    return poses.points(bodies, np.array([one.location for one in marked]))


def _solver(model: Model, markers: Markers, names: Sequence[str], options: InverseKinematicsOptions) -> Solve:
    """Inverse kinematics of single frames, each searched for anew."""

    def solve(observed: Array) -> Array:
        errors = np.full(observed.shape[:2], np.nan)
        for k, one in enumerate(observed):
            if np.isfinite(one).all(axis=1).any():
                single = Markers(markers.time[:1], tuple(names), one[None])
                errors[k] = inverse_kinematics(model, single, options).errors[0]
        return errors

    return solve


def _span(time: Array, start: int, stop: int) -> tuple[float, float]:
    return float(time[start]), float(time[stop - 1])


def _when(spans: Sequence[tuple[float, float]], most: int = 3) -> str:
    """'at 1.20 s and from 1.50 to 1.62 s'."""
    parts = [f"at {a:.2f} s" if b - a < 0.005 else f"from {a:.2f} to {b:.2f} s" for a, b in spans[:most]]
    more = f" and in {len(spans) - most} other parts" if len(spans) > most else ""
    return ", ".join(parts) + more


def _frames(count: int) -> str:
    return f"{count} frame" + ("" if count == 1 else "s")

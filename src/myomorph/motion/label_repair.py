"""Labels exchanged throughout, put back: by the poses of a model that fits, and before its lengths are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from myomorph.model.arrays import Array, runs
from myomorph.model.findings import Finding, Repair, pairs_text, repaired, spans_of, times_text
from myomorph.model.model import Model
from myomorph.model.scale import scale
from myomorph.model.series import Markers
from myomorph.motion.body.postures import overall_size
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics, tracked_markers
from myomorph.motion.lengths import length_unit
from myomorph.motion.marker_swaps import MIRRORED, OF_ANY_LENGTHS, SIDES, USUAL, Margin, Solve, Swap, find_swap
from myomorph.motion.stretch import skeleton
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

MAX_SWAPS = 4
"""Exchanges of labels that are looked for one after the other."""

SAMPLES = 16
"""Frames that are looked at before a body's lengths are known."""

THROUGHOUT = 0.9
"""Share of the frames from which on an exchange is one of all frames."""


def mended_labels(
    model: Model, markers: Markers, options: InverseKinematicsOptions | None = None
) -> tuple[Markers, tuple[Finding, ...]]:
    """A recording with labels that are exchanged throughout put back, before the lengths of the body are known. A
    calibration would else move the markers on the model to where the exchanged ones lie.
    """
    options = options or InverseKinematicsOptions()
    names, _ = tracked_markers(model, markers, options)
    columns = [markers.names.index(name) for name in names]
    seen = np.isfinite(markers.values[:, columns]).all(axis=2).sum(axis=1)
    frames = np.flatnonzero(seen >= np.percentile(seen, 75.0)) if len(seen) else np.zeros(0, np.int64)
    if len(frames) < 2 or seen.max() < 3:
        return markers, ()
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, SAMPLES).astype(int))]
    size = overall_size(model, names, [markers.values[:, columns]])
    bare = skeleton(model)
    sized = scale(bare, dict.fromkeys(bare.body_names, np.full(3, size)))
    sample = Markers(markers.time[chosen], markers.names, markers.values[chosen])
    fit = inverse_kinematics(sized, sample, options)
    _, findings = swap_findings(sized, sample, fit, options, length_unit(compile_tree(sized)), OF_ANY_LENGTHS)
    return repaired(markers, (finding for finding in findings if not finding.times))


def swap_findings(
    model: Model,
    markers: Markers,
    fit: KinematicsFit,
    options: InverseKinematicsOptions,
    unit: float,
    margin: Margin = USUAL,
    mend: bool = True,
) -> tuple[KinematicsFit, tuple[Finding, ...]]:
    """Exchanged labels that the fit shows, and the fit with those put back (if `mend`) that are not of all the body."""
    findings: list[Finding] = []
    for _ in range(MAX_SWAPS):
        names = fit.marker_names
        columns = [markers.names.index(name) for name in names]
        observed = markers.values[:, columns]
        solve = _solver(model, markers, names, options)
        swap = find_swap(model, names, observed, fit.errors, _placed(model, fit), solve, unit, margin)
        if swap is None:
            break
        other = inverse_kinematics(model, _put_back(markers, swap, names), options)
        with np.errstate(invalid="ignore"):
            wrong = _smooth(other.rms < max(0.8, margin.share) * fit.rms)
        if not wrong.any():
            break
        # A mirrored recording is not mended: its forces would have to be mirrored too, along an axis that markers hide.
        sure = swap.name != MIRRORED and (swap.certain or wrong.mean() < 0.5)
        finding = _swap_finding(swap, markers, wrong, fit, other, sure)
        findings.append(finding)
        if finding.repair is None or not mend:
            break
        markers, _ = repaired(markers, (finding,))
        fit = inverse_kinematics(model, markers, options) if finding.times else other
    return fit, tuple(findings)


def _put_back(markers: Markers, swap: Swap, names: Sequence[str], wrong: np.ndarray | None = None) -> Markers:
    """The recording with an exchange of labels undone, in some frames (frames,) or in all."""
    values, columns = np.array(markers.values), [markers.names.index(name) for name in names]
    values[:, columns] = swap.applied(values[:, columns], swap.columns(names))
    kept = values if wrong is None else np.where(wrong[:, None, None], values, markers.values)
    return replace(markers, values=kept)


def _smooth(flags: np.ndarray) -> np.ndarray:
    """Flags without runs of one or two frames."""
    result = np.array(flags)
    for value in (True, False):
        for start, stop in runs(result == value):
            if stop - start < 3 and start > 0 and stop < len(result):
                result[start:stop] = not value
    return result


def _swap_finding(
    swap: Swap, markers: Markers, wrong: np.ndarray, fit: KinematicsFit, other: KinematicsFit, sure: bool
) -> Finding:
    spans = () if wrong.mean() > THROUGHOUT else spans_of(markers.time, wrong)
    before, after = (100 * float(np.nanmedian(tried.rms[wrong])) for tried in (fit, other))
    when = times_text(spans) if spans else "throughout"
    fits = f"root mean square error {before:.1f} cm, {after:.1f} cm exchanged"
    if swap.name in (SIDES, MIRRORED) and not (swap.certain and swap.name == SIDES):
        fits = fits.replace("exchanged", "otherwise")
        sides = "the labels of the two sides are swapped (give a map with --labels)"
        mirrored = "one axis of the recording is mirrored (turn its sign, in the forces too)"
        why = mirrored if swap.certain else f"either {sides}, or {mirrored}"
        text = f"left and right are exchanged {when}: {fits}; {why}"
        return Finding("mirrored axis" if swap.certain else "left and right", "all markers", text, spans)
    labels = pairs_text(swap.pairs)
    what = f"labels {labels}" if len(swap.pairs) == 1 else f"labels of {swap.name} ({labels})"
    put_back = partial(_put_back, swap=swap, names=fit.marker_names, wrong=wrong if spans else None)
    repair = Repair(put_back, "exchanged back there") if sure else None
    text = f"{what} are exchanged {when}, with a {fits}"
    return Finding("swapped labels", labels.replace("'", ""), text, spans, repair=repair)


def _placed(model: Model, fit: KinematicsFit) -> Array:
    """(frames, markers, 3) where the model has its markers [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, np.nan_to_num(fit.motion.values))
    return poses.markers([model.marker(name) for name in fit.marker_names])


def _solver(model: Model, markers: Markers, names: Sequence[str], options: InverseKinematicsOptions) -> Solve:
    """Inverse kinematics of single frames, each searched for anew."""

    def solve(observed: Array) -> Array:
        errors = np.full(observed.shape[:2], np.nan)
        for index, positions in enumerate(observed):
            if np.isfinite(positions).all(axis=1).any():
                single = Markers(markers.time[:1], tuple(names), positions[None])
                errors[index] = inverse_kinematics(model, single, options).errors[0]
        return errors

    return solve

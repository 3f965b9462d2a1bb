"""Labels exchanged throughout, put back: by the poses of a model that fits, and before its lengths are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array, runs
from myomorph.model.findings import Finding
from myomorph.model.model import Model
from myomorph.model.scale import scale
from myomorph.model.series import Markers
from myomorph.motion.body.postures import overall_size
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics, tracked_markers
from myomorph.motion.lengths import length_unit
from myomorph.motion.marker_swaps import MIRRORED, OF_ANY_LENGTHS, SIDES, USUAL, Margin, Solve, Swap, find_swap
from myomorph.motion.marker_texts import pairs_text, span_of, times_text
from myomorph.motion.stretch import skeleton
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

MOST_SWAPS = 4
"""Exchanges of labels that are looked for one after the other."""

SAMPLES = 16
"""Frames that are looked at before a body's lengths are known."""

THROUGHOUT = 0.9
"""Share of the frames from which on an exchange is one of all frames."""


class Relabelled(NamedTuple):
    """A recording whose labels were put right, and the fit of a model to it.

    Attributes
    ----------
    throughout : exchanges that were mended in all frames
    """

    markers: Markers
    fit: KinematicsFit
    findings: tuple[Finding, ...]
    throughout: tuple[Swap, ...]


def mended_labels(
    model: Model, markers: Markers, options: InverseKinematicsOptions | None = None
) -> tuple[Markers, tuple[Finding, ...]]:
    """A recording with labels that are exchanged throughout put back, before the lengths of the body are known.

    A calibration would else move the markers on the model to where the exchanged ones lie.

    Parameters
    ----------
    model : of any size; it is scaled as a whole
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
    repaired = without_swaps(sized, sample, fit, options, True, length_unit(compile_tree(sized)), OF_ANY_LENGTHS)
    values = np.array(markers.values)
    for swap in repaired.throughout:
        values[:, columns] = swap.applied(values[:, columns], swap.columns(names))
    told = tuple(finding for finding in repaired.findings if not finding.times)
    return (replace(markers, values=values) if repaired.throughout else markers), told


def without_swaps(
    model: Model,
    markers: Markers,
    fit: KinematicsFit,
    options: InverseKinematicsOptions,
    mend: bool,
    unit: float,
    margin: Margin = USUAL,
) -> Relabelled:
    """Labels exchanged that the fit shows, put back where they are not of the whole body."""
    findings: list[Finding] = []
    throughout: list[Swap] = []
    for _ in range(MOST_SWAPS):
        names = fit.marker_names
        columns = [markers.names.index(name) for name in names]
        observed = markers.values[:, columns]
        solve = _solver(model, markers, names, options)
        swap = find_swap(model, names, observed, fit.errors, _placed(model, fit), solve, unit, margin)
        if swap is None:
            break
        values = np.array(markers.values)
        values[:, columns] = swap.applied(observed, swap.columns(names))
        exchanged = replace(markers, values=values)
        other = inverse_kinematics(model, exchanged, options)
        with np.errstate(invalid="ignore"):
            wrong = _smooth(other.rms < max(0.8, margin.share) * fit.rms)
        if not wrong.any():
            break
        # A mirrored recording is not mended: its forces would have to be mirrored too, along an axis that markers hide.
        sure = swap.name != MIRRORED and (swap.certain or wrong.mean() < 0.5)
        finding = _swap_finding(swap, markers, wrong, fit, other, sure and mend)
        findings.append(finding)
        if not finding.mended:
            break
        if wrong.mean() > THROUGHOUT:
            wrong[:] = True
            throughout.append(swap)
        markers = replace(markers, values=np.where(wrong[:, None, None], values, markers.values))
        fit = other if wrong.all() else inverse_kinematics(model, markers, options)
    return Relabelled(markers, fit, tuple(findings), tuple(throughout))


def _smooth(flags: np.ndarray) -> np.ndarray:
    """Flags without runs of one or two frames."""
    result = np.array(flags)
    for value in (True, False):
        for start, stop in runs(result == value):
            if stop - start < 3 and start > 0 and stop < len(result):
                result[start:stop] = not value
    return result


def _swap_finding(
    swap: Swap, markers: Markers, wrong: np.ndarray, fit: KinematicsFit, other: KinematicsFit, mended: bool
) -> Finding:
    spans = [] if wrong.mean() > THROUGHOUT else [span_of(markers.time, start, stop) for start, stop in runs(wrong)]
    before, after = (100 * float(np.nanmedian(tried.rms[wrong])) for tried in (fit, other))
    when = times_text(spans) if spans else "throughout"
    fits = f"root mean square error {before:.1f} cm, {after:.1f} cm exchanged"
    if swap.name in (SIDES, MIRRORED) and not (swap.certain and swap.name == SIDES):
        fits = fits.replace("exchanged", "otherwise")
        sides = "the labels of the two sides are swapped (give a map with --labels)"
        mirrored = "one axis of the recording is mirrored (turn its sign, in the forces too)"
        why = mirrored if swap.certain else f"either {sides}, or {mirrored}"
        text = f"left and right are exchanged {when}: {fits}; {why}"
        return Finding("mirrored axis" if swap.certain else "left and right", "all markers", text, tuple(spans))
    labels = pairs_text(swap.pairs)
    what = f"labels {labels}" if len(swap.pairs) == 1 else f"labels of {swap.name} ({labels})"
    text = f"{what} are exchanged {when}: {fits}" + ("; mended: exchanged back there" if mended else "")
    return Finding("swapped labels", labels.replace("'", ""), text, tuple(spans), mended)


def _placed(model: Model, fit: KinematicsFit) -> Array:
    """(frames, markers, 3) where the model has its markers [m]."""
    tree = compile_tree(model)
    marked = [model.marker(name) for name in fit.marker_names]
    poses = forward_kinematics(tree, np.nan_to_num(fit.motion.values))
    bodies = np.array([tree.body_index[marker.body] for marker in marked])
    return poses.points(bodies, np.array([marker.location for marker in marked]))


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

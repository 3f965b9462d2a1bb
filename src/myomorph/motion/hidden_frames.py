"""Frames whose markers do not show the pose: a body that walks into the cameras' view, a leg that they lose.

The least squares have an answer there all the same, which the posture and the frames beside it decide. Where the root's
pose is not shown, nothing after it means anything, so such frames become gaps; a coordinate that is hidden in some
frames only is named with them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from myomorph.model.errors import quoted
from myomorph.model.findings import Finding, Repair, spans_of
from myomorph.model.model import Model
from myomorph.model.series import Markers
from myomorph.motion.ik import KinematicsFit
from myomorph.motion.marker_influence import MarkerFrames, marker_frames
from myomorph.motion.pose_problem import PoseProblem
from myomorph.motion.turns import floating_coordinates
from myomorph.rigid.tree import compile_tree

FAINT = 0.01
"""A direction of the coordinates that moves the seen markers by a smaller share of the usual is not shown: on a human,
one that 5 mm of noise turn by a radian."""

PART = 0.3
"""Share of a hidden direction from which a coordinate is hidden with it."""

LEAST = 0.1
"""Share of the frames in which a coordinate may be hidden without a word, as markers are for moments at a time."""

ALIKE = 0.5
"""Share of their frames that two coordinates have in common to be named together."""

CHUNK = 128
"""Frames whose slopes are held at once."""


def hidden_findings(model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem) -> tuple[Finding, ...]:
    """Frames whose markers do not show where the body is, which become gaps, and what is hidden in part of the frames.
    Models with loops are not looked at: what ties determine, slopes of single markers do not know.
    """
    if model.loops or not fit.seen.any():
        return ()
    hidden = _hidden(model, markers, fit, problem)
    names = [model.coordinate_names[j] for j in problem.free]
    floating = set(floating_coordinates(model))
    root = [i for i, name in enumerate(names) if name in floating]
    lost = hidden[:, root].any(axis=1) & fit.seen
    if lost.all():
        return ()
    kept = fit.seen & ~lost
    partly = hidden & kept[:, None]
    partly[:, root] = False
    return (*_lost(fit, lost), *_partly(fit, names, partly, int(kept.sum())))


def _without(fit: KinematicsFit, lost: np.ndarray) -> KinematicsFit:
    """The fit with gaps in some frames."""
    values, errors, converged = np.array(fit.motion.values), np.array(fit.errors), np.array(fit.converged)
    values[lost], errors[lost], converged[lost] = np.nan, np.nan, False
    return replace(fit, motion=replace(fit.motion, values=values), errors=errors, converged=converged)


def _hidden(model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem) -> np.ndarray:
    """(frames, variables) whether a coordinate is hidden that the frames with most markers show."""
    seen = np.isfinite(fit.errors)
    masks, first, group = np.unique(seen, axis=0, return_index=True, return_inverse=True)
    columns = [markers.names.index(name) for name in fit.marker_names]
    tree = compile_tree(model)
    hidden = np.zeros((len(masks), len(problem.free)), bool)
    some = masks.any(axis=1)
    most = int(np.argmax(masks.sum(axis=1)))
    usual = None
    for chunk in np.array_split(np.r_[most, np.flatnonzero(some)], 1 + some.sum() // CHUNK):
        frames = first[chunk]
        influence = marker_frames(tree, problem, markers.values[frames][:, columns], fit.motion.values[frames])
        for index, mask in enumerate(chunk):
            sizes, parts = _sizes(influence, index, masks[mask])
            usual = float(np.median(sizes[sizes > 1e-12 * sizes[-1]])) if usual is None else usual
            faint = parts[:, sizes < FAINT**2 * usual]
            hidden[mask] = (np.abs(faint).max(axis=1, initial=0.0) > PART) & ~influence.held[index]
    result: np.ndarray = (hidden & ~hidden[most])[np.ravel(group)]
    result[:, problem.coordinates.weight[problem.free] > 0.0] = False
    return result & fit.seen[:, None]


def _sizes(marker_frames: MarkerFrames, frame: int, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared movement of the seen markers for directions of the coordinates, from the least, and the directions."""
    rows = marker_frames.slopes[frame, mask].reshape(-1, marker_frames.slopes.shape[-1])
    sizes, parts = np.linalg.eigh(rows.T @ rows)
    return sizes, parts


def _lost(fit: KinematicsFit, lost: np.ndarray) -> Iterator[Finding]:
    """The frames that show too few markers to determine where the body is."""
    if not lost.any():
        return
    spans = spans_of(fit.motion.time, lost)
    fewest = int(np.isfinite(fit.errors[lost]).sum(axis=1).min())
    text = (
        f"{int(lost.sum())} of {len(lost)} frames show too few markers to determine where the body is (as few as "
        f"{fewest} of {len(fit.marker_names)}, first at {spans[0][0]:.2f} s)"
    )
    repair = Repair(partial(_without, lost=lost), "left empty", "poses there are guesses")
    yield Finding("hidden frames", "frames", text, spans, repair=repair)


def _partly(fit: KinematicsFit, names: list[str], hidden: np.ndarray, frames: int) -> Iterator[Finding]:
    """Coordinates that no marker shows in more than a tenth of the frames, those of nearly the same frames together."""
    together: list[list[int]] = []
    for i in map(int, np.flatnonzero(hidden.sum(axis=0) > LEAST * frames)):
        alike = (group for group in together if _overlap(hidden[:, group[0]], hidden[:, i]) > ALIKE)
        group = next(alike, None)
        if group is None:
            together.append([i])
        else:
            group.append(i)
    for members in together:
        when = np.asarray(hidden[:, members].any(axis=1))
        spans = spans_of(fit.motion.time, when)
        which = [names[i] for i in members]
        text = (
            f"in {int(when.sum())} of {frames} frames no marker shows {quoted(which)}, first from {spans[0][0]:.2f} to "
            f"{spans[0][1]:.2f} s: values there are guesses near the default"
        )
        yield Finding("hidden in part", ", ".join(which), text, spans)


def _overlap(first: np.ndarray, other: np.ndarray) -> float:
    """Share of the frames of either that both have."""
    return float((first & other).sum() / max(int((first | other).sum()), 1))

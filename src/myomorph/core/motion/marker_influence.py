"""Influence of each marker: where all others would put it, and what no marker shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import HIDDEN, MARKERS
from myomorph.core.model.errors import quoted
from myomorph.core.model.findings import Finding, Repair, spans_of
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.model.severity import severity_of_share
from myomorph.core.model.sides import mirror_names
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.marker_frames import MarkerFrames, marker_frames
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.tree import compile_tree

# A direction of a marker of which the others determine a smaller share has no prediction
UNKNOWN = 0.15
# A direction of the coordinates that moves the markers by a smaller share of the usual is not
# determined
BLIND = 1e-5


def left_out(marker_frames: MarkerFrames, weight: Array) -> Array:
    """Measure how far each marker lies from where all others would put it.

    With e the marker's error and its weighted slopes as rows of an orthonormal basis B, its
    leverage is h = B B^T (3, 3), and the error without it

        (1 - h)^-1 e

    without the directions that the others hardly determine.

    Parameters
    ----------
    marker_frames : errors and slopes
    weight : (markers,)

    Returns
    -------
    (frames, markers, 3) in the frame of the marker's body [m]; NaN where a marker is unseen, or
    fewer than two of its directions are determined
    """
    frames, markers = marker_frames.errors.shape[:2]
    result = np.full((frames, markers, 3), np.nan)
    for f in range(frames):
        seen = np.flatnonzero(np.isfinite(marker_frames.errors[f]).all(axis=1) & (weight > 0.0))
        if len(seen) < 2:
            continue
        scale = np.sqrt(weight[seen])[:, None, None]
        rows = (marker_frames.slopes[f, seen] * scale).reshape(3 * len(seen), -1)
        basis, sizes, _ = np.linalg.svd(rows, full_matrices=False)
        basis = basis[:, sizes > 1e-6 * sizes.max(initial=0.0)].reshape(len(seen), 3, -1)
        rest = np.eye(3) - np.einsum("mik,mjk->mij", basis, basis)
        eigenvalues, axes = np.linalg.eigh(rest)
        inverse = np.where(eigenvalues > UNKNOWN, 1.0 / np.maximum(eigenvalues, UNKNOWN), 0.0)
        away = np.einsum("mij,mj,mkj,mk->mi", axes, inverse, axes, marker_frames.errors[f, seen])
        away[(eigenvalues <= UNKNOWN).sum(axis=1) > 1] = np.nan
        result[f, seen] = np.einsum("mji,mj->mi", marker_frames.rotations[f, seen], away)
    return result


def undetermined(
    marker_frames: MarkerFrames, problem: PoseProblem, weight: Array
) -> tuple[int, ...]:
    """Find coordinates that take part in a motion that no marker of any of the frames shows.

    Of the sum of J^T J over seen markers, with slopes J, such motions have an eigenvalue below
    1e-10 of the median. A variable that lies at its bound in all frames is determined by the bound.

    Parameters
    ----------
    marker_frames : errors and slopes
    problem : with the free coordinates
    weight : (markers,)

    Returns
    -------
    numbers of the coordinates, without those that a task draws
    """
    seen = np.isfinite(marker_frames.errors).all(axis=2) & (weight > 0.0)
    rows = marker_frames.slopes[seen].reshape(-1, len(problem.free))
    sizes, directions = np.linalg.eigh(rows.T @ rows)
    usual = np.median(sizes[sizes > 0.0]) if (sizes > 0.0).any() else 1.0
    blind = directions[:, sizes < BLIND**2 * usual]
    part = np.abs(blind).max(axis=1, initial=0.0)
    # A variable at its bound in all frames is determined by the bound.
    blind_variables = [
        i for i in range(len(problem.free)) if part[i] > 0.3 and not marker_frames.held[:, i].all()
    ]
    return tuple(
        int(problem.free[i])
        for i in blind_variables
        if problem.coordinates.weight[problem.free[i]] == 0.0
    )


# Distance from where all others put a marker, from which it is displaced, on a human body [m]
OFF = 0.035
USUAL = 4.0
"""That distance is at least so many times that of the median marker: on a generic model all lie off
their places.
"""

MIDDLE = 0.055
"""The same of a marker without one on the other side to compare with: sacral markers are often 4 cm
off [m].
"""

# Largest share that may change over time: skin and a wrong joint move a marker to and fro
STEADY = 0.6
# A marker of the other side that is as far off by this share shows that the model, not the marker,
# is off
ALIKE = 0.5
MAX_COUNT = 4
SAMPLES = 20


def place_findings(
    model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem, unit: float
) -> Iterator[Finding]:
    """Find markers that lie steadily off where all others put them, while those opposite do not.

    Parameters
    ----------
    model : that was fitted
    markers : as used (frames, markers, 3) [m], NaN where hidden
    fit : of inverse kinematics
    problem : of the fit
    unit : what stands for one metre, see `length_unit` [m]

    Yields
    ------
    a finding for each marker, the farthest first
    """
    seen = np.flatnonzero(fit.seen)
    if len(seen) < 3 or len(fit.marker_names) < 6:
        return
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, SAMPLES).astype(int))]
    columns = [markers.names.index(name) for name in fit.marker_names]
    frames = marker_frames(
        compile_tree(model), problem, markers.values[chosen][:, columns], fit.motion.values[chosen]
    )
    weight = np.array(problem.markers.weight, np.float64)
    partner = mirror_names(fit.marker_names)
    for _ in range(MAX_COUNT):
        displaced = _most_displaced(frames, weight, unit)
        if displaced is None:
            return
        name = fit.marker_names[displaced.marker]
        # What the others say of the next is clearer without this one.
        weight[displaced.marker] = 0.0
        other = fit.marker_names.index(partner[name]) if name in partner else -1
        if other >= 0 and displaced.distances[other] > ALIKE * displaced.distance:
            weight[other] = 0.0
            continue
        unsteady = displaced.spread > STEADY * displaced.distance
        if unsteady or (other < 0 and displaced.distance < MIDDLE * unit):
            continue
        beside = ""
        if other >= 0:
            beside = f", '{partner[name]}' {100 * displaced.distances[other]:.1f} cm"
        text = MARKERS.message(
            f"marker '{name}' lies {100 * displaced.distance:.1f} cm from where all others put it"
            f" on '{model.marker(name).body}' (median of all {100 * displaced.median:.1f}"
            f" cm{beside}): was it moved, or placed elsewhere than on the model? Leave it out"
            " (weight 0 in --tasks, or an empty name in --labels) or calibrate the model",
            size=100.0 * displaced.distance,
        )
        yield Finding("displaced marker", name, text)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Displaced:
    """The marker that lies farthest from where all others put it.

    Attributes
    ----------
    marker : number of it
    distances : (markers,) of all from where the others put them, means over frames [m]
    spread : root mean square of what changes of its distance [m]
    median : of the distances of all that count [m]
    """

    marker: int
    distances: Array
    spread: float
    median: float

    @property
    def distance(self) -> float:
        """Distance of the marker [m]."""
        return float(self.distances[self.marker])


def _most_displaced(frames: MarkerFrames, weight: Array, unit: float) -> _Displaced | None:
    """Find the marker that lies farthest off; None where all lie near, or few count.

    Parameters
    ----------
    frames : slopes of the markers
    weight : (markers,) 0 for those that do not count
    unit : what stands for one metre [m]
    """
    away, spread = _steady(left_out(frames, weight))
    distances = np.linalg.norm(away, axis=1)
    compared = np.isfinite(distances) & (weight > 0.0)
    if compared.sum() < 6:
        return None
    median = float(np.median(distances[compared]))
    worst = next(int(i) for i in np.argsort(-np.nan_to_num(distances)) if compared[i])
    if distances[worst] < max(OFF * unit, USUAL * median):
        return None
    return _Displaced(marker=worst, distances=distances, spread=float(spread[worst]), median=median)


def _steady(away: Array) -> tuple[Array, Array]:
    """Separate the mean over frames from what changes.

    Parameters
    ----------
    away : (frames, markers, 3) [m], NaN where unknown

    Returns
    -------
    mean (markers, 3) [m], NaN where known in less than half of the frames, and root mean square of
    what changes (markers,) [m]
    """
    known: np.ndarray = np.asarray(np.isfinite(away).all(axis=2))
    count = known.sum(axis=0)
    some = np.where(known[:, :, None], away, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = some.sum(axis=0) / count[:, None]
        square = (np.where(known[:, :, None], away - mean, 0.0) ** 2).sum(axis=(0, 2)) / count
    mean[count < 0.5 * len(away)] = np.nan
    return mean, np.sqrt(square)


FAINT = 0.01
"""A direction of the coordinates that moves the seen markers by a smaller share of the usual is not
shown: on a human, one that 5 mm of noise turn by a radian.
"""

PART = 0.3  # Share of a hidden direction from which a coordinate is hidden with it
LEAST = 0.1
"""Share of the frames in which a coordinate may be hidden without a word, as markers are for
moments at a time.
"""

TOGETHER = 0.5  # Share of their frames that two coordinates have in common to be named together
CHUNK = 128  # Frames whose slopes are held at once


def hidden_findings(
    model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem
) -> tuple[Finding, ...]:
    """Find frames that do not show where the body is, and coordinates hidden in part of the frames.

    The former become gaps. Models with loops are not looked at: what ties determine, slopes of
    single markers do not know.

    Parameters
    ----------
    model : that was fitted
    markers : as used (frames, markers, 3) [m], NaN where hidden
    fit : of inverse kinematics
    problem : of the fit

    Returns
    -------
    findings, the first with a repair of the fit
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
    """Make gaps of some frames (frames,) of a fit."""
    values = np.array(fit.motion.values)
    errors = np.array(fit.marker_error)
    converged = np.array(fit.converged)
    values[lost] = np.nan
    errors[lost] = np.nan
    converged[lost] = False
    return replace(
        fit, motion=replace(fit.motion, values=values), marker_error=errors, converged=converged
    )


def _hidden(model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem) -> np.ndarray:
    """Find coordinates that a frame hides and the frames with most markers show.

    A direction of the coordinates is hidden where it moves the seen markers by less than 1 % of the
    usual, and a coordinate with it from a share of 0.3.

    Parameters
    ----------
    model : that was fitted
    markers : as used (frames, markers, 3) [m], NaN where hidden
    fit : of inverse kinematics
    problem : of the fit

    Returns
    -------
    (frames, variables)
    """
    seen = np.isfinite(fit.marker_error)
    masks, first, group = np.unique(seen, axis=0, return_index=True, return_inverse=True)
    columns = [markers.names.index(name) for name in fit.marker_names]
    tree = compile_tree(model)
    hidden = np.zeros((len(masks), len(problem.free)), bool)
    some = masks.any(axis=1)
    most = int(np.argmax(masks.sum(axis=1)))
    usual = None
    for chunk in np.array_split(np.r_[most, np.flatnonzero(some)], 1 + some.sum() // CHUNK):
        frames = first[chunk]
        influence = marker_frames(
            tree, problem, markers.values[frames][:, columns], fit.motion.values[frames]
        )
        for index, mask in enumerate(chunk):
            slopes = influence.slopes[index, masks[mask]].reshape(-1, len(problem.free))
            shown = _Shown.by(slopes)
            usual = shown.median if usual is None else usual
            hidden[mask] = shown.hidden(usual) & ~influence.held[index]
    result: np.ndarray = (hidden & ~hidden[most])[np.ravel(group)]
    result[:, problem.coordinates.weight[problem.free] > 0.0] = False
    return result & fit.seen[:, None]


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Shown:
    """Directions of the coordinates, by how far they move the visible markers of a frame.

    Attributes
    ----------
    squares : (variables,) squared movements, from the least
    directions : (variables, variables) each a column
    """

    squares: Array
    directions: Array

    @staticmethod
    def by(slopes: Array) -> _Shown:
        """Decompose the slopes of the seen markers (3 markers, variables)."""
        squares, directions = np.linalg.eigh(slopes.T @ slopes)
        return _Shown(squares=squares, directions=directions)

    @property
    def median(self) -> float:
        """Squared movement of the median direction, of those that move markers at all."""
        return float(np.median(self.squares[self.squares > 1e-12 * self.squares[-1]]))

    def hidden(self, usual: float) -> np.ndarray:
        """Flag the coordinates that share in a hidden direction.

        Parameters
        ----------
        usual : squared movement of the usual direction

        Returns
        -------
        (variables,)
        """
        faint = self.directions[:, self.squares < FAINT**2 * usual]
        return np.asarray(np.abs(faint).max(axis=1, initial=0.0) > PART)


def _lost(fit: KinematicsFit, lost: np.ndarray) -> Iterator[Finding]:
    """Report the frames (frames,) that show too few markers to determine where the body is."""
    if not lost.any():
        return
    spans = spans_of(fit.motion.time, lost)
    share = float(lost.mean())
    fewest = int(np.isfinite(fit.marker_error[lost]).sum(axis=1).min())
    text = HIDDEN.message(
        f"{int(lost.sum())} of {len(lost)} frames show too few markers to determine where the body"
        f" is (as few as {fewest} of {len(fit.marker_names)}, first at {spans[0][0]:.2f} s)",
        size=100.0 * share,
        share=share,
        severity=severity_of_share(share, HIDDEN.severity),
    )
    repair = Repair(
        partial(_without, lost=lost), "left empty", "poses there are guesses", cures=False
    )
    yield Finding(kind="hidden frames", place="frames", text=text, times=spans, repair=repair)


def _partly(
    fit: KinematicsFit, names: list[str], hidden: np.ndarray, frames: int
) -> Iterator[Finding]:
    """Report coordinates that no marker shows in more than a tenth of the frames.

    Those of nearly the same frames are reported together.

    Parameters
    ----------
    fit : of inverse kinematics
    names : (variables,) of the free coordinates
    hidden : (frames, variables)
    frames : number of frames that are kept
    """
    together: list[list[int]] = []
    for i in map(int, np.flatnonzero(hidden.sum(axis=0) > LEAST * frames)):
        alike = (
            group for group in together if _overlap(hidden[:, group[0]], hidden[:, i]) > TOGETHER
        )
        group = next(alike, None)
        if group is None:
            together.append([i])
        else:
            group.append(i)
    guess = "guesses near the default"
    if fit.assumed_as:
        guess = "bridged from before and after, and guesses in long gaps"
    for members in together:
        when = np.asarray(hidden[:, members].any(axis=1))
        spans = spans_of(fit.motion.time, when)
        which = [names[i] for i in members]
        share = float(when.sum()) / frames
        text = HIDDEN.message(
            f"in {int(when.sum())} of {frames} frames no marker shows {quoted(which)}, first from"
            f" {spans[0][0]:.2f} to {spans[0][1]:.2f} s: values there are {guess}",
            size=100.0 * share,
            share=share,
            severity=severity_of_share(share, HIDDEN.severity),
        )
        yield Finding(kind="hidden in part", place=", ".join(which), text=text, times=spans)


def _overlap(first: np.ndarray, other: np.ndarray) -> float:
    """Compute the share of the frames (frames,) of either that both have."""
    return float((first & other).sum() / max(int((first | other).sum()), 1))

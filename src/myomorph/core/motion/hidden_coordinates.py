"""Coordinates that the markers of a frame do not determine, from the slopes of the markers seen."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.marker_frames import STEP, nudged_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.tree import Tree

FAINT = 0.01
"""A direction of the coordinates that moves the seen markers by a smaller share of the usual is
hidden: on a human, one that 5 mm of noise turn by a radian.
"""
WEAK = 0.03
"""While markers are hidden, a direction that moves those left by less is hidden with them: a marker
that skin moves by 1 cm beside a joint whose angle is known to 0.3 rad beforehand [m/rad].
"""
PART = 0.3  # Share of hidden directions from which a coordinate is hidden with them
SAMPLES = 2  # Frames with the same markers whose slopes are looked at
AT_ONCE = 128  # Frames whose slopes are held at once


@read_only
class Hidden:
    """What markers do not determine.

    Attributes
    ----------
    flags : (frames, variables) whether a coordinate is hidden in a frame
    always : (variables,) whether it is hidden in the frames with most markers
    lost : (frames,) whether the markers do not show where the body is, or none is seen
    whole : (frames,) whether as many markers are seen as ever together
    groups : (frames,) number of the set of markers seen
    faint, weak : movement of the markers below which a direction is hidden, always and while
        markers are hidden that are seen else [m]
    """

    flags: np.ndarray
    always: np.ndarray
    lost: np.ndarray
    whole: np.ndarray
    groups: Ints
    faint: float
    weak: float


def seen_markers(problem: PoseProblem) -> np.ndarray:
    """Find the markers that count in each frame.

    Parameters
    ----------
    problem : with the markers

    Returns
    -------
    (frames, markers)
    """
    markers = problem.markers
    return np.asarray(np.isfinite(markers.observed).all(axis=2) & (markers.weight > 0.0))


def hidden_coordinates(
    tree: Tree, problem: PoseProblem, values: Array, root: np.ndarray, unit: float
) -> Hidden:
    """Find the coordinates that the markers of each frame do not determine.

    With J the slopes of the seen markers in the coordinates, in their units, and W the weights,
    direction v moves the markers by |W^(1/2) J v|. It is hidden where this is less than a limit,
    and a coordinate where its share of the hidden directions, the length of its axis' projection
    on them, is more than `PART`. The limit is `FAINT` of the usual; while markers are hidden that
    are seen else, `WEAK`, where all markers together move by more: a forearm that two markers at
    the wrist show is not hidden because one of the thigh is. Coordinates that a task pulls at are
    determined.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames
    values : (frames, coordinates) poses [rad or m], NaN where no marker is seen
    root : (variables,) which variables move the whole body
    unit : what stands for one metre, see `length_unit` [m]

    Returns
    -------
    flags by frame
    """
    seen = seen_markers(problem)
    known = np.asarray(np.isfinite(values).all(axis=1) & seen.any(axis=1))
    sets, groups = _marker_sets(seen)
    most = _fullest(sets, groups, known)
    usual = _information(tree, problem, values, _samples(groups, known, [most]))[0]
    faint = FAINT * _median_movement(usual)
    weak = max(WEAK * unit, faint)
    pulled = problem.coordinates.weight[problem.free] > 0.0
    always = hidden_by(usual, faint) & ~pulled

    whole = np.asarray(sets.sum(axis=1) == sets[most].sum())
    # By set: what its markers hide whatever is known, and while others are hidden.
    blind = always[None]
    flags = always[None]
    if len(sets) > 1:
        hidden = partial(
            _hidden_in_sets, tree, problem, values, _samples(groups, known, range(len(sets)))
        )
        limits = np.array([np.full(len(sets), faint), np.where(whole, faint, weak)])
        blind, flags = hidden(limits) & ~pulled
        # A hidden marker hides only what it would show.
        flags = blind | (flags & ~hidden(limits[1:], np.any(seen, axis=0))[0])
    return Hidden(
        flags=flags[groups] & known[:, None],
        always=always,
        lost=((blind & root & ~always).any(axis=1) | ~sets.any(axis=1))[groups] | ~known,
        whole=whole[groups] & known,
        groups=groups,
        faint=faint,
        weak=weak,
    )


def _hidden_in_sets(
    tree: Tree,
    problem: PoseProblem,
    values: Array,
    samples: list[Ints],
    limits: Array,
    seen: np.ndarray | None = None,
) -> np.ndarray:
    """Find the coordinates that sets of markers hide.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames
    values : (frames, coordinates) [rad or m]
    samples : frames of each set
    limits : (limits, sets) movement of the markers below which a direction is hidden [m]
    seen : (markers,) that are taken for seen in all of them; None for those of each set

    Returns
    -------
    (limits, sets, variables)
    """
    if seen is not None:
        observed = np.broadcast_to(
            np.where(seen[:, None], 0.0, np.nan), problem.markers.observed.shape
        )
        problem = problem.with_markers(observed=observed)
    hidden = np.zeros((*limits.shape, len(problem.free)), bool)
    for start in range(0, len(samples), AT_ONCE):
        each = _information(tree, problem, values, samples[start : start + AT_ONCE])
        for number, information in enumerate(each, start):
            hidden[:, number] = [hidden_by(information, limit) for limit in limits[:, number]]
    return hidden


def _marker_sets(seen: np.ndarray) -> tuple[np.ndarray, Ints]:
    """Find the different sets of markers that are seen together.

    Parameters
    ----------
    seen : (frames, markers)

    Returns
    -------
    (sets, markers), and (frames,) the number of each frame's set
    """
    if (seen == seen[0]).all():
        return seen[:1], np.zeros(len(seen), np.int64)
    packed = np.packbits(seen, axis=1)
    _, first, groups = np.unique(packed, axis=0, return_index=True, return_inverse=True)
    return seen[first], np.ravel(groups).astype(np.int64)


def _fullest(sets: np.ndarray, groups: Ints, known: np.ndarray) -> int:
    """Find the set with most markers, of those with as many that of most frames."""
    frames = np.bincount(groups[known], minlength=len(sets))
    counts = np.where(frames > 0, sets.sum(axis=1), -1)
    return int(np.lexsort((frames, counts))[-1])


def _samples(groups: Ints, known: np.ndarray, numbers: Iterable[int]) -> list[Ints]:
    """Choose at most `SAMPLES` frames of each set."""
    samples = []
    for number in numbers:
        frames = np.flatnonzero((groups == number) & known)
        chosen = np.unique(np.linspace(0, max(len(frames) - 1, 0), SAMPLES).astype(int))
        samples.append(frames[chosen] if len(frames) else frames)
    return samples


def informations(tree: Tree, problem: PoseProblem, values: Array, observed: Array) -> Array:
    """Compute J^T W J of the markers seen in each frame, in units of the coordinates.

    Bounds do not count: a coordinate at a bound moves markers or none.

    Parameters
    ----------
    tree : the compiled model
    problem : with markers and coordinates
    values : (frames, coordinates) poses [rad or m]
    observed : (frames, markers, 3) where markers were seen, NaN where hidden [m]

    Returns
    -------
    (frames, variables, variables), the largest weight counting 1 [m^2]
    """
    markers = problem.markers
    weight = markers.weight / max(float(markers.weight.max(initial=0.0)), 1e-300)
    poses, _ = nudged_poses(tree, problem, values)
    points = poses.points(markers.body, markers.location)
    points = points.reshape(len(values), len(problem.free) + 1, -1, 3)
    slopes = (points[:, 1:] - points[:, :1]) / STEP * np.sqrt(weight)[:, None]
    seen: np.ndarray = np.asarray(np.isfinite(observed).all(axis=2))
    slopes *= seen[:, None, :, None]
    rows = slopes.reshape(len(values), len(problem.free), -1)
    return np.asarray(rows @ np.swapaxes(rows, 1, 2))


def _information(
    tree: Tree, problem: PoseProblem, values: Array, samples: list[Ints]
) -> list[Array]:
    """Mean of `informations` over some frames of each set, (variables, variables) of each [m^2]."""
    frames = np.concatenate(samples)
    each = informations(tree, problem, values[frames], problem.markers.observed[frames])
    ends = np.cumsum([len(sample) for sample in samples])[:-1]
    return [part.sum(axis=0) / max(len(part), 1) for part in np.split(each, ends)]


def _median_movement(information: Array) -> float:
    """Movement of the markers by the median direction, of those that move markers at all [m]."""
    squares = np.linalg.eigvalsh(information)
    moving = squares[np.flatnonzero(squares > 1e-12 * squares.max(initial=0.0))]
    return float(np.sqrt(np.median(moving))) if len(moving) else 1.0


def hidden_by(information: Array, limit: float) -> np.ndarray:
    """Flag the coordinates that share in directions which move markers by less than a limit.

    Parameters
    ----------
    information : (variables, variables) [m^2]
    limit : [m]

    Returns
    -------
    (variables,)
    """
    squares, directions = np.linalg.eigh(information)
    hidden = directions[:, np.flatnonzero(squares < limit**2)]
    return np.asarray(np.sqrt((hidden**2).sum(axis=1)) > PART)


def along_hidden(information: Array, change: Array, limit: Array) -> Array:
    """Take the part of a change of the coordinates that hardly moves the seen markers.

    Parameters
    ----------
    information : (frames, variables, variables) [m^2]
    change : (frames, variables) in units
    limit : (frames,) movement of the markers below which a direction is hidden [m]

    Returns
    -------
    (frames, variables) in units
    """
    squares, directions = np.linalg.eigh(information)
    shares = np.einsum("fvd,fv->fd", directions, change)
    return np.einsum("fvd,fd->fv", directions, np.where(squares < limit[:, None] ** 2, shares, 0.0))

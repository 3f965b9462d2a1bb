"""Prior knowledge of lengths, marker positions, differing sides and the mean posture.

Also which frames show most of a body before anything else is known.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.body.calibrate.calibration import CalibrationOptions, Distances, SideEstimate
from myomorph.body.calibrate.shared_problem import BLOCKS, MeanPosture
from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.model.sides import mirror_names
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.lengths import (
    Length,
    joint_centers,
    length_unit,
    mirrored_lengths,
)
from myomorph.core.motion.starts import closed_defaults, root_coordinates
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import ROTATION, Tree, compile_tree

CANDIDATES = 1000  # At most so many frames of all recordings are looked at
SAME_POSTURE = 0.01
"""Frames whose markers lie nearer to each other than this, root mean square, show the same posture
[length units].
"""


def spread_postures(
    model: Model,
    trials: Sequence[Markers],
    options: InverseKinematicsOptions,
    frames: int,
    static: bool = False,
) -> tuple[tuple[Ints, Array], ...]:
    """Choose the frames of all recordings whose postures differ most.

    A posture is where the model's markers lie relative to its first body, after inverse kinematics.
    The first frame is the one nearest to the mean posture, of a last recording that is `static` if
    there is one. Then follows the frame farthest from all those chosen, until none differs by
    `SAME_POSTURE`: a second frame of a posture shows the same skin and the same errors of the
    model, so it must not count as evidence. Frames that fit three times worse than usual or show
    fewer than half the markers are not chosen. Of long recordings only `CANDIDATES` frames, evenly
    spaced, are considered.

    Parameters
    ----------
    model : of about the body's size
    trials : recordings, a static one last
    options : of inverse kinematics
    frames : at most so many are chosen
    static : whether the last recording is a static trial

    Returns
    -------
    for each recording the chosen frames (chosen,), ascending, and the coordinates in them (chosen,
        coordinates) [rad or m]
    """
    total = sum(len(trial) for trial in trials)
    stride = max(1, -(-total // max(CANDIDATES, 2 * frames)))
    tree = compile_tree(model)
    looked = []
    coordinates = []
    places = []
    misfit = []
    shown = []
    for number, trial in enumerate(trials):
        every = np.arange(0, len(trial), stride)
        fit = inverse_kinematics(model, trial.frames(every), options)
        values = fit.motion.values
        seen = np.isfinite(values).all(axis=1)
        looked += [(number, int(frame)) for frame in every[seen]]
        coordinates.append(values[seen])
        places.append(_seen_from_base(model, values[seen]))
        misfit.append(fit.rms[seen])
        shown.append(np.isfinite(fit.marker_error[seen]).sum(axis=1))
    table = np.concatenate(places)
    error = np.concatenate(misfit)
    count = np.concatenate(shown)
    good = (error <= 3.0 * np.median(error)) & (count >= 0.5 * count.max())
    usable = np.flatnonzero(good)
    still = np.array([looked[place][0] == len(trials) - 1 for place in usable])
    first = still if static and still.any() else np.ones(len(usable), np.bool_)
    chosen = _farthest(table, usable, frames, first, SAME_POSTURE * length_unit(tree))
    q = np.concatenate(coordinates)
    taken = []
    for number in range(len(trials)):
        rows = [place for place in sorted(chosen) if looked[place][0] == number]
        taken.append(
            (
                np.array([looked[row][1] for row in rows], np.int64),
                q[rows].reshape(-1, len(tree.defaults)),
            )
        )
    return tuple(taken)


def _seen_from_base(model: Model, values: Array) -> Array:
    """Express the model's markers in the frame of its first body.

    Parameters
    ----------
    values : (frames, coordinates) [rad or m]

    Returns
    -------
    (frames, 3 markers) positions [m]
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    local = np.einsum(
        "fji,fmj->fmi",
        poses.rotations[:, 1],
        poses.markers(model.markers) - poses.origins[:, 1, None],
    )
    return local.reshape(len(values), -1)


def _farthest(
    table: Array, usable: Ints, count: int, first: NDArray[np.bool_], same: float
) -> list[int]:
    """Choose rows that each lie as far as possible from those chosen before.

    Parameters
    ----------
    table : (candidates, 3 markers) positions [m]
    usable : rows that may be chosen
    count : at most so many are chosen
    first : (usable,) those among which the first is chosen
    same : distance below which two rows are the same posture [m RMS]

    Returns
    -------
    rows of the table, in the order of choice
    """
    points = table[usable]
    least = same**2 * table.shape[1] / 3.0
    middle = ((points - points[first].mean(axis=0)) ** 2).sum(axis=1)
    chosen = [int(np.argmin(np.where(first, middle, np.inf)))]
    nearest = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < count and nearest.max() > least:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    return [int(usable[place]) for place in chosen]


# Of the difference of two sides that the data show to differ, as a share of the length
ASYMMETRIC_SD = 0.1
# Of pairs of lengths that differ so: the odds at which the data must show it
ASYMMETRIC_SHARE = 0.1


def usual_shifts(model: Model, names: Sequence[str], distances: Distances) -> Array:
    """Look up how far each marker usually lies from its position on the model.

    Parameters
    ----------
    model : says which markers are fixed, as on bony landmarks
    names : of the markers
    distances : of fixed and of other markers [m]

    Returns
    -------
    (markers,) standard deviation along one axis [m]
    """
    return np.array(
        [distances.fixed if model.marker(name).fixed else distances.marker for name in names]
    )


def calibration_prior(
    lengths: Sequence[Length],
    shift_sd: Array,
    options: CalibrationOptions,
    size: float,
    differing: Collection[tuple[str, str]] = (),
) -> LinearPrior:
    """Build the prior over lengths, shifts and overall size.

    Parameters
    ----------
    lengths : whose factors are the first unknowns
    shift_sd : (markers,) standard deviation of each marker's shift along one axis [m]
    options : standard deviations of lengths, of stretch across, and of differences between sides
    size : overall size, whose standard deviation is 0.5
    differing : names of pairs of lengths whose sides are not held alike

    Returns
    -------
    rows over (lengths, 3 markers, size), each of unit standard deviation
    """
    n = len(lengths)
    shifts = 3 * len(shift_sd)
    main = {length.segment: i for i, length in enumerate(lengths) if length.along}
    rows = []
    right = []

    def add(entries: Mapping[int, float], value: float, sd: float) -> None:
        row = np.zeros(n + shifts + 1)
        for i, factor in entries.items():
            row[i] += factor / sd
        rows.append(row)
        right.append(value / sd)

    add({n + shifts: 1.0}, size, 0.5)
    for i, length in enumerate(lengths):
        if length.along:
            add({i: 1.0, n + shifts: -1.0}, 0.0, options.length_sd)
        else:
            add({i: 1.0, main[length.segment]: -1.0}, 0.0, options.shape_sd)
    for i in range(shifts):
        add({n + i: 1.0}, 0.0, float(shift_sd[i // 3]))
    for i, j in mirrored_lengths(lengths):
        sd = ASYMMETRIC_SD if (lengths[i].name, lengths[j].name) in differing else options.side_sd
        add({i: 1.0, j: -1.0}, 0.0, sd)
    return LinearPrior(
        name="usual bodies", blocks=BLOCKS, rows=np.array(rows), right=np.array(right)
    )


def side_differences(
    lengths: Sequence[Length], x: Array, H: Array, prior: LinearPrior, options: CalibrationOptions
) -> tuple[SideEstimate, ...]:
    """Find pairs of lengths whose sides differ more than `side_sd` explains.

    Of two Gaussian priors on a difference, narrow (`side_sd`) and wide (`ASYMMETRIC_SD`), the one
    is taken that makes the data likelier, at odds of `ASYMMETRIC_SHARE`: pair after pair, the most
    telling first. The evidence is that of the differences without a prior on sides, about the
    minimum x.

    Parameters
    ----------
    lengths : of the model; only those from joint to joint are compared
    x : (unknowns,) at the minimum
    H : (unknowns, unknowns) information of the data alone [1/variance]
    prior : whose last rows are those of the sides
    options : with `side_sd`

    Returns
    -------
    one for each pair from joint to joint
    """
    pairs = mirrored_lengths(lengths)
    names = [(lengths[i].name, lengths[j].name) for i, j in pairs]
    along = [
        pair for pair, (i, j) in enumerate(pairs) if lengths[i].along and lengths[i].between_joints
    ]
    if not along:
        return ()
    sides = len(prior.rows) - len(pairs) + np.array(along)
    rest = np.setdiff1d(np.arange(len(prior.rows)), sides)
    rows = prior.rows[rest]
    information = H + rows.T @ rows
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    covariance = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(
        scale, scale
    )
    # At the minimum the data and the rest pull against the rows of sides: without these it lies one
    # step away.
    pull = prior.rows[sides].T @ (prior.rows[sides] @ x - prior.right[sides])
    freed = x + covariance @ pull
    D = np.zeros((len(along), len(x)))
    for row, pair in enumerate(along):
        D[row, pairs[pair][0]] = 1.0
        D[row, pairs[pair][1]] = -1.0
    seen = D @ freed
    spread = D @ covariance @ D.T
    sd = np.full(len(along), options.side_sd)
    gains = np.full(len(along), -np.inf)
    wide_sd = max(ASYMMETRIC_SD, options.side_sd)
    for _ in along:
        # Where one length differs, others of the same limb are as likely to.
        share = 0.5 if (sd >= wide_sd).any() else ASYMMETRIC_SHARE
        odds = float(np.log(share / (1.0 - share)))
        now = _log_evidence(seen, spread, sd)
        for difference in map(int, np.flatnonzero(sd < wide_sd)):
            wide = sd.copy()
            wide[difference] = wide_sd
            gains[difference] = _log_evidence(seen, spread, wide) - now + odds
        best = int(np.argmax(np.where(sd < wide_sd, gains, -np.inf)))
        if sd[best] >= wide_sd or gains[best] <= 0.0:
            break
        sd[best] = wide_sd
    return tuple(
        SideEstimate(
            *names[pair],
            float(seen[row]),
            float(np.sqrt(spread[row, row])),
            bool(sd[row] > options.side_sd),
        )
        for row, pair in enumerate(along)
    )


def _log_evidence(seen: Array, spread: Array, sd: Array) -> float:
    """Compute the log evidence of differences, without its constant.

    Parameters
    ----------
    seen : (pairs,) differences
    spread : (pairs, pairs) their covariance from the data
    sd : (pairs,) standard deviation by which the true differences vary
    """
    total = spread + np.diag(sd**2)
    return -0.5 * float(np.linalg.slogdet(total)[1] + seen @ np.linalg.solve(total, seen))


ALONG = 0.9  # Cosine from which two axes of rotation are the same one
MAX_UNEVEN = 0.25  # Postures that both sides pass so unevenly say nothing of the mean [rad]


def symmetric_posture(
    tree: Tree, free: Ints, angles: Sequence[Array], sd: float
) -> MeanPosture | None:
    """Build rows that hold the mean posture symmetric.

    They are right less left, and what bends or rotates the trunk to one side. How evenly a
    recording shows both sides is measured by what an offset does not change: the distances of the
    mean from the smallest and the largest angle. Where they differ, the row counts less, and beyond
    `MAX_UNEVEN` not at all. Joints to the ground have no rows.

    Parameters
    ----------
    tree : of the model
    free : (free,) coordinates that are solved for
    angles : of each recording (frames, coordinates) [rad or m]
    sd : standard deviation of a row [rad]

    Returns
    -------
    rows over the means of all coordinates; None where the model has no sides or no row is left
    """
    names = [coordinate.name for coordinate in tree.model.coordinates]
    every = np.concatenate(angles)
    axes = _axes(tree)
    lateral = _lateral(tree)
    if lateral is None or len(every) == 0:
        return None
    root = set(root_coordinates(tree))
    mirror = mirror_names(names)
    conditions: list[tuple[str, Array, float]] = []
    for j in (int(coordinate) for coordinate in free):
        if j in root or j not in axes:
            continue
        row = np.zeros(len(names))
        row[j] = 1.0
        other = names.index(mirror[names[j]]) if names[j] in mirror else None
        if other is None:
            if abs(axes[j] @ lateral) > 1.0 - ALONG:
                continue
            text = names[j]
            uneven = _uneven(every[:, j], -every[:, j])
        else:
            if other < j or other not in axes or other not in free:
                continue
            # Mirrored, an axis of rotation keeps its part along the normal of the mirror.
            alike = float(axes[other] @ (2.0 * (axes[j] @ lateral) * lateral - axes[j]))
            if abs(alike) < ALONG:
                continue
            row[other] = -np.sign(alike)
            text = f"{names[j]} {'-' if alike > 0 else '+'} {names[other]}"
            uneven = _uneven(every[:, j], np.sign(alike) * every[:, other])
        if uneven <= MAX_UNEVEN:
            conditions.append((text, row, float(np.hypot(sd, uneven))))
    if not conditions:
        return None
    spread = np.array([coordinate for _, _, coordinate in conditions])
    rows = np.array([row for _, row, _ in conditions]) / spread[:, None]
    return MeanPosture(
        names=tuple(text for text, _, _ in conditions),
        rows=rows,
        right=np.zeros(len(conditions)),
        sd=spread,
    )


def _uneven(angle: Array, other: Array) -> float:
    """Bound how much the means of two angles may differ because other postures were recorded.

    Parameters
    ----------
    angle, other : (frames,) [rad]

    Returns
    -------
    largest difference of the means' distances from the smallest and the largest angle [rad]
    """
    low = abs((angle.mean() - angle.min()) - (other.mean() - other.min()))
    high = abs((angle.max() - angle.mean()) - (other.max() - other.mean()))
    return float(max(low, high))


def _axes(tree: Tree) -> Mapping[int, Array]:
    """Find the axis in the default pose of every coordinate that rotates about one axis.

    Returns
    -------
    index of the coordinate to (3,) direction in ground; the first one where there are several
    """
    poses = forward_kinematics(tree, closed_defaults(tree)[None])
    directions_of: dict[int, list[Array]] = {}
    for axis, kind in enumerate(tree.arrays.axis_kind):
        for t, j in enumerate(tree.arrays.axis_coordinate[axis]):
            slope = float(poses.axis_slopes[0, axis, t])
            if kind == ROTATION and j >= 0 and abs(slope) > 1e-9:
                directions_of.setdefault(int(j), []).append(
                    np.sign(slope) * poses.axis_directions[0, axis]
                )
    return {j: directions[0] for j, directions in directions_of.items()}


def _lateral(tree: Tree) -> Array | None:
    """Find the direction from left to right by the joints of both sides in the default pose.

    Returns
    -------
    (3,) unit vector in ground; None without sides
    """
    poses = forward_kinematics(tree, closed_defaults(tree)[None])
    centers = joint_centers(tree, poses.axis_points[0], poses.origins[0])
    mirror = mirror_names(tree.body_index)
    apart = [
        centers[tree.body_index[name]] - centers[tree.body_index[other]]
        for name, other in mirror.items()
        if name < other
    ]
    apart = [
        np.sign(direction @ apart[0]) * direction
        for direction in apart
        if np.linalg.norm(direction) > 1e-6
    ]
    total = np.sum(apart, axis=0) if apart else np.zeros(3)
    size = float(np.linalg.norm(total))
    return total / size if size > 1e-6 else None

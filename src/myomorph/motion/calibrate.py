"""Kinematic identification: the lengths of a body and where its markers sit, from recorded motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from myomorph.model.errors import BadData, listing
from myomorph.model.model import Model, index_of
from myomorph.model.scale import scale
from myomorph.model.series import Markers
from myomorph.model.spatial import Array
from myomorph.motion.calibration import (
    Calibration,
    CalibrationOptions,
    FoundLength,
    FoundMarker,
    root_mean_square,
)
from myomorph.motion.ik import (
    InverseKinematicsOptions,
    coordinate_targets,
    marker_arrays,
    tracked_markers,
)
from myomorph.motion.lengths import Length, factors_of, lengths_of, mirrored_lengths
from myomorph.motion.postures import overall_size, spread_postures
from myomorph.motion.shared_fit import (
    FrameSet,
    Minimum,
    Point,
    Prior,
    SharedProblem,
    minimise,
    place_at_fixed_angles,
    reduce,
    settle,
    settle_anew,
)
from myomorph.motion.starts import root_coordinates
from myomorph.motion.stretch import skeleton, stretch_of
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.tree import compile_tree

__all__ = ["Calibration", "CalibrationOptions", "FoundLength", "FoundMarker", "calibrate"]

Bools = NDArray[np.bool_]

STANDING = ("knee_angle", "ankle_angle", "subtalar", "mtp")
"""What the coordinates' names begin with that stand near their defaults in a static trial."""

FEW_FRAMES = 10
FAR = 0.1
"""A marker farther than this from its place on the model may be another one [m]."""

NOISE_UNKNOWN, NOISE_LEAST, NOISE_AT_FIRST = 0.005, 1e-4, 0.02
"""Of a marker along one axis: where the residual cannot tell it, at least, and of the first stage [m]."""

TAIL = 3.0
"""Degrees of freedom of Student's t, of which shifts of markers are a sample."""


def calibrate(
    model: Model,
    trials: Sequence[Markers],
    options: CalibrationOptions | None = None,
    progress: Callable[[int], None] | None = None,
    path_lengths: Callable[[Model], ArrayLike] | None = None,
) -> Calibration:
    """The lengths of a body and the places of its markers that explain recorded motion best.

    Over frames f, markers m, lengths s, shifts d and angles q_f,

    min sum_fm w_m |x_m(q_f, s, d) - y_fm|^2 / noise^2 + |prior(s, d)|^2,

    where x is linear in (s, d) and the angles, bounded, locked and coupled as in inverse kinematics, are
    eliminated frame by frame. The prior keeps what no marker shows near the given model: every length near
    the overall size, stretch across near that along, right near left, markers near their places. [D] 3.2.1
    step 1 (Ayusawa et al. 2011).

    Parameters
    ----------
    trials : recordings in the model's ground
    progress : called with the number of steps just done; all together `options.iterations`
    path_lengths : lets muscles keep their ratio of fiber to path, as in `scale`

    Raises
    ------
    BadData : no recording shares a marker with the model, or the markers' unit cannot be metres
    UnknownName : an option names a marker or coordinate that does not exist
    """
    options = options or CalibrationOptions()
    _check(options)
    recordings = (*trials, *((options.static,) if options.static is not None else ()))
    if not recordings:
        raise BadData("calibration needs at least one recording of markers")
    names, weights = _tracked(model, recordings, options)
    size = overall_size(model, names, [_columns(one, names) for one in recordings])
    bare = skeleton(model)
    sized = scale(bare, {body: np.full(3, size) for body in bare.body_names})
    tracking = InverseKinematicsOptions(marker_weights=dict(zip(names, weights, strict=True)), only_weighted=True)
    chosen = spread_postures(sized, recordings, tracking, options.frames, options.static is not None)
    problem = _problem(model, bare, names, weights, recordings, [frames for frames, _ in chosen], options, size)
    # Frames are shared among our own threads; a thread pool for each of their small products costs more than it gains.
    with threadpool_limits(limits=1, user_api="blas"):
        search = _search(problem, names, size, [angles for _, angles in chosen], options, progress)
    if progress:
        progress(max(0, options.iterations - search.steps))
    return _calibration(model, search.problem, search, names, chosen, options, path_lengths)


def _check(options: CalibrationOptions) -> None:
    for name in ("frames", "length_sd", "shape_sd", "side_sd", "marker_sd", "fixed_sd", "static_sd", "iterations"):
        if not getattr(options, name) > 0:
            raise BadData(f"calibration: {name} is {getattr(options, name)}; expected a number above 0")
    if options.mass is not None and not options.mass > 0.0:
        raise BadData(f"calibration: a mass of {options.mass:g} kg; expected the subject's")
    if options.noise is not None and not options.noise >= 0.0:
        raise BadData(f"calibration: noise is {options.noise}; expected metres, or 0 for that of the residual")


def _columns(markers: Markers, names: Sequence[str]) -> Array:
    """(frames, names, 3) of a recording, NaN for markers it does not have."""
    index = {name: i for i, name in enumerate(markers.names)}
    columns = np.full((len(markers), len(names), 3), np.nan)
    for i, name in enumerate(names):
        if name in index:
            columns[:, i] = markers.values[:, index[name]]
    return columns


def _tracked(model: Model, recordings: Sequence[Markers], options: CalibrationOptions) -> tuple[tuple[str, ...], Array]:
    """Markers that the model shares with any recording, and their weights."""
    every = tuple(dict.fromkeys(name for one in recordings for name in one.names))
    joined = Markers(np.zeros(0), every, np.zeros((0, len(every), 3)))
    names, weights = tracked_markers(model, joined, InverseKinematicsOptions(marker_weights=options.marker_weights))
    for name in options.fixed_markers:
        index_of("marker", name, model.marker_names)
    for number, one in enumerate(recordings):
        if not set(names) & set(one.names):
            raise BadData(
                f"recording {number + 1} of {len(recordings)} shares no marker with the model: the model has "
                f"{listing(one.names[0] if one.names else '', model.marker_names)}; the recording has "
                f"{listing(names[0], one.names)}"
            )
        if not np.isfinite(_columns(one, names)).all(axis=2).any():
            raise BadData(f"recording {number + 1} of {len(recordings)} shows none of the model's markers in any frame")
    return names, weights


def _problem(
    model: Model,
    bare: Model,
    names: tuple[str, ...],
    weights: Array,
    recordings: Sequence[Markers],
    frames: Sequence[Ints],
    options: CalibrationOptions,
    size: float,
) -> SharedProblem:
    lengths = lengths_of(model, options.symmetric)
    tree = compile_tree(bare)
    sets = []
    for number, (one, rows) in enumerate(zip(recordings, frames, strict=True)):
        known = np.zeros(len(tree.defaults))
        targets = coordinate_targets(tree, one.time[rows], InverseKinematicsOptions())
        if options.static is not None and number == len(recordings) - 1:
            for name, value in _static_pose(model, options).items():
                j = index_of("coordinate", name, model.coordinate_names)
                known[j], targets[:, j] = options.static_sd**-2, value
        sets.append(FrameSet(np.ascontiguousarray(_columns(one, names)[rows]), targets, known))
    return SharedProblem(
        model=bare,
        lengths=lengths,
        stretch=stretch_of(bare, lengths, names),
        markers=marker_arrays(tree, names, weights, InverseKinematicsOptions()),
        sets=tuple(sets),
        prior=_prior(lengths, _usual_shifts(model, names, options), options, size),
        posture=tree.defaults,
        posture_weight=options.posture_weight,
    )


def _static_pose(model: Model, options: CalibrationOptions) -> Mapping[str, float]:
    if options.static_pose is not None:
        return options.static_pose
    driven = model.dependent_coordinates
    return {
        one.name: one.default
        for one in model.coordinates
        if one.name.startswith(STANDING) and one.name not in driven and not one.locked
    }


def _usual_shifts(model: Model, names: Sequence[str], options: CalibrationOptions) -> Array:
    """(markers,) how far each lies from its place on the model, as a standard deviation along one axis [m]."""
    return np.array([options.fixed_sd if model.marker(name).fixed else options.marker_sd for name in names])


def _prior(lengths: Sequence[Length], shift_sd: Array, options: CalibrationOptions, size: float) -> Prior:
    """Rows of the prior over lengths, shifts (markers,) and the overall size."""
    n, shifts = len(lengths), 3 * len(shift_sd)
    main = {one.segment: i for i, one in enumerate(lengths) if one.along}
    rows, right = [], []

    def add(entries: Mapping[int, float], value: float, sd: float) -> None:
        row = np.zeros(n + shifts + 1)
        for i, factor in entries.items():
            row[i] += factor / sd
        rows.append(row)
        right.append(value / sd)

    add({n + shifts: 1.0}, size, 0.5)
    for i, one in enumerate(lengths):
        if one.along:
            add({i: 1.0, n + shifts: -1.0}, 0.0, options.length_sd)
        else:
            add({i: 1.0, main[one.segment]: -1.0}, 0.0, options.shape_sd)
    for i, j in mirrored_lengths(lengths):
        add({i: 1.0, j: -1.0}, 0.0, options.side_sd)
    for i in range(shifts):
        add({n + i: 1.0}, 0.0, float(shift_sd[i // 3]))
    return Prior(np.array(rows), np.array(right))


def _may_move(problem: SharedProblem, names: Sequence[str], options: CalibrationOptions) -> tuple[Bools, Bools]:
    """Which unknowns are lengths or the size, and which are shifts of markers that may move."""
    n, total = len(problem.lengths), problem.prior.rows.shape[1]
    lengths, shifts = np.zeros(total, np.bool_), np.zeros(total, np.bool_)
    lengths[:n] = lengths[-1] = True
    for m, name in enumerate(names):
        shifts[n + 3 * m : n + 3 * m + 3] = name not in options.fixed_markers
    return lengths, shifts


def _noise(problem: SharedProblem, found: Minimum, free: Bools, variance: float) -> tuple[float, bool]:
    """Standard deviation of a marker along one axis from what the fit leaves, and whether that can be told."""
    squares, seen = 0.0, 0
    for errors in found.reduced.errors:
        squares += float(np.nansum(problem.markers.weight * errors**2))
        seen += 3 * int(np.isfinite(errors).sum())
    rows = problem.prior.rows[:, free]
    H = found.reduced.H[np.ix_(free, free)]
    used = float(np.trace(np.linalg.solve(H + variance * rows.T @ rows, H)))
    left = seen - found.reduced.angles_free - used
    if left < 0.2 * seen:
        return NOISE_UNKNOWN, False
    return max(float(np.sqrt(squares / left)), NOISE_LEAST), True


@dataclass(frozen=True, eq=False)
class _Search:
    problem: SharedProblem
    found: Minimum
    start: Point
    noise: float
    told: bool
    costs: tuple[float, ...]
    steps: int
    free: Bools


def _search(
    problem: SharedProblem,
    names: Sequence[str],
    size: float,
    angles: Sequence[Array],
    options: CalibrationOptions,
    progress: Callable[[int], None] | None,
) -> _Search:
    """Minimum of the problem, the noise told by its residual until both agree."""
    lengths, shifts = _may_move(problem, names, options)
    free = lengths | shifts
    x = np.zeros(problem.prior.rows.shape[1])
    x[lengths] = size
    steps = 0

    def one_more() -> None:
        nonlocal steps
        steps += 1
        if progress and steps <= options.iterations:
            progress(1)

    frames = sum(len(one) for one in angles)
    noise = options.noise or NOISE_UNKNOWN
    if options.noise:
        noise *= float(np.sqrt(max(1.0, frames / options.independent_frames)))
    root = root_coordinates(compile_tree(problem.model))
    # Trusting the model more at first keeps markers from following frames that are still turned wrongly.
    stages = [noise] if noise >= NOISE_AT_FIRST else [NOISE_AT_FIRST, noise]
    start = point = settle(problem, x, angles, stages[0] ** 2)
    if not np.isfinite(point.cost(0.0)):
        raise BadData(f"calibration: the loops of model '{problem.model.name}' cannot be closed at {size:.3g} its size")
    told = True
    usual = _usual_shifts(problem.model, names, options)
    stages.append(noise)
    while stages:
        noise = stages.pop(0)
        point = settle_anew(problem, point, root, noise**2)
        left = max(1, options.iterations - steps)
        if options.method == "joint":
            found = minimise(problem, point, noise**2, free, left, 1e-3 if stages else 1e-5, one_more)
        else:
            found = _alternate(problem, point, noise**2, lengths, shifts, left, one_more)
        point = found.point
        if stages:
            # The variance that Student's t gives each marker: one that lies far off is no longer pulled back.
            shifts_now = np.linalg.norm(point.x[len(problem.lengths) : -1].reshape(-1, 3), axis=1)
            released = usual * np.sqrt((TAIL + (shifts_now / usual) ** 2) / (TAIL + 3.0))
            problem = replace(problem, prior=_prior(problem.lengths, released, options, size))
        if not stages and not options.noise:
            told_noise, told = _noise(problem, found, free, noise**2)
            if abs(told_noise - noise) > 0.05 * noise and steps < options.iterations:
                stages = [told_noise]
    return _Search(problem, found, start, noise, told, found.costs, steps, free)


def _alternate(
    problem: SharedProblem,
    point: Point,
    variance: float,
    lengths: Bools,
    shifts: Bools,
    most: int,
    told: Callable[[], None],
) -> Minimum:
    """[D] 3.2.1: (b) angles and lengths, (c) marker positions at fixed angles, in turn, until neither moves."""
    costs: list[float] = []
    for _ in range(most):
        found = minimise(problem, point, variance, lengths, 3)
        x = place_at_fixed_angles(problem, found, variance, shifts)
        point = settle(problem, x, found.point.angles, variance)
        costs.append(point.cost(variance))
        told()
        if len(costs) > 1 and costs[-2] - costs[-1] <= 1e-5 * costs[-1]:
            return Minimum(point, reduce(problem, point), True, tuple(costs))
    return Minimum(point, reduce(problem, point), False, tuple(costs))


def _calibration(
    model: Model,
    problem: SharedProblem,
    search: _Search,
    names: tuple[str, ...],
    chosen: Sequence[tuple[Ints, Array]],
    options: CalibrationOptions,
    path_lengths: Callable[[Model], ArrayLike] | None,
) -> Calibration:
    x, n = search.found.point.x, len(problem.lengths)
    factors = factors_of(problem.lengths, x[:n])
    locations = dict(zip(names, problem.placed(x), strict=True))
    result = scale(model, factors, options.mass, path_lengths=path_lengths)
    placed = tuple(replace(one, location=locations.get(one.name, one.location)) for one in result.markers)
    sd, prior_sd, place_sd = _deviations(problem, search)
    lengths = tuple(
        FoundLength(one, float(x[i]), float(sd[i]), float(prior_sd[i])) for i, one in enumerate(problem.lengths)
    )
    unstretched = np.zeros_like(x)
    unstretched[:n] = 1.0
    given = settle(problem, unstretched, [angles for _, angles in chosen], search.noise**2)
    before, after = reduce(problem, given).errors, search.found.reduced.errors
    shifts = x[n:-1].reshape(-1, 3)
    markers = tuple(
        FoundMarker(
            name, model.marker(name).body, locations[name], shifts[m], place_sd[m],
            root_mean_square([one[:, m] for one in before]), root_mean_square([one[:, m] for one in after]),
        )
        for m, name in enumerate(names)
    )  # fmt: skip
    return Calibration(
        model=result.with_markers(placed),
        options=options,
        factors=factors,
        lengths=lengths,
        markers=markers,
        size=float(x[-1]),
        noise=search.noise,
        frames=tuple(frames for frames, _ in chosen),
        angles=search.found.point.angles,
        before=before,
        after=after,
        marker_names=names,
        converged=search.found.converged,
        costs=search.costs,
        notes=_notes(search, lengths, markers, options),
    )


def _deviations(problem: SharedProblem, search: _Search) -> tuple[Array, Array, Array]:
    """Standard deviations: of the lengths, of the lengths without the recordings, of the markers' places.

    A place is factor * location + shift; what the two share cancels. 0 for what may not move.
    """
    n, free = len(problem.lengths), search.free
    rows, variance = problem.prior.rows[:, free], search.noise**2
    H = search.found.reduced.H[np.ix_(free, free)]
    spread = np.zeros((len(free), len(free)))
    spread[np.ix_(free, free)] = variance * np.linalg.inv(H + variance * rows.T @ rows)
    given_size = rows[:, :-1]
    prior_sd = np.zeros(len(free))
    prior_sd[np.flatnonzero(free)[:-1]] = np.sqrt(np.diag(np.linalg.inv(given_size.T @ given_size)))
    location = problem.stretch.location.ravel()
    column = problem.stretch.column[problem.markers.body].ravel()
    slopes = np.zeros((len(location), len(free)))
    slopes[:, n:-1] = np.eye(len(location))
    stretched = column >= 0
    slopes[stretched, column[stretched]] = location[stretched]
    places = np.sqrt(np.maximum(0.0, np.einsum("ij,jk,ik->i", slopes, spread, slopes)))
    return np.sqrt(np.diag(spread))[:n], prior_sd[:n], places.reshape(-1, 3)


def _notes(
    search: _Search,
    lengths: Sequence[FoundLength],
    markers: Sequence[FoundMarker],
    options: CalibrationOptions,
) -> tuple[str, ...]:
    notes = []
    count = sum(len(one) for one in search.found.point.angles)
    if count < FEW_FRAMES:
        notes.append(f"only {count} frames: lengths and marker positions come mostly from the given model")
    if not search.told:
        notes.append(f"so few frames do not tell the noise: taken as {1e3 * search.noise:g} mm")
    if not search.found.converged:
        notes.append(f"not converged after {search.steps} steps: allow more iterations")
    if search.found.point.settled < 1.0:
        notes.append(f"the angles of {100.0 * (1.0 - search.found.point.settled):.0f} % of the frames did not converge")
    hidden = [one.length.name for one in lengths if one.length.along and not one.shown]
    if hidden:
        notes.append(
            f"the recordings do not show {', '.join(hidden)}: they follow the overall size and their neighbors"
        )
    far = [one.name for one in markers if float(np.linalg.norm(one.shift)) > FAR]
    if far:
        notes.append(
            f"more than {100 * FAR:g} cm from their places on the given model: {', '.join(far)}; look whether they are "
            "named as the model names them"
        )
    return tuple(notes)

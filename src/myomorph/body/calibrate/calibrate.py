"""Kinematic identification: lengths of a body and positions of its markers, from motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from myomorph.body.calibrate.angle_slopes import sliding
from myomorph.body.calibrate.calibration import (
    Calibration,
    CalibrationOptions,
    Distances,
    LengthEstimate,
    MarkerEstimate,
    SideEstimate,
    root_mean_square,
)
from myomorph.body.calibrate.frame_sums import reduce, settle
from myomorph.body.calibrate.priors import calibration_prior, spread_postures, usual_shifts
from myomorph.body.calibrate.shared_fit import Search, search_minimum
from myomorph.body.calibrate.shared_problem import LENGTHS, MARKERS, FrameSet, SharedProblem
from myomorph.body.calibrate.zero_angles import far_zeros, zero_angles, zero_notes
from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name, listing
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.motion.body_size import overall_size
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    coordinate_targets,
    pose_problem,
    tracked_markers,
)
from myomorph.core.motion.lengths import factors_of, length_unit, lengths_of, segments_that_stretch
from myomorph.core.motion.stretch import skeleton, stretch_of
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.tree import compile_tree

STANDING = ("knee_angle", "ankle_angle", "subtalar", "mtp")
"""What the coordinates' names begin with that stand near their defaults in a static trial."""

POSITIVE = (
    "frames",
    "length_sd",
    "shape_sd",
    "side_sd",
    "posture_sd",
    "marker_sd",
    "fixed_sd",
    "static_sd",
    "iterations",
)

FEW_FRAMES = 10
# A marker farther than this from its place on the model may be another one [length units]
FAR = 0.1


def calibrate(
    model: Model,
    trials: Sequence[Markers],
    options: CalibrationOptions | None = None,
    progress: Callable[[int], None] | None = None,
    path_lengths: Callable[[Model], ArrayLike] | None = None,
) -> Calibration:
    """Estimate lengths of a body and marker positions that explain recorded motion best.

    Over frames f, markers m, lengths s, shifts d and angles q_f,

        min sum_fm w_m |x_m(q_f, s, d) - y_fm|^2 / noise^2 + |prior(s, d)|^2

    where x is linear in (s, d). The angles, bounded, locked and coupled as in inverse kinematics,
    are eliminated frame by frame. The prior keeps what no marker shows near the given model: every
    length near the overall size, stretch across near that along, right near left, markers near
    their positions.

    Source: [D] 3.2.1 step 1, after its reference 26; Lu and O'Connor 1999, whose problem is solved
    in every frame; docs/identification.md, "Lengths and markers".

    Parameters
    ----------
    model : scaled roughly to the body, with markers [m]
    trials : recordings in the model's ground
    options : what may change, and the noise of the markers [m]; see `CalibrationOptions`
    progress : called with the number of steps just done; all together `options.iterations`
    path_lengths : lets muscles keep their ratio of fiber to path, as in `scale`

    Returns
    -------
    the model with its new lengths and marker positions, factors of the lengths with their standard
        deviations, and marker errors before and after [m]

    Raises
    ------
    BadData : no recording shares a marker with the model, an option is out of range, or the loops
        of the model cannot be closed at the size of the body
    UnknownName : an option names a marker or coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model, markers = mm.read_model("arm.osim"), mm.read_recording("reach.trc").markers
    >>> found = mm.calibrate(model, [markers], mm.CalibrationOptions(iterations=2))
    >>> [one.length.name for one in found.lengths][:3]
    ['upper_x', 'upper_y', 'upper_z']
    >>> [round(float(one.factor), 3) for one in found.lengths][:3]
    [1.0, 1.0, 1.0]
    """
    options = options or CalibrationOptions()
    _check(options)
    recordings = (*trials, *((options.static,) if options.static is not None else ()))
    if not recordings:
        raise BadData("calibration needs at least one recording of markers")
    names, weights = _tracked(model, recordings, options)
    distances = Distances.of(options, length_unit(compile_tree(model)))
    size = overall_size(model, names, [_columns(recording, names) for recording in recordings])
    bare = skeleton(model)
    sized = scale(bare, {body: np.full(3, size) for body in bare.body_names})
    tracking = InverseKinematicsOptions(
        marker_weights=dict(zip(names, weights, strict=True)), only_weighted=True
    )
    chosen = spread_postures(
        sized, recordings, tracking, options.frames, options.static is not None
    )
    problem = _problem(
        model,
        bare,
        names,
        weights,
        recordings,
        [frames for frames, _ in chosen],
        options,
        size,
        distances,
    )
    # Frames are shared among our own threads; a thread pool for each of their small products costs
    # more than it gains.
    with threadpool_limits(limits=1, user_api="blas"):
        search = search_minimum(
            problem, names, size, [angles for _, angles in chosen], options, distances, progress
        )
    if progress:
        progress(max(0, options.iterations - search.steps))
    calibration = _calibration(
        model, search.problem, search, names, chosen, options, distances, path_lengths
    )
    # Of knees and feet alone: a pelvis or a trunk may lean from the generic one's by much.
    limbs = [zero for zero in calibration.zero_angles if zero.coordinate.startswith(STANDING)]
    far = far_zeros(limbs, static=options.static is not None and len(recordings) > 1)
    if far and far[0].mended:
        return replace(calibrate(model, (), options, path_lengths=path_lengths), warnings=far)
    return replace(
        calibration,
        notes=(*calibration.notes, *_thin_notes(model, names, recordings)),
        warnings=far,
    )


def _check(options: CalibrationOptions) -> None:
    for name in POSITIVE:
        value = getattr(options, name)
        if value is not None and not value > 0:
            raise BadData(f"calibration: {name} is {value}; expected a number above 0")
    for name in ("slide_sd", "slide_turn_sd"):
        value = getattr(options, name)
        if value is not None and not value >= 0.0:
            raise BadData(f"calibration: {name} is {value}; expected 0 or more")
    for name in options.fit:
        check_name("unknowns", name, (LENGTHS, MARKERS), "what can be calibrated")
    if not options.fit:
        raise BadData("calibration: nothing to fit; expected 'lengths', 'markers' or both")
    if options.mass is not None and not options.mass > 0.0:
        raise BadData(f"calibration: a mass of {options.mass:g} kg; expected the subject's")
    if options.noise is not None and not options.noise >= 0.0:
        raise BadData(
            f"calibration: noise is {options.noise}; expected metres, or 0 for that of the residual"
        )


def _columns(markers: Markers, names: Sequence[str]) -> Array:
    """Arrange a recording by marker names.

    Parameters
    ----------
    names : of the columns

    Returns
    -------
    (frames, names, 3) positions [m], NaN for markers that the recording does not have
    """
    index = {name: i for i, name in enumerate(markers.names)}
    columns = np.full((len(markers), len(names), 3), np.nan)
    for i, name in enumerate(names):
        if name in index:
            columns[:, i] = markers.values[:, index[name]]
    return columns


def _tracked(
    model: Model, recordings: Sequence[Markers], options: CalibrationOptions
) -> tuple[tuple[str, ...], Array]:
    """Collect markers that the model shares with any recording.

    Returns
    -------
    names, and (names,) weights

    Raises
    ------
    UnknownName : a marker to keep fixed is not the model's
    BadData : a recording shares no marker with the model, or shows none of them in any frame
    """
    every = tuple(dict.fromkeys(name for markers in recordings for name in markers.names))
    joined = Markers(np.zeros(0), every, np.zeros((0, len(every), 3)))
    names, weights = tracked_markers(
        model, joined, InverseKinematicsOptions(marker_weights=options.marker_weights)
    )
    for name in options.fixed_markers:
        index_of("marker", name, model.marker_names)
    for number, recording in enumerate(recordings):
        if not set(names) & set(recording.names):
            raise BadData(
                f"recording {number + 1} of {len(recordings)} shares no marker with the model: the"
                " model has"
                f" {listing(recording.names[0] if recording.names else '', model.marker_names)};"
                f" the recording has {listing(names[0], recording.names)}"
            )
        if not np.isfinite(_columns(recording, names)).all(axis=2).any():
            raise BadData(
                f"recording {number + 1} of {len(recordings)} shows none of the model's markers in"
                " any frame"
            )
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
    distances: Distances,
) -> SharedProblem:
    """Set up the problem of the chosen frames.

    Parameters
    ----------
    model : as given
    bare : its skeleton
    names, weights : of the markers, and (markers,)
    frames : of each recording, the numbers of those chosen
    size : overall size
    """
    lengths = lengths_of(model, options.symmetric)
    tree = compile_tree(bare)
    sets = []
    for number, (recording, rows) in enumerate(zip(recordings, frames, strict=True)):
        known = np.zeros(len(tree.defaults))
        targets = coordinate_targets(tree, recording.time[rows], InverseKinematicsOptions())
        if options.static is not None and number == len(recordings) - 1:
            for name, value in _static_pose(model, options).items():
                j = index_of("coordinate", name, model.coordinate_names)
                known[j] = options.static_sd**-2
                targets[:, j] = value
        sets.append(
            FrameSet(np.ascontiguousarray(_columns(recording, names)[rows]), targets, known)
        )
    return SharedProblem(
        model=bare,
        lengths=lengths,
        marker_names=names,
        stretch=stretch_of(bare, lengths, names),
        pose=pose_problem(tree, names, weights, InverseKinematicsOptions()),
        sets=tuple(sets),
        prior=calibration_prior(lengths, usual_shifts(model, names, distances), options, size),
        posture=tree.defaults,
        posture_weight=options.posture_weight,
        unit=distances.unit,
    )


def _static_pose(model: Model, options: CalibrationOptions) -> Mapping[str, float]:
    if options.static_pose is not None:
        return options.static_pose
    driven = model.dependent_coordinates
    return {
        coordinate.name: coordinate.default
        for coordinate in model.coordinates
        if coordinate.name.startswith(STANDING)
        and coordinate.name not in driven
        and not coordinate.locked
    }


def _calibration(
    model: Model,
    problem: SharedProblem,
    search: Search,
    names: tuple[str, ...],
    chosen: Sequence[tuple[Ints, Array]],
    options: CalibrationOptions,
    distances: Distances,
    path_lengths: Callable[[Model], ArrayLike] | None,
) -> Calibration:
    """Build the result of a search: the stretched model, intervals, zeros and notes.

    Parameters
    ----------
    chosen : of each recording, the chosen frames and where their angles began
    """
    x = search.found.point.x
    n = len(problem.lengths)
    factors = factors_of(problem.lengths, x[:n])
    locations = dict(zip(names, problem.placed(x), strict=True))
    result = scale(model, factors, options.mass, path_lengths=path_lengths)
    placed = tuple(
        replace(marker, location=locations.get(marker.name, marker.location))
        for marker in result.markers
    )
    turn = distances.turn if distances.slide else 0.0
    skin = sliding(problem, search.found.point, distances.slide, turn, options.independent_frames)
    estimate = _estimate(search, skin)
    sd = estimate.posterior.sd[:n]
    prior_sd = _prior_sd(problem, search.free)
    place_sd = _place_sd(problem, estimate.posterior)
    lengths = tuple(
        LengthEstimate(
            length=length, factor=float(x[i]), sd=float(sd[i]), prior_sd=float(prior_sd[i])
        )
        for i, length in enumerate(problem.lengths)
    )
    # The given model, and the same at the body's size: one too large bends its knees to reach the
    # markers.
    angles = [each for _, each in chosen]
    variance = search.noise**2
    given = settle(problem, np.r_[np.full(n, 1.0), np.zeros(len(x) - n)], angles, variance)
    sized = settle(problem, np.r_[np.full(n, x[-1]), np.zeros(len(x) - n)], angles, variance)
    before = reduce(problem, given).errors
    after = search.found.reduced.errors
    shifts = x[n:-1].reshape(-1, 3)
    zeros = zero_angles(
        problem,
        search.found.point,
        sized,
        search.noise**2,
        search.free,
        options.static is not None,
        options.zero_sd,
        skin,
    )
    markers = tuple(
        MarkerEstimate(
            name=name,
            body=model.marker(name).body,
            location=locations[name],
            shift=shifts[m],
            sd=place_sd[m],
            before=root_mean_square([frames[:, m] for frames in before]),
            after=root_mean_square([frames[:, m] for frames in after]),
        )
        for m, name in enumerate(names)
    )
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
        costs=search.found.costs,
        notes=(
            *_notes(search, lengths, markers, FAR * problem.unit),
            *_side_notes(search.sides),
            *zero_notes(zeros, options.static is not None),
        ),
        steps=search.steps,
        last_change=search.found.change,
        zero_angles=zeros,
        sides=search.sides,
        estimate=estimate,
    )


THIN = 3  # A segment with fewer markers than these can turn without showing it [markers]


def _thin_notes(model: Model, names: Sequence[str], recordings: Sequence[Markers]) -> Iterator[str]:
    """Report segments that only one or two markers show.

    Also the model's markers that are missing there, and recorded ones that the model does not know.

    Parameters
    ----------
    names : of markers that are fitted

    Yields
    ------
    one line, or none
    """
    seen = {
        name
        for recording in recordings
        for name, values in zip(recording.names, np.moveaxis(recording.values, 1, 0), strict=True)
        if name in names and np.isfinite(values).any()
    }
    thin = []
    missing = []
    for bodies in segments_that_stretch(model):
        here = [marker.name for marker in model.markers if marker.body in bodies]
        shown = [name for name in here if name in seen]
        # Two that the model was made with show a segment together with its joint; two that are left
        # over may not.
        if len(shown) == 1 or 0 < len(shown) < min(THIN, len(here)):
            thin.append(f"{bodies[0]} ({', '.join(shown)})")
            missing += [name for name in here if name not in seen]
    if not thin:
        return
    text = f"segments that fewer than {THIN} markers show: {', '.join(thin)}"
    if missing:
        strange = sorted(
            {name for recording in recordings for name in recording.names} - set(model.marker_names)
        )
        text += f"; the model also has {', '.join(missing)} there, which no recording shows"
        text += (
            f" (recorded and unknown to the model: {listing(missing[0], strange)})"
            if strange
            else ""
        )
    yield text


def _side_notes(sides: Sequence[SideEstimate]) -> Iterator[str]:
    """Report sides that differ: a longer leg or arm, or a fault of markers that looks like it."""
    differing = [
        f"{side.first} less {side.second} {100.0 * side.difference:+.1f} % (SD"
        f" {100.0 * side.sd:.1f} %)"
        for side in sides
        if side.differs
    ]
    if differing:
        yield (
            f"sides differ more than side_sd allows: {', '.join(differing)}; they were set free:"
            " look whether the person is so, or markers of one side lie elsewhere"
        )


def _estimate(search: Search, skin: Array) -> Estimate:
    """Attach the posterior, which skin that slides widens, to the last stage's solution.

    Parameters
    ----------
    skin : (unknowns + coordinates, same) the result of `sliding` [m^2 per unknown]
    """
    size = len(search.free)
    # The gradient in units of the noise is that in metres over the variance.
    extra = skin[:size, :size] / search.noise**4
    posterior = Posterior.of(search.found.solution, extra=extra)
    return estimate_of(search.found.solution, posterior=posterior)


def _prior_sd(problem: SharedProblem, free: Bools) -> Array:
    """Compute how well lengths are known without the recordings, the overall size known.

    Parameters
    ----------
    free : (unknowns,) which are estimated

    Returns
    -------
    (lengths,) standard deviation of factors; 0 for those that are not free
    """
    given_size = free.copy()
    given_size[-1] = False
    rows = problem.prior.rows[:, given_size]
    sd = np.zeros(len(free))
    sd[given_size] = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    return sd[: len(problem.lengths)]


def _place_sd(problem: SharedProblem, posterior: Posterior) -> Array:
    """Compute how well marker positions are known.

    A position is factor * location + shift; what the two share cancels.

    Parameters
    ----------
    posterior : over all shared unknowns

    Returns
    -------
    (markers, 3) standard deviation along the body's axes [m]; 0 for what may not move
    """
    n = len(problem.lengths)
    location = problem.stretch.location.ravel()
    column = problem.stretch.column[problem.pose.markers.body].ravel()
    slopes = np.zeros((len(location), len(posterior.x)))
    slopes[:, n:-1] = np.eye(len(location))
    stretched = column >= 0
    slopes[stretched, column[stretched]] = location[stretched]
    variance = np.einsum("ij,jk,ik->i", slopes, posterior.covariance, slopes)
    return np.sqrt(np.maximum(0.0, variance)).reshape(-1, 3)


def _notes(
    search: Search,
    lengths: Sequence[LengthEstimate],
    markers: Sequence[MarkerEstimate],
    most: float,
) -> tuple[str, ...]:
    notes = []
    count = sum(len(angle) for angle in search.found.point.angles)
    if count < FEW_FRAMES:
        notes.append(
            f"only {count} frames: lengths and marker positions come mostly from the given model"
        )
    if not search.noise_found:
        notes.append(f"so few frames do not show the noise: taken as {1e3 * search.noise:g} mm")
    if not search.found.converged:
        notes.append(
            f"not converged after {search.steps} steps, last change {search.found.change:.1g}:"
            " allow more iterations"
        )
    if search.found.point.settled < 1.0:
        notes.append(
            f"the angles of {100.0 * (1.0 - search.found.point.settled):.0f} % of the frames did"
            " not converge"
        )
    hidden = [length.length.name for length in lengths if length.length.along and not length.shown]
    if hidden:
        notes.append(
            f"the recordings do not show {', '.join(hidden)}: they follow the overall size and"
            " their neighbors"
        )
    far = [marker.name for marker in markers if float(np.linalg.norm(marker.shift)) > most]
    if far:
        notes.append(
            f"more than {100 * most:.3g} cm from their places on the given model: {', '.join(far)};"
            " look whether they are named as the model names them"
        )
    return tuple(notes)

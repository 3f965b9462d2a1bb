"""Kinematic identification: lengths of a body and positions of its markers, from motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from myomorph.body.calibrate.calibration import (
    Calibration,
    CalibrationOptions,
    Distances,
    LengthEstimate,
    MarkerEstimate,
    ZeroAngle,
    root_mean_square,
)
from myomorph.body.calibrate.frame_sums import reduce, settle
from myomorph.body.calibrate.marker_spread import gradient_of_spread, marker_spread
from myomorph.body.calibrate.notes import (
    few_marker_notes,
    length_notes,
    marker_notes,
    search_notes,
    side_notes,
)
from myomorph.body.calibrate.patella_fit import (
    patella_distance,
    patella_readings,
    unlikely_marker_notes,
    with_distance,
)
from myomorph.body.calibrate.patella_markers import (
    moved_marker_notes,
    with_markers_on_patellae,
)
from myomorph.body.calibrate.postures import ChosenFrames, spread_postures
from myomorph.body.calibrate.priors import calibration_prior, usual_shifts
from myomorph.body.calibrate.recorded import RecordedMarkers, recorded_markers
from myomorph.body.calibrate.shared_fit import Search, SearchSettings, search_minimum
from myomorph.body.calibrate.shared_problem import LENGTHS, MARKERS, FrameSet, SharedProblem
from myomorph.body.calibrate.sliding_skin import Slide, sliding
from myomorph.body.calibrate.zero_angles import (
    far_zeros,
    standing_errors,
    zero_angles,
    zero_notes,
)
from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.fit.posterior import Posterior
from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.findings import Finding
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.motion.body_size import overall_size
from myomorph.core.motion.ik import InverseKinematicsOptions, coordinate_targets, pose_problem
from myomorph.core.motion.lengths import factors_of, length_unit, lengths_of
from myomorph.core.motion.stretch import skeleton, stretch_of
from myomorph.core.rigid.tree import Tree, compile_tree

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
    check_argument("model", model, Model)
    for markers in trials:
        check_argument("trials", markers, Markers)
    options = options or CalibrationOptions()
    _check(options)
    given = model
    model = with_markers_on_patellae(given)
    recorded = recorded_markers(model, trials, options)
    positions = [recorded.positions(recording) for recording in recorded.recordings]
    settings = SearchSettings(
        options=options,
        distances=Distances.of(options, length_unit(compile_tree(model))),
        size=overall_size(model, recorded.names, positions),
    )
    bare = skeleton(model)
    sized = scale(bare, {body: np.full(3, settings.size) for body in bare.body_names})
    chosen = spread_postures(sized, recorded, options.frames)
    problem = _problem(model, bare, recorded, chosen, settings)
    # Frames are shared among our own threads; a thread pool for each of their small products costs
    # more than it gains.
    with threadpool_limits(limits=1, user_api="blas"):
        search = search_minimum(problem, settings, [part.angles for part in chosen], progress)
    if progress:
        progress(max(0, options.iterations - search.steps))

    calibration = _calibration(model, search, chosen, settings, path_lengths)
    far = _far_zeros(search, calibration, recorded)
    if far and far[0].repaired:
        return replace(calibrate(model, (), options, path_lengths=path_lengths), warnings=far)
    notes = (
        *calibration.notes,
        *few_marker_notes(model, recorded),
        *moved_marker_notes(given, model),
    )
    calibration = replace(calibration, notes=notes, warnings=far)
    if not options.patellae:
        return calibration
    frames = [options.independent_frames] * len(recorded.recordings)
    if recorded.static:
        frames[-1] = 1  # All of them show one posture
    return _with_patellae(calibration, problem, settings.distances.noise, frames)


def _with_patellae(
    calibration: Calibration, problem: SharedProblem, noise: float, independent: Sequence[int]
) -> Calibration:
    """Move patellae to where markers on them say.

    Parameters
    ----------
    calibration : with patellae as far out as those of the given model
    problem : with what was observed
    noise : of a marker along one axis [m]; 0 for that of the residual
    independent : for each recording, so many frames say as much as all
    """
    model = calibration.model
    observed = [part.observed for part in problem.sets]
    readings = tuple(
        patella_readings(model, calibration.marker_names, observed, calibration.angles)
    )
    found = patella_distance(model, readings, noise or calibration.noise, independent)
    return replace(
        calibration,
        model=with_distance(model, found),
        patella=found,
        notes=(*calibration.notes, *unlikely_marker_notes(readings)),
    )


def _far_zeros(
    search: Search, calibration: Calibration, recorded: RecordedMarkers
) -> tuple[Finding, ...]:
    """Find zero angles of knees and feet where no bones have them; a pelvis or a trunk may lean."""
    limbs = [zero for zero in calibration.zero_angles if zero.coordinate.startswith(STANDING)]
    moving = len(recorded.recordings) > int(recorded.static)
    standing = standing_errors(search) if recorded.static else {}
    return far_zeros(limbs, standing, alone=recorded.static and moving)


def _check(options: CalibrationOptions) -> None:
    """Raise `BadData` where an option is out of range, `UnknownName` where `fit` names nothing."""
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


def _problem(
    model: Model,
    bare: Model,
    recorded: RecordedMarkers,
    chosen: Sequence[ChosenFrames],
    settings: SearchSettings,
) -> SharedProblem:
    """Set up the problem of the chosen frames.

    Parameters
    ----------
    model : as given
    bare : its skeleton
    """
    options = settings.options
    distances = settings.distances
    lengths = lengths_of(model, options.symmetric)
    tree = compile_tree(bare)
    sets = [
        _frame_set(tree, recorded, recording, frames)
        for recording, frames in zip(recorded.recordings, chosen, strict=True)
    ]
    if recorded.static:
        sets[-1] = _standing(sets[-1], model, options)
    usual = usual_shifts(model, recorded.names, distances)
    return SharedProblem(
        model=bare,
        lengths=lengths,
        marker_names=recorded.names,
        stretch=stretch_of(bare, lengths, recorded.names),
        pose=pose_problem(tree, recorded.names, recorded.weights, InverseKinematicsOptions()),
        sets=tuple(sets),
        prior=calibration_prior(lengths, usual, options, settings.size),
        posture=tree.defaults,
        posture_weight=options.posture_weight,
        unit=distances.unit,
    )


def _frame_set(
    tree: Tree, recorded: RecordedMarkers, recording: Markers, chosen: ChosenFrames
) -> FrameSet:
    """Take the chosen frames of a recording, of which no angle is known."""
    time = recording.time[chosen.frames]
    return FrameSet(
        observed=np.ascontiguousarray(recorded.positions(recording)[chosen.frames]),
        targets=coordinate_targets(tree, time, InverseKinematicsOptions()),
        known=np.zeros(len(tree.defaults)),
    )


def _standing(frames: FrameSet, model: Model, options: CalibrationOptions) -> FrameSet:
    """Add the angles that are known in a static trial."""
    known = frames.known.copy()
    targets = frames.targets.copy()
    for name, value in _static_pose(model, options).items():
        j = index_of("coordinate", name, model.coordinate_names)
        known[j] = options.static_sd**-2
        targets[:, j] = value
    return replace(frames, targets=targets, known=known)


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


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Before:
    """Models that the calibrated one is compared with, on the chosen frames.

    Attributes
    ----------
    errors : of each recording (frames, markers) distances on the model as given [m]
    zero_angles : of the calibrated model against the given one at the body's size
    """

    errors: tuple[Array, ...]
    zero_angles: tuple[ZeroAngle, ...]


def _calibration(
    model: Model,
    search: Search,
    chosen: Sequence[ChosenFrames],
    settings: SearchSettings,
    path_lengths: Callable[[Model], ArrayLike] | None,
) -> Calibration:
    """Build the result of a search: the stretched model, intervals, zeros and notes."""
    options = settings.options
    problem = search.problem
    found = search.found
    x = found.point.x
    factors = factors_of(problem.lengths, x[: len(problem.lengths)])
    stretched = scale(model, factors, options.mass, path_lengths=path_lengths)
    skin = _sliding_skin(search, settings)
    spread = marker_spread(search, skin)
    errors = skin + gradient_of_spread(search, spread, len(skin))
    estimate = _estimate(search, errors)
    before = _before(search, chosen, errors, options)
    lengths = _length_estimates(search, estimate.posterior)
    markers = _marker_estimates(model, search, estimate.posterior, before.errors)
    return Calibration(
        model=_with_locations(stretched, markers),
        options=options,
        factors=factors,
        lengths=lengths,
        markers=markers,
        size=float(x[-1]),
        noise=search.stage.noise,
        frames=tuple(part.frames for part in chosen),
        angles=found.point.angles,
        before=before.errors,
        after=found.reduced.errors,
        marker_names=problem.marker_names,
        converged=found.converged,
        costs=found.costs,
        notes=(
            *search_notes(search),
            *length_notes(lengths),
            *marker_notes(markers, problem.unit),
            *side_notes(search.sides),
            *zero_notes(before.zero_angles, options.static is not None),
        ),
        steps=search.steps,
        last_change=found.change,
        zero_angles=before.zero_angles,
        sides=search.sides,
        estimate=estimate,
        marker_spread=spread,
    )


def _sliding_skin(search: Search, settings: SearchSettings) -> Array:
    """Compute what sliding skin adds: (unknowns + coordinates, same), see `sliding`."""
    distances = settings.distances
    turn = distances.turn if distances.slide else 0.0
    return sliding(
        search.problem,
        search.found.point,
        Slide(shift=distances.slide, turn=turn),
        settings.options.independent_frames,
    )


def _before(
    search: Search, chosen: Sequence[ChosenFrames], errors: Array, options: CalibrationOptions
) -> _Before:
    """Settle the frames on the given model, and on the same at the body's size.

    A given model that is too large bends its knees to reach the markers.

    Parameters
    ----------
    errors : (unknowns + coordinates, same) covariance of gradient and mean angles that the noise
        of the markers does not have
    """
    problem = search.problem
    angles = [part.angles for part in chosen]
    variance = search.stage.variance
    size = search.found.point.x[-1]
    given = settle(problem, problem.of_size(1.0), angles, variance)
    sized = settle(problem, problem.of_size(size), angles, variance)
    return _Before(
        errors=reduce(problem, given).errors,
        zero_angles=zero_angles(search, sized, errors, options),
    )


def _length_estimates(search: Search, posterior: Posterior) -> tuple[LengthEstimate, ...]:
    """Describe every length, with its interval."""
    x = search.found.point.x.tolist()
    sd = posterior.sd.tolist()
    prior_sd = _prior_sd(search).tolist()
    return tuple(
        LengthEstimate(length=length, factor=x[i], sd=sd[i], prior_sd=prior_sd[i])
        for i, length in enumerate(search.problem.lengths)
    )


def _marker_estimates(
    model: Model, search: Search, posterior: Posterior, before: Sequence[Array]
) -> tuple[MarkerEstimate, ...]:
    """Describe every marker, with its interval and its distances.

    Parameters
    ----------
    before : of each recording (frames, markers) distances on the given model [m]
    """
    problem = search.problem
    x = search.found.point.x
    locations = problem.placed(x)
    shifts = problem.shifts(x)
    sd = _place_sd(problem, posterior)
    after = search.found.reduced.errors
    return tuple(
        MarkerEstimate(
            name=name,
            body=model.marker(name).body,
            location=locations[m],
            shift=shifts[m],
            sd=sd[m],
            before=root_mean_square([distances[:, m] for distances in before]),
            after=root_mean_square([distances[:, m] for distances in after]),
        )
        for m, name in enumerate(problem.marker_names)
    )


def _with_locations(model: Model, markers: Sequence[MarkerEstimate]) -> Model:
    """Move markers to where they were found; those that no recording has stay."""
    locations = {marker.name: marker.location for marker in markers}
    moved = tuple(
        replace(marker, location=locations.get(marker.name, marker.location))
        for marker in model.markers
    )
    return model.with_markers(moved)


def _estimate(search: Search, errors: Array) -> Estimate:
    """Attach the posterior to the last stage's solution.

    Parameters
    ----------
    errors : (unknowns + coordinates, same) covariance of the gradient that the noise of the markers
        does not have: of skin that slides, and of how far markers lie off [m^2 per unknown]
    """
    unknowns = len(search.stage.free)
    # The gradient in units of the noise is that in metres over the variance.
    extra = errors[:unknowns, :unknowns] / search.stage.noise**4
    posterior = Posterior.of(search.found.solution, extra=extra)
    return estimate_of(search.found.solution, posterior=posterior)


def _prior_sd(search: Search) -> Array:
    """Compute how well lengths are known without the recordings, the overall size known.

    Returns
    -------
    (lengths,) standard deviation of factors; 0 for those that are not free
    """
    problem = search.problem
    given_size = search.stage.free.copy()
    given_size[-1] = False
    rows = problem.prior.rows[:, given_size]
    sd = np.zeros(len(given_size))
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
    location = problem.stretch.location.ravel()
    length_of_row = problem.stretch.column[problem.pose.markers.body].ravel()
    slopes = np.zeros((len(location), len(posterior.x)))
    slopes[:, len(problem.lengths) : -1] = np.eye(len(location))
    stretched = length_of_row >= 0
    slopes[stretched, length_of_row[stretched]] = location[stretched]
    variance = np.einsum("ij,jk,ik->i", slopes, posterior.covariance, slopes)
    return np.sqrt(np.maximum(0.0, variance)).reshape(-1, 3)

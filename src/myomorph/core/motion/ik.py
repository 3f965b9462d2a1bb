"""Inverse kinematics: the coordinates whose markers lie nearest to those seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, check_choices, listing
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.units import MotionKind
from myomorph.core.motion.lengths import coordinate_units
from myomorph.core.motion.newton import (
    SCOUT,
    Settings,
    SolvedPoses,
    frames_shown,
    solve_poses,
    task_arrays,
)
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.quantities import ASSUMED_AS, FIT, FITTED_COORDINATE, SENSOR_ERROR
from myomorph.core.motion.starts import scout_poses, unbent_poses
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.tasks.loops import ties_of
from myomorph.core.motion.tasks.markers import MarkerTask
from myomorph.core.motion.tasks.orientations import OrientationTask
from myomorph.core.motion.tasks.task import Task
from myomorph.core.motion.turns import floating_coordinates, of_one_branch, of_one_turn
from myomorph.core.motion.unseen import (
    AssumedMode,
    assumed_poses,
    marker_errors,
    part_of,
    posture_near,
)
from myomorph.core.rigid.coordinates import Ints, couple_frames
from myomorph.core.rigid.loops import closure, free_coordinates
from myomorph.core.rigid.tree import Tree, compile_tree


@dataclass(frozen=True)
class InverseKinematicsOptions:
    """Options of inverse kinematics.

    Attributes
    ----------
    marker_weights : weight of each marker; markers that are not named have 1, and 0 leaves a marker
        out
    only_weighted : use only the markers named in `marker_weights`, as an OpenSim task set does
    tasks : further terms of the cost: pulls of coordinates, or tasks of one's own
        (docs/adding.md)
    coordinates : a motion that gives values to tasks and to locked coordinates
    tolerance : convergence tolerance: largest change of a coordinate in the last step [rad, or m on
        a body of human size; on a smaller one in proportion, see `length_unit`]
    iterations : maximum number of iterations per frame
    posture_weight : weight of a pull to the default pose that holds coordinates without markers,
        relative to the mean curvature of the cost; too small to affect the others
    root_bounds : respect the bounds of the root's coordinates of a floating body, as OpenSim does;
        by default it may stand and turn anywhere in the laboratory
    untracked_coordinates : assumption about coordinates that no marker determines; "upright": the
        trunk stays upright and gaps of markers are bridged (`myomorph.core.motion.unseen`);
        "default": the default pose in every frame, as in OpenSim
    """

    marker_weights: Mapping[str, float] = field(default_factory=dict)
    only_weighted: bool = False
    tasks: Sequence[Task] = ()
    coordinates: Motion | None = None
    tolerance: float = 1e-6
    iterations: int = 100
    posture_weight: float = 1e-7
    root_bounds: bool = False
    untracked_coordinates: Literal["upright", "default"] = "upright"

    def __post_init__(self) -> None:
        check_choices(self)

    @property
    def settings(self) -> Settings:
        """Settings of the Newton loop among them."""
        return Settings(
            posture_weight=self.posture_weight,
            tolerance=self.tolerance,
            max_steps=self.iterations,
        )


@read_only
class KinematicsFit(Labelled):
    """Coordinates, and how well they explain the markers.

    Attributes
    ----------
    motion : all coordinates, NaN in frames that no task shows
    marker_names : the markers used
    marker_error : (frames, markers) distance between model and recording [m], NaN where unseen
    marker_weight : (markers,)
    converged : (frames,) whether the last step was within the tolerance, or the cost can fall no
        further, see `myomorph.core.motion.newton.solve_poses`
    iterations : (frames,)
    loop_closure_error : (frames,) how far loops stand open, the largest gap or turning [m or rad];
        None without loops
    unused_markers : recorded markers that the model does not have, or that have no weight
    missing_markers : model markers that the recording does not have
    task_errors : by name of a kind of task (frames, ...) the residuals that it stores
    sensor_names : inertial sensors used
    assumed_sd : (frames, coordinates) standard deviation about what was assumed of coordinates that
        no marker shows, 0 where markers determine them [rad or m]; None where they determine all
    assumed_as : by coordinate what was assumed, "" where markers determine it
    modes : how coordinates that are never seen may differ from what is assumed; not stored
    """

    motion: Motion
    marker_names: tuple[str, ...]
    marker_error: Array
    marker_weight: Array
    converged: np.ndarray
    iterations: Ints
    unused_markers: tuple[str, ...]
    missing_markers: tuple[str, ...]
    loop_closure_error: Array | None = None
    task_errors: Mapping[str, Array] = field(default_factory=dict)
    sensor_names: tuple[str, ...] = ()
    assumed_sd: Array | None = None
    assumed_as: tuple[str, ...] = ()
    modes: tuple[AssumedMode, ...] = ()

    @property
    def sensor_error(self) -> Array:
        """(frames, sensors) angle between body and sensor [rad], NaN where unknown."""
        return self.task_errors.get(OrientationTask.__name__, np.empty((len(self.motion), 0)))

    @property
    def motion_kinds(self) -> Mapping[str, MotionKind] | None:
        """How coordinates move, by name, where it is known."""
        return self.motion.motion_kinds

    @property
    def held(self) -> tuple[Quantity, ...]:
        """Coordinates, errors of markers and of sensors, what was assumed, convergence."""
        return tuple(
            quantity
            for quantity in (FITTED_COORDINATE, *FIT)
            if (quantity is not SENSOR_ERROR or self.sensor_names)
            and (quantity is not ASSUMED_AS or self.assumed_as)
        )

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Name the coordinates, markers and sensors, with the times.

        Returns
        -------
        by dimension, its names; of "time" (frames,) [s]
        """
        names = {
            "coordinate": self.motion.names,
            "marker": self.marker_names,
            "sensor": self.sensor_names,
        }
        return {"time": self.motion.time, **names}

    @property
    def seen(self) -> np.ndarray:
        """(frames,) whether any marker was seen, or any sensor reported."""
        return np.asarray(
            np.isfinite(self.marker_error).any(axis=1) | np.isfinite(self.sensor_error).any(axis=1)
        )

    @property
    def rms(self) -> Array:
        """(frames,) root mean square of the marker errors [m], NaN where none was seen."""
        return marker_rms(self.marker_error)

    @property
    def largest(self) -> Array:
        """(frames,) largest marker error [m], NaN where none was seen."""
        largest: Array = np.max(
            np.where(np.isfinite(self.marker_error), self.marker_error, -np.inf),
            axis=1,
            initial=-np.inf,
        )
        return np.where(np.isfinite(largest), largest, np.nan)


def inverse_kinematics(
    model: Model,
    markers: Markers,
    options: InverseKinematicsOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> KinematicsFit:
    """Coordinates that minimise the distance of the markers, frame by frame.

    In every frame,

        sum_m w_m |x_m(c) - y_m|^2 / sum_m w_m    markers m that are seen
        + sum_j v_j (c_j - value_j)^2             a `CoordinateTask` of coordinate j
        + sum_s u_s angle_s(c)^2                  an `OrientationTask` of sensor s, and own tasks
        + p k sum_j ((c_j - default_j) / unit_j)^2

    is minimised. The marker of the model lies at x_m, was seen at y_m and has the weight w_m of
    `marker_weights`. A task pulls its coordinate to `value` with its `weight` v_j; u_s weighs the
    angle between a body and its measured orientation. The last line draws coordinates that no task
    shows to the default pose: p is `posture_weight`, k the mean curvature of the tasks of bodies
    where the frame starts, unit_j 1 rad, or the model's `length_unit`. The sum is taken over the
    coordinates that are neither locked, prescribed nor driven by a coupler, clamped ones within
    their range, so that every loop stays closed: OpenSim's problem (its `InverseKinematicsSolver`
    on Simbody's `Assembler`), solved by damped Newton steps with analytic first and second
    derivatives. Unlike there the root of a floating body has no bounds (`root_bounds`): where it
    stands and turns is a matter of the laboratory.

    Source: Lu and O'Connor 1999; Seth et al. 2018.

    Parameters
    ----------
    model : with markers, fitted in size to the body [m]
    markers : in the model's ground frame; unseen markers are NaN and do not count
    options : see `InverseKinematicsOptions`
    progress : called with the number of frames just done

    Returns
    -------
    coordinates (frames, coordinates) [rad or m] and marker errors (frames, markers) [m]

    Raises
    ------
    BadData
        where model and recording share no marker, no frame shows one, or a loop cannot be closed
    UnknownName
        where a weight or task names what the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model, markers = mm.read_model("arm.osim"), mm.read_recording("reach.trc").markers
    >>> fit = mm.inverse_kinematics(model, markers)
    >>> fit.motion.names, fit.marker_error.shape
    (('shoulder_flexion', 'elbow_flexion'), (61, 4))
    >>> bool(fit.largest.max() < 1e-4)
    True
    """
    check_argument("model", model, Model)
    check_argument("markers", markers, Markers)
    options = options or InverseKinematicsOptions()
    tree = compile_tree(model)
    names, weights = tracked_markers(model, markers, options)
    problem = pose_problem(tree, names, weights, options, markers)
    if not frames_shown(problem).any():
        raise BadData(
            f"none of the {len(markers)} frames shows a marker that the model has, or a sensor"
        )

    solved, values = _solved(tree, problem, len(markers), options.settings, progress)
    gaps = np.abs(closure(tree, values)).max(axis=1) if model.loops else None
    fit = _kinematics_fit(model, markers, (names, weights), solved, values, gaps)
    sensors = tuple(task.sensor for task in options.tasks if isinstance(task, OrientationTask))
    fit = replace(fit, sensor_names=sensors) if sensors else fit
    return (
        fit
        if options.untracked_coordinates == "default"
        else _with_unseen(tree, problem, fit, options.settings)
    )


def _kinematics_fit(
    model: Model,
    markers: Markers,
    tracked: tuple[tuple[str, ...], Array],
    solved: SolvedPoses,
    values: Array,
    gaps: Array | None,
) -> KinematicsFit:
    """Return the fit of markers by poses that were solved.

    `tracked`: names and weights of the markers that count; `values`: (frames, coordinates)
    [rad or m]; `gaps`: (frames,) of loops [m or rad], None without loops.
    """
    names, weights = tracked
    return KinematicsFit(
        motion=_motion(model, markers, values),
        marker_names=names,
        marker_error=solved.errors[MarkerTask],
        marker_weight=weights,
        converged=solved.converged,
        iterations=solved.iterations,
        loop_closure_error=gaps,
        unused_markers=tuple(name for name in markers.names if name not in names),
        missing_markers=tuple(name for name in model.marker_names if name not in markers.names),
        task_errors={
            kind.__name__: errors
            for kind, errors in solved.errors.items()
            if kind is not MarkerTask
        },
    )


def _solved(
    tree: Tree,
    problem: PoseProblem,
    frames: int,
    settings: Settings,
    progress: Callable[[int], None] | None,
) -> tuple[SolvedPoses, Array]:
    """Solve all frames, and those that ended bent the wrong way again.

    Returns what was solved, and coordinates (frames, coordinates) without turns and branches that
    change from frame to frame [rad or m].
    """
    starts = np.repeat(scout_poses(tree, problem, settings), SCOUT, axis=0)[:frames]
    solved = solve_poses(tree, problem, starts, settings, progress=progress)
    unbent = unbent_poses(tree, problem, settings, solved.values)
    if unbent is not None:
        solved = solve_poses(tree, problem, unbent, settings._replace(chained=False))
    return solved, of_one_turn(tree, problem, of_one_branch(tree, problem, solved.values))


def _with_unseen(
    tree: Tree, problem: PoseProblem, fit: KinematicsFit, settings: Settings
) -> KinematicsFit:
    """Complete a fit by what is known beforehand of coordinates that no marker shows."""
    motion = fit.motion
    assumed = assumed_poses(tree, problem, motion.time, motion.values, settings)
    if assumed is None:
        return fit
    moved = np.flatnonzero(assumed.moved)
    errors = np.array(fit.marker_error)
    errors[moved] = marker_errors(tree, part_of(problem, moved), assumed.values[moved])
    return replace(
        fit,
        motion=replace(motion, values=assumed.values),
        marker_error=errors,
        assumed_sd=assumed.sd,
        assumed_as=assumed.how,
        modes=assumed.modes,
    )


def poses_near(
    model: Model,
    markers: Markers,
    motion: Motion,
    options: InverseKinematicsOptions | None = None,
    posture: Array | None = None,
) -> Motion:
    """Coordinates of `inverse_kinematics` for markers and a model close to those of a motion.

    Where two axes of a joint are nearly parallel, other angles give nearly the same pose, and a
    search that begins elsewhere may end in these: here it begins at the motion in every frame.
    Unknown frames stay unknown.

    Parameters
    ----------
    model : with markers
    markers : at the times of the motion [m]
    motion : (frames, coordinates) where each frame begins [rad or m]
    options : see `InverseKinematicsOptions`
    posture : (frames, coordinates) what coordinates are weakly drawn to, as `posture_of` found it
        for another model or markers of the same recording; None to find it [rad or m]

    Returns
    -------
    motion, (frames, coordinates) [rad or m], NaN in unknown frames
    """
    options = options or InverseKinematicsOptions()
    tree = compile_tree(model)
    problem, starts, blank = _near(tree, markers, motion, options)
    if posture is None:
        posture = posture_near(tree, problem, starts)
    problem = problem._replace(posture=posture)
    settings = options.settings._replace(chained=False)
    values = solve_poses(tree, problem, starts, settings).values
    values[blank] = np.nan
    return _motion(model, markers, values)


def posture_of(
    model: Model, markers: Markers, motion: Motion, options: InverseKinematicsOptions | None = None
) -> Array:
    """Find what coordinates are weakly drawn to near a motion, for `poses_near`.

    It depends on which coordinates the markers show, and hardly on where they are seen.

    Parameters
    ----------
    model, markers, motion, options : as of `poses_near`

    Returns
    -------
    (frames, coordinates) [rad or m]
    """
    tree = compile_tree(model)
    problem, starts, _ = _near(tree, markers, motion, options or InverseKinematicsOptions())
    return posture_near(tree, problem, starts)


def _near(
    tree: Tree, markers: Markers, motion: Motion, options: InverseKinematicsOptions
) -> tuple[PoseProblem, Array, np.ndarray]:
    """Make the problem of `poses_near`, in which every frame begins where the motion is.

    Returns
    -------
    problem, starts (frames, coordinates) [rad or m], and which frames (frames,) are unknown
    """
    refuse_other_times("markers", markers.time, motion.time)
    names, weights = tracked_markers(tree.model, markers, options)
    problem = pose_problem(tree, names, weights, options, markers)
    # What no marker shows stays where the motion is.
    starts = np.array(motion.values)
    blank = ~(np.isfinite(starts).all(axis=1) & frames_shown(problem))
    starts[blank] = tree.defaults
    return problem, starts, blank


def _motion(model: Model, markers: Markers, values: Array) -> Motion:
    """Make a motion of coordinates (frames, coordinates) at the times of markers."""
    names = model.coordinate_names
    return Motion(markers.time, names, values, motion_kinds=model.motion_kinds)


def marker_rms(errors: Array) -> Array:
    """Root mean square of the errors of the markers seen.

    Parameters
    ----------
    errors : (frames, markers) [m], NaN where unseen

    Returns
    -------
    (frames,) [m], NaN where none was seen
    """
    seen = np.isfinite(errors)
    with np.errstate(invalid="ignore"):
        return np.sqrt((np.where(seen, errors, 0.0) ** 2).sum(axis=1) / seen.sum(axis=1))


def tracked_markers(
    model: Model, markers: Markers, options: InverseKinematicsOptions
) -> tuple[tuple[str, ...], Array]:
    """Markers that model and recording share and that have a weight.

    Parameters
    ----------
    model : with markers
    markers : of the recording
    options : with the weights

    Returns
    -------
    names, in the model's order, and weights (markers,); none where other tasks need no marker

    Raises
    ------
    BadData : they share no marker, or all that they share have weight 0
    UnknownName : a weight names a marker that neither has
    """
    either = dict.fromkeys(model.marker_names + markers.names)
    for name in options.marker_weights:
        index_of("marker", name, tuple(either), "the model or the recording")
    default = 0.0 if options.only_weighted else 1.0
    weighted = {
        name: options.marker_weights.get(name, default)
        for name in model.marker_names
        if name in set(markers.names)
    }
    if not weighted and any(not isinstance(task, CoordinateTask) for task in options.tasks):
        return (), np.empty(0)
    if not weighted:
        first = model.marker_names[0] if model.marker_names else ""
        raise BadData(
            f"model and recording share no marker: the model has {listing('', model.marker_names)};"
            f" the recording has {listing(first, markers.names)}"
        )
    names = tuple(name for name, weight in weighted.items() if weight > 0.0)
    if not names:
        raise BadData(f"all {len(weighted)} markers that model and recording share have weight 0")
    return names, np.array([weighted[name] for name in names])


def pose_problem(
    tree: Tree,
    names: Sequence[str],
    weights: Array,
    options: InverseKinematicsOptions,
    recording: Markers | None = None,
) -> PoseProblem:
    """Sum of all tasks, and what may move within its bounds.

    Parameters
    ----------
    tree : of the model
    names : of the markers
    weights : (markers,)
    options : with all other tasks
    recording : with the markers' positions; without one the problem has no frames, and tasks of
        markers and coordinates alone

    Returns
    -------
    problem of all frames
    """
    model = tree.model
    frames = 0 if recording is None else len(recording)
    time = np.empty(0) if recording is None else recording.time
    columns = (
        []
        if recording is None
        else [recording.values[:, recording.names.index(name)] for name in names]
    )
    positions = columns or [np.empty((frames, 3))] * len(names)
    tracked = [
        MarkerTask(marker=name, positions=path, weight=weight)
        for name, path, weight in zip(names, positions, weights, strict=True)
    ]
    targets = coordinate_targets(tree, time, options)
    others = [
        task for task in options.tasks if recording is not None or isinstance(task, CoordinateTask)
    ]
    free = free_coordinates(tree)
    floating = () if options.root_bounds else floating_coordinates(model)
    bounded = [
        model.coordinates[j].clamped and model.coordinates[j].name not in floating for j in free
    ]
    limits = [
        model.coordinates[j].range if held else (-np.inf, np.inf)
        for j, held in zip(free, bounded, strict=True)
    ]
    lower, upper = np.array(limits).reshape(-1, 2).T.copy()
    return PoseProblem(
        free=free,
        lower=lower,
        upper=upper,
        unit=coordinate_units(tree),
        fixed=targets,
        posture=tree.defaults[None].copy(),
        pull=np.zeros((1, len(tree.defaults))),
        tasks=task_arrays([*tracked, *others], tree, targets),
        ties=ties_of(tree),
    )


def coordinate_targets(tree: Tree, time: Array, options: InverseKinematicsOptions) -> Array:
    """Values that tasks pull coordinates to, and those of locked or prescribed coordinates.

    Parameters
    ----------
    tree : of the model
    time : (frames,) [s]
    options : with tasks of coordinates, and a motion that gives values

    Returns
    -------
    (frames, coordinates) [rad or m]
    """
    model = tree.model
    targets = np.tile(tree.defaults, (len(time), 1))
    if options.coordinates is not None:
        for name in set(options.coordinates.names) & set(model.coordinate_names):
            values = np.interp(time, options.coordinates.time, options.coordinates[name])
            targets[:, model.coordinate_names.index(name)] = values
    for j, coordinate in enumerate(model.coordinates):
        if coordinate.prescribed is not None:
            targets[:, j] = coordinate.prescribed(time)
    for task in options.tasks:
        if isinstance(task, CoordinateTask) and task.value is not None:
            targets[:, index_of("coordinate", task.coordinate, model.coordinate_names)] = task.value
    couple_frames(tree.arrays, targets)
    return targets

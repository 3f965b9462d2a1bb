"""Recordings of a subject as the data of the one problem.

Through inverse kinematics, on one clock, thinned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.body.identify.recordings import MASS_TOLERANCE, RecordingOptions, Usable, usable
from myomorph.body.identify.soft_tissue import usual_tissue
from myomorph.body.identify.subject import IdentificationOptions, identify
from myomorph.body.refine.kind import Setup
from myomorph.body.refine.kinds import kinds_of
from myomorph.body.refine.opened import Opened
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.problem import Problem
from myomorph.body.refine.spline_basis import Basis
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.body.refine.trial import TrialData
from myomorph.body.shape.envelope import own_points
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.series import DEFAULT_POSE, Motion, Wrenches
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import inverse_kinematics, pose_problem, tracked_markers
from myomorph.core.motion.lengths import length_unit
from myomorph.core.motion.stretch import skeleton
from myomorph.core.rigid.regressor import base_wrench
from myomorph.core.rigid.tree import compile_tree

KNOTS = 4.0  # Knots a period of the cutoff frequency
FRAMES_A_KNOT = 2.0  # Frames between knots that are enough
SPACING = 0.02  # Of the mass points in each link's envelope [m]


def opened(model: Model, trial: SubjectTrial, options: RefineOptions) -> Opened:
    """Run inverse kinematics of a trial on a model, and find the frames that can be used.

    Parameters
    ----------
    model : with masses
    trial : as recorded
    options : with the cutoff of the forces

    Returns
    -------
    the trial on the markers' clock

    Raises
    ------
    BadData : as in `recordings.usable`
    """
    fit = inverse_kinematics(model, trial.markers, trial.tracking)
    return Opened(
        trial=trial,
        motion=fit.motion,
        usable=_usable(model, trial, fit.motion, options),
        distances=fit.marker_error,
    )


def with_shift(model: Model, recorded: Opened, options: RefineOptions, shift: float) -> Opened:
    """Use the forces of a trial at other times.

    Parameters
    ----------
    model : with masses
    recorded : the trial on this model
    options : with the cutoff of the forces
    shift : added to the times of the forces as recorded [s]

    Returns
    -------
    the trial with these forces, and the frames that can be used then
    """
    trial = recorded.trial
    wrenches = replace(trial.wrenches, time=trial.wrenches.time + shift)
    shifted = replace(trial, wrenches=wrenches)
    used = _usable(model, shifted, recorded.motion, options)
    return replace(recorded, usable=used, shift=shift)


def _usable(model: Model, trial: SubjectTrial, motion: Motion, options: RefineOptions) -> Usable:
    """Put the motion and the forces of a trial on one clock."""
    return usable(
        model,
        motion,
        trial.wrenches,
        time=trial.time,
        name=trial.name,
        options=RecordingOptions(cutoff=options.cutoff),
    )


def problem_of(model: Model, recorded: Sequence[Opened], options: RefineOptions) -> Problem:
    """Set up the problem of some trials on a model.

    Parameters
    ----------
    model : at the subject's mass
    recorded : trials on it
    options : what is refined, and how much each part is believed

    Returns
    -------
    the problem, its masses those that `identify` finds in the same frames
    """
    weights: dict[str, float] = {}
    for each in recorded:
        tracked, weight = tracked_markers(model, each.trial.markers, each.trial.tracking)
        weights |= dict(zip(tracked, weight, strict=True))
    names = tuple(name for name in model.marker_names if name in weights)
    bare = skeleton(model)
    tree = compile_tree(bare)
    masses = inertial_parameters(model)
    tissue = None
    if options.fits_masses or options.soft_tissue != "never":
        parts = [_weighed(each.counted, model.mass) for each in recorded]
        masses, tissue = identified_masses(model, parts, options)
    pose = pose_problem(
        tree, names, np.array([weights[name] for name in names]), recorded[0].trial.tracking
    )
    unit = length_unit(tree)
    setup = Setup(
        model=bare,
        recorded=tuple(recorded),
        markers=names,
        marker_bodies=pose.markers.body,
        masses=masses,
        unit=unit,
        options=options,
    )
    return Problem(
        model=bare,
        names=names,
        pose=pose,
        locations=pose.markers.location.copy(),
        trials=tuple(_trial_data(model, names, each, options, tissue) for each in recorded),
        kinds=kinds_of(setup),
        fit=options.fit,
        weight=model.mass * float(np.linalg.norm(model.gravity)),
        unit=unit,
        options=options,
        tissue=tissue,
    )


def gain_of(usable: Usable, mass: float) -> float:
    """Compute the factor on forces where plates weigh the body otherwise than stated.

    It is 1 within `MASS_TOLERANCE`. A motion that had to explain what is missing would fall or rise
    all the time, far from the markers.

    Parameters
    ----------
    usable : recording
    mass : of the body [kg]
    """
    off = np.isfinite(usable.weighs) and abs(usable.weighs / mass - 1.0) > MASS_TOLERANCE
    return mass / usable.weighs if off else 1.0


def _weighed(usable: Usable, mass: float) -> Usable:
    """Scale the forces of a recording so that its plates weigh the body, see `gain_of`."""
    gain = gain_of(usable, mass)
    recording = usable.recording
    if gain == 1.0:
        return usable

    def weighed(wrenches: Wrenches) -> Wrenches:
        return replace(wrenches, forces=gain * wrenches.forces, torques=gain * wrenches.torques)

    finer = recording.finer
    finer = None if finer is None else replace(finer, wrenches=weighed(finer.wrenches))
    return replace(
        usable, recording=replace(recording, wrenches=weighed(recording.wrenches), finer=finer)
    )


def thinned(problem: Problem) -> Problem:
    """Keep as many frames as the knots need.

    Skin stays alike for longer, and forces are filtered.

    Parameters
    ----------
    problem : with all frames

    Returns
    -------
    the problem with every n-th frame, at least about `FRAMES_A_KNOT` a knot
    """
    rate = FRAMES_A_KNOT * KNOTS * problem.options.cutoff
    trials = []
    for trial in problem.trials:
        step = max(1, int(1.0 / (rate * float(np.median(np.diff(trial.time)))) + 1e-6))
        every = slice(None, None, step)
        span = (float(trial.time[0]), float(trial.time[-1]))
        basis = Basis.of(trial.time[every], 1.0 / (KNOTS * problem.options.cutoff), span)
        trials.append(
            replace(
                trial,
                time=trial.time[every],
                observed=trial.observed[every],
                measured=trial.measured[every],
                use=trial.use[every],
                trust=trial.trust[every],
                start=trial.start[every],
                basis=basis,
            )
        )
    return replace(problem, trials=tuple(trials))


def _trial_data(
    model: Model,
    names: Sequence[str],
    recorded: Opened,
    options: RefineOptions,
    tissue: SoftTissue | None,
) -> TrialData:
    trial = recorded.trial
    recording = recorded.usable.recording
    use = recorded.counted.use
    wrench = base_wrench(model, recording.motion, recording.wrenches, np.zeros(3))
    time = recorded.motion.time
    frames = (time >= recording.motion.time[0] - 1e-9) & (time <= recording.motion.time[-1] + 1e-9)
    if recorded.within is not None:
        # Markers outside of the part are not seen either.
        inside = np.flatnonzero(frames)[recorded.within]
        frames = np.zeros(len(time), bool)
        frames[inside[0] : inside[-1] + 1] = True
    chosen = np.isin(np.round(recording.motion.time, 9), np.round(time[frames], 9))
    columns = {name: i for i, name in enumerate(trial.markers.names)}
    observed = np.full((int(frames.sum()), len(names), 3), np.nan)
    for i, name in enumerate(names):
        if name in columns:
            observed[:, i] = trial.markers.values[frames, columns[name]]
    motion = recorded.motion if tissue is None else tissue.of(differentiate(recorded.motion))
    start = _without_gaps(compile_tree(model).coordinates_of(motion)[frames])
    return TrialData(
        name=trial.name,
        time=time[frames],
        observed=observed,
        measured=np.nan_to_num(wrench[chosen]),
        use=use[chosen],
        trust=np.ones(len(start)),
        start=start,
        basis=Basis.of(time[frames], 1.0 / (KNOTS * options.cutoff)),
        gain=gain_of(recorded.usable, model.mass),
    )


def _without_gaps(values: Array) -> Array:
    """Interpolate frames that saw no marker, straight between those that did.

    Parameters
    ----------
    values : (frames, coordinates) NaN where unknown

    Returns
    -------
    (frames, coordinates)
    """
    known = np.isfinite(values).all(axis=1)
    at = np.arange(len(values))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in values.T])


def identified_masses(
    model: Model, recorded: Sequence[Usable], options: RefineOptions
) -> tuple[Array, SoftTissue | None]:
    """Identify masses and soft tissue for the motion of the problem.

    The model's masses, and soft tissue as before anything is measured, where `identify` keeps
    these, or the recordings are too short.

    Parameters
    ----------
    model : with masses
    recorded : recordings
    options : of the refinement

    Returns
    -------
    (bodies, 10) parameters, and the soft tissue between the motion of the mass and the markers
    """
    # The refinement fits masses itself, about the likeliest ones.
    same = IdentificationOptions(compare=False, soft_tissue=options.soft_tissue, masses="expected")
    usual = usual_tissue(model) if options.soft_tissue == "always" else None
    points = {"own": own_points(model, DEFAULT_POSE, model.mass, SPACING)}
    try:
        limits = RecordingOptions(cutoff=options.cutoff)
        identification = identify(model, recorded, points, options=same, recording=limits)
    except BadData:
        return inertial_parameters(model), usual
    masses = (
        identification.parameters[identification.chosen]
        if options.fits_masses
        else inertial_parameters(model)
    )
    return masses, identification.soft_tissue or usual

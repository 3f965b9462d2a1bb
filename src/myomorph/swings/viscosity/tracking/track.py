"""Motion of a specimen's bones from the clusters on them, and the wrench on its base."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.clocks import Clock
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.core.motion.sync import cut
from myomorph.swings.viscosity.specimen.model import Specimen, SwingTrial
from myomorph.swings.viscosity.swings.motion import differentiate_joint, on_one_branch
from myomorph.swings.viscosity.swings.plate import (
    CUTOFF,
    SwingRows,
    lowpass_runs,
    on_clock,
    plate_clock,
    wrench_about,
)
from myomorph.swings.viscosity.swings.recording import (
    REACH,
    CarriedLimb,
    touched_frames,
    whole_frames,
)
from myomorph.swings.viscosity.tracking import held as holding
from myomorph.swings.viscosity.tracking.cluster_slips import without_slips
from myomorph.swings.viscosity.tracking.clusters import checked_clusters
from myomorph.swings.viscosity.tracking.held import Slip, bone_poses
from myomorph.swings.viscosity.tracking.limb_shape import shaped
from myomorph.swings.viscosity.tracking.tracked import (
    TrackedSpecimen,
    TrackedTrial,
    TrackingOptions,
    swung_limb,
)

TURNED = 0.995
"""Largest singular value of a mean rotation from which a limb has not turned about two axes enough,
some 6 degrees root mean square, to show its center.
"""

QUICK = 25.0  # Low-pass of a motion before its rows are filtered themselves [Hz].
MIN_FRAMES = 10  # Of base and limb together, from which a center is told.
PARTIAL = 0.1  # Weight in means of a frame in which a cluster has lost a marker.

Progress = Callable[[int], None]

EXACT = InverseKinematicsOptions(tolerance=1e-9, posture_weight=1e-12)
"""What is left of an iteration's last step, and of a pull to the default pose, would be
differentiated twice.
"""


def track(
    specimen: Specimen,
    trials: Sequence[SwingTrial],
    options: TrackingOptions | None = None,
    progress: Progress | None = None,
) -> TrackedSpecimen:
    """Return motion of the joint and wrench on the base in every trial of one condition.

    Between its trials the specimen stays on the plate and its wires in place; `progress` counts
    each frame twice.

    Labels are checked by the distances within clusters. Inverse kinematics with everything free
    then gives the one pose of the base and the one value of every held joint over all trials; with
    those fixed, it is solved again for the joint alone. The wrench is moved to the joint's center
    and to the markers' clock.
    """
    options = options or TrackingOptions()
    if not trials:
        raise BadData("no trial of the swinging limb is given")
    names = [trial.name for trial in trials]
    checked = [_checked_markers(specimen, trial, options) for trial in trials]
    markers = [trial_markers for trial_markers, _ in checked]
    started, notes = _centered(_started(specimen, markers), markers, options)
    markers, slid = without_slips(started, markers, names, options.shift)
    if any(slid):
        started, notes = _centered(_started(specimen, markers), markers, options)
    motions, weights = _free_motions(started, markers, progress)
    base, held, slips = _held_still(started, markers, names, motions, weights, options)
    posed = _posed(started.standing(base), held)
    if options.center == "motion" and _turns_enough(posed, markers) and not any(slips):
        posed, notes = _shaped(posed, markers, options, notes)
    known = [
        _KnownTrial(
            trial=trial,
            markers=markers[index],
            motion=motions[index],
            slips=(
                *slid[index],
                *_ascribed(slips[index], options.center == "model" and bool(notes)),
            ),
            notes=tuple(checked[index][1]),
        )
        for index, trial in enumerate(trials)
    ]
    tracked = [_tracked_trial(started, posed, each, options, progress) for each in known]
    if options.find_contact:
        tracked = _with_touches(posed, tracked, options.contact_threshold)
    return TrackedSpecimen(
        specimen=posed,
        trials=tuple(tracked),
        held=held,
        slips=tuple(chain.from_iterable(each.slips for each in known)),
        notes=notes,
    )


def _checked_markers(
    specimen: Specimen, trial: SwingTrial, options: TrackingOptions
) -> tuple[Markers, Sequence[str]]:
    """Return the markers of a trial's time whose clusters are as the model has them, and notes."""
    shown = trial.markers if trial.time is None else cut(trial.markers, *trial.time)
    return checked_clusters(specimen, shown, trial.name, options.cluster)


def _free_motions(
    specimen: Specimen, markers: Sequence[Markers], progress: Progress | None
) -> tuple[list[Motion], list[Array]]:
    """Run inverse kinematics with everything free.

    Where markers are missing, what is held may be anything: it is judged, and followed, by the
    frames that show each bone. Returns motions, NaN in other frames, and weights (frames,).
    """
    fits = [inverse_kinematics(specimen.model, marker, EXACT, progress) for marker in markers]
    motions = [on_one_branch(specimen, fit.motion) for fit in fits]
    weights = [_sureness(specimen, fit) for fit in fits]
    sure = [
        replace(motion, values=np.where(weight[:, None] > 0.0, motion.values, np.nan))
        for motion, weight in zip(motions, weights, strict=True)
    ]
    return sure, weights


def _ascribed(slips: Sequence[Slip], off_center: bool) -> list[Slip]:
    """Ascribe slips that go to and fro to a limb that turns about another center, where it does."""
    if not off_center:
        return list(slips)
    return [replace(slip, center_off=not (slip.lasting or slip.before)) for slip in slips]


def _shaped(
    specimen: Specimen,
    markers: Sequence[Markers],
    options: TrackingOptions,
    notes: tuple[str, ...],
) -> tuple[Specimen, tuple[str, ...]]:
    """Put the limb's markers where the motion has them, with a further note where that is far."""
    posed, moved = shaped(specimen, markers)
    if moved <= options.cluster:
        return posed, notes
    return posed, (
        *notes,
        f"the limb's markers lie {1000 * moved:.1f} mm (root mean square) from where the model has"
        " them; where the motion has them is used: check how clusters fit bones",
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _KnownTrial:
    """A trial, its checked markers, its motion with everything free, what slipped, and notes."""

    trial: SwingTrial
    markers: Markers
    motion: Motion
    slips: tuple[Slip, ...]
    notes: tuple[str, ...]


def _tracked_trial(
    started: Specimen,
    posed: Specimen,
    known: _KnownTrial,
    options: TrackingOptions,
    progress: Progress | None,
) -> TrackedTrial:
    """Return motion of the joint alone and wrench in a trial.

    `started`: the specimen with everything free; `posed`: with base and held joints locked.
    """
    trial = known.trial
    away, sway = _base_motion(started, posed, known)
    fit = _joint_alone(posed, known.markers, away, known.motion, known.slips, progress)
    wrench, clock, warnings = _wrench(posed, trial, away, sway, fit.motion, options)
    return TrackedTrial(
        name=trial.name,
        motion=fit.motion,
        wrench=wrench,
        touched=np.zeros(len(fit.motion), bool),
        rms=fit.rms,
        clock=clock,
        notes=(
            *known.notes,
            *(slip.line for slip in known.slips),
            *(f"trial '{trial.name}': {warning}" for warning in warnings),
        ),
        origin=_plate_origin(posed, trial),
        sway=sway,
    )


def _base_motion(started: Specimen, posed: Specimen, known: _KnownTrial) -> tuple[Array, Array]:
    """Return how far a base that slipped carries the joint's center, (frames, 3) [m].

    The second value is its sway (frames, 6) where it goes to and fro, else without frames.
    """
    motion = known.motion
    shifts = [slip for slip in known.slips if slip.what == "base" and not slip.cluster]
    if any(not (slip.lasting or slip.before) for slip in shifts):
        sway = holding.base_sway(started, motion, posed.stand)
        return sway[:, :3], sway
    away = np.zeros((len(motion), 3))
    if shifts:
        poses = holding.base_poses(started, motion)
        there = holding.center_course(started, motion.time, *poses)
        away = there - posed.center_in_ground
    return away, np.zeros((0, 6))


def _held_still(
    specimen: Specimen,
    markers: Sequence[Markers],
    names: Sequence[str],
    motions: Sequence[Motion],
    weights: Sequence[Array],
    options: TrackingOptions,
) -> tuple[Transform, dict[str, float], list[list[Slip]]]:
    """Return pose of the base, value of what is held, and what moved all the same.

    Slips are those of each trial, in it or before it. A base that its own markers show at rest is
    only drawn along by a joint whose center, or by markers whose positions, do not fit the motion.
    """
    limits = holding.SlipLimits(turned=options.slip, moved=options.shift)
    slips = [
        holding.slips_within(specimen, name, motion, limits)
        for name, motion in zip(names, motions, strict=True)
    ]
    for trial_slips, shown in zip(slips, markers, strict=True):
        if any(slip.what == "base" for slip in trial_slips):
            pose = bone_poses(specimen.model, specimen.base, [shown])
            if np.isfinite(pose[1]).any() and not holding.base_slips(
                specimen, "", shown.time, pose, limits
            ):
                trial_slips[:] = [slip for slip in trial_slips if slip.what != "base"]
    moved = [[slip.what for slip in trial_slips] for trial_slips in slips]
    base = holding.mean_base(specimen, motions, weights)
    held = holding.mean_held(specimen, motions, weights, moved)
    rest = holding.MeanRest(held=held, center=base.apply(specimen.center))
    for name, motion, trial_slips, own_notes in zip(names, motions, slips, moved, strict=True):
        before = holding.slips_before(specimen, name, motion, rest, limits)
        trial_slips += [slip for slip in before if slip.what not in own_notes]
    return base, held, slips


def _started(specimen: Specimen, trials: Sequence[Markers]) -> Specimen:
    """Set coordinates to zero in the specimen's hanging pose, far from singular angles."""
    rotations, origins = bone_poses(specimen.model, specimen.base, trials)
    seen = np.isfinite(origins).all(axis=1)
    if not seen.any():
        raise BadData(f"no frame shows three markers of the base '{specimen.base}' at once")
    stand = Transform(holding.mean_rotation(rotations[seen]), origins[seen].mean(axis=0))
    standing = specimen.standing(stand)
    limb, _ = bone_poses(specimen.model, specimen.first, trials)
    shown = np.isfinite(limb).all(axis=(1, 2))
    return (
        standing.resting(stand.rotation.T @ holding.mean_rotation(limb[shown]))
        if shown.any()
        else standing
    )


def _centered(
    specimen: Specimen, trials: Sequence[Markers], options: TrackingOptions
) -> tuple[Specimen, tuple[str, ...]]:
    """Return the specimen about the center that the options request.

    The second value reports how far the limb's own center is from the model's. A hinge, and a limb
    that hardly turns or of which fewer than three markers are seen, show no center.
    """
    if not _turns_enough(specimen, trials):
        return specimen, ()
    in_base, in_limb = holding.rotation_center(*_both_poses(specimen, trials))
    distance = float(np.linalg.norm(in_base - specimen.center))
    notes: tuple[str, ...] = ()
    if distance > options.max_center_distance:
        used = "that is used" if options.center == "motion" else "set center to 'motion' to use it"
        text = (
            f"the limb turns about a point {1000 * distance:.1f} mm from the joint's center of the"
            f" model ({used})"
        )
        notes = (f"{text}: check how clusters fit bones",)
    return (specimen.centered(in_base, in_limb) if options.center == "motion" else specimen), notes


def _both_poses(
    specimen: Specimen, trials: Sequence[Markers]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Rotations and origins of base and limb in the frames that show three markers of each."""
    base = bone_poses(specimen.model, specimen.base, trials)
    limb = bone_poses(specimen.model, specimen.first, trials)
    seen = np.isfinite(base[1]).all(axis=1) & np.isfinite(limb[1]).all(axis=1)
    return (base[0][seen], base[1][seen]), (limb[0][seen], limb[1][seen])


def _turns_enough(specimen: Specimen, trials: Sequence[Markers]) -> bool:
    """Whether the limb turns about enough axes to show the point that stays still."""
    if len(specimen.joint_coordinates) == 1:
        return False
    (base, _), (limb, _) = _both_poses(specimen, trials)
    if len(base) < MIN_FRAMES:
        return False
    mean = np.einsum("fji,fjk->ik", base, limb) / len(base)
    return bool(np.linalg.svd(mean, compute_uv=False)[0] <= TURNED)


def _sureness(specimen: Specimen, fit: KinematicsFit) -> Array:
    """Return the weight of each frame in means (frames,).

    It is 1 where all markers are seen that the trial ever shows, `PARTIAL` where two of each bone
    are, else 0; `PARTIAL` wherever any is seen if that is nowhere so.
    """
    seen = np.isfinite(fit.marker_error)
    ever = seen.any(axis=0)
    bodies = np.array([specimen.model.marker(name).body for name in fit.marker_names])
    enough = np.ones(len(seen), bool)
    for bone in set(bodies[ever]):
        bone_seen = seen[:, ever & (bodies == bone)]
        enough &= bone_seen.sum(axis=1) >= min(2, bone_seen.shape[1])
    if not enough.any():
        return np.asarray(PARTIAL * seen.any(axis=1))
    return np.where(seen[:, ever].all(axis=1), 1.0, PARTIAL) * enough


def _posed(specimen: Specimen, held: Mapping[str, float]) -> Specimen:
    """Lock base and held joints of the specimen."""
    still = dict.fromkeys(specimen.base_coordinates, 0.0) | dict(held)
    coordinates = tuple(
        (
            replace(coordinate, default=still[coordinate.name], locked=True)
            if coordinate.name in still
            else coordinate
        )
        for coordinate in specimen.model.coordinates
    )
    return replace(specimen, model=replace(specimen.model, coordinates=coordinates))


def _joint_alone(
    specimen: Specimen,
    markers: Markers,
    away: Array,
    motion: Motion,
    slips: Sequence[Slip],
    progress: Progress | None,
) -> KinematicsFit:
    """Run inverse kinematics of the joint alone.

    What slipped follows its course in this trial instead of the mean. A joint whose base moved is
    brought back by how far its center was `away` (frames, 3) [m].
    """
    markers = replace(markers, values=markers.values - away[:, None])
    slipped = [slip.what for slip in slips if slip.what != "base" and not slip.cluster]
    earlier = None
    if slipped:
        values = np.stack([holding.course(motion, name) for name in slipped], axis=1)
        earlier = Motion(motion.time, tuple(slipped), values)
    limb = {marker.name for marker in specimen.model.markers if marker.body != specimen.base} & set(
        markers.names
    )
    options = replace(
        EXACT,
        marker_weights=dict.fromkeys(sorted(limb), 1.0),
        only_weighted=True,
        coordinates=earlier,
    )
    fit = inverse_kinematics(specimen.model, markers, options, progress)
    columns = [fit.motion.names.index(name) for name in specimen.joint_coordinates]
    values = fit.motion.values[:, columns].copy()
    values[np.isfinite(fit.marker_error).sum(axis=1) < 2] = np.nan
    return replace(
        fit,
        motion=on_one_branch(specimen, Motion(fit.motion.time, specimen.joint_coordinates, values)),
    )


def _plate_origin(specimen: Specimen, trial: SwingTrial) -> Array:
    """Return the mean point that the plate's wrench is about, (3,) from the joint's center [m].

    It is zeros where the plate has none.
    """
    points = trial.wrenches.points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    return points.mean(axis=0) - specimen.center_in_ground if len(points) else np.zeros(3)


def _wrench(
    specimen: Specimen,
    trial: SwingTrial,
    away: Array,
    sway: Array,
    motion: Motion,
    options: TrackingOptions,
) -> tuple[Array, Clock, list[str]]:
    """Return the wrench about the center at the motion's times, the plate's clock, and warnings."""
    center = specimen.center_in_ground
    time = trial.wrenches.time
    raw = wrench_about(trial.wrenches, center)
    if trial.tare is not None:
        raw = raw - np.nanmean(wrench_about(trial.tare, center), axis=0)
    if away.any():
        moved = np.stack([np.interp(time, motion.time, column) for column in away.T], axis=1)
        raw[:, :3] -= np.cross(moved, raw[:, 3:])
    clock = Clock()
    warnings = list[str]()
    if options.clock and np.isfinite(raw).all(axis=1).sum() > 3:
        swing = _rows(specimen, motion, sway)
        origin = _plate_origin(specimen, trial)
        clock, warnings = plate_clock(swing, time, raw, origin, options.contact_threshold)
    wrench = on_clock(clock.times(time), raw, motion.time)
    if not np.isfinite(wrench).any():
        spans = (f"{each[0]:g} to {each[-1]:g} s" for each in (motion.time, time))
        raise BadData(
            "trial '{}': markers ({}) and plate ({}) have no time in common".format(
                trial.name, *spans
            )
        )
    return wrench, clock, warnings


def _rows(specimen: Specimen, motion: Motion, sway: Array) -> SwingRows:
    """Return the motion as rows, slow ones at the cutoff that looks for hands.

    Rows are filtered as the wrench is, after the motion has passed a filter that leaves fast twists
    as they are: what is then left of wrench - rows phi is no matter of filters.
    """
    quick = differentiate_joint(specimen, motion, QUICK)
    rows = swung_limb(specimen, quick, sway, QUICK).wrench_rows
    slow = lowpass_runs(rows.reshape(len(rows), -1), motion.rate, CUTOFF).reshape(rows.shape)
    finite = np.asarray(np.isfinite(slow).all(axis=(1, 2)))
    whole = whole_frames(motion.time, finite, CUTOFF)
    return SwingRows(time=motion.time, rows=rows, slow=slow, whole=whole)


def _with_touches(
    specimen: Specimen, trials: Sequence[TrackedTrial], share: float
) -> list[TrackedTrial]:
    """Find the frames in which somebody touches the limb, over all trials together."""
    carried = []
    for trial in trials:
        swing = _rows(specimen, trial.motion, trial.sway)
        wrench = lowpass_runs(trial.wrench, trial.motion.rate, CUTOFF)
        known = np.asarray(np.isfinite(wrench).all(axis=1))
        carried.append(
            CarriedLimb(
                time=swing.time, rows=swing.slow, wrench=wrench, candidates=swing.whole & known
            )
        )
    touching = touched_frames(carried, share, 0.5 * REACH / CUTOFF)
    result = []
    for trial, touched in zip(trials, touching, strict=True):
        hands = _hands(trial.name, trial.motion.time, touched)
        result.append(replace(trial, touched=touched, notes=(*trial.notes, *hands)))
    return result


def _hands(name: str, time: Array, touched: np.ndarray) -> tuple[str, ...]:
    if not touched.any():
        return ()
    share = float(touched.mean())
    seconds = share * float(time[-1] - time[0])
    line = (
        f"trial '{name}': something besides the joint supports the limb for {seconds:.1f} s:"
        " left out"
    )
    if share > 0.5:
        line += "; as that is most of the trial, check the plate's calibration and its clock"
    return (line,)

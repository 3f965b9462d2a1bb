"""Frames of a recording that show the body's masses.

Forces are whole, no contact is beside the plates, and no end of a filter is near.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from myomorph.body.identify.least_squares import Finer, Recording
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import WEIGHT
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.cutoff_choice import choose_cutoff
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.smoother import SmoothedMotion, differentiated_at, smoothed_by
from myomorph.core.motion.sync import cut, resample_wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.regressor import base_wrench, regressor_blocks
from myomorph.core.rigid.tree import compile_tree

NO_MOTION = "no motion: markers hidden"
OUTSIDE = "outside the time of the forces"
NO_FORCE = "a force is missing"
EDGE = "edge of the filter"
UNMEASURED = "a contact that no plate measures, such as one leg off the plates"
WINDOW = 0.2  # Time over which force must be missing to count as a contact beside the plates [s]
MISSING_WEIGHT = 0.15  # Share of the body's weight that must be missing
UNLOADED = 20.0  # Force under which a center of pressure may be unknown [N]
FLIGHT = 0.05  # Share of the body's weight under which nothing touches
# Share of the body's weight by which plates and stated mass may differ without a word
MASS_TOLERANCE = 0.03
REACH = 0.75
"""How far a filter's ends and gaps reach, times 1 / cutoff: nearer, motion and forces disagree by
more than noise.
"""
MAX_FORCE_DISTANCE = 0.25
"""Distance of forces from where they should act, over the body's extent from its base, that no
masses explain.
"""
# Cutoff, over that of the recording, of the motion whose rows are filtered after they are made
FINER = 3.0
# Largest turn of any body against the base over which a motion counts as standing still [rad]
MIN_ROTATION = 0.1


@dataclass(frozen=True)
class RecordingOptions:
    """Options that bring motion and forces together.

    Attributes
    ----------
    cutoff : cutoff frequency of the low-pass filter of coordinates and forces [Hz]; 0 for none, as
        in OpenSim; by default it is chosen by the noise of the motion, and smooth motions are not
        filtered (`choose_cutoff`)
    min_duration : minimum duration of usable frames, all recordings together [s]
    """

    cutoff: float | None = None
    min_duration: float = 0.5

    def __post_init__(self) -> None:
        if self.cutoff is not None and not 0.0 <= self.cutoff < float("inf"):
            raise BadData(
                f"cutoff {self.cutoff} Hz: expected a positive frequency, or 0 for no filter"
            )


@dataclass(frozen=True, eq=False)
class Usable:
    """A recording on one clock, with the frames that can be used and what became of the others.

    Attributes
    ----------
    name : of the recording
    recording : motion with derivatives, wrenches at its times, and which frames to use
    left_out : reason to number of frames, each frame under its first reason
    frames : that were given
    flight : frames of those used in which nothing touches, so that the wrench is truly zero
    weighs : mass that the forces say, where the motion is the model's [kg]
    notes : what looks wrong, one line each
    """

    recording: Recording
    left_out: Mapping[str, int]
    frames: int
    flight: int
    weighs: float
    name: str = ""
    notes: tuple[Message, ...] = field(default=())

    @property
    def cutoff(self) -> float | None:
        """Of the filter of motion and forces [Hz]; None where nothing was filtered."""
        return None if self.recording.finer is None else self.recording.finer.cutoff

    @property
    def use(self) -> np.ndarray:
        """(frames,) which frames of the recording are used."""
        used = self.recording.use
        return np.ones(len(self.recording.motion), bool) if used is None else used


@read_only
class Balance:
    """The wrench about the base that a motion needs, and the one that was measured.

    Attributes
    ----------
    needed, measured : (frames, 6) moment about the base and force [N m], [N]; needed by the model's
        masses, brought to the body's
    needed_up, measured_up : (frames,) upward force of each [N]
    weight : of the body [N]
    """

    needed: Array
    measured: Array
    needed_up: Array
    measured_up: Array
    weight: float

    @classmethod
    def of(cls, model: Model, recording: Recording, mass: float) -> Balance:
        """Compute both wrenches.

        Parameters
        ----------
        model : scaled to the body
        recording : on one clock
        mass : of the body [kg]

        Raises
        ------
        BadData : the model has no gravity
        """
        needed = needed_wrench(model, recording.motion) * (mass / model.mass)
        measured = base_wrench(model, recording.motion, recording.wrenches)
        return cls(
            needed=needed,
            measured=measured,
            needed_up=_up(model, needed),
            measured_up=_up(model, measured),
            weight=mass * float(np.linalg.norm(model.gravity)),
        )

    @property
    def missing_up(self) -> Array:
        """(frames,) upward force that nothing measured [N]."""
        return self.needed_up - self.measured_up


def usable(  # page: a recording, and what is known of it, all of it optional
    model: Model,
    motion: Motion,
    wrenches: Wrenches,
    *,
    mass: float | None = None,
    time: tuple[float, float] | None = None,
    name: str = "the recording",
    options: RecordingOptions | None = None,
) -> Usable:
    """Motion and forces through the same filter on one clock, and the frames that can be used.

    A contact beside the plates shows in the vertical force that the motion needs, by the model's
    masses brought to `mass`, less the one measured: where its mean over `WINDOW` passes
    `MISSING_WEIGHT` of the body's weight, and half that window around, the frames are left out.

    Parameters
    ----------
    model : scaled to the body
    options : cutoff [Hz] and shortest duration [s]; see `RecordingOptions`
    motion : coordinates as recorded; derivatives are taken here
    wrenches : as recorded, on their own clock; NaN where missing
    mass : of the subject [kg]; the model's by default
    time : start and end of what is to be used, cut after filtering [s]
    name : of the recording, for what is said about it

    Returns
    -------
    motion with derivatives, wrenches at its times, which frames are used, and why others are not

    Raises
    ------
    BadData : no common time, no force at all, or plates tared with the load on them

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> import numpy as np
    >>> time = np.arange(0.0, 2.0, 0.01)
    >>> angles = np.column_stack([np.sin(3.0 * time), 1.0 + 0.8 * np.sin(5.0 * time)])
    >>> motion = mm.Motion(time, model.coordinate_names, angles)
    >>> moved = mm.differentiate(motion)
    >>> at = mm.joint_reactions(model, moved, None, joints=["shoulder"], frame="ground")
    >>> wrenches = mm.Wrenches(time, ("shoulder",), ("upper",), at.forces, at.points, at.moments)
    >>> recording = mm.usable(model, motion, wrenches)
    >>> int(recording.use.sum()), round(recording.weighs, 3)
    (200, 4.0)
    """
    options = options or RecordingOptions()
    mass = model.mass if mass is None else mass
    smoothed = _smoothed(model, motion, options)
    motion = smoothed.filled(motion)
    whole = smoothed.motion if time is None else cut(smoothed.motion, *time)
    recording = _on_one_clock(name, motion, whole, wrenches, smoothed.cutoff)
    recording = replace(recording, seen_noise=smoothed.noise(motion))
    outside = {OUTSIDE: len(whole) - len(recording.motion)}
    balance = Balance.of(model, recording, mass)

    marks = _marked(motion, wrenches, recording, balance, smoothed.cutoff)
    so_far = _unmarked(name, len(whole), outside, marks)
    _refuse_tared(name, balance.needed_up[so_far], balance.measured_up[so_far], balance.weight)
    known = ~(marks[NO_MOTION] | marks[NO_FORCE])
    clock = recording.motion.time
    marks[UNMEASURED] = _unmeasured(clock, balance.missing_up, known, balance.weight)
    use = ~np.any(list(marks.values()), axis=0)
    filtered = _filtered(name, model, motion, recording, wrenches)
    judged = balance if filtered is recording else Balance.of(model, filtered, mass)
    _refuse_elsewhere(name, model, recording.motion, judged, use)

    flight = use & (np.abs(balance.measured_up) < FLIGHT * balance.weight)
    # Where every frame seems to lack a contact, the best carried ones say what the mass may be.
    say = use if use.any() else _best_carried(clock, balance, known)
    weighs = mass * _mean_ratio(balance, say)
    return Usable(
        recording=replace(recording, use=use),
        left_out=FrozenMap(_counted(outside, marks)),
        frames=len(whole),
        flight=int(flight.sum()),
        weighs=weighs,
        name=name,
        notes=_notes_of_mass(name, weighs, mass),
    )


def _smoothed(model: Model, motion: Motion, options: RecordingOptions) -> SmoothedMotion:
    """Differentiate a motion by the stated filter, or the one that its noise asks for.

    Measured forces are not asked what is noise: masses, which are not known yet, part them from
    the motion as well.

    Parameters
    ----------
    model : whose torques count
    motion : coordinates as recorded
    options : with the cutoff
    """
    if options.cutoff is None:
        return smoothed_by(motion, choose_cutoff(motion, model))
    return differentiated_at(motion, options.cutoff or None)


def _on_one_clock(
    name: str, motion: Motion, whole: Motion, wrenches: Wrenches, cutoff: float | None
) -> Recording:
    """Bring motion and forces through the same filter to the motion's times.

    Parameters
    ----------
    name : of the recording
    motion : coordinates as recorded
    whole : the same with derivatives, as far as it is to be used
    wrenches : as recorded, on their own clock; NaN where missing
    cutoff : of the filter [Hz]; None filters nothing

    Raises
    ------
    BadData : no common time, or no force at all
    """
    common = _in_common(name, whole, wrenches)
    lacking = _lacking(wrenches)
    if lacking.all():
        raise BadData(
            f"{name}: the forces hold no finite value: give the file that the plates wrote"
        )
    filled = _filled(wrenches, lacking)
    at = resample_wrenches(filled, common.time, cutoff)
    if cutoff is None:
        return Recording(motion=common, wrenches=at)
    little = FINER * cutoff
    fine = cut(differentiate(motion, little), common.time[0], common.time[-1])
    fine_wrenches = resample_wrenches(filled, common.time, little)
    finer = Finer(motion=fine, wrenches=fine_wrenches, cutoff=cutoff)
    return Recording(motion=common, wrenches=at, finer=finer)


def _filtered(
    name: str, model: Model, motion: Motion, recording: Recording, wrenches: Wrenches
) -> Recording:
    """Filter what nobody filtered, so that forces are not blamed for noise of the motion.

    Parameters
    ----------
    name : of the recording
    model : whose torques count
    motion : coordinates as recorded
    recording : on one clock
    wrenches : as recorded, on their own clock; NaN where missing

    Returns
    -------
    the recording itself where it is filtered or smooth
    """
    if recording.finer is not None:
        return recording
    asked = choose_cutoff(motion, model).cutoff
    if asked is None:
        return recording
    clock = recording.motion.time
    filtered = cut(differentiate(motion, asked), float(clock[0]), float(clock[-1]))
    return _on_one_clock(name, motion, filtered, wrenches, asked)


def _marked(
    motion: Motion,
    wrenches: Wrenches,
    recording: Recording,
    balance: Balance,
    cutoff: float | None,
) -> dict[str, np.ndarray]:
    """Mark frames without motion, without a force, or near an end that the filter blurs.

    Parameters
    ----------
    motion, wrenches : as recorded
    recording : both on one clock
    balance : of the recording
    cutoff : of the filter [Hz]; None for none

    Returns
    -------
    reason to (frames,) whether it applies
    """
    clock = recording.motion.time
    margin = 0.0 if cutoff is None else REACH / cutoff
    edge = np.zeros(len(clock), bool)
    if margin:
        edge = _near(clock, _ends(motion, wrenches), margin)
    return {
        NO_MOTION: ~np.isfinite(balance.needed_up),
        NO_FORCE: _near(clock, wrenches.time[_lacking(wrenches)], margin),
        EDGE: edge,
    }


def _unmarked(
    name: str, frames: int, outside: Mapping[str, int], marks: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Find the frames without a reason to leave them out.

    Parameters
    ----------
    name : of the recording
    frames : of its motion
    outside : frames off the common clock, by reason
    marks : reason to (frames,) whether it applies

    Returns
    -------
    (frames,)

    Raises
    ------
    BadData : there are none
    """
    unmarked: np.ndarray = ~np.any(list(marks.values()), axis=0)
    if not unmarked.any():
        left_out = _listed(_counted(outside, marks))
        raise BadData(f"{name}: none of the {frames} frames can be used: {left_out}")
    return unmarked


def _mean_ratio(balance: Balance, frames: np.ndarray) -> float:
    """Divide the mean measured force by the needed one, in chosen frames (frames,)."""
    if not frames.any():
        return float("nan")
    return float(balance.measured_up[frames].mean() / balance.needed_up[frames].mean())


def _notes_of_mass(name: str, weighs: float, mass: float) -> tuple[Message, ...]:
    """Report forces that weigh the body otherwise than stated.

    Parameters
    ----------
    name : of the recording
    weighs : mass that the forces say [kg]
    mass : that was stated [kg]
    """
    if not abs(weighs / mass - 1.0) > MASS_TOLERANCE:
        return ()
    return (
        WEIGHT.message(
            f"{name}: the forces correspond to {weighs:.1f} kg, but the specified mass is"
            f" {mass:.1f}: a plate's zero or gain is off, a load is carried, or the mass is wrong"
        ),
    )


def _in_common(name: str, motion: Motion, wrenches: Wrenches) -> Motion:
    """Cut the motion to the time during which forces were recorded."""
    within = (motion.time >= wrenches.time[0] - 1e-9) & (motion.time <= wrenches.time[-1] + 1e-9)
    if within.sum() < 2:
        raise BadData(
            f"{name}: motion ({motion.time[0]:g} to {motion.time[-1]:g} s) and forces"
            f" ({wrenches.time[0]:g} to {wrenches.time[-1]:g} s) have no time in common"
        )
    return cut(motion, float(motion.time[within][0]), float(motion.time[within][-1]))


def all_left_out(recordings: tuple[Usable, ...]) -> Mapping[str, int]:
    """Sum the frames of all recordings that were left out, by reason."""
    return sum((Counter(recording.left_out) for recording in recordings), Counter[str]())


def check_excited(
    model: Model, recordings: tuple[Usable, ...], options: RecordingOptions | None = None
) -> None:
    """Refuse recordings that are too short or in which the body does not move.

    Parameters
    ----------
    model : scaled to the body
    recordings : all together
    options : shortest duration [s]; see `RecordingOptions`

    Raises
    ------
    BadData : all recordings together are too short, or no body rotates by `MIN_ROTATION` against
        the base
    """
    options = options or RecordingOptions()
    seconds = sum(
        float(recording.use.sum()) * _step(recording.recording.motion.time)
        for recording in recordings
    )
    if seconds < options.min_duration:
        counts = all_left_out(recordings)
        total = sum(recording.frames for recording in recordings)
        raise BadData(
            f"{seconds:.2g} s of motion can be used, fewer than {options.min_duration:g}: of"
            f" {total} frames {_listed(counts) or 'none'} are left out; record more steps on the"
            " plates, or choose another --time"
            + "".join(f"; {note}" for recording in recordings for note in recording.notes)
        )
    turn = max(_largest_turn(model, recording.recording) for recording in recordings)
    if turn < MIN_ROTATION:
        raise BadData(
            f"the motion is not exciting: no body turns more than {np.degrees(turn):.1f} degrees"
            f" against the '{model.body_names[0]}' in {seconds:.2g} s; masses show only while limbs"
            " and trunk move"
        )


def needed_wrench(model: Model, motion: Motion) -> Array:
    """Compute the wrench that the motion needs with the model's own masses.

    Parameters
    ----------
    model : with masses
    motion : with derivatives

    Returns
    -------
    (frames, 6) moment about the base and force [N m], [N]
    """
    parameters = inertial_parameters(model).ravel()
    return np.concatenate([block.rows @ parameters for block in regressor_blocks(model, motion)])


def _up(model: Model, wrench: Array) -> Array:
    """Project the force of a wrench on the vertical.

    Parameters
    ----------
    wrench : (frames, 6) moment and force

    Returns
    -------
    (frames,) upward force [N]

    Raises
    ------
    BadData : the model has no gravity
    """
    size = float(np.linalg.norm(model.gravity))
    if size == 0.0:
        raise BadData(f"model '{model.name}' has no gravity, so forces do not determine its mass")
    return -(wrench[:, 3:] @ np.asarray(model.gravity)) / size


def _lacking(wrenches: Wrenches) -> np.ndarray:
    """Find samples without a force, a torque, or the position of a force that counts.

    Returns
    -------
    (samples,)
    """
    known = np.isfinite(wrenches.forces).all(axis=2) & np.isfinite(wrenches.torques).all(axis=2)
    unplaced = ~np.isfinite(wrenches.points).all(axis=2)
    loaded = np.linalg.norm(np.nan_to_num(wrenches.forces), axis=2) > UNLOADED
    return (~known | (loaded & unplaced)).any(axis=1)


def _filled(wrenches: Wrenches, lacking: np.ndarray) -> Wrenches:
    """Hold missing samples at the next known one, so that a filter can pass over them.

    Parameters
    ----------
    lacking : (samples,) which are missing
    """
    if not lacking.any():
        return wrenches
    known = np.flatnonzero(~lacking)
    samples = np.arange(len(lacking))
    index = known[np.searchsorted(known, samples).clip(max=len(known) - 1)]
    return replace(
        wrenches,
        forces=wrenches.forces[index],
        points=wrenches.points[index],
        torques=wrenches.torques[index],
    )


def _near(time: Array, places: Array, margin: float) -> np.ndarray:
    """Find frames near some times: within the margin and half a frame.

    Parameters
    ----------
    time : (frames,) [s]
    places : (times,) ascending [s]
    margin : [s]

    Returns
    -------
    (frames,)
    """
    if len(places) == 0:
        return np.zeros(len(time), bool)
    after = np.searchsorted(places, time).clip(max=len(places) - 1)
    nearest = np.minimum(
        np.abs(places[after] - time), np.abs(places[(after - 1).clip(min=0)] - time)
    )
    return nearest <= margin + 0.5 * _step(time)


def _ends(motion: Motion, wrenches: Wrenches) -> Array:
    """Collect times at which motion or forces begin or end, gaps included.

    Returns
    -------
    (times,) ascending [s]
    """
    seen = np.concatenate([[False], np.isfinite(motion.values).all(axis=1), [False]])
    first = np.flatnonzero(~seen[:-1] & seen[1:])
    after = np.flatnonzero(seen[:-1] & ~seen[1:])
    return np.sort(
        np.concatenate([motion.time[first], motion.time[after - 1], wrenches.time[[0, -1]]])
    )


def _step(time: Array) -> float:
    return float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def _refuse_tared(name: str, needed: Array, measured: Array, weight: float) -> None:
    """Refuse a plate that was zeroed under load.

    Most of the weight is missing then, always the same.

    Parameters
    ----------
    needed, measured : (frames,) upward force [N]
    weight : of the body [N]

    Raises
    ------
    BadData : on average half of the weight or more is missing, and it varies by no more than
        `MISSING_WEIGHT` of the weight
    """
    lacking = needed - measured
    if lacking.mean() < 0.5 * weight or lacking.std() > MISSING_WEIGHT * weight:
        return
    raise BadData(
        f"{name}: the plates measure {measured.mean():.0f} N on average where the body needs"
        f" {needed.mean():.0f}: they were set to zero (tared) with the load on them, or the subject"
        " is not on them; record again with empty plates at the start, or add the missing weight"
        " to the forces"
    )


def _refuse_elsewhere(
    name: str, model: Model, motion: Motion, balance: Balance, use: np.ndarray
) -> None:
    """Refuse forces so far from the body that they belong elsewhere.

    They are another recording's, or in another frame.

    Parameters
    ----------
    balance : of the recording
    use : (frames,) which frames are used

    Raises
    ------
    BadData : the lever of the missing moment exceeds `MAX_FORCE_DISTANCE` of the body's extent
    """
    if not use.any():
        return
    missing_moments = (balance.needed - balance.measured)[use, :3]
    arm = float(np.nanmedian(np.linalg.norm(missing_moments, axis=1))) / balance.weight
    tree = compile_tree(model)
    first = tree.coordinates_of(motion)[np.flatnonzero(use)[:1]]
    origins = forward_kinematics(tree, first).origins[0, 1:]
    size = float(np.linalg.norm(origins - origins[0], axis=1).max())
    if arm > MAX_FORCE_DISTANCE * size:
        raise BadData(
            f"{name}: the forces act {arm:.2f} m from where the body of this motion could stand on"
            " them: do they belong to this recording, and have motion and forces the same ground"
            " and clock?"
        )


def _unmeasured(time: Array, lacking: Array, known: np.ndarray, weight: float) -> np.ndarray:
    """Find frames in which something beside the plates must carry the body.

    So much force is missing for so long: more than `MISSING_WEIGHT` over `WINDOW`.

    Parameters
    ----------
    time : (frames,) [s]
    lacking : (frames,) upward force that is missing [N]
    known : (frames,) whether motion and forces are known
    weight : of the body [N]

    Returns
    -------
    (frames,)
    """
    frames = max(1, round(WINDOW / max(_step(time), 1e-9)))
    share = np.where(known, lacking / weight, 0.0)
    counted = scipy.ndimage.uniform_filter1d(known.astype(np.float64), frames)
    mean = scipy.ndimage.uniform_filter1d(share, frames) / np.maximum(counted, 1e-9)
    return (
        scipy.ndimage.binary_dilation(
            known & (mean > MISSING_WEIGHT), iterations=max(1, frames // 2)
        )
        & known
    )


def _best_carried(time: Array, balance: Balance, known: np.ndarray) -> np.ndarray:
    """Find the tenth of the known frames around which plates carry most of what the body needs.

    Parameters
    ----------
    time : (frames,) [s]
    balance : of the recording
    known : (frames,) whether motion and forces are known

    Returns
    -------
    (frames,)
    """
    frames = max(1, round(WINDOW / max(_step(time), 1e-9)))
    carried = scipy.ndimage.uniform_filter1d(np.where(known, balance.measured_up, 0.0), frames)
    weighed = scipy.ndimage.uniform_filter1d(np.where(known, balance.needed_up, 1.0), frames)
    share = np.where(known, carried / np.maximum(weighed, 1.0), -np.inf)
    return known & (share >= np.quantile(share[known], 0.9)) if known.any() else known


def _counted(first: Mapping[str, int], marks: Mapping[str, np.ndarray]) -> dict[str, int]:
    """Count frames by reason, each under the first that it has.

    Parameters
    ----------
    first : counts that come before
    marks : reason to (frames,) whether it applies

    Returns
    -------
    reason to number of frames; reasons without frames are left out
    """
    counts = dict(first)
    taken = np.zeros(len(next(iter(marks.values()))), bool)
    for reason, marked in marks.items():
        counts[reason] = int((marked & ~taken).sum())
        taken |= marked
    return {reason: count for reason, count in counts.items() if count}


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} ({reason})" for reason, count in counts.items())


def _largest_turn(model: Model, recording: Recording) -> float:
    """Compute the largest angle by which any body rotates against the base.

    Returns
    -------
    angle from the first usable pose [rad]
    """
    tree = compile_tree(model)
    values = tree.coordinates_of(recording.motion)[recording.use]
    if not len(values):
        return 0.0
    rotations = forward_kinematics(tree, values[:: max(1, len(values) // 200)]).rotations[:, 1:]
    against = np.einsum("fji,fbjk->fbik", rotations[:, 0], rotations)
    cosine = 0.5 * (np.einsum("bik,fbik->fb", against[0], against) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())

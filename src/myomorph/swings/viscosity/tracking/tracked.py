"""Motion, wrench and warnings of every trial, filtered to equations; options of tracking."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.motion.clocks import Clock
from myomorph.core.motion.filters import differentiate
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.swings.motion import (
    LimbMotion,
    differentiate_joint,
    lengthening,
    limb_motion,
    on_moving_base,
)
from myomorph.swings.viscosity.swings.plate import CUTOFF, lowpass_runs
from myomorph.swings.viscosity.swings.recording import (
    REACH,
    SwingRecording,
    near,
    swing_numbers,
    whole_frames,
)
from myomorph.swings.viscosity.tracking.held import Slip, mean_rotation


@dataclass(frozen=True)
class TrackingOptions:
    """How bones are followed.

    Attributes
    ----------
    cluster : maximum difference of the distance between two markers of a bone from the model's [m];
        larger ones trigger a warning
    slip : maximum rotation of the base or of a held joint [rad]; larger ones trigger a warning
    shift : maximum translation of the base [m]; larger ones trigger a warning
    center : joint center; "motion": the point about which the limb rotates; "model": the model's,
        which is also used if the limb hardly rotates
    max_center_distance : maximum distance of these two centers [m]; larger ones trigger a warning
    clock : estimate offset and drift of the plate's clock relative to the markers' from the swing
    find_contact : detect frames in which, by the wrench, something other than the joint supports
        the limb
    contact_threshold : share of the swing's largest change of force above which a residual is a
        contact
    """

    cluster: float = 0.006
    slip: float = 0.035
    shift: float = 0.002
    center: Literal["model", "motion"] = "motion"
    max_center_distance: float = 0.005
    clock: bool = True
    find_contact: bool = True
    contact_threshold: float = 0.1

    def __post_init__(self) -> None:
        for name in ("cluster", "slip", "shift", "max_center_distance", "contact_threshold"):
            if not getattr(self, name) > 0.0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected above 0")


@read_only
class TrackedTrial:
    """A trial as motion and wrench on the markers' clock, neither filtered.

    Attributes
    ----------
    name : of the trial
    motion : of the joint's coordinates [rad], NaN where too few markers are seen
    wrench : (frames, 6) on the base [N m], [N], NaN where the plate did not record
    touched : (frames,) whether something besides the joint carries the limb
    rms : (frames,) of the distances between markers and model [m]
    clock : the plate's against the markers', as taken
    notes : a line each
    origin : (3,) mean point of the plate's wrench from the joint's center, in ground [m]
    sway : (frames, 6) of a base that goes to and fro (`held.base_sway`), else (0, 6)
    """

    name: str
    motion: Motion
    wrench: Array
    touched: np.ndarray
    rms: Array
    clock: Clock
    notes: tuple[str, ...] = ()
    origin: Array = field(default_factory=lambda: np.zeros(3))
    sway: Array = field(default_factory=lambda: np.zeros((0, 6)))


@dataclass(frozen=True, eq=False)
class TrackedSpecimen:
    """The trials of one condition.

    Attributes
    ----------
    specimen : its base fixed where it stood, held joints locked as they were
    trials : in order
    held : values of the held joints [rad or m]
    slips : what moved all the same
    notes : a line each
    """

    specimen: Specimen
    trials: tuple[TrackedTrial, ...]
    held: Mapping[str, float]
    slips: tuple[Slip, ...]
    notes: tuple[str, ...] = ()


SWAYING = ("x", "y", "z", "about x", "about y", "about z")
MIN_ROTATION = 0.005  # Angle between two turns under which the limb counts as still [rad].


@read_only
class _Filtered:
    """A trial on the way.

    Attributes
    ----------
    motion : with derivatives
    limb : in this motion
    wrench : (frames, 6) through the same filter [N m], [N]
    whole : (frames,) whether ends and gaps are out of the filter's reach
    """

    motion: Motion
    limb: LimbMotion
    wrench: Array
    whole: np.ndarray


def swing_recordings(
    tracked: TrackedSpecimen, cutoff: float | None, muscles: bool = True
) -> tuple[SwingRecording, ...]:
    """Make the equations of [S] step 1 to 3 from the trials of one condition.

    Motion and wrench pass the same low-pass. The rest of `angles` is the mean rotation over the
    free swings of all trials, one for the condition. Frames at ends and gaps, as far as the filter
    reaches, and frames in which the limb is touched have swing -1.

    Parameters
    ----------
    tracked : the trials
    cutoff : of the low-pass [Hz], None for none
    muscles : whether J_M is wanted

    Raises
    ------
    BadData : no trial holds a frame of free swing
    """
    specimen = tracked.specimen
    trials = tracked.trials
    made = [_filtered(specimen, trial, cutoff) for trial in trials]
    # Hands were found at `CUTOFF`; a lower one smears them further.
    further = max(0.0, 0.5 * REACH * (1.0 / cutoff - 1.0 / CUTOFF)) if cutoff else 0.0
    touched = [near(trial.touched, trial.motion.time, further) for trial in trials]
    free = [parts.whole & ~hands for parts, hands in zip(made, touched, strict=True)]
    if not any(frames.any() for frames in free):
        names = ", ".join(trial.name for trial in trials)
        lacking = "has a frame of free swing with motion and wrench, beyond the reach of the filter"
        raise BadData(f"none of the trials {names} {lacking}: record longer, or raise the cutoff")
    rest = _rest(specimen, made, free)
    recordings = (
        _recording(specimen, *parts, rest, muscles)
        for parts in zip(trials, made, free, strict=True)
    )
    return tuple(replace(recording, cutoff=cutoff) for recording in recordings)


def _filtered(specimen: Specimen, trial: TrackedTrial, cutoff: float | None) -> _Filtered:
    """Pass a trial through the low-pass."""
    motion = differentiate_joint(specimen, trial.motion, cutoff)
    wrench = lowpass_runs(trial.wrench, motion.rate, cutoff)
    finite = np.asarray(np.isfinite(motion.values).all(axis=1) & np.isfinite(wrench).all(axis=1))
    limb = swung_limb(specimen, motion, trial.sway, cutoff)
    return _Filtered(motion, limb, wrench, whole_frames(motion.time, finite, cutoff))


def swung_limb(specimen: Specimen, motion: Motion, sway: Array, cutoff: float | None) -> LimbMotion:
    """Move the limb, on a base that may go to and fro.

    Parameters
    ----------
    specimen : with the limb
    motion : of the joint, with derivatives
    sway : (frames, 6) of the base, (0, 6) where it stands
    cutoff : of the sway's low-pass [Hz]

    Returns
    -------
    the limb in motion
    """
    limb = limb_motion(specimen, motion)
    if not len(sway):
        return limb
    return on_moving_base(specimen, limb, differentiate(Motion(motion.time, SWAYING, sway), cutoff))


def _rest(specimen: Specimen, made: list[_Filtered], free: list[np.ndarray]) -> Array:
    """Find the mean rotation (3, 3) of a ball in free swing, or the mean angle (1,) of a hinge."""
    if len(specimen.joint_coordinates) == 1:
        angles = np.concatenate(
            [parts.motion.values[use, 0] for parts, use in zip(made, free, strict=True)]
        )
        return np.array([angles.mean() if len(angles) else 0.0])
    rotations = np.concatenate(
        [parts.limb.rotations[use] for parts, use in zip(made, free, strict=True)]
    )
    return mean_rotation(rotations) if len(rotations) else np.eye(3)


def _angles(specimen: Specimen, filtered: _Filtered, rest: Array) -> Array:
    """Find the angles (frames, axes) from the rest [rad]."""
    if len(specimen.joint_coordinates) == 1:
        return filtered.motion.values - rest
    angles = np.full((len(filtered.motion), 3), np.nan)
    seen = np.isfinite(filtered.limb.rotations).all(axis=(1, 2))
    angles[seen] = Rotation.from_matrix(rest.T @ filtered.limb.rotations[seen]).as_rotvec()
    return angles


def _swung(
    specimen: Specimen, filtered: _Filtered, angles: Array, free: np.ndarray
) -> tuple[Array, Array]:
    """Find how far the limb is out, and its rate, by which swings are told from each other.

    Of a ball that is how far the direction that hangs down on average is out sideways, along the
    main direction of the swing, however much the limb twists about it meanwhile.

    Returns
    -------
    (frames,) each [rad], [rad/s] of a hinge, else [1], [1/s]
    """
    if len(specimen.joint_coordinates) == 1 or not free.any():
        return angles[:, 0], filtered.limb.rates[:, 0]
    gravity = np.asarray(specimen.model.gravity) / np.linalg.norm(specimen.model.gravity)
    rotations = filtered.limb.rotations
    down = (gravity @ rotations[free]).mean(axis=0)
    lever = rotations @ (down / np.linalg.norm(down))
    speed = np.cross(np.einsum("fij,fj->fi", rotations, filtered.limb.rates), lever)
    level = speed[free] - np.outer(speed[free] @ gravity, gravity)
    main = np.linalg.eigh(level.T @ level)[1][:, -1]
    return lever @ main, speed @ main


def _recording(
    specimen: Specimen,
    trial: TrackedTrial,
    filtered: _Filtered,
    free: np.ndarray,
    rest: Array,
    muscles: bool,
) -> SwingRecording:
    """Make the equations of one trial."""
    angles = _angles(specimen, filtered, rest)
    names = tuple(specimen.muscles) if muscles else ()
    none = np.zeros((len(filtered.motion), 0, len(specimen.axes)))
    arms = lengthening(specimen, filtered.motion, filtered.limb.slopes) if muscles else none
    return SwingRecording(
        name=trial.name,
        time=np.array(filtered.motion.time),
        wrench_rows=filtered.limb.wrench_rows,
        wrench=np.array(filtered.wrench),
        torque_rows=filtered.limb.torque_rows,
        rates=filtered.limb.rates,
        angles=angles,
        axes=specimen.axes,
        muscles=names,
        lengthening=arms,
        rotations=filtered.limb.rotations,
        gravity=np.array(specimen.model.gravity),
        swing=swing_numbers(*_swung(specimen, filtered, angles, free), free, MIN_ROTATION),
        strands=(
            tuple(i for i, muscle in enumerate(specimen.muscles.values()) for _ in muscle)
            if muscles
            else ()
        ),
        origin=trial.origin,
        hinges=specimen.hinges,
    )

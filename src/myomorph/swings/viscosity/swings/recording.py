"""One recording of a limb that swings from a base, as linear equations, and its free frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter1d

from myomorph.core.model.arrays import Array, checked_array, read_only, runs

PARAMETERS = 10


REACH = 2.0
"""How far ends, gaps and hands reach through the filter, times 1 / cutoff: what is left of the ends
there changes the viscosity of virtual limbs without noise by 0.02 %, with 1.5 by 0.08 % and with
0.75 by 0.3 %.
"""

WINDOW = 0.1  # Time over which a mismatch is averaged before it counts as a hand on the limb [s].
OUTLYING = 6.0  # Standard deviations of the usual mismatch, from which it may be a hand.

ROUNDS = 12

SAMPLES = 3000  # Frames of a trial that take part in the robust fit, at most.


@read_only
class SwingRecording:
    """What one trial says of the limb, everything distal of the joint taken as one rigid link.

    With the link's inertial parameters phi (10,) in [D] order, about the joint's center and along
    the axes of its first body (the humerus),

        wrench = wrench_rows @ phi                       (the base is fixed: [S] step 1)
        torque = torque_rows @ phi                       (joint torque by inverse dynamics)
        torque = -d rates - lengthening^T d_M lengthening rates     (passive: [S] eq. 1-3, signs as
        in ours)

    Attributes
    ----------
    name : of the trial
    time : (frames,) [s]
    wrench_rows : (frames, 6, 10) moment about the joint's center and force, in ground axes
    wrench : (frames, 6) measured on the base, filtered as the motion [N m], [N]
    torque_rows : (frames, axes, 10) moment about the joint's center along the joint's free axes
    rates : (frames, axes) angular velocity of the limb against the base about those axes [rad/s]
    angles : (frames, axes) rotation vector (ball) or angle (hinge) from hanging at rest [rad]
    axes : names of the free axes: "x", "y", "z" of the limb's first body for a ball; one for a
        hinge
    muscles : names
    lengthening : (frames, strands, axes) d(length)/d(angle), J_M of [S] eq. 3 [m/rad]; a muscle's n
        strands share its viscosity evenly, so the rows of each are divided by the root of n
    strands : the number of the muscle that each row of `lengthening` belongs to; () for one row a
        muscle
    rotations : (frames, 3, 3) of the limb's first body in ground
    gravity : (3,) in ground [m/s^2]
    swing : (frames,) number of the swing, from release to release or from one turn to the next but
        one; -1 where the limb was touched or something is missing: such frames are not used
    origin : (3,) center of the plate from the joint's center, in ground, about which its gains work
        [m]
    hinges : (2, 3) of a ball turned by three angles one after another, the first axis, fixed in the
        base, along ground, and the last along the limb's axes; (0, 3) where there are none
    cutoff : of the low-pass that motion and wrench passed [Hz]
    resisting : (frames, axes) what the joint resists, in the place of `rates` where these do not
        describe it [rad/s]; (0, axes) where they do
    """

    name: str
    time: Array
    wrench_rows: Array
    wrench: Array
    torque_rows: Array
    rates: Array
    angles: Array
    axes: tuple[str, ...]
    muscles: tuple[str, ...]
    lengthening: Array
    rotations: Array
    gravity: Array
    swing: np.ndarray
    strands: tuple[int, ...] = ()
    origin: Array = field(default_factory=lambda: np.zeros(3))
    hinges: Array = field(default_factory=lambda: np.zeros((0, 3)))
    cutoff: float | None = None
    resisting: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        frames = len(self.time)
        axes = len(self.axes)
        shapes = {
            "wrench_rows": (frames, 6, PARAMETERS),
            "wrench": (frames, 6),
            "torque_rows": (frames, axes, PARAMETERS),
            "rates": (frames, axes),
            "angles": (frames, axes),
            "lengthening": (frames, len(self.strands or self.muscles), axes),
            "rotations": (frames, 3, 3),
            "swing": (frames,),
            "origin": (3,),
            "hinges": (len(self.hinges), 3),
            "resisting": (len(self.resisting), axes if len(self.resisting) else 0),
        }
        for name, shape in shapes.items():
            checked_array(getattr(self, name), shape, f"{name} of swing '{self.name}'")

    def __len__(self) -> int:
        return len(self.time)

    @property
    def used(self) -> np.ndarray:
        """(frames,) whether a frame takes part in identification."""
        return self.swing >= 0

    @property
    def resisted(self) -> Array:
        """(frames, axes) `resisting`, or `rates` where there is none."""
        return self.resisting if len(self.resisting) else self.rates

    @property
    def strands_of(self) -> Array:
        """(strands, muscles) 1 where a row of `lengthening` belongs to a muscle."""
        count = len(self.muscles)
        return np.eye(count)[np.array(self.strands or range(count), np.int64)]


def near(flags: np.ndarray, time: Array, distance: float) -> np.ndarray:
    """Spread flags in time.

    Parameters
    ----------
    flags : (frames,)
    time : (frames,) [s]
    distance : within which a frame counts as flagged [s]

    Returns
    -------
    (frames,)
    """
    frames = round(distance / float(np.median(np.diff(time)))) if len(time) > 1 else 0
    return binary_dilation(flags, iterations=frames) if frames > 0 else flags.copy()


def whole_frames(time: Array, finite: np.ndarray, cutoff: float | None) -> np.ndarray:
    """Find finite frames out of the reach of ends and gaps through the filter.

    Parameters
    ----------
    time : (frames,) [s]
    finite : (frames,)
    cutoff : of the filter [Hz], None for none

    Returns
    -------
    (frames,)
    """
    lacking = np.concatenate([[True], ~finite, [True]])
    if cutoff is None or len(time) < 2:
        return ~lacking[1:-1]
    step = float(np.median(np.diff(time)))
    wide = np.concatenate([[time[0] - step], time, [time[-1] + step]])
    return ~near(lacking, wide, REACH / cutoff)[1:-1]


class CarriedLimb(NamedTuple):
    """A trial in which something besides the joint may carry the limb.

    Attributes
    ----------
    time : (frames,) [s]
    rows : (frames, 6, 10) of the wrench
    wrench : (frames, 6) [N m], [N]
    candidates : (frames,) that take part
    """

    time: Array
    rows: Array
    wrench: Array
    candidates: np.ndarray


def touched_frames(trials: Sequence[CarriedLimb], share: float, reach: float) -> list[np.ndarray]:
    """Find where something besides the joint carries the limb.

    While nobody touches the limb, force = rows phi + constant with one phi over all trials. A
    robust fit finds phi from the frames that agree, which must be the most; frames whose mismatch,
    averaged over `WINDOW`, passes both `OUTLYING` of its usual size and a share of what the swing's
    force varies are touched. Moments show nothing: a joint carries hardly any, whether the limb is
    held or not.

    Parameters
    ----------
    trials : of one condition
    share : of the force's variation
    reach : within which neighbors count as touched [s]

    Returns
    -------
    (frames,) of each trial
    """
    mismatch, largest = force_mismatch(
        [trial.rows[:, 3:, :4] for trial in trials],
        [trial.wrench[:, 3:] for trial in trials],
        [trial.candidates for trial in trials],
    )
    result = []
    for misfit, trial in zip(mismatch, trials, strict=True):
        use = trial.candidates
        time = trial.time
        error = np.where(use[:, None], misfit, 0.0)
        frames = max(1, round(WINDOW / float(np.median(np.diff(time))))) if len(time) > 1 else 1
        count = np.maximum(uniform_filter1d(use.astype(float), frames), 1.0 / frames)
        size = np.linalg.norm(uniform_filter1d(error, frames, axis=0) / count[:, None], axis=1)
        usual = float(np.median(size[use])) if use.any() else 0.0
        result.append(near(use & (size > max(OUTLYING * usual, share * largest)), time, reach))
    return result


def force_mismatch(
    rows: Sequence[Array], forces: Sequence[Array], candidates: Sequence[np.ndarray]
) -> tuple[list[Array], float]:
    """Compare measured forces with those that one limb needs in all trials.

    Parameters
    ----------
    rows : (frames, 3, 4) of each trial, of unit mass and first moments
    forces : (frames, 3) measured [N]
    candidates : (frames,) that take part

    Returns
    -------
    measured less predicted (frames, 3) of each trial, and how far the predicted one moves from its
    mean [N]
    """
    x = _robust(rows, forces, candidates)
    wanted = [Y @ x[:4] + x[4 + 3 * index : 7 + 3 * index] for index, Y in enumerate(rows)]
    seen = [force[use] for force, use in zip(wanted, candidates, strict=True) if use.any()]
    moving = [np.linalg.norm(force - force.mean(axis=0), axis=1) for force in seen]
    largest = float(np.quantile(np.concatenate(moving), 0.98)) if moving else 0.0
    return [force - expected for force, expected in zip(forces, wanted, strict=True)], largest


def _robust(
    rows: Sequence[Array], forces: Sequence[Array], candidates: Sequence[np.ndarray]
) -> Array:
    """Fit mass, first moments and a constant force of each trial (4 + 3 trials,).

    Least absolute errors first, then weights that forget what is far off.
    """
    chosen = [np.flatnonzero(use)[:: max(1, int(use.sum()) // SAMPLES)] for use in candidates]
    tables = []
    for index, (Y, frames) in enumerate(zip(rows, chosen, strict=True)):
        constant = np.zeros((len(frames), 3, 3 * len(rows)))
        constant[:, np.arange(3), 3 * index + np.arange(3)] = 1.0
        tables.append(np.concatenate([Y[frames], constant], axis=2))
    A = np.concatenate(tables)
    b = np.concatenate([force[frames] for force, frames in zip(forces, chosen, strict=True)])
    trust = np.ones(len(A))
    for turn in range(2 * ROUNDS):
        root = np.sqrt(trust)[:, None]
        weighted = (A * root[..., None]).reshape(-1, A.shape[2])
        x = np.linalg.lstsq(weighted, (b * root).ravel(), rcond=1e-9)[0]
        far = np.linalg.norm(b - A @ x, axis=1)
        scale = max(float(np.median(far)), 1e-9 * float(np.abs(b).max(initial=1e-9)))
        if turn < ROUNDS:
            trust = 1.0 / np.maximum(far, scale)
        else:
            trust = 1.0 / np.square(1.0 + np.square(far / (3.0 * scale)))
    return np.asarray(x)


def swing_numbers(angle: Array, rate: Array, free: np.ndarray, least: float) -> np.ndarray:
    """Find the numbers of the swings of the dominant rotation.

    In every unbroken run of free frames a swing lasts from one turn to the next but one; the first
    begins with the release. What follows the last turn is cut into pieces as long as the swings
    before.

    Parameters
    ----------
    angle, rate : (frames,) [rad], [rad/s]
    free : (frames,) whether the limb is
    least : a turn counts if the limb has come so far from the turn before [rad]

    Returns
    -------
    (frames,) -1 where the limb is not free
    """
    numbers = np.full(len(angle), -1)
    following = 0
    for start, stop in runs(free):
        turns = _turns(angle[start:stop], rate[start:stop], least)
        starts = [0, *turns[1::2]] if turns else [0]
        usual = int(np.median(np.diff(turns))) * 2 if len(turns) > 1 else 0
        if usual:
            while stop - start - starts[-1] > 1.75 * usual:
                starts.append(starts[-1] + usual)
            if len(starts) > 1 and stop - start - starts[-1] < usual // 2:
                starts.pop()
        numbers[start:stop] = (
            following + np.searchsorted(starts, np.arange(stop - start), side="right") - 1
        )
        following += len(starts)
    return numbers


def _turns(angle: Array, rate: Array, least: float) -> list[int]:
    """Find frames at which the limb turns back, more than `least` between one and the next."""
    turns: list[int] = []
    last = angle[0]
    for frame in np.flatnonzero(np.diff(np.signbit(rate))) + 1:
        if abs(angle[frame] - last) > least:
            turns.append(int(frame))
            last = angle[frame]
    return turns

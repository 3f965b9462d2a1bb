"""Errors of the muscles' attachments in the interval of their viscosity.

Attachments come from another body unless they were digitized on the specimen. Their error is the
largest source of d_M's error budget. It is an error in a variable: what moves an arm at random
makes its square larger on average, so d_M comes out too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.fit.interval_rule import half_width, reflected_limits
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.interval import Interval
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.rigid.coordinates import Ints
from myomorph.swings.viscosity.identification.budget import ErrorShare
from myomorph.swings.viscosity.identification.identify import (
    Condition,
    MuscleViscosity,
    SpecimenViscosity,
)
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.swings.motion import differentiate_joint, lengthening, limb_motion
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen, TrackedTrial
from myomorph.swings.viscosity.trust.moment_arms import MomentArmOptions

SOURCE = "attachments"  # Name of this source in the error budget.
RESULT = "muscle_viscosity"  # The result that it adds to, as in `cohort.QUANTITIES`.
LEAST = 0.05  # A drawn d_M is not counted as smaller than this share of the one that was found.
MAX_FRAMES = 40  # Of each trial: arms change slowly.
SAMPLES = 64  # Of the arms of each strand, from which draws take one.
AGAIN = 2  # Times that points are moved once more in each sample.
BATCH = 50  # Draws at a time.


@read_only
class MovedArms:
    """Moment arms in frames of free swings, with points of muscles moved at random.

    A move is one of all points of a strand on one bone. Strands move independently of each other,
    so a draw takes any sample of each.

    Attributes
    ----------
    torque : (frames, axes) by inverse dynamics, with what the joint resists added [N m]
    rates : (frames, axes) [rad/s]
    arms : (frames, strands, axes) as `SwingRecording.lengthening` [m/rad]
    samples : (1 + `AGAIN`, samples, frames, strands, axes) of the arms: with points moved, then
        with the same points moved once more, several times
    spring : (axes, frames, k) orthonormal columns that a spring and a constant torque explain
    """

    torque: Array
    rates: Array
    arms: Array
    samples: Array
    spring: Array

    def drawn(self, chosen: Ints, times: int) -> Array:
        """Find d_M with points that are moved.

        Parameters
        ----------
        chosen : (draws, strands) sample of each strand
        times : 0 for points that are moved, from 1 for one of the ways in which they are moved once
            more

        Returns
        -------
        (draws,) at least 0 [N s/m]
        """
        strands = np.arange(chosen.shape[1])
        return np.concatenate(
            [
                self.common(self.samples[times][part, :, strands].swapaxes(1, 2))
                for part in np.split(chosen, range(BATCH, len(chosen), BATCH))
            ]
        )

    def common(self, arms: Array) -> Array:
        """Find d_M, one value of all muscles.

            u = sum_m J_m (J_m . w),    d_M = -u . torque / u . u

        Parameters
        ----------
        arms : (draws, frames, strands, axes) [m/rad]

        Returns
        -------
        (draws,) at least 0 [N s/m]
        """
        speeds = np.einsum("dfsa,fa->dfs", arms, self.rates)
        torques = np.einsum("dfsa,dfs->daf", arms, speeds)
        explained = np.einsum("afk,daf->dak", self.spring, torques)
        torques = torques - np.einsum("afk,dak->daf", self.spring, explained)
        power = -np.einsum("daf,fa->d", torques, self.torque)
        square = np.square(torques).sum(axis=(1, 2))
        return np.maximum(power, 0.0) / np.maximum(square, 1e-300)


def with_attachments(
    specimen_viscosity: SpecimenViscosity,
    shares: Sequence[ErrorShare],
    tracked: TrackedSpecimen | None,
    options: MomentArmOptions,
    level: float,
) -> tuple[SpecimenViscosity, tuple[ErrorShare, ...]]:
    """Put errors of attachments into d_M's interval, and add this source to the error budget.

    The model's points hold errors already. Draws move them once more: by how much d_M then changes,
    in its logarithm, is by how much the value is off from the truth (`reflected_limits`). So the
    interval reaches farther up than down.

    Parameters
    ----------
    specimen_viscosity : with intervals of all other sources
    shares : the error budget
    tracked : trials with muscles; None where there are none
    options : sizes of the errors
    level : of the intervals

    Returns
    -------
    the specimen and the budget
    """
    muscles = specimen_viscosity.muscles
    intact = specimen_viscosity.intact
    bare = specimen_viscosity.without
    given = muscles is not None and intact is not None and bare is not None and tracked is not None
    if not given or options.offset <= 0.0:
        return specimen_viscosity, tuple(shares)
    assert muscles is not None
    assert intact is not None
    assert bare is not None
    assert tracked is not None
    try:
        moved = moved_arms(tracked, intact, bare.viscosity.value, options)
    except MyomorphError as error:
        notes = [f"d_M's interval holds no errors of attachments: {error}"]
        return specimen_viscosity.changed({}, notes), tuple(shares)
    limits = attachment_limits(moved, options.draws, options.seed, level)
    if limits is None:
        return specimen_viscosity, tuple(shares)
    wider = _wider(muscles, limits)
    z = float(half_width(1.0, level))
    sd = muscles.common.value * (limits.high - limits.low) / (2.0 * z)
    return replace(specimen_viscosity, muscles=wider), _with_share(
        shares, _share(muscles.common, sd, options.offset, z)
    )


def attachment_limits(moved: MovedArms, draws: int, seed: int, level: float) -> Interval | None:
    """Find the limits of d_M's truth over its value, and the middle between them.

    Parameters
    ----------
    moved : arms of the swings
    draws : how many
    seed : of the random numbers
    level : of the limits

    Returns
    -------
    middle and limits as shares of the value; None where swings show no viscosity of muscles
    """
    value = float(moved.common(moved.arms[None])[0])
    if not value > 0.0:
        return None
    random = np.random.default_rng(seed)
    chosen = random.integers(moved.samples.shape[1], size=(draws, moved.arms.shape[1]))
    times = range(1, len(moved.samples))
    once = _logarithms(moved.drawn(chosen, 0), value)
    again = np.array([_logarithms(moved.drawn(chosen, number), value) for number in times])
    low, high = reflected_limits(0.0, once, level, again=again)
    middle = -float(np.median(once))
    return Interval(value=float(np.exp(middle)), low=float(np.exp(low)), high=float(np.exp(high)))


def _logarithms(draws: Array, value: float) -> Array:
    """Take the logarithm of drawn viscosities over a value, none of them too small."""
    return np.asarray(np.log(np.maximum(draws / value, LEAST)))


def moved_arms(
    tracked: TrackedSpecimen, intact: Condition, joint: float, options: MomentArmOptions
) -> MovedArms:
    """Move the points of muscles in the free swings of all trials.

    Parameters
    ----------
    tracked : trials with muscles
    intact : what was identified of them
    joint : d_J [N m s/rad]
    options : sizes of the errors, and whether a spring is fitted beside the viscosity
    """
    pairs = zip(tracked.trials, intact.recordings, strict=True)
    swings = [
        _SwingFrames.of(tracked.specimen, trial, recording)
        for trial, recording in pairs
        if recording.used.any()
    ]
    rows = np.concatenate([one.torque_rows for one in swings])
    resisted = np.concatenate([one.resisted for one in swings])
    spring = _spring_columns(np.concatenate([one.angles for one in swings]), options.stiffness)
    torque = rows @ intact.parameters + joint * resisted
    explained = np.einsum("afk,fa->ak", spring, torque)
    return MovedArms(
        torque=torque - np.einsum("afk,ak->fa", spring, explained),
        rates=np.concatenate([one.rates for one in swings]),
        arms=np.concatenate([one.lengthening for one in swings]),
        samples=_samples(tracked.specimen, swings, options),
        spring=spring,
    )


@read_only
class _SwingFrames:
    """Some frames of free swings of a trial.

    Attributes
    ----------
    angles, rates, resisted, torque_rows, lengthening : as in `SwingRecording`
    values : (frames, coordinates) of the joint [rad]
    slopes : (frames, axes, coordinates) as in `LimbMotion`
    """

    angles: Array
    rates: Array
    resisted: Array
    torque_rows: Array
    lengthening: Array
    values: Array
    slopes: Array

    @classmethod
    def of(cls, specimen: Specimen, trial: TrackedTrial, recording: SwingRecording) -> _SwingFrames:
        """Choose frames of a trial, evenly.

        Parameters
        ----------
        specimen : that swings
        trial : its motion
        recording : the equations made of it
        """
        motion = differentiate_joint(specimen, trial.motion, recording.cutoff)
        used = np.flatnonzero(recording.used)
        chosen = used[:: -(-len(used) // MAX_FRAMES)]
        return cls(
            angles=recording.angles[chosen],
            rates=recording.rates[chosen],
            resisted=recording.resisted[chosen],
            torque_rows=recording.torque_rows[chosen],
            lengthening=recording.lengthening[chosen],
            values=motion.values[chosen],
            slopes=limb_motion(specimen, motion).slopes[chosen],
        )


def _samples(
    specimen: Specimen, swings: Sequence[_SwingFrames], options: MomentArmOptions
) -> Array:
    """Draw moment arms with points of muscles moved, see `MovedArms.samples`."""
    values = np.concatenate([one.values for one in swings])
    slopes = np.concatenate([one.slopes for one in swings])
    # Arms depend on the pose alone: frames of all trials may follow each other at any time.
    motion = Motion(np.arange(float(len(values))), specimen.joint_coordinates, values)
    random = np.random.default_rng(options.seed)
    model = specimen.model
    once = [_moved_points(model, options.offset, random) for _ in range(SAMPLES)]
    again = [[_moved_points(each, options.offset, random) for each in once] for _ in range(AGAIN)]
    return np.array(
        [
            [lengthening(replace(specimen, model=each), motion, slopes) for each in models]
            for models in (once, *again)
        ]
    )


def _moved_points(model: Model, sd: float, random: np.random.Generator) -> Model:
    """Move the points of each strand, all on one bone alike.

    Surfaces that muscles wrap around, and points that functions move, stay.

    Parameters
    ----------
    model : with the muscles
    sd : of each component of a move [m]
    random : generator, which advances
    """
    return replace(model, muscles=tuple(_moved_strand(each, sd, random) for each in model.muscles))


def _moved_strand(muscle: Muscle, sd: float, random: np.random.Generator) -> Muscle:
    """Move the points of one strand, see `_moved_points`."""
    bones = dict.fromkeys(point.body for point in muscle.path.points)
    moves = {body: sd * random.standard_normal(3) for body in bones}
    points = tuple(
        replace(point, location=np.add(point.location, moves[point.body]))
        if isinstance(point, PathPoint)
        else point
        for point in muscle.path.points
    )
    return replace(muscle, path=replace(muscle.path, points=points))


def _spring_columns(angles: Array, stiffness: bool) -> Array:
    """Find what a spring and a constant torque of each axis explain.

    Parameters
    ----------
    angles : (frames, axes) [rad]
    stiffness : whether they are fitted beside the viscosity

    Returns
    -------
    (axes, frames, 2) orthonormal columns, (axes, frames, 0) where they are not fitted
    """
    frames, axes = angles.shape
    if not stiffness:
        return np.zeros((axes, frames, 0))
    columns = [np.column_stack([angle, np.ones(frames)]) for angle in angles.T]
    return np.array([np.linalg.qr(each)[0] for each in columns])


def _wider(muscles: MuscleViscosity, limits: Interval) -> MuscleViscosity:
    """Put errors of attachments beside the others of the values of all muscles together.

    Parameters
    ----------
    muscles : with intervals of all other sources
    limits : of the truth over the value, by attachments alone
    """

    def wider(estimate: Interval) -> Interval:
        middle = limits.value * estimate.value
        down = estimate.value * (limits.value - limits.low)
        up = estimate.value * (limits.high - limits.value)
        low = middle - float(np.hypot(estimate.value - estimate.low, down))
        high = middle + float(np.hypot(estimate.high - estimate.value, up))
        return Interval(estimate.value, max(low, 0.0), high)

    return replace(muscles, common=wider(muscles.common), by_pcsa=wider(muscles.by_pcsa))


def _share(others: Interval, sd: float, offset: float, z: float) -> ErrorShare:
    """Find the share of attachments in the variance of d_M.

    Parameters
    ----------
    others : d_M with intervals of all other sources
    sd : that attachments make [N s/m]
    offset : of each component of an attachment [m]
    z : half-width of an interval over its standard deviation
    """
    rest = ((others.high - others.low) / (2.0 * z)) ** 2
    total = rest + sd**2
    return ErrorShare(
        source=SOURCE,
        prior_sd=offset,
        quantity=RESULT,
        sd=sd,
        share=sd**2 / total if total > 0.0 else 0.0,
    )


def _with_share(shares: Sequence[ErrorShare], added: ErrorShare) -> tuple[ErrorShare, ...]:
    """Add a source to the error budget, of which the others have less."""
    others = tuple(
        replace(each, share=each.share * (1.0 - added.share))
        if each.quantity == added.quantity
        else each
        for each in shares
    )
    return (*others, added)

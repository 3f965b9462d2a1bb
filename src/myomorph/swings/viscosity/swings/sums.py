"""Swings condensed to sums of products, block by block.

From these every step and every resampling is solved. A block is a few successive swings of one
trial. Whatever is fitted by least squares to a choice of blocks needs only the sums over those
blocks, so a draw of the bootstrap costs no pass over the frames. Blocks fade into each other over
half their length: cut off sharply, each would hold the noise of the limb's energy at its two ends,
which cancels in the whole because the next block holds it too, but would count as scatter between
blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.swings.friction import friction_rows
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording

SPEED_THRESHOLD = 0.1
EXPLAINED = 0.8
"""A direction is still whose rate is below this share of the fastest's and whose acceleration the
state explains less than this. Only noise is measured there; it would say that the inertia is small,
and a possible body's other inertias with it. White noise below a cutoff explains 0.56 of its own
second derivative.
"""
NOISY = 0.25
"""Share of noise in the squares of a direction's rates below which it is not still, whatever
explains its acceleration: what dry friction holds and lets go moves by no law of the state. In
simulated balls it is 0.8 and more of noise alone, 0.16 and less of such motion.
"""
WHITE = 5.0 / 3.0
"""Variance of a rate times (2 pi cutoff)^2, over that of the acceleration: of angles with white
noise below a cutoff.
"""


WRENCH = PARAMETERS
PREDICTED = PARAMETERS + 1
ONE = 2 * PARAMETERS + 1
"""Columns of the products of a row of the wrench: parameters, the wrench itself, predicted rows, a
one.
"""

RATE, ANGLE, CONSTANT, PLATE, RESISTED, MUSCLES = range(PARAMETERS, PARAMETERS + 6)
"""Columns of the products of an axis' torque: parameters, rate, angle, a one, the plate's torque,
what the joint resists, then muscles.
"""


def free_directions(recordings: Sequence[SwingRecording]) -> Array:
    """Find the free axes in the limb's first body.

    Parameters
    ----------
    recordings : of one condition

    Returns
    -------
    (axes, 3)
    """
    left = np.zeros((3, 3))
    right = np.zeros((3, len(recordings[0].axes)))
    for recording in recordings:
        moments = moment_rows(recording)[recording.used]
        rows = recording.torque_rows[recording.used]
        left += np.einsum("fip,fjp->ij", moments, moments, optimize=True)
        right += np.einsum("fip,fap->ia", moments, rows, optimize=True)
    return np.asarray(np.linalg.lstsq(left, right, rcond=1e-12)[0].T, np.float64)


def moment_rows(swing_recording: SwingRecording) -> Array:
    """Find the moment about the joint's center that unit parameters need.

    Parameters
    ----------
    swing_recording : of a swing

    Returns
    -------
    (frames, 3, 10) along the limb's axes
    """
    return swing_recording.rotations.transpose(0, 2, 1) @ swing_recording.wrench_rows[:, :3]


class PredictedRows(NamedTuple):
    """The wrench rows of a recording, and their instruments.

    Attributes
    ----------
    rows : (frames, 6, 10) without the acceleration of directions in which the limb is still
    instruments : (frames, 6, 10) the same with the acceleration that the state predicts
    """

    rows: Array
    instruments: Array


def predicted_rows(
    recordings: Sequence[SwingRecording], frames: Sequence[np.ndarray]
) -> list[PredictedRows]:
    """Make rows with the measured acceleration, and with the one that the state predicts.

    A rigid limb on a joint with linear spring, damper and dry friction accelerates by I^-1 (m c x g
    - omega x I omega - d omega - k theta - c sign omega): linear in the direction of gravity, the
    products of the rates, the rates, their signs and the angles. The fit of the measured
    acceleration to these has hardly any of its noise, and what it has is not that of the
    acceleration at the same instant. Rows with it are the instruments of step 1 (Janot, Vandanjon,
    Gautier 2014): least squares on the rows themselves draws the parameters towards zero, because
    noise in a row counts as motion.

    Parameters
    ----------
    recordings : of one condition
    frames : of each, in which the law of the acceleration is fitted

    Returns
    -------
    of every recording
    """
    along = free_directions(recordings)
    states = [_state(recording) for recording in recordings]
    measured = [_accelerations(recording, along) for recording in recordings]
    A = np.concatenate([state[use] for state, use in zip(states, frames, strict=True)])
    b = np.concatenate([moment[use] for moment, use in zip(measured, frames, strict=True)])
    law = _acceleration_law(A, b)
    rates = np.concatenate(
        [recording.rates[use] for recording, use in zip(recordings, frames, strict=True)]
    )
    still = _still(rates, b, A @ law, recordings[0].cutoff)
    turning = np.eye(len(still)) - still
    result = []
    for recording, state, seen in zip(recordings, states, measured, strict=True):
        rows = recording.wrench_rows - _rows_of(recording.rotations, seen @ still @ along)
        change = (state @ law - seen) @ turning
        result.append(PredictedRows(rows, rows + _rows_of(recording.rotations, change @ along)))
    return result


def predicted_torque_rows(
    recordings: Sequence[SwingRecording], frames: Sequence[np.ndarray]
) -> list[Array]:
    """Make rows of the torque with the acceleration that the state predicts, see `predicted_rows`.

    Parameters
    ----------
    recordings : of one condition
    frames : of each, in which the law of the acceleration is fitted

    Returns
    -------
    (frames, axes, 10) of every recording
    """
    along = free_directions(recordings)
    return [
        along @ (recording.rotations.transpose(0, 2, 1) @ rows.instruments[:, :3])
        for recording, rows in zip(recordings, predicted_rows(recordings, frames), strict=True)
    ]


def unexplained_accelerations(recordings: Sequence[SwingRecording]) -> Array:
    """Find what the state of a limb on its joint leaves of the measured accelerations: their noise.

    Parameters
    ----------
    recordings : of one condition

    Returns
    -------
    (axes,) root mean square over the frames that are used [rad/s^2]
    """
    along = free_directions(recordings)
    A = np.concatenate([_state(recording)[recording.used] for recording in recordings])
    b = np.concatenate(
        [_accelerations(recording, along)[recording.used] for recording in recordings]
    )
    return np.sqrt(np.mean((b - A @ _acceleration_law(A, b)) ** 2, axis=0))


def _accelerations(swing_recording: SwingRecording, along: Array) -> Array:
    """Read angular accelerations from the rows, whose columns of I_xx, I_yy, I_zz hold them.

    Parameters
    ----------
    along : (axes, 3) free axes

    Returns
    -------
    (frames, axes) [rad/s^2]
    """
    return moment_rows(swing_recording)[:, [0, 1, 2], [4, 5, 6]] @ along.T


def _acceleration_law(states: Array, accelerations: Array) -> Array:
    """Fit accelerations (frames, axes) linearly to states (frames, n).

    Returns
    -------
    (n, axes)
    """
    size = np.sqrt(np.square(states).mean(axis=0))
    size = np.where(size > 0.0, size, 1.0)
    law = np.linalg.lstsq(states / size, accelerations, rcond=1e-9)[0] / size[:, None]
    return np.asarray(law)


def _still(rates: Array, measured: Array, predicted: Array, cutoff: float | None) -> Array:
    """Make the projection on the directions in which the limb is still.

    Parameters
    ----------
    rates : (frames, axes) [rad/s]
    measured, predicted : (frames, axes) acceleration [rad/s^2]
    cutoff : of the low-pass of both; None without one [Hz]

    Returns
    -------
    (axes, axes)
    """
    squares, directions = np.linalg.eigh(rates.T @ rates)
    seen = np.square(measured @ directions).sum(axis=0)
    left = np.square((measured - predicted) @ directions).sum(axis=0)
    still = (squares < SPEED_THRESHOLD**2 * squares[-1]) & (left > (1.0 - EXPLAINED) * seen)
    if cutoff is not None:
        still &= noise_of_rates(left, cutoff) > NOISY * squares
    return directions[:, still] @ directions[:, still].T


def noise_of_rates(accelerations: Array, cutoff: float) -> Array:
    """Find the noise in rates from that in their slopes, of angles with white noise below a cutoff.

    Parameters
    ----------
    accelerations : variance of their noise [rad^2/s^4]
    cutoff : of the low-pass [Hz]

    Returns
    -------
    variance of the noise of rates [rad^2/s^2], as many
    """
    return WHITE * accelerations / (2.0 * np.pi * cutoff) ** 2


def _state(swing_recording: SwingRecording) -> Array:
    """Put what accelerates a limb in columns (frames, n).

    These are gravity's direction, rates, their products, angles, dry friction and a one.
    """
    down = np.einsum("fji,j->fi", swing_recording.rotations, swing_recording.gravity)
    first, second = np.triu_indices(swing_recording.rates.shape[1])
    products = swing_recording.rates[:, first] * swing_recording.rates[:, second]
    constant = np.ones((len(swing_recording), 1))
    rubbing = friction_rows(swing_recording).reshape(len(swing_recording), -1)
    motion = swing_recording.rates, products, swing_recording.angles
    return np.hstack([down, *motion, rubbing, constant])


def _rows_of(rotations: Array, accelerations: Array) -> Array:
    """Find the part of the rows that angular accelerations make.

    Parameters
    ----------
    rotations : (frames, 3, 3) of the limb
    accelerations : (frames, 3) in the limb [rad/s^2]

    Returns
    -------
    (frames, 6, 10)
    """
    x, y, z = accelerations.T
    rows = np.zeros((len(rotations), 6, 10))
    moment = rows[:, :3]
    force = rows[:, 3:]
    moment[:, 0, 4] = x
    moment[:, 1, 5] = y
    moment[:, 2, 6] = z
    for axis, column, value in ((1, 7, z), (2, 7, y), (0, 8, z), (2, 8, x), (0, 9, y), (1, 9, x)):
        moment[:, axis, column] = value
    force[:, 0, 2] = -z
    force[:, 0, 3] = y
    force[:, 1, 1] = z
    force[:, 1, 3] = -x
    force[:, 2, 1] = -y
    force[:, 2, 2] = x
    return np.concatenate([rotations @ moment, rotations @ force], axis=1)


@read_only
class SwingSums:
    """Sums of products over blocks of swings.

    Attributes
    ----------
    names : of the trials
    axes, muscles : names
    trial : (blocks,) number of the trial of each
    frames : (blocks,) how many each has, one in a fade shared by two
    uses : the frames of each block's own swings, without fades
    wrench : (blocks, 6, 22, 22) of [wrench_rows, wrench, predicted_rows, 1], one matrix a row of
        the wrench
    torque : (blocks, axes, 15 + muscles, same) of [torque_rows, rate, angle, 1, plate, resisted,
        u]; plate is the moment that the plate measures about the axis, u_m = J_m J_m . rates the
        torque of muscle m of unit viscosity, sign turned
    directions : (axes, 3) free axes in the limb's first body
    still : frames left out because the limb hardly swung any more
    parted : sum of the squares of a frame's shares in its blocks, mean over the frames, 1 without
        fades: by so much sums of independent noise scatter between blocks of what they do in the
        whole
    """

    names: tuple[str, ...]
    axes: tuple[str, ...]
    muscles: tuple[str, ...]
    trial: np.ndarray
    frames: Array
    uses: tuple[np.ndarray, ...]
    wrench: Array
    torque: Array
    directions: Array
    still: int
    parted: float

    def __len__(self) -> int:
        return len(self.trial)

    @property
    def frames_of_trials(self) -> list[np.ndarray]:
        """Frames of all blocks of each trial, in order."""
        own = zip(self.trial, self.uses, strict=True)
        by_trial: list[list[np.ndarray]] = [[] for _ in self.names]
        for trial, use in own:
            by_trial[trial].append(use)
        return [np.concatenate([np.zeros(0, np.int64), *uses]) for uses in by_trial]

    def wrench_total(self, counts: Array) -> Array:
        """Add up the wrench's products of each trial.

        Parameters
        ----------
        counts : (blocks,) how often each counts

        Returns
        -------
        (trials, 6, 22, 22)
        """
        weight = (self.trial == np.arange(len(self.names))[:, None]) * counts
        flat = weight @ self.wrench.reshape(len(self), -1)
        return flat.reshape(len(self.names), *self.wrench.shape[1:])

    def torque_total(self, counts: Array) -> Array:
        """Add up the torque's products.

        Parameters
        ----------
        counts : (blocks,) how often each counts

        Returns
        -------
        (axes, n, n)
        """
        return (counts @ self.torque.reshape(len(self), -1)).reshape(self.torque.shape[1:])


def swing_sums(
    recordings: Sequence[SwingRecording], swings: int = 1, least: float = 0.1
) -> SwingSums:
    """Condense the recordings of one condition.

    Swings that are slower than others by far are left out: a limb at rest tells nothing of what
    resists motion, but its noise biases all.

    Parameters
    ----------
    recordings : of one condition
    swings : that follow each other and are one block
    least : root mean square rate below which a swing is left out, of that of the fastest

    Raises
    ------
    BadData : recordings do not belong together, or nothing swings freely
    """
    if not recordings:
        raise BadData("no recording of swings is given")
    for recording in recordings:
        _check(recordings[0], recording)
    parts = _parts(recordings)
    live = _live(recordings, parts, least)
    by_trial = [
        [use for number, use in live if number == trial] for trial in range(len(recordings))
    ]
    blocks = [
        block for trial, uses in enumerate(by_trial) for block in _blocks(uses, trial, swings)
    ]
    predicted = predicted_rows(
        recordings, [np.concatenate([np.zeros(0, np.int64), *uses]) for uses in by_trial]
    )
    along = free_directions(recordings)
    first = recordings[0]
    return SwingSums(
        names=tuple(recording.name for recording in recordings),
        axes=first.axes,
        muscles=first.muscles,
        trial=np.array([block.trial for block in blocks]),
        frames=np.array([block.weight.sum() for block in blocks]),
        uses=tuple(block.own for block in blocks),
        wrench=_wrenches(recordings, predicted, blocks),
        torque=_torques(recordings, along, blocks),
        directions=along,
        still=_count(parts) - _count(live),
        parted=_parted(blocks, _count(live)),
    )


_Parts = list[tuple[int, np.ndarray]]
"""Numbers of recordings, each with the frames of a swing."""


def _parts(recordings: Sequence[SwingRecording]) -> _Parts:
    """List all swings.

    Raises
    ------
    BadData : there is none
    """
    parts = [
        (number, use) for number, recording in enumerate(recordings) for use in _swings(recording)
    ]
    if not parts:
        names = ", ".join(recording.name for recording in recordings)
        advice = "release the limb without touching it, and check that its markers are seen"
        raise BadData(f"none of the trials {names} holds a frame of free swing: {advice}")
    return parts


def _live(recordings: Sequence[SwingRecording], parts: _Parts, least: float) -> _Parts:
    """List swings whose root mean square rate is at least this share of the fastest one's."""
    speeds = [
        np.sqrt(np.square(recordings[number].rates[use]).sum(axis=1).mean())
        for number, use in parts
    ]
    speed = np.array(speeds)
    return [part for part, fast in zip(parts, speed >= least * speed.max(), strict=True) if fast]


def _count(parts: _Parts) -> int:
    """Count the frames of swings."""
    return sum(len(use) for _, use in parts)


def _parted(blocks: Sequence[_Block], frames: int) -> float:
    """Find the mean over frames of the sum of the squares of their shares in blocks."""
    squares = np.concatenate([block.weight**2 for block in blocks])
    return float(squares.sum() / frames)


def _wrenches(
    recordings: Sequence[SwingRecording],
    predicted: Sequence[PredictedRows],
    blocks: Sequence[_Block],
) -> Array:
    """Condense the wrench of all blocks (blocks, 6, 22, 22)."""
    products = [
        _wrench_products(recordings[block.trial], predicted[block.trial], block) for block in blocks
    ]
    return np.stack(products)


def _torques(recordings: Sequence[SwingRecording], along: Array, blocks: Sequence[_Block]) -> Array:
    """Condense the torque of all blocks (blocks, axes, 15 + muscles, same)."""
    products = [_torque_products(recordings[block.trial], along, block) for block in blocks]
    return np.stack(products)


def _check(first: SwingRecording, swing_recording: SwingRecording) -> None:
    for name in ("axes", "muscles", "strands"):
        if getattr(swing_recording, name) != getattr(first, name):
            both = (
                f"{getattr(first, name)} and {getattr(swing_recording, name)}; one condition is one"
                " specimen"
            )
            raise BadData(
                f"swings '{first.name}' and '{swing_recording.name}' have other {name}: {both}"
            )
    for name in ("wrench_rows", "wrench", "torque_rows", "rates", "angles", "lengthening"):
        if not np.isfinite(getattr(swing_recording, name)[swing_recording.used]).all():
            whose = f"swing '{swing_recording.name}': {name}"
            raise BadData(f"{whose} is not finite in a frame that is used; mark it with swing -1")


def _swings(swing_recording: SwingRecording) -> list[np.ndarray]:
    """Find the frames of each swing."""
    swing = swing_recording.swing
    return [np.flatnonzero(swing == number) for number in np.unique(swing[swing_recording.used])]


@read_only
class _Block:
    """Frames of a trial in a block.

    Attributes
    ----------
    trial : number
    own : frames before blocks fade
    frames : all of them
    weight : (frames,) in the block
    """

    trial: int
    own: np.ndarray
    frames: np.ndarray
    weight: Array


def _blocks(trial_uses: list[np.ndarray], trial: int, swings: int) -> list[_Block]:
    """Make blocks of a trial, each fading into the next.

    A last block of less than half its swings joins the one before.
    """
    cuts = [trial_uses[i : i + swings] for i in range(0, len(trial_uses), swings)]
    if len(cuts) > 1 and 2 * len(cuts[-1]) < swings:
        cuts[-2] += cuts.pop()
    frames = [np.concatenate(cut) for cut in cuts]
    weights = [np.ones(len(use)) for use in frames]
    fades = []
    for position in range(len(frames) - 1):
        half = min(len(frames[position]), len(frames[position + 1])) // 2
        if half and frames[position][-half] + 2 * half - 1 == frames[position + 1][half - 1]:
            rise = 0.5 + 0.5 * np.sin(np.pi * (np.arange(2 * half) - half + 0.5) / (2.0 * half))
            weights[position][-half:] = 1.0 - rise[:half]
            weights[position + 1][:half] = rise[half:]
            fades.append((position, half, rise))
    whole = [[use] for use in frames]
    shares = [[weight] for weight in weights]
    for position, half, rise in fades:
        whole[position].append(frames[position + 1][:half])
        shares[position].append(1.0 - rise[half:])
        whole[position + 1].append(frames[position][-half:])
        shares[position + 1].append(rise[:half])
    return [
        _Block(trial, use[0], np.concatenate(use), np.concatenate(weight))
        for use, weight in zip(whole, shares, strict=True)
    ]


def _wrench_products(
    swing_recording: SwingRecording, predicted: PredictedRows, block: _Block
) -> Array:
    use = block.frames
    rows = predicted.rows[use]
    instruments = predicted.instruments[use]
    columns = [rows, swing_recording.wrench[use, :, None], instruments, np.ones((len(use), 6, 1))]
    return _products(np.concatenate(columns, axis=2), block.weight)


def _torque_products(swing_recording: SwingRecording, along: Array, block: _Block) -> Array:
    use = block.frames
    rates = swing_recording.rates[use]
    J = swing_recording.lengthening[use]
    speeds = np.einsum("fma,fa->fm", J, rates)
    sides = swing_recording.rotations[use], swing_recording.wrench[use, :3]
    plate = np.einsum("ai,fji,fj->fa", along, *sides, optimize=True)
    columns = [
        swing_recording.torque_rows[use],
        rates[:, :, None],
        swing_recording.angles[use, :, None],
        np.ones((*rates.shape, 1)),
        plate[:, :, None],
        swing_recording.resisted[use, :, None],
        (J * speeds[:, :, None]).transpose(0, 2, 1) @ swing_recording.strands_of,
    ]
    return _products(np.concatenate(columns, axis=2), block.weight)


def _products(columns: Array, weight: Array) -> Array:
    """Add up the products of columns (frames, rows, n) over weighted frames: (rows, n, n)."""
    by_row = columns.transpose(1, 0, 2)
    return by_row.transpose(0, 2, 1) @ (by_row * weight[:, None])


def eliminated(products: Array, columns: Sequence[int]) -> Array:
    """Take what some columns explain off all others; theirs become zero.

    The normal equations of the rest are then those of the fit with the given columns left free
    (Frisch and Waugh 1933; the Schur complement).

    Parameters
    ----------
    products : (..., n, n)
    columns : that explain

    Returns
    -------
    (..., n, n)
    """
    result = np.array(products)
    for column in columns:
        pivot = result[..., column, column]
        row = result[..., column, :]
        scale = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=pivot > 0.0)
        # What an earlier column explains wholly leaves rounding only.
        scale = np.where(pivot > 1e-12 * products[..., column, column], scale, 0.0)
        result = result - row[..., :, None] * row[..., None, :] * scale[..., None, None]
        result[..., column, :] = result[..., :, column] = 0.0
    return result

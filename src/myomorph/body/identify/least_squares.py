"""Recordings as rows [Y_B, constants, measured wrench], condensed to factors (`triangles`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.body.identify.base_parameters import BaseParameters
from myomorph.body.identify.triangles import absorb, fold
from myomorph.core.fit.noise import RecordingNoise
from myomorph.core.model.arrays import Array, checked_array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import lowpass
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.regressor import (
    BLOCK,
    base_regressor,
    base_wrench,
    reference_points,
    regressor_blocks,
)

FILTER_REACH = 3.0  # How far a filter's ends reach, times 1 / cutoff, until rounding
MIN_RUN = 8  # Frames in a row that are filtered
# A constant moment about the ground's origin and a constant force, as a plate's tare leaves
CONSTANTS = 6
UNWANTED = "left out by the user"
UNSEEN = "motion missing"
UNMEASURED = "force missing"


@kernel
def _fold_frames(R, i, Y, columns, constants, wrench, used, rows):
    """Turn row i of the base wrench in some frames into a factor, in place.

    Parameters
    ----------
    R : (n + 7, n + 7) factor of [Y_B, constants, wrench], changed in place
    i : row of the wrench, 0 to 5
    Y : (frames, 6, 10 bodies) regressor
    columns : (n,) columns of Y that count
    constants : (frames, 6, 6) rows of a constant wrench
    wrench : (frames, 6) measured [N m], [N]
    used : (used,) frames that count
    rows : (6, n + 7) scratch
    """
    n = columns.shape[0]
    for first in range(0, used.shape[0], 6):
        rows[:] = 0.0
        for row in range(min(6, used.shape[0] - first)):
            f = used[first + row]
            for j in range(n):
                rows[row, j] = Y[f, i, columns[j]]
            for j in range(6):
                rows[row, n + j] = constants[f, i, j]
            rows[row, n + 6] = wrench[f, i]
        fold(R, rows)


class Blocks(NamedTuple):
    """How a recording is taken apart.

    Attributes
    ----------
    reference : point in ground that moments are about [m]; None for the base's origin
    frames : that are taken at a time
    """

    reference: tuple[float, float, float] | None = None
    frames: int = BLOCK


class RowBlock(NamedTuple):
    """Equations of some frames.

    Attributes
    ----------
    frames : which they are
    rows : (frames, 6, 10 bodies) regressor
    wrench : (frames, 6) measured moment and force [N m], [N]
    constants : (frames, 6, 6) rows of a constant wrench about the ground's origin; None where they
        were not requested
    """

    frames: slice
    rows: Array
    wrench: Array
    constants: Array | None


@read_only
class Finer:
    """A motion and its forces with little filter: what they make is filtered after it is made.

    A filter of angles and one of forces do not agree: what rotates pulls by the square of its rate,
    which is faster than the angle. Rows and forces that pass the same filter afterwards do (Gautier
    1997).

    Attributes
    ----------
    motion : with velocities and accelerations
    wrenches : through the same filter as the motion
    cutoff : of the filter for rows and forces [Hz]
    """

    motion: Motion
    wrenches: Wrenches
    cutoff: float

    def passed(self, values: Array) -> Array:
        """Filter values, each unbroken run of finite frames by itself.

        Parameters
        ----------
        values : (frames, ...)

        Returns
        -------
        (frames, ...) NaN outside runs of at least `MIN_RUN` finite frames
        """
        flat = values.reshape(len(values), -1)
        result = np.full(flat.shape, np.nan)
        rate = 1.0 / float(np.median(np.diff(self.motion.time)))
        for start, stop in runs(np.asarray(np.isfinite(flat).all(axis=1))):
            if stop - start >= MIN_RUN:
                result[start:stop] = lowpass(flat[start:stop], rate, self.cutoff)
        return result.reshape(values.shape)


@read_only
class Recording:
    """One motion and the forces measured with it, on the same clock.

    Attributes
    ----------
    motion : with velocities and accelerations, through the same filter as the forces
    wrenches : every external force; NaN where one is missing
    use : (frames,) which frames count, e.g. those with both feet on plates; all where None
    finer : the same frames with little filter, from which masses are identified; None where nothing
        was filtered
    noise : of the motion's coordinates, as it is after the filter; None where it is not known
    seen_noise : as far as the recording shows it, which is a bound from below: skin is not in it
    """

    motion: Motion
    wrenches: Wrenches
    use: np.ndarray | None = None
    finer: Finer | None = None
    noise: RecordingNoise | None = None
    seen_noise: RecordingNoise | None = None

    def __post_init__(self) -> None:
        if self.use is not None:
            checked_array(self.use, (len(self.motion),), "`use`, one value a frame of the motion,")

    def moved(self, change: Callable[[Motion], Motion]) -> Recording:
        """Replace the motion, with both filters."""
        finer = (
            None if self.finer is None else replace(self.finer, motion=change(self.finer.motion))
        )
        return replace(self, motion=change(self.motion), finer=finer)

    @property
    def alike(self) -> float:
        """Frames that the filter makes say the same."""
        rate = 1.0 / float(np.median(np.diff(self.motion.time))) if len(self.motion) > 1 else 0.0
        return 1.0 if self.finer is None else max(1.0, 0.5 * rate / self.finer.cutoff)

    def rows(
        self, model: Model, blocks: Blocks | None = None, constants: bool = False
    ) -> Iterator[RowBlock]:
        """Yield the equations block by block.

        Parameters
        ----------
        model : whose regressor is built
        blocks : what moments are about, and frames at a time
        constants : whether to build the rows of a constant wrench too

        Yields
        ------
        equations, those of `finer` through its filter
        """
        blocks = blocks or Blocks()
        finer = self.finer
        if finer is None:
            measured = base_wrench(model, self.motion, self.wrenches, blocks.reference)
            for block in regressor_blocks(model, self.motion, *blocks):
                yield RowBlock(
                    frames=block.frames,
                    rows=block.rows,
                    wrench=measured[block.frames],
                    constants=_constants(block.reference) if constants else None,
                )
            return
        measured = base_wrench(model, finer.motion, finer.wrenches, blocks.reference)
        frames = len(finer.motion)
        margin = int(FILTER_REACH / finer.cutoff / float(np.median(np.diff(finer.motion.time)))) + 1
        for start in range(0, frames, blocks.frames):
            stop = min(start + blocks.frames, frames)
            around = slice(max(0, start - margin), min(frames, stop + margin))
            inner = slice(start - around.start, stop - around.start)
            motion = finer.motion.frames(around)
            rows = base_regressor(model, motion, blocks.reference)
            columns = [rows, measured[around, :, None]]
            if constants:
                columns.append(_constants(_points(model, motion, blocks)))
            passed = finer.passed(np.concatenate(columns, axis=2))[inner]
            size = rows.shape[2]
            yield RowBlock(
                frames=slice(start, stop),
                rows=passed[:, :, :size],
                wrench=passed[:, :, size],
                constants=passed[:, :, size + 1 :] if constants else None,
            )

    def missing(self, model: Model, parameters: Array) -> Array:
        """Compute the wrench that parameters need beyond the measured one.

        Parameters
        ----------
        model : with the joints of the motion
        parameters : (bodies, 10)

        Returns
        -------
        (frames, 6) moment about the base and force [N m], [N]
        """
        source = self if self.finer is None else self.finer
        blocks = regressor_blocks(model, source.motion)
        needed = np.concatenate([block.rows @ parameters.ravel() for block in blocks])
        left = needed - base_wrench(model, source.motion, source.wrenches)
        return left if self.finer is None else self.finer.passed(left)


@read_only
class Rows:
    """The equations of all frames, condensed.

    Attributes
    ----------
    factors : (6, n + 7, n + 7) triangular factor of [Y_B, constants, wrench] for each row of the
        wrench
    frames : number of frames that were used
    left_out : number of frames left out, by reason
    """

    factors: Array
    frames: int
    left_out: dict[str, int]

    @cached_property
    def plain(self) -> Array:
        """(6, n + 1, n + 1) triangular factors without the columns of constants."""
        n = self.factors.shape[2] - CONSTANTS - 1
        parts = np.delete(self.factors, np.s_[n : n + CONSTANTS], axis=2)
        return np.stack([absorb(np.zeros((n + 1, n + 1)), part) for part in parts])

    @property
    def wrench_rms(self) -> Array:
        """(6,) of what was measured [N m], [N]."""
        return np.sqrt(np.square(self.factors[:, :, -1]).sum(axis=1) / self.frames)

    @property
    def mean_force(self) -> Array:
        """(3,) of what was measured [N]."""
        # The columns of constants hold a one in every row of their own force.
        mean: Array = np.array(
            [self.factors[3 + i, :, -4 + i] @ self.factors[3 + i, :, -1] for i in range(3)]
        )
        return mean / self.frames

    def rms(self, solution: Array) -> Array:
        """Compute what parameters leave of the wrench.

        Parameters
        ----------
        solution : (n,) parameters, or (n + 6,) parameters and constants

        Returns
        -------
        (6,) root mean square [N m], [N]
        """
        x = np.zeros(self.factors.shape[2])
        x[: len(solution)] = solution
        x[-1] = -1.0
        return np.sqrt(np.square(self.factors @ x).sum(axis=1) / self.frames)


def gather(
    model: Model, recordings: Sequence[Recording], base: BaseParameters, blocks: Blocks
) -> Rows:
    """Condense recordings by QR, so that memory does not grow with the frames.

    Parameters
    ----------
    model : with the recordings' joints
    recordings : with derivatives of the motion
    base : whose columns of the regressor count
    blocks : what moments are about, and frames at a time

    Returns
    -------
    factors, and how many frames were used and left out

    Raises
    ------
    BadData : no frame can be used, or the base parameters do not fit the motion
    """
    n = len(base)
    factors = np.zeros((6, n + CONSTANTS + 1, n + CONSTANTS + 1))
    left_out = {UNWANTED: 0, UNSEEN: 0, UNMEASURED: 0}
    frames = 0
    for recording in recordings:
        for part in recording.rows(model, blocks, constants=True):
            missing = _missing(recording, part)
            for reason, marked in missing.items():
                left_out[reason] += int(marked.sum())
            used = np.flatnonzero(~np.any(list(missing.values()), axis=0))
            if not len(used):
                continue
            if not frames:
                _check_base(part.rows[used[0]], base)
            frames += len(used)
            _fold(factors, part, base.columns, used)
    if not frames:
        reasons = ", ".join(f"{reason}: {count}" for reason, count in left_out.items() if count)
        raise BadData(f"no frame can be used to identify ({reasons or 'there are none'})")
    return Rows(factors, frames, left_out)


def _missing(recording: Recording, part: RowBlock) -> dict[str, np.ndarray]:
    """Mark frames of a block that cannot be used, each under its first reason.

    Parameters
    ----------
    recording : says which frames are wanted
    part : of it

    Returns
    -------
    reason to (frames,) whether it applies
    """
    wanted = np.ones(len(part.rows), bool)
    if recording.use is not None:
        wanted = np.asarray(recording.use)[part.frames]
    # A sum, because a missing coordinate shows in it and costs no copy.
    moving = np.isfinite(part.rows.sum(axis=(1, 2)))
    pushed = np.isfinite(part.wrench).all(axis=1)
    return {
        UNWANTED: ~wanted,
        UNSEEN: wanted & ~moving,
        UNMEASURED: wanted & moving & ~pushed,
    }


def residuals(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    estimate: Array,
    blocks: Blocks,
) -> list[Array]:
    """Compute the wrench that base parameters leave of each recording.

    Parameters
    ----------
    model : with the recordings' joints
    recordings : with derivatives of the motion
    base : of the estimate
    estimate : (n,) base parameters
    blocks : what moments are about, and frames at a time

    Returns
    -------
    for each recording (frames, 6) [N m], [N]; NaN where not used
    """
    left = []
    for recording in recordings:
        residual = np.full((len(recording.motion), 6), np.nan)
        for part in recording.rows(model, blocks):
            residual[part.frames] = part.wrench - part.rows[:, :, base.columns] @ estimate
        if recording.use is not None:
            residual[~np.asarray(recording.use, bool)] = np.nan
        left.append(residual)
    return left


def _points(model: Model, motion: Motion, blocks: Blocks) -> Array:
    """Find the points (frames, 3) that moments are about, in ground [m]."""
    if blocks.reference is None:
        return reference_points(model, motion)
    return np.tile(np.asarray(blocks.reference, np.float64), (len(motion), 1))


def _constants(points: Array) -> Array:
    """Build the rows about points of a constant wrench about the origin.

    Parameters
    ----------
    points : (frames, 3) in ground [m]

    Returns
    -------
    (frames, 6, 6)
    """
    rows = np.tile(np.eye(6), (len(points), 1, 1))
    for i, a, b in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows[:, i, 3 + b] = -points[:, a]
        rows[:, i, 3 + a] = points[:, b]
    return rows


def _fold(factors: Array, part: RowBlock, columns: np.ndarray, used: np.ndarray) -> None:
    """Fold frames into the factor of each row of the wrench, the rows shared among the cores.

    Parameters
    ----------
    factors : (6, n + 7, n + 7), changed in place
    part : equations, with the rows of a constant wrench
    columns : (n,) of the regressor that count
    used : (used,) frames of the part that count
    """
    # Copies, because a kernel is compiled anew for arrays that are read-only or no whole ones.
    chosen = columns.copy()
    rows = np.ascontiguousarray(part.rows)
    wrench = np.ascontiguousarray(part.wrench)
    constants = np.ascontiguousarray(part.constants)

    def some(start: int, stop: int) -> None:
        scratch = np.empty((6, factors.shape[2]))
        for i in range(start, stop):
            _fold_frames(factors[i], i, rows, chosen, constants, wrench, used, scratch)

    over_frames(some, 6, chunk=1)


def _check_base(rows: Array, base: BaseParameters) -> None:
    """Refuse base parameters that do not give the rows of a motion.

    Parameters
    ----------
    rows : (6, 10 bodies) regressor of one frame

    Raises
    ------
    BadData : other coordinates rest than the base parameters assume
    """
    difference = np.abs(rows - rows[:, base.columns] @ base.combination).max()
    if difference > 1e-6 * np.abs(rows).max():
        raise BadData(
            "these base parameters do not fit the motion: coordinates that they hold still move or"
            f" rest at other values ({', '.join(list(base.held)[:4]) or 'none held'}); let fit_base"
            " make them"
        )

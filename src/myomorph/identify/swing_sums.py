"""Swings condensed to sums of products, block by block, from which every step and every resampling is solved.

A block is a few successive swings of one trial. Whatever is fitted by least squares to a choice of blocks needs
only the sums over those blocks, so a draw of the bootstrap costs no pass over the frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.identify.swings import PARAMETERS, SwingRecording
from myomorph.model.errors import BadData
from myomorph.model.spatial import Array

WRENCH, ONE = PARAMETERS, PARAMETERS + 1
"""Columns of the products of a row of the wrench: parameters, the wrench itself, a one."""

RATE, ANGLE, CONSTANT, MUSCLES = PARAMETERS, PARAMETERS + 1, PARAMETERS + 2, PARAMETERS + 3
"""Columns of the products of an axis' torque: parameters, rate, angle, a one, then one a muscle."""


@dataclass(frozen=True, eq=False)
class SwingSums:
    """Sums of products over blocks of swings.

    Attributes
    ----------
    names : of the trials
    trial : (blocks,) which trial a block belongs to
    frames : (blocks,) frames in a block
    wrench : (blocks, 6, 12, 12) of [wrench_rows, wrench, 1], one matrix a row of the wrench
    torque : (blocks, axes, 13 + muscles, 13 + muscles) of [torque_rows, rate, angle, 1, u], one matrix an
        axis, with u_m = J_m J_m . rates, the torque of muscle m of unit viscosity, sign turned
    """

    names: tuple[str, ...]
    axes: tuple[str, ...]
    muscles: tuple[str, ...]
    trial: np.ndarray
    frames: Array
    wrench: Array
    torque: Array

    def __len__(self) -> int:
        return len(self.trial)

    def wrench_total(self, counts: Array) -> Array:
        """(trials, 6, 12, 12) sums of each trial with every block taken `counts` (blocks,) times."""
        weight = (self.trial == np.arange(len(self.names))[:, None]) * counts
        flat = weight @ self.wrench.reshape(len(self), -1)
        return flat.reshape(len(self.names), *self.wrench.shape[1:])

    def torque_total(self, counts: Array) -> Array:
        """(axes, n, n) sums with every block taken `counts` (blocks,) times."""
        return (counts @ self.torque.reshape(len(self), -1)).reshape(self.torque.shape[1:])


def swing_sums(recordings: Sequence[SwingRecording], swings: int = 1) -> SwingSums:
    """The recordings of one condition as sums over blocks of `swings` successive swings.

    Raises
    ------
    BadData : no recording, no usable frame, numbers that are not finite, or recordings of other axes or muscles
    """
    if not recordings:
        raise BadData("no recording of swings is given")
    first = recordings[0]
    trial, frames, wrench, torque = [], [], [], []
    for number, one in enumerate(recordings):
        _check(first, one)
        for use in _blocks(one, swings):
            trial.append(number)
            frames.append(len(use))
            wrench.append(_wrench_products(one, use))
            torque.append(_torque_products(one, use))
    if not trial:
        raise BadData(
            f"none of the trials {', '.join(one.name for one in recordings)} holds a frame of free swing: "
            "release the limb without touching it, and check that its markers are seen"
        )
    return SwingSums(
        tuple(one.name for one in recordings),
        first.axes,
        first.muscles,
        np.array(trial),
        np.array(frames, float),
        np.stack(wrench),
        np.stack(torque),
    )


def _check(first: SwingRecording, one: SwingRecording) -> None:
    for name in ("axes", "muscles"):
        if getattr(one, name) != getattr(first, name):
            raise BadData(
                f"swings '{first.name}' and '{one.name}' have other {name}: {getattr(first, name)} and "
                f"{getattr(one, name)}; one condition is one specimen"
            )
    for name in ("wrench_rows", "wrench", "torque_rows", "rates", "angles", "lengthening"):
        lacking = ~np.isfinite(getattr(one, name)[one.used]).all()
        if lacking:
            raise BadData(f"swing '{one.name}': {name} is not finite in a frame that is used; mark it with swing -1")


def _blocks(one: SwingRecording, swings: int) -> list[np.ndarray]:
    """Frames of each block; a last block of less than half its swings joins the one before."""
    numbers = np.unique(one.swing[one.used])
    parts = [numbers[i : i + swings] for i in range(0, len(numbers), swings)]
    if len(parts) > 1 and 2 * len(parts[-1]) < swings:
        last = parts.pop()
        parts[-1] = np.concatenate([parts[-1], last])
    return [np.flatnonzero(np.isin(one.swing, part)) for part in parts]


def _wrench_products(one: SwingRecording, use: np.ndarray) -> Array:
    columns = np.concatenate(
        [one.wrench_rows[use], one.wrench[use, :, None], np.ones((len(use), 6, 1))], axis=2
    ).transpose(1, 0, 2)
    return columns.transpose(0, 2, 1) @ columns


def _torque_products(one: SwingRecording, use: np.ndarray) -> Array:
    rates, J = one.rates[use], one.lengthening[use]
    speeds = np.einsum("fma,fa->fm", J, rates)
    columns = np.concatenate(
        [
            one.torque_rows[use],
            rates[:, :, None],
            one.angles[use, :, None],
            np.ones((*rates.shape, 1)),
            (J * speeds[:, :, None]).transpose(0, 2, 1),
        ],
        axis=2,
    ).transpose(1, 0, 2)
    return columns.transpose(0, 2, 1) @ columns


def eliminated(products: Array, columns: Sequence[int]) -> Array:
    """Products (..., n, n) with what the given columns explain taken off all others; theirs become zero.

    The normal equations of the rest are then those of the fit with the given columns left free
    (Frisch and Waugh 1933; the Schur complement).
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

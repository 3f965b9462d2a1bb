"""Motions in parts, so that what is fitted to some is judged by the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.identify.base import Recording
from myomorph.identify.base_parameters import BaseParameters
from myomorph.identify.factors import absorb
from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.rigid.regressor import base_wrench, regressor_blocks

KINDS = ("moment", "force")
LEAST_PARTS = 4


@dataclass(frozen=True, eq=False)
class Parts:
    """What parts of recordings say of the base parameters, moments and forces apart.

    Attributes
    ----------
    base : what the factors are of
    factors : (parts, 2, n + 1, n + 1) triangular, |R (x, -1)|^2 is the squared misfit of base parameters x
        in the moments [N m] and the forces [N] of a part
    frames : (parts,)
    """

    base: BaseParameters
    factors: Array
    frames: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "factors", frozen_array(self.factors, (len(self.frames), 2, *self.factors.shape[2:])))

    def __len__(self) -> int:
        return len(self.frames)

    def rms(self, parameters: Array, parts: Sequence[int] | None = None) -> Array:
        """(2,) root mean square of the moment's and the force's misfit of parameters (bodies, 10) [N m], [N]."""
        chosen = np.arange(len(self)) if parts is None else np.asarray(parts)
        x = np.append(self.base.of(parameters), -1.0)
        squares = np.square(self.factors[chosen] @ x).sum(axis=(0, 2))
        result: Array = np.sqrt(squares / self.frames[chosen].sum())
        return result

    def rows(self, noise: Array, parts: Sequence[int] | None = None) -> tuple[Array, Array]:
        """(A (n, 10 bodies), b (n,)) of chosen parts: |A phi - b|^2 is their misfit in units of noise (2,)."""
        chosen = range(len(self)) if parts is None else parts
        factor = np.zeros(self.factors.shape[2:])
        for part in chosen:
            for kind, size in enumerate(noise):
                # A vector of three components has three times the variance of one.
                scaled = self.factors[part, kind] * (np.sqrt(3.0) / size)
                factor = absorb(factor, scaled)
        return factor[:-1, :-1] @ self.base.combination, np.array(factor[:-1, -1])


def parts_of(model: Model, recordings: Sequence[Recording], base: BaseParameters, least: int = LEAST_PARTS) -> Parts:
    """Recordings as parts; one alone is cut in time into `least`.

    Halves of one motion are too much alike to tell how masses do on another, so that several are not cut.

    Raises
    ------
    BadData : no frame can be used
    """
    pieces = least if len(recordings) == 1 else 1
    n = len(base)
    factors, frames = [], []
    for recording in recordings:
        use = np.ones(len(recording.motion), bool) if recording.use is None else np.asarray(recording.use)
        measured = base_wrench(model, recording.motion, recording.wrenches)
        use = use & np.isfinite(measured).all(axis=1)
        piece = np.minimum(np.cumsum(use) * pieces // max(int(use.sum()) + 1, 1), pieces - 1)
        own = np.zeros((pieces, 2, n + 1, n + 1))
        for block in regressor_blocks(model, recording.motion):
            for k in range(pieces):
                wanted = use[block.frames] & (piece[block.frames] == k)
                wrench = measured[block.frames][wanted]
                for kind, rows in enumerate((slice(0, 3), slice(3, 6))):
                    table = np.empty((3 * int(wanted.sum()), n + 1), order="F")
                    table[:, :-1] = block.rows[wanted][:, rows][:, :, base.columns].reshape(-1, n)
                    table[:, -1] = wrench[:, rows].ravel()
                    own[k, kind] = absorb(own[k, kind], table)
        counts = np.array([int((use & (piece == k)).sum()) for k in range(pieces)])
        factors.append(own[counts > 0])
        frames.append(counts[counts > 0])
    if not frames or not sum(len(one) for one in frames):
        raise BadData("no frame can be used to identify")
    return Parts(base, np.concatenate(factors), np.concatenate(frames))


def held_out(parts: Parts, fit: Callable[[Sequence[int]], Array]) -> Array:
    """(parts, 2) mean square misfit of each part by what was fitted to the others: moment, force [(N m)^2], [N^2].

    Parameters
    ----------
    fit : parameters (bodies, 10) from the numbers of the parts to fit
    """
    squares = np.empty((len(parts), 2))
    for part in range(len(parts)):
        others = [one for one in range(len(parts)) if one != part]
        squares[part] = np.square(parts.rms(fit(others), [part]))
    return squares

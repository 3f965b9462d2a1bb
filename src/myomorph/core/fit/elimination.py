"""Unknowns of single frames, eliminated: what is left is an equation of the shared unknowns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.fit.residuals import NormalEquations
from myomorph.core.model.arrays import Array, read_only

SMALLEST = 1e-6  # Singular values of a frame below this share of its largest show nothing


class Eliminated(NamedTuple):
    """A frame whose own unknowns follow the shared ones.

    Attributes
    ----------
    equations : of the shared unknowns
    moved : (own,) how far the frame's own unknowns lie from their best values
    follows : (own, shared) how these follow the shared unknowns
    cost : sum of squares that is left at these best values
    """

    equations: NormalEquations
    moved: Array
    follows: Array
    cost: float


def eliminated(own: Array, shared: Array, residuals: Array) -> Eliminated:
    """Take the unknowns of a frame out of its equations (Schur complement).

    Residuals r + J q + X d of the frame's own unknowns q and the shared ones d are least at

        q = -J^+ (r + X d),   with P = I - J J^+:   H = X^T P X,   g = X^T P r

    Parameters
    ----------
    own : (rows, own) J, in units of the residuals' noise
    shared : (rows, shared) X
    residuals : (rows,) r

    Returns
    -------
    the equations of the shared unknowns, and how the frame's own follow them

    Examples
    --------
    A frame with an offset of its own shows the shared slope by differences alone:

    >>> import numpy as np
    >>> from myomorph.core.fit.elimination import eliminated
    >>> frame = eliminated(np.ones((2, 1)), np.array([[0.0], [2.0]]), np.array([1.0, 3.0]))
    >>> frame.equations.H.round(6).tolist(), frame.equations.g.round(6).tolist()
    ([[2.0]], [2.0])
    """
    basis, sizes, directions = np.linalg.svd(own, full_matrices=False)
    shown = sizes > SMALLEST * sizes.max(initial=0.0)
    basis = basis[:, shown]
    rest = shared - basis @ (basis.T @ shared)
    left = residuals - basis @ (basis.T @ residuals)
    inverse = -(directions[shown].T / sizes[shown]) @ basis.T
    return Eliminated(
        equations=NormalEquations(H=shared.T @ rest, g=rest.T @ residuals),
        moved=inverse @ residuals,
        follows=inverse @ shared,
        cost=float(left @ left),
    )


@read_only
class EliminatedFrames:
    """Frames of which each one's own unknowns follow the shared ones; see `eliminated`.

    Attributes
    ----------
    H : (frames, shared, shared) curvatures of the shared unknowns
    g : (frames, shared) half the slopes
    moved : (frames, own) how far each frame's own unknowns lie from their best values
    follows : (frames, own, shared) how these follow the shared unknowns
    """

    H: Array
    g: Array
    moved: Array
    follows: Array


def eliminated_frames(own: Array, shared: Array, residuals: Array) -> EliminatedFrames:
    """Take the unknowns of many frames out of their equations, all at once; see `eliminated`.

    Parameters
    ----------
    own : (frames, rows, own) J, in units of the residuals' noise; rows of 0 say nothing
    shared : (frames, rows, shared) X
    residuals : (frames, rows) r

    Returns
    -------
    the equations of each frame
    """
    basis, sizes, directions = np.linalg.svd(own, full_matrices=False)
    shown = sizes > SMALLEST * sizes.max(axis=1, keepdims=True, initial=0.0)
    basis = basis * shown[:, None]
    inverse_sizes = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=shown)
    along = np.swapaxes(basis, 1, 2)
    shared_along = along @ shared
    residuals_along = (along @ residuals[..., None])[..., 0]
    rest = shared - basis @ shared_along
    inverse = -np.swapaxes(directions, 1, 2) * inverse_sizes[:, None]
    return EliminatedFrames(
        H=np.swapaxes(shared, 1, 2) @ rest,
        g=(residuals[:, None] @ rest)[:, 0],
        moved=(inverse @ residuals_along[..., None])[..., 0],
        follows=inverse @ shared_along,
    )

"""Unknowns over time that residuals have of their own, as a motion: eliminated by banded factors.

Coefficients of splines depend on each other in windows alone, so that their part of the normal
equations is banded, and time and memory grow in proportion to the frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from myomorph.core.fit.residuals import NormalEquations
from myomorph.core.model.arrays import Array, read_only

JITTER = 1e-12  # Of the largest diagonal entry: keeps what nothing shows solvable


@read_only
class BandedEquations:
    """Normal equations of own unknowns that depend on each other in windows.

    Attributes
    ----------
    band : (window, own) lower band of their matrix
    right : (own,) gradient
    cross : (own, shared) with the shared unknowns
    """

    band: Array
    right: Array
    cross: Array


@read_only
class Reduced:
    """Equations of the shared unknowns, and how the own ones follow them.

    Attributes
    ----------
    equations : of the shared unknowns
    gain : what the own unknowns alone take off the cost
    solved : for each group of own unknowns (own, 1 + shared) B^-1 [r C]
    """

    equations: NormalEquations
    gain: float
    solved: tuple[Array, ...]

    def own_steps(self, shared: Array) -> tuple[Array, ...]:
        """Find the steps of the own unknowns that go with one of the shared ones.

        Parameters
        ----------
        shared : (shared,)

        Returns
        -------
        for each group (own,)
        """
        return tuple(-block[:, 0] - block[:, 1:] @ shared for block in self.solved)


def reduce_banded(
    own: Sequence[BandedEquations], shared: NormalEquations, damping: float = 0.0
) -> Reduced:
    """Eliminate own unknowns from the normal equations of the shared ones (Schur complement).

        (H - sum C^T B^-1 C) ds = -(g - sum C^T B^-1 r)

    with the band B, the gradient r and the cross terms C of each group.

    Parameters
    ----------
    own : groups that do not depend on each other
    shared : equations with the own unknowns fixed
    damping : share of the diagonals of H and B that is added to them

    Returns
    -------
    equations of the shared unknowns, damped

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.core.fit.banded import BandedEquations, reduce_banded
    >>> offset = BandedEquations(
    ...     band=np.array([[2.0]]), right=np.array([4.0]), cross=np.array([[2.0]])
    ... )
    >>> slope = mm.fit.NormalEquations(H=np.array([[4.0]]), g=np.array([6.0]))
    >>> reduce_banded([offset], slope).equations.H.round(6).tolist()
    [[2.0]]
    """
    H = np.array(shared.H)
    g = np.array(shared.g)
    H[np.diag_indices_from(H)] *= 1.0 + damping
    gain = 0.0
    solved = []
    for group in own:
        band = group.band.copy()
        band[0] = band[0] * (1.0 + damping) + JITTER * band[0].max()
        factor = scipy.linalg.cholesky_banded(band, lower=True, overwrite_ab=True)
        right = np.column_stack([group.right, group.cross])
        reduced = scipy.linalg.cho_solve_banded((factor, True), right)
        H -= group.cross.T @ reduced[:, 1:]
        g -= group.cross.T @ reduced[:, 0]
        gain += float(group.right @ reduced[:, 0])
        solved.append(reduced)
    return Reduced(equations=NormalEquations(H=H, g=g), gain=gain, solved=tuple(solved))

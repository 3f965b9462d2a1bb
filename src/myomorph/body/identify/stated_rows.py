"""Equations that state something about masses beside what was measured."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array, read_only


@read_only
class StatedRows:
    """Rows of unit noise, A x = b, of the pseudo-inertias of all bodies.

    Attributes
    ----------
    rows : (rows, 10 bodies) A
    right : (rows,) b
    """

    rows: Array
    right: Array

    def beside(self, measured: tuple[Array, Array]) -> tuple[Array, Array]:
        """Put the rows below measured ones.

        Parameters
        ----------
        measured : (rows, 10 bodies) A and (rows,) b of unit noise

        Returns
        -------
        both
        """
        A, b = measured
        return np.vstack([A, self.rows]), np.concatenate([b, self.right])

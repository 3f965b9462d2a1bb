"""The masses before anything is measured, and changes that keep each link some body's."""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.pseudo_inertia import (
    SMALLEST_SHARE,
    possible_reference,
    symmetric,
    tangents,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import parameters_of, pseudo_inertias
from myomorph.core.rigid.coordinates import Ints


@read_only
class MassPrior:
    """The masses before anything is measured.

    Each link's change E with P = L (I + E) L^T has the norm `sd`.

    Attributes
    ----------
    reference : (links, 10) parameters
    moved : numbers of the links that have a mass worth changing
    rows : (links moved, 10, 10) of the prior: |rows (phi - reference)|^2
    """

    reference: Array
    moved: Ints
    rows: Array

    @classmethod
    def of(cls, parameters: Array, sd: float) -> MassPrior:
        """Build the prior about parameters.

        Parameters
        ----------
        parameters : (links, 10)
        sd : relative standard deviation of a mass

        Returns
        -------
        prior about the nearest possible parameters
        """
        reference = possible_reference(parameters)
        moved = np.flatnonzero(reference[:, 0] > SMALLEST_SHARE * reference[:, 0].sum())
        rows: Array = np.asarray(np.linalg.inv(tangents(reference[moved])) / sd, dtype=np.float64)
        return cls(reference, moved, rows)

    def misses(self, parameters: Array) -> Array:
        """Compute how far parameters are from the prior.

        Parameters
        ----------
        parameters : (links, 10)

        Returns
        -------
        (links moved, 10) in standard deviations
        """
        return np.einsum("lij,lj->li", self.rows, (parameters - self.reference)[self.moved])


def changed(parameters: Array, entries: Array) -> Array:
    """Change parameters so that they stay some body's whatever the change.

        P = L (I + E / 2)^2 L^T

    Parameters
    ----------
    parameters : (links, 10) of bodies
    entries : (links, 10) scaled triangles of E

    Returns
    -------
    (links, 10)
    """
    L = np.linalg.cholesky(pseudo_inertias(parameters))
    half = L @ (np.eye(4) + 0.5 * symmetric(entries))
    return parameters_of(half @ np.swapaxes(half, 1, 2))

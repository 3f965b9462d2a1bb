"""Masses of links as unknowns that always are a body's: small changes of a pseudo-inertia and their prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.identify.pseudo_inertia import SMALLEST_SHARE, possible_reference
from myomorph.model.arrays import Array, read_only
from myomorph.model.inertia import parameters_of, pseudo_inertias
from myomorph.rigid.coordinates import Ints

_ROWS, _COLUMNS = np.tril_indices(4)


@read_only
@dataclass(frozen=True, eq=False)
class MassPrior:
    """The masses before anything is measured: each link's change E with P = L (I + E) L^T has the norm `sd`."""

    reference: Array  # (links, 10) parameters
    moved: Ints  # numbers of the links that have a mass worth changing
    rows: Array  # (links moved, 10, 10) of the prior: |rows (phi - reference)|^2

    @classmethod
    def of(cls, parameters: Array, sd: float) -> MassPrior:
        """Prior about parameters (links, 10) with the relative SD of a mass."""
        reference = possible_reference(parameters)
        moved = np.flatnonzero(reference[:, 0] > SMALLEST_SHARE * reference[:, 0].sum())
        rows: Array = np.asarray(np.linalg.inv(tangents(reference[moved])) / sd, dtype=np.float64)
        return cls(reference, moved, rows)

    def misses(self, parameters: Array) -> Array:
        """(links moved, 10) in standard deviations."""
        return np.einsum("lij,lj->li", self.rows, (parameters - self.reference)[self.moved])


def tangents(parameters: Array) -> Array:
    """(links, 10, 10) derivative of parameters (links, 10) in the scaled entries of E, P = L (I + E) L^T."""
    L = np.linalg.cholesky(pseudo_inertias(parameters))
    return np.moveaxis(parameters_of(L[:, None] @ _symmetric(np.eye(10)) @ np.swapaxes(L, 1, 2)[:, None]), 1, 2)


def changed(parameters: Array, entries: Array) -> Array:
    """Parameters (links, 10) after changes (links, 10) of E: L (I + E / 2)^2 L^T, which is some body's whatever E."""
    L = np.linalg.cholesky(pseudo_inertias(parameters))
    half = L @ (np.eye(4) + 0.5 * _symmetric(entries))
    return parameters_of(half @ np.swapaxes(half, 1, 2))


def _symmetric(entries: Array) -> Array:
    """(..., 4, 4) symmetric matrices whose norm is that of their entries (..., 10)."""
    matrices = np.zeros((*entries.shape[:-1], 4, 4))
    scaled = entries * np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(0.5))
    matrices[..., _ROWS, _COLUMNS] = scaled
    matrices[..., _COLUMNS, _ROWS] = scaled
    return matrices

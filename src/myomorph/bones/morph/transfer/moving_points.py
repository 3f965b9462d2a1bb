"""Path points that depend on coordinates: in those of another model, and rotated with a bone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.bones.morph.checks.moment_arms import CoordinateTable
from myomorph.core.model.functions import (
    Function,
    PiecewisePolynomial,
    SineProduct,
    constant,
    substituted,
)
from myomorph.core.model.paths import MovingPathPoint, Path, PathPoint, PathWrap, TendonWrap


def translated_path(
    path: Path, table: CoordinateTable, standing: Mapping[str, float]
) -> tuple[Path, list[str]]:
    """Let conditional and moving points of a path follow the target's coordinates.

    Returns the path, and what it lost. A point that depends on a coordinate that the target does
    not have is as it is at `standing`, the values of the source's coordinates [rad or m]: fixed
    there, or left out where the path does not go through it.
    """
    kept: list[PathPoint | MovingPathPoint] = []
    dropped: list[int] = []
    lost: list[str] = []
    for i, point in enumerate(path.points):
        if isinstance(point, MovingPathPoint):
            kept.append(_moving(point, table, standing, lost))
        elif not point.coordinate:
            kept.append(point)
        elif point.coordinate in table:
            name, factor, offset = table[point.coordinate]
            low, high = sorted(factor * end + offset for end in point.range)
            kept.append(replace(point, coordinate=name, range=(low, high)))
        else:
            lost.append(point.coordinate)
            low, high = point.range
            if low <= standing[point.coordinate] <= high:
                kept.append(replace(point, coordinate="", range=(-np.inf, np.inf)))
            else:
                dropped.append(i)
    return replace(path, points=tuple(kept), wraps=_renumbered(path, dropped)), lost


def _moving(
    point: MovingPathPoint, table: CoordinateTable, standing: Mapping[str, float], lost: list[str]
) -> MovingPathPoint:
    functions = []
    names = []
    for function, name in zip(point.functions, point.coordinates, strict=True):
        if not function.arity or name in table:
            theirs, factor, offset = table[name] if function.arity else ("", 1.0, 0.0)
            functions.append(
                reparametrized(function, factor, offset) if function.arity else function
            )
            names.append(theirs)
        else:
            lost.append(name)
            functions.append(constant(float(function(standing[name]))))
            names.append("")
    x, y, z = functions
    return replace(point, functions=(x, y, z), coordinates=(names[0], names[1], names[2]))


def reparametrized(function: Function, factor: float, offset: float) -> Function:
    """Return the g with g(factor x + offset) = f(x), of a function of one coordinate."""
    if isinstance(function, SineProduct):
        frequencies = function.frequencies / factor
        return replace(
            function, frequencies=frequencies, phases=function.phases - frequencies * offset
        )
    # Pieces from left to right, the one before the first break among them, each about a break that
    # it touches.
    breaks = np.unique(function.breaks)
    if len(breaks) == 1 and len(function.breaks) == 1:
        edges = breaks
        rows = [function.coefficients[0]]
    else:
        first = max(0, int(np.searchsorted(function.breaks, breaks[0], side="left")) - 1)
        pieces = [first, *(np.searchsorted(function.breaks, breaks, side="right") - 1)]
        about = [breaks[0], *breaks]
        if factor < 0.0:  # now a piece begins where it ended
            pieces = pieces[::-1]
            about = [breaks[-1], *breaks[::-1]]
            breaks = breaks[::-1]
        rows = [piece_about(function, piece, at) for piece, at in zip(pieces, about, strict=True)]
        edges = np.array([breaks[0], *breaks])
    powers = factor ** -np.arange(function.coefficients.shape[1], dtype=np.float64)
    return PiecewisePolynomial(factor * edges + offset, np.array(rows) * powers)


def piece_about(function: PiecewisePolynomial, piece: int, place: float) -> np.ndarray:
    """Expand one of a function's pieces about another value.

    Parameters
    ----------
    function : piecewise polynomial
    piece : index of the piece
    place : value of the variable to expand about

    Returns
    -------
    (order,) coefficients, as in the function
    """
    return substituted(function.coefficients[piece], place - function.breaks[piece])


def _renumbered(path: Path, dropped: list[int]) -> tuple[PathWrap | TendonWrap, ...]:
    """Return the wraps of a path without some of its points, which they count."""
    if not dropped:
        return path.wraps
    before = np.cumsum(np.isin(np.arange(len(path.points) + 1), dropped))
    wraps: list[PathWrap | TendonWrap] = []
    for wrap in path.wraps:
        if isinstance(wrap, TendonWrap):
            wraps.append(replace(wrap, after=wrap.after - int(before[wrap.after])))
            continue
        # A range begins at the next point that is left, and ends at the one before.
        first = (
            wrap.first
            if wrap.first < 1
            else wrap.first - int(before[wrap.first - 1] - (wrap.first - 1 in dropped))
        )
        last = wrap.last if wrap.last < 1 else wrap.last - int(before[wrap.last - 1])
        wraps.append(replace(wrap, first=first, last=last))
    return tuple(wraps)

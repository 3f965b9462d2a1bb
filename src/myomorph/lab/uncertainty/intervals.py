"""The uncertainty of any result that is computed from a model.

Its values under drawn errors are computed, and their spread.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack

import numpy as np

from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.lab.uncertainty.bodies import Draw, drawn_subject
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import NOTHING, ErrorSizes, Sources, source_sizes
from myomorph.lab.uncertainty.spread import Draws, Spread, Uncertainty

# What a draw may end in that has no solution
FAILURES = (MyomorphError, ArithmeticError, np.linalg.LinAlgError)
MIN_DRAWS = 2


def uncertainty_of(  # page: a model and a result of it, and how it is drawn, all of it optional
    model: Model,
    compute: Callable[[Model, Draw], Mapping[str, Series]],
    *,
    draws: int = 100,
    sources: Sources | None = None,
    sizes: ErrorSizes = NOTHING,
    seed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Uncertainty:
    """Limits that hold 90 % of a result's values under drawn errors, whatever the result is.

    Each draw has a model of its own, with other masses, joints, marker positions, paths and
    muscles. Inputs of other kinds are drawn within `compute`: `drawn_markers`, `drawn_angles`,
    `drawn_wrenches`, `drawn_emg`. Limits are those of the draws; no factor widens them.

    Source: see docs/uncertainty.md for the sources of error and their sizes.

    Parameters
    ----------
    model : without errors
    compute : from a drawn model and the draw to series by name, alike in shape and columns in every
        draw
    draws : how many, 2 or more
    sources : standard deviations of the sources of error, each in its own unit; by default the
        usual ones
    sizes : of single items, which an earlier step found
    seed : of the random numbers
    progress : called with 1 after each draw

    Returns
    -------
    spreads by name, each with low, high and standard deviation (frames, columns) in the unit of the
    series; how many draws had no solution; the sizes of the sources

    Raises
    ------
    BadData
        fewer than two draws are asked for or have a solution, or series differ in shape from draw
        to draw

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> def torques(drawn, draw):
    ...     return {"torques": mm.inverse_dynamics(drawn, motion)}
    >>> result = mm.uncertainty.uncertainty_of(model, torques, draws=20)
    >>> spread = result.spreads["torques"]
    >>> spread.names, spread.low.shape, bool((spread.low < spread.high).all())
    (('shoulder_flexion', 'elbow_flexion'), (61, 2), True)
    """
    if draws < MIN_DRAWS:
        raise BadData(f"{draws} draws: expected {MIN_DRAWS} or more")
    sources = sources or Sources()
    normals = Normals(draws, seed)
    with ExitStack() as kept:
        drawn = _DrawnSeries(draws, kept)
        for number in range(draws):
            draw = Draw(
                number=number, sources=sources, normals=normals, found=sizes.beside(sources)
            )
            try:
                result = compute(drawn_subject(model, draw), draw)
            except FAILURES as error:
                drawn.fail(error)
            else:
                drawn.put(number, result)
            finally:
                progress(1)
        spreads = drawn.spreads()
    return Uncertainty(
        spreads, draws=draws, failed=drawn.failed, sizes=source_sizes(sources, sizes)
    )


class _DrawnSeries:
    """Series of draws, stored as they come.

    Attributes
    ----------
    failed : draws without a solution
    """

    def __init__(self, draws: int, kept: ExitStack) -> None:
        """Store nothing yet.

        Parameters
        ----------
        draws : how many there are
        kept : closes the tables
        """
        self.failed = 0
        self._draws = draws
        self._kept = kept
        self._error = ""
        self._first: Mapping[str, Series] = FrozenMap({})
        self._tables: Draws | None = None

    def fail(self, error: Exception) -> None:
        """Count a draw without a solution."""
        self.failed += 1
        self._error = f"; the last has none: {error}"

    def put(self, number: int, result: Mapping[str, Series]) -> None:
        """Store the series of a draw.

        Raises
        ------
        BadData : their shapes are not those of the first draw
        """
        shapes = _shapes(result)
        if self._tables is None:
            self._first = result
            self._tables = self._kept.enter_context(Draws(self._draws, shapes))
        expected = _shapes(self._first)
        if shapes != expected:
            raise BadData(
                f"a draw has series of shapes {shapes}, the first has {expected}: expected the same"
            )
        self._tables.put(number, {name: series.values for name, series in result.items()})

    def spreads(self) -> FrozenMap[str, Spread]:
        """Find limits and standard deviation of each series.

        Raises
        ------
        BadData : fewer than two draws have a solution
        """
        solved = self._draws - self.failed
        if solved < MIN_DRAWS or self._tables is None:
            raise BadData(
                f"{solved} of {self._draws} draws have a solution: expected {MIN_DRAWS} or"
                f" more{self._error}"
            )
        return FrozenMap(
            {
                name: self._tables.spread(name, series.time, series.names)
                for name, series in self._first.items()
            }
        )


def _shapes(result: Mapping[str, Series]) -> dict[str, tuple[int, ...]]:
    return {name: series.values.shape for name, series in result.items()}

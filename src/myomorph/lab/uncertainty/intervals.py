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
from myomorph.lab.uncertainty.spread import Draws, Uncertainty

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
    failed = 0
    last = ""
    first: Mapping[str, Series] = FrozenMap({})
    with ExitStack() as kept:
        for number in range(draws):
            draw = Draw(
                number=number, sources=sources, normals=normals, found=sizes.beside(sources)
            )
            try:
                result = compute(drawn_subject(model, draw), draw)
            except FAILURES as error:
                failed = failed + 1
                last = f"; the last has none: {error}"
                continue
            finally:
                progress(1)
            shapes = {name: series.values.shape for name, series in result.items()}
            if not first:
                first = result
                expected = shapes
                tables = kept.enter_context(Draws(draws, shapes))
            if shapes != expected:
                raise BadData(
                    f"a draw has series of shapes {shapes}, the first has {expected}: expected the"
                    " same"
                )
            tables.put(number, {name: series.values for name, series in result.items()})
        if draws - failed < MIN_DRAWS:
            raise BadData(
                f"{draws - failed} of {draws} draws have a solution: expected {MIN_DRAWS} or"
                f" more{last}"
            )
        spreads = FrozenMap(
            {name: tables.spread(name, series.time, series.names) for name, series in first.items()}
        )
    return Uncertainty(spreads, draws=draws, failed=failed, sizes=source_sizes(sources, sizes))

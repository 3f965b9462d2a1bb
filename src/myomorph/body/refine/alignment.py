"""Forces brought near the clock of the markers before anything else is estimated.

Masses that `identify` finds, and the frames that it trusts, are wrong where forces are late. So the
clocks are found first with the motions alone, on the body as given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from myomorph.body.refine.opened import Opened
from myomorph.body.refine.options import CLOCK, RefineOptions
from myomorph.body.refine.search import solve
from myomorph.body.refine.trial_data import problem_of, thinned, with_shift
from myomorph.core.model.model import Model


def aligned(
    model: Model, recorded: Sequence[Opened], options: RefineOptions, progress: Callable[[], None]
) -> list[Opened]:
    """Shift the forces of all trials by their clocks, where these are estimated.

    Frames keep their weight here: at impacts, which nothing explains while the clock is wrong, it
    shows best.

    Parameters
    ----------
    model : as given, at the subject's mass
    recorded : trials on it
    options : what is estimated
    progress : called once a step

    Returns
    -------
    the trials; as they are where no clock is estimated
    """
    if not options.fits_clock:
        return list(recorded)
    alone = replace(options, fit=(CLOCK,), soft_tissue="never")
    problem = thinned(problem_of(model, recorded, alone))
    offsets = solve(problem, problem.begin(), progress).at[CLOCK]
    # One for each trial, or one for all of them.
    shifts = [float(offsets[number % len(offsets)]) for number in range(len(recorded))]
    return [
        with_shift(model, trial, options, shift)
        for trial, shift in zip(recorded, shifts, strict=True)
    ]

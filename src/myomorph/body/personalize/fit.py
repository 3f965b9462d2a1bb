"""Muscles from recordings: torques that must be borne, and activations as EMG shows them.

    tau = R^T F(p, a) + e_tau,   a = g e + e_a   (or a = l + e_a where no EMG is),   p = prior + e_p

Of every frame the activations are marginalized to first order: with G = R^T dF/da the misfit r has
the covariance S = var(e_tau) + G var(a) G^T, so that least effort weighs no more than what is known
of activations says. Gauss-Newton steps in p use S^-1; activations follow as their mean given p,
within 0 and 1. Errors of neighboring frames are alike: frames count by one over the correlation
time of the whitened misfit (`correlation_times`). Errors of torques and activations are estimated
beside p from the squared misfits (Rasmussen and Williams 2006 for the marginal).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from myomorph.body.personalize.muscle_problem import (
    BLOCKS,
    FIBER_RANGE,
    MAX_STEP,
    MuscleProblem,
    as_fit,
)
from myomorph.body.personalize.recording_at import Noise
from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.solver import Method, Solution, minimize
from myomorph.core.model.arrays import Array, read_only

STEPS = 40
METHOD = Method(
    iterations=STEPS,
    # Steps end where no parameter moves by more of its standard deviation.
    tolerance=0.02,
    reweighted=True,
    changes_in="standard deviations",
    min_iterations=6,
    calm_steps=3,
    stiffness=0.5,
    max_stiffness=64.0,
    max_step=MAX_STEP,
)


@read_only
class Fitted:
    """Parameters, how sure they are, and what became of the recordings.

    Attributes
    ----------
    solution : where the search ended
    posterior : of the parameters, for which the range of fibers says nothing
    noise : errors of torques and activations that the misfits show
    weights : of each recording: what a frame counts
    """

    solution: Solution
    posterior: Posterior
    noise: Noise
    weights: tuple[float, ...]

    @property
    def p(self) -> Array:
        """(parameters,), see `Prior`."""
        return self.posterior.x

    @property
    def covariance(self) -> Array:
        """(parameters, parameters) after the recordings."""
        return self.posterior.covariance


def fit(
    problem: MuscleProblem,
    blocks: Sequence[str] = BLOCKS,
    steps: int = STEPS,
    advance: Callable[[int], None] | None = None,
) -> Fitted:
    """Find the most probable parameters given the recordings.

    The model and its marginal are at the head of this file.

    Parameters
    ----------
    problem : muscles and recordings
    blocks : names of the parameters that are estimated together; the others stay as the prior has
        them
    steps : at most
    advance : called with the number of steps just done

    Returns
    -------
    parameters with covariance and errors
    """

    def progress() -> None:
        if advance is not None:
            advance(1)

    stated = as_fit(problem, blocks)
    method = replace(METHOD, iterations=steps)
    solution = minimize(stated, fit=blocks, method=method, progress=progress)
    # What is estimated beside the parameters follows the last step too.
    state = solution.at.parts[0].every.state_after(solution.x)  # type: ignore[attr-defined]
    known = replace(solution, at=solution.at.without(FIBER_RANGE))
    return Fitted(
        solution=solution,
        posterior=Posterior.of(known),
        noise=state.noise,
        weights=state.weights,
    )

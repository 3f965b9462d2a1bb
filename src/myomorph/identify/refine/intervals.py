"""Standard deviations of body and masses at the optimum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.identify.determined import LINK_SD
from myomorph.identify.refine.equations import linearize
from myomorph.identify.refine.masses import MassPrior, tangents
from myomorph.identify.refine.problem import Problem, Unknowns
from myomorph.identify.refine.solve import reduced_information
from myomorph.model.arrays import Array


def covariance(problem: Problem, at: Unknowns) -> Array:
    """(shared, shared) of the shared unknowns, all motions unknown too.

    Masses that are identified first come from the same recordings, so that they are no prior knowledge: links are
    taken to differ from the given model by `LINK_SD`, as in `identify`.
    """
    if not problem.count:
        return np.zeros((0, 0))
    problem = replace(problem, prior=MassPrior.of(problem.prior.reference, LINK_SD))
    return np.asarray(np.linalg.inv(reduced_information(linearize(problem, at))), dtype=np.float64)


def mass_sd(problem: Problem, at: Unknowns, spread: Array) -> Array:
    """(bodies,) standard deviation of the masses [kg], 0 of those that do not change.
    `spread` (shared, shared) as by `covariance`.
    """
    result = np.zeros(len(problem.prior.reference))
    if problem.masses:
        masses = problem.columns()[2]
        rows = tangents(at.parameters[problem.prior.moved])[:, 0]
        for index, link in enumerate(problem.prior.moved):
            columns = slice(masses.start + 10 * index, masses.start + 10 * index + 10)
            result[link] = np.sqrt(rows[index] @ spread[columns, columns] @ rows[index])
    return result

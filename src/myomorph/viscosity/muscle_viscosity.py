"""Step 3: the viscosity of the muscles, with the joint's own taken off ([S] eq. 2 and 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls

from myomorph.model.arrays import Array
from myomorph.viscosity.joint_viscosity import FIRST, SPEED, TORQUE

RANK_TOLERANCE = 1e-6
"""Of the largest singular value: a combination of muscles that turns the limb less is not shown."""


@dataclass(frozen=True, eq=False)
class MuscleSolution:
    """d_M of [S] eq. 3: torque + d_J rate = -J_M^T d_M J_M rate.

    Attributes
    ----------
    common : one value of all muscles [N s/m]
    by_pcsa : the factor of given shares [N s/m]
    by_muscle : (muscles,) each for itself, drawn towards the common value [N s/m]
    """

    common: float
    by_pcsa: float
    by_muscle: Array


@dataclass(frozen=True, eq=False)
class MuscleProblem:
    """Normal equations H d = g of the muscles' viscosities.

    Attributes
    ----------
    H : (muscles, muscles), g : (muscles,)
    """

    H: Array
    g: Array

    @property
    def singular_values(self) -> Array:
        """(muscles,) of the rows behind H, relative to the largest, descending."""
        values = np.linalg.eigvalsh(self.H)[::-1]
        relative: Array = np.sqrt(np.maximum(values, 0.0) / values[0]) if values[0] > 0.0 else np.zeros(len(values))
        return relative

    @property
    def rank(self) -> int:
        """Number of combinations of muscles that the swings show."""
        return int((self.singular_values > RANK_TOLERANCE).sum())

    def resolved(self, variance: float, common: float) -> int:
        """Number of combinations whose size, were all muscles `common`, is above its standard error."""
        values = np.maximum(np.linalg.eigvalsh(self.H), 0.0)
        return int((values * common**2 > variance).sum())

    def along(self, shares: Array) -> float:
        """The factor, at least 0, of given shares (muscles,) that fits best."""
        square = float(shares @ self.H @ shares)
        return max(float(shares @ self.g) / square, 0.0) if square > 0.0 else 0.0

    def towards(self, common: float, strength: float) -> Array:
        """(muscles,) values, at least 0, that minimise d H d / 2 - g d + strength |d - common|^2 / 2."""
        L = cholesky(self.H + strength * np.eye(len(self.g)), lower=True)
        found: Array = nnls(L.T, solve_triangular(L, self.g + strength * common, lower=True))[0]
        return found


def muscle_problem(problem: Array, joint: Array) -> MuscleProblem:
    """The equations of the muscles with the joint's own torque -d_J rate taken off.

    Parameters
    ----------
    problem : (axes, 2 + muscles, 2 + muscles) of `torque_problem`, of the swings with muscles
    joint : (axes,) d_J of the swings without muscles [N m s/rad]
    """
    H = problem[:, FIRST:, FIRST:].sum(axis=0)
    g = -(problem[:, TORQUE, FIRST:] + joint[:, None] * problem[:, SPEED, FIRST:]).sum(axis=0)
    return MuscleProblem(H, g)


def noise_variance(blocks: Array, joint: Array) -> float:
    """Variance that noise, independent between frames, would need for scores that scatter over the blocks as they do.

    The scores are those of the muscles' values that fit best without any restraint, so that muscles which differ do
    not count as noise; frames that depend on each other count as what they are.

    Parameters
    ----------
    blocks : (blocks, axes, 2 + muscles, 2 + muscles) `torque_problem` of each block
    joint : (axes,) d_J [N m s/rad]
    """
    each = [muscle_problem(block, joint) for block in blocks]
    H, g = np.sum([one.H for one in each], axis=0), np.sum([one.g for one in each], axis=0)
    best = np.linalg.pinv(H, rcond=RANK_TOLERANCE**2, hermitian=True) @ g
    scores = np.array([one.g - one.H @ best for one in each])
    free = max(len(each) - MuscleProblem(H, g).rank, 1) / len(each)
    trace = float(np.trace(H))
    return float(np.square(scores).sum()) / (free * trace) if trace > 0.0 else 0.0


def ridge_strength(problem: MuscleProblem, variance: float, common: float, spread: float) -> float:
    """Strength with which single muscles are drawn to the common value: variance / (spread common)^2.

    The prior of a muscle's viscosity is then normal about the common value with that relative standard deviation.

    Parameters
    ----------
    variance : of `noise_variance`
    spread : relative standard deviation of the muscles' viscosities about the common one
    """
    if not common > 0.0:
        return float("inf")
    least = 1e-12 * float(np.trace(problem.H)) / len(problem.g)
    return max(variance / (spread * common) ** 2, least)


def solve_muscles(problem: MuscleProblem, pcsa: Array, strength: float) -> MuscleSolution:
    """Common, scaled and single values.

    Parameters
    ----------
    pcsa : (muscles,) shares of the physiological cross-section, mean 1
    strength : of `ridge_strength`
    """
    common = problem.along(np.ones(len(problem.g)))
    single = np.full(len(problem.g), common)
    if np.isfinite(strength):
        single = problem.towards(common, strength)
    return MuscleSolution(common, problem.along(pcsa), single)

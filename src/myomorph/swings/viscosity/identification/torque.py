"""Steps 2 and 3: viscosity of joint and muscles from the torque of free swings, beside a spring.

Source: [S] eq. 1 to 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Evaluation, NormalEquations
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording
from myomorph.swings.viscosity.swings.sums import (
    ANGLE,
    CONSTANT,
    MUSCLES,
    PLATE,
    RATE,
    RESISTED,
    SwingSums,
    eliminated,
)

TORQUE, SPEED, JOINT, FIRST = range(4)
"""Columns of a torque problem: the torque by inverse dynamics, the rate, what the joint resists,
then one a muscle.
"""


# Of the largest singular value: a combination of muscles that turns the limb less is not shown.
RANK_TOLERANCE = 1e-6
MUSCLE_VISCOSITY = "muscles"  # The block of unknowns
ONE_STEP = Method(iterations=1, reweighted=True)  # Of a linear problem, exact within its bounds
# A rest farther than this from the mean pose is not believed: there is hardly a spring [rad].
MAX_SHIFT = 1.5


@read_only
class JointViscosity:
    """d_J of [S] eq. 1, the sign that resists: torque = -d rate.

    Attributes
    ----------
    one : for all axes alike, as the paper prints it [N m s/rad]
    law : of torque = -law resisted, the one value where the joint resists its rates [N m s/rad]
    axes : (axes,) each for itself, at least 0 [N m s/rad]
    residual : (axes,) root mean square of torque + one rate [N m]
    """

    one: float
    law: float
    axes: Array
    residual: Array

    def taken_off(self, subtract: Literal["one", "axes"]) -> Array:
        """Find what step 3 takes off.

        Parameters
        ----------
        subtract : "one" for `law` about every axis, or each axis' own

        Returns
        -------
        (axes,) [N m s/rad]
        """
        return np.full(len(self.axes), self.law) if subtract == "one" else self.axes


def torque_problem(products: Array, parameters: Array | None, stiffness: bool = True) -> Array:
    """Choose the columns of a torque problem.

    Parameters
    ----------
    products : (axes, n, n) of `SwingSums.torque_total`
    parameters : (10,) of the limb; without them the torque is the one that the plate measures
    stiffness : take off what a spring and a constant torque of each axis explain, so that neither
        biases what resists motion

    Returns
    -------
    (axes, 3 + muscles, 3 + muscles) products of [torque, rate, resisted, u] of each axis, torque =
    torque_rows phi
    """
    if stiffness:
        products = eliminated(products, [CONSTANT, ANGLE])
    muscles = products.shape[-1] - MUSCLES
    chosen = np.zeros((products.shape[-1], FIRST + muscles))
    if parameters is None:
        chosen[PLATE, TORQUE] = 1.0
    else:
        chosen[:PARAMETERS, TORQUE] = parameters
    chosen[RATE, SPEED] = chosen[RESISTED, JOINT] = 1.0
    chosen[MUSCLES:, FIRST:] = np.eye(muscles)
    return chosen.T @ products @ chosen


def joint_viscosity(problem: Array, frames: float) -> JointViscosity:
    """Fit torque = -d rate, d at least 0, over all axes and over each.

    Parameters
    ----------
    problem : (axes, n, n) of `torque_problem`
    frames : how many it is of

    Returns
    -------
    the viscosities
    """
    power = -problem[:, TORQUE, SPEED]
    square = problem[:, SPEED, SPEED]
    axes = np.maximum(np.divide(power, square, out=np.zeros_like(power), where=square > 0.0), 0.0)
    sizes = ((column, problem[:, column, column].sum()) for column in (SPEED, JOINT))
    slopes = (
        problem[:, TORQUE, column].sum() / size if size > 0.0 else 0.0 for column, size in sizes
    )
    common_slope, law_slope = slopes
    common = max(-float(common_slope), 0.0)
    law = max(-float(law_slope), 0.0)
    left = problem[:, TORQUE, TORQUE] - 2.0 * common * power + common**2 * square
    return JointViscosity(
        one=common, law=law, axes=axes, residual=np.sqrt(np.maximum(left, 0.0) / frames)
    )


@read_only
class MuscleProblem:
    """Normal equations H d = g of the muscles' viscosities.

    Attributes
    ----------
    H : (muscles, muscles)
    g : (muscles,)
    """

    H: Array
    g: Array

    @property
    def singular_values(self) -> Array:
        """(muscles,) of the rows behind H, relative to the largest, descending."""
        values = np.linalg.eigvalsh(self.H)[::-1]
        return (
            np.sqrt(np.maximum(values, 0.0) / values[0])
            if values[0] > 0.0
            else np.zeros(len(values))
        )

    @property
    def rank(self) -> int:
        """Number of combinations of muscles that the swings show."""
        return int((self.singular_values > RANK_TOLERANCE).sum())

    def resolved(self, variance: float, common: float) -> int:
        """Count combinations that stand out, were all muscles alike.

        Their size is above their standard error.

        Parameters
        ----------
        variance : of the torque
        common : viscosity of all muscles [N s/m]
        """
        values = np.maximum(np.linalg.eigvalsh(self.H), 0.0)
        return int((values * common**2 > variance).sum())

    def solved(self, pcsa: Array, strength: float) -> Array:
        """Find d_M of [S] eq. 3, torque + d_J rate = -J_M^T d_M J_M rate.

        Parameters
        ----------
        pcsa : (muscles,) shares of the cross-section, of mean 1
        strength : by which single muscles are drawn towards the common value

        Returns
        -------
        (2 + muscles,) one value of all muscles; the factor of the shares; each muscle [N s/m]
        """
        common = self.along(np.ones(len(self.g)))
        single = (
            self.towards(common, strength)
            if np.isfinite(strength)
            else np.full(len(self.g), common)
        )
        return np.array([common, self.along(pcsa), *single])

    def along(self, shares: Array) -> float:
        """Find the factor, at least 0, of given shares that fits best.

        Parameters
        ----------
        shares : (muscles,)

        Returns
        -------
        [N s/m]
        """
        square = float(shares @ self.H @ shares)
        return max(float(shares @ self.g) / square, 0.0) if square > 0.0 else 0.0

    def towards(self, common: float, strength: float) -> Array:
        """Estimate every muscle by itself, held likely near a common value.

        With d at least 0, the minimum of

            d . H d - 2 g . d + strength |d - common|^2

        Parameters
        ----------
        common : mean of the prior [N s/m]
        strength : see `ridge_strength`

        Returns
        -------
        (muscles,) [N s/m]
        """
        unknowns = tuple(
            Unknown(
                name=f"viscosity of muscle {number}",
                unit="N s/m",
                start=common,
                sd=strength**-0.5,
                low=0.0,
            )
            for number in range(len(self.g))
        )
        block = Block(name=MUSCLE_VISCOSITY, unknowns=unknowns)
        torques = MuscleTorques(H=self.H, g=self.g)
        return minimize(Problem(Unknowns((block,)), (torques,)), method=ONE_STEP).x


@read_only
class MuscleTorques:
    """Residuals of the muscles' torques, condensed to products over the frames.

    Attributes
    ----------
    H : (muscles, muscles) of the torques of unit viscosities
    g : (muscles,) with the torque that is left to the muscles
    """

    H: Array
    g: Array
    name: str = field(default="torques of the muscles", init=False)
    blocks: tuple[str, ...] = field(default=(MUSCLE_VISCOSITY,), init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: Evaluation | None = None) -> MuscleTorquesAt:
        """Evaluate the residuals.

        Parameters
        ----------
        values : viscosities
        before : not used
        """
        return MuscleTorquesAt(torques=self, viscosity=values[MUSCLE_VISCOSITY])


@read_only
class MuscleTorquesAt:
    """Residuals of the muscles' torques at some viscosities.

    Attributes
    ----------
    torques : that have to be explained
    viscosity : (muscles,) [N s/m]
    """

    torques: MuscleTorques
    viscosity: Array

    @property
    def cost(self) -> float:
        """Sum of squares, less what it is where no muscle resists [N^2 m^2]."""
        d = self.viscosity
        return float(d @ self.torques.H @ d - 2.0 * self.torques.g @ d)

    @property
    def count(self) -> int:
        """How many numbers say all that the frames do: one a muscle."""
        return len(self.viscosity)

    def normal(self) -> NormalEquations:
        """Return the normal equations, which are the products."""
        H = self.torques.H
        return NormalEquations(H=H, g=H @ self.viscosity - self.torques.g)


def muscle_problem(problem: Array, joint: Array) -> MuscleProblem:
    """Take the joint's own torque -d_J resisted off, which leaves the muscles' equations.

    Parameters
    ----------
    problem : (axes, n, n) of `torque_problem`
    joint : (axes,) d_J [N m s/rad]

    Returns
    -------
    the equations
    """
    H = problem[:, FIRST:, FIRST:].sum(axis=0)
    g = -(problem[:, TORQUE, FIRST:] + joint[:, None] * problem[:, JOINT, FIRST:]).sum(axis=0)
    return MuscleProblem(H, g)


def noise_variance(blocks: Array, joint: Array) -> float:
    """Find the variance of independent noise that makes scores scatter as they do over blocks.

    The scores are those of the muscles' values that fit best without any restraint, so that muscles
    which differ do not count as noise; frames that depend on each other count as what they are.

    Parameters
    ----------
    blocks : (blocks, axes, n, n) of `torque_problem`
    joint : (axes,) d_J [N m s/rad]

    Returns
    -------
    of a frame's torque [N^2 m^2]
    """
    each = [muscle_problem(block, joint) for block in blocks]
    H = np.sum([block.H for block in each], axis=0)
    g = np.sum([block.g for block in each], axis=0)
    best = np.linalg.pinv(H, rcond=RANK_TOLERANCE**2, hermitian=True) @ g
    scores = np.array([block.g - block.H @ best for block in each])
    free = max(len(each) - MuscleProblem(H, g).rank, 1) / len(each)
    trace = float(np.trace(H))
    return float(np.square(scores).sum()) / (free * trace) if trace > 0.0 else 0.0


def ridge_strength(problem: MuscleProblem, variance: float, common: float, spread: float) -> float:
    """Find the strength of the prior of single muscles: variance / (spread common)^2.

    It is normal about the common value with that relative standard deviation.

    Parameters
    ----------
    problem : of the muscles
    variance : of a frame's torque [N^2 m^2]
    common : viscosity of all muscles [N s/m]
    spread : relative standard deviation
    """
    if not common > 0.0:
        return float("inf")
    least = 1e-12 * float(np.trace(problem.H)) / len(problem.g)
    return max(variance / (spread * common) ** 2, least)


def neutral_position(sums: SwingSums, parameters: Array) -> Array:
    """Find the rotation from the slack spring to where the angles are zero.

    Only angles that are counted from the neutral position make a ball's spring linear in them: with
    R_rest moved by a small c, log(exp(c) exp(theta)) = theta + c + c x theta / 2 + ... The last
    part is neither spring nor constant, does work like a damper in a conical swing, and 0.02 rad of
    it change the viscosity by 1 % (`docs/viscosity.md`). Least squares of torque = -d rate - u d_M
    - k (angle + c): d, d_M and c of each axis, k of all.

    Parameters
    ----------
    sums : over blocks of swings
    parameters : (10,) of the limb

    Returns
    -------
    (axes,) c; zero where there is no spring [rad]
    """
    left = _without_dampers(sums, parameters)
    varying = eliminated(left, [2])
    square = varying[:, 1, 1].sum()
    stiffness = -varying[:, 0, 1].sum() / square if square > 0.0 else 0.0
    if not stiffness > 0.0:
        return np.zeros(len(sums.axes))
    shift: Array = -(left[:, 0, 2] / stiffness + left[:, 1, 2]) / left[:, 2, 2]
    return shift if np.linalg.norm(shift) < MAX_SHIFT else np.zeros(len(shift))


def spring_misfit(sums: SwingSums, parameters: Array) -> float:
    """Find what the same least squares leave of the torque, with k of all axes and c of each.

    Parameters
    ----------
    sums : over blocks of swings
    parameters : (10,) of the limb

    Returns
    -------
    sum of squares [N^2 m^2]
    """
    varying = eliminated(_without_dampers(sums, parameters), [2])
    square = float(varying[:, 1, 1].sum())
    explained = float(varying[:, 0, 1].sum()) ** 2 / square if square > 0.0 else 0.0
    return float(varying[:, 0, 0].sum()) - explained


def _without_dampers(sums: SwingSums, parameters: Array) -> Array:
    """Take rates and muscles off the products of torque, angle and one.

    Parameters
    ----------
    parameters : (10,) of the limb

    Returns
    -------
    (axes, 3, 3)
    """
    muscles = len(sums.muscles)
    chosen = np.zeros((sums.torque.shape[-1], 4 + muscles))
    chosen[:PARAMETERS, 0] = parameters
    chosen[[ANGLE, CONSTANT, RATE], [1, 2, 3]] = 1.0
    chosen[MUSCLES:, 4:] = np.eye(muscles)
    return eliminated(
        chosen.T @ sums.torque_total(np.ones(len(sums))) @ chosen, range(3, 4 + muscles)
    )


def counted_from(recordings: Sequence[SwingRecording], shift: Array) -> list[SwingRecording]:
    """Count angles from a rest that lies before theirs.

    Parameters
    ----------
    recordings : of a ball
    shift : (3,) rotation vector between the two [rad]

    Returns
    -------
    the recordings with these angles
    """
    result = []
    turn = Rotation.from_rotvec(shift)
    for recording in recordings:
        angles = np.array(recording.angles)
        angles[recording.used] = (
            turn * Rotation.from_rotvec(recording.angles[recording.used])
        ).as_rotvec()
        result.append(replace(recording, angles=angles))
    return result

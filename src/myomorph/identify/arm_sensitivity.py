"""How far the muscles' viscosity follows an error of their moment arms, which [S] blames for the spread of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from myomorph.identify.joint_viscosity import torque_problem
from myomorph.identify.muscle_viscosity import MuscleProblem, muscle_problem
from myomorph.identify.swing_sums import swing_sums
from myomorph.identify.swings import SwingRecording
from myomorph.model.errors import BadData
from myomorph.model.spatial import Array

Kind = Literal["one factor", "factor of each muscle", "offset of each muscle"]

ATTACHMENT = 13.3e-3
"""Mean distance between an attachment carried over from another body's bone and the true one, SD 8.1 mm; legs
(Pellikaan, Carbone, Fluit, van der Krogt, Verdonschot, Koopman 2013) [m]."""
OFFSET = 0.5 * ATTACHMENT / np.sqrt(8.0 / np.pi)
"""Standard deviation of a component of the moment arm that follows: distances of mean 13.3 mm have components of
8.3 mm, and of two attachments' errors about half reaches the arm of a line between them [m]."""
RATE = 50.0
"""Frames a second that draws of offsets use; d_M is a ratio of sums over frames [Hz]."""

STEADY = ("name", "axes", "muscles", "gravity")
"""Fields of a recording that have no frames."""


@dataclass(frozen=True)
class ArmOptions:
    """Settings of `arm_sensitivity`.

    Attributes
    ----------
    factor : standard deviation of the factors, relative
    offset : of each component of an offset [m]; 0 leaves that kind out
    draws, seed : of the errors
    stiffness : as in `ViscosityOptions`
    """

    factor: float = 0.10
    offset: float = OFFSET
    draws: int = 1000
    seed: int = 0
    stiffness: bool = True

    def __post_init__(self) -> None:
        if not (0.0 < self.factor < 1.0 and self.offset >= 0.0 and self.draws >= 2):
            raise BadData(f"errors of moment arms: expected factor within 0 and 1 and at least 2 draws, but got {self}")


@dataclass(frozen=True, eq=False)
class ArmSpread:
    """What one kind of error does to d_M, the common viscosity of the muscles.

    Attributes
    ----------
    kind : one factor for all muscles; one a muscle; or an offset of each muscle's arms, constant in the limb's axes
    error : standard deviation of the factor, relative, or of each component of the offset [m]
    exact : d_M with the arms as given [N s/m]
    draws : (draws,) d_M with arms in error [N s/m]
    first_order : relative standard deviation of d_M by its slopes; NaN for an offset
    """

    kind: Kind
    error: float
    exact: float
    draws: Array
    first_order: float

    @property
    def sd(self) -> float:
        """Standard deviation of d_M, relative to the exact value."""
        return float(np.std(self.draws) / self.exact)

    @property
    def bias(self) -> float:
        """Mean of d_M less the exact value, relative to that."""
        return float(np.mean(self.draws) / self.exact - 1.0)

    def quantiles(self, shares: Sequence[float] = (0.025, 0.5, 0.975)) -> Array:
        """Quantiles of d_M [N s/m]."""
        return np.quantile(self.draws, shares)


@dataclass(frozen=True, eq=False)
class ArmSensitivity:
    """Sensitivity of d_M to moment arms.

    Attributes
    ----------
    muscles : names
    slopes : (muscles,) relative change of d_M over relative change of that muscle's moment arms; they sum to -2
    spreads : one a kind of error
    """

    muscles: tuple[str, ...]
    slopes: Array
    spreads: tuple[ArmSpread, ...]

    def spread(self, kind: Kind) -> ArmSpread:
        """Of one kind of error."""
        return next(one for one in self.spreads if one.kind == kind)


def arm_sensitivity(
    intact: Sequence[SwingRecording], parameters: Array, joint: float | Array, options: ArmOptions | None = None
) -> ArmSensitivity:
    """Spread of d_M when every muscle's moment arms are systematically wrong.

    The common value of swings with muscles is d_M = v g / v H v with v_m the square of the factor of muscle m,
    so a factor s of all arms makes it d_M / s^2.

    Parameters
    ----------
    intact : swings with muscles
    parameters : (10,) of the limb with muscles
    joint : d_J of the swings without muscles, one or (axes,) [N m s/rad]

    Raises
    ------
    BadData
        the swings have no moment arms, or show no viscosity of muscles
    """
    options = options or ArmOptions()
    random = np.random.default_rng(options.seed)
    problem = _problem(intact, parameters, joint, options.stiffness)
    n = len(problem.g)
    exact = problem.along(np.ones(n)) if n else 0.0
    if not exact > 0.0:
        raise BadData("sensitivity to moment arms: these swings show no viscosity of muscles")
    force, square = problem.g / problem.g.sum(), problem.H.sum(axis=1) / problem.H.sum()
    slopes = 2.0 * (force - 2.0 * square)
    one = 1.0 + options.factor * random.standard_normal((options.draws, 1)) * np.ones(n)
    each = 1.0 + options.factor * random.standard_normal((options.draws, n))
    spreads = [
        ArmSpread("one factor", options.factor, exact, _by_factors(problem, one), 2.0 * options.factor),
        ArmSpread(
            "factor of each muscle",
            options.factor,
            exact,
            _by_factors(problem, each),
            options.factor * float(np.linalg.norm(slopes)),
        ),
    ]
    if options.offset > 0.0:
        spreads.append(_by_offsets(intact, parameters, joint, options, random))
    return ArmSensitivity(intact[0].muscles, slopes, tuple(spreads))


def _problem(
    intact: Sequence[SwingRecording], parameters: Array, joint: float | Array, stiffness: bool
) -> MuscleProblem:
    sums = swing_sums(intact)
    torque = torque_problem(sums.torque_total(np.ones(len(sums))), parameters, stiffness)
    return muscle_problem(torque, np.broadcast_to(np.asarray(joint, dtype=np.float64), (len(sums.axes),)))


def _by_factors(problem: MuscleProblem, factors: Array) -> Array:
    """d_M (draws,) with the arms of every muscle times factors (draws, muscles)."""
    v = factors**2
    return np.maximum(v @ problem.g, 0.0) / np.einsum("di,ij,dj->d", v, problem.H, v)


def _by_offsets(
    intact: Sequence[SwingRecording],
    parameters: Array,
    joint: float | Array,
    options: ArmOptions,
    random: np.random.Generator,
) -> ArmSpread:
    few = [_thinned(one) for one in intact]
    exact = _problem(few, parameters, joint, options.stiffness).along(np.ones(len(few[0].muscles)))
    draws = np.empty(min(options.draws, 200))
    for i in range(len(draws)):
        offset = options.offset * random.standard_normal(few[0].lengthening.shape[1:])
        moved = [replace(one, lengthening=one.lengthening + offset) for one in few]
        draws[i] = _problem(moved, parameters, joint, options.stiffness).along(np.ones(len(offset)))
    return ArmSpread("offset of each muscle", float(options.offset), exact, draws, float("nan"))


def _thinned(one: SwingRecording) -> SwingRecording:
    """The recording at about `RATE`."""
    step = max(round((len(one) - 1) / (one.time[-1] - one.time[0]) / RATE), 1)
    arrays = {f.name: getattr(one, f.name) for f in fields(one)}
    timed = {name: value[::step] for name, value in arrays.items() if name not in STEADY}
    return replace(one, **timed)

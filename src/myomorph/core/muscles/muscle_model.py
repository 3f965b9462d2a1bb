"""Classes of muscles: curves, parameters, and where OpenSim's static optimization departs.

A new class is a subclass of `MuscleModel` in a file of its own and a line in `hill.py`: kernels
evaluate all curves alike and know no class.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.errors import BadModel
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import Curve

NO_PENNATION = float("inf")
MIN_PENNATION = 1e-14  # Greatest pennation that limits fibers by their height [rad]
SHORTEST_UNPENNATED = 0.01  # Least length of fibers that it does not limit, by optimal length


class FiberCurves(NamedTuple):
    """Curves of a muscle's fibers.

    Attributes
    ----------
    active : f_L over the normalized fiber length
    velocity : f_V over the normalized fiber velocity, negative where fibers shorten
    passive : f_PE over the normalized fiber length
    """

    active: Curve
    velocity: Curve
    passive: Curve


class FiberSizes(NamedTuple):
    """Sizes of a muscle.

    Attributes
    ----------
    force : maximum isometric force [N]
    fiber : optimal fiber length [m]
    tendon : tendon slack length [m]
    height : constant height of the fibers over the tendon's line [m]
    shortest : least fiber length [m]
    shortest_along : part of the shortest fiber along the tendon [m]
    cos_optimal : cosine of the pennation at optimal length
    speed : maximum contraction velocity [m/s]
    """

    force: float
    fiber: float
    tendon: float
    height: float
    shortest: float
    shortest_along: float
    cos_optimal: float
    speed: float


@dataclass(frozen=True)
class StaticOptimization:
    """Differences of OpenSim 4.6's static optimization from the forces of a rigid tendon.

    Attributes
    ----------
    bounded : whether fibers end where their part along the tendon is 0
    turning : whether the path's velocity is projected on the fibers
    pennation_by : factor of the normalized fiber length, where the sine of the pennation is the
        fibers' height over it [m]; None for the pennation as it is, `NO_PENNATION` for none
    """

    bounded: bool = True
    turning: bool = True
    pennation_by: float | None = None


class MuscleModel:
    """A class of muscles with rigid tendons, and with elastic ones where it has a `tendon`.

    Attributes
    ----------
    times : time constants of activation and deactivation where the muscle has none [s]
    smooth : whether activation switches smoothly between the two (De Groote et al. 2016)
    slowed : how far little activation slows the fibers: v_max (1 - slowed (1 - a))
    damping : normalized damping of the fibers where the muscle has none
    undamped : normalized damping below which the fibers have none
    elastic : whether the class has a `tendon`
    obeys_flags : whether the parameters `ignore_tendon_compliance` and
        `ignore_activation_dynamics` count
    passive_strain : parameter with the strain of the fibers at which the passive force is 1, and
        its default
    static_optimization : where OpenSim's differs
    """

    times: tuple[float, float] = (0.015, 0.060)
    smooth: bool = False
    slowed: float = 0.0
    damping: float = 0.0
    undamped: float = 0.0
    elastic: bool = False
    obeys_flags: bool = True
    passive_strain: tuple[str, float] | None = None
    static_optimization: StaticOptimization = StaticOptimization()

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves of the fibers; equal parameters give the same curves."""
        raise NotImplementedError

    def smooth_curves(self, muscle: Muscle) -> FiberCurves:
        """Curves for elastic tendons, whose solver needs continuous slopes."""
        return self.curves(muscle)

    def tendon(self, muscle: Muscle) -> Curve:
        """f_SE over the tendon's length by its slack length."""
        raise BadModel(f"muscle '{muscle.name}': tendons of {muscle.kind} are rigid")

    def stretch(self, muscle: Muscle) -> Curve:
        """Tendon length by slack length over the normalized force, the inverse of `tendon`."""
        return self.tendon(muscle).inverse()

    def resting_tendon(self, muscle: Muscle) -> Curve | None:
        """Tendon curve for static optimization with resting muscles: normalized force over strain.

        None where static optimization takes tendons as rigid.
        """
        return None

    def greatest_pennation(self, muscle: Muscle) -> float | None:
        """Pennation at which fibers are shortest and lose their force [rad]; None for no limit."""
        return None

    def pennation(self, muscle: Muscle) -> float:
        """Pennation at optimal length [rad]."""
        return muscle.pennation_at_optimal

    def fiber_damping(self, muscle: Muscle) -> float:
        """Damping of the fibers: normalized force at the maximum contraction velocity."""
        return muscle.parameters.get("fiber_damping", self.damping)

    def stretched_passive(self, parameters: dict[str, float], factor: float) -> dict[str, float]:
        """Scale the strains at which the passive force of a muscle is reached.

        Parameters
        ----------
        parameters : of the muscle, changed in place
        factor : of the strains
        """
        if self.passive_strain is None:
            return parameters
        name, default = self.passive_strain
        strain = parameters.get(name, parameters.get(name.split("/")[-1], default))
        parameters[name] = factor * strain
        return parameters

    def has_elastic_tendon(self, muscle: Muscle) -> bool:
        """Whether the class has a curve for tendons, and the muscle lets its tendon stretch."""
        rigid = self.obeys_flags and bool(muscle.parameters.get("ignore_tendon_compliance"))
        return self.elastic and muscle.tendon_slack_length > 0.0 and not rigid

    def sizes(self, muscle: Muscle) -> FiberSizes:
        """Sizes that formulas of every class read.

        Fibers keep their height over the tendon's line: height = L0 sin(pennation at L0). Where
        they have a greatest pennation, shortest = height / sin(greatest pennation).
        """
        pennation = self.pennation(muscle)
        height = muscle.optimal_fiber_length * float(np.sin(pennation))
        end = self.greatest_pennation(muscle)
        shortest = height
        along = 0.0
        if end is not None:
            shortest = SHORTEST_UNPENNATED * muscle.optimal_fiber_length
            if end > MIN_PENNATION:
                shortest = height / float(np.sin(end))
            along = shortest * float(np.cos(end))
        return FiberSizes(
            force=muscle.max_isometric_force,
            fiber=muscle.optimal_fiber_length,
            tendon=muscle.tendon_slack_length,
            height=height,
            shortest=shortest,
            shortest_along=along,
            cos_optimal=float(np.cos(pennation)),
            speed=muscle.max_contraction_velocity * muscle.optimal_fiber_length,
        )


def numbers(muscle: Muscle, **defaults: float) -> tuple[float, ...]:
    """Read parameters of a muscle by name.

    Parameters
    ----------
    muscle : whose parameters are read
    defaults : values of parameters that it does not have

    Returns
    -------
    a value for each of `defaults`, in their order
    """
    return tuple(float(muscle.parameters.get(name, default)) for name, default in defaults.items())

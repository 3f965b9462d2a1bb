"""What a class of muscles is: its curves, its parameters, and where OpenSim's static optimization
departs from them.

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


class FiberCurves(NamedTuple):
    """Curves of a muscle's fibers."""

    # active, passive: f_L and f_PE over the normalized fiber length
    active: Curve
    velocity: Curve  # f_V over the normalized fiber velocity, negative where fibers shorten
    passive: Curve


class FiberSizes(NamedTuple):
    """Sizes of a muscle."""

    # force, fiber, tendon: maximum isometric force [N], optimal fiber length [m], tendon slack
    # length [m]
    force: float
    fiber: float
    tendon: float
    height: float  # constant height of the fibers over the tendon's line [m]
    # shortest, shortest_along: least fiber length [m] and its part along the tendon [m]
    shortest: float
    shortest_along: float
    cos_optimal: float  # cosine of the pennation at optimal length
    speed: float  # maximum contraction velocity [m/s]


@dataclass(frozen=True)
class StaticOptimization:
    """How the forces that OpenSim 4.6 takes in its static optimization differ from those of a rigid
    tendon.
    """

    bounded: bool = True  # whether fibers end where their part along the tendon is 0
    turning: bool = True  # whether the path's velocity is projected on the fibers
    # what the normalized fiber length is multiplied with, where the sine of the pennation is the
    # fibers' height over it [m]; None for the pennation as it is, `NO_PENNATION` for none
    pennation_by: float | None = None


class MuscleModel:
    """A class of muscles with rigid tendons, and with elastic ones where `tendon` is given.
    `times`: time constants of activation and deactivation [s], where the muscle has none; `smooth`:
    whether activation switches smoothly between the two (De Groote et al. 2016); `slowed`: how far
    activation slows the fibers: v_max (1 - slowed (1 - a)); `damping`, `undamped`: normalized
    damping of the fibers where the muscle gives none, and below which they have none; `elastic`:
    whether `tendon` is given; `obeys_flags`: whether the parameters `ignore_tendon_compliance` and
    `ignore_activation_dynamics` count; `passive_strain`: parameter with the strain of the fibers at
    which the passive force is 1, and its default; `static_optimization`: where OpenSim's differs.
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
        """The curves with elastic tendons, whose solver needs continuous slopes."""
        return self.curves(muscle)

    def tendon(self, muscle: Muscle) -> Curve:
        """f_SE over the tendon's length by its slack length."""
        raise BadModel(f"muscle '{muscle.name}': tendons of {muscle.kind} are rigid")

    def stretch(self, muscle: Muscle) -> Curve:
        """The inverse of `tendon`: tendon length by slack length over the normalized force."""
        return self.tendon(muscle).inverse()

    def resting_tendon(self, muscle: Muscle) -> Curve | None:
        """Normalized force over strain, where static optimization takes muscles in equilibrium with
        it at rest.
        """
        return None

    def greatest_pennation(self, muscle: Muscle) -> float | None:
        """The pennation at which fibers are shortest and lose their force [rad]; None where nothing
        ends them.
        """
        return None

    def pennation(self, muscle: Muscle) -> float:
        """At optimal length [rad]."""
        return muscle.pennation_at_optimal

    def fiber_damping(self, muscle: Muscle) -> float:
        """Normalized force of the fibers' damper at the maximum contraction velocity."""
        return muscle.parameters.get("fiber_damping", self.damping)

    def stretched_passive(self, parameters: dict[str, float], factor: float) -> dict[str, float]:
        """Parameters of a muscle whose passive force is reached at strains larger by a factor."""
        if self.passive_strain is not None:
            name, default = self.passive_strain
            parameters[name] = factor * parameters.get(
                name, parameters.get(name.split("/")[-1], default)
            )
        return parameters

    def has_elastic_tendon(self, muscle: Muscle) -> bool:
        """Whether the class has a curve for tendons, and the muscle lets its tendon stretch."""
        rigid = self.obeys_flags and bool(muscle.parameters.get("ignore_tendon_compliance"))
        return self.elastic and muscle.tendon_slack_length > 0.0 and not rigid

    def sizes(self, muscle: Muscle) -> FiberSizes:
        """Sizes that formulas of every class read."""
        pennation = self.pennation(muscle)
        height = muscle.optimal_fiber_length * float(np.sin(pennation))
        end = self.greatest_pennation(muscle)
        shortest = height
        along = 0.0
        if end is not None:
            shortest = (
                height / float(np.sin(end)) if end > 1e-14 else 0.01 * muscle.optimal_fiber_length
            )
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
    """Parameters of a muscle by name, with their defaults."""
    return tuple(float(muscle.parameters.get(name, default)) for name, default in defaults.items())

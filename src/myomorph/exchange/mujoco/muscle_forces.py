"""The parameters of MuJoCo's muscles that come nearest to those of a model, and what they lack.

MuJoCo's muscle has a rigid tendon and no pennation. Its fiber is that of ours along the tendon, L0
cos(pennation). Its curves are parabolas of the fiber's length and velocity, whose parameters have
the least sum of squares to ours.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.hill import hill_forces
from myomorph.exchange.mujoco.copy import MujocoCopy

# Normalized fiber lengths that MuJoCo's `lengthrange` stands for.
RANGE = (0.5, 1.6)
SHORTEST, LONGEST = RANGE

LENGTHS = np.linspace(0.3, 1.9, 321)
SPEEDS = np.linspace(-1.5, 1.5, 301)
# Velocity up to which curves are fitted; walks and runs stay below it [of the fastest].
USUAL = 0.5
# Lengths at which both muscles are compared.
COMPARED = (LENGTHS >= SHORTEST) & (LENGTHS <= LONGEST)

LOW = np.linspace(0.0, 0.9, 181)
HIGH = np.linspace(1.1, 3.0, 381)
"""Choices of `lmin` and `lmax`; MuJoCo takes a negative `lmin` for none and puts its default there.
"""
FASTEST = np.linspace(0.2, 1.5, 261)
STRONGEST = np.linspace(1.02, 2.5, 297)
"""Choices of `vmax` over that of ours, and of `fvmax`."""

TIME_CONSTANTS = (0.01, 0.04)  # Activation and deactivation [s].


@read_only
class MuscleCurves:
    """Curves of muscles by fiber length along the tendon and velocity.

    Forces are over the strength at optimal length.
    """

    active: Array  # active, passive: (lengths, muscles) at `LENGTHS`
    passive: Array
    velocity: Array  # (speeds, muscles) at `SPEEDS`, in the muscles' fastest
    strength: Array  # (muscles,) force of the fully active fiber at its optimal length [N]


def curves_of(model: Model) -> MuscleCurves:
    """Sample the force curves of a model's muscles."""
    fiber, slack, fastest = _fibers(model)
    still = np.zeros((len(LENGTHS), len(fiber)))
    forces = hill_forces(model, slack + LENGTHS[:, None] * fiber, still)
    optimal = np.broadcast_to(slack + fiber, (len(SPEEDS), len(fiber)))
    moving = hill_forces(model, optimal, SPEEDS[:, None] * (fastest * fiber))
    strength = hill_forces(model, optimal[:1], still[:1]).active[0]
    scale = np.where(strength > 0.0, strength, 1.0)
    return MuscleCurves(
        active=forces.active / scale,
        passive=forces.passive / scale,
        velocity=moving.active / scale,
        strength=strength,
    )


def _fibers(model: Model) -> tuple[Array, Array, Array]:
    fiber = np.array(
        [
            muscle.optimal_fiber_length
            * (np.cos(muscle.pennation_at_optimal) if muscle.kind != "mujoco" else 1.0)
            for muscle in model.muscles
        ]
    )
    slack = np.array([muscle.tendon_slack_length for muscle in model.muscles])
    return fiber, slack, np.array([muscle.max_contraction_velocity for muscle in model.muscles])


def mujoco_muscles(model: Model) -> tuple[Muscle, ...]:
    """Return the muscles as MuJoCo's; those that are stay."""
    if not model.muscles:
        return ()
    curves = curves_of(model)
    fiber, slack, fastest = _fibers(model)
    low, high = _widths(curves)
    share = _speed_shares(curves)
    made = []
    for m, muscle in enumerate(model.muscles):
        if muscle.kind == "mujoco":
            made.append(muscle)
            continue
        parameters = {
            "range0": RANGE[0],
            "range1": RANGE[1],
            "lengthrange0": slack[m] + RANGE[0] * fiber[m],
            "lengthrange1": slack[m] + RANGE[1] * fiber[m],
            "force": curves.strength[m],
            "scale": 200.0,
            "lmin": low[m],
            "lmax": high[m],
            "vmax": fastest[m] * share[m],
            "fpmax": _passive_strength(curves.passive[:, m], high[m]),
            "fvmax": _lengthening_strength(curves.velocity[:, m : m + 1], share[m]),
            "timeconst0": TIME_CONSTANTS[0],
            "timeconst1": TIME_CONSTANTS[1],
        }
        made.append(
            replace(
                muscle,
                kind="mujoco",
                max_isometric_force=float(curves.strength[m]),
                optimal_fiber_length=float(fiber[m]),
                pennation_at_optimal=0.0,
                max_contraction_velocity=float(parameters["vmax"]),
                parameters=FrozenMap({key: float(value) for key, value in parameters.items()}),
                curves=FrozenMap({}),
                viscosity=0.0,
            )
        )
    return tuple(made)


def _widths(curves: MuscleCurves) -> tuple[Array, Array]:
    """Fit `lmin` and `lmax` (muscles,) to both sides of the active curves."""
    rising = COMPARED & (LENGTHS <= 1.0)
    low = _nearest(LOW, _active(1.0 - LENGTHS[rising], 0.5 * (1.0 - LOW)), curves.active[rising])
    falling = COMPARED & (LENGTHS >= 1.0)
    half = 0.5 * (HIGH - 1.0)
    high = _nearest(HIGH, _active(LENGTHS[falling] - 1.0, half), curves.active[falling])
    return low, high


def _speed_shares(curves: MuscleCurves) -> Array:
    """Fit `vmax` (muscles,), over the muscles' own, to shortening fibers."""
    slower = (SPEEDS >= -USUAL) & (SPEEDS <= 0.0)
    shapes = np.maximum(1.0 + SPEEDS[slower] / FASTEST[:, None], 0.0) ** 2
    return _nearest(FASTEST, shapes, curves.velocity[slower])


def _passive_strength(passive: Array, high: float) -> float:
    """Fit `fpmax` to a passive curve (lengths,), for a muscle whose `lmax` is `high`."""
    falling = COMPARED & (LENGTHS >= 1.0)
    stretch = (LENGTHS[falling] - 1.0) / (0.5 * (high - 1.0))
    shape = np.where(stretch < 1.0, 0.5 * stretch**2, stretch - 0.5)
    return max(float(shape @ passive[falling] / (shape @ shape)), 0.0)


def _lengthening_strength(velocity: Array, share: float) -> float:
    """Fit `fvmax` to a force-velocity curve (speeds, 1) of lengthening fibers.

    `share`: `vmax` over the muscle's own fastest velocity.
    """
    faster = (SPEEDS >= 0.0) & (SPEEDS <= USUAL)
    over = STRONGEST[:, None] - 1.0
    lengthening = 1.0 + over - np.maximum(over - SPEEDS[faster] / share, 0.0) ** 2 / over
    return float(_nearest(STRONGEST, lengthening, velocity[faster])[0])


def _active(away: Array, half: Array) -> Array:
    """Return MuJoCo's active curve (choices, lengths) at lengths `away` from the optimum.

    It is half as strong at `half`.
    """
    x = away / half[:, None]
    return np.where(x < 1.0, 1.0 - 0.5 * x**2, 0.5 * np.maximum(2.0 - x, 0.0) ** 2)


def _nearest(choices: Array, shapes: Array, wanted: Array) -> Array:
    """Return for each muscle the choice (muscles,) whose shape is nearest to what is wanted.

    It has the least sum of squares of the shapes (choices, samples).
    """
    costs = (shapes**2).sum(axis=1)[:, None] - 2.0 * shapes @ wanted
    return np.asarray(choices[costs.argmin(axis=0)])


def force_differences(model: Model, copy: MujocoCopy) -> tuple[Array, Array]:
    """Return the largest differences of MuJoCo's forces from ours over each muscle's strength.

    Parameters
    ----------
    model : with muscles
    copy : MuJoCo's copy of it

    Returns
    -------
    (muscles,) isometric, active and passive, at fiber lengths from 0.5 to 1.6, and (muscles,)
    active at the optimal length at any velocity
    """
    curves = curves_of(model)
    fiber, slack, fastest = _fibers(model)
    strength = np.where(curves.strength > 0.0, curves.strength, np.inf)
    lengths = slack + LENGTHS[COMPARED, None] * fiber
    speeds = SPEEDS[:, None] * (fastest * fiber)
    active, passive = copy.muscle_forces(lengths, np.zeros_like(lengths))
    still = np.abs(active / strength - curves.active[COMPARED]) + np.abs(
        passive / strength - curves.passive[COMPARED]
    )
    moving = (
        copy.muscle_forces(np.broadcast_to(slack + fiber, speeds.shape), speeds)[0] / strength
        - curves.velocity
    )
    return still.max(axis=0), np.abs(moving).max(axis=0)

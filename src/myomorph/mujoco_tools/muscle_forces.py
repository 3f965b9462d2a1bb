"""The parameters of MuJoCo's muscles that come nearest to those of a model, and what they lack.

MuJoCo's muscle has a rigid tendon and no pennation. Its fiber is that of ours along the tendon, L0 cos(pennation), its
curves are parabolas through the points where ours are half as strong, come to rest, and hold passively:

    l_min = 2 l(f_L = 1/2, rising) - 1,   l_max = 2 l(f_L = 1/2, falling) - 1,   fp_max = 2 f_PE((1 + l_max) / 2).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.hill import hill_forces

RANGE = (0.5, 1.6)
"""Normalized fiber lengths that MuJoCo's `lengthrange` stands for."""

LENGTHS = np.linspace(0.3, 1.9, 321)
SPEEDS = np.linspace(-1.5, 1.5, 301)
HALF = 0.5
STILL = 1e-3
COMPARED = slice(40, 261)
"""Of the lengths, those from 0.5 to 1.6, where both muscles are compared."""

TIME_CONSTANTS = (0.01, 0.04)
"""Activation and deactivation [s]."""


@read_only
class MuscleCurves:
    """Curves of muscles by fiber length along the tendon and velocity, over the strength at optimal length.

    Attributes
    ----------
    active, passive : (lengths, muscles) at `LENGTHS`
    velocity : (speeds, muscles) at `SPEEDS`, in the muscles' fastest
    strength : (muscles,) force of the fully active fiber at its optimal length [N]
    """

    active: Array
    passive: Array
    velocity: Array
    strength: Array


def curves_of(model: Model) -> MuscleCurves:
    """What the muscles of a model pull with, sampled."""
    fiber, slack, fastest = _fibers(model)
    still = np.zeros((len(LENGTHS), len(fiber)))
    forces = hill_forces(model, slack + LENGTHS[:, None] * fiber, still)
    optimal = np.broadcast_to(slack + fiber, (len(SPEEDS), len(fiber)))
    moving = hill_forces(model, optimal, SPEEDS[:, None] * (fastest * fiber))
    strength = hill_forces(model, optimal[:1], still[:1]).active[0]
    scale = np.where(strength > 0.0, strength, 1.0)
    return MuscleCurves(forces.active / scale, forces.passive / scale, moving.active / scale, strength)


def _fibers(model: Model) -> tuple[Array, Array, Array]:
    fiber = np.array(
        [
            muscle.optimal_fiber_length * (np.cos(muscle.pennation_at_optimal) if muscle.kind != "mujoco" else 1.0)
            for muscle in model.muscles
        ]
    )
    slack = np.array([muscle.tendon_slack_length for muscle in model.muscles])
    return fiber, slack, np.array([muscle.max_contraction_velocity for muscle in model.muscles])


def mujoco_muscles(model: Model) -> tuple[tuple[Muscle, ...], Array]:
    """The muscles as MuJoCo's, and the largest difference of each one's isometric force, over its strength.

    Returns
    -------
    muscles, differences : (muscles,) of active and passive force at fiber lengths from 0.5 to 1.6
    """
    if not model.muscles:
        return (), np.zeros(0)
    curves = curves_of(model)
    fiber, slack, fastest = _fibers(model)
    made = []
    for m, muscle in enumerate(model.muscles):
        if muscle.kind == "mujoco":
            made.append(muscle)
            continue
        active, velocity = curves.active[:, m], curves.velocity[:, m]
        peak = int(np.argmax(active))
        low = np.interp(HALF, active[: peak + 1], LENGTHS[: peak + 1])
        high = np.interp(-HALF, -active[peak:], LENGTHS[peak:])
        low, high = 2.0 * low - 1.0, 2.0 * high - 1.0
        still = SPEEDS[velocity > STILL]
        parameters = {
            "range0": RANGE[0],
            "range1": RANGE[1],
            "lengthrange0": slack[m] + RANGE[0] * fiber[m],
            "lengthrange1": slack[m] + RANGE[1] * fiber[m],
            "force": curves.strength[m],
            "scale": 200.0,
            "lmin": low,
            "lmax": high,
            "vmax": fastest[m] * (-still[0] if len(still) else 1.0),
            "fpmax": max(2.0 * np.interp(0.5 * (1.0 + high), LENGTHS, curves.passive[:, m]), 0.0),
            "fvmax": max(float(velocity.max()), 1.01),
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
    after = curves_of(replace(model, muscles=tuple(made)))
    wrong = np.abs(after.active - curves.active)[COMPARED] + np.abs(after.passive - curves.passive)[COMPARED]
    return tuple(made), wrong.max(axis=0)

"""Fibers and tendons of Hill-type muscles whose states are known: lengths, velocities, forces and
powers.

Beside `hill`, whose tendons are rigid, stands what an integrator of muscles needs: with activation
a and fiber length l given (or the normalized tendon force, for DeGrooteFregly2016Muscle), the
tendon's length follows from the path, its force from its curve, and the fiber velocity v is what
balances

    (a f_L(l) f_V(v) + f_PE(l) + damping v) cos(alpha) = f_SE(tendon)

Tendons that a model calls rigid take l and v from the path instead. Conventions, defaults and
clamps are those of OpenSim 4.6, so that tables of its MuscleAnalysis come out alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.fiber_equations import (
    ACTIVATION,
    FIBER_LENGTH,
    TENDON_FORCE,
    FiberMuscle,
    Fibers,
)
from myomorph.core.muscles.hill import MODELS, loaded, muscle_model


@dataclass(frozen=True, eq=False)
class FiberStates(Fibers):
    """Fibers and tendons over time, every array (frames, muscles)."""

    muscles: tuple[str, ...]
    in_balance: np.ndarray  # False where equilibrium was asked for and none was found

    def __post_init__(self) -> None:
        for field in fields(Fibers):
            object.__setattr__(
                self, field.name, frozen_array(getattr(self, field.name), (-1, len(self.muscles)))
            )


def without_fibers(model: Model) -> tuple[str, ...]:
    """Classes of the model's muscles that `fiber_states` does not know."""
    return tuple(
        dict.fromkeys(muscle.kind for muscle in model.muscles if fiber_muscle(muscle) is None)
    )


def fiber_muscle(muscle: Muscle) -> FiberMuscle | None:
    """The class of a muscle, where its fibers have states."""
    model = muscle_model(muscle) if muscle.kind in MODELS else None
    return model if isinstance(model, FiberMuscle) else None


def state_names(muscle: Muscle) -> tuple[str, ...]:
    """The states that OpenSim gives a muscle, as it names them; of a class that is not built, those
    of most.
    """
    return (fiber_muscle(muscle) or FiberMuscle()).states(muscle)


def default_states(model: Model) -> dict[tuple[str, str], float]:
    """The states of all muscles by muscle and name, where no file gives them."""
    return {
        (muscle.name, name): (fiber_muscle(muscle) or FiberMuscle()).first_state(muscle, name)
        for muscle in model.muscles
        for name in state_names(muscle)
    }


def fibers_of(
    muscle: Muscle, length: Array, speed: Array, activation: Array, state: Array | None
) -> Fibers:
    """Fibers and tendon of one muscle whose class has states.
    `length`, `speed` (frames,) of the path [m], [m/s]; `activation` (frames,); `state` (frames,)
    fiber length [m] or normalized tendon force; None for a rigid tendon.
    """
    model = _fiber_muscle(muscle)
    # A state far from any balance, which a file may hold, gives infinite numbers as it does in
    # OpenSim.
    with np.errstate(all="ignore"):
        return model.fibers(muscle, length, speed, model.activation(muscle, activation), state)


def equilibrium(muscle: Muscle, length: Array, speed: Array, activation: Array) -> Array:
    """Fiber length [m] or normalized tendon force, (frames,), of one muscle in equilibrium, NaN
    where none is found.
    """
    with np.errstate(all="ignore"):
        return _fiber_muscle(muscle).equilibrium(muscle, length, speed, activation)


def _fiber_muscle(muscle: Muscle) -> FiberMuscle:
    model = fiber_muscle(muscle)
    if model is None:
        built = ", ".join(
            kind for kind, place in MODELS.items() if isinstance(loaded(place), FiberMuscle)
        )
        raise BadData(f"fibers of {muscle.kind} are not built: there are {built}")
    return model


def fiber_states(
    model: Model,
    lengths: Array,
    speeds: Array,
    states: Mapping[tuple[str, str], Array] | None = None,
    balanced: bool = False,
) -> tuple[FiberStates, Mapping[tuple[str, str], Array]]:
    """Fibers and tendons of all muscles, and the states (muscle, name) that they have.
    `lengths`, `speeds` (frames, muscles) of the muscle paths [m], [m/s]; `states` (frames,) by
    muscle and name of `state_names`; what is missing stands at the model's default; `balanced`:
    take fiber lengths and tendon forces from equilibrium instead, as OpenSim finds it; where it
    finds none, what was given stands.
    """
    for muscle in model.muscles:
        _fiber_muscle(muscle)
    lengths = np.asarray(lengths, dtype=np.float64)
    speeds = np.asarray(speeds, dtype=np.float64)
    if lengths.ndim != 2 or lengths.shape[1] != len(model.muscles) or speeds.shape != lengths.shape:
        raise BadData(
            f"expected lengths and speeds of shape (frames, {len(model.muscles)}), but got"
            f" {lengths.shape} and {speeds.shape}"
        )
    values = {
        key: np.full(len(lengths), value) for key, value in default_states(model).items()
    } | dict(states or {})
    columns: list[Fibers] = []
    in_balance = np.ones(lengths.shape, bool)
    for m, muscle in enumerate(model.muscles):
        # Without a controller OpenSim's control is 0, which is the activation where dynamics are
        # left out.
        a = values.get((muscle.name, ACTIVATION), np.zeros(len(lengths)))
        last = ("", *state_names(muscle))[-1]
        elastic = last in (FIBER_LENGTH, TENDON_FORCE)
        if balanced and elastic:
            state = equilibrium(muscle, lengths[:, m], speeds[:, m], a)
            in_balance[:, m] = np.isfinite(state)
            values[muscle.name, last] = np.where(in_balance[:, m], state, values[muscle.name, last])
        columns.append(
            fibers_of(
                muscle,
                lengths[:, m],
                speeds[:, m],
                a,
                values[muscle.name, last] if elastic else None,
            )
        )
    names = [field.name for field in fields(Fibers)]
    nothing = np.zeros((len(lengths), 0))
    stacked = {
        name: (
            np.stack([getattr(column, name) for column in columns], axis=1) if columns else nothing
        )
        for name in names
    }
    return FiberStates(**stacked, muscles=model.muscle_names, in_balance=in_balance), values

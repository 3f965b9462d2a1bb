"""Fibers and tendons of Hill-type muscles with known states: lengths, velocities, forces, powers.

Where `hill` has rigid tendons, this is what an integrator of muscles needs: from activation a and
fiber length l (or the normalized tendon force, for DeGrooteFregly2016Muscle), the tendon's length
follows from the path, its force from its curve, and the fiber velocity v balances

    (a f_L(l) f_V(v) + f_PE(l) + damping v) cos(alpha) = f_SE(tendon)

Tendons that a model calls rigid take l and v from the path instead. Conventions, defaults and
clamps are those of OpenSim 4.6, so that tables of its MuscleAnalysis come out alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.shapes import FrameValues
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
    """Fibers and tendons over time, every array (frames, muscles).

    Attributes
    ----------
    muscles : names
    in_balance : (frames, muscles) False where equilibrium was requested and none exists
    """

    muscles: tuple[str, ...]
    in_balance: np.ndarray

    def __post_init__(self) -> None:
        for field in fields(Fibers):
            values = frozen_array(getattr(self, field.name), (-1, len(self.muscles)))
            object.__setattr__(self, field.name, values)


def without_fibers(model: Model) -> tuple[str, ...]:
    """List the classes of the model's muscles that `fiber_states` does not know, each once."""
    kinds = (muscle.kind for muscle in model.muscles if fiber_muscle(muscle) is None)
    return tuple(dict.fromkeys(kinds))


def fiber_muscle(muscle: Muscle) -> FiberMuscle | None:
    """Find the class of a muscle, None where its fibers have no states."""
    model = muscle_model(muscle) if muscle.kind in MODELS else None
    return model if isinstance(model, FiberMuscle) else None


def state_names(muscle: Muscle) -> tuple[str, ...]:
    """Names of the states that OpenSim gives a muscle.

    A class that is not built is taken to have those of most classes.
    """
    return (fiber_muscle(muscle) or FiberMuscle()).states(muscle)


def default_states(model: Model) -> dict[tuple[str, str], float]:
    """Values of all states where no file has them, by names of muscle and state."""
    return {
        (muscle.name, name): (fiber_muscle(muscle) or FiberMuscle()).first_state(muscle, name)
        for muscle in model.muscles
        for name in state_names(muscle)
    }


def fibers_of(
    muscle: Muscle,
    length: FrameValues,
    speed: FrameValues,
    activation: FrameValues,
    state: FrameValues | None,
) -> Fibers:
    """Fibers and tendon of one muscle whose class has states.

    Parameters
    ----------
    muscle : whose class has states
    length, speed : (frames,) of the path [m], [m/s]
    activation : (frames,)
    state : (frames,) fiber length [m] or normalized tendon force; None for a rigid tendon

    Returns
    -------
    arrays (frames,)

    Raises
    ------
    BadData : the class has no states
    """
    model = _fiber_muscle(muscle)
    # A state far from any balance, which a file may hold, gives infinite numbers as it does in
    # OpenSim.
    with np.errstate(all="ignore"):
        return model.fibers(muscle, length, speed, model.activation(muscle, activation), state)


def equilibrium(
    muscle: Muscle, length: FrameValues, speed: FrameValues, activation: FrameValues
) -> FrameValues:
    """State of one muscle in equilibrium, as OpenSim finds it.

    Parameters
    ----------
    muscle : whose class has states
    length, speed : (frames,) of the path [m], [m/s]
    activation : (frames,)

    Returns
    -------
    (frames,) fiber length [m] or normalized tendon force, NaN where no equilibrium is found

    Raises
    ------
    BadData : the class has no states
    """
    with np.errstate(all="ignore"):
        return _fiber_muscle(muscle).equilibrium(muscle, length, speed, activation)


def _fiber_muscle(muscle: Muscle) -> FiberMuscle:
    """Find the class of a muscle; `BadData` where its fibers have no states."""
    model = fiber_muscle(muscle)
    if model is None:
        built = ", ".join(
            kind for kind, place in MODELS.items() if isinstance(loaded(place), FiberMuscle)
        )
        raise BadData(f"fibers of {muscle.kind} are not supported: there are {built}")
    return model


def fiber_states(
    model: Model,
    lengths: Array,
    speeds: Array,
    states: Mapping[tuple[str, str], Array] | None = None,
    balanced: bool = False,
) -> tuple[FiberStates, Mapping[tuple[str, str], Array]]:
    """Fibers and tendons of all muscles.

    Parameters
    ----------
    model : with muscles whose classes have states
    lengths, speeds : (frames, muscles) of the muscle paths [m], [m/s]
    states : (frames,) by names of muscle and state, of `state_names`; what is missing has the
        model's default
    balanced : take fiber lengths and tendon forces from equilibrium instead; where there is none,
        those of `states` stay

    Returns
    -------
    fibers : arrays (frames, muscles)
    states : (frames,) by names of muscle and state, of all muscles

    Raises
    ------
    BadData : a class has no states, or the shape of an array is wrong
    """
    for muscle in model.muscles:
        _fiber_muscle(muscle)
    lengths = np.asarray(lengths, dtype=np.float64)
    speeds = np.asarray(speeds, dtype=np.float64)
    expected = (*lengths.shape[:1], len(model.muscles))
    if lengths.shape != expected or speeds.shape != expected:
        raise BadData(
            f"expected lengths and speeds of shape (frames, {len(model.muscles)}), but got"
            f" {lengths.shape} and {speeds.shape}"
        )
    defaults = default_states(model).items()
    values = {key: np.full(len(lengths), value) for key, value in defaults} | dict(states or {})
    columns: list[Fibers] = []
    in_balance = np.ones(lengths.shape, bool)
    for m, muscle in enumerate(model.muscles):
        # Without a controller OpenSim's control is 0, which is the activation where dynamics are
        # left out.
        activation = values.get((muscle.name, ACTIVATION), np.zeros(len(lengths)))
        state_name = ("", *state_names(muscle))[-1]
        is_elastic = state_name in (FIBER_LENGTH, TENDON_FORCE)
        length = lengths[:, m]
        speed = speeds[:, m]
        key = (muscle.name, state_name)
        if balanced and is_elastic:
            state = equilibrium(muscle, length, speed, activation)
            in_balance[:, m] = np.isfinite(state)
            values[key] = np.where(in_balance[:, m], state, values[key])
        known_state = values[key] if is_elastic else None
        columns.append(fibers_of(muscle, length, speed, activation, known_state))
    return _side_by_side(columns, model.muscle_names, in_balance), values


def _side_by_side(
    columns: Sequence[Fibers], muscles: tuple[str, ...], in_balance: np.ndarray
) -> FiberStates:
    """Put muscles, each of arrays (frames,), into arrays (frames, muscles)."""

    def stacked(name: str) -> Array:
        if not columns:
            return np.zeros(in_balance.shape)
        return np.stack([getattr(column, name) for column in columns], axis=1)

    return FiberStates(
        muscles=muscles,
        in_balance=in_balance,
        activation=stacked("activation"),
        fiber_length=stacked("fiber_length"),
        tendon_length=stacked("tendon_length"),
        pennation=stacked("pennation"),
        fiber_velocity=stacked("fiber_velocity"),
        normalized_velocity=stacked("normalized_velocity"),
        pennation_velocity=stacked("pennation_velocity"),
        active_force=stacked("active_force"),
        passive_force=stacked("passive_force"),
        fiber_force=stacked("fiber_force"),
        tendon_force=stacked("tendon_force"),
        active_power=stacked("active_power"),
        passive_power=stacked("passive_power"),
        tendon_power=stacked("tendon_power"),
        muscle_power=stacked("muscle_power"),
    )

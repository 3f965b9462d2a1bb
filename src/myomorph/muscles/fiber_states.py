"""Fibers and tendons of Hill-type muscles whose states are known: lengths, velocities, forces and powers.

Beside `hill`, whose tendons are rigid, stands what an integrator of muscles needs: with activation a and fiber
length l given (or the normalized tendon force, for DeGrooteFregly2016Muscle), the tendon's length follows from the
path, its force from its curve, and the fiber velocity v is what balances

    (a f_L(l) f_V(v) + f_PE(l) + damping v) cos(alpha) = f_SE(tendon)

Tendons that a model calls rigid take l and v from the path instead. Conventions, defaults and clamps are those of
OpenSim 4.6, so that tables of its MuscleAnalysis come out alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.fiber_equations import Fibers, fibers_of, shortest_fiber
from myomorph.muscles.fiber_equilibrium import equilibrium
from myomorph.muscles.hill_arrays import compile_hill
from myomorph.muscles.hill_classes import DEGROOTE, KINDS, MILLARD, RIGID, THELEN

BUILT = (THELEN, MILLARD, DEGROOTE, RIGID)
ACTIVATION, FIBER_LENGTH, TENDON_FORCE = "activation", "fiber_length", "normalized_tendon_force"


@dataclass(frozen=True, eq=False)
class FiberStates(Fibers):
    """Fibers and tendons over time, every array (frames, muscles).

    Attributes
    ----------
    in_balance : False where equilibrium was asked for and none was found
    """

    muscles: tuple[str, ...]
    in_balance: np.ndarray

    def __post_init__(self) -> None:
        for field in fields(Fibers):
            object.__setattr__(self, field.name, frozen_array(getattr(self, field.name), (-1, len(self.muscles))))


def without_fibers(model: Model) -> tuple[str, ...]:
    """Classes of the model's muscles that `fiber_states` does not know."""
    return tuple(dict.fromkeys(muscle.kind for muscle in model.muscles if KINDS.get(muscle.kind) not in BUILT))


def state_names(muscle: Muscle) -> tuple[str, ...]:
    """The states that OpenSim gives a muscle, as it names them."""
    kind = KINDS.get(muscle.kind)
    # Thelen2003Muscle has these properties, but does not read them.
    flags = muscle.parameters if kind != THELEN else {}
    active = () if kind == RIGID or flags.get("ignore_activation_dynamics") else (ACTIVATION,)
    if kind == RIGID or flags.get("ignore_tendon_compliance"):
        return active
    return (*active, TENDON_FORCE if kind == DEGROOTE else FIBER_LENGTH)


def default_state(model: Model, m: int, name: str) -> float:
    """The value of a state of muscle m where no file gives it."""
    muscle = model.muscles[m]
    fallback = {ACTIVATION: 0.05, FIBER_LENGTH: 0.1, TENDON_FORCE: 0.5}[name]
    if name == ACTIVATION and KINDS[muscle.kind] == DEGROOTE:
        fallback = 0.5
    value = float(muscle.parameters.get(f"default_{name}", fallback))
    if name == FIBER_LENGTH and KINDS[muscle.kind] == MILLARD:
        return max(value, shortest_fiber(compile_hill(model), m, muscle))
    return value


def default_states(model: Model) -> dict[tuple[str, str], float]:
    """The states of all muscles by muscle and name, where no file gives them."""
    return {
        (muscle.name, name): default_state(model, m, name)
        for m, muscle in enumerate(model.muscles)
        for name in state_names(muscle)
    }


def fiber_states(
    model: Model,
    lengths: Array,
    speeds: Array,
    states: Mapping[tuple[str, str], Array] | None = None,
    balanced: bool = False,
) -> tuple[FiberStates, Mapping[tuple[str, str], Array]]:
    """Fibers and tendons of all muscles, and the states (muscle, name) that they have.

    Parameters
    ----------
    lengths, speeds : (frames, muscles) of the muscle paths [m], [m/s]
    states : (frames,) by muscle and name of `state_names`; what is missing stands at the model's default
    balanced : take fiber lengths and tendon forces from equilibrium instead, as OpenSim finds it; where it finds
        none, what was given stands

    Raises
    ------
    BadData
        where the model has muscles of a class that is not built, or arrays do not have one column a muscle
    """
    if unknown := without_fibers(model):
        raise BadData(f"fibers of {', '.join(unknown)} are not built: there are {', '.join(_built())}")
    lengths, speeds = (np.asarray(one, dtype=np.float64) for one in (lengths, speeds))
    if lengths.ndim != 2 or lengths.shape[1] != len(model.muscles) or speeds.shape != lengths.shape:
        raise BadData(
            f"expected lengths and speeds of shape (frames, {len(model.muscles)}), but got {lengths.shape} and "
            f"{speeds.shape}"
        )
    given = {key: np.full(len(lengths), value) for key, value in default_states(model).items()} | dict(states or {})
    columns: list[Fibers] = []
    in_balance = np.ones(lengths.shape, bool)
    for m, muscle in enumerate(model.muscles):
        # Without a controller OpenSim's control is 0, which is the activation where dynamics are left out.
        a = given.get((muscle.name, ACTIVATION), np.zeros(len(lengths)))
        last = ("", *state_names(muscle))[-1]
        elastic = last in (FIBER_LENGTH, TENDON_FORCE)
        if balanced and elastic:
            found = equilibrium(model, m, lengths[:, m], speeds[:, m], a)
            in_balance[:, m] = np.isfinite(found)
            given[muscle.name, last] = np.where(in_balance[:, m], found, given[muscle.name, last])
        state = given[muscle.name, last] if elastic else None
        columns.append(fibers_of(model, m, lengths[:, m], speeds[:, m], a, state))
    names = [field.name for field in fields(Fibers)]
    stacked = {name: _stacked([getattr(column, name) for column in columns], len(lengths)) for name in names}
    return FiberStates(**stacked, muscles=model.muscle_names, in_balance=in_balance), given


def _stacked(columns: list[Array], frames: int) -> Array:
    return np.stack(columns, axis=1) if columns else np.zeros((frames, 0))


def _built() -> tuple[str, ...]:
    return tuple(name for name, kind in KINDS.items() if kind in BUILT)

"""What-if: a model with weaker muscles, heavier bodies or other viscosity."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Body, Model, index_of
from myomorph.core.model.paths import Bushing

NO_FACTORS: Mapping[str, float] = FrozenMap({})


@dataclass(frozen=True, kw_only=True)
class Changes:
    """Factors of parts of a model.

    Attributes
    ----------
    strength : of muscles' maximum isometric forces, by name
    mass : of bodies' masses and inertias, by name
    viscosity : of all damping of joints, bushings and muscles
    """

    strength: Mapping[str, float] = field(default_factory=lambda: NO_FACTORS)
    mass: Mapping[str, float] = field(default_factory=lambda: NO_FACTORS)
    viscosity: float = 1.0

    def __bool__(self) -> bool:
        return bool(self.strength or self.mass) or self.viscosity != 1.0

    @property
    def sentence(self) -> str:
        """What is changed, in words."""
        parts = [
            f"{name} at {100 * factor:g} % of its strength"
            for name, factor in self.strength.items()
        ]
        parts += [f"{name} with {factor:g} times its mass" for name, factor in self.mass.items()]
        if self.viscosity != 1.0:
            parts.append(f"viscosity {self.viscosity:g} times as large")
        return ", ".join(parts) or "nothing changed"

    def applied(self, model: Model) -> Model:
        """Change a model.

        Raises
        ------
        BadData : a factor is below 0, or there is no viscosity to change
        UnknownName : the model has no such muscle or body
        """
        _check("a strength", self.strength)
        _check("a mass", self.mass)
        _check("viscosity", {"all": self.viscosity})
        for name in self.strength:
            index_of("muscle", name, model.muscle_names)
        for name in self.mass:
            index_of("body", name, model.body_names)
        if self.viscosity != 1.0 and not has_viscosity(model):
            raise BadData(
                f"model '{model.name}' has no viscosity to change: no damping of a joint, bushing"
                " or muscle; 'myomorph viscosity --into' writes an identified one into a model"
            )
        muscles = [
            replace(
                muscle,
                max_isometric_force=self.strength.get(muscle.name, 1.0)
                * muscle.max_isometric_force,
                viscosity=self.viscosity * muscle.viscosity,
            )
            for muscle in model.muscles
        ]
        torques = [
            replace(torque, damping=torque.damping.scaled(self.viscosity))
            for torque in model.passive_torques
        ]
        return replace(
            model,
            bodies=tuple(_heavier(body, self.mass.get(body.name, 1.0)) for body in model.bodies),
            muscles=tuple(muscles),
            passive_torques=tuple(torques),
            bushings=tuple(_damped(bushing, self.viscosity) for bushing in model.bushings),
        )

    def to_json(self) -> str:
        """Write as text."""
        return json.dumps(
            {
                "strength": dict(self.strength),
                "mass": dict(self.mass),
                "viscosity": self.viscosity,
            }
        )

    @staticmethod
    def from_json(text: str) -> Changes:
        """Read what `to_json` wrote."""
        entries = json.loads(text)
        return Changes(
            strength=FrozenMap(entries["strength"]),
            mass=FrozenMap(entries["mass"]),
            viscosity=entries["viscosity"],
        )


NO_CHANGES = Changes()


def has_viscosity(model: Model) -> bool:
    """Whether anything in a model is damped."""
    bushings = [
        np.concatenate([bushing.rotational_damping, bushing.translational_damping])
        for bushing in model.bushings
    ]
    at_zero = np.zeros(1)
    return (
        any(muscle.viscosity > 0.0 for muscle in model.muscles)
        or any(bool(damping.any()) for damping in bushings)
        or any(float(torque.damping(at_zero)[0]) != 0.0 for torque in model.passive_torques)
    )


def _check(what: str, factors: Mapping[str, float]) -> None:
    for name, factor in factors.items():
        if not 0.0 <= factor < np.inf:
            raise BadData(
                f"{what} of '{name}' is to be {factor:g} times as large: expected 0 or more"
            )


def _heavier(body: Body, factor: float) -> Body:
    return replace(body, mass=factor * body.mass, inertia=factor * body.inertia)


def _damped(bushing: Bushing, factor: float) -> Bushing:
    return replace(
        bushing,
        rotational_damping=factor * bushing.rotational_damping,
        translational_damping=factor * bushing.translational_damping,
    )

"""Identified passive dynamics in a model: springs and dampers of coordinates and muscles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.functions import constant, linear
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.paths import Bushing, PassiveTorque

NOTHING: Mapping[str, float] = {}
PASSIVE = "passive_"

Part = TypeVar("Part", bound="Named")


class Named(Protocol):
    """A part of a model that has a name."""

    @property
    def name(self) -> str:
        """Name in the model."""


def with_passive_dynamics(  # page: five kinds of parts, each optional
    model: Model,
    damping: Mapping[str, float] = NOTHING,
    stiffness: Mapping[str, float] = NOTHING,
    rest: Mapping[str, float] = NOTHING,
    viscosity: Mapping[str, float] = NOTHING,
    bushings: Sequence[Bushing] = (),
) -> Model:
    """Put passive torques at coordinates, bushings at joints and viscosity along muscles.

        tau_passive = -stiffness (q - rest) - damping qdot,    f = viscosity * lengthening velocity

    A coordinate's torque is named "passive_<coordinate>" and replaces an earlier one of that name;
    springs and limits that the model has under other names stay. So does a bushing replace one of
    its name, and a muscle's viscosity what it had. All of it is written into `.osim` in forms that
    OpenSim honours (SpringGeneralizedForce, BushingForce, ExpressionBasedPathForce) and read back.

    Parameters
    ----------
    model : to change
    damping : of coordinates [N m s/rad or N s/m]
    stiffness : of coordinates [N m/rad or N/m]
    rest : neutral positions of springs, by default those of the coordinates [rad or m]
    viscosity : of muscles [N s/m]; see `line_viscosity`
    bushings : `viscosity.identified_model.joint_bushing` makes one of the damping of a ball joint

    Raises
    ------
    BadData : a value below 0, a neutral position without stiffness, or a dependent coordinate
    UnknownName : the model has no such coordinate or muscle
    """
    for what, values in (("damping", damping), ("stiffness", stiffness), ("viscosity", viscosity)):
        _check_passive(what, values)
    springless = [name for name in rest if name not in stiffness]
    if springless:
        raise BadData(f"a neutral position is specified for '{springless[0]}', but no stiffness")
    for name in viscosity:
        index_of("muscle", name, model.muscle_names)
    springs = [
        _spring(model, name, damping, stiffness, rest)
        for name in dict.fromkeys((*damping, *stiffness))
    ]
    replaced = {spring.name for spring in springs} | {bushing.name for bushing in bushings}
    muscles = [
        replace(muscle, viscosity=viscosity.get(muscle.name, muscle.viscosity))
        for muscle in model.muscles
    ]
    return replace(
        model,
        passive_torques=(*_without(model.passive_torques, replaced), *springs),
        kept=_without(model.kept, replaced),
        bushings=(*_without(model.bushings, replaced), *bushings),
        muscles=tuple(muscles),
    )


def _without(parts: tuple[Part, ...], names: set[str]) -> tuple[Part, ...]:
    """Parts of a model but those of some names."""
    return tuple(part for part in parts if part.name not in names)


def _check_passive(what: str, values: Mapping[str, float]) -> None:
    """Raise `BadData` where a value would give energy."""
    for name, value in values.items():
        if not (np.isfinite(value) and value >= 0.0):
            raise BadData(
                f"{what} of '{name}' is {value:g}: expected 0 or more, as it cannot give energy"
            )


def _spring(
    model: Model,
    name: str,
    damping: Mapping[str, float],
    stiffness: Mapping[str, float],
    rest: Mapping[str, float],
) -> PassiveTorque:
    """Spring and damper of a coordinate; mappings as of `with_passive_dynamics`."""
    coordinate = model.coordinate(name)
    if name in model.dependent_coordinates:
        raise BadData(
            f"coordinate '{name}' follows {model.dependent_coordinates[name].independents}: damp"
            " those"
        )
    slope = stiffness.get(name, 0.0)
    at = rest.get(name, coordinate.default)
    return PassiveTorque(
        name=f"{PASSIVE}{name}",
        coordinate=name,
        torque=linear(-slope, slope * at),
        damping=constant(damping.get(name, 0.0)),
    )


def line_viscosity(
    viscosity: Mapping[str, float], lines: Mapping[str, Sequence[str]]
) -> dict[str, float]:
    """Share the viscosity of muscles evenly among their lines of action.

    Parameters
    ----------
    viscosity : by muscle [N s/m]
    lines : lines of action (muscles of the model) that each muscle consists of

    Returns
    -------
    viscosity by line of action [N s/m]

    Raises
    ------
    BadData : a muscle has no lines, or two muscles have the same one
    """
    result: dict[str, float] = {}
    for muscle, value in viscosity.items():
        lines_of_muscle = lines.get(muscle, ())
        if not lines_of_muscle:
            raise BadData(
                f"muscle '{muscle}' has no lines of action: there are those of"
                f" {quoted(lines) or 'none'}"
            )
        for line in lines_of_muscle:
            if line in result:
                raise BadData(
                    f"line of action '{line}' belongs to '{muscle}' and to another muscle"
                )
            result[line] = value / len(lines_of_muscle)
    return result

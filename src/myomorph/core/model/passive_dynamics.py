"""Identified passive dynamics put into a model: springs and dampers of coordinates, dampers along
muscles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.functions import constant, linear
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.paths import Bushing, PassiveTorque

NOTHING: Mapping[str, float] = {}
PASSIVE = "passive_"


def with_passive_dynamics(
    model: Model,
    damping: Mapping[str, float] = NOTHING,
    stiffness: Mapping[str, float] = NOTHING,
    rest: Mapping[str, float] = NOTHING,
    viscosity: Mapping[str, float] = NOTHING,
    bushings: Sequence[Bushing] = (),
) -> Model:
    """The model with passive torques at coordinates, bushings at joints and viscosity along
    muscles.

        tau_passive = -stiffness (q - rest) - damping qdot,    f = viscosity * lengthening velocity

    A coordinate's torque is named "passive_<coordinate>" and replaces an earlier one of that name;
    springs and limits that the model has under other names stay. So does a bushing replace one of
    its name, and a muscle's viscosity what it had. All of it is written into `.osim` in forms that
    OpenSim honours (SpringGeneralizedForce, BushingForce, ExpressionBasedPathForce) and read back.

    `damping`: of coordinates [N m s/rad or N s/m]; `stiffness`, `rest`: of coordinates [N m/rad or
    N/m], [rad or m]; at rest by default where the coordinate's default is; `viscosity`: of muscles
    [N s/m]; see `line_viscosity`; `bushings`: `viscosity.identified_model.joint_bushing` makes one
    of the damping of a ball joint.
    """
    for what, values in (("damping", damping), ("stiffness", stiffness), ("viscosity", viscosity)):
        for name, value in values.items():
            if not (np.isfinite(value) and value >= 0.0):
                raise BadData(
                    f"{what} of '{name}' is {value:g}: expected 0 or more, as it cannot give energy"
                )
    springless = [name for name in rest if name not in stiffness]
    if springless:
        raise BadData(f"a rest position is given for '{springless[0]}', but no stiffness")
    added = [
        _spring(model, name, damping, stiffness, rest)
        for name in dict.fromkeys((*damping, *stiffness))
    ]
    for name in viscosity:
        index_of("muscle", name, model.muscle_names)
    names = {torque.name for torque in added} | {bushing.name for bushing in bushings}
    return replace(
        model,
        passive_torques=(
            *(torque for torque in model.passive_torques if torque.name not in names),
            *added,
        ),
        kept=tuple(part for part in model.kept if part.name not in names),
        bushings=(*(bushing for bushing in model.bushings if bushing.name not in names), *bushings),
        muscles=tuple(
            replace(muscle, viscosity=viscosity.get(muscle.name, muscle.viscosity))
            for muscle in model.muscles
        ),
    )


def _spring(
    model: Model,
    name: str,
    damping: Mapping[str, float],
    stiffness: Mapping[str, float],
    rest: Mapping[str, float],
) -> PassiveTorque:
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
    """Viscosity of each line of action: those that are one muscle share its viscosity evenly.
    `viscosity`: by muscle [N s/m]; `lines`: the lines of action (muscles of the model) that each
    muscle is made of.
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

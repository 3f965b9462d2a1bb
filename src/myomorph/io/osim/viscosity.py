"""Viscosity of muscles in OpenSim's terms: a damper of its own along the muscle's path.

OpenSim's muscle classes have no damper along the path. Millard2012EquilibriumMuscle alone damps, along the
fiber and in proportion to its strength, and static optimization leaves that out with the passive force; a
PathSpring's dissipation multiplies its stretch. An ExpressionBasedPathForce `viscosity*ldot` on the same path is
exact for every class and pose.
"""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from myomorph.io.osim.document import Node
from myomorph.io.osim.muscles import PathReader
from myomorph.model.paths import Muscle

DAMPER = "_viscosity"
FORM = re.compile(r"\(?\+?(\d+\.?\d*(?:[eE][-+]?\d+)?)\)?\*ldot")


def damper_expression(viscosity: float) -> str:
    """The force of a damper as OpenSim's expression of the lengthening speed `ldot`."""
    return f"{float(viscosity)!r}*ldot"


def with_dampers(muscles: list[Muscle], forces: list[Node], paths: PathReader) -> tuple[list[Muscle], list[Node]]:
    """Muscles with the viscosity of the dampers that lie along their paths, and the forces left over.

    A damper is an ExpressionBasedPathForce named "<muscle>_viscosity" whose path is the muscle's.
    """
    places = {muscle.name: i for i, muscle in enumerate(muscles)}
    found, rest = list(muscles), []
    for force in forces:
        value = _viscosity(force)
        i = places.get(force.name.removesuffix(DAMPER), -1) if force.name.endswith(DAMPER) else -1
        if value is None or i < 0 or not _same(paths.read(force), muscles[i].path):
            rest.append(force)
        else:
            found[i] = replace(found[i], viscosity=found[i].viscosity + value)
    return found, rest


def _viscosity(force: Node) -> float | None:
    """N s/m of a path force that is a damper and is switched on, else None."""
    if force.kind != "ExpressionBasedPathForce" or not force.flag("appliesForce", True):
        return None
    form = FORM.fullmatch("".join(force.text("0.0", "expression").split()))
    return float(form.group(1)) if form else None


def _same(first: Any, second: Any) -> bool:
    """Whether two values are alike, whatever their parts are named."""
    if isinstance(first, float | np.ndarray):
        return np.shape(first) == np.shape(second) and np.allclose(first, second, rtol=1e-9, atol=1e-9)
    if is_dataclass(first):
        parts = [one.name for one in fields(first) if one.name != "name"]
        return type(first) is type(second) and all(_same(getattr(first, one), getattr(second, one)) for one in parts)
    if isinstance(first, tuple):
        return isinstance(second, tuple) and len(first) == len(second) and all(map(_same, first, second))
    return bool(first == second)

"""OpenSim's ForceSet: muscles, ideal actuators, and the forces that are kept but not modelled."""

from __future__ import annotations

from dataclasses import dataclass, replace

from myomorph.io.osim.actuators import KINDS, placed_actuator, read_actuator
from myomorph.io.osim.document import Node, unique
from myomorph.io.osim.frames import Frames
from myomorph.io.osim.kept import kept_force
from myomorph.io.osim.ligaments import read_ligaments
from myomorph.io.osim.muscles import PathReader, is_muscle, read_muscle
from myomorph.io.osim.viscosity import with_dampers
from myomorph.model.model import Actuator, Kept
from myomorph.model.paths import Ligament, Muscle


@dataclass(frozen=True)
class Forces:
    """What a ForceSet holds."""

    muscles: tuple[Muscle, ...]
    actuators: tuple[Actuator, ...]
    kept: tuple[Kept, ...]
    ligaments: tuple[Ligament, ...]


def read_forces(model: Node, frames: Frames, coordinates: tuple[str, ...], wraps: dict[str, str]) -> Forces:
    """Muscles, actuators and the rest of a model's forces."""
    paths = PathReader(frames, coordinates, wraps)
    groups = _groups(model)
    muscles, actuators, others = [], [], []
    for one in (*model.items("ForceSet"), *model.items("ActuatorSet")):
        if is_muscle(one):
            muscles.append(read_muscle(one, paths, groups.get(one.name, ())))
        elif one.kind in KINDS:
            actuators.append(placed_actuator(one, read_actuator(one), frames, coordinates))
        else:
            others.append(one)
    names = unique([one.name for one in muscles], "muscle", model.document)
    muscles = [replace(one, name=name) for one, name in zip(muscles, names, strict=True)]
    muscles, others = with_dampers(muscles, others, paths)
    names = unique([one.name for one in actuators], "actuator", model.document)
    actuators = [replace(one, name=name) for one, name in zip(actuators, names, strict=True)]
    kept = tuple(kept_force(one) for one in others)
    return Forces(tuple(muscles), tuple(actuators), kept, read_ligaments(others, paths))


def _groups(model: Node) -> dict[str, tuple[str, ...]]:
    """Groups of each member, in the file's order."""
    found: dict[str, tuple[str, ...]] = {}
    forces = model.child("ForceSet", "ActuatorSet")
    if forces is None:
        return found
    for element in forces.element.findall("groups/ObjectGroup"):
        group = forces.node(element)
        for member in group.words("members"):
            found[member] = (*found.get(member, ()), group.name)
    return found

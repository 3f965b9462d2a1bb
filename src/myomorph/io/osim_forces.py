"""OpenSim's ForceSet: muscles, ideal actuators, and the forces that are kept but not modelled."""

from __future__ import annotations

from dataclasses import dataclass, replace

from myomorph.io.osim_document import Node, unique
from myomorph.io.osim_frames import Frames
from myomorph.io.osim_muscles import PathReader, is_muscle, read_muscle
from myomorph.model.model import Actuator, Kept
from myomorph.model.paths import Muscle


@dataclass(frozen=True)
class Forces:
    """What a ForceSet holds."""

    muscles: tuple[Muscle, ...]
    actuators: tuple[Actuator, ...]
    kept: tuple[Kept, ...]


def read_forces(model: Node, frames: Frames, coordinates: tuple[str, ...], wraps: dict[str, str]) -> Forces:
    """Muscles, actuators and the rest of a model's forces."""
    paths = PathReader(frames, coordinates, wraps)
    groups = _groups(model)
    muscles = [read_muscle(one, paths, groups.get(one.name, ())) for one in model.items("ForceSet") if is_muscle(one)]
    names = unique([one.name for one in muscles], "muscle", model.document)
    muscles = [replace(one, name=name) for one, name in zip(muscles, names, strict=True)]
    return Forces(tuple(muscles), (), ())


def _groups(model: Node) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    forces = model.child("ForceSet", "ActuatorSet")
    if forces is None:
        return found
    for element in forces.element.findall("groups/ObjectGroup"):
        group = forces.node(element)
        for member in group.words("members"):
            found[member] = (*found.get(member, ()), group.name)
    return found

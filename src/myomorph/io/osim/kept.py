"""What an OpenSim file holds and Myomorph does not model: kept as it is, with what that means."""

from __future__ import annotations

from collections.abc import Iterable

from myomorph.io.osim.document import Node
from myomorph.io.osim.frames import OFFSET_KINDS
from myomorph.model.model import Kept

HARMLESS = "nothing that is computed changes"
EFFECTS = {
    "CoordinateLimitForce": HARMLESS,
    "ExpressionBasedCoordinateForce": "its passive torque is left out",
    "SpringGeneralizedForce": HARMLESS,
    "Blankevoort1991Ligament": "the ligament's force is left out",
    "Ligament": "the ligament's force is left out",
    "ExpressionBasedPathForce": "the force along its path is left out",
    "PathSpring": "the spring's force is left out",
    "BushingForce": HARMLESS,
    "FunctionBasedBushingForce": "the bushing's force is left out",
    "ExpressionBasedBushingForce": "the bushing's force is left out",
    "ElasticFoundationForce": "its contact force is left out",
    "HuntCrossleyForce": "its contact force is left out",
    "SmoothSphereHalfSpaceForce": "its contact force is left out",
    "Smith2018ArticularContactForce": "the contact force of the joint is left out",
    "PrescribedForce": "its force is left out",
    "ExternalForce": "its force is left out",
    "PathActuator": "the actuator cannot be used",
}
WORDS = ("credits", "publications", "length_units", "force_units", "ModelVisualPreferences")
ROOMS = {
    "ControllerSet": HARMLESS,
    "ContactGeometrySet": HARMLESS,
    "ProbeSet": HARMLESS,
    "ComponentSet": "the component has no effect",
    "components": "the component has no effect",
}


def keep(node: Node, room: str, effect: str) -> Kept:
    """A part as the file has it."""
    return Kept(node.kind, node.name, effect, node.source(), room, node.document.version)


def kept_force(node: Node) -> Kept:
    """A force or actuator that is not modelled."""
    if not node.flag("appliesForce", not node.flag("isDisabled", False)):
        return keep(node, "ForceSet", "switched off in the file")
    return keep(node, "ForceSet", EFFECTS.get(node.kind, "its force is left out"))


def kept_elsewhere(model: Node, bodies: list[Node]) -> list[Kept]:
    """Controllers, probes, contact geometry and further components, of the model and of its bodies."""
    found = [keep(one, "Model", HARMLESS) for tag in WORDS if (one := model.child(tag)) is not None]
    for room, effect in ROOMS.items():
        for one in model.items(room):
            if one.kind in OFFSET_KINDS or one.kind.endswith("Joint"):
                continue
            found.append(keep(one, room, effect))
    for body in bodies:
        for one in body.items("components"):
            if one.kind not in OFFSET_KINDS:
                found.append(keep(one, f"/bodyset/{body.name}", HARMLESS))
    return found


def warnings_of(kept: Iterable[Kept]) -> list[str]:
    """One line for each class that is kept and matters."""
    names: dict[tuple[str, str], list[str]] = {}
    for one in kept:
        if one.effect != HARMLESS and not one.effect.startswith("switched off"):
            names.setdefault((one.kind, one.effect), []).append(one.name)
    lines = []
    for (kind, effect), some in names.items():
        shown = ", ".join(f"'{name}'" for name in some[:3]) + (f" and {len(some) - 3} more" if len(some) > 3 else "")
        lines.append(f"{kind} {shown}: kept but not modelled, {effect}")
    return lines

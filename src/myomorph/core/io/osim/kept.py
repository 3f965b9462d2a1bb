"""Parts of an OpenSim file that are not modelled: stored as they are, with the effect of that."""

from __future__ import annotations

import re
from collections.abc import Iterable

from lxml import etree

from myomorph.core.io.osim.document import NEWEST, Node
from myomorph.core.io.osim.frames import OFFSET_KINDS
from myomorph.core.io.osim.paths import put_ligament
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import quoted
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Kept, Model

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

SAME_SINCE_2 = frozenset(
    {"CoordinateLimitForce", "SpringGeneralizedForce", "ExpressionBasedCoordinateForce"}
)


def keep(node: Node, room: str, effect: str) -> Kept:
    """Store a part as the file has it.

    Parameters
    ----------
    node : the part
    room : name of the set that it stands in
    effect : of not modelling it

    Returns
    -------
    the part with its XML text and the version of its document
    """
    return Kept(
        kind=node.kind,
        name=node.name,
        effect=effect,
        text=node.source(),
        room=room,
        version=node.document.version,
    )


def kept_force(node: Node) -> Kept:
    """Store a force or actuator that is not modelled.

    Parameters
    ----------
    node : the force

    Returns
    -------
    the part, with the effect of leaving out its class
    """
    acting = EFFECTS.get(node.kind, "its force is left out")
    return keep(node, "ForceSet", acting if node.is_applied else "switched off in the file")


def kept_elsewhere(model: Node, bodies: list[Node]) -> list[Kept]:
    """Store controllers, probes, contact geometry and components of the model and its bodies.

    Parameters
    ----------
    model : the model's node
    bodies : nodes of its bodies

    Returns
    -------
    the parts in the order of the sets
    """
    result = [
        keep(child, "Model", HARMLESS) for tag in WORDS if (child := model.child(tag)) is not None
    ]
    for room, effect in ROOMS.items():
        for child in model.items(room):
            if child.kind in OFFSET_KINDS or child.kind.endswith("Joint"):
                continue
            result.append(keep(child, room, effect))
    for body in bodies:
        for child in body.items("components"):
            if child.kind not in OFFSET_KINDS:
                result.append(keep(child, f"/bodyset/{body.name}", HARMLESS))
    return result


def warnings_of(kept: Iterable[Kept]) -> list[Message]:
    """List a warning for each class that is stored and whose absence has an effect.

    Parameters
    ----------
    kept : stored parts

    Returns
    -------
    one line per class and effect
    """
    acting = [
        part
        for part in kept
        if part.effect != HARMLESS and not part.effect.startswith("switched off")
    ]
    names = grouped(((part.kind, part.effect), part.name) for part in acting)
    lines = [
        MODEL.message(f"{kind} {quoted(some, 3)}: kept but not modelled, {effect}")
        for (kind, effect), some in names.items()
    ]
    return lines


def usable_parts(kept: Iterable[Kept], warnings: list[Message]) -> list[Kept]:
    """Select the stored parts that an OpenSim 4.6 document can hold, in its layout.

    Parameters
    ----------
    kept : stored parts
    warnings : gets a line for each that is left out

    Returns
    -------
    the parts to write; a bushing that the model has itself is not among them
    """
    usable = []
    for part in kept:
        if part.kind == "BushingForce" and part.effect == HARMLESS:
            continue  # the model's own bushing is written
        new = part.version >= 40000 and not (part.room == "ControllerSet" and part.version < NEWEST)
        if new or part.room == "Model" or part.kind in SAME_SINCE_2:
            usable.append(part)
        elif part.version:
            warnings.append(
                MODEL.message(
                    f"{part.kind} '{part.name}' is left out: its layout is of document version"
                    f" {part.version}"
                )
            )
        else:
            warnings.append(
                MODEL.message(f"{part.kind} '{part.name}' is left out: it is not OpenSim's")
            )
    return usable


def is_kept(passive: str, kept: list[Kept]) -> bool:
    """Return whether a passive torque comes from a part that is written back.

    A limit of a coordinate has a torque for each of its sides.

    Parameters
    ----------
    passive : name of the torque
    kept : parts that are written back
    """
    names = {passive, passive.removesuffix("_upper"), passive.removesuffix("_lower")}
    return any(part.room == "ForceSet" and part.name in names for part in kept)


def put_back(
    parent: etree._Element,
    kept: list[Kept],
    room: str,
    model: Model | None = None,
    joints: dict[str, str] | None = None,
) -> None:
    """Write the stored parts of one set of the document back into it.

    Parameters
    ----------
    parent : element of the set
    kept : parts of all sets
    room : name of the set
    model : its ligaments give paths and slack lengths; None leaves the parts' own
    joints : component name of the joint of each coordinate, for the paths of ligaments
    """
    for part in kept:
        if part.room != room:
            continue
        element = etree.fromstring(part.text)
        if part.version < 30509:
            # Before 4.0, parts were switched off by `isDisabled`.
            for switch in element.findall("isDisabled"):
                switch.tag = "isEnforced" if room == "ConstraintSet" else "appliesForce"
                switch.text = str(not re.fullmatch(r"\s*(true|1)\s*", switch.text or "")).lower()
        if model is not None:
            put_ligament(part, element, model.ligaments, joints or {})
        for path in element.findall("GeometryPath"):
            path.set("name", "path")
        parent.append(element)

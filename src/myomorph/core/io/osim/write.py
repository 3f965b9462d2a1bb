"""A model as an OpenSim 4 document, with the stored parts of its file written back."""

from __future__ import annotations

import os

from lxml import etree

from myomorph.core.io.osim.actuators import write_actuator
from myomorph.core.io.osim.bodies import write_body, write_body_parts
from myomorph.core.io.osim.constraints import (
    write_bushing,
    write_coupler,
    write_loop,
    write_passive,
)
from myomorph.core.io.osim.document import NEWEST, child, legal, numbers, write_document
from myomorph.core.io.osim.kept import is_kept, put_back, usable_parts
from myomorph.core.io.osim.muscles import write_muscle, write_viscosity
from myomorph.core.io.osim.setup_parts import put_marker
from myomorph.core.io.osim.write_joints import Plan, plan_joints, write_joint
from myomorph.core.model.arguments import check_argument
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadModel, quoted
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Kept, Model

SETS = (
    "ConstraintSet",
    "ForceSet",
    "ControllerSet",
    "ContactGeometrySet",
    "ProbeSet",
    "ComponentSet",
)


def write_osim(model: Model, path: str | os.PathLike[str]) -> tuple[Message, ...]:
    """Write a model as `.osim` of OpenSim 4.6, whole or not at all.

    Parts that reading kept are put back where their layout allows it.

    Source: Seth et al. 2018, OpenSim's model files.

    Parameters
    ----------
    model : to write
    path : of the new file, replaced where it exists

    Returns
    -------
    what could not be written as it is, one line each

    Raises
    ------
    BadFile : the file cannot be written
    BadModel : two names would become one in OpenSim

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> mm.write_osim(model, "copy.osim")
    ()
    >>> mm.read_model("copy.osim").muscle_names
    ('flexor', 'extensor')
    """
    check_argument("model", model, Model)
    warnings = _renamed(model)
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    _model(child(root, "Model", name=model.name), model, warnings)
    write_document(root, path)
    return tuple(dict.fromkeys(warnings))


def _renamed(model: Model) -> list[Message]:
    """Warn of names that OpenSim cannot hold.

    Returns
    -------
    a line where names are changed, else none

    Raises
    ------
    BadModel : two names would become one
    """
    groups = {
        "bodies": model.body_names,
        "joints": tuple(joint.name for joint in model.joints),
        "coordinates": model.coordinate_names,
        "markers": model.marker_names,
        "muscles": model.muscle_names,
    }
    changed = []
    for what, names in groups.items():
        meant: dict[str, str] = {}
        for name in names:
            if meant.setdefault(legal(name), name) != name:
                raise BadModel(
                    f"{what} '{meant[legal(name)]}' and '{name}' would have one name in OpenSim"
                )
        changed += [name for name in names if legal(name) != name]
    if not changed:
        return []
    return [
        MODEL.message(
            f"blanks and special characters in {len(changed)} names ({quoted(changed, 3)}) are"
            " written as '_',"
            " as OpenSim wants"
        )
    ]


def _model(element: etree._Element, model: Model, warnings: list[Message]) -> None:
    """Write all parts of the model into its element, and add to the warnings."""
    plan = plan_joints(model, warnings)
    joints = {name: legal(joint.name) for joint in plan.joints for name in joint.coordinates}
    kept = usable_parts(model.kept, warnings)
    put_back(element, kept, "Model")
    child(element, "gravity", numbers(model.gravity))
    _bodies(element, model, plan, kept)
    _joints(element, model, plan, warnings)
    holders = {name: child(element, name, name=name.lower()) for name in SETS}
    sets = {name: child(holder, "objects") for name, holder in holders.items()}
    _constraints(sets["ConstraintSet"], model, warnings)
    _muscles(sets["ForceSet"], model, joints, warnings)
    _other_forces(sets["ForceSet"], model, kept, warnings)
    for name, objects in sets.items():
        put_back(objects, kept, name, model, joints)
    _write_groups(holders["ForceSet"], model)
    markers = child(child(element, "MarkerSet", name="markerset"), "objects")
    for marker in model.markers:
        put_marker(markers, marker)
    components = etree.Element("components")
    put_back(components, kept, "components")
    if len(components):
        element.append(components)


def _bodies(element: etree._Element, model: Model, plan: Plan, kept: list[Kept]) -> None:
    """Write the ground and all bodies, those between joints too."""
    ground = child(element, "Ground", name=GROUND)
    write_body_parts(ground, GROUND, model.ground_meshes, model, kept)
    bodies = child(child(element, "BodySet", name="bodyset"), "objects")
    for body in (*model.bodies, *plan.bodies):
        write_body(bodies, body, model, kept)


def _joints(element: etree._Element, model: Model, plan: Plan, warnings: list[Message]) -> None:
    """Write the planned joints with their coordinates."""
    coordinates = {coordinate.name: coordinate for coordinate in model.coordinates}
    joints = child(child(element, "JointSet", name="jointset"), "objects")
    for joint in plan.joints:
        write_joint(joints, joint, coordinates, warnings)


def _constraints(parent: etree._Element, model: Model, warnings: list[Message]) -> None:
    """Write couplers and loops."""
    for coupler in model.couplers:
        write_coupler(parent, coupler, warnings)
    for loop in model.loops:
        write_loop(parent, loop, warnings)


def _muscles(
    parent: etree._Element, model: Model, joints: dict[str, str], warnings: list[Message]
) -> None:
    """Write muscles, and behind them their viscosities.

    Parameters
    ----------
    parent : element of the forces
    model : its muscles are written
    joints : name of the joint that has a coordinate, by coordinate
    warnings : gets a line for what cannot be written as it is
    """
    for muscle in model.muscles:
        write_muscle(parent, muscle, joints, warnings)
    for muscle in model.muscles:
        if muscle.viscosity:
            write_viscosity(parent, muscle, joints)


def _other_forces(
    parent: etree._Element, model: Model, kept: list[Kept], warnings: list[Message]
) -> None:
    """Write actuators, passive torques and bushings, but for those that are put back as read."""
    for actuator in model.actuators:
        write_actuator(parent, actuator)
    for passive in model.passive_torques:
        if not is_kept(passive.name, kept):
            write_passive(parent, passive, warnings)
    for bushing in model.bushings:
        if not is_kept(bushing.name, kept):
            write_bushing(parent, bushing)


def _write_groups(parent: etree._Element, model: Model) -> None:
    """Write groups in an order that agrees with every muscle's own order of groups."""
    members = grouped((group, muscle.name) for muscle in model.muscles for group in muscle.groups)
    earlier: dict[str, set[str]] = {group: set() for group in members}
    for muscle in model.muscles:
        for index, group in enumerate(muscle.groups):
            earlier[group].update(muscle.groups[:index])
    groups = child(parent, "groups")
    waiting = list(members)
    while waiting:
        # Where muscles contradict each other, the first.
        ready = [group for group in waiting if earlier[group].isdisjoint(waiting)]
        name = ready[0] if ready else waiting[0]
        waiting.remove(name)
        written_group = child(groups, "ObjectGroup")
        written_group.set("name", name)
        child(written_group, "members", " ".join(legal(member) for member in members[name]))

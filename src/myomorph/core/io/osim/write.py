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
from myomorph.core.io.osim.write_joints import plan_joints, write_joint
from myomorph.core.model.errors import BadModel, quoted
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import GROUND, Model

SETS = (
    "ConstraintSet",
    "ForceSet",
    "ControllerSet",
    "ContactGeometrySet",
    "ProbeSet",
    "ComponentSet",
)


def write_osim(model: Model, path: str | os.PathLike[str]) -> tuple[str, ...]:
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
    warnings = _renamed(model)
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    _model(child(root, "Model", name=model.name), model, warnings)
    write_document(root, path)
    return tuple(dict.fromkeys(warnings))


def _renamed(model: Model) -> list[str]:
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
        f"blanks and signs in {len(changed)} names ({quoted(changed, 3)}) are written as '_', as"
        " OpenSim wants"
    ]


def _model(element: etree._Element, model: Model, warnings: list[str]) -> None:
    """Write all parts of the model into its element, and add to the warnings."""
    plan = plan_joints(model, warnings)
    coordinates = {coordinate.name: coordinate for coordinate in model.coordinates}
    joints = {name: legal(joint.name) for joint in plan.joints for name in joint.coordinates}
    kept = usable_parts(model.kept, warnings)
    put_back(element, kept, "Model")
    child(element, "gravity", numbers(model.gravity))
    write_body_parts(
        child(element, "Ground", name=GROUND), GROUND, model.ground_meshes, model, kept
    )
    bodies = child(child(element, "BodySet", name="bodyset"), "objects")
    for body in (*model.bodies, *plan.bodies):
        write_body(bodies, body, model, kept)
    joint_set = child(child(element, "JointSet", name="jointset"), "objects")
    for joint in plan.joints:
        write_joint(joint_set, joint, coordinates, warnings)
    holders = {name: child(element, name, name=name.lower()) for name in SETS}
    sets = {name: child(holder, "objects") for name, holder in holders.items()}
    for coupler in model.couplers:
        write_coupler(sets["ConstraintSet"], coupler, warnings)
    for loop in model.loops:
        write_loop(sets["ConstraintSet"], loop, warnings)
    for muscle in model.muscles:
        write_muscle(sets["ForceSet"], muscle, joints, warnings)
    for muscle in model.muscles:
        if muscle.viscosity:
            write_viscosity(sets["ForceSet"], muscle, joints)
    for actuator in model.actuators:
        write_actuator(sets["ForceSet"], actuator)
    for passive in model.passive_torques:
        if not is_kept(passive.name, kept):
            write_passive(sets["ForceSet"], passive, warnings)
    for bushing in model.bushings:
        if not is_kept(bushing.name, kept):
            write_bushing(sets["ForceSet"], bushing)
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


def _write_groups(parent: etree._Element, model: Model) -> None:
    """Write groups in an order that agrees with every muscle's own order of groups."""
    members = grouped((group, muscle.name) for muscle in model.muscles for group in muscle.groups)
    sooner: dict[str, set[str]] = {group: set() for group in members}
    for muscle in model.muscles:
        for i, group in enumerate(muscle.groups):
            sooner[group].update(muscle.groups[:i])
    groups = child(parent, "groups")
    waiting = list(members)
    while waiting:
        name = next((group for group in waiting if not sooner[group] & set(waiting)), waiting[0])
        waiting.remove(name)
        written_group = child(groups, "ObjectGroup")
        written_group.set("name", name)
        child(written_group, "members", " ".join(legal(member) for member in members[name]))

"""Forces at contact points of joints in result files."""

from __future__ import annotations

from myomorph.store.results import ResultWriter, Stored
from myomorph.tension.joint_contact import JointContactForces

MEANINGS = {
    "joint_contact_force": "force at a contact point of a joint, along its normal",
    "joint_contact_total": "size of the joint's whole force",
    "joint_contact_shear": "force across the mean normal, which the contact points do not carry",
    "joint_contact_unbalanced_force": "force along the mean normal that would pull",
    "joint_contact_unbalanced_moment": "moment that is left where contact points have lifted off",
}
WEIGHT = "joint_contact_body_weight"


def put_joint_contacts(writer: ResultWriter, found: JointContactForces) -> None:
    """Forces at contact points, those of their joints, and what the points do not carry."""
    writer.time(found.time)
    writer.names("joint_contact", found.point_columns)
    writer.names("contact_joint", found.joints)
    writer.texts("joint_contact_point", "joint_contact", found.points)
    writer.texts("joint_contact_joint", "joint_contact", found.joint_of)
    writer.fact(WEIGHT, repr(found.weight))
    for name, one in found.variables().items():
        writer.put(name, one.dimensions, one.values, one.unit, MEANINGS[name])


def get_joint_contacts(stored: Stored) -> JointContactForces | None:
    """What `put_joint_contacts` wrote, or None."""
    values, names = stored.values, stored.names
    if "joint_contact_force" not in values:
        return None
    return JointContactForces(
        stored.time,
        names["contact_joint"],
        names["joint_contact_point"],
        names["joint_contact_joint"],
        *(values[name] for name in MEANINGS),
        weight=float(stored.facts[WEIGHT]),
    )

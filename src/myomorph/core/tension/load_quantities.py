"""Quantities of loads: at contacts with the surroundings, at joints and at their contact points."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity, Tidy

BY_JOINT = ("time", "contact_joint")
BY_GROUP = ("interval_time", "contact_group", "axis")
INFEASIBLE = ("infeasible_contact",)
# Columns of a table may be forces, moments and points.
LOADS = "N, N m or m"

JOINT_FORCE = Quantity(
    name="joint_force",
    dims=("time", "joint", "axis"),
    unit="N",
    meaning="force of a joint on one of its bodies",
    attribute="forces",
    stored=False,
)
JOINT_MOMENT = Quantity(
    name="joint_moment",
    dims=("time", "joint", "axis"),
    unit="N m",
    meaning="moment of a joint on one of its bodies, about its point",
    attribute="moments",
    stored=False,
)
JOINT_POINT = Quantity(
    name="joint_point",
    dims=("time", "joint", "axis"),
    unit="m",
    meaning="point of a joint that its load acts at",
    attribute="points",
    stored=False,
)
JOINT_REACTIONS = (JOINT_FORCE, JOINT_MOMENT, JOINT_POINT)

JOINT_CONTACT_FORCE = Quantity(
    name="joint_contact_force",
    dims=("time", "joint_contact"),
    unit="N",
    meaning="force at a contact point of a joint, along its normal",
    file="joint_contact_forces.sto",
)
JOINT_CONTACT_TOTAL = Quantity(
    name="joint_contact_total",
    dims=BY_JOINT,
    unit="N",
    meaning="magnitude of the joint's total force",
    file="joint_contact_forces.sto",
)
JOINT_CONTACT_SHEAR = Quantity(
    name="joint_contact_shear",
    dims=BY_JOINT,
    unit="N",
    meaning="force across the mean normal, which the contact points do not carry",
    file="joint_contact_forces.sto",
)
JOINT_CONTACT_UNBALANCED_FORCE = Quantity(
    name="joint_contact_unbalanced_force",
    dims=BY_JOINT,
    unit="N",
    meaning="tensile force along the mean normal",
    file="joint_contact_forces.sto",
)
JOINT_CONTACT_UNBALANCED_MOMENT = Quantity(
    name="joint_contact_unbalanced_moment",
    dims=BY_JOINT,
    unit="N m",
    meaning="moment that contact points cannot balance after lift-off",
    file="joint_contact_forces.sto",
)
JOINT_CONTACTS = (
    JOINT_CONTACT_FORCE,
    JOINT_CONTACT_TOTAL,
    JOINT_CONTACT_SHEAR,
    JOINT_CONTACT_UNBALANCED_FORCE,
    JOINT_CONTACT_UNBALANCED_MOMENT,
)
JOINT_CONTACT_POINT = Quantity(
    name="joint_contact_point",
    dims=("joint_contact",),
    unit="",
    meaning="name of a contact point",
    attribute="points",
    kind="text",
)
JOINT_CONTACT_JOINT = Quantity(
    name="joint_contact_joint",
    dims=("joint_contact",),
    unit="",
    meaning="joint of a contact point",
    attribute="joint_of",
    kind="text",
)
JOINT_CONTACT_LOAD = Quantity(
    name="joint_contact_load",
    dims=("time", "joint_contact_load_column"),
    unit=LOADS,
    meaning="forces at contact points and of whole joints, and what the points do not carry",
    stored=False,
    file="joint_contact_forces.sto",
    title="Joint contact forces",
    label="Forces at contact points of joints",
    tidy=Tidy(
        statistics=("maximum", "mean"),
        endings=(" contact force",),
        unit="N",
        curve="joint contact force",
        curve_unit="N",
    ),
    drawn=True,
)
JOINT_REACTION = Quantity(
    name="joint_reaction",
    dims=("time", "joint_reaction_column"),
    unit=LOADS,
    meaning="load that a joint transmits to its child body: force, moment and point",
    stored=False,
    file="joint_reactions.sto",
    title="joint reactions",
    label="Joint loads",
    drawn=True,
)
JOINT_FORCE_NORM = Quantity(
    name="joint_force",
    dims=("time", "loaded_joint"),
    unit="N",
    meaning="magnitude of the force that a joint transmits",
    attribute="values",
    label="Joint forces",
    tidy=Tidy(
        statistics=("maximum", "mean"),
        endings=(" joint force",),
        curve="joint force",
        curve_unit="N",
    ),
)
STATIC_LOAD_LOW = Quantity(
    name="static_load_low",
    dims=("time", "static_joint"),
    unit="N",
    meaning="minimum force of a joint that its torque requires, with published moment arms",
    file="static_load_low.sto",
    title="Least force of joints by statics",
    label="Least forces of joints by statics",
    tidy=Tidy(statistics=("maximum", "mean"), endings=(" least joint force",)),
)
STATIC_LOAD_HIGH = Quantity(
    name="static_load_high",
    dims=("time", "static_joint"),
    unit="N",
    meaning="maximum force of a joint that its torque requires, with published moment arms",
    file="static_load_high.sto",
    title="Greatest force of joints by statics",
    label="Greatest forces of joints by statics",
    tidy=Tidy(statistics=("maximum", "mean"), endings=(" greatest joint force",)),
)
STATIC_LOADS = (STATIC_LOAD_LOW, STATIC_LOAD_HIGH)
CONTACT_LOAD = Quantity(
    name="contact_load",
    dims=("time", "contact_load_column"),
    unit=LOADS,
    meaning="external loads, those of estimated contacts included: force, point and torque",
    stored=False,
    file="contact_forces.sto",
    title="contact forces",
    label="Contact forces of bodies",
    drawn=True,
)
CONTACT_GROUP_FORCE = Quantity(
    name="contact_group_force",
    dims=("time", "contact_group_force_column"),
    unit="N",
    meaning="force of a contact, its sites together, on the body in ground, and its size",
    stored=False,
    file="contact_groups.sto",
    title="Forces of contacts",
    label="Contact forces",
    drawn=True,
)

INTERVAL_TIME = Quantity(
    name="interval_time",
    dims=("interval_time",),
    unit="s",
    meaning="instants at which force intervals were computed",
    attribute="time",
)
INTERVAL_LOW = Quantity(
    name="interval_low",
    dims=BY_GROUP,
    unit="N",
    meaning="least force that the data allow",
    attribute="low",
    file="contact_intervals.sto",
)
INTERVAL_HIGH = Quantity(
    name="interval_high",
    dims=BY_GROUP,
    unit="N",
    meaning="greatest force that the data allow",
    attribute="high",
    file="contact_intervals.sto",
)
CONTACT_INTERVALS = (
    INTERVAL_TIME,
    Quantity(
        name="max_interval_direction",
        dims=("interval_time",),
        unit="",
        meaning="combination of forces that data and effort determine least",
        attribute="sentences",
        kind="text",
    ),
    INTERVAL_LOW,
    INTERVAL_HIGH,
    Quantity(
        name="interval_near_low",
        dims=BY_GROUP,
        unit="N",
        meaning="least force among solutions near the optimum",
        attribute="near_low",
    ),
    Quantity(
        name="interval_near_high",
        dims=BY_GROUP,
        unit="N",
        meaning="greatest force among solutions near the optimum",
        attribute="near_high",
    ),
)
INFEASIBLE_CONTACTS = (
    Quantity(
        name="infeasible_contact_time",
        dims=INFEASIBLE,
        unit="s",
        meaning="frame whose contacts are infeasible",
        attribute="time",
    ),
    Quantity(
        name="infeasible_contact_relaxation",
        dims=INFEASIBLE,
        unit="",
        meaning="what would make them feasible",
        attribute="sentence",
        kind="text",
    ),
)

QUANTITIES = (
    *JOINT_CONTACTS,
    JOINT_CONTACT_POINT,
    JOINT_CONTACT_JOINT,
    JOINT_CONTACT_LOAD,
    JOINT_REACTION,
    JOINT_FORCE_NORM,
    *STATIC_LOADS,
    CONTACT_LOAD,
    CONTACT_GROUP_FORCE,
    *CONTACT_INTERVALS,
    *INFEASIBLE_CONTACTS,
)

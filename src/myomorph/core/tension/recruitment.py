"""Costs beside the effort, as options and terms: joint loads, and co-contraction of joints.

What least effort is by default is declared here alone: `RecruitmentOptions.settled`. Commands,
studies, `solve_tension` and muscle forces while frames arrive take it from here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.muscles.patella import patella_of
from myomorph.core.rigid.knees import knee_joints
from myomorph.core.tension.knee_sides import knee_sides
from myomorph.core.tension.reaction import joint_reactions
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.co_contraction import CoContractionTerm
from myomorph.core.tension.terms.joint_load import JointLoadTerm, crossed_joints
from myomorph.core.tension.terms.knee_contact import KneeContactTerm
from myomorph.core.tension.terms.term import Term

KNEES = "knees"
ALL = "all"
KNEE_LOAD = 0.02
"""Default weight of the load of knees (docs/decisions/0029-knees-that-bend.md)."""


@dataclass(frozen=True)
class RecruitmentOptions:
    """Costs beside the effort of muscles.

    Attributes
    ----------
    joint_load : weight of the squared joint contact force, in body weights, relative to the effort
        a^2 of one muscle; 0 for none; by default 0.02 with rigid tendons if the external forces are
        known
    joint_load_joints : joints whose load is weighted, separated by commas; "knees": between thigh
        and shank, and thigh and patella; "all": all that muscles cross
    co_contraction : minimum co-contraction: share, 0 to 1, of its maximum torque that the weaker
        side of every joint gives at least; 0 for none
    co_contraction_coordinates : coordinates with this co-contraction, separated by commas; by
        default all that muscles can turn in both directions
    knee_contact : minimum force on the medial and lateral side of every knee below 30 degrees of
        flexion, so that neither lifts off [body weights]; 0 for none; 0.2 improved all measured
        walks
    """

    joint_load: float | None = None
    joint_load_joints: str = KNEES
    co_contraction: float = 0.0
    co_contraction_coordinates: str = ""
    knee_contact: float = 0.0

    def __post_init__(self) -> None:
        if self.joint_load is not None and not 0.0 <= self.joint_load < float("inf"):
            raise BadData(f"weight {self.joint_load:g} of joint loads: expected 0 or more")
        if not 0.0 <= self.co_contraction <= 1.0:
            raise BadData(f"co-contraction of {self.co_contraction:g}: expected 0 to 1")
        if not 0.0 <= self.knee_contact <= 1.0:
            raise BadData(f"knee_contact {self.knee_contact:g}: expected 0 to 1 body weight")
        for names, weight, default in (
            ("joint_load_joints", "joint_load", KNEES),
            ("co_contraction_coordinates", "co_contraction", ""),
        ):
            if getattr(self, names) != default and not getattr(self, weight):
                raise BadData(f"{names} without {weight}: give {weight} above 0")

    @property
    def has_costs(self) -> bool:
        """Whether anything beside the effort costs."""
        return bool(self.joint_load or self.co_contraction or self.knee_contact)

    def settled(self, model: Model, options: TensionOptions, external: bool) -> RecruitmentOptions:
        """Options with the default weight of joint loads where none is set.

        It is `KNEE_LOAD` for the knees of models without closed loops, with rigid tendons and the
        effort as a power, where the external forces are known; else nothing beside the effort
        costs.

        Parameters
        ----------
        model : of the body
        options : settings
        external : whether the external forces are known
        """
        if self.joint_load is not None:
            return self
        plain = options.tendons == "rigid" and options.recruitment == "power" and not model.loops
        usable = plain and external and model.weight > 0.0 and bool(loaded_knees(model))
        return replace(self, joint_load=KNEE_LOAD if usable else 0.0)


EFFORT_ALONE = RecruitmentOptions(joint_load=0.0)
"""What OpenSim's static optimization minimizes."""


def settled_recruitment(
    asked: RecruitmentOptions | None,
    model: Model,
    options: TensionOptions,
    external: bool,
) -> RecruitmentOptions:
    """Settle the costs beside the effort of a problem.

    Parameters
    ----------
    asked : by the user; None for the default
    model, options, external : as of `RecruitmentOptions.settled`

    Raises
    ------
    BadData : joint loads were asked for, and the external forces are not known
    """
    asked = asked or RecruitmentOptions()
    if asked.knee_contact and not external:
        raise BadData(
            "knee_contact with joint torques of a file: forces of knees need external forces, as"
            " torques of inverse dynamics carry them (--loads)"
        )
    if asked.joint_load and not external:
        raise BadData(
            "joint_load with joint torques of a file: loads of joints need external forces, as"
            " torques of inverse dynamics carry them (--loads)"
        )
    return asked.settled(model, options, external)


def recruitment_terms(
    model: Model,
    motion: Motion,
    torques: Series,
    wrenches: Wrenches | None,
    options: RecruitmentOptions,
) -> tuple[Term, ...]:
    """Make the terms that options ask for.

    Raises
    ------
    BadData : joint loads of knees, and no muscle crosses one; further errors are those of
        `crossed_joints` and `CoContractionTerm`
    """
    terms: list[Term] = []
    if options.joint_load:
        joints = loaded_joints(model, options.joint_load_joints)
        terms.append(joint_load_term(model, motion, wrenches, options.joint_load, joints))
    if options.co_contraction:
        terms.append(
            CoContractionTerm(
                model,
                motion,
                torques,
                level=options.co_contraction,
                coordinates=_names(options.co_contraction_coordinates),
            )
        )
    if options.knee_contact:
        terms.append(
            KneeContactTerm(
                model=model,
                sides=knee_sides(model, motion, wrenches),
                level=options.knee_contact,
            )
        )
    return tuple(terms)


def loaded_joints(model: Model, text: str) -> tuple[str, ...]:
    """Names of the joints whose load counts.

    Parameters
    ----------
    model : of the body
    text : names, "knees" or "all"

    Raises
    ------
    BadData : no muscle crosses a knee; further errors are those of `crossed_joints`
    """
    if text == ALL:
        return crossed_joints(model)
    if text != KNEES:
        return crossed_joints(model, _names(text))
    knees = loaded_knees(model)
    if not knees:
        raise BadData(
            f"joint_load: no muscle crosses a knee of '{model.name}': name joints in"
            " joint_load_joints"
        )
    return knees


def loaded_knees(model: Model) -> tuple[str, ...]:
    """Knees that muscles cross, by name, and the joints of their patellae."""
    names = [knee.name for knee in knee_joints(model)]
    patellae = {patella_of(model, knee) for knee in knee_joints(model)}
    names += [joint.name for joint in model.joints if joint.child in patellae]
    crossed = set(crossed_joints(model)) if names and model.muscles and not model.loops else set()
    return tuple(name for name in names if name in crossed)


def joint_load_term(
    model: Model,
    motion: Motion,
    wrenches: Wrenches | None,
    weight: float,
    joints: Sequence[str] = (),
) -> JointLoadTerm:
    """Make the term of joint loads.

    Parameters
    ----------
    model : of the body
    motion : with velocities and accelerations
    wrenches : external forces at the motion's times, None for none
    weight : of one body weight squared, in units of the effort a^2 of one muscle
    joints : names; none for all that a muscle crosses
    """
    chosen = crossed_joints(model, joints)
    without_muscles = joint_reactions(model, motion, None, wrenches, joints=chosen, frame="ground")
    return JointLoadTerm(model, chosen, without_muscles.forces, weight=weight)


def _names(text: str) -> tuple[str, ...]:
    """Names in a text, separated by commas."""
    return tuple(item.strip() for item in text.split(",") if item.strip())

"""Loads of joints by default: reactions of all joints, and contact points of a person's knees."""

from __future__ import annotations

from myomorph.core.model.errors import BadModel
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.muscles.published_arms import size_of_person
from myomorph.core.rigid.knees import knee_joints
from myomorph.lab.study.inputs.contact_points import ContactPointsFile
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.trial.trial_inputs import Settings


def with_joint_loads(options: Settings) -> Settings:
    """Return settings that ask for the loads of joints, unless they say otherwise."""
    return FrozenMap({**options, "tension": {"reactions": "child", **options.get("tension", {})}})


def chosen_contact_points(model: Model, inputs: ByType, options: Settings) -> ContactPointsFile:
    """Return the contact points that were stated, else those of the knees of a person.

    Parameters
    ----------
    model : of the body
    inputs : that were stated
    options : of the steps; without reactions nothing is chosen
    """
    stated = inputs.or_default(ContactPointsFile)
    unwanted = options.get("tension", {}).get("reactions") == "none"
    if stated.contact_points or unwanted or not model.muscles:
        return stated
    return ContactPointsFile("auto") if _has_knees(model) else stated


def _has_knees(model: Model) -> bool:
    """Tell whether a model has a person's knees, each with contact points."""
    # What follows takes a while to import.
    from myomorph.core.tension.knee_points import knee_points

    knees = knee_joints(model)
    if not knees or any(size_of_person(model, knee) is None for knee in knees):
        return False
    try:
        knee_points(model, {})
    except BadModel:
        return False
    return True

"""What the distance of the patella from the knee's axis changes in rises, landings and walks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee_activities import ACTIVITIES, ALONG, EXPERT, inputs
from benchmarks.results import Row
from myomorph.core.muscles.patella_distance import patella_directions, with_patellae_farther
from myomorph.core.muscles.published_arms import PATELLAR_TENDON, knee_arms
from myomorph.core.rigid.knees import knee_joints
from myomorph.core.tension.recruitment import EFFORT_ALONE, RecruitmentOptions, recruitment_terms
from myomorph.core.tension.static_loads import static_joint_loads
from myomorph.core.tension.terms.actuators import default_reserves

DISTANCES = (-0.007, 0.0, 0.007)
"""Of patellae beyond those of the model [m]: one standard deviation of published arms."""
FLEXION = 90.0
"""At which arms are compared [degrees]."""


def measure(folder: Path) -> Iterator[Row]:
    """Greatest forces of both knees, their mean, a row for each model, activity and distance."""
    for model_name in (ALONG, EXPERT):
        for activity in ACTIVITIES:
            if not (folder / activity.folder).is_dir():
                continue
            model, motion, wrenches = inputs(folder, activity, model_name)
            statics = static_joint_loads(model, motion, wrenches)
            knees = [place for place, name in enumerate(statics.joints) if "knee" in name]
            standing = wrenches.forces[:, :, 1].sum(axis=1) > 0.9 * model.weight
            least = statics.static_load_low[standing][:, knees].max(axis=0).mean()
            for distance in DISTANCES:
                moves = dict.fromkeys(patella_directions(model), distance)
                moved = with_patellae_farther(model, moves)
                yield {
                    "model": model_name,
                    "activity": activity.name,
                    "patella farther by [mm]": 1e3 * distance,
                    "arm of the tendon at 90 deg [cm]": _arm(moved),
                    "peak force [BW]": _peak(moved, motion, wrenches),
                    "minimum by statics [BW]": float(least / model.weight),
                    "maximum in implants [BW]": activity.implants,
                }


def _arm(model: mm.Model) -> float:
    """Moment arm of the first patellar tendon [cm]."""
    arms = next(arms for arms in knee_arms(model) if arms.band is PATELLAR_TENDON)
    return 100.0 * float(np.interp(FLEXION, arms.flexion, arms.arms))


def _peak(model: mm.Model, motion: mm.Motion, wrenches: mm.Wrenches) -> float:
    """Greatest force of each knee by default settings, their mean, in body weights."""
    torques = mm.inverse_dynamics(model, motion, wrenches)
    options = mm.TensionOptions()
    reserves = default_reserves(model)
    costs = RecruitmentOptions().settled(model, options, True)
    terms = recruitment_terms(model, motion, torques, wrenches, costs)
    found = mm.solve_tension(
        model, motion, torques, options, reserves, recruitment=EFFORT_ALONE, terms=terms
    )
    knees = [knee.name for knee in knee_joints(model)]
    forces = mm.joint_reactions(model, motion, found, wrenches, knees, actuators=reserves).forces
    standing = wrenches.forces[:, :, 1].sum(axis=1) > 0.9 * model.weight
    sizes = np.linalg.norm(forces[standing], axis=2)
    return float(sizes.max(axis=0).mean() / model.weight)

"""Forces of a recording's plates, on the bodies that stand on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.contact.assign import assign_bodies
from myomorph.contact.plates import wrenches_from_plates
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.segments import feet_of
from myomorph.model.series import Motion, Trial, Wrenches
from myomorph.study.trial.inputs import PosesBy


def recorded_wrenches(trial: Trial, bodies: Sequence[str]) -> Wrenches:
    """Forces of a recording's plates on the bodies that stand on them, in the plates' order; "" for none.

    Raises
    ------
    BadData
        where there are fewer plates than bodies
    """
    if len(bodies) > len(trial.plates):
        names = ", ".join(f"'{plate.name}'" for plate in trial.plates) or "none"
        raise BadData(f"{trial.source}: {len(bodies)} bodies are given for its plates, but the plates are {names}")
    used = [(plate, body) for plate, body in zip(trial.plates, bodies, strict=False) if body]
    wrenches = wrenches_from_plates([plate for plate, _ in used], trial.plate_time)
    return replace(wrenches, bodies=tuple(body for _, body in used))


def assigned_wrenches(trial: Trial, model: Model, motion: Motion) -> Wrenches:
    """Forces of a recording's plates, each given to the foot that is nearest to its center of pressure.

    Raises
    ------
    BadData
        where the model has no foot
    """
    feet = feet_of(model)
    if not feet:
        raise BadData(
            f"{trial.source}: no body of model '{model.name}' is called a foot: name the bodies on its plates"
        )
    wrenches = wrenches_from_plates(trial.plates, trial.plate_time)
    inside = (wrenches.time >= motion.time[0]) & (wrenches.time <= motion.time[-1])
    parts = {name: getattr(wrenches, name)[inside] for name in ("time", "forces", "points", "torques")}
    wrenches = replace(wrenches, **parts)
    poses = PosesBy(model, motion)
    places = {}
    for foot in feet:
        rotations, origins = poses(foot, wrenches.time)
        # Heel and ball: twice the way from the body's origin to its mass center.
        ahead = 2.0 * rotations @ model.body(foot).mass_center
        places[foot] = np.stack([origins, origins + ahead], axis=1)
    return assign_bodies(wrenches, places).wrenches

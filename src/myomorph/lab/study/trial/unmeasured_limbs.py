"""Muscles of limbs whose load is unmeasured have no tension while that lasts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.core.contact.undetermined import UNDETERMINED
from myomorph.core.model.model import Model
from myomorph.core.model.series import Wrenches
from myomorph.core.tension.dual import NOT_DETERMINED
from myomorph.core.tension.tension import Tension
from myomorph.lab.analysis.walking import chains, walking_limbs


def without_unmeasured_limbs(
    tension: Tension, model: Model, wrenches: Wrenches | None, driven: Mapping[str, str]
) -> Tension:
    """Return tensions without those of a limb whose load is not determined.

    At times at which the load on its foot is not determined, activations, forces, torques and
    reserves of its muscles are NaN; a frame in which none is left is "not determined". Limbs do not
    share a joint, so what is left is as solved. `driven`: reserve to the coordinate it drives, ""
    for none.
    """
    findings = () if wrenches is None else wrenches.findings
    limbs = chains(model, walking_limbs(model))
    joints = {joint.child: joint.coordinates for joint in model.joints}
    paths = [{point.body for point in model.muscle(name).path.points} for name in tension.muscles]
    muscles = np.zeros(tension.muscle_force.shape, bool)
    coordinates = np.zeros(tension.balanced_torque.shape, bool)
    reserves = np.zeros(tension.actuator_force.shape, bool)
    for finding in findings:
        if finding.kind == UNDETERMINED and finding.place in limbs:
            bodies = limbs[finding.place]
            own = {name for body in bodies for name in joints[body]}
            at = np.any(
                [(tension.time >= start) & (tension.time <= stop) for start, stop in finding.times],
                axis=0,
            )
            muscles[np.ix_(at, [bool(path & bodies) for path in paths])] = True
            coordinates[np.ix_(at, [name in own for name in tension.coordinates])] = True
            reserves[np.ix_(at, [driven.get(name) in own for name in tension.reserve_names])] = True
    if not muscles.any():
        return tension
    return replace(
        tension,
        activation=np.where(muscles, np.nan, tension.activation),
        muscle_force=np.where(muscles, np.nan, tension.muscle_force),
        balanced_torque=np.where(coordinates, np.nan, tension.balanced_torque),
        actuator_force=np.where(reserves, np.nan, tension.actuator_force),
        status=np.where(muscles.all(axis=1), NOT_DETERMINED, tension.status),
    )

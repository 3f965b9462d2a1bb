"""Passive torques of hips, knees and ankles as measured, of everything that crosses them.

With flexion of hip h, knee k and dorsiflexion of the ankle a [degrees], torques towards flexion and
dorsiflexion are [N m]

    hip    exp(1.4655 - 0.0034 k - 0.0750 h) - exp(1.3403 - 0.0226 k + 0.0305 h) + 8.072
    knee   exp(1.800 + 0.0460 a - 0.0352 k + 0.0217 h)
           - exp(-3.971 + 0.0004 a + 0.0495 k - 0.0128 h) - 4.820 + exp(2.220 - 0.150 k)
    ankle  exp(-7.9763 - 0.1949 a + 0.0008 k) - exp(2.1016 + 0.0843 a - 0.0176 k) + 1.792

the means of ten people. Muscles are part of them: with passive forces of muscles they count twice.

Source: Riener and Edrich 1999.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.shapes import Coordinates, GeneralizedForces
from myomorph.core.muscles.published_arms import size_of_person
from myomorph.core.rigid.leg_angles import JointAngle, LegAngles, leg_angles
from myomorph.core.rigid.tree import Tree

Tissue = Literal["none", "hips", "legs"]


def tissue_torques(tree: Tree, coordinates: Coordinates, tissue: Tissue) -> GeneralizedForces:
    """Passive torques of hips, or of whole legs, where the model has none of its own.

    Parameters
    ----------
    tree : the compiled model of a person
    coordinates : (frames, coordinates) [rad or m]
    tissue : whose torques; "none" for none

    Returns
    -------
    (frames, coordinates) [N m or N]

    Raises
    ------
    BadData : the model has no leg of a person
    """
    result = np.zeros_like(coordinates)
    if tissue == "none":
        return result
    legs = persons_legs(tree.model)
    if not legs:
        raise BadData(
            f"joint_tissue '{tissue}': model '{tree.model.name}' has no human leg: hip, knee"
            " and ankle that bend, with a thigh of 0.22 to 0.6 m; leave it out"
        )
    own = {torque.coordinate for torque in tree.model.passive_torques}
    names = tree.model.coordinate_names
    for leg in legs:
        for joint, torque in _of_leg(leg, np.degrees(coordinates), tissue):
            if names[joint.coordinate] not in own:
                result[:, joint.coordinate] += joint.sign * torque
    return result


def persons_legs(model: Model) -> tuple[LegAngles, ...]:
    """Find legs with hip and ankle that are as long as a person's."""
    return tuple(
        leg
        for leg in leg_angles(model)
        if leg.hip is not None
        and leg.ankle is not None
        and size_of_person(model, leg.knee.joint) is not None
    )


def _of_leg(leg: LegAngles, angles: Array, tissue: Tissue) -> list[tuple[JointAngle, Array]]:
    """Torques (frames,) of a leg's joints towards flexion [N m].

    Parameters
    ----------
    angles : (frames, coordinates) of the model [degrees]
    """
    assert leg.hip is not None
    assert leg.ankle is not None
    h = leg.hip.of(angles)
    k = leg.knee.of(angles)
    a = leg.ankle.of(angles)
    extended = np.exp(1.4655 - 0.0034 * k - 0.0750 * h)
    of_hip = extended - np.exp(1.3403 - 0.0226 * k + 0.0305 * h) + 8.072
    if tissue == "hips":
        return [(leg.hip, of_hip)]
    straight = np.exp(1.800 + 0.0460 * a - 0.0352 * k + 0.0217 * h) + np.exp(2.220 - 0.150 * k)
    of_knee = straight - np.exp(-3.971 + 0.0004 * a + 0.0495 * k - 0.0128 * h) - 4.820
    pointed = np.exp(-7.9763 - 0.1949 * a + 0.0008 * k)
    of_ankle = pointed - np.exp(2.1016 + 0.0843 * a - 0.0176 * k) + 1.792
    return [(leg.hip, of_hip), (leg.knee, of_knee), (leg.ankle, of_ankle)]

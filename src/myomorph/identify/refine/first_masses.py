"""Masses to begin with: those that plain inverse kinematics of the same recordings shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.identify.body.envelope import own_points
from myomorph.identify.recordings import RecordingOptions, Usable
from myomorph.identify.subject import IdentificationOptions, identify
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import Model
from myomorph.model.series import Motion

SPACING = 0.02
"""Of the mass points in each link's envelope [m]."""

STANDING = Motion(np.zeros(1), (), np.zeros((1, 0)))


def identified_masses(model: Model, recorded: Sequence[Usable], cutoff: float) -> Array:
    """(bodies, 10) of `identify`; the model's where it keeps these, or the recordings are too short for it."""
    options = IdentificationOptions(compare=False)
    points = {"own": own_points(model, STANDING, model.mass, SPACING)}
    try:
        identification = identify(model, recorded, points, options=options, recording=RecordingOptions(cutoff=cutoff))
    except BadData:
        return inertial_parameters(model)
    return identification.parameters[identification.chosen]

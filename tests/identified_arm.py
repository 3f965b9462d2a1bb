"""An arm on a force plate whose forces belong to a body of other masses than its model's."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.regressor import base_regressor, reference_points
from myomorph.show.demo.arm import table_text

LOADS = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><ExternalLoads name="loads"><objects><ExternalForce name="plate">
<applied_to_body>upper</applied_to_body><force_expressed_in_body>ground</force_expressed_in_body>
<point_expressed_in_body>ground</point_expressed_in_body><force_identifier>plate_v</force_identifier>
<point_identifier>plate_p</point_identifier><torque_identifier>plate_m</torque_identifier></ExternalForce></objects>
<datafile>{table}</datafile></ExternalLoads></OpenSimDocument>
"""
UPPER = 2.4
"""True mass of the upper arm of 4 kg in all [kg]; the model says 2."""


def put_on_plate(arm: SimpleNamespace) -> None:
    """Write forces and loads in place of the arm's own.

    They are what a plate measures under the true arm.
    """
    model = read_osim(arm.model)
    motion = differentiate(motion_from_table(read_sto(arm.motion), model))
    parameters = inertial_parameters(model) * np.array([[UPPER / 2.0], [(4.0 - UPPER) / 2.0]])
    wrench = base_regressor(model, motion) @ parameters.ravel()
    places = reference_points(model, motion)
    columns = {"time": motion.time}
    for kind, values in (("v", wrench[:, 3:]), ("p", places), ("m", wrench[:, :3])):
        columns |= {
            f"plate_{kind}{axis}": column for axis, column in zip("xyz", values.T, strict=True)
        }
    arm.forces.write_text(table_text(columns))
    arm.loads.write_text(LOADS.format(table=arm.forces.name))

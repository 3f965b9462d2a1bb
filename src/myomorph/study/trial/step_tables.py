"""The tables that steps write."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from myomorph.model.model import Model
from myomorph.model.series import Series, Table
from myomorph.motion.ik import KinematicsFit

if TYPE_CHECKING:
    pass


def error_table(fit: KinematicsFit) -> Table:
    """Marker errors as a table: root mean square, largest, and each marker's [m]."""
    values = np.column_stack([fit.rms, fit.largest, fit.errors])
    return Table(fit.motion.time, ("rms", "largest", *fit.marker_names), values)


def torque_table(torques: Series, model: Model) -> Table:
    """Generalized forces as OpenSim's inverse dynamics names them: `hip_flexion_r_moment`, `pelvis_tx_force`."""
    endings = {"rotational": "moment", "translational": "force", "coupled": "force"}
    names = tuple(f"{name}_{endings[model.coordinate(name).motion]}" for name in torques.names)
    facts = MappingProxyType({"name": "Inverse Dynamics Generalized Forces"})
    return Table(torques.time, names, torques.values, facts=facts)

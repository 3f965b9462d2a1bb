"""How well coordinates explain markers, to a result file and back."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.quantities import FIT, SENSOR_ERROR
from myomorph.lab.store.quantities import get_fields, put_value, value_of
from myomorph.lab.store.results import ResultWriter, Stored
from myomorph.lab.store.stored import get_motion, put_motion


def put_fit(writer: ResultWriter, fit: KinematicsFit, model: Model) -> None:
    """Coordinates found, and how well they explain the markers."""
    put_motion(writer, fit.motion, model)
    put_value(writer, fit, leave_out=(COORDINATE_VALUE,))


def get_fit(stored: Stored) -> KinematicsFit | None:
    """Read what `put_fit` wrote, or None."""
    fields = get_fields(stored, FIT)
    if "converged" not in fields:
        return None
    absent = {
        "marker_error": np.empty((len(stored.time), 0)),
        "marker_weight": np.empty(0),
        "unused_markers": (),
        "missing_markers": (),
    }
    sensor_errors = fields.pop(SENSOR_ERROR.field, None)
    others = {
        "motion": get_motion(stored),
        "marker_names": stored.names.get("marker", ()),
        "task_errors": {} if sensor_errors is None else {"OrientationTask": sensor_errors},
        "sensor_names": stored.names.get("sensor", ()),
    }
    return value_of(KinematicsFit, absent, fields, others)

"""The section of limits: every number in a unit of its own."""

from dataclasses import replace

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.load_quantities import JOINT_REACTION
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.validation import uncertainty_section, unit_of
from myomorph.lab.uncertainty.spread import Shares, Spread, Uncertainty
from walker import everything, model

NAMES = ("pelvis_tx", "hip_flexion_r")


def spread(half: float) -> Spread:
    ones = np.ones((3, 2))
    return Spread(
        time=np.arange(3.0),
        names=NAMES,
        low=-half * ones,
        high=half * ones,
        deviation=0.5 * half * ones,
        quantity=COORDINATE_VALUE,
    )


def test_units_are_those_of_each_column() -> None:
    own = model()
    units = {
        (COORDINATE_VALUE, "hip_flexion_r"): "°",
        (COORDINATE_VALUE, "pelvis_tx"): "m",
        (GENERALIZED_FORCE, "knee_angle_r"): "N·m",
        (GENERALIZED_FORCE, "pelvis_ty"): "N",
        (MUSCLE_FORCE, "recfem_r"): "N",
        (ACTIVATION, "recfem_r"): "",
        (JOINT_REACTION, "hip_r_force"): "N",
        (JOINT_REACTION, "hip_r_on_femur_r_in_femur_r_mx"): "N·m",
        (JOINT_REACTION, "hip_r_on_femur_r_in_femur_r_pz"): "m",
    }
    assert {key: unit_of(*key, own) for key in units} == units


def test_angles_are_in_degrees_and_sources_are_named_where_they_are_known() -> None:
    found = Uncertainty(FrozenMap({"coordinate_value": spread(0.1)}), draws=20)
    section = uncertainty_section(prepare(replace(everything(), uncertainty=found)))
    assert section is not None
    (grid,) = section.grids
    assert grid.rows == (("hip_flexion_r", "11.5 °", "2.86 °"), ("pelvis_tx", "0.200 m", "0.050 m"))
    assert len(grid.head) == 3
    shares = Shares(
        ("markers", "joints"),
        np.array([[0.2, 0.7], [0.8, 0.3]]),
        np.array([[0.2, 0.7], [0.8, 0.3]]),
    )
    known = replace(found, shares=FrozenMap({"coordinate_value": shares}))
    section = uncertainty_section(prepare(replace(everything(), uncertainty=known)))
    assert section is not None
    assert [row[-1] for row in section.grids[0].rows] == [
        "markers 70 %, joints 30 %",
        "joints 80 %, markers 20 %",
    ]

"""ForceSet files of ideal actuators."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.actuators import read_actuators
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadFile, UnknownName

TWO = """<OpenSimDocument Version="40000"><ForceSet name="set"><objects>
 <CoordinateActuator name="a"><min_control>-Inf</min_control><max_control>2</max_control>
  <coordinate>{coordinate}</coordinate><optimal_force>50</optimal_force></CoordinateActuator>
 <TorqueActuator name="b"><bodyA>{body}</bodyA><bodyB>ground</bodyB><axis>0 1 0</axis>\
</TorqueActuator>
 <PointToPointActuator name="c"><bodyA>{body}</bodyA><bodyB>ground</bodyB><pointA>1 0 0</pointA>\
<pointB>0 0 2</pointB>
 </PointToPointActuator>
 <PointActuator name="d"><appliesForce>false</appliesForce><body>{body}</body></PointActuator>
</objects></ForceSet></OpenSimDocument>"""


@pytest.fixture
def model(data):
    return read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))


@pytest.fixture
def actuators(tmp_path):
    def write(**names):
        path = tmp_path / "actuators.xml"
        path.write_text(TWO.format(**{"coordinate": "knee_angle_r", "body": "pelvis"} | names))
        return path

    return write


def test_residuals_of_a_real_file(data):
    found = read_actuators(data("opensim-gait-subject01/ref_rra/gait2354_RRA_Actuators.xml"))
    by_name = {one.name: one for one in found}
    assert len(by_name) == 23
    force = by_name["FX"]
    assert (force.kind, force.body) == ("point", "pelvis")
    assert np.array_equal(np.abs(force.direction), (1, 0, 0))
    assert force.direction_is_global
    assert sum(one.kind == "coordinate" for one in found) == 17
    assert sum(one.kind == "torque" for one in found) == 3


def test_kinds_and_their_defaults(actuators, model):
    a, b, c = read_actuators(actuators(), model)
    assert (a.kind, a.coordinate, a.optimal_force) == ("coordinate", "knee_angle_r", 50)
    assert (a.min_control, a.max_control) == (-np.inf, 2)
    assert (b.kind, b.body, b.other_body, b.direction_is_global) == (
        "torque",
        "pelvis",
        "ground",
        True,
    )
    assert np.array_equal(c.point, (1, 0, 0))
    assert np.array_equal(c.other_point, (0, 0, 2))
    assert not c.point_is_global


def test_names_are_looked_up_in_the_model(actuators, model):
    with pytest.raises(UnknownName, match=r"unknown coordinate 'knee'.*'a'.*'knee_angle_r'"):
        read_actuators(actuators(coordinate="knee"), model)
    with pytest.raises(UnknownName, match=r"unknown body 'pelvus'.*'pelvis'"):
        read_actuators(actuators(body="pelvus"), model)
    assert len(read_actuators(actuators(body="pelvus"))) == 3


def test_other_forces_are_refused_by_name(data, tmp_path):
    with pytest.raises(
        BadFile, match="SmoothSphereHalfSpaceForce 'contactHeel_r': is not an ideal actuator"
    ):
        read_actuators(data("rajagopal-walk-emg/subject_walk_scaled_ContactForceSet.xml"))
    empty = tmp_path / "empty.xml"
    empty.write_text(
        '<OpenSimDocument Version="40000"><ForceSet><objects/></ForceSet></OpenSimDocument>'
    )
    with pytest.raises(BadFile, match="no actuator"):
        read_actuators(empty)

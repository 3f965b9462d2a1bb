"""Input files are fitted to the model.

Which way is up, what unit, which foot stands on which plate.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import ForcePlate, Markers, Trial
from myomorph.core.motion.measurements import default_markers
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.external_forces import on_feet, plate_wrenches, read_loads
from myomorph.lab.study.inputs.reading import fitted_to, open_model, read_motion


@pytest.fixture(scope="module")
def walker(data):
    return open_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))


def test_c3d_with_z_up_is_turned(data):
    """The same static trial as C3D, with z up, and as TRC, which was rotated by hand."""
    model = open_model(data("c3d-functional-joints/models/scaled.osim"))
    turned = fitted_to(model, reading.read_recording(data("c3d-functional-joints/static.c3d")))
    plain = reading.read_recording(data("c3d-functional-joints/static.trc"))
    assert any("z axis points up" in text for text in turned.warnings)
    names = [
        name
        for name in model.marker_names
        if name in turned.markers.names and name in plain.markers.names
    ]
    assert len(names) > 40
    height = {
        kind: np.array([np.nanmean(trial.markers[name][:, axis]) for name in names])
        for kind, trial, axis in (("turned", turned, 1), ("plain", plain, 1))
    }
    own = default_markers(model, names)[:, 1]
    assert np.corrcoef(height["turned"], own)[0, 1] > 0.99
    assert np.ptp(height["turned"]) == pytest.approx(np.ptp(own), rel=0.15)


def test_trc_is_taken_as_it_is(walker, data):
    trial = reading.read_recording(data("rajagopal-walk-emg/markers_walk.trc"))
    assert fitted_to(walker, trial) is trial


@pytest.mark.parametrize(
    ("factor", "word"), [(1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "metres")]
)
def test_wrong_units_are_suspected(walker, data, factor, word):
    trial = reading.read_recording(data("rajagopal-walk-emg/markers_walk.trc"))
    markers = trial.markers
    wrong = Trial(
        markers=Markers(markers.time, markers.names, factor * markers.values), source="walk.trc"
    )
    with pytest.raises(BadData, match=f"are its numbers {word}"):
        fitted_to(walker, wrong)


def test_plates_go_to_the_feet_that_stand_on_them(walker, data):
    """Forces whose feet are known, as if two plates had measured them.

    Nearness finds the feet again.
    """
    motion = read_motion(data("rajagopal-walk-emg/coordinates.sto"), walker)
    known = read_loads(data("rajagopal-walk-emg/grf_walk.xml"), walker, motion)
    loaded = known.forces[:, :, 1] > 30.0
    plates = []
    for i in range(2):
        rest = ~loaded[:, i, None]
        point = np.where(rest, np.nan, known.points[:, i])
        torque = np.where(rest, np.nan, known.torques[:, i])
        middle = np.nanmean(point, axis=0)
        corners = middle + np.array([[1, 0, 1], [-1, 0, 1], [-1, 0, -1], [1, 0, -1]]) * 0.3
        force = np.where(rest, 0.0, known.forces[:, i])
        plates.append(
            ForcePlate(
                name=f"plate {i + 1}",
                kind=2,
                corners=corners,
                forces=force,
                points=point,
                torques=torque,
            )
        )
    found = on_feet(
        plate_wrenches(Trial(plates=tuple(plates), plate_time=known.time)), walker, motion
    )
    assert feet_of(walker) == ("calcn_r", "calcn_l")
    inside = (known.time >= motion.time[0]) & (known.time <= motion.time[-1])
    during = (found.time >= motion.time[0]) & (found.time <= motion.time[-1])
    for foot in ("calcn_r", "calcn_l"):
        mine = sum(
            found.forces[during, i, 1] for i, body in enumerate(found.bodies) if body == foot
        )
        right = (
            known.forces[inside][:, known.bodies.index(foot), 1]
            * loaded[inside][:, known.bodies.index(foot)]
        )
        assert np.abs(mine - right).max() < 1.0


def test_loads_of_the_wrong_kind(walker, data, tmp_path):
    motion = read_motion(data("rajagopal-walk-emg/coordinates.sto"), walker)
    with pytest.raises(BadFile, match=r"ends in '\.doc'"):
        read_loads(tmp_path / "x.doc", walker, motion)
    with pytest.raises(BadData, match="no columns of a force"):
        read_loads(data("rajagopal-walk-emg/id_walk.sto"), walker, motion)
    with pytest.raises(BadData, match="belong to a recording"):
        read_loads(data("rajagopal-walk-emg/grf_walk.mot"), walker, motion, plates=("calcn_r",))
    with pytest.raises(BadData, match="names the bodies itself"):
        read_loads(
            data("rajagopal-walk-emg/grf_walk.xml"), walker, motion, {"ground_force_r_": "calcn_r"}
        )
    with pytest.raises(BadData, match="no column names"):
        read_loads(
            data("c3d-opensim-walking/walking2.c3d"), walker, motion, {"ground_force_r_": "calcn_r"}
        )


def test_force_table_equals_the_loads_file(walker, data):
    motion = read_motion(data("rajagopal-walk-emg/coordinates.sto"), walker)
    by_xml = read_loads(data("rajagopal-walk-emg/grf_walk.xml"), walker, motion)
    bodies = {"ground_force_r_": "calcn_r", "ground_force_l_": "calcn_l"}
    by_table = read_loads(data("rajagopal-walk-emg/grf_walk.mot"), walker, motion, bodies)
    for name in ("time", "forces", "points", "torques"):
        np.testing.assert_array_equal(getattr(by_table, name), getattr(by_xml, name))
    assert by_table.bodies == by_xml.bodies

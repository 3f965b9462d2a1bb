"""Which foot stands on which plate: real walks with known sides, and a shared plate."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.contact.assign import assign_bodies
from myomorph.core.contact.plates import force_plates, wrenches_from_plates
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Wrenches


def feet(markers, names=("HEE", "TOE", "ANK")):
    return {side: np.stack([markers[side + name] for name in names], axis=1) for side in "LR"}


@pytest.mark.parametrize(
    "name", ["HC030A/Straight/HC030A05", "HC002D/Straight/HC002D06", "HC030A/Turn/HC030A22"]
)
def test_walks_with_sides_known_to_plug_in_gait(name, data):
    trial = force_plates(read_c3d(data(f"c3d-gait-plugingait/{name}.c3d")))
    wrenches = wrenches_from_plates(trial.plates, trial.plate_time, trial.markers.time)
    found = assign_bodies(wrenches, feet(trial.markers))
    assert found.warnings == ()
    assert len(found.contacts) == 2
    mass = float(trial.facts["body mass"].split()[0])
    for side in "LR":
        theirs = np.nan_to_num(trial.other_points[f"{side}GroundReactionForce"])[:, 2] * mass
        columns = [k for k, body in enumerate(found.wrenches.bodies) if body == side]
        mine = found.wrenches.forces[:, columns, 2].sum(axis=1)
        firm = theirs > 0.3 * mass * 9.81
        assert firm.sum() > 20
        # Plug-in Gait averages over a frame, so forces at heel strike differ: the side is what is
        # held.
        assert (mine[firm] > 0).all()
        assert np.median(np.abs(mine[firm] - theirs[firm])) < 1.0


def test_two_feet_on_one_plate_at_once_are_doubted(data):
    trial = force_plates(read_c3d(data("c3d-gait-plugingait/HC030A/Static/HC030A01.c3d")))
    wrenches = wrenches_from_plates(trial.plates, trial.plate_time, trial.markers.time)
    found = assign_bodies(wrenches, feet(trial.markers))
    assert any("two bodies" in line for line in found.warnings)


def test_a_walk_given_by_its_loads_file(data):
    """The loads file says which foot each force acts on; the points must say the same."""
    opensim_says = read_external_loads(data("rajagopal-walk-emg/grf_walk.xml"))
    markers = read_trc(data("rajagopal-walk-emg/markers_walk.trc")).markers
    names = {"calcn_r": ("R.Heel", "R.Toe"), "calcn_l": ("L.Heel", "L.Toe")}
    names = {body: [one for one in some if one in markers.names] for body, some in names.items()}
    if not all(names.values()):
        pytest.skip("the feet of rajagopal-walk-emg carry other markers than this test knows")
    samples = np.rint(markers.time * 2000).astype(int)
    samples = samples[samples < len(opensim_says)]
    thin = Wrenches(
        time=opensim_says.time[samples],
        names=opensim_says.names,
        bodies=("", ""),
        forces=opensim_says.forces[samples],
        points=opensim_says.points[samples],
        torques=opensim_says.torques[samples],
    )
    positions = {
        body: np.stack([markers[one] for one in some], axis=1)[: len(samples)]
        for body, some in names.items()
    }
    found = assign_bodies(thin, positions)
    firm = [one for one in found.contacts if one.stop - one.start > 0.2]
    assert len(firm) >= 2
    for contact in firm:
        assert contact.body == opensim_says.bodies[opensim_says.names.index(contact.plate)]


def test_a_plate_that_one_foot_leaves_to_the_other_is_split():
    time = np.arange(200) / 100
    force = np.zeros((200, 1, 3))
    force[10:190, 0, 1] = 700.0
    point = np.zeros((200, 1, 3))
    point[:100, 0, 0] = 0.1
    point[100:, 0, 0] = 0.6
    wrenches = Wrenches(
        time=time,
        names=("belt",),
        bodies=("",),
        forces=force,
        points=point,
        torques=np.zeros((200, 1, 3)),
    )
    left = np.zeros((200, 3)) + [0.1, 0.05, 0]
    right = np.zeros((200, 3)) + [0.6, 0.05, 0]
    found = assign_bodies(wrenches, {"left": left, "right": right})
    assert found.wrenches.names == ("belt_left", "belt_right")
    assert found.wrenches.bodies == ("left", "right")
    np.testing.assert_array_equal(found.wrenches.forces.sum(axis=1), force[:, 0])
    assert np.flatnonzero(found.wrenches.forces[:, 1, 1])[0] == 100


def test_a_short_flicker_of_the_nearest_foot_is_overruled():
    time = np.arange(200) / 100
    wrenches = Wrenches(
        time=time,
        names=("p",),
        bodies=("",),
        forces=np.ones((200, 1, 3)),
        points=np.zeros((200, 1, 3)),
        torques=np.zeros((200, 1, 3)),
    )
    near = np.zeros((200, 3))
    far = np.zeros((200, 3)) + 0.3
    far[50:53] = 0.0
    near[50:53] = 0.3
    found = assign_bodies(wrenches, {"near": near, "far": far})
    assert found.wrenches.bodies == ("near",)


def test_hidden_feet_and_wrong_clocks_are_told():
    time = np.arange(10) / 100
    wrenches = Wrenches(
        time=time,
        names=("p",),
        bodies=("",),
        forces=np.ones((10, 1, 3)),
        points=np.zeros((10, 1, 3)),
        torques=np.zeros((10, 1, 3)),
    )
    found = assign_bodies(wrenches, {"foot": np.full((10, 3), np.nan)})
    assert found.wrenches.bodies == ("",)
    assert any("no candidate" in line for line in found.warnings)
    with pytest.raises(BadData, match=r"\(10, points, 3\)"):
        assign_bodies(wrenches, {"foot": np.zeros((9, 3))})
    with pytest.raises(BadData, match="no candidate"):
        assign_bodies(wrenches, {})

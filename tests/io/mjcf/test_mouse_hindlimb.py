"""The anatomist's mouse leg, written as .osim.

OpenSim finds the joints and muscle lengths that we do.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from opensim_oracle import ask
from truths.mouse_hindlimb import FILE, mouse_hindlimb_model

TOLERANCE = 1e-6


def test_it_is_a_mouse(data):
    model = mouse_hindlimb_model(data(FILE))
    assert (len(model.muscles), len(model.wrap_objects), len(model.bodies)) == (42, 22, 6)
    assert sum(len(one.path.points) for one in model.muscles) == 146
    assert 0.019 < model.mass < 0.021
    assert any("Foot_r" in one for one in model.warnings)


def test_opensim_finds_the_same(data, tmp_path):
    pytest.importorskip("opensim")
    model = mouse_hindlimb_model(data(FILE))
    assert write_osim(model, tmp_path / "mouse.osim") == ()
    found = ask({"mouse": tmp_path / "mouse.osim"}, tmp_path)["mouse"]
    assert isinstance(found, dict), found
    tree = compile_tree(model)
    for pose in found["poses"]:
        values = np.array([[pose["coordinates"][name] for name in model.coordinate_names]])
        motion = Motion(np.zeros(1), model.coordinate_names, values)
        kinematics = forward_kinematics(tree, values)
        for name, (rotation, place) in pose["bodies"].items():
            i = tree.body_index[name]
            assert kinematics.rotations[0, i] == pytest.approx(rotation, abs=TOLERANCE)
            assert kinematics.origins[0, i] == pytest.approx(place, abs=TOLERANCE)
        lengths = muscle_kinematics(
            model, motion, velocities=False, moment_arms=False
        ).muscle_length[0]
        for i, name in enumerate(model.muscle_names):
            assert lengths[i] == pytest.approx(pose["lengths"][name], abs=TOLERANCE), name


def test_reading_it_back_keeps_it(data, tmp_path):
    model = mouse_hindlimb_model(data(FILE))
    write_osim(model, tmp_path / "mouse.osim")
    back = read_osim(tmp_path / "mouse.osim")
    assert back.coordinate_names == model.coordinate_names
    for one, other in zip(model.muscles, back.muscles, strict=True):
        assert dict(one.parameters).items() <= dict(other.parameters).items()
        assert set(one.groups) == set(other.groups)

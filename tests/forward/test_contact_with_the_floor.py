"""Compliant contact: OpenSim's law, its energy, and feet on a floor."""

from __future__ import annotations

import numpy as np
import pytest
from tests.forward.opensim_manager import opensim_forward

from myomorph.core.io.formats import read_model
from myomorph.core.model.series import Motion
from myomorph.forward.contact_law import ContactLaw, ContactSphere, Ground
from myomorph.forward.drives import Drives
from myomorph.forward.feet import depth_at, floor_under_feet
from myomorph.forward.simulate import SimulationOptions, simulate

RATE = 50.0
LAW = ContactLaw(stiffness=1e5, dissipation=0.5)
# Of a free joint OpenSim's speeds are no rates of its angles, but where these are 0.
START = {
    "free_coord_2": (0.0, 3.0),
    "free_coord_3": (0.0, 1.0),
    "free_coord_4": (0.2, 0.0),
    "free_coord_5": (0.0, 0.3),
}


def test_a_spinning_ball_bounces_as_in_opensim(tmp_path):
    pytest.importorskip("opensim")
    law = {
        "stiffness": LAW.stiffness,
        "dissipation": LAW.dissipation,
        "static_friction": LAW.static,
        "dynamic_friction": LAW.dynamic,
        "viscous_friction": LAW.viscous,
        "transition_velocity": LAW.transition_velocity,
        "hertz_smoothing": LAW.hertz_smoothing,
        "hunt_crossley_smoothing": LAW.hunt_crossley_smoothing,
    }
    theirs, ran = opensim_forward(
        "ball", tmp_path, seconds=0.6, rate=RATE, start=START, law=law, accuracy=1e-8
    )
    model = read_model(ran)
    start = Motion(
        np.zeros(1),
        tuple(START),
        np.array([[value for value, _ in START.values()]]),
        velocities=np.array([[speed for _, speed in START.values()]]),
    )
    sphere = ContactSphere(body="ball", center=np.zeros(3), radius=0.1)
    drives = Drives(ground=Ground(spheres=(sphere,), law=LAW))
    options = SimulationOptions(seconds=0.6, rate=RATE, tolerance=1e-8)
    simulation = simulate(model, start, drives, options)
    columns = [simulation.motion.names.index(name) for name in theirs["names"]]
    assert np.abs(simulation.motion.values[:, columns] - theirs["values"]).max() < 1e-4
    assert simulation.energy.largest_share < 1e-5
    assert simulation.contact_force[:, 0, 1].max() > 5.0 * model.weight


def test_feet_stand_on_the_floor_that_is_under_them(data):
    model = read_model(data("opensim-gait-subject01/ref_id/subject01.osim"))
    ground = floor_under_feet(model)
    assert len(ground.spheres) == 12
    assert {sphere.body for sphere in ground.spheres} == {"calcn_r", "toes_r", "calcn_l", "toes_l"}
    deep = depth_at(model, ground, None)
    below = floor_under_feet(model, -deep)
    assert depth_at(model, below, None) == pytest.approx(0.0, abs=1e-12)

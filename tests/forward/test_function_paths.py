"""Muscles whose lengths are functions of coordinates, in motion: OpenSim's, and their energy."""

from __future__ import annotations

import numpy as np
import pytest
from tests.forward.opensim_manager import opensim_forward
from tests.muscles.function_arm import PATHS, function_arm, function_path

from myomorph.core.io.formats import read_model
from myomorph.core.model.series import Motion, Series
from myomorph.forward.drives import Drives
from myomorph.forward.simulate import SimulationOptions, simulate

RATE = 20.0
START = {
    "shoulder_angle": (0.3, 0.0),
    "elbow_angle": (0.4, 0.5),
    "wrist_angle": (0.1, 0.0),
}
DRIVEN = [[0.0, 0.05], [0.1, 0.4], [0.3, 0.1]]


def test_an_arm_moves_as_in_opensim(tmp_path):
    pytest.importorskip("opensim")
    path = tmp_path / "arm.osim"
    path.write_text(function_arm(PATHS), encoding="utf-8")
    controls = dict.fromkeys(PATHS, DRIVEN)
    theirs, ran = opensim_forward(
        path,
        tmp_path,
        # Rigid tendons have no damping of their fibers here.
        changes=["undamped", "rigid"],
        seconds=0.1,
        rate=RATE,
        start=START,
        controls=controls,
    )
    model = read_model(ran)
    assert all(muscle.path.function is not None for muscle in model.muscles)
    time = np.array([sample[0] for sample in DRIVEN])
    values = np.array([[sample[1]] * len(PATHS) for sample in DRIVEN])
    drives = Drives(excitations=Series(time, tuple(PATHS), values))
    start = Motion(
        np.zeros(1),
        tuple(START),
        np.array([[value for value, _ in START.values()]]),
        velocities=np.array([[speed for _, speed in START.values()]]),
    )
    options = SimulationOptions(seconds=0.1, rate=RATE, tolerance=1e-8)
    simulation = simulate(model, start, drives, options)
    columns = [simulation.motion.names.index(name) for name in theirs["names"]]
    assert np.abs(simulation.motion.values[:, columns] - theirs["values"]).max() < 1e-6
    assert np.abs(np.diff(theirs["values"], axis=0)).max() > 0.1
    assert simulation.energy.largest_share < 1e-6


def test_moment_arms_do_the_work_where_a_velocity_has_a_function_of_its_own(tmp_path):
    speed = "<LinearFunction><coefficients>0 0.7 0.1</coefficients></LinearFunction>"
    more = f"<lengthening_speed_function>{speed}</lengthening_speed_function>"
    length = "<LinearFunction><coefficients>-0.02 0.33</coefficients></LinearFunction>"
    path = tmp_path / "arm.osim"
    own = function_path(length, "elbow", more=more)
    path.write_text(function_arm({"own": own}), encoding="utf-8")
    drives = Drives(activations=Series(np.zeros(1), ("own",), np.full((1, 1), 0.5)))
    simulation = simulate(read_model(path), None, drives, SimulationOptions(seconds=0.2))
    work = dict(zip(simulation.energy.names, simulation.energy.work[-1], strict=True))
    assert abs(work["muscles"]) > 0.1
    assert simulation.energy.largest_share < 1e-5

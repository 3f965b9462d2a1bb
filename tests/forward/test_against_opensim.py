"""Simulations against OpenSim's Manager: rigid bodies, rigid and elastic tendons."""

from __future__ import annotations

import numpy as np
import pytest
from tests.forward.opensim_manager import opensim_forward

from myomorph.core.io.formats import read_model
from myomorph.core.model.series import Motion, Series
from myomorph.forward.drives import Drives
from myomorph.forward.simulate import SimulationOptions, simulate

pytest.importorskip("opensim")

RATE = 20.0
FLEXORS = ("BIClong", "BICshort", "BRA")
EXTENSORS = ("TRIlong", "TRIlat", "TRImed")
FLEXING = [[0.0, 0.05], [0.1, 0.25], [0.3, 0.05]]
EXTENDING = [[0.0, 0.05], [0.1, 0.1], [0.3, 0.25]]
CONTROLS = dict.fromkeys(FLEXORS, FLEXING) | dict.fromkeys(EXTENSORS, EXTENDING)
ARM = {"r_shoulder_elev": (0.2, 0.0), "r_elbow_flex": (0.8, 0.0)}


def state(start):
    """Make a motion of one frame of a start."""
    return Motion(
        time=np.zeros(1),
        names=tuple(start),
        values=np.array([[value for value, _ in start.values()]]),
        velocities=np.array([[speed for _, speed in start.values()]]),
    )


def ours(path, start, seconds, controls=None, tendons="rigid"):
    """Run the same with the model that OpenSim ran."""
    model = read_model(path)
    drives = Drives()
    if controls:
        time = np.array([sample[0] for sample in next(iter(controls.values()))])
        values = np.array([[value for _, value in samples] for samples in controls.values()]).T
        drives = Drives(excitations=Series(time, tuple(controls), values))
    options = SimulationOptions(seconds=seconds, rate=RATE, tolerance=1e-8, tendons=tendons)
    return simulate(model, state(start), drives, options)


def apart(simulation, theirs):
    """Largest difference of any coordinate [rad or m]."""
    columns = [simulation.motion.names.index(name) for name in theirs["names"]]
    return float(np.abs(simulation.motion.values[:, columns] - theirs["values"]).max())


def test_a_double_pendulum(data, tmp_path):
    start = {"r1_z": (1.0, 0.5), "r2_x": (-0.7, 1.0)}
    path = data("opensim-reference-small/DoublePendulum3D.osim")
    theirs, ran = opensim_forward(path, tmp_path, seconds=1.0, rate=RATE, start=start)
    assert apart(ours(ran, start, 1.0), theirs) < 1e-7


@pytest.mark.parametrize(
    ("change", "tendons", "seconds"),
    [
        ("rigid", "rigid", 0.3),
        # Beyond 0.2 s the triceps jumps from one side of its surface to the other in OpenSim.
        ("", "elastic", 0.2),
    ],
    ids=["DeGrooteFregly2016, rigid tendons", "Thelen2003, elastic tendons"],
)
def test_an_arm_with_excitations(data, tmp_path, change, tendons, seconds):
    path = data("opensim-reference-small/arm26_bounds.osim")
    theirs, ran = opensim_forward(
        path,
        tmp_path,
        changes=[change] if change else [],
        seconds=seconds,
        rate=RATE,
        start=ARM,
        controls=CONTROLS,
    )
    simulation = ours(ran, ARM, seconds, CONTROLS, tendons)
    assert apart(simulation, theirs) < 1e-6
    assert np.abs(simulation.muscle_force - theirs["forces"]).max() < 2e-3
    assert simulation.energy.largest_share < 1e-6

"""Generalized forces from OpenSim's own inverse dynamics solver, without muscles and actuators."""

from __future__ import annotations

import numpy as np
import pytest


def opensim_torques(path, model, c, cdot, cddot):
    """Return OpenSim's torques (frames, coordinates) [N m or N] in the model's order.

    States are (frames, coordinates) in that order.
    """
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    theirs = opensim.Model(str(path))
    theirs.updForceSet().clearAndDestroy()
    state = theirs.initSystem()
    solver = opensim.InverseDynamicsSolver(theirs)
    coordinates = theirs.getCoordinateSet()
    # OpenSim's vectors are in the order of its multibody tree: a speed of its own for each tells
    # which.
    for j, name in enumerate(model.coordinate_names):
        coordinates.get(name).setLocked(state, False)
        coordinates.get(name).setSpeedValue(state, j + 1.0)
    order = [round(speed) - 1 for speed in state.getU().to_numpy()]
    torques = np.empty(c.shape)
    for frame in range(len(c)):
        for j, name in enumerate(model.coordinate_names):
            coordinates.get(name).setValue(state, float(c[frame, j]), False)
            coordinates.get(name).setSpeedValue(state, float(cdot[frame, j]))
        theirs.realizeVelocity(state)
        torques[frame, order] = solver.solve(
            state, opensim.Vector.createFromMat(cddot[frame, order])
        ).to_numpy()
    return torques

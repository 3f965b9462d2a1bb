"""OpenSim's point constraint of a model: its gap, derivatives, and assembled pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import opensim

import myomorph as mm

opensim.Logger.setLevelString("Off")


def point_constraint(
    path: Path, model: mm.Model, coordinates: np.ndarray, accuracy: float = 1e-10
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate the first constraint of a model file at given poses, all coordinates unlocked.

    Parameters
    ----------
    path : the model file
    model : the same model, for the order of its coordinates
    coordinates : (frames, coordinates) in the model's order
    accuracy : of the assembly

    Returns
    -------
    gaps (frames, 3) [m] and their derivatives (frames, 3, coordinates) in a frame of OpenSim's
    choice, and assembled (frames, coordinates): each pose as OpenSim closes it, all coordinates
    weighted alike
    """
    theirs = opensim.Model(str(path))
    theirs.updForceSet().clearAndDestroy()
    state = theirs.initSystem()
    matter = theirs.getMatterSubsystem()
    named = theirs.getCoordinateSet()
    columns = []
    for name in model.coordinate_names:
        named.get(name).setLocked(state, False)
    for name in model.coordinate_names:
        before = state.getQ().to_numpy().copy()
        named.get(name).setValue(state, named.get(name).getValue(state) + 0.1, False)
        columns.append(int(np.argmax(np.abs(state.getQ().to_numpy() - before))))
    gaps = []
    derivatives = []
    assembled = []
    for row in coordinates:
        references = opensim.SimTKArrayCoordinateReference()
        for name, value in zip(model.coordinate_names, row, strict=True):
            named.get(name).setValue(state, float(value), False)
            references.push_back(opensim.CoordinateReference(name, opensim.Constant(float(value))))
        theirs.realizePosition(state)
        matrix = opensim.Matrix()
        matter.calcPq(state, matrix)
        gaps.append(state.getQErr().to_numpy()[:3].copy())
        derivatives.append(matrix.to_numpy()[:3, columns])
        solver = opensim.AssemblySolver(theirs, references)
        solver.setAccuracy(accuracy)
        solver.assemble(state)
        assembled.append([named.get(name).getValue(state) for name in model.coordinate_names])
    return np.array(gaps), np.array(derivatives), np.array(assembled)

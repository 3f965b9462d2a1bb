"""Muscle lengths and moment arms of real models against OpenSim, within nanometers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from path_models import opensim_lengths

from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.paths import MovingPathPoint
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.coordinates import couple_frames

opensim = pytest.importorskip("opensim")
SAME = 1e-6
FRAMES = 4
PAIRS = 60
CASES = {
    "rajagopal-walk-emg/subject_walk_scaled.osim": "rajagopal-walk-emg/coordinates.sto",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim": "",
    "opencap-subject4-multitask/models/manually_scaled.osim": (
        "opencap-subject4-multitask/ik_manual_scaling/DJ1_ik.mot"
    ),
    "ceinms-emg-walk/model/gait2392.osim": "ceinms-emg-walk/walk36/ik.sto",
    "opensim-gait-subject01/ref_id/subject01.osim": (
        "opensim-gait-subject01/ref_id/subject01_walk1_ik.mot"
    ),
    "hamner-run-subject04/unscaled_generic.osim": "",
    "opensim-reference-small/arm26_bounds.osim": "",
    "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim": "",
    "c3d-functional-joints/models/wholebody.osim": "",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim": (
        "shoulder-thoracoscapular/ik/FLX01.mot"
    ),
}
QUASI_SPEEDS = "shoulder-thoracoscapular"


def poses(model, file):
    """Frames of a motion, or random poses inside the ranges."""
    tree = compile_paths(model).tree
    if file:
        motion = motion_from_table(read_sto(file), model)
        values = tree.coordinates_of(motion)[np.linspace(0, len(motion) - 1, FRAMES).astype(int)]
    else:
        rng = np.random.default_rng(2)
        values = np.tile(tree.defaults, (FRAMES, 1))
        for j, one in enumerate(model.coordinates):
            low, high = one.range if np.ptp(one.range) < 6.5 else (-0.5, 0.5)
            if not one.locked:
                values[:, j] = np.clip(
                    one.default + rng.uniform(-0.4, 0.4, FRAMES) * (high - low), low, high
                )
    return values


def moving_before_fixed(muscle):
    """Whether a moving point has a neighbour on its own body.

    OpenSim 4.6 leaves that neighbour out of the moment arm (its lengthening speed has it); ours has
    it.
    """
    points = muscle.path.points
    return any(
        MovingPathPoint in (type(a), type(b)) and a.body == b.body
        for a, b in itertools.pairwise(points)
    )


def opened(path, model):
    opensim.Logger.setLevelString("Off")
    theirs = opensim.Model(str(path))
    for k in range(theirs.getConstraintSet().getSize() if model.loops else 0):
        theirs.updConstraintSet().get(k).set_isEnforced(False)
    state = theirs.initSystem()
    for name in model.coordinate_names:
        theirs.getCoordinateSet().get(name).setLocked(state, False)
    return theirs, state


@pytest.mark.parametrize("name", CASES)
def test_lengths_and_moment_arms(name, data):
    model = read_model(data(name))
    paths = compile_paths(model)
    values = poses(model, data(CASES[name]) if CASES[name] else "")
    # Coupled coordinates are set as the model's couplers say, or OpenSim would be asked for another
    # pose.
    couple_frames(paths.tree.arrays, values)
    theirs, state = opened(data(name), model)
    lengths, _, arms = paths.evaluate(values)
    expected = opensim_lengths(theirs, state, model.muscle_names, model.coordinate_names, values)
    np.testing.assert_allclose(lengths, expected, atol=SAME)
    if name.startswith(QUASI_SPEEDS):
        # OpenSim's moment arms are about the speeds of the scapula, which are not rates of its
        # coordinates.
        return
    kept = [
        k
        for k, m in enumerate(paths.arm_muscle)
        if paths.arrays.arm[k, 1] == 1 and not moving_before_fixed(model.muscles[m])
    ]
    chosen = np.random.default_rng(1).permutation(kept)[:PAIRS]
    for frame in (0, FRAMES - 1):
        for j, value in enumerate(values[frame]):
            theirs.getCoordinateSet().get(model.coordinate_names[j]).setValue(
                state, float(value), False
            )
        theirs.realizePosition(state)
        for k in chosen:
            path = (
                theirs.getMuscles().get(model.muscle_names[paths.arm_muscle[k]]).getGeometryPath()
            )
            about = theirs.getCoordinateSet().get(model.coordinate_names[paths.arm_coordinate[k]])
            assert path.computeMomentArm(state, about) == pytest.approx(arms[frame, k], abs=SAME)


def test_lengths_of_520_muscles(data):
    path = data("fullbody-many-muscles/cyclistFullBodyMuscle.osim")
    model = read_model(path)
    values = poses(model, "")[:2]
    paths = compile_paths(model)
    theirs, state = opened(path, model)
    couple_frames(paths.tree.arrays, values)
    expected = opensim_lengths(theirs, state, model.muscle_names, model.coordinate_names, values)
    np.testing.assert_allclose(paths.evaluate(values)[0], expected, atol=SAME)

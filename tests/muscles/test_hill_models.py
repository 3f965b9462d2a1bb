"""Hill forces of whole models against what OpenSim's static optimization takes."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.muscles.hill import hill_forces

# Thelen's velocity curve is inverted by OpenSim to 1e-6, and the deprecated classes settle to 0.01
# N.
MODELS = {
    "rajagopal-walk-emg/subject_walk_scaled.osim": 1e-6,
    "walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim": 1e-6,
    "opensim-reference-small/arm26_bounds.osim": 1e-5,
    "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim": 1e-6,
    "c3d-functional-joints/models/scaled.osim": 1e-4,
    "shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim": 1e-6,
    "hamner-run-subject04/unscaled_generic.osim": 1e-5,
}


@pytest.mark.parametrize("name", MODELS)
def test_every_muscle_of_a_model_has_opensims_force(data, name):
    opensim = pytest.importorskip("opensim")
    path = data(name)
    opensim.Logger.setLevelString("Off")
    other = opensim.Model(str(path))
    state = other.initSystem()
    muscles = other.getMuscles()
    names = [muscles.get(i).getName() for i in range(muscles.getSize())]
    rng = np.random.default_rng(0)
    lengths, speeds, forces = np.empty((3, 3, len(names)))
    for pose in range(3):
        _move_at_random(other, state, rng)
        for i in range(len(names)):
            muscle = muscles.get(i)
            lengths[pose, i] = muscle.getLength(state)
            speeds[pose, i] = muscle.getLengtheningSpeed(state)
            forces[pose, i] = muscle.calcInextensibleTendonActiveFiberForce(state, 1.0)
    model = read_osim(path)
    assert list(model.muscle_names) == names
    ours = hill_forces(model, lengths, speeds, "opensim")
    scale = np.array([muscle.max_isometric_force for muscle in model.muscles])
    np.testing.assert_allclose(ours.active / scale, forces / scale, rtol=0, atol=MODELS[name])
    assert np.mean(forces / scale > 0.1) > 0.3


def _move_at_random(model, state, rng):
    """Put OpenSim's model into a pose inside its ranges, with random speeds."""
    import opensim

    for component in model.getComponentsList():
        one = opensim.Coordinate.safeDownCast(component)
        if one is not None and not one.isConstrained(state):
            low = one.getRangeMin()
            high = one.getRangeMax()
            inside = min(max(one.getDefaultValue(), low), high)
            one.setValue(state, inside + 0.25 * rng.uniform(low - inside, high - inside), False)
            one.setSpeedValue(state, rng.uniform(-1.0, 1.0))
    model.assemble(state)
    model.realizeVelocity(state)

"""On recordings: a calibrated model tracks motions better than an expert's model.

The model was not made from these motions.
"""

import numpy as np
import pytest

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.core.io.formats import read_model
from myomorph.core.io.trc import read_trc
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics

FOLDER = "opencap-subject4-multitask"


def test_held_out_motions_of_a_person(data):
    """Sit-to-stand and standing shown; walking and a jump not."""
    generic = read_model(data(f"{FOLDER}/models/unscaled_generic.osim"))
    expert = read_model(data(f"{FOLDER}/models/manually_scaled.osim"))
    recorded = {
        name: read_trc(data(f"{FOLDER}/markers/{name}.trc")).markers
        for name in ("STS1", "walking1", "DJ1")
    }
    static = read_trc(data(f"{FOLDER}/markers/static1.trc")).markers
    found = calibrate(generic, [recorded["STS1"]], CalibrationOptions(static=static, mass=62.6))
    assert found.converged
    assert len(found.frames[-1]) >= 1
    assert found.model.mass == pytest.approx(62.6)
    for name in ("walking1", "DJ1"):
        seen = set(recorded[name].names)
        common = [one for one in generic.marker_names if one in seen and one in expert.marker_names]
        options = InverseKinematicsOptions(
            marker_weights=dict.fromkeys(common, 1.0), only_weighted=True
        )
        error = [
            np.sqrt(
                np.nanmean(inverse_kinematics(model, recorded[name], options).marker_error ** 2)
            )
            for model in (found.model, expert)
        ]
        assert error[0] < error[1]
    thighs = [one.value for one in found.lengths if one.length.name in ("femur_r_y", "femur_l_y")]
    assert thighs[0] == pytest.approx(thighs[1], rel=0.03)
    assert all(0.8 < one.factor < 1.3 for one in found.lengths if one.length.along)

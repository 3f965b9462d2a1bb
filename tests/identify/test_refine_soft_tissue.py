"""Refinement of markers that move more than the mass.

Alphas and the motion of the mass are found; none is found where there is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.refine import fit
from myomorph.body.refine.fit import refine
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.refinement import Errors, Prediction
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Marker
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.regressor import base_regressor, reference_points
from truths.simulated_bodies import TETRAHEDRON
from truths.small_person import person

ALPHA = 4e-4
CUTOFF = 8.0


@pytest.fixture(scope="module")
def truth():
    """Make a person whose model has other masses than its own, its motion and plate's wrench."""
    model = model_from_mujoco(person(), name="person")
    markers = [
        Marker(f"{body.name}_{i}", body.name, body.mass_center + 0.06 * offset)
        for body in model.bodies
        for i, offset in enumerate(TETRAHEDRON)
    ]
    model = model.with_markers(tuple(markers))
    random = np.random.default_rng(3)
    time = np.arange(0.0, 3.0, 0.01)
    values = np.tile(
        [0.8 * name.endswith("flexion") for name in model.coordinate_names], (len(time), 1)
    )
    for column, coordinate in enumerate(model.coordinates):
        size = 0.04 if coordinate.motion == "translational" else 0.2
        for frequency in random.uniform(0.4, 3.5, 4):
            values[:, column] += (
                0.5 * size * np.sin(2.0 * np.pi * (frequency * time + random.uniform()))
            )
    motion = differentiate(Motion(time, model.coordinate_names, values))
    masses = inertial_parameters(model) * random.uniform(0.85, 1.15, (len(model.bodies), 1))
    masses *= model.mass / masses[:, 0].sum()
    wrench = base_regressor(model, motion) @ masses.ravel()
    wrenches = Wrenches(
        time=time,
        names=("plate",),
        bodies=(model.body_names[0],),
        forces=wrench[:, None, 3:],
        points=reference_points(model, motion)[:, None],
        torques=wrench[:, None, :3],
    )
    return model, motion, wrenches, masses


def refined(truth, alpha, use="auto", check=True):
    model, motion, wrenches, _ = truth
    seen = replace(motion, values=motion.values - alpha * motion.accelerations)
    options = RefineOptions(cutoff=CUTOFF, fit=("masses",), check=check, soft_tissue=use)
    return refine(
        model, [SubjectTrial("swing", marker_positions(model, seen), wrenches)], options=options
    )


def errors(found, truth):
    """Root mean squares of rotation [rad] and of the masses of its links [kg]."""
    _, motion, _, masses = truth
    trial = found.trials[0].motion
    inside = slice(50, -50)
    off = trial.values[inside, 6:] - motion.values[np.isin(motion.time, trial.time)][inside, 6:]
    return np.sqrt(np.mean(off**2)), np.sqrt(np.mean((found.parameters - masses)[:, 0] ** 2))


def test_the_motion_of_the_mass_is_found(truth):
    soft = refined(truth, ALPHA)
    rigid = refined(truth, ALPHA, "never")
    assert rigid.soft_tissue is None
    np.testing.assert_allclose(soft.soft_tissue.alpha, ALPHA, rtol=0.15)
    for better, worse in zip(errors(soft, truth), errors(rigid, truth), strict=True):
        assert better < 0.2 * worse
    assert soft.after.markers < rigid.after.markers
    # The same without a check, where it is wanted in any case.
    np.testing.assert_allclose(
        refined(truth, ALPHA, "always", check=False).soft_tissue.alpha, soft.soft_tissue.alpha
    )


def test_none_is_found_where_markers_move_as_the_mass(truth):
    assert refined(truth, 0.0).soft_tissue is None
    # Nothing says that there is any where no part is predicted.
    assert refined(truth, ALPHA, check=False).soft_tissue is None


def test_what_predicts_no_better_is_not_taken(truth, monkeypatch):
    """`identify` has soft tissue of this recording; predictions of `refine` decide."""
    tried = []

    def predictions(model, recorded, options, progress):
        tried.append(options.soft_tissue)
        given = Errors(0.006, 20.0, 10.0)
        gain = 0.96 if options.soft_tissue == "always" else 1.0
        return (
            Prediction(
                name="a",
                given=given,
                refined=Errors(0.006, 20.0 * gain, 10.0 * gain),
                markers_alone=0.006,
            ),
        )

    monkeypatch.setattr(fit, "predictions_of", predictions)
    assert refined(truth, ALPHA).soft_tissue is None
    assert tried == ["never", "always"]


def test_other_words_are_refused():
    with pytest.raises(BadData, match="soft_tissue is 'sometimes'"):
        RefineOptions(soft_tissue="sometimes")

"""A new muscle model is one file (`winters_muscle.py`) and one line in the table of classes.

All else follows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.personalize.muscle_curves import muscle_shapes
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadModel
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.hill import MODELS, activation_times, hill_forces
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions

KIND = "Winters1995Muscle"


@pytest.fixture
def arm(data, monkeypatch):
    """Return OpenSim's arm with muscles of the new class, its motion and torques.

    The first line registers the class.
    """
    monkeypatch.setitem(MODELS, KIND, "tests.muscles.winters_muscle:Winters1995")
    model = read_osim(data("opensim-reference-small/arm26_bounds.osim"))
    muscles = (replace(muscle, kind=KIND, parameters={"width": 0.5}) for muscle in model.muscles)
    model = replace(model, muscles=tuple(muscles))
    table = read_sto(data("opensim-reference-small/arm26_InverseKinematics.mot"))
    whole = differentiate(motion_from_table(table, model), 6.0)
    keep = slice(0, 80, 2)
    motion = Motion(
        time=whole.time[keep],
        names=whole.names,
        values=whole.values[keep],
        velocities=whole.velocities[keep],
        accelerations=whole.accelerations[keep],
    )
    return model, motion, inverse_dynamics(model, motion)


def test_forces_on_rigid_tendons_follow_its_formulas(arm):
    model, motion, _ = arm
    paths = muscle_kinematics(model, motion)
    for convention in ("rigid-tendon", "opensim"):
        forces = hill_forces(model, paths.muscle_length, paths.muscle_velocity, convention)
        for m, muscle in enumerate(model.muscles):
            height = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
            along = paths.muscle_length[:, m] - muscle.tendon_slack_length
            x = np.hypot(along, height) / muscle.optimal_fiber_length
            cosine = along / np.hypot(along, height)
            v = (
                paths.muscle_velocity[:, m]
                * cosine
                / muscle.optimal_fiber_length
                / muscle.max_contraction_velocity
            )
            k = (1.0 + 1.0 / 0.3) / 0.4
            factor = np.where(
                v < 0.0, (1.0 + v) / (1.0 - v / 0.3), (1.0 + 1.4 * k * v) / (1.0 + k * v)
            )
            active = (
                muscle.max_isometric_force * np.exp(-(((x - 1.0) / 0.5) ** 2)) * factor * cosine
            )
            passive = np.maximum(np.expm1(4.0 * (x - 1.0) / 0.6) / np.expm1(4.0), 0.0) * cosine
            assert along.min() > 0.0
            np.testing.assert_allclose(forces.active[:, m], active, rtol=1e-12)
            np.testing.assert_allclose(
                forces.passive[:, m], muscle.max_isometric_force * passive, atol=1e-9
            )


def test_tensions_are_found_with_rigid_tendons_and_with_elastic_ones(arm):
    model, motion, torques = arm
    rigid = solve_tension(model, motion, torques, TensionOptions(curves="rigid-tendon"))
    forces = hill_forces(
        model,
        *(lambda paths: (paths.muscle_length, paths.muscle_velocity))(
            muscle_kinematics(model, motion)
        ),
    )
    assert rigid.optimal.all()
    np.testing.assert_allclose(rigid.muscle_force, rigid.activation * forces.active, atol=1e-6)
    elastic = solve_tension(model, motion, torques, TensionOptions(tendons="elastic", passive=True))
    assert elastic.optimal.all()
    assert elastic.fibers.certificate.residual < 1e-3
    assert elastic.fibers.certificate.equilibrium < 1e-5
    assert not elastic.fibers.rigid
    strength = np.array([muscle.max_isometric_force for muscle in model.muscles])
    strain = 0.05 / 3.0 * np.log(1.0 + np.expm1(3.0) * elastic.muscle_force / strength)
    np.testing.assert_allclose(elastic.fibers.tendon_strain, strain, atol=1e-9)
    np.testing.assert_array_equal(activation_times(model)[:, 0], [0.020, 0.050])


def test_its_curves_are_personalized(arm):
    shapes = muscle_shapes(arm[0])
    assert not shapes.rigid.any()
    np.testing.assert_array_equal(shapes.damping, 0.05)
    strain = np.full((1, 6), 0.03)
    value, slope = shapes.tendon(strain)
    np.testing.assert_allclose(value, np.expm1(3.0 * 0.03 / 0.05) / np.expm1(3.0), rtol=1e-6)
    np.testing.assert_allclose(slope, 60.0 * np.exp(3.0 * 0.03 / 0.05) / np.expm1(3.0), rtol=1e-3)


def test_without_its_line_it_is_refused_with_the_classes_that_exist(arm, monkeypatch):
    monkeypatch.delitem(MODELS, KIND)
    model = replace(arm[0], name="again")
    with pytest.raises(BadModel, match=f"{KIND}.*Thelen2003Muscle"):
        hill_forces(model, np.ones((1, 6)), np.zeros((1, 6)))

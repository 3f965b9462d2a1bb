"""Passive force of fibers on elastic tendons: it takes part, counted as OpenSim counts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions

opensim = pytest.importorskip("opensim")

ARM = "opensim-reference-small/"
STRETCHED = 0.9
"""Slack lengths of tendons by those of the model, so that fibers are long."""


def opensim_passive(muscle, fibers):
    """Passive force along the tendon (frames,) [N] of OpenSim's muscle at fiber lengths [m]."""
    model = opensim.Model()
    body = opensim.Body("body", 1.0, opensim.Vec3(0.0), opensim.Inertia(1.0))
    model.addBody(body)
    joint = opensim.SliderJoint("slider", model.getGround(), body)
    model.addJoint(joint)
    own = getattr(opensim, muscle.kind)(
        muscle.name,
        muscle.max_isometric_force,
        muscle.optimal_fiber_length,
        muscle.tendon_slack_length,
        muscle.pennation_at_optimal,
    )
    own.addNewPathPoint("origin", model.getGround(), opensim.Vec3(0.0))
    own.addNewPathPoint("insertion", body, opensim.Vec3(0.0))
    model.addForce(own)
    state = model.initSystem()
    found = []
    for fiber in fibers:
        height = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
        along = np.sqrt(fiber**2 - height**2)
        joint.getCoordinate(0).setValue(state, float(along + muscle.tendon_slack_length), False)
        model.setStateVariableValue(state, f"/forceset/{muscle.name}/fiber_length", float(fiber))
        model.realizeDynamics(state)
        # Of Millard's class the other has the fibers' damping too.
        name = "getPassiveFiberElasticForceAlongTendon"
        read = getattr(own, name, own.getPassiveFiberForceAlongTendon)
        found.append(read(state))
    return np.array(found)


@pytest.mark.parametrize("kind", ["Millard2012EquilibriumMuscle", "Thelen2003Muscle"])
def test_passive_force_is_that_of_opensims_fibers(data, kind):
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    muscles = tuple(
        replace(
            muscle,
            kind=kind,
            parameters={},
            tendon_slack_length=STRETCHED * muscle.tendon_slack_length,
        )
        for muscle in model.muscles
    )
    model = replace(model, muscles=muscles)
    whole = differentiate(
        motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model), 6.0
    )
    motion = whole.frames(slice(0, 60, 2))
    torques = inverse_dynamics(model, motion)
    found = solve_tension(model, motion, torques, TensionOptions(tendons="elastic"))
    fibers = found.fibers
    assert fibers is not None
    assert not fibers.rigid
    assert found.muscle_passive_share.max() > 0.05
    for m, muscle in enumerate(model.muscles):
        theirs = opensim_passive(muscle, fibers.fiber_length[:, m]) / muscle.max_isometric_force
        # Corners of Thelen's curve are rounded for the solver.
        assert found.muscle_passive_share[m] == pytest.approx(theirs.max(), abs=2e-3)
        assert (
            found.muscle_passive_time[m] == pytest.approx(motion.time[np.argmax(theirs)], abs=0.05)
            or theirs.max() < 1e-3
        )
    without = solve_tension(
        model, motion, torques, TensionOptions(tendons="elastic", passive=False)
    )
    assert not without.muscle_passive_share.any()
    assert np.abs(without.activation - found.activation).max() > 0.01


def test_muscles_on_rigid_tendons_keep_it_out_by_default(data):
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    whole = differentiate(
        motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model), 6.0
    )
    motion = whole.frames(slice(0, 20, 2))
    found = solve_tension(model, motion, inverse_dynamics(model, motion))
    assert not found.options.has_passive
    assert not found.muscle_passive_share.any()

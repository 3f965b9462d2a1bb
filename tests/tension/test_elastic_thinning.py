"""Elastic tendons of fast recordings.

Some frames are solved, those between follow and balance their torques.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.elastic.windows import MAX_RATE, along, picked, solved_every
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions

ARM = "opensim-reference-small/"
ELASTIC = TensionOptions(tendons="elastic")


def fast_arm(data, rate: float) -> tuple[Model, Motion, Series]:
    """0.3 s of OpenSim's arm at a rate [1/s], on the cubics through its filtered motion."""
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    whole = differentiate(
        motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model), 6.0
    )
    q = CubicSpline(whole.time, whole.values)
    time = whole.time[0] + np.arange(round(0.3 * rate) + 1) / rate
    motion = Motion(
        time=time,
        names=whole.names,
        values=q(time),
        velocities=q(time, 1),
        accelerations=q(time, 2),
    )
    return model, motion, inverse_dynamics(model, motion)


@pytest.mark.parametrize(
    ("rate", "every"),
    [(50.0, 1), (100.0, 1), (MAX_RATE, 1), (240.0, 2), (400.0, 2), (1000.0, 5), (1200.0, 6)],
)
def test_no_more_frames_a_second_are_solved_than_said(rate, every):
    assert solved_every(np.arange(1000) / rate) == every


@pytest.mark.parametrize("frames", [2, 3, 11, 100, 257])
@pytest.mark.parametrize("every", [1, 2, 5, 7])
def test_solved_frames_have_both_ends_and_steps_alike(frames, every):
    keep = picked(frames, every)
    assert keep[0] == 0
    assert keep[-1] == frames - 1
    steps = np.diff(keep)
    assert steps.max() <= every
    assert steps.max() - steps.min() <= 1


def test_curves_between_stay_in_their_range():
    time = np.linspace(0.0, 1.0, 101)
    keep = np.arange(0, 101, 5)
    values = (time[keep, None] > 0.5).astype(float)
    found = along(time, keep, values)
    assert np.array_equal(found[keep], values)
    assert found.min() >= 0.0
    assert found.max() <= 1.0


def test_a_fast_recording_balances_everywhere_and_is_as_a_slower_one(data):
    model, motion, torques = fast_arm(data, 1000.0)
    fast = solve_tension(model, motion, torques, ELASTIC)
    slow = solve_tension(*fast_arm(data, MAX_RATE), ELASTIC)
    assert fast.optimal.all()
    assert slow.optimal.all()
    assert fast.equilibrium_residual.max() < 1e-3
    assert fast.fibers.certificate.residual < 1e-3
    strength = np.array([one.max_isometric_force for one in model.muscles])
    inside = ~slow.fibers.transient
    assert np.abs((fast.muscle_force[::5] - slow.muscle_force)[inside] / strength).max() < 1e-3
    assert np.abs((fast.activation[::5] - slow.activation)[inside]).max() < 1e-3
    # Between solved frames nothing jumps: forces of neighbors differ no more than those of the
    # slower recording.
    assert (
        np.abs(np.diff(fast.muscle_force, axis=0)).max()
        < 1.5 * np.abs(np.diff(slow.muscle_force, axis=0)).max()
    )

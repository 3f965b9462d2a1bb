"""Sequential identification: equal to the batch, frame by frame, with what it reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_base import other_body, recorded, simulated

from myomorph.body.identify.base import BaseOptions, fit_base
from myomorph.body.identify.base_parameters import base_parameters
from myomorph.body.identify.least_squares import Recording
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.regressor import base_regressor, base_wrench
from myomorph.live.sequential import SequentialFit
from trees import floating_tree

SIGMA = (2.0, 2.0, 2.0, 5.0, 5.0, 5.0)
OPTIONS = BaseOptions(moment_noise=2.0, force_noise=5.0, correlated=False, motion_sd=0.0)


def run(fit, model, given):
    rows = base_regressor(model, given.motion)
    wrench = base_wrench(model, given.motion, given.wrenches)
    return np.array([fit.update(rows[i], wrench[i]) for i in range(len(rows))])


def walk(data):
    """Read a walk; some joints of its model do not move at all."""
    folder = data("opensim-gait-subject01/ref_id/subject01.osim").parent
    return (
        folder / "subject01.osim",
        folder / "subject01_walk1_ik.mot",
        folder / "subject01_walk1_grf.xml",
    )


def jump(data):
    folder = data("opencap-subject4-multitask/models/manually_scaled.osim").parents[1]
    trial = folder / "ik_manual_scaling" / "DJ1_ik.mot", folder / "grf" / "DJ1_external_forces.xml"
    return folder / "models" / "manually_scaled.osim", *trial


@pytest.mark.parametrize("files", [walk, jump])
def test_equals_the_batch_on_real_data(data, files):
    """Estimate, standard deviations, rank, condition number and information agree.

    They are compared after a walk, and after a jump.
    """
    model_file, motion_file, loads = files(data)
    model = read_model(model_file)
    motion = differentiate(motion_from_table(read_sto(motion_file), model), 6.0)
    given = Recording(motion, resample_wrenches(read_external_loads(loads), motion.time, 6.0))
    batch = fit_base(model, [given], options=OPTIONS)
    fit = SequentialFit(model, batch.base, SIGMA)
    run(fit, model, given)
    state = fit.state()
    assert state.frames == batch.frames
    np.testing.assert_allclose(
        state.estimate, batch.estimate, rtol=0, atol=1e-8 * np.abs(batch.estimate).max()
    )
    scale = np.maximum(np.abs(batch.estimate), batch.size)
    assert (np.abs(state.estimate - batch.estimate) / scale).max() < 1e-8
    np.testing.assert_allclose(state.sd, batch.sd, rtol=1e-8)
    assert state.rank == batch.rank
    assert state.condition == pytest.approx(batch.condition, rel=1e-6)
    A, b = fit.rows()
    B, c = batch.rows()
    np.testing.assert_allclose(A.T @ A, B.T @ B, atol=1e-10 * np.abs(B.T @ B).max())
    np.testing.assert_allclose(A.T @ b, B.T @ c, atol=1e-10 * np.abs(B.T @ c).max())


@pytest.fixture(scope="module")
def arm():
    return floating_tree(4, 8)


def test_truth_is_recovered_and_predicted(arm):
    truth = other_body(arm)
    fit = SequentialFit(arm, sigma=0.5)
    errors = run(fit, arm, recorded(arm, simulated(arm, 1500), truth, noise=0.5))
    state = fit.state()
    assert np.mean(np.abs(state.estimate - fit.base.of(truth)) < 3.0 * state.sd) > 0.95
    # In the end nothing but the noise is left; before there was the wrong body.
    assert np.sqrt(np.mean(errors[-200:] ** 2)) < 0.75
    assert np.sqrt(np.mean(errors[:2] ** 2)) > 3.0
    np.testing.assert_allclose(
        state.innovation_rms, np.sqrt(np.mean(errors[-200:] ** 2, axis=0)), rtol=0.3
    )
    np.testing.assert_allclose(state.expected_rms, 0.5, rtol=0.2)
    assert state.progress > 0.9


def test_what_is_known_only_grows(arm):
    fit = SequentialFit(arm, sigma=0.5)
    nothing = fit.state()
    np.testing.assert_allclose(nothing.levels, 0.0, atol=1e-9)
    np.testing.assert_allclose(nothing.estimate, fit.base.of(inertial_parameters(arm)))
    assert nothing.rank == 0
    assert (nothing.expected_rms == 0.5).all()
    given = recorded(arm, simulated(arm, 60), other_body(arm), noise=0.5)
    rows = base_regressor(arm, given.motion)
    wrench = base_wrench(arm, given.motion, given.wrenches)
    before = nothing
    for i in range(0, 60, 10):
        for k in range(i, i + 10):
            fit.update(rows[k], wrench[k])
        after = fit.state()
        assert (after.levels >= before.levels - 1e-9).all()
        assert (after.sd <= before.sd * (1.0 + 1e-9)).all()
        before = after


def test_forgetting_follows_a_body_that_changes(arm):
    """The first body picks up 5 kg: with forgetting the estimate follows, without it lags."""
    before = inertial_parameters(arm)
    after = before.copy()
    after[0, 0] += 5.0
    motions = simulated(arm, 1500), simulated(arm, 600, seed=1)
    found = {}
    for forgetting in (1.0, 0.99):
        fit = SequentialFit(arm, sigma=0.5, forgetting=forgetting)
        for motion, truth in zip(motions, (before, after), strict=True):
            run(fit, arm, recorded(arm, motion, truth, noise=0.5))
        found[forgetting] = fit.state().estimate[0]
    truth = fit.base.of(after)[0]
    assert abs(found[0.99] - truth) < 0.2
    assert abs(found[1.0] - truth) > 1.0


def test_forgetting_weighs_frames_by_their_age(arm):
    """With factor 0.98 the information is that of frames with noise grown by 0.98^(-T/2)."""
    given = recorded(arm, simulated(arm, 50), other_body(arm), noise=0.5)
    rows = base_regressor(arm, given.motion)
    wrench = base_wrench(arm, given.motion, given.wrenches)
    fit = SequentialFit(arm, sigma=0.5, forgetting=0.98)
    run(fit, arm, given)
    A, b = fit.rows()
    weight = 0.98 ** np.arange(49, -1, -1.0)
    own = rows[:, :, fit.base.columns] / 0.5
    information = np.einsum("f,fri,frj->ij", weight, own, own)
    R = A[:, fit.base.columns]
    np.testing.assert_allclose(R.T @ R, information, atol=1e-10 * information.max())
    np.testing.assert_allclose(
        R.T @ b, np.einsum("f,fri,fr->i", weight, own, wrench / 0.5), rtol=1e-7, atol=1e-6
    )


def test_a_movement_that_is_proposed_shows_more_than_the_others(arm):
    """All but one joint have moved, and that one is proposed.

    Its body has the largest uncertainty, and moving it helps most.
    """
    still = arm.joints[-1].coordinates[0]
    fit = SequentialFit(arm, sigma=0.5)
    run(fit, arm, recorded(arm, simulated(arm, 800, hold={still: 0.0}), other_body(arm), noise=0.5))
    first = fit.propose()[0]
    assert first.coordinate == still
    assert first.body == arm.joints[-1].child
    before = fit.state()
    run(fit, arm, recorded(arm, simulated(arm, 200, seed=3), other_body(arm), noise=0.5))
    assert fit.state().link_levels[first.body] > before.link_levels[first.body]
    assert fit.propose()[0].gain < first.gain


def test_bodies_without_parameters_of_their_own_have_their_parents_level(data):
    model = read_model(data("hamner-run-subject04/unscaled_generic.osim"))
    fit = SequentialFit(model)
    state = fit.state()
    assert set(state.link_levels) == set(model.body_names)
    assert state.link_levels["toes_r"] == state.link_levels["calcn_r"]
    assert state.least in model.body_names


def test_frames_with_something_missing_are_left_out(arm):
    given = recorded(arm, simulated(arm, 10), noise=0.5)
    rows = base_regressor(arm, given.motion)
    wrench = base_wrench(arm, given.motion, given.wrenches)
    wrench[3] = np.nan
    rows[5] = np.nan
    fit = SequentialFit(arm, sigma=0.5)
    errors = np.array([fit.update(rows[i], wrench[i]) for i in range(10)])
    assert np.flatnonzero(np.isnan(errors).any(axis=1)).tolist() == [3, 5]
    assert (fit.frames, fit.left_out) == (8, 2)
    assert np.isfinite(fit.state().estimate).all()


def test_bad_settings_are_named(arm):
    with pytest.raises(BadData, match="noise"):
        SequentialFit(arm, sigma=0.0)
    with pytest.raises(BadData, match="forgetting"):
        SequentialFit(arm, forgetting=1.5)
    other = replace(
        arm,
        bodies=tuple(replace(body, name=f"other_{body.name}") for body in arm.bodies),
        joints=tuple(
            replace(
                j,
                child=f"other_{j.child}",
                parent=j.parent if j.parent == "ground" else f"other_{j.parent}",
            )
            for j in arm.joints
        ),
    )
    with pytest.raises(BadData, match="another model"):
        SequentialFit(arm, base_parameters(other))

"""Muscles fitted to simulated people.

Parameters are recovered within their intervals, and what is not identifiable is reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.tension.personalize import ARM, CAREFUL, passive_trial

from myomorph.body.personalize.fibers import MuscleSizes
from myomorph.body.personalize.fit import fit
from myomorph.body.personalize.generic_map import map_generic
from myomorph.body.personalize.held_out import held_out, split
from myomorph.body.personalize.muscle_curves import muscle_shapes
from myomorph.body.personalize.muscle_problem import MuscleProblem, as_fit, muscle_unknowns
from myomorph.body.personalize.personalize import PersonalizeOptions, personalize
from myomorph.body.personalize.prior import PriorOptions, prior_of, sizes_of, with_sizes
from myomorph.body.personalize.recording_at import Noise, recording_at, with_slopes
from myomorph.body.personalize.recordings import PersonalTrial, torque_floors, windows_of
from myomorph.core.fit.residuals import Rows
from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.series import Series
from truths.simulated_muscles import (
    Laboratory,
    Performance,
    Spread,
    as_degroote,
    person,
    recorded,
    smooth_activations,
    some_gains,
    swings,
)

NOISE = Noise(torque=np.ones(2), rest=np.ones(2))
FIBER = "optimal_fiber_length"
SLACK = "tendon_slack_length"


@pytest.fixture(scope="module")
def arm26(data):
    return as_degroote(read_model(data("opensim-reference-small/arm26_bounds.osim")))


@pytest.fixture(scope="module")
def someone(arm26):
    """Make a person, and three recordings of 4 s with good EMG, and passive torques."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 4.0, 0.01)
    motions = [swings(arm26, ARM, time, rng) for _ in range(3)]
    own = person(arm26, motions, Spread(), rng, np.array([0, 0, 0, 1, 1, 1]))
    gains = some_gains(arm26, CAREFUL, rng)
    laboratory = Laboratory(errors=CAREFUL, gains=gains, rng=rng)
    trials = [
        recorded(
            arm26,
            own,
            Performance(
                name=f"swing {k}", motion=motion, activations=smooth_activations(time, 6, rng)
            ),
            laboratory,
        )
        for k, motion in enumerate(motions)
    ]
    return own, [*trials, passive_trial(arm26, own, ARM, rng)]


def problem_of(model, trials):
    windows, rows = windows_of(model, trials)
    return MuscleProblem(
        prior=prior_of(model, windows, rows, PriorOptions(), np.zeros(6, bool)),
        shapes=muscle_shapes(model),
        windows=tuple(windows),
        floors=torque_floors(model, rows, windows),
    )


@pytest.fixture(scope="module")
def found(arm26, someone):
    return personalize(arm26, someone[1], PersonalizeOptions(gain_spread=0.06, keep_generic=False))


def lengths(found, model, own):
    """Estimates of lengths with the true values."""
    for one in found.estimates:
        if one.parameter in (FIBER, SLACK):
            yield one, getattr(own.muscles[model.muscle_names.index(one.of)], one.parameter)


def test_lengths_lie_within_their_intervals(arm26, someone, found):
    inside = [one.low <= true <= one.high for one, true in lengths(found, arm26, someone[0])]
    assert np.mean(inside) >= 0.75  # of twelve, where 90 % are expected


def test_what_is_identifiable_is_found(arm26, someone, found):
    known = [
        (one, true) for one, true in lengths(found, arm26, someone[0]) if one.identifiable != "no"
    ]
    assert len(known) >= 4
    before = np.mean([abs(one.generic / true - 1.0) for one, true in known])
    after = np.mean([abs(one.person / true - 1.0) for one, true in known])
    assert after < 0.7 * before
    for one in found.estimates:
        if one.identifiable == "yes":
            assert one.variance_ratio <= 0.25


def test_the_person_explains_a_recording_that_was_held_out(found):
    checked = found.held_out
    assert checked.recordings == ("swing 2",)
    assert checked.score < checked.score_generic
    assert np.all(checked.left < 1.05 * checked.left_generic)


def test_a_muscle_without_information_keeps_its_prior(arm26, someone):
    """A trial without torques of note and EMG: nothing is identifiable, nothing moves far."""
    trial = someone[1][0]
    weak = replace(trial.torques, values=0.0 * trial.torques.values)
    still = replace(
        trial.motion,
        velocities=0.0 * trial.motion.velocities,
        values=0.0 * trial.motion.values + 0.5,
    )
    silent = PersonalTrial("still", still, weak)
    quiet = personalize(arm26, [silent], PersonalizeOptions(hold_out=False))
    of_lengths = [one for one in quiet.estimates if one.parameter in (FIBER, SLACK)]
    assert sum(one.identifiable == "yes" for one in of_lengths) == 0
    assert any("no EMG" in note for note in quiet.notes)
    assert "hardly determine 100 % of the lengths" in quiet.notes[0]
    assert "of 6 tendon slack lengths they identify 0" in quiet.notes[0]


def test_generic_values_are_kept_where_they_explain_more(arm26, someone):
    """Fitted parameters of one group are replaced by wrong ones.

    On held-out recordings its generic values are better and stay.
    """
    problem = problem_of(arm26, someone[1][:2])
    prior = problem.prior
    parts = split(problem.windows)
    seen = problem.of(parts.seen)
    fitted = fit(seen)
    g = prior.groups.index("elbow_flex +")
    wrong = fitted.p.copy()
    wrong[prior.parts.points.start + np.flatnonzero(prior.group == g)] -= 0.35
    wrong[prior.parts.strength.start + g] = -1.0
    fitted = replace(fitted, posterior=replace(fitted.posterior, x=wrong))
    checked, p = held_out(seen, parts.unseen, fitted)
    assert "elbow_flex +" in checked.kept
    assert p[prior.parts.strength.start + g] == 0.0
    told, same = held_out(seen, parts.unseen, fitted, keep=False)
    assert "elbow_flex +" in told.kept
    np.testing.assert_array_equal(same, wrong)


def test_a_generic_model_alone_maps_its_operating_ranges(arm26):
    """A model whose muscles were all lengthened by a wrong scaling.

    It comes back to those of the generic model.
    """
    spoiled = replace(
        arm26,
        muscles=tuple(
            replace(
                one,
                optimal_fiber_length=0.9 * one.optimal_fiber_length,
                tendon_slack_length=1.03 * one.tendon_slack_length,
            )
            for one in arm26.muscles
        ),
    )
    mapped = map_generic(arm26, spoiled)
    for one, true in zip(mapped.model.muscles, arm26.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(true.optimal_fiber_length, rel=1e-4)
        assert one.tendon_slack_length == pytest.approx(true.tendon_slack_length, rel=1e-4)
    assert mapped.after.max() < 1e-4 < mapped.before.max()
    again = personalize(spoiled, generic=arm26)
    assert [one.optimal_fiber_length for one in again.model.muscles] == [
        one.optimal_fiber_length for one in mapped.model.muscles
    ]


def test_the_range_of_fibers_that_is_assumed_makes_no_interval_narrower(
    arm26, someone, monkeypatch
):
    """At the same parameters; while it pulls the muscles, recordings say as much as without it."""
    problem = problem_of(arm26, someone[1][:1])
    plain = fit(problem, steps=1)
    pull = Rows(residuals=np.full(12, -5.0), slopes=50.0 * np.eye(len(plain.p))[:12])
    monkeypatch.setattr(
        "myomorph.body.personalize.muscle_problem._fiber_range_rows", lambda *_: pull
    )
    pulled = fit(problem, steps=1)
    assert np.abs(pulled.p - plain.p).max() > 0.05
    np.testing.assert_allclose(pulled.covariance, plain.covariance, rtol=1e-9)


def test_the_estimate_certifies_itself(found):
    estimate = found.estimate
    assert estimate.search.converged
    assert estimate.verdict.better
    assert estimate.verdict.parts == ("swing 2",)
    lines = "\n".join(estimate.certificate)
    assert "torques of swing 0" in lines
    assert "predicts swing 2 better than the generic values: torque left" in lines
    # An unknown is found by its name.
    gain = estimate.posterior.interval("TRIlong log gain")
    assert gain.low < gain.value < gain.high


def test_any_subset_of_the_parameters_is_fitted(arm26, someone):
    options = PersonalizeOptions(fit=("strength", "gains"), hold_out=False)
    some = personalize(arm26, someone[1][:1], options)
    values = some.estimate.values
    assert not values["fibers"].any()
    assert not values["points"].any()
    assert not values["passive"].any()
    assert values["strength"].all()
    for one in some.estimates:
        if one.parameter in (FIBER, SLACK):
            assert one.person == pytest.approx(one.generic, rel=1e-12)
            assert np.isnan(one.low)
    with pytest.raises(UnknownName, match="tendons"):
        PersonalizeOptions(fit=("tendons",))
    with pytest.raises(BadData, match="nothing to fit"):
        PersonalizeOptions(fit=())


def test_every_muscle_keeps_a_tendon(arm26, someone):
    """Operating points are limited by how long the fibers are."""
    prior = problem_of(arm26, someone[1][:1]).prior
    unknowns = muscle_unknowns(prior)
    far = np.zeros(len(unknowns))
    far[prior.parts.fibers] = 5.0
    far[prior.parts.points] = 5.0
    within = unknowns.within(far)
    sizes = prior.sizes(within)
    bound = within[prior.parts.points] == -prior.bound[prior.parts.points]
    assert np.all((sizes.slack >= 0.3 * prior.start.slack - 1e-12) | bound)
    assert np.any(within[prior.parts.points] < prior.bound[prior.parts.points])


def test_nothing_to_fit_to_is_refused(arm26):
    with pytest.raises(BadData, match="nothing to fit muscles to"):
        personalize(arm26)
    other = replace(
        arm26, muscles=tuple(replace(one, name=f"x{one.name}") for one in arm26.muscles)
    )
    with pytest.raises(BadModel, match="no muscle of the generic model"):
        map_generic(other, arm26)
    with pytest.raises(BadData, match="expected 0 to 1"):
        PersonalizeOptions(fiber_spread=2.0)


def test_passive_torques_of_one_joint_at_a_time_are_enough(arm26, someone):
    """Each pose has the torque of one joint only.

    Those left out give the same as if they were of another recording.
    """
    own, (*_, passive) = someone
    values = np.array(passive.torques.values)
    halves = []
    for k, name in enumerate(("r_elbow_flex", "r_shoulder_elev")):
        j = passive.torques.names.index(name)
        column = np.where(np.arange(len(values)) % 2 == k, values[:, j], np.nan)
        halves.append(
            replace(
                passive, name=name, torques=Series(passive.motion.time, (name,), column[:, None])
            )
        )
    both = np.column_stack([one.torques.values for one in halves])
    names = tuple(one.name for one in halves)
    together = replace(passive, torques=Series(passive.motion.time, names, both))
    options = PersonalizeOptions(hold_out=False)
    one = personalize(arm26, [together], options)
    two = personalize(arm26, halves, options)
    # Errors of neighbouring poses are looked for recording by recording, so that weights differ a
    # little.
    apart = one.estimate.posterior.x - two.estimate.posterior.x
    assert np.all(np.abs(apart) < 0.3 * one.estimate.posterior.sd)
    fitted = [est for est in one.estimates if est.parameter == SLACK and est.identifiable != "no"]
    assert fitted
    for est in fitted:
        assert (
            est.low <= own.muscles[arm26.muscle_names.index(est.of)].tendon_slack_length <= est.high
        )
    with pytest.raises(BadData, match="no column is the torque of a coordinate"):
        personalize(
            arm26, [replace(passive, torques=Series(passive.motion.time, ("x",), values[:, :1]))]
        )


def test_muscles_that_cannot_reach_are_named(arm26, someone):
    long = replace(arm26.muscles[0], tendon_slack_length=arm26.muscles[0].tendon_slack_length + 0.3)
    model = replace(arm26, muscles=(long, *arm26.muscles[1:]))
    found = personalize(model, someone[1][:1], PersonalizeOptions(hold_out=False))
    assert f"'{long.name}' cannot reach" in found.notes[0]
    assert "shorter than its slack tendon" in found.notes[0]
    assert "swing 0" in found.notes[0]


def test_written_models_have_the_person_s_muscles(data, tmp_path):
    """Of Millard's and Thelen's class too.

    Compared are lengths, strength, and the passive curve stretched by its factor.
    """
    for name in (
        "rajagopal-walk-emg/subject_walk_scaled.osim",
        "opensim-reference-small/arm26_bounds.osim",
    ):
        model = read_model(data(name))
        before = sizes_of(model)
        after = MuscleSizes(
            fiber=1.05 * before.fiber,
            slack=0.97 * before.slack,
            force=1.2 * before.force,
            strain=1.1 * before.strain,
        )
        made = with_sizes(model, after, before)
        write_osim(made, tmp_path / "made.osim")
        read = sizes_of(read_model(tmp_path / "made.osim"))
        np.testing.assert_allclose(read.fiber, after.fiber, rtol=1e-9)
        np.testing.assert_allclose(read.slack, after.slack, rtol=1e-9)
        np.testing.assert_allclose(read.force, after.force, rtol=1e-9)
        x = np.tile([[1.4]], (1, len(model.muscles)))
        plain = muscle_shapes(model).passive(x)[0]
        stretched = muscle_shapes(read_model(tmp_path / "made.osim")).passive(
            1.0 + 1.1 * (x - 1.0)
        )[0]
        # Millard's curve begins with a stiffness that does not follow its strains.
        np.testing.assert_allclose(stretched, plain, rtol=0.01)


def test_scatter_of_torques_moves_strength_and_gains_alike(arm26, someone):
    """How far torques scatter about what EMG shows is no difference of strength and gain.

    A force that is linear in the activation knows their product alone, so the slopes differ by what
    does not come of activation.
    """
    problem = problem_of(arm26, someone[1][:1])
    part = as_fit(problem).at().parts[0].part
    prior = problem.prior
    shifted = np.clip(part.activations + 0.1, 0.0, 1.0)
    moved = with_slopes(
        problem.muscles,
        recording_at(problem.muscles, part.recorded, np.zeros(len(prior.bound)), shifted, NOISE),
        1.0,
    )
    at = moved.at
    passive = at.followed.force - at.followed.by_activation * at.present
    for group in range(len(prior.groups)):
        members = prior.group == group
        strength = moved.slopes[..., prior.parts.strength.start + group]
        gains = moved.slopes[..., prior.parts.gains][..., prior.gain[members]].sum(axis=-1)
        rest = np.einsum("frm,fm->fr", moved.recorded.arms[..., members], passive[:, members])
        np.testing.assert_allclose(strength - gains, rest, atol=1e-9 * np.abs(strength).max())

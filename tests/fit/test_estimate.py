"""An estimate certifies itself, judges itself on held-out parts, and travels."""

import pickle

import numpy as np
import pytest

from myomorph.core.fit import (
    Block,
    Measured,
    NormalEquations,
    Problem,
    Unknown,
    Unknowns,
    Verdict,
    estimate,
)
from myomorph.core.fit.cones import Cone, Cones, minimize_in_cones
from myomorph.core.fit.verdict import held_out
from myomorph.core.model.errors import BadData
from myomorph.core.model.provenance import Source

GAIN = Block(name="gain", unknowns=(Unknown(name="gain", start=1.0, sd=0.5),))


def trial(name, gain, sd=0.1, seed=0):
    signal = np.linspace(1.0, 2.0, 20)
    seen = gain * signal + sd * np.random.default_rng(seed).normal(size=20)
    return Measured(
        name=name,
        blocks=("gain",),
        function=lambda values: values["gain"][0] * signal - seen,
        sd=sd,
    )


def test_an_estimate_says_what_it_was_made_from_and_how_well_that_fits():
    source = Source("markers", "walk.trc", "0" * 64)
    trials = [trial(f"walk {number}", 1.4, seed=number) for number in range(3)]
    found = estimate(
        Problem(Unknowns((GAIN,)), tuple(trials), (source,)),
        hold_out=[one.name for one in trials],
    )
    assert found.converged
    assert found.sources == (source,)
    assert [one.name for one in found.explained] == ["walk 0", "walk 1", "walk 2", "prior"]
    assert [one.count for one in found.explained] == [20, 20, 20, 1]
    assert all(0.5 < one.rms < 1.5 for one in found.explained)
    assert found.verdict is not None
    assert found.verdict.better
    status, *rest = found.certificate
    assert status.startswith("converged after")
    assert rest[-1].startswith("predicts parts held out in turn better than the generic values")
    assert "generic" in rest[-1]


def test_an_estimate_that_predicts_worse_is_not_better():
    trials = (trial("first", 1.5), trial("second", 0.9), trial("third", 1.1, seed=3))
    verdict = held_out(Problem(Unknowns((GAIN,)), trials), [one.name for one in trials])
    assert not verdict.better
    assert verdict.ratio > 1.0
    assert "not better" in verdict.sentence
    assert verdict.losses
    with pytest.raises(BadData, match="fourth"):
        held_out(Problem(Unknowns((GAIN,)), trials), ["fourth"])


def test_a_verdict_weighs_parts_and_kinds():
    verdict = Verdict(
        kinds=(("force", "N"), ("moment", "N m")),
        parts=("walk", "jump"),
        estimate=np.array([[3.0, 1.0], [4.0, 1.0]]),
        generic=np.array([[6.0, 1.0], [8.0, 1.0]]),
        weights=np.array([3.0, 1.0]),
        what="recordings held out in turn",
    )
    np.testing.assert_allclose(verdict.ratios, [0.5, 1.0])
    np.testing.assert_allclose(verdict.ratio, np.sqrt(0.625))
    assert verdict.better
    assert verdict.losses == ()
    assert verdict.sentence == (
        "predicts recordings held out in turn better than the generic values: force 3.28 N (generic"
        " 6.56), moment 1 N m (generic 1)"
    )
    nothing = Verdict(
        kinds=(), parts=(), estimate=np.zeros((0, 0)), generic=np.zeros((0, 0)), weights=np.zeros(0)
    )
    assert not nothing.better
    assert "not known" in nothing.sentence
    with pytest.raises(BadData, match="1 parts"):
        Verdict(
            kinds=(("force", "N"),),
            parts=("walk",),
            estimate=np.zeros((2, 1)),
            generic=np.zeros((1, 1)),
            weights=np.ones(1),
        )


def test_estimates_travel_between_processes():
    found = estimate(Problem(Unknowns((GAIN,)), (trial("walk", 1.4),)))
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.values["gain"], found.values["gain"])
    assert again.certificate == found.certificate
    assert not again.posterior.x.flags.writeable


def test_an_unknown_is_added_in_one_place():
    """A delay is declared with the residuals that show it, and fitted beside what was there."""
    time = np.linspace(0.0, 1.0, 50)
    before = Problem(Unknowns((GAIN,)), (trial("still", 1.3),))
    delay = Block(name="clock", unknowns=(Unknown(name="delay", unit="s", sd=0.1),))
    moving = Measured(
        name="moving",
        blocks=("gain", "clock"),
        function=lambda values: (
            values["gain"][0] * np.sin(5.0 * (time - values["clock"][0]))
            - 1.3 * np.sin(5.0 * (time - 0.04))
        ),
        sd=0.001,
    )
    found = estimate(before + Problem(Unknowns((GAIN, delay)), (moving,)), fit=["gain", "clock"])
    np.testing.assert_allclose(found.values["clock"], 0.04, atol=1e-4)
    limits = found.posterior.interval("delay")
    assert limits.holds(0.04)
    assert limits.high - limits.low < 0.01


def test_least_squares_in_cones_meet_them():
    # The nearest positive semidefinite matrix to one with eigenvalues 2 and -1.
    root = np.sqrt(2.0)
    matrix = np.array([[0.5, 1.5], [1.5, 0.5]])
    target = np.array([matrix[0, 0], root * matrix[0, 1], matrix[1, 1]])
    found = minimize_in_cones(
        NormalEquations(H=np.eye(3), g=-target),
        Cones(rows=-np.eye(3), right=np.zeros(3), cones=(Cone("semidefinite", 2),)),
    )
    assert found.converged
    np.testing.assert_allclose(found.x, [1.0, root, 1.0], atol=1e-6)
    # With a sum that is kept.
    rows = np.vstack([np.ones((1, 2)), -np.eye(2)])
    found = minimize_in_cones(
        NormalEquations(H=np.eye(2), g=np.array([-3.0, 1.0])),
        Cones(
            rows=rows,
            right=np.array([1.0, 0.0, 0.0]),
            cones=(Cone("zero", 1), Cone("nonnegative", 2)),
        ),
    )
    np.testing.assert_allclose(found.x, [1.0, 0.0], atol=1e-6)

"""Groups that keep generic values.

They are those whose values explain held-out frames clearly better, and no others.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.body.personalize import held_out as room
from myomorph.body.personalize.held_out import BETTER, held_out
from myomorph.body.personalize.prior import Parts

PARTS = Parts(
    fibers=slice(0, 2),
    points=slice(2, 4),
    strength=slice(4, 6),
    passive=slice(6, 8),
    gains=slice(8, 8),
)
"""Two muscles, each a group of its own: fiber, point, force, strain, and no gains."""


@pytest.mark.parametrize("score", [0.2, 10.0, -10.0])
def test_generic_values_of_a_group_must_be_better_by_half_a_percent(monkeypatch, score):
    """The first group would gain a little too little, the second a little more than enough.

    The threshold is at least 0.005.
    """
    least = BETTER * max(abs(score), 1.0)
    gains = {"first": 0.9 * least, "second": 1.1 * least}

    def check(problem, p, noise):
        found = SimpleNamespace(score=score + 1.0, left=np.zeros(1), misfits=np.ones(1))
        if p.any():
            gained = sum(gain for at, gain in enumerate(gains.values()) if p[at] == 0.0)
            found.score = score - gained
        return found

    monkeypatch.setattr(room, "check", check)
    prior = SimpleNamespace(
        parts=PARTS, groups=("first", "second"), group=np.array([0, 1]), deviation=np.ones(8)
    )
    unseen = [SimpleNamespace(name="walk", counted=np.ones(7, bool))]
    problem = SimpleNamespace(prior=prior, of=lambda windows: problem)
    found, p = held_out(problem, unseen, SimpleNamespace(p=np.ones(8), noise=None))
    assert found.kept == ("second",)
    np.testing.assert_array_equal(p, [1.0, 0.0] * 4)
    assert found.frames == 7
    assert (found.score_generic, found.score) == pytest.approx(
        (score + 1.0, score - gains["second"])
    )

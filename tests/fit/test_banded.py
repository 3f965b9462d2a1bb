"""Own unknowns that banded factors eliminate: the same minimum as with all unknowns together."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from myomorph.core.fit.banded import BandedEquations, Reduced, reduce_banded
from myomorph.core.fit.estimation import estimate
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Measured, NormalEquations
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns

TIME = np.linspace(0.0, 1.0, 9)
MEASURED = np.exp(0.7 * np.sin(3.0 * TIME)) + 0.1 * np.cos(20.0 * TIME)
STIFFNESS = 2.0  # Of the spring between neighbors


def residuals(own, gain):
    """Measured exp(gain own), own values near those of their neighbors."""
    return np.concatenate([np.exp(gain * own) - MEASURED, STIFFNESS * np.diff(own)])


def slopes(own, gain):
    """(rows, own) and (rows,) in the gain."""
    of_own = np.vstack(
        [np.diag(gain * np.exp(gain * own)), STIFFNESS * np.diff(np.eye(len(own)), axis=0)]
    )
    of_gain = np.concatenate([own * np.exp(gain * own), np.zeros(len(own) - 1)])
    return of_own, of_gain


@dataclass(frozen=True, eq=False)
class CurveAt:
    """The residuals at a gain, with values of their own."""

    own: np.ndarray
    gain: float

    @property
    def cost(self):
        return float(np.sum(residuals(self.own, self.gain) ** 2))

    @property
    def count(self):
        return len(TIME)

    def reduced(self, damping) -> Reduced:
        of_own, of_gain = slopes(self.own, self.gain)
        left = residuals(self.own, self.gain)
        H = of_own.T @ of_own
        band = np.stack([np.diag(H), np.append(np.diag(H, -1), 0.0)])
        own = BandedEquations(band=band, right=of_own.T @ left, cross=(of_own.T @ of_gain)[:, None])
        shared = NormalEquations(H=np.array([[of_gain @ of_gain]]), g=np.array([of_gain @ left]))
        return reduce_banded([own], shared, damping)

    def normal(self):
        return self.reduced(0.0).equations

    def damped(self, damping):
        reduced = self.reduced(damping)
        return reduced.equations, reduced.gain

    def stepped(self, damping, step):
        return CurveAt(self.own + self.reduced(damping).own_steps(step)[0], self.gain)


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve whose values are its own unknowns."""

    name: str = field(default="curve", init=False)
    blocks: tuple[str, ...] = field(default=("gain",), init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values, before=None):
        own = np.zeros(len(TIME)) if before is None else before.own
        return CurveAt(own, float(values["gain"][0]))


def test_own_unknowns_step_along_to_the_minimum_of_all():
    gain = Block(name="gain", unknowns=(Unknown(name="gain", start=1.0, sd=0.2),))
    found = estimate(Problem(Unknowns((gain,)), (Curve(),)))
    values = Block(name="values", unknowns=tuple(Unknown(name=f"value {i}") for i in range(9)))
    together = Measured(
        name="curve",
        blocks=("gain", "values"),
        function=lambda at: residuals(at["values"], at["gain"][0]),
    )
    expected = estimate(Problem(Unknowns((gain, values)), (together,)))
    assert found.converged
    assert found.search.cost == pytest.approx(expected.search.cost, rel=1e-9)
    assert found.values["gain"] == pytest.approx(expected.values["gain"], rel=1e-5)
    assert found.posterior.sd[0] == pytest.approx(expected.posterior.sd[0], rel=1e-5)


def test_an_unknown_from_elsewhere_is_estimated_with_own_ones():
    """A block and a residual, added as a problem: the solver takes them as they are."""
    gain = Block(name="gain", unknowns=(Unknown(name="gain", start=1.0, sd=0.2),))
    offset = Block(name="offset", unknowns=(Unknown(name="scale's offset", sd=1.0),))
    weighed = Measured(
        name="weighed gain",
        blocks=("gain", "offset"),
        function=lambda at: at["gain"] + at["offset"] - 1.3,
        sd=1e-6,
    )
    curve = Problem(Unknowns((gain,)), (Curve(),))
    found = estimate(curve + Problem(Unknowns((gain, offset)), (weighed,)))
    total = found.values["gain"][0] + found.values["offset"][0]
    assert total == pytest.approx(1.3, abs=1e-6)
    assert "scale's offset" in found.unknowns.names
    held = estimate(curve + Problem(Unknowns((gain, offset)), (weighed,)), fit=["gain"])
    assert held.values["offset"][0] == 0.0

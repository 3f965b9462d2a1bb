"""Which stick made each impact: whole assignments, those of a moment together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from sticks import SITES, rods

from myomorph.core.contact.sound import HeardImpact, HeardImpacts, Instrument
from myomorph.core.contact.strikers import find_strikers
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import UnknownName
from myomorph.core.model.series import Motion

ANGLES = {"snare": -0.5, "tom": 0.6}
DRUMS = tuple(Instrument(name=name, channel=name, sites=("tip_a", "tip_b")) for name in ANGLES)
Stroke = tuple[float, str, str]


def played(strokes: Sequence[Stroke], seed: int) -> tuple[HeardImpacts, Motion]:
    """Impacts of strokes (time, drum, stick) in order, and the motion of both sticks.

    Each stick turns down to the drum, turns round there, and is elsewhere between.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, strokes[-1][0] + 1.0, 0.005)
    values = np.empty((len(time), 2))
    for column, stick in enumerate("ab"):
        knots = [(0.0, 0.2, 0.0, 0.0)]
        for at, drum, by in strokes:
            if by != stick:
                continue
            up = knots[-1][0] + 0.5 * (at - knots[-1][0])
            knots.append((up, rng.uniform(-0.3, 0.3), 0.0, 0.0))
            speed = 8.0 * np.sign(ANGLES[drum])
            angle = ANGLES[drum] + 0.03 * rng.standard_normal()
            knots.append((at, angle, speed, -0.6 * speed))
        knots.append((time[-1], 0.2, 0.0, 0.0))
        for one, other in pairwise(knots):
            inside = (time >= one[0]) & (time <= other[0])
            curve = CubicHermiteSpline((one[0], other[0]), (one[1], other[1]), (one[3], other[2]))
            values[inside, column] = curve(time[inside])
    values += 0.002 * rng.standard_normal(values.shape)
    impacts = tuple(
        HeardImpact(instrument=drum, time=at, energy=1e-4, confidence=1.0)
        for at, drum, _ in strokes
    )
    return HeardImpacts(DRUMS, impacts), Motion(time, ("a", "b"), values)


def both(at: float, crossed: bool, later: float = 0.008) -> list[Stroke]:
    """Both sticks at once, each on its own drum, or each on the other's; the tom somewhat later."""
    first, other = ("b", "a") if crossed else ("a", "b")
    return [(at, "snare", first), (at + later, "tom", other)]


def test_sticks_that_strike_at_once_are_told_apart() -> None:
    for seed in (31, 32, 33):
        strokes = [(1.0, "snare", "a"), (1.6, "tom", "b"), (2.2, "snare", "b"), (2.8, "tom", "a")]
        for number in range(8):
            strokes += both(3.5 + 0.7 * number, crossed=number % 3 == 2)
        heard, motion = played(strokes, seed)
        found = find_strikers(heard, rods("a", "b"), motion, SITES)
        assert [found[i].site for i in range(len(strokes))] == [f"tip_{by}" for _, _, by in strokes]
        assert min(striker.confidence for striker in found.values()) > 0.95


def test_no_stick_is_certain_where_both_always_strike_at_once() -> None:
    """Nothing shows which drum is where: the exchanged assignment is as likely."""
    strokes = [stroke for number in range(8) for stroke in both(1.0 + 0.7 * number, False, 0.0)]
    heard, motion = played(strokes, 34)
    found = find_strikers(heard, rods("a", "b"), motion, SITES)
    by_drum = {
        drum: {found[i].site for i, stroke in enumerate(strokes) if stroke[1] == drum}
        for drum in ANGLES
    }
    assert all(len(sites) == 1 for sites in by_drum.values()), "each stick keeps its drum"
    assert by_drum["snare"] != by_drum["tom"]
    assert max(striker.confidence for striker in found.values()) < 0.9


def test_one_site_makes_all_impacts_of_its_own_drum() -> None:
    strokes = [stroke for number in range(4) for stroke in both(1.0 + 0.7 * number, False)]
    heard, motion = played(strokes, 35)
    own = tuple(
        Instrument(name=drum, channel=drum, sites=(f"tip_{stick}",))
        for drum, stick in (("snare", "a"), ("tom", "b"))
    )
    found = find_strikers(HeardImpacts(own, heard.impacts), rods("a", "b"), motion, SITES)
    assert {found[i] for i in range(0, 8, 2)} == {found[0]}
    assert (found[0].site, found[1].site, found[1].confidence) == ("tip_a", "tip_b", 1.0)
    alone = (Instrument(name="snare", channel="1", sites=("tip_a",)), Instrument("tom", "2"))
    found = find_strikers(HeardImpacts(alone, heard.impacts), rods("a", "b"), motion, SITES)
    assert set(found) == {0, 2, 4, 6}, "nothing strikes the tom"
    bell = Instrument(name="snare", channel="1", sites=("tip_z",))
    with pytest.raises(UnknownName, match="'tip_z'"):
        find_strikers(HeardImpacts((bell,), ()), rods("a", "b"), motion, SITES)
    assert find_strikers(HeardImpacts(DRUMS, ()), rods("a", "b"), motion, SITES) == {}


def test_sites_that_are_not_named_do_not_strike() -> None:
    strokes = [(1.0, "snare", "a"), (1.8, "snare", "a"), (2.6, "snare", "a")]
    heard, motion = played(strokes, 36)
    more = (*SITES, Site("tip_c", "a", np.zeros((1, 3))))
    found = find_strikers(heard, rods("a", "b"), motion, more)
    assert {striker.site for striker in found.values()} == {"tip_a"}

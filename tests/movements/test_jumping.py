"""Laws of the numbers of jumps: made of a center of mass whose way is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.jumping import jumps
from myomorph.lab.movements.part import Part
from myomorph.lab.movements.support_force import SupportForce

MASS = 68.0
G = 9.80665
DOWN = 0.3
PUSH = 0.45
OFF = 1.0 + DOWN + PUSH


def countermovement(
    rate: float = 1000.0, noise: float = 0.0, offset: float = 0.0, right: float = 0.5
) -> tuple[SupportForce, dict[str, float]]:
    """Stand for 1 s, dip, push, fly, land in 0.25 s and stand.

    Accelerations are half sines a sin(pi t / T): each gives 2 a T / pi of velocity.
    """
    dip = 5.0
    push = 13.0
    time = np.arange(0.0, 4.0, 1.0 / rate)
    speed = 2.0 / math.pi * (push * PUSH - dip * DOWN)
    flight = 2.0 * speed / G
    land = OFF + flight
    stop = 0.25
    brake = math.pi * speed / (2.0 * stop)
    acceleration = np.zeros(len(time))
    for begin, length, size in ((1.0, DOWN, -dip), (1.0 + DOWN, PUSH, push), (land, stop, brake)):
        inside = (time >= begin) & (time < begin + length)
        acceleration[inside] = size * np.sin(np.pi * (time[inside] - begin) / length)
    acceleration[(time >= OFF) & (time < land)] = -G
    total = MASS * (G + acceleration)
    random = np.random.default_rng(11)
    parts = [
        share * total + offset + random.normal(0.0, noise, len(time))
        for share in (right, 1.0 - right)
    ]
    known = {
        "speed": speed,
        "flight": flight,
        "height": speed**2 / (2.0 * G),
        "landing": 1.0 + brake / G,
        "depth": _depth(dip, push),
    }
    return SupportForce.of(time, MASS * G, *parts).zeroed(), known


def _depth(dip: float, push: float) -> float:
    """How far the center of mass goes down, by sums of a thousandth of a millisecond."""
    time = np.arange(0.0, DOWN + PUSH, 1e-5)
    early = time < DOWN
    acceleration = np.where(
        early, -dip * np.sin(np.pi * time / DOWN), push * np.sin(np.pi * (time - DOWN) / PUSH)
    )
    return -float(np.cumsum(np.cumsum(acceleration) * 1e-5).min() * 1e-5)


def only(force: SupportForce) -> Part:
    (jump,) = jumps(force)
    return jump


@pytest.mark.parametrize(
    "disturbed", [{}, {"noise": 3.0}, {"rate": 400.0}, {"rate": 2000.0}, {"offset": 12.0}]
)
def test_a_jump_has_the_height_and_impulse_it_was_made_with(disturbed: dict) -> None:
    force, known = countermovement(**disturbed)
    jump = only(force)
    assert jump.number(of.HEIGHT_BY_IMPULSE) == pytest.approx(known["height"], rel=0.03)
    assert jump.number(of.HEIGHT_BY_FLIGHT) == pytest.approx(known["height"], rel=0.02)
    assert abs(jump.number(of.HEIGHT_DIFFERENCE)) < 0.012
    assert jump.number(of.NET_IMPULSE) == pytest.approx(MASS * known["speed"], rel=0.015)
    assert jump.number(of.FLIGHT_TIME) == pytest.approx(known["flight"], abs=0.006)
    assert jump.number(of.COUNTERMOVEMENT_DEPTH) == pytest.approx(known["depth"], rel=0.05)
    assert jump.number(of.LANDING_FORCE) == pytest.approx(known["landing"], rel=0.02)
    assert math.isnan(jump.number(of.REACTIVE_STRENGTH))


def test_phases_follow_each_other() -> None:
    force, known = countermovement()
    jump = only(force)
    names = [phase.name for phase in jump.phases]
    assert names == ["unweighting", "braking", "propulsion", "flight", "landing"]
    for phase, following in zip(jump.phases, jump.phases[1:], strict=False):
        assert phase.stop == pytest.approx(following.start)
    flight = jump.phases[3]
    assert flight.stop - flight.start == pytest.approx(known["flight"], abs=0.005)


def test_peak_power_is_that_of_the_made_jump() -> None:
    force, _ = countermovement()
    time = np.arange(0.0, PUSH, 1e-4)
    pushing = 13.0 * np.sin(np.pi * time / PUSH)
    velocity = np.cumsum(pushing) * 1e-4 - 2.0 / math.pi * 5.0 * DOWN
    power = float(((pushing + G) * velocity).max())
    assert only(force).number(of.PEAK_POWER) == pytest.approx(power, rel=0.01)


@pytest.mark.parametrize("share", [0.5, 0.62])
def test_the_share_of_a_leg_is_the_one_it_took(share: float) -> None:
    jump = only(countermovement(right=share)[0])
    assert jump.number(of.LANDING_SHARE) == pytest.approx(100.0 * share, abs=0.3)
    assert jump.number(of.PUSH_SHARE) == pytest.approx(100.0 * share, abs=0.3)


def test_one_plate_shows_no_share() -> None:
    force, known = countermovement()
    alone = SupportForce.of(force.time, force.weight, None, None, force.total)
    jump = only(alone)
    assert jump.number(of.HEIGHT_BY_IMPULSE) == pytest.approx(known["height"], rel=0.03)
    assert math.isnan(jump.number(of.LANDING_SHARE))


def drop_jump(rate: float = 1000.0, contact: float = 0.22) -> tuple[SupportForce, float]:
    """Fall from 0.3 m, a half sine on the ground, and fly as high again."""
    fall = math.sqrt(2.0 * G * 0.3)
    flight = 2.0 * fall / G
    # m (v + v) = integral (F - m g): the mean of a half sine is 2 / pi of its peak.
    peak = math.pi / 2.0 * MASS * (G + 2.0 * fall / contact)
    time = np.arange(0.0, 2.5, 1.0 / rate)
    total = np.zeros(len(time))
    on = (time >= 0.4) & (time < 0.4 + contact)
    total[on] = peak * np.sin(np.pi * (time[on] - 0.4) / contact)
    landed = time >= 0.4 + contact + flight
    since = time[landed] - (0.4 + contact + flight)
    slow = 0.3
    brake = math.pi * fall / (2.0 * slow)
    landing = np.where(since < slow, brake * np.sin(np.pi * np.minimum(since, slow) / slow), 0.0)
    total[landed] = MASS * (G + landing)
    half = 0.5 * total
    return SupportForce.of(time, MASS * G, half, half), flight


def test_a_drop_jump_has_its_contact_and_its_index() -> None:
    force, flight = drop_jump()
    jump = only(force)
    height = G * flight**2 / 8.0
    assert jump.number(of.CONTACT_TIME) == pytest.approx(0.22, abs=0.003)
    assert jump.number(of.REACTIVE_STRENGTH) == pytest.approx(height / 0.22, rel=0.03)
    assert jump.number(of.HEIGHT_BY_FLIGHT) == pytest.approx(0.3, rel=0.02)
    assert math.isnan(jump.number(of.HEIGHT_BY_IMPULSE))
    assert [phase.name for phase in jump.phases][:3] == ["braking", "propulsion", "flight"]
    braking = jump.phases[0]
    assert braking.stop - braking.start == pytest.approx(0.11, abs=0.005)


def test_who_walks_or_stands_does_not_jump() -> None:
    time = np.arange(0.0, 3.0, 0.001)
    standing = np.full(len(time), 0.5 * MASS * G)
    assert jumps(SupportForce.of(time, MASS * G, standing, standing)) == ()
    in_turn = np.sin(2.0 * np.pi * time) > 0.0
    right = np.where(in_turn, 1.05 * MASS * G, 0.0)
    left = np.where(in_turn, 0.0, 1.05 * MASS * G)
    assert jumps(SupportForce.of(time, MASS * G, right, left)) == ()


def test_who_leaves_the_plates_does_not_fly() -> None:
    time = np.arange(0.0, 6.0, 0.001)
    on = (time < 1.0) | (time > 4.0)
    force = np.where(on, 0.5 * MASS * G, 0.0)
    assert jumps(SupportForce.of(time, MASS * G, force, force)) == ()


def test_a_weight_that_contradicts_the_force_gives_no_power() -> None:
    """Of a drop jump the velocity follows from the weight: one that is 20 % off lifts the body."""
    force, _ = drop_jump(contact=0.6)
    jump = only(force)
    heavy = SupportForce.of(force.time, 1.2 * force.weight, force.right, force.left)
    wrong = only(heavy)
    assert jump.number(of.PEAK_POWER) > 0.0
    assert math.isnan(wrong.number(of.PEAK_POWER))
    assert math.isnan(wrong.number(of.COUNTERMOVEMENT_DEPTH))
    assert wrong.number(of.CONTACT_TIME) == pytest.approx(jump.number(of.CONTACT_TIME), abs=0.01)

"""Laws of the numbers of a run: a mass on springs of known stiffness, seen by plates alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy

from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.running import Runner, Stance, running_steps
from myomorph.lab.movements.support_force import SupportForce

MASS = 70.0
G = 9.80665
LEG = 0.95


class Bounce:
    """A runner as a mass on a massless leg: what one contact looks like.

    The touch-down angle is the one by which the body leaves the ground as it met it.
    """

    def __init__(self, stiffness: float, speed: float, fall: float) -> None:
        self.stiffness = stiffness
        self.speed = speed
        self.fall = fall
        self.angle = scipy.optimize.brentq(self._asymmetry, 0.2, 0.75)
        self.times, self.forces = self._contact(self.angle)
        self.contact = float(self.times[-1])
        self.flight = 2.0 * fall / G

    def _contact(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Give times, and the vertical force at them."""
        solution = self._solved(angle)
        times = np.linspace(0.0, solution.t[-1], 400)
        x, y, _, _ = solution.sol(times)
        length = np.hypot(x, y)
        return times, self.stiffness * (LEG - length) * y / length

    def _solved(self, angle: float) -> scipy.integrate.OdeSolution:
        def rates(_: float, state: np.ndarray) -> list[float]:
            x, y, u, v = state
            length = math.hypot(x, y)
            push = self.stiffness * (LEG - length) / (MASS * length)
            return [u, v, push * x, push * y - G]

        def long_again(_: float, state: np.ndarray) -> float:
            return math.hypot(state[0], state[1]) - LEG

        long_again.terminal = True  # type: ignore[attr-defined]
        long_again.direction = 1.0  # type: ignore[attr-defined]
        start = [-LEG * math.sin(angle), LEG * math.cos(angle), self.speed, -self.fall]
        return scipy.integrate.solve_ivp(
            rates, (0.0, 1.0), start, events=long_again, dense_output=True, rtol=1e-9, atol=1e-10
        )

    def _asymmetry(self, angle: float) -> float:
        solution = self._solved(angle)
        return float(solution.y[3, -1] - self.fall)


def recorded(
    bounce: Bounce, rate: float = 1000.0, count: int = 8, noise: float = 0.0, offset: float = 0.0
) -> tuple[SupportForce, list[Stance]]:
    """Put steps of both feet in turn on two plates."""
    period = bounce.contact + bounce.flight
    time = np.arange(0.0, 0.2 + count * period + 0.1, 1.0 / rate)
    forces = {"right": np.zeros(len(time)), "left": np.zeros(len(time))}
    stances = []
    for step in range(count):
        side = "right" if step % 2 == 0 else "left"
        strike = 0.2 + step * period
        forces[side] += np.interp(time - strike, bounce.times, bounce.forces, 0.0, 0.0)
        stances.append(Stance(side=side, start=strike, stop=strike + bounce.contact, measured=True))
    random = np.random.default_rng(5)
    parts = {
        side: force + offset + random.normal(0.0, noise, len(time))
        for side, force in forces.items()
    }
    force = SupportForce.of(time, MASS * G, parts["right"], parts["left"]).zeroed()
    return force, stances


@pytest.fixture(scope="module")
def bounce() -> Bounce:
    return Bounce(stiffness=11_000.0, speed=3.0, fall=0.6)


def means(steps: tuple, quantity: of.Quantity) -> float:
    values = [step.number(quantity) for step in steps]
    return float(np.nanmean(values))


@pytest.mark.parametrize(
    "disturbed", [{}, {"noise": 3.0}, {"offset": 25.0}, {"rate": 500.0}, {"rate": 2400.0}]
)
def test_a_run_on_springs_has_their_stiffness(bounce: Bounce, disturbed: dict) -> None:
    force, stances = recorded(bounce, **disturbed)
    steps = running_steps(stances, force, Runner(leg_length=LEG, speed=bounce.speed))
    assert len(steps) == len(stances)
    assert means(steps, of.LEG_STIFFNESS) == pytest.approx(1e-3 * bounce.stiffness, rel=0.06)
    peak = float(bounce.forces.max())
    assert means(steps, of.PEAK_VERTICAL_FORCE) == pytest.approx(peak / MASS / G, rel=0.02)
    assert means(steps, of.CONTACT_TIME) == pytest.approx(bounce.contact, rel=0.01)
    assert means(steps, of.FLIGHT_TIME) == pytest.approx(bounce.flight, abs=0.004)
    period = bounce.contact + bounce.flight
    assert means(steps, of.CADENCE) == pytest.approx(60.0 / period, rel=0.01)
    assert means(steps, of.DUTY_FACTOR) == pytest.approx(bounce.contact / (2 * period), rel=0.01)


@pytest.mark.parametrize("stiffness", [15_000.0, 40_000.0])
def test_who_hops_on_a_spring_has_its_vertical_stiffness(stiffness: float) -> None:
    """The closed form: F = k s, s from A sin(w t) + rest, through the same force at both ends."""
    omega = math.sqrt(stiffness / MASS)
    fall = 1.0
    rest = MASS * G / stiffness
    amplitude = math.hypot(rest, fall / omega)
    begin = math.asin(-rest / amplitude)
    contact = (math.pi - 2.0 * begin) / omega
    time = np.arange(0.0, contact, 1e-4)
    force = stiffness * (rest + amplitude * np.sin(begin + omega * time))
    whole = np.concatenate([np.zeros(1000), force, np.zeros(3000)])
    clock = np.arange(len(whole)) * 1e-4
    stance = Stance(side="right", start=0.1, stop=0.1 + contact, measured=True)
    plates = SupportForce.of(clock, MASS * G, whole, np.zeros(len(whole)))
    (step,) = running_steps([stance], plates, Runner())
    assert step.number(of.VERTICAL_STIFFNESS) == pytest.approx(1e-3 * stiffness, rel=0.01)
    assert math.isnan(step.number(of.LEG_STIFFNESS))


def test_a_straight_rise_of_the_force_is_its_loading_rate() -> None:
    time = np.arange(0.0, 0.6, 0.0005)
    slope = 60.0 * MASS * G
    impact = np.interp(time, [0.1, 0.125, 0.14, 0.22, 0.35], [0.0, 1.5, 1.2, 2.4, 0.0])
    force = SupportForce.of(time, MASS * G, impact * MASS * G, np.zeros(len(time)))
    stances = [Stance(side="right", start=0.1, stop=0.35, measured=True)]
    (step,) = running_steps(stances, force, Runner())
    assert step.number(of.LOADING_RATE) == pytest.approx(slope / MASS / G, rel=0.02)


def test_too_few_samples_show_no_loading_rate(bounce: Bounce) -> None:
    force, stances = recorded(bounce, rate=100.0)
    steps = running_steps(stances, force, Runner())
    assert all(math.isnan(step.number(of.LOADING_RATE)) for step in steps)


def test_without_plates_there_are_times_and_no_forces(bounce: Bounce) -> None:
    _, stances = recorded(bounce)
    for step in running_steps(stances, None, Runner(leg_length=LEG, speed=3.0)):
        assert step.number(of.CONTACT_TIME) == pytest.approx(bounce.contact)
        for quantity in (of.PEAK_VERTICAL_FORCE, of.LOADING_RATE, of.LEG_STIFFNESS):
            assert math.isnan(step.number(quantity))


def test_half_a_foot_on_a_plate_is_no_force(bounce: Bounce) -> None:
    """What does not carry the body over a step was not measured as a whole."""
    force, stances = recorded(bounce)
    assert force.right is not None
    assert force.left is not None
    half = SupportForce.of(force.time, force.weight, 0.6 * force.right, force.left)
    for step in running_steps(stances, half, Runner())[:-1]:
        assert math.isnan(step.number(of.PEAK_VERTICAL_FORCE)) == (step.side == "right")


def test_a_step_that_was_not_seen_makes_no_flight(bounce: Bounce) -> None:
    force, stances = recorded(bounce)
    steps = running_steps([*stances[:2], *stances[3:]], force, Runner())
    assert math.isnan(steps[1].number(of.FLIGHT_TIME))
    assert math.isnan(steps[1].number(of.CADENCE))
    assert steps[0].number(of.FLIGHT_TIME) == pytest.approx(bounce.flight)

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from myomorph.core.model.series import Series, Wrenches
from myomorph.lab.analysis.phases import contacts, ground_phases, side_of
from walker import steps

UP = np.array([0.0, 1.0, 0.0])
G = 9.80665


TAKE_OFF = 1.75
"""Of the made jump [s]."""


def jump(
    rate: float = 1000.0, mass: float = 75.0, noise: float = 3.0
) -> tuple[Wrenches, Series, dict[str, float]]:
    """Simulate a jump whose center of mass is known.

    The phases are: stand 1 s, dip, push, ballistic flight, land and stand.
    """
    time = np.arange(0.0, 4.0, 1.0 / rate)
    before = time < TAKE_OFF
    acceleration = _pushing(time)
    fastest = float((np.cumsum(acceleration) / rate)[before][-1])
    flight = 2.0 * fastest / G
    _fly_and_land(acceleration, time, fastest, flight)
    speed = np.cumsum(acceleration) / rate
    height = 1.0 + np.cumsum(speed) / rate
    force = mass * (G + acceleration)
    force += np.random.default_rng(1).normal(0.0, noise, len(time))
    forces = np.zeros((len(time), 1, 3))
    forces[:, 0, 1] = force
    wrenches = Wrenches(
        time=time,
        names=("plate",),
        bodies=("",),
        forces=forces,
        points=np.zeros_like(forces),
        torques=np.zeros_like(forces),
    )
    known = {
        "Onset": 1.0,
        "Braking": float(time[np.argmin(speed * before)]),
        "Lowest point": float(time[np.argmin(np.where(before, height, np.inf))]),
        "Take-off": TAKE_OFF,
        "Landing": TAKE_OFF + flight,
        "height": fastest**2 / (2 * G),
    }
    com = Series(time, ("x", "y", "z"), np.stack([0 * height, height, 0 * height], axis=1))
    return wrenches, com, known


def _pushing(time):
    """Return the acceleration (frames,) of dip and push, zero elsewhere [m/s^2]."""
    acceleration = np.zeros_like(time)
    down = (time >= 1.0) & (time < 1.3)
    push = (time >= 1.3) & (time < TAKE_OFF)
    acceleration[down] = -5.0 * np.sin(np.pi * (time[down] - 1.0) / 0.3)
    acceleration[push] = 13.0 * np.sin(np.pi * (time[push] - 1.3) / 0.45)
    return acceleration


def _fly_and_land(acceleration, time, fastest, flight):
    """Add flight, and a landing that takes up the speed of take-off [m/s] in 0.3 s."""
    landing_start = TAKE_OFF + flight
    acceleration[(time >= TAKE_OFF) & (time < landing_start)] = -G
    landing = (time >= landing_start) & (time < landing_start + 0.3)
    since = time[landing] - TAKE_OFF - flight
    acceleration[landing] = np.pi / 2 * fastest / 0.3 * np.sin(np.pi * since / 0.3)


@pytest.mark.parametrize("with_com", [True, False])
@pytest.mark.parametrize("with_weight", [True, False])
def test_a_jump_has_the_phases_it_was_made_with(with_com: bool, with_weight: bool) -> None:
    wrenches, com, known = jump()
    found = ground_phases(
        wrenches, UP, 75.0 * G if with_weight else None, com if with_com else None
    )
    assert found.kind == "jump"
    times = {event.label: event.time for event in found.events}
    assert list(times) == ["Onset", "Braking", "Lowest point", "Take-off", "Landing"]
    assert times["Onset"] == pytest.approx(known["Onset"], abs=0.06)
    for label in ("Braking", "Lowest point", "Take-off", "Landing"):
        assert times[label] == pytest.approx(known[label], abs=0.012), label
    measures = {one.name: one.value for one in found.measures}
    assert measures["Body weight on the plates"] == pytest.approx(75.0 * G, rel=0.003)
    assert measures["Jump height from take-off velocity"] == pytest.approx(
        known["height"], rel=0.04
    )
    assert measures["Jump height from flight time"] == pytest.approx(known["height"], rel=0.04)


def test_steps_become_strikes_and_offs_on_their_sides() -> None:
    time = np.arange(0.0, 1.6, 0.001)
    found = ground_phases(steps(time, 600.0), UP, 600.0)
    assert found.kind == "gait"
    told = [(event.side, event.label) for event in found.events]
    assert told == [
        ("Right", "Foot Strike"),
        ("Left", "Foot Strike"),
        ("Right", "Foot Off"),
        ("Left", "Foot Off"),
    ]
    assert [event.time for event in found.events] == pytest.approx([0.2, 0.7, 0.9, 1.4], abs=0.012)


def test_a_mouse_walks_like_a_man() -> None:
    """Events do not depend on the size of the forces."""
    time = np.arange(0.0, 1.6, 0.001)
    large = ground_phases(steps(time, 600.0), UP, 600.0)
    small = ground_phases(steps(time, 0.3), UP, 0.3)
    assert [event.time for event in small.events] == [event.time for event in large.events]


def test_running_is_no_jump() -> None:
    """Flights that do not follow standing still are steps."""
    time = np.arange(0.0, 2.0, 0.001)
    forces = np.zeros((len(time), 2, 3))
    for i, start in enumerate(np.arange(0.1, 1.9, 0.4)):
        inside = (time >= start) & (time <= start + 0.22)
        forces[inside, i % 2, 1] = 1500 * np.sin(np.pi * (time[inside] - start) / 0.22)
    wrenches = Wrenches(
        time=time,
        names=("1", "2"),
        bodies=("foot_r", "foot_l"),
        forces=forces,
        points=0 * forces,
        torques=0 * forces,
    )
    assert ground_phases(wrenches, UP, 700.0).kind == "gait"


@pytest.mark.parametrize(
    "forces",
    [np.zeros((5, 1, 3)), np.full((5, 1, 3), np.nan), np.zeros((5, 0, 3)), np.zeros((1, 1, 3))],
)
def test_nothing_is_found_where_nothing_presses(forces: np.ndarray) -> None:
    """Forces that are zero, missing, of no plate or of one frame.

    Parameters
    ----------
    forces : (frames, plates, 3) [N]
    """
    names = tuple(str(i) for i in range(forces.shape[1]))
    wrenches = Wrenches(
        time=np.arange(float(len(forces))),
        names=names,
        bodies=names,
        forces=forces,
        points=0 * forces,
        torques=0 * forces,
    )
    assert ground_phases(wrenches, UP, 700.0).events == ()


@given(st.lists(st.tuples(st.floats(0.1, 0.5), st.floats(0.1, 0.5)), min_size=1, max_size=5))
def test_contacts_are_where_they_were_put(parts: list[tuple[float, float]]) -> None:
    rate = 1000.0
    force = []
    edges = []
    for gap, load in parts:
        force += [0.0] * round(gap * rate)
        edges.append(len(force))
        force += [500.0] * round(load * rate)
        edges.append(len(force) - 1)
    force += [0.0] * 200
    found = contacts(np.arange(len(force)) / rate, np.array(force), 20.0, 0.03)
    assert len(found) == len(parts)
    assert np.ravel(found) == pytest.approx(edges, abs=10)


@pytest.mark.parametrize(
    ("name", "body", "side"),
    [
        ("1", "calcn_r", "Right"),
        ("left plate", "", "Left"),
        ("FP1", "", ""),
        ("right_foot", "", "Right"),
        ("upright", "", ""),
    ],
)
def test_sides_of_wrenches(name: str, body: str, side: str) -> None:
    assert side_of(name, body) == side


def test_feet_of_one_who_sits_and_rises_make_no_jump() -> None:
    """The chair carries the weight first, and the plates are briefly empty: no flight."""
    time = np.arange(0.0, 4.0, 0.01)
    force = np.where(time < 1.0, 95.0, np.where(time < 1.4, 0.0, 700.0))
    forces = np.zeros((len(time), 1, 3))
    forces[:, 0, 1] = force
    wrenches = Wrenches(
        time=time,
        names=("plate",),
        bodies=("",),
        forces=forces,
        points=np.zeros_like(forces),
        torques=np.zeros_like(forces),
    )
    assert ground_phases(wrenches, UP, 700.0).kind != "jump"


@pytest.mark.parametrize("begin", [0.0, -3.0, 100.0])
def test_contacts_last_as_long_as_they_must_whenever_the_clock_begins(begin: float) -> None:
    """Of 50 N for 0.05, 0.07 and 0.2 s, the last with a gap of 0.04 s: two last 0.06 s."""
    time = np.arange(0.0, 1.0, 0.001)
    spans = ((0.1, 0.15), (0.3, 0.37), (0.6, 0.68), (0.72, 0.8))
    force = sum(np.where((time >= start) & (time < stop), 50.0, 0.0) for start, stop in spans)
    found = contacts(begin + time, force, 10.0, 0.06)
    np.testing.assert_allclose(time[np.array(found)], [[0.3, 0.37], [0.6, 0.8]], atol=0.006)


def test_peaks_of_a_jump_are_those_of_the_force_as_measured() -> None:
    """A landing's spike of 20 ms that the filter takes away is in the peak."""
    wrenches, _, known = jump()
    time = wrenches.time
    whole = wrenches.forces @ UP
    spike = 800.0 * np.exp(-(((time - known["Landing"] - 0.05) / 0.01) ** 2))
    measured = Series(time, ("foot",), whole.sum(axis=1, keepdims=True) + spike[:, None])
    filtered = ground_phases(wrenches, UP, 75.0 * G)
    found = ground_phases(wrenches, UP, 75.0 * G, measured=measured)
    peaks = {one.name: one.value for one in found.measures}
    inside = (time >= known["Landing"]) & (time <= known["Landing"] + 0.5)
    assert peaks["Peak force of landing"] == pytest.approx(measured.values[inside].max(), rel=1e-9)
    before = {one.name: one.value for one in filtered.measures}
    assert peaks["Peak force before take-off"] == pytest.approx(
        before["Peak force before take-off"], rel=1e-9
    )
    assert found.events == filtered.events

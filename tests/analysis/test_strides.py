"""Strides: those of made gaits are recovered.

Plates agree with markers on a real walk; a mouse's strides have gaps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Z_UP_TO_Y_UP, Series, Wrenches
from myomorph.lab.analysis.cycles import band, over_cycles
from myomorph.lab.analysis.foot_events import Limb
from myomorph.lab.analysis.strides import find_strides

Y = np.array([0.0, 1.0, 0.0])
Z = np.array([0.0, 0.0, 1.0])
LIMBS = (
    Limb("foot_r", ("paw_r",), bodies=("foot_r",)),
    Limb("foot_l", ("paw_l",), bodies=("foot_l",)),
)


@dataclass(frozen=True, kw_only=True)
class Gait:
    """A made gait of two paws.

    Attributes
    ----------
    rate : of the frames [Hz]
    period, length : of a stride [s, m]
    duty : share of the stride in which a paw stands
    width : between the paws [m]
    phase : of the left paw, in strides
    belt : whether the ground moves under a body that stays
    cycles : number of strides
    turn : of the direction about the vertical [rad]
    """

    rate: float = 200.0
    period: float = 0.25
    duty: float = 0.6
    length: float = 0.06
    width: float = 0.02
    phase: float = 0.5
    belt: bool = False
    cycles: int = 12
    turn: float = 0.0


USUAL = Gait()


def gait(made=USUAL):
    """Make two paws that stand still on the ground (or move with the belt) and swing evenly.

    Foot strikes are at whole cycles.
    """
    time = np.arange(0.0, made.cycles * made.period, 1.0 / made.rate)
    speed = made.length / made.period
    right = _paw(made, time, -0.5, 0.0)
    left = _paw(made, time, 0.5, made.phase)
    along = speed * time + 0.3 * made.length
    body = np.stack([along, np.zeros_like(time), np.full_like(time, made.length)], axis=1)
    points = np.stack([right, left, body], axis=1)
    if made.belt:
        points[:, :, 0] -= (speed * time)[:, None]
    cosine = np.cos(made.turn)
    sine = np.sin(made.turn)
    turned = points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    return Series(time, ("paw_r", "paw_l", "trunk"), turned)


def _paw(made, time, side, shift):
    """Return positions (frames, 3) of a paw on one side, its strikes shifted by a share."""
    cycle = time / made.period - shift
    u = np.clip((cycle % 1.0 - made.duty) / (1.0 - made.duty), 0.0, 1.0)
    forward = (np.floor(cycle) + shift + u) * made.length
    height = 0.1 * made.length * np.sin(np.pi * u)
    return np.stack([forward, np.full_like(time, side * made.width), height], axis=1)


@pytest.mark.parametrize("belt", [False, True])
@pytest.mark.parametrize(("rate", "period", "length"), [(200.0, 0.25, 0.06), (100.0, 1.1, 1.4)])
def test_a_made_gait_comes_back(belt, rate, period, length):
    made = gait(
        Gait(
            rate=rate,
            period=period,
            duty=0.6,
            length=length,
            width=0.3 * length,
            phase=0.4,
            belt=belt,
            turn=0.5,
        )
    )
    found = find_strides(made, LIMBS, ("trunk",), Z)
    np.testing.assert_allclose(found.direction, (np.cos(0.5), np.sin(0.5), 0.0), atol=2e-3)
    assert found.ground_speed == pytest.approx(-length / period if belt else 0.0, rel=0.01)
    assert len(found.of("foot_r")) == 10
    truth = period * np.arange(1, 12)
    np.testing.assert_allclose(found.strikes["foot_r"], truth, atol=1.5 / rate)
    np.testing.assert_allclose(
        found.lifts["foot_r"], period * (np.arange(12) + 0.6), atol=1.5 / rate
    )
    for one in found.strides:
        assert one.duration == pytest.approx(period, abs=1.0 / rate)
        assert one.length == pytest.approx(length, rel=0.03)
        assert one.duty == pytest.approx(0.6, abs=2.5 / rate / period)
        assert one.speed == pytest.approx(length / period, rel=0.03)
        assert one.width == pytest.approx(0.3 * length, rel=0.03)
    np.testing.assert_allclose(found.phases["foot_l"], 0.4, atol=1.5 / rate / period)


def test_strides_do_not_depend_on_how_the_room_lies():
    made = gait(Gait(turn=0.0))
    turned = Series(made.time, made.names, made.values @ Z_UP_TO_Y_UP.T)
    here = find_strides(made, LIMBS, ("trunk",), Z)
    there = find_strides(turned, LIMBS, ("trunk",), Y)
    assert [one.start for one in here.strides] == pytest.approx(
        [one.start for one in there.strides]
    )
    assert [one.length for one in here.strides] == pytest.approx(
        [one.length for one in there.strides]
    )


def test_what_was_not_seen_is_not_told():
    made = gait(Gait(cycles=20))
    rng = np.random.default_rng(0)
    values = np.array(made.values)
    for start in rng.uniform(0.0, made.time[-1], 12):
        values[(made.time > start) & (made.time < start + 0.05), 0] = np.nan
    found = find_strides(Series(made.time, made.names, values), LIMBS, ("trunk",), Z)
    whole = find_strides(made, LIMBS, ("trunk",), Z)
    assert 3 < len(found.strikes["foot_r"]) < len(whole.strikes["foot_r"])
    assert len(found.of("foot_l")) == len(whole.of("foot_l"))
    for one in found.strikes["foot_r"]:
        assert np.abs(whole.strikes["foot_r"] - one).min() < 0.005
    for one in found.of("foot_r"):
        assert one.duration == pytest.approx(0.25, abs=0.006)
        assert one.seen >= 0.5


def test_noise_of_the_markers_moves_events_little():
    made = gait()
    noisy = Series(
        made.time,
        made.names,
        made.values + np.random.default_rng(1).normal(0.0, 3e-4, made.values.shape),
    )
    found = find_strides(noisy, LIMBS, ("trunk",), Z)
    truth = find_strides(made, LIMBS, ("trunk",), Z)
    for limb in ("foot_r", "foot_l"):
        errors = [np.abs(truth.strikes[limb] - one).min() for one in found.strikes[limb]]
        assert len(errors) == len(truth.strikes[limb])
        assert np.median(errors) < 0.01


def test_feet_that_tremble_make_no_strides():
    """Of an animal that stands: noise of its points, and a shake of 0.07 mm every 10 ms."""
    time = np.arange(0.0, 3.0, 1.0 / 400.0)
    noise = 1e-5 * np.random.default_rng(4).normal(size=(len(time), 3, 3))
    standing = np.array([[0.0, -0.01, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.02]]) + noise
    standing[:, 0, 0] += 3.5e-5 * np.sin(2.0 * np.pi * time / 0.01)
    points = Series(time, ("paw_r", "paw_l", "trunk"), standing)
    found = find_strides(points, LIMBS, ["trunk"], Z)
    assert not found.strides
    assert sum("does not move forward and back" in note for note in found.notes) == 2


def test_plates_go_before_markers():
    made = gait(Gait(belt=False))
    strikes = 0.25 * np.arange(1, 12)
    time = np.arange(0.0, made.time[-1], 0.001)
    share = (time - 0.004) / 0.25 % 1.0
    forces = np.zeros((len(time), 1, 3))
    forces[:, 0, 2] = np.where(share < 0.6, 0.25, 0.0)
    loads = Wrenches(
        time=time,
        names=("plate",),
        bodies=("foot_r",),
        forces=forces,
        points=np.zeros_like(forces),
        torques=np.zeros_like(forces),
    )
    found = find_strides(made, LIMBS, ("trunk",), Z, wrenches=loads, weight=0.25)
    assert {one.source for one in found.of("foot_r")} == {"plates"}
    assert {one.source for one in found.of("foot_l")} == {"markers"}
    np.testing.assert_allclose(found.strikes["foot_r"][:11], strikes + 0.004, atol=0.006)
    with pytest.raises(BadData, match="need the body weight"):
        find_strides(made, LIMBS, ("trunk",), Z, wrenches=loads)


def test_a_real_walk_against_its_plates(data):
    folder = "rajagopal-walk-emg"
    markers = read_trc(data(f"{folder}/markers_walk.trc")).markers
    loads = read_external_loads(data(f"{folder}/grf_walk.xml"))
    limbs = [
        Limb(f"calcn_{s}", (f"{s.upper()}.Heel",), (f"{s.upper()}.Toe",), bodies=(f"calcn_{s}",))
        for s in ("r", "l")
    ]
    seen = find_strides(markers, limbs, ("R.ASIS", "L.ASIS"), Y)
    told = find_strides(markers, limbs, ("R.ASIS", "L.ASIS"), Y, wrenches=loads, weight=735.0)
    assert [one.limb for one in seen.strides] == ["calcn_r", "calcn_l"]
    for which in ("strikes", "lifts"):
        for limb, times in getattr(told, which).items():
            assert np.abs(getattr(seen, which)[limb] - times).max() < 0.04
    assert 0.55 < told.strides[0].duty < 0.7
    assert 1.0 < told.strides[0].speed < 1.6


def test_what_is_wrong_is_named():
    made = gait()
    with pytest.raises(UnknownName, match="hoof"):
        find_strides(made, (Limb("a", ("hoof",)),), ("trunk",), Z)
    with pytest.raises(BadData, match="no limb"):
        find_strides(made, (), ("trunk",), Z)
    with pytest.raises(BadData, match="vertical"):
        find_strides(made, LIMBS, ("trunk",), Z, direction=Z)
    hidden = np.array(made.values)
    hidden[:, 2] = np.nan
    with pytest.raises(BadData, match="trunk"):
        find_strides(Series(made.time, made.names, hidden), LIMBS, ("trunk",), Z)
    still = np.array(made.values)
    still[:, 1] = still[:, 2]
    assert (
        "foot_l: the foot does not move forward and back"
        in find_strides(Series(made.time, made.names, still), LIMBS, ("trunk",), Z).notes
    )


def test_phases_are_against_the_first_limb_or_none():
    made = gait()
    still = np.array(made.values)
    still[:, 0] = still[:, 2]
    third = Limb("foot_x", ("paw_l",))
    found = find_strides(Series(made.time, made.names, still), (*LIMBS, third), ("trunk",), Z)
    assert set(found.phases) == {"foot_l", "foot_x"}
    assert all(len(one) == 0 for one in found.phases.values())


def test_curves_over_the_cycle():
    time = np.linspace(0.0, 3.0, 301)
    values = np.stack([np.sin(2 * np.pi * time), time], axis=1)
    values[(time > 1.3) & (time < 1.6), 0] = np.nan
    cycles = over_cycles(
        Series(time, ("wave", "line"), values), [(0.0, 1.0), (1.0, 2.0), (2.5, 3.5)]
    )
    assert cycles.values.shape == (3, 101, 2)
    np.testing.assert_allclose(
        cycles.values[0, :, 0], np.sin(2 * np.pi * np.linspace(0, 1, 101)), atol=1e-3
    )
    np.testing.assert_allclose(cycles.values[1, :, 1], np.linspace(1, 2, 101), atol=1e-12)
    assert np.isnan(cycles.values[1, 35:55, 0]).all()
    assert np.isfinite(cycles.values[1, 65:, 0]).all()
    assert np.isnan(cycles.values[2, 55:, 1]).all()
    with pytest.raises(BadData, match="does not go forward"):
        over_cycles(Series(time, ("a",), values[:, :1]), [(1.0, 1.0)])


@pytest.mark.parametrize(("frames", "crossed"), [(199, True), (201, False)])
def test_a_line_crosses_gaps_up_to_a_tenth_of_the_cycle(frames, crossed):
    time = np.arange(2001) / 2000.0
    values = np.sin(time)[:, None]
    values[601 : 600 + frames] = np.nan
    curve = over_cycles(Series(time, ("a",), values), [(0.0, 1.0)]).values[0, :, 0]
    line = np.interp(0.35, time[[600, 600 + frames]], np.sin(time[[600, 600 + frames]]))
    np.testing.assert_allclose(curve[35], line if crossed else np.nan, rtol=1e-12)
    assert np.isfinite(np.delete(curve, range(31, 41))).all()


def test_intervals_hold_the_mean_as_often_as_they_say():
    rng = np.random.default_rng(2)
    held = []
    for _ in range(1000):
        one = band(rng.normal(3.0, 2.0, (5, 1)))
        held.append(one.low[0] < 3.0 < one.high[0])
    assert abs(np.mean(held) - 0.95) < 0.021
    few = band(np.array([[1.0], [np.nan]]))
    assert few.mean[0] == 1.0
    assert np.isnan(few.low[0])
    assert few.count[0] == 1

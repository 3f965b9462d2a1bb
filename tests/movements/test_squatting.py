"""Laws of the numbers of squats and rises: motions of known depth, tempo and number."""

from __future__ import annotations

import math

import numpy as np
import pytest

from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.body_curves import BodyCurves
from myomorph.lab.movements.part import MovementNumbers
from myomorph.lab.movements.rising import rises, rising
from myomorph.lab.movements.squatting import repetitions, squats
from myomorph.lab.movements.support_force import SupportForce

WEIGHT = 700.0


def smooth(time: np.ndarray, begin: float, length: float) -> np.ndarray:
    """From 0 to 1 with half a cosine.

    Parameters
    ----------
    time : (frames,) [s]
    begin, length : of the way [s]

    Returns
    -------
    (frames,)
    """
    share = np.clip((time - begin) / length, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * share)


def edge(length: float) -> float:
    """How long a half cosine takes for its first 5 %."""
    return length * math.acos(0.9) / math.pi


def squatted(
    depths: tuple[float, ...], rate: float = 100.0, noise: float = 0.0, end: float = 0.0
) -> BodyCurves:
    """Down in 1.2 s, 0.4 s at the bottom, up in 0.8 s, 1 s of standing between."""
    time = np.arange(0.0, 1.0 + 3.4 * len(depths) - end, 1.0 / rate)
    bend = np.full(len(time), 4.0)
    for index, depth in enumerate(depths):
        begin = 1.0 + 3.4 * index
        down = smooth(time, begin, 1.2)
        up = smooth(time, begin + 1.6, 0.8)
        bend += depth * (down - up)
    center = 1.0 - 0.004 * (bend - 4.0)
    bend += np.random.default_rng(2).normal(0.0, noise, len(time))
    clock = np.arange(0.0, time[-1], 0.005)
    torque = np.interp(clock, time, bend) / 100.0
    return BodyCurves(
        time=time,
        bend=bend,
        center=center,
        hips=center,
        lean=None,
        clock=clock,
        moments={of.KNEE_MOMENT_RIGHT: torque, of.KNEE_MOMENT_LEFT: np.full(len(clock), np.nan)},
    )


@pytest.mark.parametrize("disturbed", [{}, {"rate": 60.0}, {"rate": 250.0}, {"noise": 0.3}])
def test_each_repetition_has_its_depth_and_tempo(disturbed: dict) -> None:
    depths = (90.0, 104.0, 71.0)
    parts = squats(squatted(depths, **disturbed), None)
    assert len(parts) == 3
    for part, depth in zip(parts, depths, strict=True):
        assert part.number(of.KNEE_DEPTH) == pytest.approx(depth + 4.0, abs=1.2)
        assert part.number(of.CENTER_DROP) == pytest.approx(0.004 * depth, rel=0.06)
        assert part.number(of.DOWN_TIME) == pytest.approx(1.2 - 2.0 * edge(1.2), abs=0.06)
        assert part.number(of.UP_TIME) == pytest.approx(0.8 - 2.0 * edge(0.8), abs=0.06)
        bottom = 0.4 + edge(1.2) + edge(0.8)
        assert part.number(of.BOTTOM_TIME) == pytest.approx(bottom, abs=0.08)
        peak = (depth + 4.0) / 100.0
        assert part.number(of.KNEE_MOMENT_RIGHT) == pytest.approx(peak, abs=0.015)
        assert math.isnan(part.number(of.KNEE_MOMENT_LEFT))
        assert math.isnan(part.number(of.RIGHT_SHARE))


def test_mean_and_deviation_are_those_of_the_repetitions() -> None:
    numbers = MovementNumbers(
        one="repetition",
        many="repetitions",
        parts=squats(squatted((90.0, 104.0, 71.0)), None),
        quantities=of.SQUATTING,
    )
    summary = numbers.summary(of.KNEE_DEPTH, "")
    assert summary is not None
    assert summary.count == 3
    assert summary.mean == pytest.approx(4.0 + np.mean([90.0, 104.0, 71.0]), abs=0.5)
    assert summary.sd == pytest.approx(np.std([90.0, 104.0, 71.0], ddof=1), abs=0.5)
    assert of.RIGHT_SHARE not in numbers.known
    assert of.KNEE_DEPTH in numbers.known


def test_a_recording_that_ends_at_the_bottom_shows_no_way_up() -> None:
    curves = squatted((90.0,), end=2.1)
    (part,) = squats(curves, None)
    assert part.number(of.KNEE_DEPTH) == pytest.approx(94.0, abs=0.5)
    assert part.number(of.DOWN_TIME) == pytest.approx(1.2 - 2.0 * edge(1.2), abs=0.05)
    assert math.isnan(part.number(of.UP_TIME))


def test_a_recording_that_begins_on_the_way_shows_no_way_down() -> None:
    whole = squatted((90.0,))
    late = whole.time > 1.5
    (found,) = repetitions(whole.time[late], whole.bend[late])
    assert math.isnan(found.start)
    assert np.isfinite(found.stop)


def test_who_stands_does_not_squat() -> None:
    assert squats(squatted((8.0,)), None) == ()
    assert repetitions(np.arange(3.0), np.full(3, np.nan)) == ()


@pytest.mark.parametrize("share", [0.5, 0.44])
def test_the_share_of_a_leg_is_the_one_it_bore(share: float) -> None:
    curves = squatted((90.0,))
    clock = np.arange(0.0, float(curves.time[-1]), 0.001)
    whole = np.full(len(clock), WEIGHT)
    force = SupportForce.of(clock, WEIGHT, share * whole, (1.0 - share) * whole)
    (part,) = squats(curves, force)
    assert part.number(of.RIGHT_SHARE) == pytest.approx(100.0 * share, abs=0.2)


def test_plates_that_miss_a_part_of_the_weight_show_no_share() -> None:
    curves = squatted((90.0,))
    clock = np.arange(0.0, float(curves.time[-1]), 0.001)
    part_of_it = np.full(len(clock), 0.3 * WEIGHT)
    (part,) = squats(curves, SupportForce.of(clock, WEIGHT, part_of_it, part_of_it))
    assert math.isnan(part.number(of.RIGHT_SHARE))


def rose(count: int, rate: float = 100.0, noise: float = 0.0) -> BodyCurves:
    """Lean from 10 to 45 degrees in 0.6 s, rise 0.45 m in 1 s from 0.4 s on, sit down again."""
    time = np.arange(0.0, 1.0 + 4.0 * count, 1.0 / rate)
    hips = np.full(len(time), 0.5)
    lean = np.full(len(time), 10.0)
    for index in range(count):
        begin = 1.0 + 4.0 * index
        hips += 0.45 * (smooth(time, begin + 0.4, 1.0) - smooth(time, begin + 2.2, 1.0))
        lean += 35.0 * (smooth(time, begin, 0.6) - smooth(time, begin + 0.7, 0.7))
        lean += 30.0 * (smooth(time, begin + 2.0, 0.6) - smooth(time, begin + 2.7, 0.6))
    random = np.random.default_rng(7)
    return BodyCurves(
        time=time,
        bend=np.zeros(len(time)),
        center=hips + random.normal(0.0, noise, len(time)),
        hips=hips + random.normal(0.0, noise, len(time)),
        lean=lean,
        clock=time,
        moments={of.KNEE_MOMENT_RIGHT: hips},
    )


@pytest.mark.parametrize("disturbed", [{}, {"rate": 60.0}, {"rate": 250.0}, {"noise": 0.001}])
@pytest.mark.parametrize("count", [1, 5])
def test_each_rise_has_its_times(count: int, disturbed: dict) -> None:
    parts = rising(rose(count, **disturbed), None)
    assert len(parts) == count
    for part in parts:
        leaves = 0.4 + edge(1.0)
        stands = 1.4 - edge(1.0)
        begins = edge(0.6)
        assert part.number(of.RISE_TIME) == pytest.approx(stands - begins, abs=0.05)
        assert part.number(of.MOMENTUM_TIME) == pytest.approx(leaves - begins, abs=0.05)
        assert part.number(of.EXTENSION_TIME) == pytest.approx(stands - leaves, abs=0.05)
        assert part.number(of.TRUNK_LEAN) == pytest.approx(45.0, abs=0.5)
        assert part.number(of.KNEE_MOMENT_RIGHT) == pytest.approx(0.93, abs=0.04)
        assert math.isnan(part.number(of.PEAK_VERTICAL_FORCE))


def test_the_peak_force_is_the_measured_one() -> None:
    curves = rose(1)
    clock = np.arange(0.0, float(curves.time[-1]), 0.001)
    under = np.interp(clock, [1.4, 1.7, 2.2], [0.2, 1.25, 1.0]) * WEIGHT
    force = SupportForce.of(clock, WEIGHT, 0.5 * under, 0.5 * under)
    (part,) = rising(curves, force)
    assert part.number(of.PEAK_VERTICAL_FORCE) == pytest.approx(1.25, rel=0.01)
    assert part.number(of.RIGHT_SHARE) == pytest.approx(50.0, abs=0.1)


def test_who_stands_does_not_rise() -> None:
    time = np.arange(0.0, 3.0, 0.01)
    assert rises(time, np.full(len(time), 0.9)) == ()
    assert rises(time, np.full(len(time), np.nan)) == ()


def test_a_trunk_that_was_not_seen_has_no_momentum_phase() -> None:
    seen = rose(1)
    curves = BodyCurves(
        time=seen.time,
        bend=seen.bend,
        center=seen.center,
        hips=seen.hips,
        lean=None,
        clock=seen.clock,
        moments={},
    )
    (part,) = rising(curves, None)
    assert math.isnan(part.number(of.RISE_TIME))
    assert part.number(of.EXTENSION_TIME) == pytest.approx(1.0 - 2.0 * edge(1.0), abs=0.05)

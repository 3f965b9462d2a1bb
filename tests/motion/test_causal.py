import numpy as np
import pytest
from scipy.signal import bessel

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.motion.causal import HALF_POWER, CausalFilter, CausalStream


def test_it_is_the_bessel_filter_of_scipy() -> None:
    filter = CausalFilter(7.0)
    top, bottom = bessel(4, 1.0, analog=True, norm="delay")
    at = np.array([0.5, 2.0, 7.0, 20.0])
    x = 2j * np.pi * at * filter.delay
    np.testing.assert_allclose(
        filter.response(at), np.polyval(top, x) / np.polyval(bottom, x), rtol=1e-12
    )
    assert abs(filter.response(np.array(7.0))) ** 2 == pytest.approx(0.5, abs=1e-12)
    assert filter.delay == pytest.approx(HALF_POWER / (2.0 * np.pi * 7.0))


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0, 3.0])
def test_what_it_passes_comes_late_by_the_delay_alone(frequency: float) -> None:
    """Up to half of the cutoff the phase is that of the delay, to a thousandth of a radian."""
    filter = CausalFilter(6.0)
    phase = -np.angle(filter.response(np.array(frequency)))
    assert phase == pytest.approx(2.0 * np.pi * frequency * filter.delay, abs=1e-3)


def test_value_velocity_and_acceleration_of_a_sine() -> None:
    """The output is the filter's answer to a sine and its derivatives.

    It is exact up to the lines between samples.
    """
    filter = CausalFilter(6.0)
    frequency = 1.5
    omega = 2.0 * np.pi * frequency
    time = np.arange(0.0, 3.0, 0.002)
    found = filter.motion(Motion(time, ("a",), np.sin(omega * time)[:, None]))
    answer = filter.response(np.array(frequency)) * np.exp(1j * omega * time)
    late = time > 1.0
    for values, order in ((found.values, 0), (found.velocities, 1), (found.accelerations, 2)):
        assert values is not None
        exact = np.imag((1j * omega) ** order * answer)
        np.testing.assert_allclose(values[late, 0], exact[late], atol=1e-4 * omega**order)


def test_a_line_lags_by_the_delay_and_keeps_its_slope() -> None:
    filter = CausalFilter(6.0)
    time = np.arange(0.0, 3.0, 0.01)
    found = filter.motion(Motion(time, ("a",), (2.0 + 3.0 * time)[:, None]))
    assert found.velocities is not None
    assert found.accelerations is not None
    late = time > 2.0
    np.testing.assert_allclose(
        found.values[late, 0], 2.0 + 3.0 * (time[late] - filter.delay), atol=1e-9
    )
    np.testing.assert_allclose(found.velocities[late, 0], 3.0, atol=1e-8)
    np.testing.assert_allclose(found.accelerations[late, 0], 0.0, atol=1e-6)


def test_more_samples_on_the_same_lines_change_nothing() -> None:
    """The filter's equation is solved exactly along each line.

    This holds at uneven times too, and over a gap.
    """
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.002, 0.05, 60))
    rows = rng.standard_normal((60, 3))
    between = np.sort(np.r_[time, rng.uniform(time[0], time[-1], 200)])
    lines = np.stack([np.interp(between, time, column) for column in rows.T], axis=1)
    few = CausalStream(CausalFilter(5.0), 3)
    many = CausalStream(CausalFilter(5.0), 3)
    few.push(time, rows)
    many.push(between, lines)
    np.testing.assert_allclose(
        few.at(float(time[-1])), many.at(float(time[-1])), rtol=1e-8, atol=1e-8
    )


def test_missing_rows_are_bridged() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(80) / 100.0
    rows = rng.standard_normal((80, 2))
    holed = rows.copy()
    holed[40:43, 1] = np.nan
    kept = np.isfinite(holed).all(axis=1)
    one = CausalStream(CausalFilter(8.0), 2)
    other = CausalStream(CausalFilter(8.0), 2)
    one.push(time, holed)
    other.push(time[kept], rows[kept])
    np.testing.assert_array_equal(one.at(0.79), other.at(0.79))


def test_chunks_make_no_difference_and_later_times_hold_the_last_row() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(100) / 100.0
    rows = rng.standard_normal((100, 2))
    one = CausalStream(CausalFilter(8.0), 2)
    other = CausalStream(CausalFilter(8.0), 2)
    held = CausalStream(CausalFilter(8.0), 2)
    one.push(time, rows)
    for frame in range(100):
        other.push(time[frame : frame + 1], rows[frame : frame + 1])
    np.testing.assert_array_equal(one.at(0.99), other.at(0.99))
    held.push(np.r_[time, 1.02], np.vstack([rows, rows[-1]]))
    np.testing.assert_allclose(one.at(1.02), held.at(1.02), atol=1e-9)
    # Looking ahead leaves the state as it was.
    np.testing.assert_array_equal(one.at(0.99), other.at(0.99))


def test_nothing_is_told_before_it_has_settled() -> None:
    filter = CausalFilter(6.0)
    time = np.arange(0.0, 1.0, 0.01)
    found = filter.motion(Motion(time, ("a",), np.ones((100, 1))))
    known = np.isfinite(found.values[:, 0])
    assert time[known][0] == pytest.approx(filter.settling, abs=0.011)
    np.testing.assert_allclose(found.values[known], 1.0)
    for bad in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(BadData, match="cutoff"):
            CausalFilter(bad)

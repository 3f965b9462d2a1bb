from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.online import (
    MovingWindow,
    OnlineFilter,
    OnlineKinematics,
    SteadyFrame,
    SteadyKinematics,
)


def test_parabolas_are_differentiated_exactly() -> None:
    filter = OnlineFilter(100.0, 6.0)
    time = np.arange(200) / 100.0
    found = filter.motion(Motion(time, ("a",), (3.0 - 2.0 * time + 0.7 * time**2)[:, None]))
    np.testing.assert_allclose(found.velocities[:, 0], -2.0 + 1.4 * found.time, atol=1e-10)  # type: ignore[index]
    np.testing.assert_allclose(found.accelerations[:, 0], 1.4, atol=1e-8)  # type: ignore[index]


@pytest.mark.parametrize(("rate", "cutoff"), [(100.0, 6.0), (250.0, 10.0), (60.0, 7.5)])
def test_power_is_halved_at_the_cutoff(rate: float, cutoff: float) -> None:
    """A sine at the cutoff comes out with 1/sqrt(2) of its amplitude and no shift.

    Far above the cutoff it comes out as zero.
    """
    filter = OnlineFilter(rate, cutoff)
    time = np.arange(0.0, 4.0, 1.0 / rate)
    middle = time[filter.half : -filter.half]
    passed = filter.values(np.sin(2 * np.pi * cutoff * time))
    np.testing.assert_allclose(
        passed, np.sin(2 * np.pi * cutoff * middle) / np.sqrt(2.0), atol=2e-3
    )
    if 5.0 * cutoff < 0.5 * rate:
        assert np.abs(filter.values(np.sin(2 * np.pi * 5.0 * cutoff * time))).max() < 1e-3


def test_derivatives_are_those_of_the_filtered_motion() -> None:
    """Velocity and acceleration agree with the sine that comes out.

    At walking's frequencies they agree to a thousandth.
    """
    filter = OnlineFilter(100.0, 6.0)
    time = np.arange(400) / 100.0
    omega = 2 * np.pi * 2.0
    found = filter.motion(Motion(time, ("a",), np.sin(omega * time)[:, None]))
    np.testing.assert_allclose(
        found.velocities[1:-1, 0], np.gradient(found.values[:, 0], 0.01)[1:-1], atol=0.02 * omega
    )  # type: ignore[index]
    gain = float(np.abs(found.values).max())
    assert np.abs(found.velocities).max() == pytest.approx(gain * omega, rel=0.05)  # type: ignore[type-var]
    assert np.abs(found.accelerations).max() == pytest.approx(gain * omega**2, rel=0.05)  # type: ignore[type-var]


def test_frame_by_frame_is_the_whole_at_once() -> None:
    filter = OnlineFilter(120.0, 7.0)
    rng = np.random.default_rng(0)
    time = np.arange(90) / 120.0
    values = rng.standard_normal((90, 4))
    values[40, 2] = np.nan
    whole = filter.motion(Motion(time, tuple("abcd"), values))
    window = MovingWindow(filter, 4)
    rows = []
    for moment, row in zip(time, values, strict=True):
        window.push(moment, row)
        if window.full:
            assert window.time == pytest.approx(whole.time[len(rows)])
            rows.append(window.filtered)
    found = np.array(rows)
    np.testing.assert_allclose(found[:, 0], whole.values, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], whole.velocities, atol=1e-9)  # type: ignore[arg-type]
    np.testing.assert_allclose(found[:, 2], whole.accelerations, atol=1e-7)  # type: ignore[arg-type]
    assert np.isnan(found[:, 0, 2]).sum() == 2 * filter.half + 1


@pytest.mark.parametrize(
    ("rate", "cutoff", "told"),
    [(0.0, 6.0, "rate"), (100.0, 0.0, "cutoff"), (100.0, 30.0, "at most an eighth")],
)
def test_impossible_filters_are_refused(rate: float, cutoff: float, told: str) -> None:
    with pytest.raises(BadData, match=told):
        OnlineFilter(rate, cutoff)


def test_independent_samples_of_filtered_noise() -> None:
    """White noise that is filtered has as many independent samples as its mean's variance tells."""
    filter = OnlineFilter(100.0, 6.0)
    noise = filter.values(np.random.default_rng(0).standard_normal((4000, 200)))
    ratio = len(noise) * noise.mean(axis=0).var() / noise.var()
    assert ratio == pytest.approx(filter.frames_per_sample, rel=0.2)


def test_uneven_frames_are_refused() -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(0.005, 0.02, 100))
    with pytest.raises(BadData, match="evenly spaced"):
        OnlineFilter(100.0).motion(Motion(time, ("a",), np.zeros((100, 1))))


def test_single_frames_agree_with_the_batch(data: Callable[[str], Path]) -> None:
    """Inverse kinematics frame by frame finds the poses that the batch finds.

    It recovers after a gap.
    """
    folder = data("opensim-gait-subject01")
    model = read_model(folder / "ref_ik/subject01_simbody.osim")
    markers = read_trc(folder / "experiment/subject01_walk1.trc").markers
    assert markers is not None
    frames = slice(0, 120)
    fit = inverse_kinematics(
        model, type(markers)(markers.time[frames], markers.names, markers.values[frames])
    )
    online = OnlineKinematics(model, markers.names)
    for i in range(120):
        positions = np.full_like(markers.values[i], np.nan) if 50 <= i < 60 else markers.values[i]
        values, error = online.solve(markers.time[i], positions)
        if 50 <= i < 60:
            assert np.isnan(values).all()
        else:
            assert error == pytest.approx(fit.rms[i], rel=1e-3)
            np.testing.assert_allclose(values, fit.motion.values[i], atol=1e-3)


@pytest.mark.parametrize("kinematics", [OnlineKinematics, SteadyKinematics])
def test_a_stream_begins_no_whole_turn_away(
    data: Callable[[str], Path], kinematics: type[OnlineKinematics] | type[SteadyKinematics]
) -> None:
    """A shoulder without bounds begins at the angle that the batch finds.

    Of the poses from several headings the best has it a full rotation away at 0.3 s of this walk.
    """
    folder = data("rajagopal-walk-emg")
    model = read_model(folder / "subject_walk_scaled.osim")
    markers = read_trc(folder / "markers_walk.trc").markers
    assert markers is not None
    begin = int(np.searchsorted(markers.time, 0.3))
    first = slice(begin, begin + 2)
    batch = inverse_kinematics(
        model, type(markers)(markers.time[first], markers.names, markers.values[first])
    )
    solved = kinematics(model, markers.names).solve(markers.time[begin], markers.values[begin])
    coordinates = solved.coordinates if isinstance(solved, SteadyFrame) else solved[0]
    np.testing.assert_allclose(coordinates, batch.motion.values[0], atol=1e-2)

"""Repeated and missing frames are found where they are, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.motion.lost_frames import FROZEN, LOST, lost_findings

RATE = 100.0
NAMES = tuple(f"m{number}" for number in range(12))


def walk(seed: int = 7, noise: float = 0.0005) -> mm.Markers:
    """Markers that go ahead at 1.2 m/s and swing about each other."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 3.0, 1.0 / RATE)
    phase = rng.uniform(0.0, 6.0, (1, len(NAMES), 3))
    size = rng.uniform(0.01, 0.1, (1, len(NAMES), 3))
    values = rng.uniform(-0.5, 0.5, (1, len(NAMES), 3)) + size * np.sin(
        2.0 * np.pi * time[:, None, None] + phase
    )
    values[..., 0] += 1.2 * time[:, None]
    return mm.Markers(time, NAMES, values + rng.normal(0.0, noise, values.shape))


def found(markers: mm.Markers) -> list[tuple[str, tuple]]:
    return [(item.kind, item.times) for item in lost_findings(markers, NAMES)]


@pytest.mark.parametrize("seed", range(8))
def test_a_recording_without_faults_passes(seed):
    assert found(walk(seed)) == []


@pytest.mark.parametrize("frames", [2, 4, 11])
def test_missing_frames_are_found_where_they_are(frames):
    whole = walk()
    values = np.delete(whole.values, slice(140, 140 + frames), axis=0)
    ((kind, ((start, stop),)),) = found(mm.Markers(whole.time[: len(values)], NAMES, values))
    assert kind == LOST
    assert start == stop
    assert abs(start - 1.40) <= 0.011


def test_how_many_are_missing_is_said():
    whole = walk(noise=0.0)
    values = np.delete(whole.values, slice(140, 146), axis=0)
    (finding,) = lost_findings(mm.Markers(whole.time[: len(values)], NAMES, values), NAMES)
    assert "6 frames" in str(finding)


@pytest.mark.parametrize("frames", [4, 15])
def test_repeated_frames_are_found_with_their_times(frames):
    values = np.array(walk().values)
    values[100 : 100 + frames] = values[100]
    ((kind, ((start, stop),)),) = found(mm.Markers(walk().time, NAMES, values))
    assert kind == FROZEN
    assert (round(start, 3), round(stop, 3)) == (1.0, round(1.0 + (frames - 1) / RATE, 3))


def test_a_recording_that_stands_still_is_not_frozen():
    values = np.tile(walk().values[:1], (200, 1, 1))
    assert found(mm.Markers(np.arange(200) / RATE, NAMES, values)) == []


def test_hidden_markers_are_no_jump():
    values = np.array(walk().values)
    values[120:160, :5] = np.nan
    values[150:170, 6:] = np.nan
    assert found(mm.Markers(walk().time, NAMES, values)) == []

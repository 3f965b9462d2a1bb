"""The line that `muscles` prints: ends of fiber lengths, fastest shortening, jumps of paths."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.model import GROUND
from myomorph.lab.report.trial.summary_lines import muscles_line
from myomorph.lab.study.workers.ahead import two_links

TIME = np.linspace(0.0, 1.0, 101)


def smooth(model, low, high):
    """Path lengths whose fibers work between two normalized lengths, and their exact velocities."""
    one = model.muscles[0]
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low)
    phase = 2.0 * np.pi * TIME[:, None]
    lengths = one.tendon_slack_length + one.optimal_fiber_length * (middle - half * np.cos(phase))
    return lengths, one.optimal_fiber_length * half * 2.0 * np.pi * np.sin(phase)


@pytest.fixture
def model():
    found = two_links()
    assert GROUND not in found.body_names
    return found


def test_ends_of_fiber_lengths_with_muscle_and_time(model):
    line = muscles_line(model, TIME, *smooth(model, 0.6, 1.4))
    assert line.startswith(
        "101 frames, 1 muscles: fibers 0.60 (muscle_0 at 0.00 s) to 1.40 (muscle_0 at 0.50 s)"
    )
    assert "within 0.5 to 1.5" in line
    assert "muscle_0 outside 0.5 to 1.5" in muscles_line(model, TIME, *smooth(model, 0.6, 1.6))


def test_shortening_counts_in_shares_of_what_the_muscle_can_do(model):
    """0.4 pi optimal lengths a second, of 10 that the muscle has."""
    line = muscles_line(model, TIME, *smooth(model, 0.8, 1.2))
    assert (
        "fastest shortening 12.6 % of the greatest velocity (muscle_0 at 0.75 s): below it" in line
    )
    quick = muscles_line(
        model, 0.01 * TIME, smooth(model, 0.8, 1.2)[0], 100.0 * smooth(model, 0.8, 1.2)[1]
    )
    assert "muscle_0 too fast to pull" in quick


def test_a_path_that_leaves_its_surface_jumps(model):
    lengths, velocities = smooth(model, 0.8, 1.2)
    assert "no path jumps" in muscles_line(model, TIME, lengths, velocities)
    lengths = lengths + 0.004 * (TIME > 0.305)[:, None]
    line = muscles_line(model, TIME, lengths, velocities)
    assert "(muscle_0 by 4.0 mm at 0.31 s)" in line


def test_frames_without_coordinates_are_passed_over(model):
    lengths, velocities = smooth(model, 0.6, 1.4)
    lengths[40:45] = np.nan
    velocities[40:45] = np.nan
    assert "1.40 (muscle_0 at 0.50 s)" in muscles_line(model, TIME, lengths, velocities)

"""Derivatives of poses in the places of markers, against poses that are solved for anew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.formats import read_model, read_trial
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    inverse_kinematics,
    poses_near,
    tracked_markers,
)
from myomorph.live.online_errors import SlopeFinder
from myomorph.show.demo.arm import example_files


def test_what_they_leave_out_falls_with_the_square_of_the_errors(tmp_path: Path) -> None:
    files = example_files(tmp_path)
    options = InverseKinematicsOptions()
    model = read_model(files.model)
    markers = read_trial(files.markers).markers
    assert markers is not None
    exact = inverse_kinematics(model, markers, options).motion
    names, weights = tracked_markers(model, markers, options)
    columns = [markers.names.index(name) for name in names]
    seen = np.isfinite(markers.values[:, columns]).all(axis=2)
    slopes = SlopeFinder(model=model, names=names, weights=weights, options=options).at(
        exact.values, seen
    )
    shift = np.random.default_rng(0).normal(size=markers.values.shape)
    left = []
    for size in (0.004, 0.001):
        moved = replace(markers, values=markers.values + size * shift)
        solved = poses_near(model, moved, exact, options).values - exact.values
        linear = np.einsum("fcm,fm->fc", slopes, size * shift[:, columns].reshape(len(shift), -1))
        left.append(np.abs(solved - linear).max() / np.abs(solved).max())
    assert left[0] < 0.1
    assert left[1] == pytest.approx(left[0] / 4.0, rel=0.5)

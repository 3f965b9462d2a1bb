"""Errors of contact forces beside a constant guess: known estimates of a known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.sto import write_sto
from myomorph.core.model.series import Series, Table
from myomorph.show.demo.performances import Written, contact_rows

TIME = np.linspace(0.0, 1.0, 101)
SWING = np.sin(2.0 * np.pi * TIME)
TRUE = np.stack([0.0 * TIME, 300.0 + 100.0 * SWING, 0.0 * TIME], axis=1)


def row_of(folder: Path, estimate: np.ndarray) -> dict[str, object]:
    """Compare an estimate of the one contact's force with the truth.

    Parameters
    ----------
    folder : to write results to
    estimate : (frames, 3) [N]

    Returns
    -------
    its row of errors
    """
    results = folder / "trial"
    results.mkdir()
    names = tuple(f"foot_f{axis}" for axis in "xyz")
    write_sto(Table(TIME, names, estimate, in_degrees=False), results / "contact_groups.sto")
    nothing = Series(TIME, (), np.empty((len(TIME), 0)))
    written = Written(
        study=folder / "study.toml",
        results=Path("trial"),
        forces=Series(TIME, ("foot",), TRUE[:, None]),
        torques=nothing,
        activations=nothing,
    )
    (row,) = contact_rows(written, folder)
    return row


@pytest.mark.parametrize(
    ("scale", "offset", "expected"),
    [
        (1.0, 0.0, 100.0),
        (0.5, 0.0, 75.0),
        (0.0, 0.0, 0.0),
        (-1.0, 0.0, -300.0),
        (1.0, 200.0, -700.0),
    ],
    ids=["right", "half", "constant", "reversed", "too heavy"],
)
def test_a_constant_guess_has_no_skill(tmp_path, scale, offset, expected):
    """Of a swing of 100 N an estimate of half has three quarters; the mean itself has none."""
    estimate = TRUE.copy()
    estimate[:, 1] = 300.0 + offset + scale * 100.0 * SWING
    row = row_of(tmp_path, estimate)
    # The samples hold both ends of a whole period.
    assert row["skill against it [%]"] == pytest.approx(expected, abs=10.0)
    assert row["skill, vertical [%]"] == row["skill against it [%]"]
    assert row["a constant guess, RMS [N]"] == pytest.approx(100.0 / np.sqrt(2.0), rel=0.01)


def test_only_frames_that_were_estimated_count(tmp_path):
    """A constant guess is judged where the estimate is."""
    estimate = TRUE.copy()
    estimate[50:] = np.nan
    row = row_of(tmp_path, estimate)
    assert row["skill against it [%]"] == pytest.approx(100.0)
    assert row["a constant guess, RMS [N]"] == pytest.approx(TRUE[:50, 1].std(), rel=0.05)

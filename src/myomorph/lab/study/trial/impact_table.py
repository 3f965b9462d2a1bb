"""The table of impacts that were heard: when, by which site, on what, and how hard."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.contact.impacts import Impact
from myomorph.core.io.parsing.text import write_csv

COLUMNS = (
    "time",
    "site",
    "instrument",
    "impulse",
    "impulse_low",
    "impulse_high",
    "site_confidence",
)


def write_impacts(impacts: Sequence[Impact], path: Path) -> None:
    """Impacts as a table; cells are empty where nothing shows the limits of an impulse.

    Parameters
    ----------
    impacts : in the order of time
    path : of the table
    """
    rows = [
        (
            f"{impact.time:.4f}",
            impact.site,
            impact.instrument,
            _cell(impact.impulse),
            _cell(impact.low),
            _cell(impact.high),
            f"{impact.confidence:.3f}",
        )
        for impact in impacts
    ]
    write_csv(path, COLUMNS, rows)


def _cell(value: float) -> str:
    """Write an impulse [N s]; "" where it is not known."""
    return f"{value:.4g}" if np.isfinite(value) else ""

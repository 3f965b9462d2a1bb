"""Where forces act on feet: how far a center of pressure must lie from a sole to be looked at."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.contact import force_placement
from myomorph.contact.force_placement import FITS, MARKED, NEAR, Remedy, check_origins
from myomorph.contact.force_samples import ForceSamples

UNIT = 0.8


@pytest.mark.parametrize(
    ("before", "after", "mended"),
    [
        (1.01 * NEAR, 0.0, True),
        (0.99 * NEAR, 0.0, False),
        (1.01 * NEAR, 0.99 * MARKED * 1.01 * NEAR, True),
        (1.01 * NEAR, 1.01 * MARKED * 1.01 * NEAR, False),
        (1.0, 0.99 * FITS, True),
        (1.0, 1.01 * FITS, False),
    ],
)
def test_an_origin_is_changed_only_from_far_to_near(monkeypatch, before, after, mended):
    """Distances are shares of the foot's; a change must leave less than `FITS`, and than `MARKED` of those before."""
    remedy = Remedy("units", "", "", "", lambda force, point, torque: (force, point, torque))
    monkeypatch.setattr(force_placement, "_remedies", lambda inspection, number: [remedy])
    zero = np.zeros((2, 1, 3))
    changed, found = [], []
    inspection = SimpleNamespace(
        numbers=[0],
        feet=SimpleNamespace(unit=UNIT),
        samples=ForceSamples(zero, zero, zero, np.ones((2, 1), bool)),
        misfit=lambda number, samples=None: UNIT * (before if samples is None else after),
        change=lambda number, change: changed.append((number, change)),
        found=lambda *what: found.append(what),
        name=lambda number: "ForcePlate1",
    )
    check_origins(inspection)
    assert changed == ([(0, remedy.change)] if mended else [])
    assert len(found) == len(changed)

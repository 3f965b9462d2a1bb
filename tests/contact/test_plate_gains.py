"""A plate of another sensitivity is named; plates that agree, and a wrong mass, are not it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.contact.test_force_checks import clean  # noqa: F401

from myomorph.core.contact.force_checks import checked_forces


def gained(recorded, factor):
    """Forces of one plate multiplied."""
    loads = np.abs(recorded.wrenches.forces[..., 1]).sum(axis=0)
    number = int(np.argmax(loads))
    forces = np.array(recorded.wrenches.forces)
    torques = np.array(recorded.wrenches.torques)
    forces[:, number] *= factor
    torques[:, number] *= factor
    return number, replace(recorded.wrenches, forces=forces, torques=torques)


@pytest.mark.parametrize("factor", [0.75, 1.3])
def test_a_plate_that_measures_another_share_is_named(clean, factor):  # noqa: F811
    number, wrenches = gained(clean, factor)
    found = checked_forces(wrenches, clean.model, clean.motion).findings
    gains = [one for one in found if one.kind == "gain"]
    assert [one.place for one in gains] == [wrenches.names[number]]
    assert gains[0].text.size == pytest.approx(100.0 * (factor - 1.0), abs=9.0)
    assert gains[0].text.cause.key == "weight"


def test_plates_that_agree_are_not_named(clean):  # noqa: F811
    found = checked_forces(clean.wrenches, clean.model, clean.motion).findings
    assert "gain" not in {one.kind for one in found}

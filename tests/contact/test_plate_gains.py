"""A plate of another sensitivity is named; plates that agree, and a wrong mass, are not it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.faults import faults

from myomorph.core.contact.force_checks import checked_forces

WALKS = ("gait2354 walk", "OpenCap walk")
BY_NAME = {one.name: one for one in faults.CLEAN}


@pytest.fixture(scope="module", params=WALKS)
def clean(request, data):
    """Open a walk whose model weighs what its plates carry."""
    walk = BY_NAME[request.param]
    for path in (walk.model, walk.motion, walk.loads):
        data(path)
    return faults.of_its_mass(data(walk.model.split("/")[0]).parent, walk)


def gained(recorded, factor):
    """Multiply the forces of one plate."""
    loads = np.abs(recorded.wrenches.forces[..., 1]).sum(axis=0)
    number = int(np.argmax(loads))
    forces = np.array(recorded.wrenches.forces)
    torques = np.array(recorded.wrenches.torques)
    forces[:, number] *= factor
    torques[:, number] *= factor
    return number, replace(recorded.wrenches, forces=forces, torques=torques)


@pytest.mark.parametrize("factor", [0.75, 1.3])
def test_a_plate_that_measures_another_share_is_named(clean, factor):
    number, wrenches = gained(clean, factor)
    found = checked_forces(wrenches, clean.model, clean.motion).findings
    gains = [one for one in found if one.kind == "gain"]
    assert [one.place for one in gains] == [wrenches.names[number]]
    assert gains[0].text.size == pytest.approx(100.0 * (factor - 1.0), abs=9.0)
    assert gains[0].text.cause.key == "weight"


def test_plates_that_agree_are_not_named(clean):
    found = checked_forces(clean.wrenches, clean.model, clean.motion).findings
    assert "gain" not in {one.kind for one in found}

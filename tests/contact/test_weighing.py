"""Masses are weighed where somebody rises from a seat, and where two feet share a plate.

Truth: recordings whose model was made heavier or lighter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.faults import faults

from myomorph.core.contact.force_checks import BODY_CHECKS, checked_forces

RISE = next(one for one in faults.CLEAN if one.name == "OpenCap sit-to-stand")
JUMP = next(one for one in faults.CLEAN if one.name == "OpenCap drop jump")


def opened(recording, data):
    """Open a recording whose model weighs what its plates carry."""
    for path in (recording.model, recording.motion, recording.loads):
        data(path)
    return faults.of_its_mass(data(recording.model.split("/")[0]).parent, recording)


def masses(recorded, checks=()):
    """Find masses."""
    found = checked_forces(recorded.wrenches, recorded.model, recorded.motion, checks=checks)
    return [finding for finding in found.findings if finding.kind.startswith("mass")]


@pytest.mark.parametrize("factor", [0.8, 1.2, 2.2])
def test_somebody_who_rises_is_weighed_while_standing(data, factor):
    """A seat carries a part of the weight in most frames."""
    (finding,) = masses(faults.scaled_mass(factor)(opened(RISE, data)))
    assert finding.text.size == pytest.approx(100.0 * (factor - 1.0), abs=12.0 * factor)


def test_a_seat_is_no_lighter_body(data):
    assert masses(opened(RISE, data)) == []


def on_one_plate(recorded):
    """Put both feet on one plate: its center of pressure lies between them."""
    wrenches = recorded.wrenches
    force = wrenches.forces.sum(axis=1, keepdims=True)
    moment = np.cross(np.nan_to_num(wrenches.points), wrenches.forces).sum(axis=1, keepdims=True)
    lift = np.where(force[..., 1:2] > 20.0, force[..., 1:2], np.inf)
    point = np.cross(np.array([0.0, 1.0, 0.0]), moment) / lift
    return replace(
        recorded,
        wrenches=replace(
            wrenches,
            names=("plate",),
            bodies=("",),
            forces=force,
            points=point,
            torques=np.zeros_like(force),
        ),
    )


@pytest.mark.parametrize(("factor", "named"), [(0.8, True), (1.0, False), (1.25, True)])
def test_a_plate_that_two_feet_share_weighs_the_body(data, factor, named):
    recorded = on_one_plate(faults.scaled_mass(factor)(opened(JUMP, data)))
    assert bool(masses(recorded, BODY_CHECKS)) is named

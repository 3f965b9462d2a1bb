"""One plate that is turned under somebody who rises or walks is named, and nothing is repaired.

Truth: recordings in which forces and points of one plate are turned about its middle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.faults import faults

from myomorph.core.contact.force_checks import checked_forces
from myomorph.core.contact.force_inspection import TURNED_PLATE

RECORDINGS = ("OpenCap sit-to-stand", "OpenCap drop jump", "OpenCap walk", "gait2354 walk")
BY_NAME = {one.name: one for one in faults.CLEAN}
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


@pytest.fixture(scope="module", params=RECORDINGS)
def clean(request, data):
    """Open a recording whose model weighs what its plates carry."""
    recording = BY_NAME[request.param]
    for path in (recording.model, recording.motion, recording.loads):
        data(path)
    return faults.of_its_mass(data(recording.model.split("/")[0]).parent, recording)


def turned(wrenches, number, quarters):
    """Turn forces and points of one plate about the middle of its points."""
    turn = np.linalg.matrix_power(QUARTER, quarters)
    forces = np.array(wrenches.forces)
    points = np.nan_to_num(wrenches.points)
    loaded = np.linalg.norm(forces[:, number], axis=1) > 30.0
    on_plate = points[loaded, number]
    center = 0.5 * (on_plate.min(axis=0) + on_plate.max(axis=0))
    forces[:, number] = forces[:, number] @ turn.T
    points[:, number] = (points[:, number] - center) @ turn.T + center
    return replace(wrenches, forces=forces, points=points)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_plate_is_named(clean, quarters):
    number = int(np.argmax(np.abs(clean.wrenches.forces[..., 1]).sum(axis=0)))
    faulty = turned(clean.wrenches, number, quarters)
    found = checked_forces(faulty, clean.model, clean.motion)
    (finding,) = [one for one in found.findings if one.kind == TURNED_PLATE]
    assert finding.place == clean.wrenches.names[number]
    assert ("180" if quarters == 2 else "90") in finding.text
    assert finding.text.severity == "changes results"
    # Axes of all plates were exchanged in its place, and torques were wrong in silence.
    assert not any(one.kind in ("mirrored axis", "walking direction") for one in found.findings)


def test_plates_that_agree_are_not_named(clean):
    found = checked_forces(clean.wrenches, clean.model, clean.motion)
    assert TURNED_PLATE not in {one.kind for one in found.findings}


def test_plates_that_are_turned_together_are_put_right(clean):
    """They are no single plate's fault."""
    faulty = faults.turned(clean)
    found = checked_forces(faulty.wrenches, clean.model, clean.motion)
    assert TURNED_PLATE not in {one.kind for one in found.findings}
    assert any(one.repaired for one in found.findings)

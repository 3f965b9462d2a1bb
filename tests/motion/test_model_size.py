"""A model of another person's size is named, one of this person's is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.test_marker_checks import RECORDINGS

from myomorph.core.model.scale import scale
from myomorph.core.motion.marker_checks import checked_kinematics
from myomorph.lab.study.inputs.reading import fitted_to, open_model, read_recording


def sizes(model, markers):
    """Return findings on the size of the model."""
    found = checked_kinematics(model, markers)
    return [one for one in found.findings if one.kind == "size of the model"]


@pytest.fixture(params=RECORDINGS)
def walk(request, data):
    """Open a scaled model and a clean walk of 40 frames."""
    model, recording = map(data, RECORDINGS[request.param])
    body = open_model(model)
    markers = fitted_to(body, read_recording(recording)).markers
    return body, replace(markers, time=markers.time[:40], values=markers.values[:40])


@pytest.mark.parametrize("factor", [0.88, 1.12])
def test_a_model_of_another_person_is_named(walk, factor):
    model, markers = walk
    other = scale(model, {body.name: np.full(3, factor) for body in model.bodies})
    (finding,) = sizes(other, markers)
    assert finding.text.severity == "changes results"
    assert finding.text.size == pytest.approx(100.0 * (1.0 / factor - 1.0), abs=4.0)


def test_the_person_s_own_model_is_not(walk):
    assert not sizes(*walk)

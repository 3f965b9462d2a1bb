"""Labels exchanged throughout are corrected on a model of any size.

This comes before lengths and marker positions are known.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.faults import marker_faults as faults

from myomorph.core.model.series import Markers
from myomorph.core.motion.label_repair import repaired_labels
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.session.recordings import bare, look_at, sites_of

RECORDINGS = (
    "c3d-vendor-samples/C3DSamples/others/FunctionalWalk.c3d",
    "lifting-box-15kg/stoop1.c3d",
)


@pytest.fixture(scope="module", params=RECORDINGS)
def recording(request, data):
    """Return a generic model that is not the body's, and a recording in its ground."""
    one = look_at(data(request.param))
    turned = one.laboratory.trial(one.trial).markers
    model, _ = generic_model(sites_of([one]))
    names = tuple(map(bare, turned.names))
    own = [k for k, name in enumerate(names) if name in model.marker_names]
    return model, Markers(
        turned.time[::5], tuple(names[k] for k in own), turned.values[::5][:, own]
    )


def test_nothing_is_changed_where_labels_are_right(recording):
    model, markers = recording
    found, findings = repaired_labels(model, markers)
    assert found is markers
    assert findings == ()


@pytest.mark.parametrize(
    "change", [faults.swapped_pair(0.0, False), faults.swapped_leg], ids=["pair", "leg"]
)
def test_exchanged_labels_come_back(recording, change):
    model, markers = recording
    found, findings = repaired_labels(model, change(model, markers))
    np.testing.assert_array_equal(found.values, markers.values)
    assert [(one.kind, one.repaired) for one in findings] == [("swapped labels", True)]


def test_sides_that_may_be_mirrored_are_named_and_left(recording):
    model, markers = recording
    faulty = faults.swapped_sides(False)(model, markers)
    found, (finding,) = repaired_labels(model, faulty)
    assert found is faulty
    assert finding.kind == "left and right"

"""Rates that gravity or the other file contradicts are named, and those of recordings are not.

Truth: recordings whose times are multiplied by a factor, as a wrong rate in a head does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.faults import faults

from myomorph.core.contact.force_checks import BODY_CHECKS, checked_forces
from myomorph.core.contact.rates import PACE, RATE
from myomorph.core.model.errors import BadData
from myomorph.core.motion.sync import resample_wrenches

RECORDINGS = ("Rajagopal walk", "OpenCap walk", "knee implant, stride 1")
BY_NAME = {one.name: one for one in faults.CLEAN}


@pytest.fixture(scope="module", params=RECORDINGS)
def clean(request, data):
    """Open a walk whose model weighs what its plates carry."""
    walk = BY_NAME[request.param]
    for path in (walk.model, walk.motion, walk.loads):
        data(path)
    return faults.of_its_mass(data(walk.model.split("/")[0]).parent, walk)


def paced(series, pace):
    """Multiply the times of a series, from its first on."""
    start = series.time[0]
    return replace(series, time=start + pace * (series.time - start))


def rates(recorded, *paces):
    """Find rates, with times of forces and of the motion multiplied."""
    forces, motion = paces
    found = checked_forces(
        paced(recorded.wrenches, forces), recorded.model, paced(recorded.motion, motion)
    )
    return [finding for finding in found.findings if finding.kind in (RATE, PACE)]


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.25, 2.0])
def test_a_recording_of_another_rate_is_named_with_it(clean, factor):
    """A head that states `factor` times the rate makes all of it so much shorter."""
    start = clean.wrenches.time[0] - clean.motion.time[0]
    moved = replace(clean.wrenches, time=clean.wrenches.time - start * (1.0 - 1.0 / factor))
    (finding,) = rates(replace(clean, wrenches=moved), 1.0 / factor, 1.0 / factor)
    assert finding.text.size == pytest.approx(factor, rel=0.12)
    assert finding.text.severity == "changes results"
    assert finding.text.cause.order == 0


@pytest.mark.parametrize("pace", [0.8, 1.2])
def test_forces_of_another_rate_than_the_motion_are_named_with_it(clean, pace):
    (finding,) = rates(clean, 1.0 / pace, 1.0)
    assert finding.text.size == pytest.approx(pace, rel=1e-3)


def test_recordings_of_their_own_rate_are_not_named(clean):
    assert rates(clean, 1.0, 1.0) == []


def test_another_mass_is_no_rate(clean):
    for factor in (0.8, 1.3):
        assert rates(faults.scaled_mass(factor)(clean), 1.0, 1.0) == []


def test_forces_that_feet_share_show_rates_too(clean):
    """No foot is asked for."""
    found = checked_forces(
        paced(clean.wrenches, 1.25), clean.model, clean.motion, checks=BODY_CHECKS
    )
    assert [finding.kind for finding in found.findings] == [PACE]


def test_forces_that_are_a_usual_ratio_too_short_are_asked_for_their_rate(clean):
    inside = (clean.wrenches.time >= clean.motion.time[0] - 1e-9) & (
        clean.wrenches.time <= clean.motion.time[-1] + 1e-9
    )
    forces = clean.wrenches.frames(inside)
    with pytest.raises(BadData, match="check whether both rates are right in Hz"):
        resample_wrenches(paced(forces, 0.5), clean.motion.time)
    cut = forces.frames(forces.time < np.quantile(forces.time, 0.71))
    with pytest.raises(BadData) as refused:
        resample_wrenches(cut, clean.motion.time)
    assert "Hz" not in str(refused.value)

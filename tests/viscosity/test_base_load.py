"""What rests on the base changes no viscosity and no first moment.

A mass is as well known as that load is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swung_limb import GRAVITY, LIMB, released

from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.cohort import cohort, specimen_row
from myomorph.swings.viscosity.identification.base_load import (
    BaseLoad,
    shared_load,
    with_base_load,
)
from myomorph.swings.viscosity.identification.budget import ErrorOptions
from myomorph.swings.viscosity.identification.identify import (
    MeasuredMuscles,
    ViscosityOptions,
    identify_specimen,
)
from myomorph.swings.viscosity.identification.instruments import Instruments
from myomorph.swings.viscosity.report.tables import span, with_interval
from myomorph.swings.viscosity.trust.checks import base_findings

OPTIONS = ViscosityOptions(draws=20)
PLACE = np.array([0.04, 0.03, -0.05])
"""Of the load, from the joint's center [m]."""


@pytest.fixture(scope="module")
def light() -> list:
    return released()["viscosity"]


def loaded(recordings: list, mass: float) -> list:
    """Return the recordings with a mass at rest on the base; wrenches include its weight."""
    force = -mass * GRAVITY
    return [
        replace(one, wrench=one.wrench + np.concatenate([np.cross(PLACE, force), force]))
        for one in recordings
    ]


def test_a_load_of_the_base_changes_neither_viscosity_nor_first_moment(light):
    plain = identify_specimen("plain", light, (), options=OPTIONS).without
    heavy = identify_specimen("heavy", loaded(light, 0.4), (), options=OPTIONS).without
    assert heavy.viscosity.value == pytest.approx(plain.viscosity.value, rel=1e-6)
    assert heavy.first_moment.value == pytest.approx(float(np.linalg.norm(LIMB[1:4])), rel=1e-6)
    assert heavy.mass.value == pytest.approx(LIMB[0] + 0.4, rel=1e-6)


def test_a_mass_is_as_well_known_as_the_load(light):
    heavy = identify_specimen("heavy", loaded(light, 0.4), (), options=OPTIONS)
    known = with_base_load(heavy, BaseLoad((0.4, 0.4))).without
    assert known.mass.value == pytest.approx(LIMB[0], rel=1e-6)
    assert known.com.value == pytest.approx(float(np.linalg.norm(LIMB[1:4])) / LIMB[0], rel=1e-6)
    unknown = with_base_load(heavy, BaseLoad())
    assert unknown.without.mass.high == pytest.approx(LIMB[0] + 0.4, rel=1e-6)
    assert unknown.without.mass.low < LIMB[0]
    assert unknown.without.com.low < known.com.value < unknown.without.com.high
    # A range has no middle that would pass for an estimate.
    assert np.isnan([unknown.without.mass.value, unknown.without.com.value]).all()
    row = specimen_row(unknown)["mass_muscles_removed"]
    assert with_interval(row) == span(row.low, row.high)
    assert any("weighs like limb" in note for note in unknown.notes)
    assert with_base_load(heavy, BaseLoad((0.3, 0.5))).without.mass.holds(LIMB[0])


def test_a_load_is_named_by_its_moment_and_an_empty_base_is_not(light):
    instruments = Instruments.assumed(ErrorOptions(plate_position=5e-4, joint_center=5e-4))
    (found,) = base_findings(loaded(light, 0.4), instruments)
    assert (found.kind, found.place) == ("base load", "base")
    assert base_findings(light, instruments) == ()


def test_loads_of_both_conditions_bound_each_other():
    """The base carries with muscles what it does without, and what stays on it of those cut."""
    known = shared_load(BaseLoad(removed=(0.3, 0.3)), 0.8)
    assert known.removed == (0.3, 0.3)
    assert known.intact == pytest.approx((0.3, 1.1))
    unweighed = shared_load(BaseLoad(removed=(0.3, 0.3)), None)
    assert unweighed.intact == (0.3, np.inf)
    back = shared_load(BaseLoad(intact=(1.0, 1.0)), 0.8)
    assert back.removed == pytest.approx((0.2, 1.0))
    with pytest.raises(BadData, match="no less with muscles"):
        shared_load(BaseLoad(removed=(0.5, 0.6), intact=(0.1, 0.2)), None)


def test_muscles_weigh_no_more_than_the_scale_says(light):
    whole = [replace(each, wrench=1.3 * each.wrench) for each in light]
    both = identify_specimen(
        "both",
        light,
        whole,
        MeasuredMuscles(mass=0.65),
        options=replace(OPTIONS, draws=20),
    )
    shown = both.muscle_mass.value
    assert shown == pytest.approx(0.3 * LIMB[0], rel=1e-3)
    found = with_base_load(both, BaseLoad()).muscle_mass
    assert np.isnan(found.value)
    assert found.high == pytest.approx(0.65)
    # Where one mass is known, the other lies between it and it with the muscles.
    one = with_base_load(both, BaseLoad(removed=(0.0, 0.0)))
    assert one.without.mass.value == pytest.approx(LIMB[0], rel=1e-6)
    assert one.intact.mass.low == pytest.approx(one.without.mass.low + one.muscle_mass.low)
    assert one.intact.mass.high <= one.without.mass.high + 0.65 + 1e-9
    stated = with_base_load(both, BaseLoad(removed=(0.0, 0.0), intact=(0.2, 0.2))).muscle_mass
    assert stated.value == pytest.approx(shown - 0.2)


def test_a_mean_of_ranges_is_a_range():
    rows = [
        {"mass_intact": Interval(np.nan, 1.0, 2.0)},
        {"mass_intact": Interval(2.0, 1.9, 2.1)},
    ]
    (line,) = cohort(rows)
    assert np.isnan(line.mean)
    assert (line.low, line.high, line.count) == pytest.approx((1.45, 2.05, 2))


def test_a_load_below_zero_is_refused():
    with pytest.raises(BadData, match=r"-0\.1 to 0\.2 kg"):
        BaseLoad((-0.1, 0.2))

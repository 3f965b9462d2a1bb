"""What rests on the base changes no viscosity and no first moment; a mass is as well known as that
load is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swung_limb import GRAVITY, LIMB, released

from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.identification.base_load import BaseLoad, with_base_load
from myomorph.swings.viscosity.identification.budget import ErrorOptions
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.identification.instruments import Instruments
from myomorph.swings.viscosity.trust.checks import base_findings

OPTIONS = ViscosityOptions(draws=20)
PLACE = np.array([0.04, 0.03, -0.05])
"""Of the load, from the joint's center [m]."""


@pytest.fixture(scope="module")
def light() -> list:
    return released()["viscosity"]


def loaded(recordings: list, mass: float) -> list:
    """The recordings with a mass at rest on the base; wrenches are those that carry."""
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
    assert any("weighs like limb" in note for note in unknown.notes)
    assert with_base_load(heavy, BaseLoad((0.3, 0.5))).without.mass.holds(LIMB[0])


def test_a_load_is_named_by_its_moment_and_an_empty_base_is_not(light):
    instruments = Instruments.assumed(ErrorOptions(plate_position=5e-4, joint_center=5e-4))
    (found,) = base_findings(loaded(light, 0.4), instruments)
    assert (found.kind, found.place) == ("base load", "base")
    assert base_findings(light, instruments) == ()


def test_a_load_below_zero_is_refused():
    with pytest.raises(BadData, match=r"-0\.1 to 0\.2 kg"):
        BaseLoad((-0.1, 0.2))

"""Contacts drawn around those that were found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.series import Series
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.drawn_inputs import drawn_activations, drawn_sites
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import Sources

TIME = np.arange(0.0, 2.0, 0.01)
SITES = tuple(
    Site(name=name, body=body, points=np.zeros((1, 3)), cone=Cone(), group="foot_r")
    for name, body in (("heel", "calcn_r"), ("ball", "calcn_r"), ("toe", "toes_r"))
)


def draw(number, **sizes):
    return Draw(number, replace(Sources(), **sizes), Normals(50))


def ready(*spans):
    values = np.zeros((len(TIME), 3))
    for k, (start, stop) in enumerate(spans):
        values[(start <= TIME) & (stop >= TIME), k] = 1.0
    return Series(TIME, tuple(one.name for one in SITES), values)


@pytest.mark.parametrize("number", [0, 7])
def test_all_sites_of_a_foot_begin_and_end_late_by_the_same(number):
    one = draw(number, contact_time=0.03)
    begin, end = one.of("contact_time", "foot_r", 2)
    moved = drawn_activations(ready((0.5, 1.1), (0.5, 1.2), (0.5, 1.2)), SITES, one).values
    on = [TIME[np.flatnonzero(column > 0.5)[[0, -1]]] for column in moved.T]
    np.testing.assert_allclose(on[2], (0.5 + begin, 1.2 + end), atol=0.011)
    # What leaves in the middle of the touch is late by something between the two.
    assert min(begin, end) - 0.011 <= on[0][1] - 1.1 <= max(begin, end) + 0.011


def test_a_touch_that_the_recording_cuts_keeps_that_end():
    one = draw(2, contact_time=0.03)
    moved = drawn_activations(ready((-1.0, 0.8), (-1.0, 0.9), (1.5, 3.0)), SITES, one).values
    assert moved[0, 0] == 1.0
    assert moved[-1, 2] == 1.0


def test_without_sizes_contacts_are_those_that_were_found():
    given = ready((0.5, 1.1), (0.6, 1.2), (0.7, 1.2))
    none = draw(0, contact_time=0.0, contact_point=0.0)
    np.testing.assert_array_equal(drawn_activations(given, SITES, none).values, given.values)
    assert drawn_sites(SITES, none) == SITES


def test_sites_on_one_body_move_as_one():
    places = [one.points[0] for one in drawn_sites(SITES, draw(1))]
    np.testing.assert_array_equal(places[0], places[1])
    assert np.abs(places[0] - places[2]).max() > 1e-4

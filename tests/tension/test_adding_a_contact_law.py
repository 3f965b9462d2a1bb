"""A new contact law is one file (`ellipse_law.py`) and one line in the table of laws.

All else follows.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from tests.tension.ellipse_law import FrictionEllipse
from walking import full, soles, walk

from myomorph.core.model import contacts as model_contacts
from myomorph.core.model.contacts import Cone, Site, contact_law, register_law
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.lab.store.contact_store import _plain_site, _site
from myomorph.lab.study.inputs.contact_file import read_contacts

FILE = """
feet = false
[[site]]
name = "skate"
body = "calcn_r"
points = [[0.1, 0.0, 0.0]]
friction = 0.6
law = "flat_ellipse"
law_options = {{ {option} = 0.1 }}
"""


@pytest.fixture
def ellipse(monkeypatch):
    """Register the law by the one line, forgotten after the test."""
    monkeypatch.setattr(model_contacts, "CONTACT_LAWS", dict(model_contacts.CONTACT_LAWS))
    register_law("flat_ellipse", FrictionEllipse)


def test_forces_of_a_walk_stay_inside_the_ellipse_and_do_not_inside_another(data, ellipse):
    """Sagittal friction as before, sideways a hundredth.

    The force to the side is smaller than with the round pyramid.
    """
    model, motion, _ = walk(data, slice(200, 1000, 160))
    torques = inverse_dynamics(model, motion)
    sideways = {}
    for name, cone in (
        ("round", Cone(edges=8)),
        ("ellipse", FrictionEllipse(edges=8, across=0.01)),
    ):
        sites = soles(cone)
        contacts = ContactTask(sites, full(motion, sites), options=ContactOptions(smoothness=0.0))
        tension = solve_tension(model, motion, torques, contacts=contacts)
        assert tension.optimal.all()
        x, y, z = np.moveaxis(tension.contacts.contact_force, 2, 0)
        assert (np.abs(x) <= 0.8 * y + 1e-6).all()
        sideways[name] = np.abs(z).max()
        if name == "ellipse":
            # The first tangent of the upward direction is the x axis.
            assert (np.abs(z) <= 0.008 * y + 1e-6).all()
    assert sideways["round"] > 10.0 * sideways["ellipse"]


def test_a_contact_file_takes_it_with_its_options(data, tmp_path, ellipse):
    model, _, _ = walk(data, slice(0, 20, 10))
    path = tmp_path / "contacts.toml"
    path.write_text(FILE.format(option="across"), encoding="utf-8")
    (site,) = read_contacts(path, model).sites
    assert (type(site.cone), site.cone.across, site.cone.friction) == (FrictionEllipse, 0.1, 0.6)
    path.write_text(FILE.format(option="acros"), encoding="utf-8")
    with pytest.raises(BadFile, match=r"acros.*across"):
        read_contacts(path, model)


def test_results_keep_it_and_those_before_know_pyramids(ellipse):
    site = Site(
        name="skate",
        body="calcn_r",
        points=np.zeros((1, 3)),
        cone=FrictionEllipse(friction=0.6, across=0.1),
    )
    plain = json.loads(json.dumps(_plain_site(site)))
    assert plain["cone"]["law"] == "flat_ellipse"
    again = _site(plain).cone
    assert (type(again), again.across) == (FrictionEllipse, 0.1)
    np.testing.assert_array_equal(again.direction, site.cone.direction)
    older = {
        "direction": None,
        "frame": "ground",
        "friction": 0.5,
        "torsion": 0.0,
        "grip": 0.1,
        "edges": 6,
        "most": 9.0,
    }
    cone = _site({**plain, "cone": older}).cone
    assert (type(cone), cone.friction, cone.most, cone.direction) == (Cone, 0.5, 9.0, None)


def test_an_unknown_law_is_answered_with_those_that_exist():
    with pytest.raises(UnknownName, match=r"flat_ellipse.*pyramid"):
        contact_law("flat_ellipse")
    with pytest.raises(BadData, match=r"FrictionEllipse.*pyramid"):
        FrictionEllipse().plain()


def test_a_name_is_given_once(ellipse):
    register_law("flat_ellipse", FrictionEllipse)
    with pytest.raises(BadData, match=r"pyramid.*FrictionEllipse"):
        register_law("pyramid", FrictionEllipse)
    assert contact_law("pyramid") is Cone

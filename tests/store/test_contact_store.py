"""Contacts and their forces come back from result files as they were."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.contact.impacts import Impact
from myomorph.core.model.contacts import Cone, ContactForces, Contacts, SharedWrench, Site, Touch
from myomorph.lab.store.contact_store import (
    get_contact_forces,
    get_contacts,
    get_impacts,
    get_plate_forces,
    put_contact_forces,
    put_contacts,
    put_impacts,
    put_plate_forces,
)
from myomorph.lab.store.results import new_result, read_result

TIME = np.arange(4) / 100.0
SITES = (
    Site(
        name="heel_r",
        body="calcn_r",
        points=[[0.0, -0.02, 0.01]],
        cone=Cone(friction=np.inf, most=900.0),
        group="foot_r",
    ),
    Site(
        name="grip",
        body="hand_r",
        points=[[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]],
        cone=Cone(None, grip=0.05),
        against="box",
    ),
    Site(
        name="sleeve",
        body="hand_l",
        points=[[0.0, 0.0, 0.0]],
        cone=Cone([0.0, 0.0, 2.0], "torso", friction=0.0),
    ),
)


def test_forces_at_sites_survive(tmp_path):
    draw = np.random.default_rng(2)
    activations = draw.random((4, 3))
    forces_at_sites, points, torques = draw.normal(size=(3, 4, 3, 3))
    forces = ContactForces(
        time=TIME,
        sites=SITES,
        contact_activation=activations,
        contact_force=forces_at_sites,
        contact_point=points,
        contact_torque=torques,
    )
    with new_result(tmp_path / "x.nc") as writer:
        put_contact_forces(writer, forces)
    found = get_contact_forces(read_result(tmp_path / "x.nc"))
    for name in ("time", "contact_activation", "contact_force", "contact_point", "contact_torque"):
        np.testing.assert_array_equal(getattr(found, name), getattr(forces, name))
    for one, other in zip(found.sites, SITES, strict=True):
        assert (one.name, one.body, one.against, one.group) == (
            other.name,
            other.body,
            other.against,
            other.group,
        )
        np.testing.assert_array_equal(one.points, other.points)
        for name in ("frame", "friction", "torsion", "grip", "edges", "most"):
            assert getattr(one.cone, name) == getattr(other.cone, name)
        np.testing.assert_array_equal(one.cone.direction, other.cone.direction)


@pytest.mark.parametrize("count", [0, 1, 900])
def test_contacts_survive_however_many(tmp_path, count):
    touches = tuple(
        Touch("heel_r", 0.1 * k, 0.1 * k + 0.05, confidence=0.5, source="camera")
        for k in range(count)
    )
    contacts = Contacts(("heel_r", "toe_r"), touches, ("a doubt",))
    with new_result(tmp_path / "x.nc") as writer:
        put_contacts(writer, contacts)
    assert get_contacts(read_result(tmp_path / "x.nc")) == contacts


def test_results_without_contacts_say_so(tmp_path):
    with new_result(tmp_path / "x.nc") as writer:
        writer.time(TIME)
    found = read_result(tmp_path / "x.nc")
    assert get_contact_forces(found) is None
    assert get_contacts(found) is None


def test_plates_and_impacts_survive(tmp_path):
    force = np.random.default_rng(3).normal(size=(4, 3))
    force[2:] = np.nan
    plate = SharedWrench(name="plate 1", sites=("heel_r", "grip"), forces=force, moments=force)
    impact = Impact(
        site="grip", time=0.5, impulse=0.4, direction=[0.0, 1.0, 0.0], instrument="snare", low=0.3
    )
    with new_result(tmp_path / "x.nc") as writer:
        put_plate_forces(writer, [plate])
        put_impacts(writer, [impact])
    stored = read_result(tmp_path / "x.nc")
    (found,) = get_plate_forces(stored)
    assert (found.name, found.sites) == ("plate 1", ("heel_r", "grip"))
    np.testing.assert_array_equal(found.forces, force)
    (heard,) = get_impacts(stored)
    assert (heard.site, heard.instrument, heard.low) == ("grip", "snare", 0.3)
    assert np.isnan(heard.high)
    with new_result(tmp_path / "y.nc") as writer:
        put_plate_forces(writer, [])
    stored = read_result(tmp_path / "y.nc")
    assert get_plate_forces(stored) == ()
    assert get_impacts(stored) == ()

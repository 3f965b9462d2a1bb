"""Contact forces as files: what is written is read back, by us and by OpenSim."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from myomorph.core.io.loads import loads_table, read_external_loads, write_external_loads
from myomorph.core.model.contacts import Cone, ContactForces, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Wrenches


def made_wrenches(frames=7):
    forces, points, torques = np.random.default_rng(3).normal(size=(3, frames, 2, 3))
    return Wrenches(
        time=np.linspace(0.5, 1.1, frames),
        names=("calcn_r", "hand_l"),
        bodies=("calcn_r", "hand_l"),
        forces=forces,
        points=points,
        torques=torques,
    )


def test_loads_come_back(tmp_path):
    wrenches = made_wrenches()
    write_external_loads(wrenches, tmp_path / "contact_forces.sto", tmp_path / "contact_forces.xml")
    found = read_external_loads(tmp_path / "contact_forces.xml")
    assert found.names == wrenches.names
    assert found.bodies == wrenches.bodies
    for name in ("time", "forces", "points", "torques"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(wrenches, name), rtol=1e-9, atol=1e-12
        )


def test_opensim_takes_them(tmp_path):
    """In a process of its own: beside OpenSim's module ezc3d cannot work."""
    pytest.importorskip("opensim", reason="OpenSim is not installed")
    wrenches = made_wrenches()
    write_external_loads(wrenches, tmp_path / "forces.mot", tmp_path / "forces.xml")
    script = (
        "import opensim; loads = opensim.ExternalLoads('forces.xml', True); first = loads.get(0);"
        " column = opensim.ArrayDouble();"
        " opensim.Storage(loads.getDataFileName()).getDataColumn(first.getForceIdentifier() + 'y',"
        " column); print('found', loads.getSize(), first.getAppliedToBodyName(), *[column.get(i)"
        " for i in range(column.size())])"
    )
    said = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    _, count, body, *values = next(
        line for line in said.stdout.splitlines() if line.startswith("found")
    ).split()
    assert (count, body) == ("2", "calcn_r")
    np.testing.assert_allclose(np.array(values, float), wrenches.forces[:, 0, 1], rtol=1e-9)


def test_points_of_idle_loads_are_numbers():
    wrenches = made_wrenches(2)
    idle = Wrenches(
        time=wrenches.time,
        names=wrenches.names,
        bodies=wrenches.bodies,
        forces=0.0 * wrenches.forces,
        points=np.nan * wrenches.points,
        torques=0.0 * wrenches.torques,
    )
    assert np.isfinite(loads_table(idle).values).all()


def test_a_load_without_a_body_is_refused():
    nothing = np.zeros((1, 1, 3))
    wrenches = Wrenches(
        time=np.zeros(1),
        names=("plate 1",),
        bodies=("",),
        forces=nothing,
        points=nothing,
        torques=nothing,
    )
    with pytest.raises(BadData, match="acts on no body"):
        loads_table(wrenches)


def test_sites_of_a_body_become_one_load():
    """Four corners of a sole on a floor.

    Compared are force, center of pressure and the free vertical torque that remains.
    """
    draw = np.random.default_rng(5)
    corners = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, 0.1], [0.2, 0.0, 0.1]])
    sites = tuple(
        Site(f"corner {k}", "foot", corner[None], group="sole") for k, corner in enumerate(corners)
    )
    forces = draw.normal(size=(1, 4, 3)) * 50.0 + [0.0, 200.0, 0.0]
    points = corners[None]
    found = ContactForces(
        time=np.zeros(1),
        sites=sites,
        contact_activation=np.ones((1, 4)),
        contact_force=forces,
        contact_point=points,
        contact_torque=np.zeros((1, 4, 3)),
    ).wrenches()
    assert (found.names, found.bodies) == (("foot",), ("foot",))
    np.testing.assert_allclose(found.forces[0, 0], forces[0].sum(axis=0))
    moment = np.cross(points[0], forces[0]).sum(axis=0)
    np.testing.assert_allclose(
        found.torques[0, 0] + np.cross(found.points[0, 0], found.forces[0, 0]), moment
    )
    np.testing.assert_allclose(found.torques[0, 0, [0, 2]], 0.0, atol=1e-12)


def test_contacts_between_bodies_give_two_opposite_loads():
    site = Site(
        name="grip",
        body="hand",
        points=np.zeros((1, 3)),
        cone=Cone(None, grip=0.05),
        against="sleeve",
    )
    force, point, torque = np.array([[[[3.0, 4.0, 5.0]]], [[[0.1, 0.2, 0.3]]], [[[1.0, 0.0, 2.0]]]])
    found = ContactForces(
        time=np.zeros(1),
        sites=(site,),
        contact_activation=np.ones((1, 1)),
        contact_force=force,
        contact_point=point,
        contact_torque=torque,
    ).wrenches("group")
    assert found.bodies == ("hand", "sleeve")
    np.testing.assert_allclose(found.forces[:, 0], -found.forces[:, 1])
    np.testing.assert_allclose(found.torques[:, 0], -found.torques[:, 1])
    np.testing.assert_allclose(found.points[:, 0], found.points[:, 1])

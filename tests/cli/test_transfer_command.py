"""`myomorph transfer`: a subject's lengths and masses in another model, as files."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.model import Body, Joint, Model
from myomorph.core.model.spatial import Transform


def leg(thigh, mass):
    """Make a pelvis with two thighs and a right leg, of bodies that all have the same mass."""
    parts = {
        "pelvis": ("ground", 1.0, 0.0),
        "femur_r": ("pelvis", -0.1, 0.1),
        "femur_l": ("pelvis", -0.1, -0.1),
        "tibia_r": ("femur_r", -thigh, 0.0),
        "calcn_r": ("tibia_r", -0.4, 0.0),
    }
    bodies = tuple(
        Body(name=name, mass=mass, mass_center=[0.0, -0.1, 0.0], inertia=0.05 * np.eye(3))
        for name in parts
    )
    here = Transform(np.eye(3), np.zeros(3))
    joints = tuple(
        Joint(
            name=f"to_{name}",
            kind="WeldJoint",
            parent=parent,
            child=name,
            parent_frame=Transform(np.eye(3), np.array([0.0, y, z])),
            child_frame=here,
        )
        for name, (parent, y, z) in parts.items()
    )
    return Model(
        name="leg", bodies=bodies, joints=joints, coordinates=(), gravity=[0.0, -9.80665, 0.0]
    )


def test_lengths_and_masses_go_into_the_other_model(command, tmp_path):
    write_osim(leg(0.44, 6.0), tmp_path / "subject.osim")
    write_osim(leg(0.4, 5.0), tmp_path / "detailed.osim")
    out = tmp_path / "detailed_subject.osim"
    files = ("--model", tmp_path / "subject.osim", "--to", tmp_path / "detailed.osim")
    told = command("transfer", *files, "--out", out)
    assert told.status == 0, told.err
    assert "joint centers in common, at most 0.0 mm apart; 30.00 kg" in told.out
    model = read_osim(out)
    assert model.mass == pytest.approx(30.0)
    knee = next(one for one in model.joints if one.child == "tibia_r")
    assert knee.parent_frame.translation[1] == pytest.approx(-0.44, abs=1e-6)
    tables = tmp_path / "detailed_subject_transfer"
    rows = list(csv.DictReader((tables / "masses.csv").read_text().splitlines()))
    assert {row["region"]: float(row["mass_kg"]) for row in rows}["right thigh"] == pytest.approx(
        6.0
    )
    assert (tables / "provenance.json").is_file()

    into_itself = command("transfer", *files, "--out", tmp_path / "subject.osim")
    assert into_itself.status == 2
    assert "would be written over" in into_itself.err

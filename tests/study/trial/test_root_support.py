"""Bodies that known forces do not carry: contacts are estimated, else tensions are refused.

Truth is a simulated walk whose forces balance it.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.contact.seated import is_seated
from myomorph.core.io.loads import write_external_loads
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import read_sto
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.tension.load_quantities import CONTACT_GROUP_FORCE
from myomorph.core.tension.quantities import MUSCLE_FORCE
from myomorph.lab.store.quantity_files import write_series
from myomorph.lab.study.trial.root_support import lacking_support
from truths.mouse_motion import mouse

CHAIR = "opencap-subject4-multitask"
TIME = ("--time", 1.0, 3.0, "--cutoff", 6)


@pytest.fixture(scope="module")
def walk():
    """Simulate a walk: its motion with rates, and forces at its times."""
    sample = mm.sample("walk")
    motion = mm.differentiate(sample.truth[COORDINATE_VALUE.name], cutoff=6.0)
    return SimpleNamespace(
        model=sample.model,
        truth=sample.truth[COORDINATE_VALUE.name],
        motion=motion,
        loads=sample.loads,
        wrenches=resample_wrenches(sample.loads, motion.time, 6.0),
    )


def files(folder, walk, loads, raised=0.0):
    """Files of a walk with some of its loads, the whole body raised by a height [m]."""
    values = np.array(walk.truth.values)
    values[:, walk.truth.names.index("pelvis_ty")] += raised
    write_series(folder, replace(walk.truth, values=values), walk.model)
    write_osim(walk.model, folder / "walker.osim")
    write_external_loads(loads, folder / "grf.mot", folder / "grf.xml")
    return (
        *("tension", "--model", folder / "walker.osim"),
        *("--motion", folder / COORDINATE_VALUE.file, "--loads", folder / "grf.xml", *TIME),
        *("--out", folder / "out"),
    )


def test_forces_that_carry_the_body_are_left_alone(walk):
    assert lacking_support(walk.model, walk.motion, walk.wrenches) is None


@pytest.mark.parametrize("wrong", [0.85, 1.3])
def test_a_wrong_mass_is_no_missing_force(walk, wrong):
    heavier = walk.model.with_mass(wrong * walk.model.mass)
    assert lacking_support(heavier, walk.motion, walk.wrenches) is None


def test_some_frames_without_forces_are_no_reason(walk):
    """A foot beside the plates for a third of the time."""
    forces = np.array(walk.wrenches.forces)
    third = len(forces) // 3
    forces[:third] = 0.0
    assert lacking_support(walk.model, walk.motion, replace(walk.wrenches, forces=forces)) is None
    forces[: 2 * third] = 0.0
    found = lacking_support(walk.model, walk.motion, replace(walk.wrenches, forces=forces))
    assert found.median > 0.7
    assert found.missing[0][1] == pytest.approx(walk.motion.time[2 * third - 1], abs=0.02)
    assert found.carried[0] >= walk.motion.time[2 * third - 1]


def test_forces_on_hands_alone_say_nothing_of_the_ground(walk):
    hands = replace(walk.wrenches, bodies=("torso", "torso"), forces=0.01 * walk.wrenches.forces)
    assert lacking_support(walk.model, walk.motion, hands) is None


def test_nobody_who_walks_sits(walk):
    assert not is_seated(walk.model, walk.motion, np.ones(len(walk.motion), bool))


def test_a_foot_without_a_plate_is_carried_by_default(walk, tmp_path, command):
    """Forces of the right foot alone: those of the left are found, and the right ones stay."""
    right = walk.loads.columns([walk.loads.bodies.index("calcn_r")])
    done = command(*files(tmp_path, walk, right))
    assert done.status == 0, done.err
    assert "forces under feet off the plates are estimated" in done.out + done.err
    forces = read_sto(tmp_path / "out" / CONTACT_GROUP_FORCE.file)
    left = walk.wrenches.forces[:, walk.wrenches.bodies.index("calcn_l"), 1]
    true = np.interp(forces.time, walk.motion.time, left)
    assert np.sqrt(np.mean((forces["foot_l_fy"] - true) ** 2)) < 0.15 * walk.model.weight
    # Double support takes part: what is estimated of a measured foot is nothing.
    assert np.abs(forces["foot_r_fy"]).max() < 0.02 * walk.model.weight


def test_a_body_that_nothing_can_carry_is_refused_by_name(walk, tmp_path, command):
    """Raised by half a metre, with a fifth of the forces that it needs."""
    weak = replace(walk.loads, forces=0.2 * walk.loads.forces)
    words = files(tmp_path, walk, weak, raised=0.5)
    done = command(*words)
    assert done.status == 2
    (line,) = [line for line in done.err.splitlines() if line.startswith("error")]
    for part in (
        "do not support the body of 70 kg: 81 % of the weight of 687 N on the median",
        "more than 10 % in 201 of 201 frames (from 1.00 to 3.00 s)",
        "--contacts FILE.toml",
        "--time START END",
        "--contacts none",
    ):
        assert part in line
    assert not (tmp_path / "out").exists()
    assert command(*words, "--contacts", "none").status == 0
    assert (tmp_path / "out" / MUSCLE_FORCE.file).exists()
    assert not (tmp_path / "out" / CONTACT_GROUP_FORCE.file).exists()


def test_a_seat_is_found_under_somebody_who_sits(tmp_path, data, command):
    """On a recording: nobody measured the chair, feet have their plates."""
    model = data(f"{CHAIR}/models/manually_scaled.osim")
    done = command(
        *("tension", "--model", model, "--motion", data(f"{CHAIR}/ik_manual_scaling/STS1_ik.mot")),
        *("--loads", data(f"{CHAIR}/grf/STS1_external_forces.xml"), "--cutoff", 6),
        *("--time", 5.2, 6.2, "--out", tmp_path),
    )
    assert done.status == 0, done.err
    assert "forces under a seat and feet off the plates" in done.out + done.err
    forces = read_sto(tmp_path / CONTACT_GROUP_FORCE.file)
    weight = mm.read_model(model).weight
    # A person who sits on a chair puts most of the weight on it.
    assert 0.5 < np.median(forces["seat_fy"]) / weight < 1.0


def test_a_mouse_whose_trunk_is_level_does_not_sit(data):
    folder = data("mouse-gait-c3d-force").parent
    data("mouse-hindlimb-muscles/mouse_hindlimb.json")
    one = mouse(folder, "1R")
    known = np.isfinite(one.fit.motion.values).all(axis=1)
    assert not is_seated(one.model, one.fit.motion, known)

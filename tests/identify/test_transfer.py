"""A calibrated model's lengths, markers and masses in a model with more joints."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from myomorph.body.identify.carry import carry_motion
from myomorph.body.identify.transfer import _nearest, _with_masses, transfer
from myomorph.body.shape.points import Links
from myomorph.body.shape.regions import (
    Region,
    Standing,
    centers_of,
    regions_of,
    spread,
    spread_mass,
)
from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters, parameters_of, pseudo_inertias
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.study.inputs.reading import read_motion

REST = Motion(np.zeros(1), (), np.zeros((1, 0)))


@pytest.fixture(scope="module")
def lower(data):
    return read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))


@pytest.fixture(scope="module")
def higher(data):
    return read_model(data("fullbody-many-muscles/cyclistFullBodyMuscle.osim"))


@pytest.fixture(scope="module")
def transferred(lower, higher):
    return transfer(lower, higher, path_lengths=None)


def random_body(random, where):
    points = random.normal(where, (0.1, 0.2, 0.05), (6, 3))
    masses = random.uniform(0.1, 1.0, 6)
    wide = np.hstack([points, np.ones((6, 1))])
    return (wide * masses[:, None]).T @ wide


def test_how_far_mass_centers_move_is_told(lower):
    """With mass centers placed elsewhere: a region's only body goes all the way back."""
    away = {"femur_r": (0.03, 0.0, 0.0), "calcn_l": (0.0, 0.04, 0.03), "hand_r": (0.0, 0.0, -0.02)}
    bodies = (
        replace(one, mass_center=one.mass_center + away.get(one.name, (0.0,) * 3))
        for one in lower.bodies
    )
    regions = regions_of(lower)
    moved = replace(lower, bodies=tuple(bodies))
    _, matches = _with_masses(
        Standing(lower, REST, regions), Standing(moved, REST, regions), np.eye(3)
    )
    alone = {
        one.higher_bodies[0]: one.largest_shift for one in matches if len(one.higher_bodies) == 1
    }
    assert set(away) <= set(alone)
    for body, shift in alone.items():
        assert shift == pytest.approx(np.linalg.norm(away.get(body, 0.0)), abs=1e-9), body


def test_the_nearest_bone_is_nearest_along_all_of_its_length():
    """Three bones near a long one, 0.4 m.

    A short one is 13 cm from its middle, another behind its end, and one has no length.
    """
    bones = np.array(
        [
            [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
            [[0.9, 0.13, 0.0], [1.1, 0.13, 0.0]],
            [[2.1, 0.0, 0.0], [3.0, 0.0, 0.0]],
            [[0.0, 0.0, 5.0], [0.0, 0.0, 5.0]],
        ]
    )
    names = ("long", "short", "behind", "point")
    links = Links(
        names=names,
        rotations=np.tile(np.eye(3), (4, 1, 1)),
        origins=bones[:, 0],
        centers=bones.mean(axis=1),
        bones=bones,
        bone_links=np.arange(4),
    )
    places = {
        "long": ((1.99, 0.055, 0.0), (1.0, 0.0649, 0.0), (2.04, 0.0, 0.0), (-0.5, 0.0, 0.0)),
        "short": ((1.0, 0.0651, 0.0), (0.9, 0.09, 0.0)),
        "behind": ((2.06, 0.0, 0.0),),
        "point": ((1.0, 0.0, 3.0),),
    }
    for name, near in places.items():
        assert [_nearest(np.array(one), links, names) for one in near] == [name] * len(near)
    assert _nearest(np.array([1.0, 0.07, 0.0]), links, ("long", "behind")) == "long"


@pytest.mark.parametrize("size", [0.2, 1.0, 3.0])
def test_spread_masses_sum_to_the_target_and_stay_possible(size):
    """Targets smaller than, like and larger than the sum, in other directions.

    Some masses must shrink, some grow.
    """
    random = np.random.default_rng(5)
    bodies = np.stack([random_body(random, (0.0, 0.3 * i, 0.0)) for i in range(5)])
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    target = 1.7 * bodies.sum(axis=0)
    center = target[:3, 3] / target[3, 3]
    central = target[:3, :3] - target[3, 3] * np.outer(center, center)
    moved = center + (0.1, -0.2, 0.05)
    target[:3, :3] = size * turn @ central @ turn.T + target[3, 3] * np.outer(moved, moved)
    target[:3, 3] = target[3, :3] = target[3, 3] * moved
    found = spread(bodies, target)
    np.testing.assert_allclose(found.sum(axis=0), target, atol=1e-12)
    assert (np.linalg.eigvalsh(found)[:, 0] > 0.0).all()
    np.testing.assert_allclose(found[:, 3, 3], 1.7 * bodies[:, 3, 3])


def test_spreading_the_same_changes_nothing():
    random = np.random.default_rng(6)
    bodies = np.stack([random_body(random, (0.0, 0.3 * i, 0.0)) for i in range(4)])
    np.testing.assert_allclose(spread(bodies, bodies.sum(axis=0)), bodies, atol=1e-12)


def test_what_no_body_can_have_is_refused_but_its_mass_can_be_given():
    random = np.random.default_rng(7)
    bodies = np.stack([random_body(random, (0.0, 0.0, 0.0)) for _ in range(3)])
    flat = bodies.sum(axis=0)
    flat[0, 0] = flat[0, 3] ** 2 / flat[3, 3] - 1e-3
    with pytest.raises(BadData, match=r"least second moment of mass is -0\.00"):
        spread(bodies, flat)
    found = spread_mass(bodies, flat).sum(axis=0)
    np.testing.assert_allclose(found[3], flat[3], atol=1e-12)


def test_parameters_of_a_pseudo_inertia_come_back(lower):
    given = inertial_parameters(lower)
    np.testing.assert_allclose(parameters_of(pseudo_inertias(given)), given, atol=1e-14)


def test_regions_and_centers_of_both_models(lower, higher):
    tables = regions_of(lower), regions_of(higher)
    assert (
        tables[0]["torso"]
        == tables[1]["lumbar5"]
        == tables[1]["rib1_R"]
        == tables[1]["scapula_R"]
        == Region("torso")
    )
    assert tables[1]["sacrum"] == Region("pelvis")
    assert tables[1]["head_neck"] == Region("head")
    assert tables[0]["patella_l"] == Region("shank", "left")
    centers = [
        centers_of(model, table) for model, table in zip((lower, higher), tables, strict=True)
    ]
    assert set(centers[1]) - set(centers[0]) == {"neck"}
    assert centers[0]["right knee"].joint.child == "tibia_r"
    assert centers[1]["lumbar"].joint.child == "lumbar5"


def test_joint_centers_coincide(transferred, lower):
    assert len(transferred.joint_errors) == 17
    assert max(transferred.joint_errors.values()) < 1e-9
    # Stretching and posing alone bring them this near; the rest is made up at the joints.
    assert max(transferred.joint_shifts.values()) < 5e-3
    places = [
        Standing(model, pose, regions_of(model)).places
        for model, pose in (
            (lower, transferred.lower_pose),
            (transferred.model, transferred.higher_pose),
        )
    ]
    for key in transferred.joint_errors:
        np.testing.assert_allclose(
            places[1][key], transferred.rotation @ places[0][key], atol=1e-9, err_msg=key
        )
    assert all(abs(one.lower - one.higher) < 1e-9 for one in transferred.lengths)


def test_markers_stay_where_they_are(transferred, lower, higher):
    def places(model, pose):
        tree = compile_tree(model)
        poses = forward_kinematics(tree, tree.coordinates_of(pose))
        bodies = np.array([tree.body_index[one.body] for one in model.markers])
        return poses.points(bodies, np.array([one.location for one in model.markers]))[0]

    assert transferred.model.marker_names == lower.marker_names
    np.testing.assert_allclose(
        places(transferred.model, transferred.higher_pose),
        places(lower, transferred.lower_pose),
        atol=1e-9,
    )
    tables = regions_of(lower), regions_of(higher)
    for one in transferred.model.markers:
        region = tables[1][one.body]
        expected = region.parent if region.name == "head" else region
        assert expected == tables[0][lower.marker(one.name).body], one.name


def test_masses_of_regions_are_the_lower_models(transferred, lower):
    assert transferred.model.mass == pytest.approx(lower.mass, abs=1e-9)
    given = Standing(lower, transferred.lower_pose, {}).pseudo_inertias()
    found = Standing(transferred.model, transferred.higher_pose, {}).pseudo_inertias()
    for one in transferred.masses:
        theirs = given[[lower.body_names.index(name) for name in one.lower_bodies]].sum(axis=0)
        ours = found[[transferred.model.body_names.index(name) for name in one.higher_bodies]].sum(
            axis=0
        )
        np.testing.assert_allclose(ours[3], theirs[3], atol=1e-9, err_msg=str(one.region))
        if not one.note:
            np.testing.assert_allclose(ours, theirs, atol=1e-9, err_msg=str(one.region))
    assert {str(one.region) for one in transferred.masses if one.note} == {
        "right toes",
        "left toes",
    }
    assert sum(len(one.higher_bodies) for one in transferred.masses) == len(
        transferred.model.bodies
    )


def test_bodies_that_were_possible_still_are(transferred, higher):
    before = np.linalg.eigvalsh(pseudo_inertias(inertial_parameters(higher)))[:, 0]
    after = np.linalg.eigvalsh(pseudo_inertias(inertial_parameters(transferred.model)))[:, 0]
    assert (after[before > 1e-12] > 0.0).all()


def test_what_has_no_counterpart_is_named(transferred):
    assert transferred.without_center == ("neck",)
    assert transferred.without_counterpart == ("head_neck",)
    head = transferred.factors["head_neck"]
    torso = transferred.factors["thoracic5"]
    np.testing.assert_allclose(head, np.prod(torso) ** (1.0 / 3.0), rtol=1e-12)
    np.testing.assert_allclose(transferred.factors["lumbar3"], torso, rtol=1e-12)


def test_a_motion_is_carried_and_what_it_leaves_open_is_held(transferred, lower, data):
    """Segments follow within millimeters; the rotation of a limb is its own.

    The trunk's bend is distributed, and ribs stay.
    """
    walk = read_motion(data("rajagopal-walk-emg/coordinates.sto"), lower)
    motion = Motion(walk.time[::400], walk.names, walk.values[::400].copy())
    motion.values.setflags(write=True)
    motion.values[1, 0] = np.nan
    carried = carry_motion(lower, motion, transferred)
    assert np.isnan(carried.motion.values[1]).all()
    assert np.isfinite(np.delete(carried.motion.values, 1, axis=0)).all()
    assert np.sqrt(np.nanmean(carried.errors**2)) < 3e-3
    for name in ("hip_flexion_r", "knee_angle_l", "ankle_angle_r"):
        assert carried.known[name] > 0.99
    held = {name: share for name, share in carried.known.items() if share < 0.5}
    assert len(held) > 60
    assert "T5_r5L_X" in held
    column = carried.motion.names.index("T5_r5L_X")
    rest = compile_tree(transferred.model).coordinates_of(transferred.higher_pose)[0, column]
    np.testing.assert_allclose(np.delete(carried.motion.values[:, column], 1), rest, atol=1e-3)
    again = carry_motion(
        lower, Motion(motion.time[2:], motion.names, motion.values[2:]), transferred
    )
    np.testing.assert_allclose(again.motion.values, carried.motion.values[2:], atol=1e-4)


def test_a_motion_stays_in_its_laboratory(transferred, lower):
    tilted = replace(transferred, model=replace(transferred.model, gravity=[0.0, 0.0, -9.81]))
    with pytest.raises(BadData, match="other verticals"):
        carry_motion(lower, REST, tilted)


def test_a_stretched_model_gives_its_size_back(lower):
    """From a model stretched by known factors back to its own kind.

    The factors and masses are found.
    """
    known = {
        "femur_r": (1.1,) * 3,
        "tibia_l": (0.9,) * 3,
        "humerus_l": (1.05,) * 3,
        "patella_l": (0.9,) * 3,
    }
    larger = scale(lower, known, mass=90.0)
    found = transfer(larger, lower, path_lengths=None)
    for body, factor in known.items():
        np.testing.assert_allclose(found.factors[body], factor, atol=1e-4, err_msg=body)
    assert max(found.joint_shifts.values()) < 1e-4
    for one, other in zip(found.model.bodies, larger.bodies, strict=True):
        assert one.mass == pytest.approx(other.mass, rel=1e-6)
    assert found.without_counterpart == ()


def test_muscles_follow(lower):
    """Fibers and tendons keep their ratio to paths."""
    larger = scale(lower, {"femur_r": (1.1,) * 3}, path_lengths=default_path_lengths)
    found = transfer(larger, lower)
    grown = (
        found.model.muscle("vasint_r").optimal_fiber_length
        / lower.muscle("vasint_r").optimal_fiber_length
    )
    known = (
        larger.muscle("vasint_r").optimal_fiber_length
        / lower.muscle("vasint_r").optimal_fiber_length
    )
    assert grown == pytest.approx(known, rel=1e-3)
    assert grown > 1.02


def test_models_without_legs_are_refused(lower, data):
    with pytest.raises(BadData, match="no body of model"):
        transfer(lower, read_model(data("opensim-reference-small/arm26.osim")))
    alone = replace(lower, markers=())
    with pytest.raises(BadData, match="no first frame"):
        transfer(alone, lower, pose=Motion(np.zeros(1), ("pelvis_tx",), np.full((1, 1), np.nan)))


@pytest.mark.long
def test_full_body_of_mujoco_takes_the_body(lower):
    """Another format, other axes of the ground, 101 bodies, a shoulder whose default is a pole."""
    spec = find_spec("musclemimic_models")
    if spec is None or spec.origin is None:
        pytest.skip("needs the package musclemimic-models")
    model = read_model(Path(spec.origin).parent / "model" / "body" / "myofullbody.xml")
    found = transfer(lower, model)
    assert max(found.joint_errors.values()) < 1e-9
    assert max(found.joint_shifts.values()) < 5e-3
    assert found.model.mass == pytest.approx(lower.mass, abs=1e-9)
    np.testing.assert_allclose(found.rotation @ (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), atol=1e-12)
    assert set(found.without_counterpart) == {"head_attach", "neck", "head"}

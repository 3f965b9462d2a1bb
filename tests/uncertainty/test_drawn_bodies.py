"""Models drawn around the one that was given."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.paths import PathPoint
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import InverseKinematicsOptions, poses_near
from myomorph.core.muscles.hill import compile_hill, compile_hill_as
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.muscles.model_paths import compile_paths, compile_paths_as
from myomorph.core.muscles.patella_distance import patella_directions, with_patellae_farther
from myomorph.core.muscles.published_arms import PATELLAR_TENDON, knee_arms
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree, compile_tree_as
from myomorph.lab.uncertainty.bodies import Draw, drawn_model, drawn_subject, stronger
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import GROUPS, Sources

NONE = replace(Sources(), **{name: 0.0 for names in GROUPS.values() for name in names})


def draw(number=0, draws=200, **sizes):
    return Draw(number, replace(NONE, **sizes), Normals(draws))


def markers_at(model, values):
    tree = compile_tree(model)
    poses = forward_kinematics(
        tree, tree.coordinates_of(Motion(np.zeros(1), model.coordinate_names, values))
    )
    bodies = np.array([tree.body_number(one.body) for one in model.markers], np.int64)
    return poses.points(bodies, np.array([one.location for one in model.markers]))[0]


@pytest.fixture
def model(arm):
    return read_model(arm.model)


def test_without_sizes_it_is_the_model_itself(model):
    assert drawn_model(model, draw()) is model


def test_every_source_belongs_to_one_group():
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(one.name for one in fields(Sources) if one.name != "skin_time")


def test_segments_weigh_otherwise_and_the_whole_the_same(model):
    masses = np.array(
        [
            [one.mass for one in drawn_model(model, draw(k, segment_mass=0.1)).bodies]
            for k in range(200)
        ]
    )
    np.testing.assert_allclose(masses.sum(axis=1), model.mass, rtol=1e-12)
    # Two bodies whose sum is fixed: the share of one is p, its logit has 0.1 sqrt(2).
    share = masses[:, 0] / model.mass
    np.testing.assert_allclose(np.log(share / (1.0 - share)).std(), 0.1 * np.sqrt(2.0), rtol=0.1)


def test_another_center_leaves_the_zero_pose_and_moves_the_bent_one(model):
    other = drawn_model(model, draw(joint_center=0.01, joint_axis=0.05))
    zero = np.zeros((1, 2))
    bent = np.array([[0.0, 1.0]])
    np.testing.assert_allclose(markers_at(other, zero), markers_at(model, zero), atol=1e-12)
    assert np.abs(markers_at(other, bent) - markers_at(model, bent)).max() > 1e-3


def test_a_patella_elsewhere_moves_all_points_on_it_alike(data):
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    other = drawn_model(model, draw(patella=0.01))
    moved = {"patella_r": [], "patella_l": [], "femur_r": []}
    for old, new in zip(model.muscles, other.muscles, strict=True):
        for before, after in zip(old.path.points, new.path.points, strict=True):
            if before.body in moved and isinstance(before, PathPoint):
                moved[before.body].append(after.location - before.location)
    for body, shifts in moved.items():
        assert np.ptp(shifts, axis=0).max() < 1e-12
        assert (np.abs(shifts[0]).max() > 0.0) == body.startswith("patella")


def test_bowed_legs_move_the_knee_out_between_hip_and_ankle(data):
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    tree = compile_tree(model)
    still = Motion(np.zeros(1), model.coordinate_names, np.zeros((1, len(model.coordinates))))
    places = forward_kinematics(tree, tree.coordinates_of(still)).origins[0]
    chain = [tree.body_index[name] for name in ("femur_r", "tibia_r", "talus_r")]
    observed = Markers(
        still.time, tuple(one.name for one in model.markers), markers_at(model, still.values)[None]
    )
    angles = []
    moved = []
    for k in range(20):
        bowed = drawn_model(model, draw(k, leg_alignment=0.04))
        found = poses_near(bowed, observed, still, InverseKinematicsOptions())
        own = compile_tree(bowed)
        now = forward_kinematics(own, own.coordinates_of(found)).origins[0]
        hip, knee, ankle = (now[chain] - places[chain])[:, 2]
        assert max(abs(hip), abs(ankle)) < 0.0015
        angles.append(draw(k, leg_alignment=0.04).of("leg_alignment", "walker_knee_r")[0])
        moved.append(knee - 0.5 * (hip + ankle))
    # Two bones of 0.4 m, each turned by half of the angle.
    np.testing.assert_allclose(np.abs(moved), 0.2 * np.abs(angles), atol=0.002)
    assert abs(np.corrcoef(angles, moved)[0, 1]) > 0.99
    assert 0.02 < np.std(angles) < 0.06


def test_points_of_paths_move_by_their_size(model):
    before = [
        one.location
        for muscle in model.muscles
        for one in muscle.path.points
        if isinstance(one, PathPoint)
    ]
    moved = []
    for k in range(200):
        muscles = drawn_model(model, draw(k, attachment=0.004)).muscles
        moved.append(
            [
                one.location
                for muscle in muscles
                for one in muscle.path.points
                if isinstance(one, PathPoint)
            ]
        )
    # Latin hypercubes: standard deviations are right to a few percent in each column.
    np.testing.assert_allclose((np.array(moved) - np.array(before)).std(axis=0), 0.004, rtol=0.08)


@pytest.mark.parametrize(
    ("name", "value"), [("placement", -0.001), ("strength", np.nan), ("skin_time", 0.0)]
)
def test_a_size_that_is_none_is_refused(name, value):
    with pytest.raises(BadData, match=name):
        replace(Sources(), **{name: value})


def test_arrays_of_a_drawn_model_are_those_that_compiling_it_anew_makes(data):
    model = read_model(data("opencap-subject4-multitask/models/manually_scaled.osim"))
    drawn = drawn_model(model, Draw(3, Sources(), Normals(5)))
    for kept, anew in (
        (compile_tree_as(drawn, model).arrays, compile_tree(replace(drawn)).arrays),
        (compile_paths_as(drawn, model).arrays, compile_paths(replace(drawn)).arrays),
        (compile_hill_as(drawn, model), compile_hill(replace(drawn))),
    ):
        for name, one, other in zip(kept._fields, kept, anew, strict=True):
            if isinstance(one, np.ndarray) and name != "pre_is_shift":
                np.testing.assert_allclose(one, other, atol=1e-14, err_msg=name)


def test_tendons_are_fitted_to_drawn_paths_and_fibers(model):
    """Normalized fiber lengths in the default pose stay.

    The source of slack lengths alone changes them.
    """

    def fibers(one):
        lengths = default_path_lengths(one)
        return np.array(
            [
                (length - muscle.tendon_slack_length) / muscle.optimal_fiber_length
                for muscle, length in zip(one.muscles, lengths, strict=True)
            ]
        )

    drawn = drawn_subject(model, draw(4, attachment=0.004, wrap_radius=0.1, fiber_length=0.1))
    assert np.abs(default_path_lengths(drawn) - default_path_lengths(model)).max() > 1e-3
    np.testing.assert_allclose(fibers(drawn), fibers(model), atol=1e-9)
    apart = [
        fibers(drawn_subject(model, draw(k, slack_length=0.05))) - fibers(model) for k in range(200)
    ]
    np.testing.assert_allclose(np.std(apart, axis=0), 0.05, rtol=0.05)


def test_a_stronger_body_is_stronger_in_all_muscles(model):
    more = stronger(model, 1.4)
    for one, other in zip(model.muscles, more.muscles, strict=True):
        assert other.max_isometric_force == pytest.approx(1.4 * one.max_isometric_force)


def test_the_whole_body_weighs_otherwise(model):
    masses = [drawn_model(model, draw(k, body_mass=0.02)).mass for k in range(200)]
    np.testing.assert_allclose(np.std(np.log(masses)), 0.02, rtol=0.02)


def tendon_arms_of(model):
    """Arms of the right patellar tendon beyond 60 degrees (angles,) [m]."""
    arms = next(arms for arms in knee_arms(model) if arms.band is PATELLAR_TENDON)
    return arms.arms[arms.flexion >= 60.0]


def test_a_patella_farther_out_lengthens_the_tendons_arm_by_as_much(data):
    model = read_model(data("rajagopal-walk-emg/raw/Rajagopal2016.osim"))
    farther = with_patellae_farther(model, {"patella_r": 0.006, "patella_l": 0.006})
    assert set(patella_directions(model)) == {"patella_r", "patella_l"}
    for way in patella_directions(model).values():
        assert np.linalg.norm(way) == pytest.approx(1.0)
        assert way[0] > 0.9  # forward, as the model's axes point
    longer = tendon_arms_of(farther) - tendon_arms_of(model)
    np.testing.assert_allclose(longer, 0.0065, atol=0.0008)
    back = with_patellae_farther(farther, {"patella_r": -0.006, "patella_l": -0.006})
    np.testing.assert_allclose(tendon_arms_of(back), tendon_arms_of(model), atol=1e-6)
    with pytest.raises(UnknownName, match="unknown patella 'kneecap'"):
        with_patellae_farther(model, {"kneecap": 0.001})


def test_drawn_patellae_have_the_spread_of_published_arms_and_both_knees_alike(data):
    """A quarter of the published band, which is two standard deviations on both sides."""
    model = read_model(data("rajagopal-walk-emg/raw/Rajagopal2016.osim"))
    usual = Sources()
    sizes = {"patella": usual.patella, "patella_distance": usual.patella_distance}
    drawn = [drawn_model(model, draw(k, 80, **sizes)) for k in range(80)]
    spread = np.std([tendon_arms_of(each) for each in drawn], axis=0)
    band = next(arms for arms in knee_arms(model) if arms.band is PATELLAR_TENDON)
    published = (band.high - band.low)[band.flexion >= 60.0] / 4.0
    np.testing.assert_allclose(spread, published, rtol=0.25)

    alone = drawn_model(model, draw(3, patella_distance=0.006))
    moves = {}
    for old, new in zip(model.muscles, alone.muscles, strict=True):
        for before, after in zip(old.path.points, new.path.points, strict=True):
            if isinstance(before, PathPoint):
                moves.setdefault(before.body, []).append(after.location - before.location)
    out = {body: np.linalg.norm(found[0]) for body, found in moves.items()}
    assert out["patella_r"] == pytest.approx(out["patella_l"])
    assert out["patella_r"] > 1e-4
    assert out["femur_r"] == 0.0

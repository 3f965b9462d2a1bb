"""Sites under feet.

They are on the sole of every model, where plates measure the foot, and on the floor after a fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from measured_walk import measured_walk
from mujoco_models import compiled
from myomorph.core.contact.site_motion import (
    cluster,
    floor_under,
    plate_height,
    rest_on_floor,
    site_motion,
)
from myomorph.core.contact.sites import body_sites, feet_of, foot_sites
from myomorph.core.contact.states import ContactStateOptions, find_contacts
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.mesh import read_surfaces
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.join import join_models
from myomorph.core.model.model import Body, Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.kinematics import standing_poses

OSIM = (
    "rajagopal-walk-emg/subject_walk_scaled.osim",
    "opensim-gait-subject01/ref_id/subject01.osim",
    "hamner-run-subject04/unscaled_generic.osim",
    "opencap-subject4-multitask/models/manually_scaled.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
)


def checked_soles(model: Model) -> None:
    """Check the six sites of each foot.

    They are in convex order, under the ankle, ahead of the heel, and mirrored on the other foot.
    """
    sites = foot_sites(model)
    poses = standing_poses(model)
    up = model.up
    placed = {one.name: poses[one.body].apply(one.points[0]) for one in sites}
    assert [one.group for one in sites] == ["foot_r"] * 6 + ["foot_l"] * 6
    for foot in feet_of(model):
        side = foot.name[-2:]
        forward = foot.axes[:, 0]
        ankle = poses[foot.heel].translation
        mine = {name[: -len(side)]: x for name, x in placed.items() if name.endswith(side)}
        assert all((x - ankle) @ up < 0.0 for x in mine.values())
        along = {name: (x - ankle) @ forward for name, x in mine.items()}
        assert (
            along["heel_medial"]
            < along["ball_lateral"]
            < along["ball_medial"]
            < along["toe_medial"]
        )
        for part in ("heel", "ball", "toe"):
            outer = mine[f"{part}_lateral"]
            inner = mine[f"{part}_medial"]
            assert (outer - inner) @ foot.axes[:, 2] > 0.02
    for name, x in placed.items():
        if name.endswith("_r"):
            other = placed[name[:-1] + "l"]
            assert abs((x - other) @ up) < 0.005
            assert abs((x - other) @ feet_of(model)[0].axes[:, 0]) < 0.01


@pytest.mark.parametrize("name", OSIM)
def test_soles_of_opensim_models(data, name):
    checked_soles(read_model(data(name)))


@pytest.mark.parametrize("name", ["myolegs", "MyoFullBody"])
def test_soles_of_mujoco_models(name):
    model = model_from_mujoco(compiled(name))
    checked_soles(model)
    assert all(one.cone.direction[2] == 1.0 for one in foot_sites(model))


def test_a_foot_turned_with_its_model_keeps_its_sites(data):
    """Sites are fixed to the body.

    Turning the model's ground about the vertical changes none of them.
    """
    model = read_model(data(OSIM[0]))
    turn = Transform.from_euler_xyz((0.0, 0.7, 0.0), (0.3, 0.0, -0.2))
    joints = tuple(
        replace(one, parent_frame=turn @ one.parent_frame) if one.parent == "ground" else one
        for one in model.joints
    )
    for one, other in zip(
        foot_sites(model), foot_sites(replace(model, joints=joints)), strict=True
    ):
        assert_allclose(one.points, other.points, atol=1e-9)


def test_every_subject_of_a_joined_model_has_its_feet(data):
    model = read_model(data(OSIM[0]))
    joined = join_models({"tori": model, "uke": model})
    own = foot_sites(model)
    found = foot_sites(joined)
    assert {one.group for one in found} == {
        f"{part}_foot_{side}" for part in ("tori", "uke") for side in "rl"
    }
    by_name = {one.name: one for one in found}
    for part in ("tori", "uke"):
        for one in own:
            assert by_name[f"{part}_{one.name}"].body == f"{part}_{one.body}"
            assert_allclose(by_name[f"{part}_{one.name}"].points, one.points, atol=1e-9)


def test_bones_tell_where_a_sole_is(data):
    model = read_model(data(OSIM[0]))
    surfaces, _ = read_surfaces(model, [data("bones-opensim-rajagopal/Geometry")])
    by_bones = {one.name: one.points[0] for one in foot_sites(model, surfaces)}
    for one in foot_sites(model):
        # Proportions and bones agree to the width of a finger.
        assert np.linalg.norm(by_bones[one.name] - one.points[0]) < 0.025
    tip = surfaces["r_bofoot.vtp"].vertices[:, 0].max() * model.body("toes_r").meshes[0].scale[0]
    assert by_bones["toe_medial_r"][0] == pytest.approx(tip, abs=1e-6)


def one_body_foot(model: Model, place: np.ndarray) -> Model:
    """Make a model of calcaneus and toes as one body.

    Parameters
    ----------
    model : with a foot of two bodies
    place : of the new body's origin in ground, (3,) [m]

    Returns
    -------
    a model of the foot alone, where the other has it
    """
    poses = standing_poses(model)
    parts = [model.body(name) for name in ("calcn_r", "toes_r")]
    centers = [poses[part.name].apply(part.mass_center) for part in parts]
    mass = sum(part.mass for part in parts)
    center = sum(part.mass * at for part, at in zip(parts, centers, strict=True)) / mass
    inertia = np.zeros((3, 3))
    for part, at in zip(parts, centers, strict=True):
        turn = poses[part.name].rotation
        away = at - center
        inertia += turn @ part.inertia @ turn.T
        inertia += part.mass * (away @ away * np.eye(3) - np.outer(away, away))
    foot = Body(name="foot_r", mass=mass, mass_center=center - place, inertia=inertia)
    ankle = Joint(
        name="ankle_r",
        kind="WeldJoint",
        parent="ground",
        child="foot_r",
        parent_frame=Transform(np.eye(3), place),
        child_frame=Transform.identity(),
    )
    return Model(
        name="foot", bodies=(foot,), joints=(ankle,), coordinates=(), gravity=model.gravity
    )


@pytest.mark.parametrize("origin", ["calcn_r", "talus_r"])
@pytest.mark.parametrize("name", OSIM)
def test_a_foot_of_one_body_has_its_sole_wherever_its_origin_is(data, name, origin):
    model = read_model(data(name))
    poses = standing_poses(model)
    whole = one_body_foot(model, poses[origin].translation)
    expected = {one.name: poses[one.body].apply(one.points[0]) for one in foot_sites(model)}
    for one in foot_sites(whole):
        at = standing_poses(whole)[one.body].apply(one.points[0])
        assert np.linalg.norm(at - expected[one.name]) < 0.035


def test_a_foot_of_a_made_up_inertia_has_its_origin_at_the_heel(data):
    model = read_model(data(OSIM[0]))
    whole = one_body_foot(model, standing_poses(model)["calcn_r"].translation)
    point_like = replace(whole, bodies=(replace(whole.bodies[0], inertia=1e-6 * np.eye(3)),))
    (foot,) = feet_of(point_like)
    assert_allclose(foot.origin, standing_poses(model)["calcn_r"].translation, atol=1e-9)
    assert foot.length == pytest.approx(feet_of(model)[0].length, rel=0.2)


def test_no_foot_is_guessed(data):
    for name in (
        "opensim-reference-small/arm26_bounds.osim",
        "mouse-skeleton-keypoints/mouse_with_meshes.xml",
    ):
        with pytest.raises(BadData, match="name contact sites"):
            foot_sites(read_model(data(name)))


def test_sites_of_hands_and_seat(data):
    model = read_model(data(OSIM[0]))
    hand, seat, back = body_sites(model, ("hand_r", "seat", "back"))
    assert hand.body == "hand_r"
    assert hand.cone.direction is None
    poses = standing_poses(model)
    hips = poses["femur_r"].translation[1]
    assert 0.05 < hips - poses["pelvis"].apply(seat.points).mean(axis=0)[1] < 0.12
    assert poses["torso"].apply(back.points)[:, 0].mean() < poses["torso"].translation[0]
    with pytest.raises(UnknownName, match="hand_r"):
        body_sites(model, ("nose",))


def test_hips_in_one_point_have_no_seat(data):
    """So are those of the mouse's hindlimb and its mirror image."""
    model = read_model(data(OSIM[0]))
    middle = Transform(np.eye(3), np.zeros(3))
    joints = tuple(
        replace(one, parent_frame=middle) if one.child.startswith("femur") else one
        for one in model.joints
    )
    with pytest.raises(BadData, match="no two hips"):
        body_sites(replace(model, joints=joints), ("seat",))


def test_a_cluster_is_where_most_values_lie():
    values = np.concatenate(
        [np.linspace(0.3, 1.0, 70), np.full(40, 0.2) + 0.001 * np.arange(40) / 40]
    )
    assert cluster(values) == pytest.approx(0.2005, abs=1e-3)


@pytest.fixture(scope="module")
def walk(data):
    """Return the walk of Rajagopal's example, and its plates at the motion's times."""
    model = read_model(data(OSIM[0]))
    whole = motion_from_table(read_sto(data("rajagopal-walk-emg/coordinates.sto")), model)
    thin = type(whole)(whole.time[::10], whole.names, whole.values[::10])
    motion = differentiate(thin, 6.0)
    return (
        model,
        motion,
        resample_wrenches(
            read_external_loads(data("rajagopal-walk-emg/grf_walk.xml")), motion.time, 20.0
        ),
    )


def test_soles_rest_on_the_floor_of_the_plates(walk):
    model, motion, wrenches = walk
    height = plate_height(model, wrenches)
    assert height == pytest.approx(0.0, abs=1e-6)
    sites, floor = rest_on_floor(model, motion, foot_sites(model), height)
    again, _ = rest_on_floor(model, motion, sites, height)
    for one, other in zip(sites, again, strict=True):
        assert_allclose(one.points, other.points, atol=1e-3)
    assert abs(floor_under(site_motion(model, motion, sites)).height) < 0.01
    assert not floor.velocity.any()


def test_centers_of_pressure_lie_inside_the_soles(walk):
    """Measured centers of pressure of a loaded foot are inside the polygon of its sites.

    Outside it they are no farther than a finger's breadth.
    """
    model, motion, wrenches = walk
    sites, _ = rest_on_floor(model, motion, foot_sites(model), 0.0)
    moving = site_motion(model, motion, sites)
    for foot, group in ((0, "foot_r"), (1, "foot_l")):
        members = [k for k, one in enumerate(sites) if one.group == group]
        loaded = wrenches.forces[:, foot, 1] > 0.3 * model.mass * 9.81
        corners = moving.places[loaded][:, [members[k] for k in (0, 2, 4, 5, 3, 1)]][..., [0, 2]]
        point = wrenches.points[loaded, foot][:, [0, 2]]
        assert np.mean(_outside(corners, point) < 0.02) > 0.97


def _outside(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of points (frames, 2) outside convex polygons (frames, corners, 2), 0 inside."""
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    side = np.einsum("fki,fki->fk", points[:, None] - corners, normals)
    middle = np.einsum("fki,fki->fk", corners.mean(axis=1, keepdims=True) - corners, normals)
    return np.maximum((side * -np.sign(middle)).max(axis=1), 0.0)


def test_a_foot_that_swings_throughout_has_the_sole_of_the_other(data):
    """In the swing of one leg alone its lowest frames are no stance.

    They once put its sole far under the floor.
    """
    walk = measured_walk(data)
    rows = (walk.motion.time > 0.6) & (walk.motion.time < 0.8)
    part = Motion(walk.motion.time[rows], walk.motion.names, walk.motion.values[rows])
    before = foot_sites(walk.model)
    sites, floor = rest_on_floor(walk.model, part, before, 0.0)
    for short, long in zip(sites, walk.sites, strict=True):
        assert_allclose(short.points, long.points, atol=0.015)
    assert_allclose(floor_under(site_motion(walk.model, part, sites), 0.0).velocity, 0.0)
    found = find_contacts(walk.model, part, sites, ContactStateOptions(floor=floor.height))
    assert {one.site[-1] for one in found.intervals} == {"r"}


def test_sites_are_found_by_their_whole_name(data):
    model = read_model(data(OSIM[0]))
    with pytest.raises(UnknownName, match=r"'hand_rr'.*'hand_r'"):
        body_sites(model, ["hand_rr"])

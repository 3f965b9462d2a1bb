"""Mass points without a skin: they weigh, balance and turn as the model's bodies do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from skins import sphere

from myomorph.body.shape.envelope import HULL, INERTIA, TISSUE, envelope_points
from myomorph.body.shape.points import MassPoints, links_of
from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Body, Mesh
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform


def default_pose(model):
    return Motion(np.zeros(1), (), np.zeros((1, 0)))


def own_parameters(model, found, spacing):
    from scipy import sparse

    count = len(found.points)
    weights = sparse.csr_array(
        (np.ones(count), (np.arange(count), found.link)), (count, len(model.bodies))
    )
    points = MassPoints(
        points=found.points,
        reference=found.masses,
        weights=weights,
        links=links_of(model, default_pose(model)),
        spacing=spacing,
    )
    return points.parameters(points.reference)


def test_ellipsoids_have_the_bodies_own_parameters(data):
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    found = envelope_points(model, default_pose(model), 0.005)
    expected = inertial_parameters(model)
    got = own_parameters(model, found, 0.005)
    for name, own, points in zip(model.body_names, expected, got, strict=True):
        if name.startswith("patella"):
            continue
        np.testing.assert_allclose(points, own, atol=1e-9 * own[4:7].max(), err_msg=name)
    assert INERTIA in found.words
    assert found.masses.sum() == pytest.approx(model.mass, rel=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        "opensim-gait-subject01/ref_id/subject01.osim",
        "hamner-run-subject04/unscaled_generic.osim",
        "opencap-subject4-multitask/models/manually_scaled.osim",
    ],
)
def test_points_have_the_second_moments_of_every_body_that_counts(data, name):
    """Torsos that stand for head and arms are thinner than tissue: they had half their inertia."""
    model = read_model(data(name))
    expected = inertial_parameters(model)
    got = own_parameters(model, envelope_points(model, default_pose(model), 0.02), 0.02)
    heavy = expected[:, 0] > 0.01 * model.mass
    sizes = expected[heavy, 4:7].max(axis=1)
    off = np.abs(got[heavy] - expected[heavy]).max(axis=1)
    assert (off < 1e-9 * sizes).all()


def test_an_inertia_that_no_points_have_is_refused_by_name(data):
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    tibia = model.body("tibia_r")
    wrong = replace(tibia, inertia=np.diag([0.01, 0.2, 0.05]))
    bodies = tuple(wrong if body.name == "tibia_r" else body for body in model.bodies)
    with pytest.raises(BadData, match=r"'tibia_r' .* has an inertia that no body can have"):
        envelope_points(replace(model, bodies=bodies), default_pose(model))


def test_hulls_have_the_volume_of_the_bodys_mass(data):
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    i = model.body_names.index("femur_r")
    mesh = Mesh("ball", Transform(np.eye(3), np.array([0.0, -0.1, 0.0])), np.ones(3))
    # A guessed inertia, as that of vertebrae in many models, tells no size.
    ball = Body(
        name="femur_r",
        mass=8.0,
        mass_center=np.array([0.0, -0.1, 0.0]),
        inertia=1e-4 * np.eye(3),
        meshes=(mesh,),
    )
    bodies = (*model.bodies[:i], ball, *model.bodies[i + 1 :])
    model = replace(model, bodies=bodies)
    for radius in (0.05, 0.3):
        found = envelope_points(model, default_pose(model), 0.005, {"ball": sphere(radius)})
        assert HULL in found.words
        count = (found.link == i).sum()
        assert count * 0.005**3 == pytest.approx(8.0 / TISSUE, rel=0.01)
        links = links_of(model, default_pose(model))
        center = links.origins[i] + links.rotations[i] @ [0.0, -0.1, 0.0]
        reach = np.linalg.norm(found.points[found.link == i] - center, axis=1).max()
        assert reach == pytest.approx((8.0 / TISSUE * 0.75 / np.pi) ** (1 / 3), rel=0.06)


@pytest.mark.parametrize(
    "name",
    [
        "fullbody-many-muscles/cyclistFullBodyMuscle.osim",
        "opensim-reference-small/arm26_bounds.osim",
        "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    ],
)
def test_every_body_with_mass_has_points_inside_any_model(data, name):
    model = read_model(data(name))
    found = envelope_points(model, default_pose(model), 0.02)
    heavy = {i for i, body in enumerate(model.bodies) if body.mass >= 1e-3}
    assert set(found.link.tolist()) == heavy
    masses = np.bincount(found.link, found.masses, len(model.bodies))
    np.testing.assert_allclose(
        masses[list(heavy)], [model.bodies[i].mass for i in heavy], rtol=1e-12
    )
    assert np.isfinite(found.points).all()


def test_what_cannot_be(data):
    model = read_model(data("opensim-reference-small/arm26_bounds.osim"))
    with pytest.raises(BadData, match="above 0"):
        envelope_points(model, default_pose(model), 0.0)
    with pytest.raises(BadData, match="wider spacing"):
        envelope_points(model, default_pose(model), 1e-4)
    light = replace(model, bodies=tuple(replace(body, mass=0.0) for body in model.bodies))
    with pytest.raises(BadData, match="nothing to fill"):
        envelope_points(light, default_pose(model))

import numpy as np
import pytest

from made_bodies import AXES, made_body
from myomorph.body.identify.validation import consistency
from myomorph.body.shape.weights import nearest_weights
from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters


@pytest.fixture(scope="module")
def body():
    return made_body(0.05, 5, nearest_weights)


@pytest.fixture(scope="module")
def parameters(body):
    return body.parameters(body.reference)


def in_ellipsoid(points):
    return (((points - [0.3, 1.0, -0.2]) / AXES) ** 2).sum(axis=1) < 1.0


def test_masses_of_points_are_bodies(body, parameters):
    report = consistency(body.links.names, parameters, points=body, inside=in_ellipsoid)
    assert report.ok
    assert report.verdict == "all 5 links are physically possible, 5 mass centers inside the body"
    for link, row in zip(report.links, parameters, strict=True):
        assert link.mass == row[0]
        assert np.allclose(link.center, row[1:4] / row[0])
        assert (link.eigenvalues > 0.0).all()
        assert (link.second_moments > 0.0).all()
        a, b, c = link.moments
        assert a + b > c >= b >= a


def test_principal_moments_are_those_of_a_box():
    m = 2.0
    x = 0.1
    y = 0.2
    z = 0.4
    c = np.array([0.5, -0.3, 0.2])
    about = m / 12 * np.array([y**2 + z**2, z**2 + x**2, x**2 + y**2])
    inertia = np.diag(about) + m * (c @ c * np.eye(3) - np.outer(c, c))
    row = [m, *(m * c), *np.diag(inertia), inertia[1, 2], inertia[2, 0], inertia[0, 1]]
    link = consistency(["box"], [row]).links[0]
    assert np.allclose(link.moments, np.sort(about), rtol=1e-12)
    assert np.allclose(link.second_moments, m / 12 * np.array([x, y, z]) ** 2, rtol=1e-12)


def test_each_fault_is_named(body, parameters):
    wrong = parameters.copy()
    wrong[0, 0] = -0.5
    R = body.links.rotations[1]
    p = body.links.origins[1]
    center = wrong[1, 1:4] / wrong[1, 0]
    away = R.T @ (np.array([5.0, 1.0, 0.0]) - p)
    inertia = wrong[1, 0] * (away @ away * np.eye(3) - np.outer(away, away) + 0.01 * np.eye(3))
    wrong[1] = [
        wrong[1, 0],
        *(wrong[1, 0] * away),
        *np.diag(inertia),
        inertia[1, 2],
        inertia[2, 0],
        inertia[0, 1],
    ]
    wrong[2, 4] *= 5.0
    wrong[3] = 0.0
    wrong[4, 0] = 0.0
    report = consistency(body.links.names, wrong, points=body)
    assert not report.ok
    assert [bool(link.faults) for link in report.links] == [True, True, True, False, True]
    assert report.links[0].faults == ("mass -0.5 kg",)
    assert report.links[1].faults == ("mass center outside the body",)
    assert "no mass can have these moments" in report.links[2].faults[0]
    assert report.links[3].massless
    assert report.links[4].faults == ("moments without mass",)
    assert report.verdict.startswith(
        "4 of 5 links are not physically possible: 'link0': mass -0.5 kg; 'link1'"
    )
    assert not np.allclose(center, away)


def test_without_a_skin_nothing_is_said_of_it(body, parameters):
    report = consistency(body.links.names, parameters)
    assert all(link.inside is None for link in report.links)
    assert report.verdict.endswith("mass centers not checked")


def test_a_real_model(data):
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    report = consistency(model.body_names, inertial_parameters(model))
    assert len(report.links) == len(model.bodies)
    assert np.allclose([link.mass for link in report.links], [body.mass for body in model.bodies])


def test_bad_input_is_named(body, parameters):
    with pytest.raises(BadData, match="another order"):
        consistency(body.links.names[::-1], parameters, points=body)
    with pytest.raises(BadData, match="expected finite parameters"):
        consistency(body.links.names, parameters[:3])

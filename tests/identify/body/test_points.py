import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from myomorph.body.shape.points import Links, MassPoints
from myomorph.core.model.inertia import inertia_matrices


def test_parameters_of_points_are_those_of_equation_3_9():
    random = np.random.default_rng(0)
    links = 3
    points = 40
    rotations = Rotation.random(links, rng=random).as_matrix()
    origins = random.normal(size=(links, 3))
    weights = random.uniform(size=(points, links))
    weights /= weights.sum(axis=1, keepdims=True)
    x = random.normal(size=(points, 3))
    rho = random.uniform(size=points)
    made = MassPoints(
        points=x,
        reference=rho,
        weights=sparse.csr_array(weights),
        links=Links(names=("a", "b", "c"), rotations=rotations, origins=origins, centers=origins),
        spacing=0.1,
    ).parameters(rho)
    for i in range(links):
        r = (x - origins[i]) @ rotations[i]
        shares = weights[:, i] * rho
        inertia = sum(
            m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(shares, r, strict=True)
        )
        assert np.isclose(made[i, 0], shares.sum())
        assert np.allclose(made[i, 1:4], shares @ r, atol=1e-12)
        assert np.allclose(inertia_matrices(made[i]), inertia, atol=1e-12)

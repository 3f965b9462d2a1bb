"""The demo of a morph: its truth is a truth, and a dense morph halves the errors of scaling."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from docs_build.examples import DOCS, run_page

from myomorph.bones.deformed_leg import LANDMARKS, demo_case, picked_landmarks
from myomorph.bones.demo import ERRORS, RESULT, WRITTEN, run_morph_demo, summary
from myomorph.bones.morph.checks.penetration import Solid
from myomorph.core.io.formats import read_model


@pytest.fixture(scope="module")
def case():
    return demo_case()


def test_the_deformation_keeps_orientation_and_its_slopes_are_its_own(case):
    _, ours, _, truth = case
    for body, surface in ours.items():
        points = surface.vertices[::7]
        slopes = truth[body].jacobian(points)
        assert np.linalg.det(slopes).min() > 0.5
        step = 1e-6
        numeric = np.stack(
            [
                (truth[body].apply(points + step * one) - truth[body].apply(points - step * one))
                / (2 * step)
                for one in np.eye(3)
            ],
            axis=-1,
        )
        np.testing.assert_allclose(slopes, numeric, atol=1e-8)


def test_the_left_bones_in_the_mirror_are_the_right_ones(case):
    _, ours, theirs, truth = case
    for body, surface in ours.items():
        # Every corner of the right bone is one of the target's, deformed; the target has more.
        carried = truth[body].apply(surface.vertices)
        assert Solid(theirs[body]).distances(carried).max() < 1e-9
        assert len(theirs[body].faces) == 4 * len(surface.faces)


def test_a_bone_keeps_the_frame_it_had(case):
    for one in case[3].values():
        np.testing.assert_allclose(one.apply(np.zeros(3)), 0.0, atol=1e-15)


def test_landmarks_are_picked_alike_each_time(case):
    _, ours, _, truth = case
    one = picked_landmarks(ours, truth)
    other = picked_landmarks(ours, truth)
    for body, points in one.items():
        assert len(points) == LANDMARKS
        np.testing.assert_array_equal(points.target, other[body].target)
        errors = np.linalg.norm(points.target - truth[body].apply(points.source), axis=1)
        assert 0.0 < errors.mean() < 0.004


@pytest.mark.long
def test_the_tutorial_runs_and_its_demo_ends_in_a_report_with_errors_against_the_truth(
    tmp_path, data, monkeypatch
):
    demos = []

    def kept(out):
        demos.append(run_morph_demo(out))
        return demos[-1]

    monkeypatch.setattr("myomorph.bones.demo.run_morph_demo", kept)
    run_page(DOCS / "tutorials" / "other-bones.md", tmp_path, data)
    (found,) = demos
    page = (tmp_path / found.report).read_text(encoding="utf-8")
    assert "synthetic" in page
    assert "Error against the truth" in page
    errors = found.errors
    scaling = errors.distances[f"scaling, {LANDMARKS} landmarks"]
    assert np.median(errors.distances[WRITTEN]) < 0.5 * np.median(scaling)
    # A few via points are brought out of bones, away from where the map alone puts them.
    assert np.percentile(errors.distances[WRITTEN], 95.0) < 0.5 * np.percentile(scaling, 95.0)
    assert np.median(errors.arms[WRITTEN]) < np.median(
        errors.arms[f"scaling, {LANDMARKS} landmarks"]
    )
    with (tmp_path / "morph" / ERRORS).open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(errors.points)
    assert float(rows[0][f"{WRITTEN} [m]"]) == pytest.approx(errors.distances[WRITTEN][0], rel=1e-5)
    written = read_model(tmp_path / "morph" / RESULT)
    assert written.muscle_names == found.morphed.morph.model.muscle_names
    assert any("scaling" in line for line in summary(found))

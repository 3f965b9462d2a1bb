"""Markers that move more than the mass.

The law is inverted, alphas are recovered, and none is found where there is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.least_squares import Blocks
from myomorph.body.identify.recordings import RecordingOptions, usable
from myomorph.body.identify.subject import IdentificationOptions, identify
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.soft_tissue import SoftTissue, coordinate_groups
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.regressor import base_regressor, reference_points
from myomorph.lab.report.trial.identification_tables import identification_tables
from myomorph.lab.study.inputs.soft_tissue import read_soft_tissue
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape

ALPHA = 4e-4


def test_the_law_of_a_sine():
    """1 / (1 + alpha w^2) of values and both derivatives, away from the ends.

    A steady movement stays.
    """
    time = np.arange(0.0, 4.0, 0.005)
    w = 2.0 * np.pi * 3.0
    sine = np.sin(w * time)
    line = 1.0 + 2.0 * time
    motion = differentiate(Motion(time, ("a", "b"), np.column_stack([sine, line])))
    tissue = SoftTissue(
        names=("a", "b"), groups=("g", "g"), alpha=np.full(2, ALPHA), sd=np.zeros(2)
    )
    soft = tissue.of(motion)
    inside = slice(100, -100)
    gain = 1.0 / (1.0 + ALPHA * w**2)
    for got, expected in (
        (soft.values, np.column_stack([gain * sine, line])),
        (soft.velocities, np.column_stack([gain * w * np.cos(w * time), np.full(len(time), 2.0)])),
        (soft.accelerations, np.column_stack([-gain * w**2 * sine, np.zeros(len(time))])),
    ):
        scale = np.abs(expected).max(axis=0) + 1e-3
        np.testing.assert_allclose(got[inside] / scale, expected[inside] / scale, atol=3e-3)
    np.testing.assert_allclose(tissue.shown(soft)[inside], motion.values[inside], atol=3e-3)


def test_gaps_stay_gaps_and_other_names_stay_as_they_are():
    time = np.arange(0.0, 1.0, 0.01)
    values = np.column_stack([np.sin(9.0 * time), np.cos(9.0 * time)])
    values[40:45] = np.nan
    motion = differentiate(Motion(time, ("a", "b"), values))
    soft = SoftTissue(names=("a",), groups=("g",), alpha=np.array([ALPHA]), sd=np.zeros(1)).of(
        motion
    )
    assert (np.isnan(soft.accelerations) == np.isnan(motion.accelerations)).all()
    np.testing.assert_array_equal(soft.values[:, 1], motion.values[:, 1])
    assert np.nanmax(np.abs(soft.values[:, 0] - motion.values[:, 0])) > 1e-3


def test_what_cannot_be():
    with pytest.raises(BadData, match="alpha"):
        SoftTissue(names=("a",), groups=("g",), alpha=np.array([-1.0]), sd=np.zeros(1))
    with pytest.raises(BadData, match="differentiate"):
        SoftTissue(names=("a",), groups=("g",), alpha=np.ones(1), sd=np.zeros(1)).of(
            Motion(np.zeros(1), ("a",), np.zeros((1, 1)))
        )
    with pytest.raises(BadData, match="soft_tissue"):
        IdentificationOptions(soft_tissue="sometimes")


@pytest.fixture(scope="module")
def runner(arm_and_legs):
    """Make a moving body, the plates' wrench, and mass points.

    The wrench is that of masses other than its model's.
    """
    model, motion = arm_and_legs
    truth = inertial_parameters(model)
    names = list(model.body_names)
    truth[[names.index("femur_r"), names.index("femur_l")]] *= 0.75
    truth *= model.mass / truth[:, 0].sum()
    wrench = base_regressor(model, motion) @ truth.ravel()
    wrenches = Wrenches(
        time=motion.time,
        names=("plate",),
        bodies=(model.body_names[0],),
        forces=wrench[:, None, 3:],
        points=reference_points(model, motion)[:, None],
        torques=wrench[:, None, :3],
    )
    points, _, _ = body_points(model, BodyShape(), model.mass, BodyOptions(spacing=0.04))
    return model, motion, wrenches, truth, points


@pytest.fixture(scope="module")
def arm_and_legs(data):
    from myomorph.core.io.formats import read_model

    model = read_model(data("opensim-gait-subject01/ref_id/subject01.osim"))
    model = with_inertial_parameters(model, inertial_parameters(model) * (72.6 / model.mass))
    random = np.random.default_rng(2)
    time = np.arange(0.0, 6.0, 0.01)
    values = np.tile([coordinate.default for coordinate in model.coordinates], (len(time), 1))
    for column, coordinate in enumerate(model.coordinates):
        size = 0.04 if coordinate.motion == "translational" else 0.2
        for frequency in random.uniform(0.4, 3.5, 4):
            values[:, column] += (
                0.5 * size * np.sin(2.0 * np.pi * (frequency * time + random.uniform()))
            )
    return model, differentiate(Motion(time, model.coordinate_names, values))


def identified(runner, alpha):
    model, motion, wrenches, _, points = runner
    markers = Motion(motion.time, motion.names, motion.values - alpha * motion.accelerations)
    recording = usable(model, markers, wrenches, options=RecordingOptions(cutoff=8.0))
    options = IdentificationOptions(compare=False)
    return identify(
        model, [recording], points, options=options, recording=RecordingOptions(cutoff=8.0)
    )


def test_alphas_and_masses_are_found_again(runner):
    model, motion, _, truth, _ = runner
    found = identified(runner, ALPHA)
    assert found.soft_tissue is not None
    np.testing.assert_allclose(found.soft_tissue.alpha, ALPHA, rtol=0.15)
    assert set(found.soft_tissue.by_group) == {
        "pelvis, translation",
        "pelvis, rotation",
        "femur",
        "torso",
    }
    rows = base_regressor(model, motion)
    wrench = rows @ (found.parameters[found.identified] - truth).ravel()
    generic = rows @ (inertial_parameters(model) - truth).ravel()
    assert np.sqrt(np.mean(wrench**2)) < 0.4 * np.sqrt(np.mean(generic**2))


def test_nothing_is_found_where_markers_move_as_the_mass(runner):
    assert identified(runner, 0.0).soft_tissue is None


def test_groups_are_those_of_both_sides(runner):
    model = runner[0]
    groups = dict(zip(model.coordinate_names, coordinate_groups(model), strict=True))
    assert groups["hip_flexion_r"] == groups["knee_angle_l"] == "femur"
    assert groups["pelvis_ty"] != groups["pelvis_tilt"] != groups["lumbar_extension"]


def test_rows_in_blocks_are_those_of_the_whole(runner):
    """Filtered block by block, with what the filter reaches beside each, or all at once."""
    model, motion, wrenches, _, _ = runner
    recording = usable(model, motion, wrenches, options=RecordingOptions(cutoff=8.0)).recording
    whole = recording.finer.passed(base_regressor(model, recording.finer.motion))
    parts = recording.rows(model, Blocks(frames=150))
    blocks = np.concatenate([part.rows for part in parts])
    np.testing.assert_allclose(blocks, whole, atol=2e-3 * np.abs(whole).max())
    truth = runner[3]
    missing = np.concatenate(
        [part.rows @ truth.ravel() - part.wrench for part in recording.rows(model)]
    )
    np.testing.assert_allclose(recording.missing(model, truth), missing, atol=0.5)


def test_filtered_products_explain_filtered_forces(runner):
    """True masses leave less where rows are filtered after they are made.

    The comparison filters angles before.
    """
    model, motion, wrenches, truth, _ = runner
    recording = usable(model, motion, wrenches, options=RecordingOptions(cutoff=4.0)).recording
    before = replace(recording, finer=None).missing(model, truth)[recording.use]
    after = recording.missing(model, truth)[recording.use]
    assert np.sqrt(np.mean(after**2)) < 0.2 * np.sqrt(np.mean(before**2))


def test_the_table_is_read_again_and_changes_forces(runner, tmp_path):
    """`id` takes from the motion what `identify` writes.

    Another table is refused with what to try.
    """
    found = identified(runner, ALPHA)
    path = tmp_path / "soft_tissue.csv"
    path.write_text(identification_tables(found, {})[path.name].csv(), encoding="utf-8")
    tissue = read_soft_tissue(path)
    assert tissue.names == found.soft_tissue.names
    np.testing.assert_allclose(tissue.alpha, found.soft_tissue.alpha, rtol=1e-3)
    (tmp_path / "other.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(BadFile, match="identify or refine wrote"):
        read_soft_tissue(tmp_path / "other.csv")

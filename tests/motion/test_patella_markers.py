"""Markers on patellae: whose they are, and what they say of the patellae's distance from knees."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.body.calibrate.patella_fit import (
    AXIS_SD,
    BONE_SD,
    MARKER_SD,
    PLACE_SD,
    SKIN_SD,
    patella_distance,
    patella_readings,
    unlikely_marker_notes,
    with_distance,
)
from myomorph.body.calibrate.patella_markers import (
    markers_on_patellae,
    moved_marker_notes,
    with_markers_on_patellae,
)
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.model import Axis, Coordinate, Marker
from myomorph.core.model.series import Motion
from myomorph.core.motion.protocols import recognize
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.muscles.patella_distance import (
    middle_of_paths,
    patella_directions,
    with_patellae_farther,
)
from myomorph.core.muscles.patella_spread import DISTANCE_SD, TRACK_SD
from myomorph.core.rigid.kinematics import forward_kinematics, standing_poses
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.study.inputs.error_size_tables import read_error_sizes, tables_beside
from myomorph.lab.uncertainty.bodies import Draw, drawn_patellae
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import Sources, source_sizes
from truths.patella_person import Traits, recorded_person

LABELS = (
    *("RASI", "LASI", "RPSI", "LPSI", "C7", "CLAV"),
    *(
        f"{side}{name}"
        for side in "RL"
        for name in ("THI", "KNE", "MKNE", "TIB", "ANK", "MANK", "HEE", "TOE", "MT5")
    ),
)
PATELLAE = ("RPAT", "LPAT")
NOISE = 0.005


@pytest.fixture(scope="module")
def model():
    """Return the generic model with usual markers and one on each patella."""
    pytest.importorskip("myo_sim")
    return generic_model(recognize((*LABELS, *PATELLAE)).sites)[0]


@pytest.fixture(scope="module")
def angles(model):
    """Coordinates (frames, coordinates) of both knees bending [rad or m]."""
    time = np.linspace(0.0, 1.0, 24)
    bend = 0.5 - 0.5 * np.cos(2.0 * np.pi * time)
    names = ("knee_angle_r", "knee_angle_l", "hip_flexion_r", "hip_flexion_l", "pelvis_tx")
    values = np.column_stack([bend, bend[::-1], 0.5 * bend, 0.3 * bend, time])
    return compile_tree(model).coordinates_of(Motion(time, names, values))


def seen(model, angles):
    """Where markers (frames, markers, 3) of a model are [m]."""
    tree = compile_tree(model)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    places = np.array([marker.location for marker in model.markers])
    return forward_kinematics(tree, angles).points(bodies, places)


def put(model, height):
    """Put markers on patellae at a height over their muscle paths [m]."""
    ways = patella_directions(model)
    on = markers_on_patellae(model)

    def placed(marker):
        if marker.name not in on:
            return marker
        middle = middle_of_paths(model, marker.body)
        return replace(marker, location=middle + height * ways[marker.body])

    return model.with_markers(tuple(map(placed, model.markers)))


def found(model, angles, height, sides=PATELLAE):
    """Estimate the distance from exact poses and markers at a height [m]."""
    positions = seen(put(model, height), angles)
    names = list(model.marker_names)
    for name in set(PATELLAE) - set(sides):
        positions[:, names.index(name)] = np.nan
    readings = tuple(patella_readings(model, names, [positions], [angles]))
    return readings, patella_distance(model, readings, NOISE, [6])


def test_labels_of_patellae_are_known_in_any_laboratory() -> None:
    for name in ("RPAT", "LPatella", "PATR", "L_patella", "Anna:RPatella", "RKneecap"):
        site = recognize([name]).sites[name]
        assert site.key == "thigh.patella"
        assert site.side == ("left" if name.upper().startswith("L") else "right")


def test_the_generic_model_has_them_on_patellae_before_the_bone(model) -> None:
    assert dict(markers_on_patellae(model)) == {"RPAT": "patella_r", "LPAT": "patella_l"}
    for name, body in markers_on_patellae(model).items():
        beyond = model.marker(name).location - middle_of_paths(model, body)
        assert float(beyond @ patella_directions(model)[body]) == pytest.approx(0.021, abs=0.001)


def test_a_height_is_what_was_put_there_in_every_frame(model, angles) -> None:
    readings, _ = found(model, angles, 0.03)
    assert [reading.marker for reading in readings] == list(markers_on_patellae(model))
    for reading in readings:
        np.testing.assert_allclose(reading.heights[0], 0.03, atol=1e-12)


@pytest.mark.parametrize("sides", [PATELLAE, ("LPAT",)])
def test_the_estimate_is_the_mean_of_the_normal_law(model, angles, sides) -> None:
    """By conditioning a normal vector, with none of the code of estimates."""
    height = 0.03
    readings, estimate = found(model, angles, height, sides)
    assert estimate is not None
    shared = DISTANCE_SD**2 + BONE_SD**2 + SKIN_SD**2 + MARKER_SD**2
    each = AXIS_SD**2 + TRACK_SD**2 + PLACE_SD**2 + NOISE**2 / 6.0
    covariance = np.full((len(sides), len(sides)), shared) + each * np.eye(len(sides))
    gain = np.linalg.solve(covariance, np.full(len(sides), DISTANCE_SD**2))
    off = np.array([height - reading.expected for reading in readings])
    assert estimate.value == pytest.approx(float(gain @ off), abs=1e-9)
    left = DISTANCE_SD**2 * (1.0 - gain.sum())
    assert estimate.sd == pytest.approx(np.sqrt(left), rel=1e-9)
    assert estimate.share == pytest.approx(float(gain.sum()), rel=1e-9)
    half = estimate.interval.high - estimate.interval.value
    assert half == pytest.approx(1.6448536 * np.sqrt(left), rel=1e-6)


def test_prior_and_markers_alone_never_show_it(model, angles) -> None:
    """Skin, bone and axes leave more than a quarter of the variance, however long the trial."""
    _, estimate = found(model, angles, 0.03)
    readings, _ = found(model, angles, 0.03)
    longest = patella_distance(model, readings, 1e-6, [10**6])
    assert longest is not None
    assert estimate is not None
    assert estimate.share < longest.share < 0.5
    assert not longest.shown
    assert "alone do not show it" in longest.sentence


def test_a_marker_where_the_model_has_it_moves_nothing(model, angles) -> None:
    readings, _ = found(model, angles, 0.02)
    _, estimate = found(model, angles, readings[0].expected)
    assert estimate is not None
    assert abs(estimate.value) < 1e-9


def test_tendons_grow_so_that_fibers_keep_their_lengths(model, angles) -> None:
    _, estimate = found(model, angles, 0.034)
    assert estimate is not None
    moved = with_distance(model, estimate)
    before = default_path_lengths(model) - [one.tendon_slack_length for one in model.muscles]
    after = default_path_lengths(moved) - [one.tendon_slack_length for one in moved.muscles]
    np.testing.assert_allclose(after, before, atol=1e-12)
    for body, way in patella_directions(model).items():
        shift = middle_of_paths(moved, body) - middle_of_paths(model, body)
        np.testing.assert_allclose(shift, estimate.value * way, atol=1e-12)
    pairs = zip(model.muscles, moved.muscles, strict=True)
    longer = [one.name for one, new in pairs if new.tendon_slack_length != one.tendon_slack_length]
    quadriceps = ("recfem", "vasint", "vaslat", "vasmed")
    assert sorted(longer) == sorted(f"{name}_{side}" for name in quadriceps for side in "rl")


def test_without_markers_on_patellae_nothing_is_said(model, angles) -> None:
    readings, estimate = found(model, angles, 0.03, sides=())
    assert readings == ()
    assert estimate is None
    assert with_distance(model, estimate) is model


def test_a_marker_that_is_no_patellas_is_named_and_says_nothing(model, angles) -> None:
    readings, estimate = found(model, angles, 0.07)
    assert estimate is None
    (note,) = unlikely_marker_notes(readings)
    assert "RPAT +49 mm" in str(note)
    likely, _ = found(model, angles, 0.03)
    assert not list(unlikely_marker_notes(likely))


def test_a_marker_on_the_thigh_follows_the_patella_that_it_is_called_after(model) -> None:
    poses = standing_poses(model)
    place = poses["patella_r"].apply(model.marker("RPAT").location)
    on_femur = Marker("RPAT", "femur_r", poses["femur_r"].inverse().apply(place))
    markers = tuple(on_femur if one.name == "RPAT" else one for one in model.markers)
    given = model.with_markers(markers)
    used = with_markers_on_patellae(given)
    assert used.marker("RPAT").body == "patella_r"
    np.testing.assert_allclose(
        used.marker("RPAT").location, model.marker("RPAT").location, atol=1e-12
    )
    (note,) = moved_marker_notes(given, used)
    assert "RPAT (femur_r)" in str(note)
    assert with_markers_on_patellae(used) is used
    assert not list(moved_marker_notes(used, used))


def test_a_patella_that_moves_by_itself_says_nothing(model, angles) -> None:
    """Its own coordinate takes what the marker is farther out."""
    joints = tuple(
        replace(
            joint,
            coordinates=(*joint.coordinates, "glide"),
            axes=(
                *joint.axes,
                Axis(
                    kind="translation",
                    vector=np.array([1.0, 0.0, 0.0]),
                    function=joint.axes[0].function,
                    coordinates=("glide",),
                ),
            ),
        )
        if joint.child == "patella_r"
        else joint
        for joint in model.joints
    )
    free = replace(
        model, joints=joints, coordinates=(*model.coordinates, Coordinate("glide", "translational"))
    )
    assert set(markers_on_patellae(free).values()) == {"patella_l"}


@pytest.fixture(scope="module")
def bones(data):
    """Return files of Rajagopal's model and of the bone that it shares with others."""
    pytest.importorskip("opensim")
    return (
        data("rajagopal-walk-emg/raw/Rajagopal2016.osim"),
        data("bones-opensim-rajagopal/Geometry/r_patella.vtp"),
    )


def calibrated(person, patellae=True):
    """Calibrate the generic model by a person's walk and standing."""
    generic, _ = generic_model(recognize(person.walk.names).sites)
    options = CalibrationOptions(static=person.static, frames=24, patellae=patellae)
    return calibrate(generic, [person.walk], options, path_lengths=default_path_lengths)


def test_people_with_patellae_apart_are_told_apart(bones) -> None:
    """OpenSim moves the patella; the difference found is the markers' share of the true one."""
    estimates = []
    for farther in (-0.006, 0.006):
        person = recorded_person(*bones, 21, Traits(farther=farther, skin=0.005))
        estimates.append(calibrated(person).patella)
    near, far = estimates
    assert far.share == pytest.approx(near.share, abs=0.02)
    assert far.value - near.value == pytest.approx(0.012 * far.share, rel=0.1)
    assert near.interval.holds(-0.006)
    assert far.interval.holds(0.006)


def test_a_calibration_without_them_stays_as_it_was(bones) -> None:
    person = recorded_person(*bones, 22, Traits(patella_markers=False))
    first = calibrated(person)
    second = calibrated(person, patellae=False)
    assert first.patella is None
    assert second.patella is None
    for one, other in zip(first.model.muscles, second.model.muscles, strict=True):
        assert one.tendon_slack_length == other.tendon_slack_length
        for point, same in zip(one.path.points, other.path.points, strict=True):
            assert repr(point) == repr(same)


def test_without_the_option_markers_are_tracked_and_patellae_stay(bones) -> None:
    person = recorded_person(*bones, 23, Traits(farther=0.008))
    moved = calibrated(person)
    stays = calibrated(person, patellae=False)
    assert moved.patella is not None
    assert stays.patella is None
    back = dict.fromkeys(moved.patella.patellae, -moved.patella.value)
    for body in back:
        np.testing.assert_allclose(
            middle_of_paths(with_patellae_farther(moved.model, back), body),
            middle_of_paths(stays.model, body),
            atol=1e-12,
        )
    assert stays.model.marker("RPAT").body == "patella_r"


def test_the_command_writes_what_draws_take(bones, command, tmp_path) -> None:
    person = recorded_person(*bones, 24)
    generic, _ = generic_model(recognize(person.walk.names).sites)
    write_osim(generic, tmp_path / "generic.osim")
    write_trc(person.walk, tmp_path / "walk.trc")
    write_trc(person.static, tmp_path / "static.trc")
    said = command(
        "calibrate",
        "--model",
        tmp_path / "generic.osim",
        "--markers",
        tmp_path / "walk.trc",
        "--static",
        tmp_path / "static.trc",
        "--frames",
        20,
        "--out",
        tmp_path / "person.osim",
    )
    assert said.status == 0, said.err
    assert "which alone do not show it" in said.out
    tables = tmp_path / "person_calibration"
    (row,) = read_rows(tables / "patellae.csv")
    assert row["markers"] == "RPAT LPAT"
    assert float(row["lowest_mm"]) < float(row["farther_mm"]) < float(row["highest_mm"])
    assert "Distance of patellae" in (tables / "report.html").read_text()
    sizes = read_error_sizes(tables_beside(tmp_path / "person.osim"))
    size = sizes.of("patella_distance", "patella_r")
    assert size is not None
    assert size.size == pytest.approx(1e-3 * float(row["sd_mm"]), rel=1e-5)
    assert size.size < Sources().patella_distance
    lines = {one.source: one for one in source_sizes(Sources(), sizes)}
    assert lines["patella_distance"].origin == "calibrate"
    assert lines["patella_distance"].items == 2
    # Both knees are drawn alike, each by its size
    sources = replace(Sources(), patella=0.0)
    drawn = Draw(number=0, sources=sources, normals=Normals(10), found=sizes)
    moves = drawn_patellae(generic, drawn)
    ways = patella_directions(generic)
    steps = [float(moves[body] @ way) for body, way in ways.items()]
    assert steps[0] == pytest.approx(steps[1])
    assert steps[0] != 0.0


def read_rows(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))

"""Force plates: known wrenches through every type, and laws.

Oracles are ezc3d, OpenSim and Plug-in Gait.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.plates import (
    _idle,
    force_plate,
    force_plates,
    plate_axes,
    wrenches_from_plates,
)
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Z_UP_TO_Y_UP, Markers, PlateRecording, Trial
from myomorph.core.model.spatial import rotation_from_euler_xyz

SAMPLES = "c3d-vendor-samples/C3DSamples"
ORIGINS = {
    1: (0.0, 0.0, 0.0),
    2: (0.001, -0.002, -0.04),
    3: (0.12, 0.2, -0.058),
    4: (0.001, -0.002, -0.04),
}


def _a_plate(
    kind: int, rotation: np.ndarray | None = None
) -> tuple[PlateRecording, dict[str, np.ndarray]]:
    """Make a plate of any type, tilted and turned.

    With it are the wrenches (in the laboratory) that its channels represent.
    """
    random = np.random.default_rng(kind)
    axes = rotation_from_euler_xyz((np.pi + 0.1, 0.05, 0.7)) if rotation is None else rotation
    middle = np.array([0.3, -0.2, 0.05])
    local = np.array([[0.2, 0.3, 0], [-0.2, 0.3, 0], [-0.2, -0.3, 0], [0.2, -0.3, 0]])
    force = random.normal(size=(50, 3)) * [40, 60, 50] + [0, 0, -700]
    center = np.column_stack((random.uniform(-0.1, 0.1, (50, 2)), np.zeros(50)))
    torque = np.column_stack((np.zeros((50, 2)), random.normal(size=50) * 5))
    moment = torque + np.cross(center, force)
    origin = np.array(ORIGINS[kind])
    calibration = None
    if kind == 1:
        channels = np.column_stack((force, center[:, :2], torque[:, 2]))
    elif kind == 3:
        channels = _kistler_sensors(
            force, moment - np.cross(force, [0, 0, origin[2]]), origin[0], origin[1]
        )
    else:
        channels = np.hstack((force, moment - np.cross(force, origin)))
        if kind == 4:
            calibration = np.diag([3.0, 3, 11, 2, 2, 1]) + random.normal(size=(6, 6)) * 0.02
            channels = np.linalg.solve(calibration, channels.T).T
    plate = PlateRecording(
        name="p",
        kind=kind,
        corners=local @ axes.T + middle,
        origin=origin,
        channels=channels,
        calibration=calibration,
    )
    return plate, {
        "forces": force @ axes.T,
        "points": center @ axes.T + middle,
        "torques": torque @ axes.T,
    }


def _kistler_sensors(force: np.ndarray, moment: np.ndarray, a: float, b: float) -> np.ndarray:
    """Eight sensor forces with a given resultant; the one vertical freedom is set to zero."""
    vertical = np.array([[1, 1, 1, 1], [b, b, -b, -b], [-a, a, a, -a], [1, -1, 1, -1]])
    z = np.linalg.solve(
        vertical, np.column_stack((force[:, 2], moment[:, :2], np.zeros(len(force)))).T
    ).T
    # Half of the twist is carried by the x sensors, half by the y sensors.
    x34_less_x12 = 0.5 * moment[:, 2] / b
    y14_less_y23 = 0.5 * moment[:, 2] / a
    x = 0.5 * (force[:, :1] + np.column_stack((-x34_less_x12, x34_less_x12)))
    y = 0.5 * (force[:, 1:2] + np.column_stack((y14_less_y23, -y14_less_y23)))
    return np.hstack((x, y, z))


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
def test_known_wrenches_come_back(kind):
    recording, known = _a_plate(kind)
    plate = force_plate(recording)
    for name, values in known.items():
        np.testing.assert_allclose(getattr(plate, name), values, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", [2, 3, 4])
def test_an_origin_written_upside_down_is_repaired(kind):
    recording, known = _a_plate(kind)
    turned = -recording.origin if kind != 3 else recording.origin * [1, 1, -1]
    np.testing.assert_allclose(
        force_plate(replace(recording, origin=turned)).points, known["points"], atol=1e-9
    )


def test_the_makers_correction_of_the_center_of_pressure():
    """Shift of x by 1e-6 x^3 + 0.01 x and of y by 1e-8 x^2 y^3, lengths in mm."""
    recording, known = _a_plate(3, rotation=np.diag([1.0, -1, -1]))
    polynomial = [[0, 0, 1e-6, 0, 0, 0.01], [0, 1e-8, 0, 0, 0, 0]]
    plain = force_plate(recording)
    corrected = force_plate(replace(recording, center_polynomial=np.array(polynomial)))
    middle = recording.corners.mean(axis=0)
    x = 1000 * (plain.points - middle)[:, 0]
    y = -1000 * (plain.points - middle)[:, 1]
    np.testing.assert_allclose(1000 * (corrected.points - middle)[:, 0], x - 1e-6 * x**3 - 0.01 * x)
    np.testing.assert_allclose(-1000 * (corrected.points - middle)[:, 1], y - 1e-8 * x**2 * y**3)
    np.testing.assert_allclose(plain.points, known["points"])


@pytest.mark.parametrize("kind", [5, 6, 7, 11, 12, 21, 99])
def test_other_types_are_refused_by_name(kind):
    recording, _ = _a_plate(2)
    with pytest.raises(BadData, match=rf"'p' is of C3D type {kind}\b.*type 2"):
        force_plate(replace(recording, kind=kind))
    trial = force_plates(
        Trial(plate_recordings=(replace(recording, kind=kind),), plate_time=np.arange(50) / 100)
    )
    assert trial.plates == ()
    assert any(f"type {kind}" in line for line in trial.warnings)


@pytest.mark.parametrize(
    "name",
    [
        f"{SAMPLES}/c3d.org/sample01/Eb015pr.c3d",
        f"{SAMPLES}/c3d.org/sample10/TYPE-4.C3D",
        f"{SAMPLES}/c3d.org/sample10/type-4a.c3d",
        f"{SAMPLES}/others/ADemo1_rewrite_c3d_pc_float.c3d",
        f"{SAMPLES}/others/FunctionalWalk.c3d",
        f"{SAMPLES}/others/Res16bits.c3d",
        "c3d-functional-joints/functional_trials/right_hip.c3d",
        "mouse-gait-c3d-force/Cage6_1R_12_01_26_trial_2.c3d",
    ],
)
def test_plates_are_what_ezc3d_makes_of_them(name, data):
    ezc3d = pytest.importorskip("ezc3d")
    path = data(name)
    theirs = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]
    trial = read_c3d(path)
    assert len(theirs) == len(trial.plate_recordings)
    for recording, other in zip(trial.plate_recordings, theirs, strict=True):
        plate = force_plate(recording)
        unit = {"mm": 1e-3, "m": 1.0}[other["unit_position"]]
        np.testing.assert_allclose(plate.forces, other["force"].T, atol=1e-9)
        pressing = np.abs(plate.forces @ plate_axes(recording.corners)[:, 2])
        loaded = pressing > 0.02 * np.nanmax(pressing)
        np.testing.assert_allclose(
            plate.points[loaded], other["center_of_pressure"].T[loaded] * unit, atol=1e-9
        )
        np.testing.assert_allclose(plate.torques[loaded], other["Tz"].T[loaded] * unit, atol=1e-9)


@pytest.mark.parametrize("number", [2, 5])
def test_plates_are_what_opensim_reads(number, data):
    trial = read_c3d(data(f"c3d-opensim-walking/walking{number}.c3d"))
    table = read_sto(data(f"c3d-opensim-walking/std_cop_walking{number}_grfs.sto"))
    samples = np.rint(table.time * 2000).astype(int)
    for index, recording in enumerate(trial.plate_recordings, start=1):
        plate = force_plate(recording)
        for name, letter, unit in (
            ("forces", "f", 1.0),
            ("points", "p", 1e-3),
            ("torques", "m", 1e-3),
        ):
            theirs = (
                np.column_stack([table[f"{letter}{index}_{axis}"] for axis in (1, 2, 3)]) * unit
            )
            np.testing.assert_allclose(getattr(plate, name)[samples], theirs, rtol=1e-5, atol=2e-5)


@pytest.mark.parametrize("name", ["HC030A/Straight/HC030A05", "HC002D/Turn/HC002D25"])
def test_forces_are_those_of_plug_in_gait(name, data):
    """Plug-in Gait gives, per body mass, the mean of the eleven samples around each frame."""
    trial = force_plates(read_c3d(data(f"c3d-gait-plugingait/{name}.c3d")))
    mass = float(trial.facts["body mass"].split()[0])
    theirs = (
        sum(np.nan_to_num(trial.other_points[f"{side}GroundReactionForce"]) for side in "LR") * mass
    )
    total = sum(plate.forces for plate in trial.plates)
    frames = np.arange(1, len(theirs) - 1)
    mine = np.array([total[10 * frame - 5 : 10 * frame + 6].mean(axis=0) for frame in frames])
    # It leaves out the frames at the edges of a contact.
    firm = theirs[frames, 2] > 0.25 * mass * 9.81
    assert firm.sum() > 60
    np.testing.assert_allclose(mine[firm], theirs[frames][firm], atol=1e-3)


def test_type_2_and_type_4_of_one_recording_agree(data):
    """The type 2 file leaves the crosstalk out, which is a few percent of this plate."""
    two = force_plates(read_c3d(data(f"{SAMPLES}/c3d.org/sample10/TYPE-{2}.C3D"))).plates[0]
    four = force_plates(read_c3d(data(f"{SAMPLES}/c3d.org/sample10/TYPE-{4}.C3D"))).plates[0]
    loaded = np.abs(two.forces[:, 2]) > 100
    assert loaded.sum() > 200
    assert np.abs(two.forces - four.forces)[loaded].max() < 0.06 * np.abs(two.forces).max()
    assert np.nanmedian(np.linalg.norm(two.points - four.points, axis=1)[loaded]) < 0.015


def test_a_turned_laboratory_turns_the_wrenches():
    recording, _ = _a_plate(2)
    turn = rotation_from_euler_xyz((0.4, -1.1, 2.0))
    markers = Markers(
        np.arange(2.0),
        ("m",),
        np.random.default_rng(0).normal(size=(2, 1, 3)) + recording.corners[0],
    )
    trial = Trial(markers=markers, plate_recordings=(recording,), plate_time=np.arange(50) / 100)
    before = force_plates(trial).rotated(turn).plates[0]
    after = force_plates(trial.rotated(turn)).plates[0]
    np.testing.assert_allclose(
        trial.rotated(turn).markers.values[1, 0], turn @ markers.values[1, 0]
    )
    for name in ("forces", "points", "torques", "corners"):
        np.testing.assert_allclose(getattr(before, name), getattr(after, name), atol=1e-9)


def test_a_reflection_is_no_rotation():
    with pytest.raises(BadData, match="rotation"):
        Trial().rotated(np.diag([1.0, 1, -1]))
    np.testing.assert_array_equal(Z_UP_TO_Y_UP @ [0, 0, 1], [0, 1, 0])


@pytest.mark.parametrize("scale", [1.0, 3e-4])
def test_loading_is_judged_by_the_plates_own_size(scale):
    """A mouse of 0.2 N and a person of 700 N stand on the plate for the same samples."""
    time = np.arange(2000) / 1000
    push = -700.0 * scale * np.clip(np.sin(2 * np.pi * time), 0, None)
    noise = np.random.default_rng(0).normal(size=(2000, 6)) * scale
    channels = noise + np.column_stack((np.zeros((2000, 2)), push, np.zeros((2000, 3))))
    recording = replace(_a_plate(2)[0], origin=np.zeros(3), channels=channels)
    plate = force_plates(Trial(plate_recordings=(recording,), plate_time=time)).plates[0]
    loaded = np.isfinite(plate.points).all(axis=1)
    assert loaded[20:480].all()
    assert not loaded[510:990].any()


def test_a_plate_that_nobody_steps_on_is_unloaded():
    channels = np.random.default_rng(0).normal(size=(2000, 6))
    recordings = tuple(
        replace(_a_plate(2)[0], channels=values) for values in (channels, np.full((2000, 6), 80.0))
    )
    trial = force_plates(Trial(plate_recordings=recordings, plate_time=np.arange(2000) / 1000))
    assert all(np.isnan(plate.points).all() for plate in trial.plates)
    wrenches = wrenches_from_plates(trial.plates, trial.plate_time)
    assert not wrenches.forces.any()
    assert np.isfinite(wrenches.points).all()


def test_an_idle_reading_is_told(data):
    found = force_plates(read_c3d(data("c3d-opensim-walking/walking2.c3d")))
    assert any("nobody on it" in line for line in found.warnings)
    for plate in found.plates:
        assert abs(np.median(plate.forces[np.isnan(plate.points).any(axis=1), 2])) > 10


@pytest.mark.parametrize(("idle", "named"), [(11, True), (8, False)])
def test_an_idle_reading_needs_more_than_ten_samples(idle, named):
    """A plate on which somebody stands all along shows its rest in hardly a sample."""
    push = np.full(2000, -700.0)
    push[:idle] = -15.0
    recording = replace(
        _a_plate(2)[0], channels=np.column_stack((np.zeros((2000, 2)), push, np.zeros((2000, 3))))
    )
    found = force_plates(Trial(plate_recordings=(recording,), plate_time=np.arange(2000) / 1000))
    assert np.count_nonzero(np.isnan(found.plates[0].points[:, 0])) == idle
    assert any("reads 15 N with nobody on it" in line for line in found.warnings) == named


def test_the_force_lifts_the_subject_whatever_the_sign_of_the_file(data):
    for name in (
        "odd-trc-mot/upside_down_trial2.c3d",
        f"{SAMPLES}/c3d.org/sample24/MotionMonitorC3D.c3d",
    ):
        recorded = read_c3d(data(name))
        trial = force_plates(recorded)
        assert any("reversed" in line for line in trial.warnings)
        for recording, plate in zip(recorded.plate_recordings, trial.plates, strict=True):
            normal = plate_axes(recording.corners)[:, 2]
            side = np.sign(
                np.nanmedian((trial.markers.values - plate.corners.mean(axis=0)) @ normal)
            )
            loaded = np.isfinite(plate.points).all(axis=1)
            if np.abs(plate.forces).max() > 10:
                assert np.median(plate.forces[loaded] @ normal) * side > 0


def test_standing_persons_weigh_what_the_file_says(data):
    for name, mass in (("HC030A/Static/HC030A01", 45.8), ("HC002D/Static/HC002D02", 32.1)):
        trial = force_plates(read_c3d(data(f"c3d-gait-plugingait/{name}.c3d")))
        weight = np.median(
            wrenches_from_plates(trial.plates, trial.plate_time).forces.sum(axis=1)[:, 2]
        )
        assert weight / 9.81 == pytest.approx(mass, rel=0.04)


def test_wrenches_on_another_clock_keep_force_and_moment():
    recording, _ = _a_plate(2)
    markers = Markers(np.zeros(1), ("m",), np.ones((1, 1, 3)))
    trial = force_plates(
        Trial(markers=markers, plate_recordings=(recording,), plate_time=np.arange(50) / 100)
    )
    same = wrenches_from_plates(trial.plates, trial.plate_time)
    np.testing.assert_allclose(same.points[:, 0], trial.plates[0].points, atol=1e-9)
    between = wrenches_from_plates(
        trial.plates, trial.plate_time, (trial.plate_time[:-1] + trial.plate_time[1:]) / 2
    )

    def about_lab(one):
        return one.torques[:, 0] + np.cross(one.points[:, 0], one.forces[:, 0])

    mean = (about_lab(same)[1:] + about_lab(same)[:-1]) / 2
    np.testing.assert_allclose(about_lab(between), mean, atol=1e-9)
    outside = wrenches_from_plates(trial.plates, trial.plate_time, np.array([-1.0, 5.0]))
    assert not outside.forces.any()
    assert outside.bodies == ("",)


def test_wrenches_need_a_plate_and_its_clock():
    with pytest.raises(BadData, match="no force plate"):
        wrenches_from_plates((), np.zeros(0))
    with pytest.raises(BadData, match="50 samples"):
        wrenches_from_plates((force_plate(_a_plate(2)[0]),), np.arange(7.0))


def test_what_an_unloaded_plate_reads_is_a_group_of_its_own():
    small = 12.0 + np.linspace(-1.0, 1.0, 401)
    loaded = np.full(600, 700.0)
    assert _idle(-np.concatenate([small, loaded]), 700.0) == pytest.approx(-12.0)
    # A load that comes slowly passes all sizes: none of them is that of an empty plate.
    assert _idle(np.concatenate([np.linspace(0.0, 210.0, 401), loaded]), 700.0) == 0.0

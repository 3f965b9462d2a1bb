"""Files of inertial sensors as each maker writes them.

They are made here from sensors whose motion is known.
"""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from myomorph.core.io.c3d.write import write_trial
from myomorph.core.io.inertial.read import read_inertial
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.inertial_sensors import InertialSensors, beside
from myomorph.core.model.series import Analog, Markers, Trial
from myomorph.core.model.spatial import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from sensor_files import write_orientations

FRAMES = 40
RATE = 100.0
NAMES = ("Pelvis", "RightUpperLeg")


@pytest.fixture
def sensors():
    rng = np.random.default_rng(0)
    time = np.arange(FRAMES) / RATE
    rotations = rotation_from_vector(
        0.5 * np.sin(3.0 * time[:, None, None] + rng.uniform(0, 6, (1, 2, 3)))
    )
    return InertialSensors(
        time=time,
        names=NAMES,
        orientations=quaternion_from_rotation(rotations),
        angular_velocities=rng.normal(size=(FRAMES, 2, 3)),
        accelerations=9.8 * np.swapaxes(rotations, 2, 3)[..., 2]
        + 0.1 * rng.normal(size=(FRAMES, 2, 3)),
        magnetic_fields=rng.normal(size=(FRAMES, 2, 3)),
    )


def same(read, sensors, *signals):
    """Check that orientations are the same, whichever sign, and signals too."""
    np.testing.assert_allclose(read.time, sensors.time, atol=1e-9)
    for name in signals:
        ours = read.signals[name]
        theirs = sensors.signals[name]
        if name == "orientations":
            ours = rotation_from_quaternion(ours)
            theirs = rotation_from_quaternion(theirs)
        np.testing.assert_allclose(ours, theirs, atol=1e-6)


def words(values):
    return " ".join(f"{value:.10g}" for value in np.ravel(values))


def test_opensim_orientations(tmp_path, sensors):
    path = tmp_path / "walk.sto"
    write_orientations(path, sensors)
    read = read_inertial(path)
    assert read.names == NAMES
    same(read, sensors, "orientations")
    other = tmp_path / "other.sto"
    other.write_text("angles\nversion=1\nnRows=1\nnColumns=2\nendheader\ntime\tknee\n0\t1\n")
    with pytest.raises(BadFile, match="DataType"):
        read_inertial(other)


def test_mvnx(tmp_path, sensors):
    frames = "".join(
        f'<frame time="{1e3 * time:.3f}" index="{index}" type="normal">'
        f"<orientation>{words(sensors.orientations[index, :1])}</orientation>"
        f"<sensorOrientation>{words(sensors.orientations[index])}</sensorOrientation>"
        f"<sensorMagneticField>{words(sensors.magnetic_fields[index])}</sensorMagneticField></frame>"
        for index, time in enumerate(sensors.time)
    )
    labels = "".join(f'<sensor label="{name}"/>' for name in NAMES)
    text = (
        '<?xml version="1.0"?><mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">'
        '<subject label="s" frameRate="100"><segments><segment id="1" label="Pelvis"/></segments>'
        f"<sensors>{labels}</sensors><frames>"
        '<frame time="0" index="" type="npose"><orientation>1 0 0 0</orientation></frame>'
        f"{frames}</frames></subject></mvnx>"
    )
    path = tmp_path / "walk.mvnx"
    path.write_text(text)
    read = read_inertial(path)
    assert read.names == NAMES
    same(read, sensors, "orientations", "magnetic_fields")
    # Without sensors, the segments, and that is said.
    path.write_text(text.replace("sensorOrientation", "somethingElse"))
    read = read_inertial(path)
    assert read.names == ("Pelvis",)
    assert "segments" in read.warnings[0]
    path.write_text(text.replace(words(sensors.orientations[3]), "1 0 0"))
    with pytest.raises(BadFile, match="3 numbers in sensorOrientation"):
        read_inertial(path)


def xsens_table(path, sensors, index, matrix):
    """One sensor as MT Manager writes it."""
    rotation = rotation_from_quaternion(sensors.orientations[:, index])
    names = [f"Mat[{row}][{column}]" for column in (1, 2, 3) for row in (1, 2, 3)] if matrix else []
    parts = [np.swapaxes(rotation, 1, 2).reshape(-1, 9)] if matrix else []
    if not matrix:
        names = ["Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"]
        parts = [sensors.orientations[:, index]]
    names += [f"{kind}_{axis}" for kind in ("Acc", "Gyr", "Mag") for axis in "XYZ"]
    parts += [
        part[:, index]
        for part in (sensors.accelerations, sensors.angular_velocities, sensors.magnetic_fields)
    ]
    lines = ["// Start Time: Unknown", "// Update Rate: 100.0Hz", "// Filter Profile: human (46.1)"]
    lines.append("\t".join(["PacketCounter", "SampleTimeFine", *names]))
    for frame, row in enumerate(np.hstack(parts)):
        # The counter begins again half way.
        counter = (frame + (1 << 16) - FRAMES // 2) % (1 << 16)
        lines.append("\t".join([str(counter), "", *(f"{value:.9f}" for value in row)]))
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("matrix", [False, True])
def test_xsens_text_of_each_sensor(tmp_path, sensors, matrix):
    paths = [tmp_path / f"MT_012005D6_009-001_00B4279{index}.txt" for index in range(2)]
    for index, path in enumerate(paths):
        xsens_table(path, sensors, index, matrix)
    read = read_inertial(paths)
    assert read.names == ("00B42790", "00B42791")
    same(read, sensors, "orientations", "accelerations", "angular_velocities", "magnetic_fields")


def test_movella_dot(tmp_path, sensors):
    path = tmp_path / "dot.csv"
    head = ["sep=,", "DeviceTag:,LeftShank", "FirmwareVersion:,2.0.0"]
    names = ["PacketCounter", "SampleTimeFine", "Quat_W", "Quat_X", "Quat_Y", "Quat_Z"]
    names += [f"{kind}_{axis}" for kind in ("Acc", "Gyr") for axis in "XYZ"]
    rows = np.hstack(
        (
            sensors.orientations[:, 0],
            sensors.accelerations[:, 0],
            np.degrees(sensors.angular_velocities[:, 0]),
        )
    )
    lines = [",".join(names)] + [
        ",".join([str(frame), str(5_000_000 + 10_000 * frame), *(f"{value:.9f}" for value in row)])
        for frame, row in enumerate(rows)
    ]
    path.write_text("\n".join(head + lines) + "\n")
    read = read_inertial(path)
    assert read.names == ("LeftShank",)
    same(read, sensors.only(NAMES[:1]), "orientations", "accelerations", "angular_velocities")


def test_delsys(tmp_path, sensors):
    """Each channel has its clock; EMG is faster and left out."""
    path = tmp_path / "trigno.csv"
    names = []
    columns = []
    for index, name in enumerate(NAMES):
        names += ["X[s]", f"{name}: EMG {index + 1} [V]"]
        columns += [np.arange(2 * FRAMES) / (2 * RATE), np.zeros(2 * FRAMES)]
        for kind, unit, values in (
            ("ACC", "g", sensors.accelerations[:, index] / 9.80665),
            ("GYRO", "deg/s", np.degrees(sensors.angular_velocities[:, index])),
        ):
            for axis in range(3):
                names += ["X[s]", f"{name}: {kind}.{'XYZ'[axis]} {index + 1} [{unit}]"]
                columns += [sensors.time, values[:, axis]]
    rows = [
        ",".join("" if frame >= len(column) else f"{column[frame]:.10g}" for column in columns)
        for frame in range(2 * FRAMES)
    ]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    read = read_inertial(path)
    assert read.names == ("Pelvis_1", "RightUpperLeg_2")
    same(read, sensors, "accelerations", "angular_velocities")


@pytest.mark.parametrize("new", [False, True])
def test_apdm(tmp_path, sensors, new):
    path = tmp_path / "opal.h5"
    titles = {
        "accelerations": "Accelerometer",
        "angular_velocities": "Gyroscope",
        "magnetic_fields": "Magnetometer",
    }
    with h5py.File(path, "w") as file:
        for index, name in enumerate(NAMES):
            key = f"{1000 + index}"
            ticks = np.asarray(1e6 * (1.6e9 + sensors.time), dtype=np.int64)
            if new:
                group = file.create_group(f"Sensors/{key}")
                group.create_group("Configuration").attrs["Label 0"] = name.encode()
                group["Time"] = ticks
                file[f"Processed/{key}/Orientation"] = sensors.orientations[:, index]
            else:
                group = file.create_group(f"SI-{key}/Calibrated")
                file[f"SI-{key}/Time"] = ticks
                group["Orientation"] = sensors.orientations[:, index]
            for kind, title in titles.items():
                group[title if new else f"{title}s"] = sensors.signals[kind][:, index]
        if not new:
            file.attrs["CaseIdList"] = [b"SI-1000", b"SI-1001"]
            file.attrs["MonitorLabelList"] = [name.encode() for name in NAMES]
    read = read_inertial(path)
    assert read.names == NAMES
    same(read, sensors, "orientations", *titles)


def test_c3d_channels(tmp_path, sensors):
    path = tmp_path / "walk.c3d"
    names = []
    units = []
    columns = []
    for index, name in enumerate(NAMES):
        for kind, unit, values in (
            ("ACC", "g", sensors.accelerations[:, index] / 9.80665),
            ("GYRO", "deg/s", np.degrees(sensors.angular_velocities[:, index])),
        ):
            names += [f"{name}.{kind}.{axis}" for axis in "XYZ"]
            units += [unit] * 3
            columns.append(values)
    trial = Trial(
        Markers(sensors.time, ("A",), np.zeros((FRAMES, 1, 3)) + 0.5),
        analog=Analog(sensors.time, tuple(names), np.hstack(columns), units=tuple(units)),
        plate_time=sensors.time,
    )
    write_trial(path, trial)
    read = read_inertial(path)
    assert read.names == NAMES
    np.testing.assert_allclose(read.accelerations, sensors.accelerations, atol=1e-3)
    np.testing.assert_allclose(read.angular_velocities, sensors.angular_velocities, atol=1e-3)


def test_what_is_no_file_of_sensors_is_refused(tmp_path, sensors):
    with pytest.raises(BadFile, match=r"\.mvnx"):
        read_inertial(tmp_path / "walk.trc")
    for name, text in (("a.csv", "a,b\n1,2\n"), ("a.txt", "nothing\n"), ("a.mvnx", "<mvnx/>")):
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(BadFile, match="expected"):
            read_inertial(path)
    (tmp_path / "a.h5").write_bytes(b"no")
    with pytest.raises(BadFile, match="APDM"):
        read_inertial(tmp_path / "a.h5")
    with pytest.raises(BadData, match="called"):
        beside([sensors, sensors])


def test_parts_and_spans(sensors):
    assert sensors.only(NAMES[1:]).names == NAMES[1:]
    assert len(sensors.between(0.1, 0.2)) == 11
    with pytest.raises(BadData, match="no frame"):
        sensors.between(5.0, 6.0)

"""APDM's CSV files in both layouts: names, clocks, signals, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.inertial.read import read_inertial, sensor_files
from myomorph.core.model.errors import BadFile

START = 1_700_000_000_000_000
RATE = 128.0


@pytest.fixture
def recorded():
    """Accelerations, rates, fields (20, 2, 3) and quaternions (20, 2, 4) of two sensors."""
    random = np.random.default_rng(2)
    quaternions = random.normal(size=(20, 2, 4))
    quaternions /= np.linalg.norm(quaternions, axis=2, keepdims=True)
    return *random.normal(size=(3, 20, 2, 3)), quaternions


def _format_7(recorded):
    names = ("Trunk", "Left Foot")
    head = "Format=7," + ",".join(f"{4000 + i},,,{name}" + "," * 10 for i, name in enumerate(names))
    kinds = "Accelerometer,,,Gyroscope,,,Magnetometer,,,Barometer,Orientation,,,"
    axes = "X,Y,Z,X,Y,Z,X,Y,Z,,S,X,Y,Z"
    lines = [head, f"Time,{kinds},{kinds}", f",{axes},{axes}"]
    for row in range(20):
        cells = [f"{START + round(1e6 * row / RATE)}"]
        for sensor in range(2):
            *vectors, quaternion = [part[row, sensor] for part in recorded]
            cells += [repr(float(x)) for x in (*np.ravel(vectors), 101.3, *quaternion)]
        lines.append(",".join(cells))
    return lines


def _older(recorded):
    titles = ["Time"]
    for name in ("Trunk", "Left Foot"):
        titles += [f"{name}/Acceleration/{axis}" for axis in "XYZ"]
        titles += [f"{name}/Angular Velocity/{axis}" for axis in "XYZ"]
        titles += [f"{name}/Magnetic Field/{axis}" for axis in "XYZ"]
        titles += [f"{name}/Orientation/{axis}" for axis in ("Scalar", "X", "Y", "Z")]
        titles += [f"{name}/Temperature/Scalar"]
    lines = ["Test Name:,walk", "Sample Rate:,128,Hz", ",".join(titles), "s" + ",unit" * 28]
    for row in range(20):
        cells = [f"{0.25 + row / RATE:.9f}"]
        for sensor in range(2):
            *vectors, quaternion = [part[row, sensor] for part in recorded]
            cells += [repr(float(x)) for x in (*np.ravel(vectors), *quaternion, 25.0)]
        lines.append(",".join(cells))
    return lines


@pytest.mark.parametrize("layout", [_format_7, _older])
def test_signals_of_each_sensor(tmp_path, recorded, layout):
    path = tmp_path / "trial.csv"
    path.write_text("\n".join(layout(recorded)) + "\n", encoding="utf-8")
    sensors = read_inertial(path)
    assert sensors.names == ("Trunk", "Left Foot")
    np.testing.assert_allclose(sensors.time, np.arange(20) / RATE, atol=1e-6)
    np.testing.assert_array_equal(sensors.accelerations, recorded[0])
    np.testing.assert_array_equal(sensors.angular_velocities, recorded[1])
    np.testing.assert_array_equal(sensors.magnetic_fields, recorded[2])
    np.testing.assert_array_equal(sensors.orientations, recorded[3])
    assert sensor_files(path) == (path,)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (f"{START + 7812}", f"{START - 5}", "do not rise"),
        (f"{START + 7812}", "now", "not of 29 numbers"),
        ("Accelerometer", "Thermometer", "no sensor"),
    ],
)
def test_a_broken_file_is_named(tmp_path, recorded, old, new, problem):
    text = "\n".join(_format_7(recorded))
    assert old in text
    path = tmp_path / "trial.csv"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(BadFile, match=problem):
        read_inertial(path)

"""Tables of forces with any heading or none give the forces that were written.

What is ambiguous is refused by name.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.force_table import force_layout, holds_forces, read_forces
from myomorph.core.model.errors import BadData, BadFile

RATE = 100.0
TIME = 3.0 + np.arange(120) / RATE
NAMES = {"F": "F?", "COP": "COP?", "M": "M?"}


def _steps() -> dict[str, np.ndarray]:
    """Make two plates (frames, 2, 3), z up.

    Their values are forces [N], centers of pressure [m], free moments and moments about the origin.
    """
    phase = np.pi * np.clip(np.stack([TIME - 3.0, TIME - 3.4], axis=1) / 0.7, 0.0, 1.0)
    size = 800.0 * np.sin(phase)
    force = np.stack([0.1 * size * np.cos(phase), 0.02 * size, size], axis=2)
    point = np.stack([0.3 + 0.2 * phase / np.pi, 0.1 + 0.0 * phase, 0.0 * phase], axis=2)
    point[:, 1, 1] = -0.1
    free = np.stack([0.0 * size, 0.0 * size, 5.0 * np.sin(2.0 * phase)], axis=2)
    return {"F": force, "COP": point, "M": free, "about": np.cross(point, force) + free}


def _columns(*kinds: str, scale: float = 1.0) -> np.ndarray:
    """Columns (frames, ...) of the plates, one after the other."""
    made = _steps()
    each = [
        made[kind][:, plate] * (scale if kind != "F" else 1.0) for plate in (0, 1) for kind in kinds
    ]
    return np.concatenate(each, axis=1)


def _write(path, values: np.ndarray, heading: str = "", mark: str = ","):
    rows = "\n".join(mark.join(f"{value:.9g}" for value in row) for row in values)
    path.write_text(heading + rows + "\n", encoding="utf-8")
    return path


def test_devices_of_vicon(tmp_path) -> None:
    """Plates over names over units, frames and sub frames, a second section below."""
    made = _steps()
    frames = np.stack([31 + np.arange(120) // 10, np.arange(120) % 10], axis=1)
    parts = [1e3 * made["about"][:, 0], 1e3 * made["COP"][:, 0]]
    groups = (
        ",,Imported Force Plate #1 - Force,,,Imported Force Plate #1 - Moment,,,Imported Force"
        " Plate #1 - CoP,,\n"
    )
    heading = (
        f"Devices\n1000\n{groups}Frame,Sub"
        " Frame,Fx,Fy,Fz,Mx,My,Mz,Cx,Cy,Cz\n,,N,N,N,N.mm,N.mm,N.mm,mm,mm,mm\n"
    )
    path = _write(
        tmp_path / "x.csv", np.concatenate([frames, made["F"][:, 0], *parts], axis=1), heading
    )
    path.write_text(
        path.read_text() + "\nTrajectories\n100\nFrame,Sub Frame,X,Y,Z\n1,0,3,4,5\n2,0,3,4,5\n"
    )
    found = read_forces(path)
    np.testing.assert_allclose(found.forces[:, 0], made["F"][:, 0], atol=1e-5)
    np.testing.assert_allclose(found.points[:, 0], made["COP"][:, 0], atol=1e-8)
    np.testing.assert_allclose(found.torques[:, 0], made["about"][:, 0], atol=1e-5)
    np.testing.assert_allclose(found.time, 0.3 + np.arange(120) / 1000.0)
    assert any("1000 Hz" in note for note in found.notes)
    assert any("below row 120" in note for note in found.notes)


@pytest.mark.parametrize("kinds", [("F", "COP"), ("F", "COP", "M"), ("F", "M", "COP")])
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_numbers_alone_say_which_column_is_which(
    kinds: tuple[str, ...], scale: float, tmp_path
) -> None:
    values = _columns(*kinds, scale=scale)
    found = read_forces(_write(tmp_path / "x.csv", np.column_stack([TIME, values])))
    made = _steps()
    np.testing.assert_allclose(found.forces, made["F"], atol=1e-5)
    np.testing.assert_allclose(found.points, made["COP"], atol=1e-8)
    if scale == 1.0 and "M" in kinds:
        np.testing.assert_allclose(found.torques, made["M"], atol=1e-7)
    assert "--force-columns" in found.notes[0]


def test_moments_alone_are_found_too_and_are_about_their_origin(tmp_path) -> None:
    path = _write(tmp_path / "x.txt", np.column_stack([TIME, _columns("F", "about")]), mark=" ")
    made = _steps()
    plain = read_forces(path)
    np.testing.assert_allclose(plain.torques, made["about"], atol=1e-5)
    assert sum("no center of pressure" in note for note in plain.notes) == 2
    origins = read_forces(path, layout=force_layout(origins="0.5,0,0; 0,0.2,0.1"))
    np.testing.assert_allclose(origins.points[:, 0], np.tile([0.5, 0.0, 0.0], (120, 1)))
    np.testing.assert_allclose(origins.points[:, 1], np.tile([0.0, 0.2, 0.1], (120, 1)))
    with pytest.raises(BadData, match="1 origins of moments for 2 forces"):
        read_forces(path, layout=force_layout(origins="0,0,0"))


def test_decimal_commas_and_a_center_of_pressure_in_the_plane(tmp_path) -> None:
    made = _steps()
    values = np.column_stack([TIME, made["F"][:, 0], 1e3 * made["COP"][:, 0, :2]])
    path = _write(tmp_path / "x.csv", values, "t [s];Fx;Fy;Fz;COPx;COPy\n", ";")
    path.write_text(path.read_text().replace(".", ","))
    found = read_forces(path)
    np.testing.assert_allclose(found.points[:, 0], made["COP"][:, 0], atol=1e-8)
    assert any("without z" in note for note in found.notes)
    assert any("taken as mm by their size" in note for note in found.notes)


def test_names_and_a_rate_may_be_stated(tmp_path) -> None:
    path = _write(tmp_path / "x.csv", np.column_stack([np.zeros(120), _columns("F", "COP")]))
    assert not holds_forces(path)
    with pytest.raises(BadFile, match="--force-columns"):
        read_forces(path)
    names = "-,Fx1,Fy1,Fz1,COPx1,COPy1,COPz1,-,-,-,-,-,-"
    with pytest.raises(BadFile, match="--force-rate"):
        read_forces(path, layout=force_layout(names))
    found = read_forces(path, {"F1": "calcn_r"}, force_layout(names, RATE))
    np.testing.assert_allclose(found.forces[:, 0], _steps()["F"][:, 0], atol=1e-5)
    np.testing.assert_allclose(found.time, np.arange(120) / RATE)
    assert found.bodies == ("calcn_r",)
    with pytest.raises(BadFile, match="13 columns, and 2 names"):
        read_forces(path, layout=force_layout("time,Fx1"))


def test_what_is_no_table_of_forces_is_none(tmp_path) -> None:
    """Angles, torques and positions of a recording are not taken for forces by their numbers."""
    rng = np.random.default_rng(0)
    for scale in (0.5, 40.0, 900.0):
        waves = scale * np.sin(3.0 * TIME[:, None] + 6.0 * rng.random(12))
        assert not holds_forces(_write(tmp_path / "x.csv", np.column_stack([TIME, waves])))


def test_the_table_of_a_lift(data) -> None:
    """No heading: the box and the feet, in the laboratory's axes."""
    found = read_forces(data("lifting-box-15kg/stoop1_F1Cop1F2Cop2.csv"))
    assert found.names == ("F1", "F2")
    assert 700.0 < np.median(found.forces[:, 1, 2]) < 1000.0
    assert np.abs(found.points[:, 1]).max() < 1.0
    for name in ("box_2D", "id_tau_2D", "id_q_2D", "ik_3D", "l5s1_bottom_up"):
        assert not holds_forces(data(f"lifting-box-15kg/stoop1_{name}.csv"))

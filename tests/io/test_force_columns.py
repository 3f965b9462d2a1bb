"""Forces are found in tables by the names that programs and laboratories give their columns."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.force_columns import force_columns, table_wrenches
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Table


def named(*stems: str) -> tuple[str, ...]:
    return tuple(stem.replace("?", axis) for stem in stems for axis in "xyz")


STYLES = {
    "first and second foot": (
        named("ground_force_v?", "ground_force_p?", "ground_torque_?"),
        ("ground_force",),
    ),
    "number before": (
        named("1_ground_force_v?", "1_ground_force_p?", "1_ground_torque_?"),
        ("1_ground_force",),
    ),
    "number after": (
        named("ground_force_2_v?", "ground_force_2_p?", "ground_torque_2_?"),
        ("ground_force_2",),
    ),
    "moments as m": (
        named("ground_force_1_v?", "ground_force_1_p?", "ground_force_1_m?"),
        ("ground_force_1",),
    ),
    "side": (
        named("R_ground_force_v?", "R_ground_force_p?", "R_ground_torque_?"),
        ("R_ground_force",),
    ),
    "body": (named("calcn_r_force_v?", "calcn_r_force_p?", "calcn_r_torque_?"), ("calcn_r_force",)),
    "laboratory": (named("F?1", "COP?1", "M?1"), ("F1",)),
    "plate before": (named("FP1_F?", "FP1_COP?", "FP1_M?"), ("FP1_F",)),
    "number between": (named("F1?", "COP1_?", "M1?"), ("F1",)),
    "groups": (named("Force.F?1", "Moment.M?1"), ("Force.F1",)),
    "units": (named("F?1 [N]", "COP?1 [mm]", "M?1 [Nmm]"), ("F1",)),
}


@pytest.mark.parametrize("style", STYLES)
def test_usual_names(style: str) -> None:
    columns, expected = STYLES[style]
    found = force_columns(columns)
    assert tuple(one.name for one in found) == expected
    assert found[0].force == columns[:3]
    assert found[0].torque == columns[-3:]
    assert found[0].point == (columns[3:6] if len(columns) == 9 else ())


def test_two_forces_are_kept_apart() -> None:
    columns = named(
        "ground_force_v?",
        "ground_force_p?",
        "l_ground_force_v?",
        "l_ground_force_p?",
        "ground_torque_?",
    )
    found = force_columns((*columns, *named("l_ground_torque_?")))
    assert [one.name for one in found] == ["ground_force", "l_ground_force"]
    assert found[1].torque == named("l_ground_torque_?")


@pytest.mark.parametrize(
    "columns", [named("hip_flexion_r_moment"), ("Fx1", "Fy1"), named("F?1"), named("pelvis_t?")]
)
def test_what_is_no_force_is_refused(columns: tuple[str, ...]) -> None:
    table = Table(
        np.arange(2.0), tuple(dict.fromkeys(columns)), np.zeros((2, len(dict.fromkeys(columns))))
    )
    with pytest.raises(BadData, match="no columns of a force"):
        table_wrenches(table)


def test_units_and_prefixes() -> None:
    columns = named("F?1 [N]", "COP?1 [mm]", "M?1 [Nmm]")
    table = Table(np.arange(3.0), columns, np.arange(27.0).reshape(3, 9))
    wrenches = table_wrenches(table, {"F1": "calcn_r"})
    assert wrenches.bodies == ("calcn_r",)
    np.testing.assert_allclose(wrenches.forces[1, 0], [9, 10, 11])
    np.testing.assert_allclose(wrenches.points[1, 0], [0.012, 0.013, 0.014])
    np.testing.assert_allclose(wrenches.torques[1, 0], [0.015, 0.016, 0.017])
    with pytest.raises(UnknownName, match="F1"):
        table_wrenches(table, {"F2": "calcn_r"})


def test_a_moment_without_a_center_of_pressure_is_about_the_origin() -> None:
    table = Table(np.arange(2.0), named("F?1", "M?1"), np.ones((2, 6)))
    wrenches = table_wrenches(table)
    assert not wrenches.points.any()
    assert "about the ground's origin" in wrenches.notes[0]

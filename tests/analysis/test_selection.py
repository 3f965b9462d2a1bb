import numpy as np
import pytest

from myomorph.lab.analysis.selection import (
    coordinate_pairs,
    major_muscles,
    muscle_rows,
    pairs,
    root_coordinates,
    split_side,
)
from walker import model

_RAJAGOPAL = """
addbrev addlong addmagDist addmagIsch addmagMid addmagProx bflh bfsh edl ehl fdl fhl gaslat
gasmed glmax1 glmax2 glmax3 glmed1 glmed2 glmed3 glmin1 glmin2 glmin3 grac iliacus perbrev
perlong piri psoas recfem sart semimem semiten soleus tfl tibant tibpost vasint vaslat vasmed"""
_GAIT2392 = """
glut_med1 glut_med2 glut_med3 glut_min1 semimem semiten bifemlh bifemsh sar add_long add_brev
add_mag1 add_mag2 add_mag3 tfl pect grac glut_max1 glut_max2 glut_max3 iliacus psoas quad_fem
gem peri rect_fem vas_med vas_int vas_lat med_gas lat_gas soleus tib_post flex_dig flex_hal
tib_ant per_brev per_long per_tert ext_dig ext_hal"""
RAJAGOPAL = _RAJAGOPAL.split()
GAIT2392 = _GAIT2392.split()
LARGE = [
    f"{name}140" if name in ("bflh", "bfsh", "gaslat", "vaslat") else name for name in RAJAGOPAL
]


@pytest.mark.parametrize("family", [RAJAGOPAL, GAIT2392, LARGE])
def test_the_sixteen_are_found_in_every_spelling(family: list[str]) -> None:
    found = major_muscles([f"{name}_{side}" for side in "rl" for name in family])
    assert len(found) == 16
    assert all(set(pair.members) == {"right", "left"} for pair in found)
    labels = [pair.label for pair in found]
    assert labels[0] == "Gluteus maximus"
    assert len(found[0].members["right"]) == 3
    assert {"Soleus", "Tibialis anterior", "Peroneus longus", "Vastus lateralis"} <= set(labels)
    names = [name for pair in found for name in pair.names]
    assert len(set(names)) == len(names)


def test_unknown_muscles_are_chosen_by_their_pull() -> None:
    names = [f"m{i}" for i in range(40)]
    found = major_muscles(names, np.arange(40.0))
    assert [pair.names[0] for pair in found] == [f"m{i}" for i in range(39, 23, -1)]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hip_flexion_r", ("hip_flexion", "right")),
        ("trap_cl_L", ("trap_cl", "left")),
        ("r_knee", ("knee", "right")),
        ("LeftArm", ("LeftArm", "")),
        ("left_arm", ("arm", "left")),
        ("mouse__LElbow_flexion", ("mouse__Elbow_flexion", "left")),
        ("RFemur", ("Femur", "right")),
        ("RECFEM", ("RECFEM", "")),
        ("lumbar_extension", ("lumbar_extension", "")),
    ],
)
def test_sides_of_names(name: str, expected: tuple[str, str]) -> None:
    assert split_side(name) == expected


def test_a_name_without_a_side_pairs_with_its_left_one() -> None:
    (pair,) = pairs(["DELT1", "DELT1_l"])
    assert pair.members == {"left": ("DELT1_l",), "right": ("DELT1",)}


def test_rows_hold_every_muscle_once_by_side() -> None:
    names = [f"{name}_{side}" for side in "rl" for name in RAJAGOPAL] + ["ercspn"]
    blocks = muscle_rows(names)
    assert [side for side, _ in blocks] == ["right", "left", ""]
    assert sorted(np.concatenate([columns for _, columns in blocks])) == list(range(len(names)))
    right = [names[i] for i in blocks[0][1]]
    assert right.index("glmax1_r") < right.index("recfem_r") < right.index("soleus_r")


def test_the_root_is_what_hangs_free_on_the_ground() -> None:
    assert root_coordinates(model()) == (("pelvis_tx", "pelvis_ty", "pelvis_tz"), ("pelvis_tilt",))


def test_coordinates_shown_are_those_that_move() -> None:
    body = model()
    found = coordinate_pairs(
        body,
        dict.fromkeys(body.coordinate_names, 0.5) | {"knee_angle_r": 0.0, "knee_angle_l": 0.001},
    )
    assert [pair.label for pair in found] == ["Hip flexion"]

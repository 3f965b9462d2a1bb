"""The movement that markers show: laws on a made figure, and recordings whose movement is known."""

from __future__ import annotations

import numpy as np
import pytest

from made_person import made_person
from myomorph.core.io.formats import read_trial
from myomorph.core.model.movement import MOVEMENTS
from myomorph.core.model.series import Markers
from myomorph.core.motion.protocols import recognize
from myomorph.lab.analysis.found_movement import found_movement
from myomorph.lab.analysis.seen_body import SeenBody
from myomorph.lab.study.inputs.laboratory import Laboratory

UPRIGHT = np.eye(3)


def found(markers: Markers, rotation: np.ndarray = UPRIGHT) -> str:
    """Name the movement of markers (frames, markers, 3), turned by (3, 3) to y up.

    Parameters
    ----------
    markers : (frames, markers, 3)
    rotation : (3, 3)

    Returns
    -------
    the movement
    """
    sites = recognize(markers.names).sites
    return str(found_movement(SeenBody.of(markers, sites, rotation)))


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_each_movement_is_found(movement: str) -> None:
    assert found(made_person(movement)) == movement


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_a_child_is_judged_as_an_adult(movement: str) -> None:
    """Lengths are shares of the leg, times of its pendulum."""
    assert found(made_person(movement, leg=0.4)) == movement


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_axes_of_the_laboratory_change_nothing(movement: str) -> None:
    laboratory = Laboratory("z", 37.0)
    turned = made_person(movement).rotated(laboratory.rotation.T)
    assert found(turned, laboratory.rotation) == movement


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_sides_may_be_exchanged(movement: str) -> None:
    markers = made_person(movement)
    names = tuple({"R": "L", "L": "R"}[name[0]] + name[1:] for name in markers.names)
    mirrored = Markers(markers.time, names, markers.values * [1.0, 1.0, -1.0])
    assert found(mirrored) == movement


def test_short_gaps_change_nothing() -> None:
    markers = made_person("walking")
    values = np.array(markers.values)
    values[40:50, ::2] = np.nan
    assert found(Markers(markers.time, markers.names, values)) == "walking"


def test_an_arm_alone_is_an_upper_limb_and_a_pelvis_alone_is_not_known() -> None:
    markers = made_person("walking")
    arm = [i for i, name in enumerate(markers.names) if name[1:] in ("SHO", "ELB", "WRA")]
    assert found(markers.columns(arm)) == "upper limb"
    pelvis = [i for i, name in enumerate(markers.names) if name[1:] in ("ASI", "PSI")]
    assert found(markers.columns(pelvis)) == "not known"


def test_one_frame_is_a_pose() -> None:
    assert found(made_person("standing").frames(slice(0, 1))) == "standing"


def test_words_show_a_body_that_no_protocol_knows() -> None:
    segments = {"ASI": "pelvis", "KNE": "shin", "ANK": "ankle", "SHO": "shoulder"}
    markers = made_person("walking")
    kept = [i for i, name in enumerate(markers.names) if name[1:] in segments]
    named = markers.columns(kept)
    words = {"R": "Right", "L": "Left"}
    names = tuple(f"{words[name[0]]}{segments[name[1:]].title()}1" for name in named.names)
    body = SeenBody.of(Markers(named.time, names, named.values), {}, UPRIGHT)
    assert str(found_movement(body)) == "walking"


RECORDINGS = (
    ("c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d", "z", "walking"),
    ("hamner-run-subject04/run200/markers.trc", "y", "running"),
    ("opencap-subject4-multitask/markers/DJ1.trc", "y", "jumping"),
    ("opencap-subject4-multitask/markers/STS1.trc", "y", "rising"),
    ("odd-trc-mot/markers_StairUp3.trc", "y", "stairs"),
    ("lifting-box-15kg/stoop1.c3d", "z", "other"),
    ("rajagopal-walk-emg/raw/static_walk_1.trc", "y", "standing"),
)


@pytest.mark.parametrize(("file", "up", "movement"), RECORDINGS)
def test_recordings_whose_movement_is_known(file: str, up: str, movement: str, data) -> None:
    markers = read_trial(data(file)).markers
    assert markers is not None
    assert found(markers, Laboratory(up).rotation) == movement  # type: ignore[arg-type]

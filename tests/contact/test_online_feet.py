"""Plates are given to feet as they are loaded."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from myomorph.core.contact.assign import OnlineFeet
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.tree import compile_tree
from myomorph.live.online_identification import total_wrench


class PlateWalk(NamedTuple):
    """A walk over plates.

    Attributes
    ----------
    coordinates : (frames, coordinates) in the model's order [rad or m]
    wrenches : (frames, plates, 6) moment about the ground's origin and force [N m; N]
    feet : body on each plate
    """

    model: Model
    coordinates: np.ndarray
    wrenches: np.ndarray
    feet: tuple[str, ...]


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> PlateWalk:
    """Return the walk of Rajagopal's example."""
    from myomorph.core.io.formats import read_model
    from myomorph.core.io.loads import read_external_loads
    from myomorph.core.io.sto import motion_from_table, read_sto

    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    motion = motion_from_table(read_sto(data("rajagopal-walk-emg/coordinates.sto")), model)
    given = resample_wrenches(
        read_external_loads(data("rajagopal-walk-emg/grf_walk.xml")), motion.time
    )
    each = total_wrench(
        given.forces[:, :, None], given.points[:, :, None], given.torques[:, :, None]
    )
    return PlateWalk(
        model=model,
        coordinates=compile_tree(model).coordinates_of(motion),
        wrenches=each,
        feet=given.bodies,
    )


def _followed(
    feet: OnlineFeet, coordinates: np.ndarray, each: np.ndarray, chunk: int = 10
) -> np.ndarray:
    parts = [
        feet.given(each[start : start + chunk], coordinates[max(start - 1, 0)])
        for start in range(0, len(each), chunk)
    ]
    return np.concatenate(parts)


def test_the_foot_on_each_plate_is_found(
    walk: PlateWalk,
) -> None:
    """The forces of the file, given without their bodies, come out on the bodies it names."""
    model, coordinates, each, bodies = walk
    feet = OnlineFeet(model, ("one", "two"), ("", ""))
    found = _followed(feet, coordinates, each)
    for plate, body in enumerate(bodies):
        loaded = np.linalg.norm(each[:, plate, 3:], axis=1) > 25.0
        assert loaded.mean() > 0.3
        np.testing.assert_allclose(found[loaded, feet.bodies.index(body)], each[loaded, plate])
    assert feet.nobody.sum() == 0


def test_a_plate_that_both_feet_use_in_turn_changes_its_foot(
    walk: PlateWalk,
) -> None:
    model, coordinates, each, bodies = walk
    right = np.linalg.norm(each[:, 0, 3:], axis=1)
    left = np.linalg.norm(each[:, 1, 3:], axis=1)
    # Where only one foot is loaded, as on a treadmill's one plate; both together cannot be told
    # apart.
    one = np.where((right > left)[:, None], each[:, 0], each[:, 1])
    one[np.minimum(right, left) > 0.0] = 0.0
    feet = OnlineFeet(model, ("belt",), ("",))
    found = _followed(feet, coordinates, one[:, None])
    for plate, body in enumerate(bodies):
        mine = (np.linalg.norm(one[:, 3:], axis=1) > 25.0) & (one == each[:, plate]).all(axis=1)
        assert mine.sum() > 20
        np.testing.assert_allclose(found[mine, feet.bodies.index(body)], one[mine])


def test_loads_near_no_foot_act_on_nobody(
    walk: PlateWalk,
) -> None:
    model, coordinates, each, _ = walk
    away = each.copy()
    # The same forces three metres to the side.
    away[..., :3] += np.cross([0.0, 0.0, 3.0], each[..., 3:])
    feet = OnlineFeet(model, ("one", "two"), ("", ""))
    assert not _followed(feet, coordinates, away).any()
    assert (feet.nobody > 100).all()


def test_bodies_that_are_named_need_no_search(
    walk: PlateWalk,
) -> None:
    model, _, each, _ = walk
    feet = OnlineFeet(model, ("one", "two"), ("hand_r", "hand_r"))
    assert feet.bodies == ("hand_r",)
    np.testing.assert_allclose(feet.given(each, None)[:, 0], each.sum(axis=1))
    holed = each[:5].copy()
    holed[2, 0, 4] = np.nan
    assert np.isnan(feet.given(holed, None)).all(axis=(1, 2)).tolist() == [
        False,
        False,
        True,
        False,
        False,
    ]


def test_a_model_without_feet_is_told(
    walk: PlateWalk,
) -> None:
    model = walk[0]
    renamed = {name: name.replace("calcn", "stump") for name in model.body_names}
    bodies = tuple(replace(one, name=renamed[one.name]) for one in model.bodies)
    joints = tuple(
        replace(one, child=renamed[one.child], parent=renamed.get(one.parent, one.parent))
        for one in model.joints
    )
    bare = replace(model, bodies=bodies, joints=joints, muscles=(), markers=())
    with pytest.raises(BadData, match=r"no body of model .* is named as a foot"):
        OnlineFeet(bare, ("plate",), ("",))

import numpy as np
import pytest

from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.lab.analysis.center_of_mass import centroid
from walker import model, motion


def test_in_the_default_pose_it_is_the_weighted_mean_of_the_mass_centers() -> None:
    body = model()
    found = centroid(body, Motion(np.zeros(1), (), np.zeros((1, 0))))
    # Pelvis 36 kg at 0.9 + 0.2 m, thighs 9 kg at 0.9 - 0.2 m, shanks 3 kg at 0.9 - 0.4 - 0.2 m.
    height = (36 * 1.1 + 18 * 0.7 + 6 * 0.3) / 60
    assert found.values[0] == pytest.approx([0.0, height, 0.0], abs=1e-12)


def test_it_moves_along_with_the_root() -> None:
    body = model()
    movement = motion(body)
    shifted = np.array(movement.values)
    shift = [0.3, -0.2, 0.7]
    for name, by in zip(("pelvis_tx", "pelvis_ty", "pelvis_tz"), shift, strict=True):
        shifted[:, movement.names.index(name)] += by
    there = centroid(body, Motion(movement.time, movement.names, shifted)).values
    assert there - centroid(body, movement).values == pytest.approx(
        np.tile(shift, (len(movement), 1)), abs=1e-12
    )


def test_a_frame_without_a_pose_has_none() -> None:
    body = model()
    values = np.array(motion(body).values)
    values[3] = np.nan
    found = centroid(body, Motion(motion(body).time, body.coordinate_names, values)).values
    assert np.isnan(found[3]).all()
    assert np.isfinite(np.delete(found, 3, axis=0)).all()


@pytest.mark.parametrize(
    ("gravity", "up"),
    [((0, -9.81, 0), (0, 1, 0)), ((0, 0, -9.81), (0, 0, 1)), ((0, 0, 0), (0, 1, 0))],
)
def test_up_is_against_gravity(gravity: tuple[float, ...], up: tuple[float, ...]) -> None:
    one = Model(
        name="m", bodies=(), joints=(), coordinates=(), gravity=np.array(gravity, dtype=float)
    )
    assert one.up == pytest.approx(up)

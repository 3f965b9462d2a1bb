"""Tendons and fibers that follow an animal's own postures, on muscles of known path lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.bones.morph.morphed import Morph, MorphOptions, MuscleChange
from myomorph.bones.morph.species.own_postures import MAX_CHANGE, WORKING, fitted_to_postures
from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform

HERE = Transform.identity()
PENNATION = 0.4


def slider(fiber: float, tendon: float) -> Model:
    """Two bodies that slide along x, each with a muscle as long as its coordinate."""
    sides = ("r", "l")
    return Model(
        name="slider",
        bodies=tuple(
            Body(name=f"foot_{side}", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3))
            for side in sides
        ),
        joints=tuple(
            Joint(
                name=f"slide_{side}",
                kind="CustomJoint",
                parent=GROUND,
                child=f"foot_{side}",
                parent_frame=HERE,
                child_frame=HERE,
                axes=(
                    Axis(
                        kind="translation",
                        vector=np.array([1.0, 0.0, 0.0]),
                        function=linear(1.0),
                        coordinates=(f"x_{side}",),
                    ),
                ),
                coordinates=(f"x_{side}",),
            )
            for side in sides
        ),
        coordinates=tuple(Coordinate(f"x_{side}", "translational") for side in sides),
        gravity=np.zeros(3),
        muscles=tuple(
            Muscle(
                name=f"pull_{side}",
                kind="Millard2012EquilibriumMuscle",
                path=Path(
                    (
                        PathPoint("a", GROUND, np.zeros(3)),
                        PathPoint("b", f"foot_{side}", np.zeros(3)),
                    )
                ),
                max_isometric_force=9.0,
                optimal_fiber_length=fiber,
                tendon_slack_length=tendon,
                pennation_at_optimal=PENNATION,
            )
            for side in sides
        ),
    )


def moved(low: float, high: float, left: float | None = None, frames: int = 401) -> Motion:
    """Move the right body over a range, the left one too or not from its place."""
    path = np.linspace(low, high, frames)
    other = path if left is None else np.full(frames, left)
    return Motion(np.arange(frames) / 100.0, ("x_r", "x_l"), np.stack([path, other], axis=1))


def morph_of(model: Model) -> Morph:
    """Make a morph of the model with one change for each muscle."""
    changes = tuple(
        MuscleChange(
            name=muscle.name,
            path=1.0,
            fiber=2.0,
            tendon=3.0,
            force=1.0,
            pennation=0.0,
            range_source=(0.6, 1.2),
            range_target=(0.6, 1.2),
        )
        for muscle in model.muscles
    )
    return Morph(
        source=model,
        model=model,
        bones={},
        points=(),
        joints=(),
        muscles=changes,
        options=MorphOptions(),
        notes=(),
    )


def fibers(model: Model, motion: Motion) -> np.ndarray:
    """Compute normalized fiber lengths of both muscles from the coordinates themselves.

    Parameters
    ----------
    model : of `slider`
    motion : its coordinates

    Returns
    -------
    (frames, 2)
    """
    columns = [
        (motion.values[:, column] - muscle.tendon_slack_length)
        / (muscle.optimal_fiber_length * np.cos(PENNATION))
        for column, muscle in enumerate(model.muscles)
    ]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(
    ("low", "high"), [(0.105, 0.112), (0.115, 0.135), (0.130, 0.137)], ids=["short", "wide", "long"]
)
def test_fibers_work_where_they_pull(low, high):
    """Of three ranges, two need another tendon, and one longer fibers too."""
    model = slider(fiber=0.02, tendon=0.1)
    motion = moved(low, high)
    found = fitted_to_postures(morph_of(model), [motion])
    inside = fibers(found.model, motion)
    assert ((inside > WORKING[0] - 0.03) & (inside < WORKING[1] + 0.03)).all()
    given = fibers(model, motion)
    assert ((given < WORKING[0] - 0.03) | (given > WORKING[1] + 0.03)).any()
    slope = found.model.muscles[0].optimal_fiber_length / 0.02
    wide = bool(high - low > 0.02 * np.cos(PENNATION))
    assert (slope > 1.0) is wide
    assert 1.0 <= slope <= MAX_CHANGE
    assert found.muscles[0].fiber == pytest.approx(2.0 * slope)
    tendon = found.model.muscles[0].tendon_slack_length
    assert found.muscles[0].tendon == pytest.approx(3.0 * tendon / 0.1)
    assert len(found.notes) == 1
    # What suits stays: a second time nothing changes.
    again = fitted_to_postures(found, [motion])
    assert again.model.muscles == found.model.muscles


def test_what_suits_is_left_alone():
    model = slider(fiber=0.02, tendon=0.1)
    found = fitted_to_postures(morph_of(model), [moved(0.112, 0.122)])
    assert found.model.muscles == model.muscles
    assert found.notes == ()


def test_both_sides_stay_alike():
    """Postures of the left leg count for the right one's muscle, and the other way round."""
    model = slider(fiber=0.02, tendon=0.1)
    found = fitted_to_postures(morph_of(model), [moved(0.130, 0.134, left=0.137)])
    right, left = found.model.muscles
    assert right.tendon_slack_length == left.tendon_slack_length > 0.1
    assert fibers(found.model, moved(0.130, 0.137)).max() < WORKING[1] + 0.03


def test_a_path_that_no_fiber_can_follow_is_named():
    model = slider(fiber=0.02, tendon=0.1)
    found = fitted_to_postures(morph_of(model), [moved(0.105, 0.2)])
    assert found.model.muscles == model.muscles
    (note,) = found.notes
    assert "left as they are" in note
    assert "pull_r" in note


def test_lengths_of_a_class_follow_and_frames_without_a_pose_do_not_count():
    model = slider(fiber=0.02, tendon=0.1)
    muscles = tuple(
        replace(muscle, kind="mujoco", parameters={"L0": 0.02, "LT": 0.1})
        for muscle in model.muscles
    )
    motion = moved(0.130, 0.137)
    values = motion.values.copy()
    values[::2] = np.nan
    found = fitted_to_postures(
        morph_of(replace(model, muscles=muscles)), [replace(motion, values=values)]
    )
    for muscle in found.model.muscles:
        assert muscle.parameters["LT"] == pytest.approx(muscle.tendon_slack_length)
        assert muscle.parameters["L0"] == pytest.approx(muscle.optimal_fiber_length)
    with pytest.raises(BadData, match="0 frames have a pose: expected 10 or more"):
        fitted_to_postures(morph_of(model), [replace(motion, values=np.full_like(values, np.nan))])

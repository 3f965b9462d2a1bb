"""Postures by which frames are chosen.

They are positions of markers in the first body's frame, whatever that body does.
"""

from __future__ import annotations

import numpy as np

from myomorph.body.calibrate.postures import seen_from_base, spread_postures
from myomorph.body.calibrate.recorded import RecordedMarkers
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure


def recorded(recordings, static=False):
    names = recordings[0].names
    return RecordedMarkers(
        recordings=tuple(recordings), names=names, weights=np.ones(len(names)), static=static
    )


def test_a_posture_is_the_same_wherever_the_first_body_stands():
    """Against positions in ground rotated and moved back.

    The pelvis's own markers stay where the model has them.
    """
    model = stick_figure()
    rng = np.random.default_rng(0)
    values = np.tile(rng.normal(scale=0.3, size=len(model.coordinates)), (4, 1))
    values[:, :6] = rng.normal(scale=2.0, size=(4, 6))
    found = seen_from_base(model, values).reshape(4, -1, 3)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    for k, marker in enumerate(model.markers):
        body = tree.body_index[marker.body]
        for frame in range(4):
            place = poses.origins[frame, body] + poses.rotations[frame, body] @ marker.location
            local = np.linalg.solve(poses.rotations[frame, 1], place - poses.origins[frame, 1])
            np.testing.assert_allclose(found[frame, k], local, atol=1e-12)
        if marker.body == model.bodies[0].name:
            np.testing.assert_allclose(found[:, k], np.tile(marker.location, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(found, np.tile(found[:1], (4, 1, 1)), atol=1e-12)


def test_a_small_body_shows_the_postures_that_a_larger_one_does():
    """Below the size of a human, whose length unit is a meter.

    The same frames are chosen at every scale.
    """
    model = stick_figure()
    values = np.zeros((30, len(model.coordinates)))
    bent = [model.coordinate_names.index(name) for name in ("femur_r_r0", "tibia_r_r0")]
    values[:, bent] = np.linspace(0.0, 1.0, 30)[:, None] * [0.3, -0.5]
    sliding = [
        k for k, coordinate in enumerate(model.coordinates) if coordinate.motion == "translational"
    ]
    chosen = []
    for size in (0.4, 0.05):
        body = scale(model, {one.name: np.full(3, size) for one in model.bodies})
        tree = compile_tree(body)
        poses = forward_kinematics(
            tree, np.where(np.isin(np.arange(values.shape[1]), sliding), size * values, values)
        )
        places = poses.points(
            np.array([tree.body_index[marker.body] for marker in body.markers]),
            np.array([marker.location for marker in body.markers]),
        )
        markers = Markers(np.arange(30) / 10.0, body.marker_names, places)
        ((frames, _),) = spread_postures(body, recorded([markers]), 12)
        chosen.append(frames.tolist())
    assert chosen[0] == chosen[1]
    assert 1 < len(chosen[0]) < 12


def test_the_first_posture_is_the_mean_of_all_unless_the_last_recording_is_static():
    """A knee that bends steadily, and then a last recording of its end alone."""
    model = stick_figure()
    values = np.zeros((21, len(model.coordinates)))
    values[:, model.coordinate_names.index("tibia_r_r0")] = -np.linspace(0.5, 1.5, 21)
    tree = compile_tree(model)
    bodies, at = zip(
        *((tree.body_index[marker.body], marker.location) for marker in model.markers), strict=True
    )
    places = forward_kinematics(tree, values).points(np.array(bodies), np.array(at))
    trials = [
        Markers(np.arange(len(part)) / 10.0, model.marker_names, part)
        for part in (places[:20], places[20:])
    ]
    for static, expected in ((False, [1, 0]), (True, [0, 1])):
        chosen = spread_postures(model, recorded(trials, static), 1)
        assert [len(frames) for frames, _ in chosen] == expected

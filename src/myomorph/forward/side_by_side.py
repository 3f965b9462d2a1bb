"""Two simulated bodies side by side, as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.join import join_models, join_motions, join_series, join_wrenches
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.paths import MovingPathPoint, Muscle, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.forward.shown import ShownRun

GAP = 0.35  # Between two bodies, by the size of one
MIN_GAP = 0.2  # [m]


def side_by_side(first: ShownRun, second: ShownRun) -> ShownRun:
    """Put a second body beside a first one, on one ground.

    Parameters
    ----------
    first, second : at the same times; the second one is moved sideways

    Returns
    -------
    both as one, whose names begin with those of the runs
    """
    across = _across(first.model)
    width = max(_width(first, across), _width(second, across))
    size = max(_size(first), _size(second))
    offset = (width + max(GAP * size, MIN_GAP)) * across
    runs = {first.name: first, second.name: replace(second, model=moved(second.model, offset))}
    wrenches = None
    if first.wrenches is not None and second.wrenches is not None:
        shifted = replace(second.wrenches, points=second.wrenches.points + offset)
        wrenches = join_wrenches({first.name: first.wrenches, second.name: shifted})
    return ShownRun(
        name=f"{first.name} and {second.name}",
        model=join_models({name: run.model for name, run in runs.items()}),
        motion=_joined(runs),
        activations=join_series({name: run.activations for name, run in runs.items()}),
        wrenches=wrenches,
    )


def _joined(runs: dict[str, ShownRun]) -> Motion:
    return join_motions({name: run.motion for name, run in runs.items()})


def moved(model: Model, offset: Array) -> Model:
    """Move a model with all that it has on the ground.

    Parameters
    ----------
    model : to move
    offset : (3,) in ground [m]

    Returns
    -------
    the model elsewhere
    """
    shift = Transform(np.eye(3), offset)
    joints = [
        replace(joint, parent_frame=shift @ joint.parent_frame) if joint.parent == GROUND else joint
        for joint in model.joints
    ]
    wraps = [
        replace(wrap, pose=shift @ wrap.pose) if wrap.body == GROUND else wrap
        for wrap in model.wrap_objects
    ]
    return replace(
        model,
        joints=tuple(joints),
        wrap_objects=tuple(wraps),
        muscles=tuple(_moved_path(muscle, offset) for muscle in model.muscles),
    )


def _moved_path(muscle: Muscle, offset: Array) -> Muscle:
    points = tuple(_moved_point(point, offset) for point in muscle.path.points)
    return replace(muscle, path=replace(muscle.path, points=points))


def _moved_point(point: PathPoint | MovingPathPoint, offset: Array) -> PathPoint | MovingPathPoint:
    if point.body != GROUND:
        return point
    if isinstance(point, PathPoint):
        return replace(point, location=point.location + offset)
    x, y, z = point.functions
    raised = (x.raised(float(offset[0])), y.raised(float(offset[1])), z.raised(float(offset[2])))
    return replace(point, functions=raised)


def _across(model: Model) -> Array:
    """Horizontal direction that most models face across, (3,)."""
    up = model.up
    # OpenSim's models face along x with y up, MuJoCo's along x or y with z up.
    return np.array([0.0, 0.0, 1.0]) if abs(up[1]) > 0.5 else np.array([0.0, 1.0, 0.0])


def _places(run: ShownRun) -> Array:
    """Origins of all bodies over time, (points, 3) [m]."""
    tree = compile_tree(run.model)
    return forward_kinematics(tree, tree.coordinates_of(run.motion)).origins[:, 1:].reshape(-1, 3)


def _width(run: ShownRun, across: Array) -> float:
    return float(np.ptp(_places(run) @ across))


def _size(run: ShownRun) -> float:
    return float(np.ptp(_places(run), axis=0).max())

"""The distance of the patella from the knee's axis, as a parameter of a person.

It is the lever of quadriceps: a patella that lies farther out gives the patellar tendon a longer
moment arm, and the same knee torque presses less on the joint. People differ in it by more than
models do. Markers on the patella inform it (`body.calibrate.patella_fit`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array, changed
from myomorph.core.model.errors import check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.paths import Path, PathPoint
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.muscles.patella import patella_of
from myomorph.core.rigid.knees import flexed, hinge_axis, knee_joints, long_axis
from myomorph.core.rigid.tree import compile_tree


def _directions(model: Model) -> Mapping[str, Array]:
    """Find the ways out of `patella_directions`."""
    found = {}
    for knee in knee_joints(model):
        patella = patella_of(model, knee)
        way = None if patella is None else _way_out(model, knee, patella)
        if patella is not None and way is not None:
            found[patella] = way
    return FrozenMap(found)


def _way_out(model: Model, knee: Joint, patella: str) -> Array | None:
    """Find the way from a knee's axis to the points on its patella, across axis and shank.

    The mean over flexions of 0 to 60 degrees, as the patella turns with the knee.

    Returns
    -------
    (3,) unit vector in the patella, None for a knee that does not bend or a patella without points
    """
    middle = middle_of_paths(model, patella)
    down = long_axis(model, knee)
    poses = flexed(model, knee)
    if down is None or poses is None or middle is None:
        return None
    index = compile_tree(model).body_index
    shank = poses.rotations[:, index[knee.child]]
    axis = shank @ hinge_axis(model, knee, poses, down)
    along = shank @ down
    # (poses, 3) across both, towards the patella
    out = np.cross(axis, along)
    bone = poses.rotations[:, index[patella]]
    center = poses.origins[:, index[knee.child]] + shank @ knee.child_frame.translation
    on_bone = poses.origins[:, index[patella]] + bone @ middle
    out *= np.sign(np.einsum("fi,fi->f", on_bone - center, out))[:, None]
    mean = np.einsum("fij,fi->fj", bone, out).mean(axis=0)
    size = float(np.linalg.norm(mean))
    return mean / size if size > 0.5 else None


def middle_of_paths(model: Model, patella: str) -> Array | None:
    """Find the middle of the points of muscle paths on a patella.

    Parameters
    ----------
    model : with the patella
    patella : name of the body

    Returns
    -------
    (3,) in its axes [m], None where no path has a point there
    """
    points = [
        point.location
        for muscle in model.muscles
        for point in muscle.path.points
        if isinstance(point, PathPoint) and point.body == patella
    ]
    return np.mean(points, axis=0) if points else None


patella_directions = Latest(_directions)
"""Ways out of the patellae of a model: by body, (3,) unit vectors in its axes."""


def with_patellae_farther(
    model: Model, distances: Mapping[str, float], fitted_tendons: bool = False
) -> Model:
    """Move the points of muscle paths on patellae away from the knees' axes.

    Slack lengths of tendons stay: fibers and tendons of the default pose change with the path. Or
    they grow with the path in the default pose, where fibers then keep their lengths.

    Parameters
    ----------
    model : with patellae as bodies that hang on the thighs
    distances : by body, how far out its points move, below 0 towards the axis [m]
    fitted_tendons : let slack lengths grow with the path

    Raises
    ------
    UnknownName : no patella of a knee that bends has that name

    Examples
    --------
    >>> import myomorph as mm
    >>> with_patellae_farther(mm.read_model("arm.osim"), {}).name
    'arm'
    """
    ways = patella_directions(model)
    for body in distances:
        check_name("patella", body, ways, f"model '{model.name}'")
    moves = {body: distance * ways[body] for body, distance in distances.items() if distance}
    if not moves:
        return model
    muscles = tuple(changed(muscle, path=_moved(muscle.path, moves)) for muscle in model.muscles)
    made = replace(model, muscles=muscles)
    return _with_fitted_tendons(made, model) if fitted_tendons else made


def _with_fitted_tendons(made: Model, model: Model) -> Model:
    """Lengthen tendons by as much as paths are longer in the default pose than before."""
    longer = default_path_lengths(made) - default_path_lengths(model)
    muscles = (
        changed(muscle, tendon_slack_length=max(muscle.tendon_slack_length + float(more), 0.0))
        if more
        else muscle
        for muscle, more in zip(made.muscles, longer, strict=True)
    )
    return replace(made, muscles=tuple(muscles))


def _moved(path: Path, moves: Mapping[str, Array]) -> Path:
    """Move the points of a path that lie on patellae; `moves` by body, (3,) in its axes [m]."""
    points = (
        changed(point, location=point.location + moves[point.body])
        if isinstance(point, PathPoint) and point.body in moves
        else point
        for point in path.points
    )
    return changed(path, points=tuple(points))

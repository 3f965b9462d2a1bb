"""Paths of a model's muscles over time, as lines to draw."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.shapes import Points
from myomorph.core.muscles.drawn_paths import drawn_paths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.tree import compile_tree


@read_only
class MusclePaths:
    """Lines of action of all muscles of a model over time.

    Attributes
    ----------
    time : (frames,) [s]
    muscles : names, in the model's order
    muscle_of : (points,) index of the muscle that each point belongs to
    positions : (frames, points, 3) in ground, along each muscle from its origin; NaN beyond the
        last point that a frame has [m]
    """

    time: Array
    muscles: tuple[str, ...]
    muscle_of: np.ndarray
    positions: Points

    def line(self, muscle: str) -> Points:
        """Positions along one muscle.

        Parameters
        ----------
        muscle : by name

        Returns
        -------
        (frames, points, 3) in ground [m]

        Raises
        ------
        UnknownName : no muscle has that name
        """
        check_name("muscle", muscle, self.muscles)
        return self.positions[:, self.muscle_of == self.muscles.index(muscle)]


def muscle_paths(model: Model, motion: Motion) -> MusclePaths:
    """Paths of a model's muscles in a motion, arcs around surfaces as short straight parts.

    The same paths give `muscle_kinematics` its lengths; Source: see docs/method.md, muscle paths.

    Parameters
    ----------
    model : with muscles
    motion : coordinates over time; what it lacks stands at the model's default

    Returns
    -------
    positions (frames, points, 3) in ground [m], at the motion's times; NaN where a coordinate is

    Raises
    ------
    UnknownName : the motion has a coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> paths = mm.viewer.muscle_paths(model, mm.read_motion("reach.mot", model))
    >>> paths.line(paths.muscles[0]).shape[0]
    61
    """
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    coordinates = compile_tree(model).coordinates_of(motion)
    known = np.asarray(np.isfinite(coordinates).all(axis=1))
    drawn = drawn_paths(compile_paths(model), np.where(known[:, None], coordinates, 0.0))
    return MusclePaths(
        time=motion.time,
        muscles=model.muscle_names,
        muscle_of=drawn.muscle,
        positions=np.where(known[:, None, None], drawn.places, np.nan),
    )

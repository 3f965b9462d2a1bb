"""Two subjects who hold each other: where they grip, and whether action is reaction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.errors import BadData, UnknownName, check_name
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.join import own_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.regressor import regressor_blocks, sum_of_wrenches
from myomorph.core.rigid.tree import compile_tree

PULL = 1e-3
"""Weight of the first guess of a grip's place, against one frame in which the bodies hold together.
"""


@read_only
class Grip:
    """Grip of one body on another.

    Attributes
    ----------
    site : its point is fixed to the body that grips
    place : (3,) the point of the other body that is held [m]
    apart : (frames,) distance of the two points over the whole motion [m]
    """

    site: Site
    place: Array
    apart: Array


def grip_between(  # page: two bodies, and what is known of the grip
    model: Model,
    motion: Motion,
    body: str,
    other: str,
    *,
    name: str = "",
    near: ArrayLike | None = None,
    span: tuple[float, float] | None = None,
    cone: Cone | None = None,
) -> Grip:
    """Find the point at which two bodies hold together while both move.

        minimise  sum_frames |(R_b x + p_b) - (R_o y + p_o)|^2 + w |x - near|^2

    over x in the body and y in the other: the point about which they turn on each other (Ehrig,
    Taylor, Duda and Heller 2006), with a weak pull to a first guess along directions that the
    motion does not determine.

    Parameters
    ----------
    model : of both bodies
    motion : coordinates over time
    body, other : names
    name : of the site; "<body>_on_<other>" by default
    near : (3,) first guess in the body's frame [m]; its mass center by default
    span : from when to when they hold together [s]; the whole motion by default
    cone : which forces can pass; any by default

    Raises
    ------
    UnknownName : a body is not in the model
    BadData : no frame in the span
    """
    tree = compile_tree(model)
    for held_body in (body, other):
        check_name("body", held_body, tree.body_index)
    start, stop = (motion.time[0], motion.time[-1]) if span is None else span
    held = (motion.time >= start - 1e-9) & (motion.time <= stop + 1e-9)
    if not held.any():
        raise BadData(
            f"grip of '{body}' on '{other}': no frame between {start:g} and {stop:g} s; the motion"
            f" runs from {motion.time[0]:g} to {motion.time[-1]:g} s"
        )
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    b = tree.body_index[body]
    o = tree.body_index[other]
    guess = np.asarray(model.body(body).mass_center if near is None else near, dtype=np.float64)
    x, y = _common_point(poses, held, (b, o), guess)
    apart = poses.points(np.array([b]), x[None])[:, 0] - poses.points(np.array([o]), y[None])[:, 0]
    site = Site(
        name=name or f"{body}_on_{other}",
        body=body,
        points=x[None],
        cone=cone or Cone(direction=None),
        against=other,
    )
    return Grip(site, frozen_array(y), frozen_array(np.linalg.norm(apart, axis=1)))


def _common_point(
    poses: Poses, held: NDArray[np.bool_], bodies: tuple[int, int], guess: Array
) -> tuple[Array, Array]:
    """Point of two bodies about which they turn on each other, by least squares.

    Parameters
    ----------
    held : (frames,) when they hold together
    bodies : numbers
    guess : (3,) of the point on the first [m]

    Returns
    -------
    (3,) on the first and (3,) on the second [m]
    """
    b, o = bodies
    pull = np.sqrt(PULL * int(held.sum()))
    weight = pull * np.hstack([np.eye(3), np.zeros((3, 3))])
    both = np.concatenate([poses.rotations[held, b], -poses.rotations[held, o]], axis=2)
    gaps = (poses.origins[held, o] - poses.origins[held, b]).ravel()
    solved = np.linalg.lstsq(
        np.vstack([both.reshape(-1, 6), weight]),
        np.concatenate([gaps, pull * guess]),
        rcond=None,
    )[0]
    return solved[:3], solved[3:]


@read_only
class ActionReaction:
    """Wrenches that parts pass to each other, and what is left when all are added.

    Rows of wrenches are moment about the ground's origin [N m], then force [N], in ground.

    Attributes
    ----------
    time : (frames,) [s]
    parts : names
    passed : (frames, parts, 6) external wrench that a part's motion and weight need, less what was
        measured on it: what the others do to it
    """

    time: Array
    parts: tuple[str, ...]
    passed: Array

    @property
    def residual(self) -> Array:
        """(frames, 6) sum over the parts, 0 where action is reaction and all is measured."""
        return self.passed.sum(axis=1)

    @property
    def force_error(self) -> float:
        """Root mean square of the residual's force [N]."""
        return float(np.sqrt(np.mean(np.sum(self.residual[:, 3:] ** 2, axis=1))))


def action_reaction(
    model: Model, motion: Motion, parts: Sequence[str], measured: Wrenches
) -> ActionReaction:
    """Check the parts of a joined model against forces measured on them, by their root equations.

    Parameters
    ----------
    model : joined (`join_models`)
    motion : coordinates over time
    parts : names
    measured : forces on bodies, at the motion's times

    Raises
    ------
    UnknownName : a part is not in the model
    """
    origin = np.zeros((len(motion), 3))
    owners = np.array(
        [[own_name(body.name, part) is not None for body in model.bodies] for part in parts]
    )
    existing = tuple(dict.fromkeys(name.partition("_")[0] for name in model.body_names))
    for part, owned in zip(parts, owners, strict=True):
        if not owned.any():
            raise UnknownName("part", part, existing)
    parameters = inertial_parameters(model) * owners[:, :, None]
    passed = np.empty((len(motion), len(parts), 6))
    for block in regressor_blocks(model, motion, np.zeros(3)):
        passed[block.frames] = np.einsum(
            "fik,pk->fpi", block.rows, parameters.reshape(len(parts), -1)
        )
    for index, part in enumerate(parts):
        columns = [i for i, body in enumerate(measured.bodies) if own_name(body, part) is not None]
        passed[:, index] -= sum_of_wrenches(model, motion, measured.columns(columns), origin)
    return ActionReaction(frozen_array(motion.time), tuple(parts), frozen_array(passed))

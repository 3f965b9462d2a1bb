"""Joint load as a term: the force that a joint transmits, squared, in shares of body weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel, check_name
from myomorph.core.model.model import Model
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.patella import with_lever
from myomorph.core.tension.terms.muscles import MuscleTerm
from myomorph.core.tension.terms.term import Frames, Rows, Term, Unknowns


class JointLoadTerm(Term):
    """weight sum_j |F_j / W|^2 of forces F_j that joints transmit, with the body's weight W.

    The bodies that hang on a joint are taken as free, as in `joint_reactions`:

        F_j = F_j0 - sum_m P_jm (F_m a_m + F_passive,m + F_viscous,m)

    with F_j0 of motion, gravity and external forces, and P_jm what unit tension of a muscle does to
    these bodies: it is linear in activations. Actuators that push on bodies are not seen.

    Source: Cleather and Bull 2011 for joint loads in the cost; Steele et al. 2012 for F_j.

    Parameters
    ----------
    model : with muscles
    joints : names, of joints that a muscle crosses (see `crossed_joints`)
    alone : (frames, joints, 3) F_j0 in ground [N], as `joint_reactions` without tensions gives it
    weight : above 0, of one body weight squared in units of the effort a^2 of one muscle

    Raises
    ------
    BadData : a weight that is not above 0
    BadModel : a model without mass or gravity
    """

    def __init__(self, model: Model, joints: Sequence[str], alone: Array, weight: float):
        if not weight > 0.0:
            raise BadData(f"weight {weight:g} of joint loads: expected above 0")
        self.joints = tuple(joints)
        self._weight = weight
        self._paths = compile_paths(model)
        self._alone = alone
        muscles = crossing_muscles(model)
        child = {joint.name: joint.child for joint in model.joints}
        self._crossing = [np.flatnonzero(muscles[name]) for name in joints]
        self._pairs = [
            np.flatnonzero(self._paths.tree.hanging(child[name])[self._paths.pull_body])
            for name in joints
        ]
        # (crossing muscles, pairs of the joint) 1 where a pull is of a muscle, else 0
        self._owners = [
            (crossing[:, None] == self._paths.pull_muscle[pairs]).astype(np.float64)
            for crossing, pairs in zip(self._crossing, self._pairs, strict=True)
        ]
        self._body_weight = model.mass * float(np.linalg.norm(model.gravity))
        if not self._body_weight > 0.0:
            raise BadModel(f"model '{model.name}' has no weight to take joint loads in shares of")

    def renew(self, alone: Array) -> None:
        """Put other frames, as many, in the place of those given.

        Parameters
        ----------
        alone : (frames, joints, 3) F_j0 in ground [N]
        """
        self._alone[:] = alone

    def rows(self, unknowns: Unknowns) -> Rows:
        """Three rows per joint, of the muscles that cross it."""
        self._muscles = next(term for term in unknowns.terms if isinstance(term, MuscleTerm))
        first = unknowns.of(self._muscles).start
        columns = [first + crossing for crossing in self._crossing for _ in range(3)]
        names = tuple(f"load of {name} {axis}" for name in self.joints for axis in "xyz")
        return Rows.of_frames(names, columns, 1.0, self._weight, on_forces=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force per unit activation on the bodies of each joint, and what else the joint carries.

        Parameters
        ----------
        rows : as `rows` returned them
        frames : a chunk of the motion

        Returns
        -------
        (frames, entries) and (frames, rows), both in body weights
        """
        muscles = self._muscles.forces(frames)
        pulls, work = self._paths.pulls(frames.coordinates)
        pulls = with_lever(self._paths, frames.coordinates, pulls, work)
        shares = pulls[..., :3] / self._body_weight
        anyway = muscles.passive + muscles.viscous
        values = []
        targets = []
        for j, (pairs, crossing) in enumerate(zip(self._pairs, self._crossing, strict=True)):
            # (frames, crossing muscles, 3) of one unit of tension; what does not cross has no share
            unit = self._owners[j] @ shares[:, pairs]
            of_activation = unit * muscles.active[:, crossing, None]
            values.append(of_activation.transpose(0, 2, 1).reshape(len(frames), -1))
            carried = np.einsum("kmi,km->ki", unit, anyway[:, crossing])
            targets.append(self._alone[frames.part, j] / self._body_weight - carried)
        return np.hstack(values), np.hstack(targets)


def crossed_joints(model: Model, joints: Sequence[str] = ()) -> tuple[str, ...]:
    """Joints whose load depends on muscles.

    Parameters
    ----------
    model : of the body
    joints : names to check; none for all joints that a muscle crosses

    Raises
    ------
    BadModel : the model closes loops
    UnknownName : a joint is not in the model
    BadData : no muscle crosses a joint
    """
    if model.loops:
        raise BadModel(
            f"model '{model.name}' has closed loops: joint loads in the cost need a model"
            " without any"
        )
    names = tuple(joint.name for joint in model.joints)
    for name in joints:
        check_name("joint", name, names)
    crossing = crossing_muscles(model)
    for name in joints:
        if not crossing[name].any():
            raise BadData(f"no muscle crosses joint '{name}': its load does not depend on muscles")
    return tuple(joints) or tuple(name for name in names if crossing[name].any())


def crossing_muscles(model: Model) -> dict[str, np.ndarray]:
    """Muscles that pull both on bodies that hang on a joint and on others.

    Parameters
    ----------
    model : of the body

    Returns
    -------
    by joint, (muscles,) whether a muscle crosses it
    """
    paths = compile_paths(model)
    muscles = np.arange(len(model.muscles))
    result = {}
    for joint in model.joints:
        inside = paths.tree.hanging(joint.child)[paths.pull_body]
        result[joint.name] = np.isin(muscles, paths.pull_muscle[inside]) & np.isin(
            muscles, paths.pull_muscle[~inside]
        )
    return result

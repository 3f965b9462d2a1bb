"""Joint load as a term: the force that a joint transmits, squared, in shares of body weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, BadModel, check_name
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.muscles.path import compile_paths
from myomorph.rigid.tree import compile_tree
from myomorph.tension.reaction import joint_reactions
from myomorph.tension.terms.muscles import MuscleTerm
from myomorph.tension.terms.term import Frames, Rows, Term, Unknowns


class JointLoadTerm(Term):
    """weight sum_j |F_j / W|^2 of the forces F_j that joints transmit, with the body's weight W.

    The bodies that hang on a joint are taken as free, as in `joint_reactions`:

        F_j = F_j0 - sum_m P_jm (F_m a_m + F_passive,m + F_viscous,m)

    with F_j0 of motion, gravity and external forces, and P_jm what unit tension of a muscle does to these bodies: it is
    linear in activations. Actuators that push on bodies are not seen.

    Source: Cleather and Bull 2011 for joint loads in the cost; Steele et al. 2012 for F_j.

    Parameters
    ----------
    model, motion : with velocities and accelerations
    wrenches : external forces at the motion's times, None for none
    weight : above 0, of one body weight squared in units of the effort a^2 of one muscle
    joints : names; none for all that a muscle crosses

    Raises
    ------
    BadData, UnknownName, BadModel
        where the weight is not above 0, a joint does not exist or no muscle crosses it, or loops are closed
    """

    def __init__(
        self, model: Model, motion: Motion, wrenches: Wrenches | None, weight: float, joints: Sequence[str] = ()
    ):
        if not weight > 0.0:
            raise BadData(f"weight {weight:g} of joint loads: expected above 0")
        if model.loops:
            raise BadModel(f"model '{model.name}' has closed loops: joint loads in the cost need a model without any")
        tree = compile_tree(model)
        self._paths, self._weight = compile_paths(model), weight
        parent = tree.arrays.parent
        names = tuple(one.name for one in model.joints)
        for name in joints:
            check_name("joint", name, names)
        inside, crossing, chosen = [], [], []
        for joint in model.joints:
            if joints and joint.name not in joints:
                continue
            hangs = np.zeros(len(parent), dtype=bool)
            hangs[tree.body_index[joint.child]] = True
            for body in range(1, len(parent)):
                hangs[body] |= bool(hangs[parent[body]])
            pairs = hangs[self._paths.pull_body]
            muscles = np.arange(len(model.muscles))
            within = np.isin(muscles, self._paths.pull_muscle[pairs])
            beyond = np.isin(muscles, self._paths.pull_muscle[~pairs])
            if not (within & beyond).any():
                if joints:
                    raise BadData(f"no muscle crosses joint '{joint.name}': its load does not depend on muscles")
                continue
            chosen.append(joint.name)
            inside.append(np.flatnonzero(pairs))
            crossing.append(np.flatnonzero(within & beyond))
        self.joints, self._pairs, self._crossing = tuple(chosen), inside, crossing
        mass = sum(body.mass for body in model.bodies)
        self._body_weight = mass * float(np.linalg.norm(model.gravity))
        if not self._body_weight > 0.0:
            raise BadModel(f"model '{model.name}' has no weight to take joint loads in shares of")
        self._alone = joint_reactions(model, motion, None, wrenches, joints=self.joints, frame="ground").forces

    def rows(self, unknowns: Unknowns) -> Rows:
        """Three rows a joint, of the muscles that cross it."""
        self._muscles = next(one for one in unknowns.terms if isinstance(one, MuscleTerm))
        first = unknowns.of(self._muscles).start
        row = [np.full(len(of), 3 * j + k) for j, of in enumerate(self._crossing) for k in range(3)]
        column = [first + of for of in self._crossing for _ in range(3)]
        names = tuple(f"load of {name} {axis}" for name in self.joints for axis in "xyz")
        count = len(names)
        every, wide = np.ones(count), np.full(count, np.inf)
        entries = np.concatenate(row).astype(np.int64), np.concatenate(column).astype(np.int64)
        values = np.zeros(len(entries[0]))
        return Rows(names, *entries, values, np.zeros(count), every, self._weight * every, -wide, wide)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force per unit activation on the bodies that hang on each joint, and what else the joint carries."""
        found = self._muscles.forces(frames)
        pulls = self._paths.pulls(frames.coordinates)[0][..., :3] / self._body_weight
        values, targets = [], []
        for j, (pairs, crossing) in enumerate(zip(self._pairs, self._crossing, strict=True)):
            unit = np.zeros((len(frames), found.active.shape[1], 3))
            for pair in pairs:
                unit[:, self._paths.pull_muscle[pair]] += pulls[:, pair]
            values.append((unit * found.active[..., None])[:, crossing].transpose(0, 2, 1).reshape(len(frames), -1))
            anyway = np.einsum("kmi,km->ki", unit, found.passive + found.viscous)
            targets.append(self._alone[frames.part, j] / self._body_weight - anyway)
        return np.hstack(values), np.hstack(targets)

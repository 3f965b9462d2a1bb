"""Costs beside the effort, as options and terms: joint loads and co-contraction of muscles on both sides of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, BadModel, check_name
from myomorph.model.model import Model
from myomorph.model.series import Motion, Series, Wrenches
from myomorph.muscles.passive import joint_forces
from myomorph.muscles.patella import patella_of, with_lever
from myomorph.muscles.path import compile_paths
from myomorph.rigid.dynamics import rates_of
from myomorph.rigid.forward import gathered
from myomorph.rigid.knees import knee_joints
from myomorph.rigid.tree import compile_tree
from myomorph.tension.reaction import joint_reactions
from myomorph.tension.tension import TensionOptions
from myomorph.tension.terms.actuators import free_coordinates
from myomorph.tension.terms.muscles import MuscleTerm
from myomorph.tension.terms.term import LIMIT_COST, Frames, Rows, Term, Unknowns, Variables

WEIGHT = 100.0
"""Cost of a co-contraction that lacks, squared, in units of the effort a^2 of one muscle: an aim and no constraint, so
that a joint whose muscles cannot do it still has a solution."""

SMALL = 1e-4  # Moment arms below this turn nothing [m]


class CoContractionTerm(Term):
    """At every coordinate that muscles turn both ways, the weaker side gives at least `level` of what it can.

    With moment arms r and forces F of unit activation, A = min over the sides of sum |r| F, and the joint torque tau,

        sum_m |r_m| F_m a_m / A >= |tau| / A + 2 level

    as both sides together give |tau| and twice the torque of the weaker side. What lacks costs `WEIGHT` times its
    square; more than that costs nothing but its effort.

    `motion`: with velocities; `torques`: joint torques at the motion's times [N m]; `level`: 0 to 1; `coordinates`:
    names; none for all rotations that muscles turn both ways.
    """

    def __init__(self, model: Model, motion: Motion, torques: Series, level: float, coordinates: Sequence[str] = ()):
        if not 0.0 < level <= 1.0:
            raise BadData(f"co-contraction of {level:g}: expected above 0, at most 1")
        self._tree, self._paths, self._level = compile_tree(model), compile_paths(model), level
        free = free_coordinates(model)
        for name in coordinates:
            check_name("free coordinate", name, free)
        values, rates = rates_of(self._tree, motion)
        known = {name: torques[name] for name in torques.names}
        tau = np.array([known.get(name, np.zeros(len(motion))) for name in model.coordinate_names]).T
        every = np.linspace(0, len(motion) - 1, min(len(motion), 9)).round().astype(int)
        arms = self._arms(self._paths.evaluate(values[every], rates[every])[2])
        wanted = [index for index, name in enumerate(model.coordinate_names) if name in (coordinates or free)]
        rotates = [number for number in wanted if model.coordinates[number].motion == "rotational"]
        both = [
            rotate
            for rotate in rotates
            if (arms[:, :, rotate] > SMALL).any(1).all() and (arms[:, :, rotate] < -SMALL).any(1).all()
        ]
        if coordinates and len(both) < len(wanted):
            lacking = next(model.coordinate_names[number] for number in wanted if number not in both)
            raise BadData(f"muscles do not turn '{lacking}' both ways: there is no co-contraction of it")
        if not both:
            raise BadData(f"muscles of model '{model.name}' turn no joint both ways: there is no co-contraction")
        self.coordinates, self._columns = tuple(model.coordinate_names[number] for number in both), both
        self._crossing = [np.flatnonzero((np.abs(arms[:, :, number]) > SMALL).any(axis=0)) for number in both]
        left = gathered(self._tree, values, tau - joint_forces(self._tree, values, rates))
        self._torque = np.abs(left[:, both])

    def _arms(self, arms: Array) -> Array:
        """(frames, muscles, coordinates) moment arms; those of a coordinate that leads hold what follows it."""
        whole = np.zeros((len(arms), len(self._paths.muscles), len(self._tree.model.coordinates)))
        whole[:, self._paths.arm_muscle, self._paths.arm_coordinate] = arms
        return whole

    def variables(self) -> Variables:
        """How far each coordinate passes what is asked for."""
        count = len(self.coordinates)
        names = tuple(f"co-contraction of {name} beyond" for name in self.coordinates)
        ends = np.zeros(count), np.full(count, np.inf)
        return Variables(names, np.full(count, LIMIT_COST), np.full(count, 2.0), *ends)

    def entries(self) -> Sequence[tuple[int, int]]:
        """No generalized forces."""
        return ()

    def rows(self, unknowns: Unknowns) -> Rows:
        """A row a coordinate, of the muscles that cross it and of what passes."""
        self._muscles = next(term for term in unknowns.terms if isinstance(term, MuscleTerm))
        first, columns = unknowns.of(self._muscles).start, unknowns.of(self).start
        count = len(self.coordinates)
        row = np.concatenate([np.full(len(of) + 1, j) for j, of in enumerate(self._crossing)])
        column = np.concatenate([np.append(first + of, columns + j) for j, of in enumerate(self._crossing)])
        names = tuple(f"co-contraction of {name}" for name in self.coordinates)
        every, wide = np.ones(count), np.full(count, np.inf)
        shape = row.astype(np.int64), column.astype(np.int64), np.zeros(len(row)), np.zeros(count)
        return Rows(names, *shape, every, WEIGHT * every, -wide, wide, on_forces=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """|r| F / A of each muscle, and |tau| / A + 2 level."""
        result = self._muscles.forces(frames)
        turning = self._arms(result.arms)[:, :, self._columns] * result.active[..., None]
        sides = [np.maximum(sign * turning, 0.0).sum(axis=1) for sign in (1.0, -1.0)]
        weaker = np.maximum(np.minimum(*sides), 1e-9)
        size = np.abs(turning) / weaker[:, None]
        beyond = -np.ones((len(frames), 1))
        values = [np.hstack([size[:, of, j], beyond]) for j, of in enumerate(self._crossing)]
        return np.hstack(values), self._torque[frames.part] / weaker + 2.0 * self._level


class JointLoadTerm(Term):
    """weight sum_j |F_j / W|^2 of the forces F_j that joints transmit, with the body's weight W.

    The bodies that hang on a joint are taken as free, as in `joint_reactions`:

        F_j = F_j0 - sum_m P_jm (F_m a_m + F_passive,m + F_viscous,m)

    with F_j0 of motion, gravity and external forces, and P_jm what unit tension of a muscle does to these bodies: it is
    linear in activations. Actuators that push on bodies are not seen.

    Source: Cleather and Bull 2011 for joint loads in the cost; Steele et al. 2012 for F_j.

    `model`: with muscles; `joints`: names, of joints that a muscle crosses (see `crossed_joints`); `alone` (frames,
    joints, 3) F_j0 in ground [N], as `joint_reactions` without tensions gives it; `weight`: above 0, of one body weight
    squared in units of the effort a^2 of one muscle.
    """

    def __init__(self, model: Model, joints: Sequence[str], alone: Array, weight: float):
        if not weight > 0.0:
            raise BadData(f"weight {weight:g} of joint loads: expected above 0")
        self.joints, self._weight = tuple(joints), weight
        self._paths, self._alone = compile_paths(model), alone
        muscles = _crossing(model)
        child = {joint.name: joint.child for joint in model.joints}
        self._crossing = [np.flatnonzero(muscles[name]) for name in joints]
        self._pairs = [np.flatnonzero(self._paths.tree.hanging(child[name])[self._paths.pull_body]) for name in joints]
        mass = sum(body.mass for body in model.bodies)
        self._body_weight = mass * float(np.linalg.norm(model.gravity))
        if not self._body_weight > 0.0:
            raise BadModel(f"model '{model.name}' has no weight to take joint loads in shares of")

    def rows(self, unknowns: Unknowns) -> Rows:
        """Three rows a joint, of the muscles that cross it."""
        self._muscles = next(term for term in unknowns.terms if isinstance(term, MuscleTerm))
        first = unknowns.of(self._muscles).start
        row = [np.full(len(of), 3 * j + index) for j, of in enumerate(self._crossing) for index in range(3)]
        column = [first + of for of in self._crossing for _ in range(3)]
        names = tuple(f"load of {name} {axis}" for name in self.joints for axis in "xyz")
        count = len(names)
        every, wide = np.ones(count), np.full(count, np.inf)
        entries = np.concatenate(row).astype(np.int64), np.concatenate(column).astype(np.int64)
        values = np.zeros(len(entries[0]))
        return Rows(names, *entries, values, np.zeros(count), every, self._weight * every, -wide, wide, on_forces=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force per unit activation on the bodies that hang on each joint, and what else the joint carries."""
        result = self._muscles.forces(frames)
        own = self._paths.pulls(frames.coordinates)
        pulls = with_lever(self._paths, frames.coordinates, *own)[..., :3] / self._body_weight
        values, targets = [], []
        for j, (pairs, crossing) in enumerate(zip(self._pairs, self._crossing, strict=True)):
            unit = np.zeros((len(frames), result.active.shape[1], 3))
            for pair in pairs:
                unit[:, self._paths.pull_muscle[pair]] += pulls[:, pair]
            values.append((unit * result.active[..., None])[:, crossing].transpose(0, 2, 1).reshape(len(frames), -1))
            anyway = np.einsum("kmi,km->ki", unit, result.passive + result.viscous)
            targets.append(self._alone[frames.part, j] / self._body_weight - anyway)
        return np.hstack(values), np.hstack(targets)


def crossed_joints(model: Model, joints: Sequence[str] = ()) -> tuple[str, ...]:
    """Joints by name, checked; without any all that a muscle crosses."""
    if model.loops:
        raise BadModel(f"model '{model.name}' has closed loops: joint loads in the cost need a model without any")
    names = tuple(joint.name for joint in model.joints)
    for name in joints:
        check_name("joint", name, names)
    crossing = _crossing(model)
    for name in joints:
        if not crossing[name].any():
            raise BadData(f"no muscle crosses joint '{name}': its load does not depend on muscles")
    return tuple(joints) or tuple(name for name in names if crossing[name].any())


def _crossing(model: Model) -> dict[str, np.ndarray]:
    """(muscles,) whether a muscle pulls on bodies that hang on a joint and on others too, by joint."""
    paths, muscles = compile_paths(model), np.arange(len(model.muscles))
    result = {}
    for joint in model.joints:
        inside = paths.tree.hanging(joint.child)[paths.pull_body]
        result[joint.name] = np.isin(muscles, paths.pull_muscle[inside]) & np.isin(muscles, paths.pull_muscle[~inside])
    return result


KNEES, ALL = "knees", "all"
KNEE_LOAD = 0.02  # Default weight of the load of knees (docs/decisions/0029-knees-that-bend.md)


@dataclass(frozen=True)
class RecruitmentOptions:
    """Costs beside the effort of muscles.

    Attributes
    ----------
    joint_load : weight of the squared force that joints transmit, in body weights, beside the effort a^2 of one
        muscle; 0 for none; by default 0.02 with rigid tendons where the external forces are known
    joint_load_joints : names of these joints, separated by commas; "knees" for those between thigh and shank and
        thigh and patella, "all" for all that a muscle crosses
    co_contraction : share of what the weaker side of every joint can give that it gives at least, 0 to 1; 0 for none
    co_contraction_coordinates : names of these coordinates, separated by commas; "" for all that muscles turn both ways
    """

    joint_load: float | None = None
    joint_load_joints: str = KNEES
    co_contraction: float = 0.0
    co_contraction_coordinates: str = ""

    def __post_init__(self) -> None:
        if self.joint_load is not None and not 0.0 <= self.joint_load < float("inf"):
            raise BadData(f"weight {self.joint_load:g} of joint loads: expected 0 or more")
        if not 0.0 <= self.co_contraction <= 1.0:
            raise BadData(f"co-contraction of {self.co_contraction:g}: expected 0 to 1")
        for names, weight, default in (
            ("joint_load_joints", "joint_load", KNEES),
            ("co_contraction_coordinates", "co_contraction", ""),
        ):
            if getattr(self, names) != default and not getattr(self, weight):
                raise BadData(f"{names} without {weight}: give {weight} above 0")

    def settled(self, model: Model, options: TensionOptions, external: bool) -> RecruitmentOptions:
        """The options with a default weight of joint loads; `external`: whether the external forces are known."""
        if self.joint_load is not None:
            return self
        plain = options.tendons == "rigid" and options.recruitment == "power" and not model.loops
        usable = plain and external and model.weight > 0.0 and bool(loaded_knees(model))
        return replace(self, joint_load=KNEE_LOAD if usable else 0.0)


def recruitment_terms(
    model: Model, motion: Motion, torques: Series, wrenches: Wrenches | None, options: RecruitmentOptions
) -> tuple[Term, ...]:
    """The terms that options ask for; errors are those of `crossed_joints` and `CoContractionTerm`."""
    terms: list[Term] = []
    if options.joint_load:
        joints = {KNEES: loaded_knees(model), ALL: ()}.get(options.joint_load_joints)
        if options.joint_load_joints == KNEES and not joints:
            raise BadData(f"joint_load: no muscle crosses a knee of '{model.name}': name joints in joint_load_joints")
        joints = _names(options.joint_load_joints) if joints is None else joints
        terms.append(joint_load_term(model, motion, wrenches, options.joint_load, joints))
    if options.co_contraction:
        coordinates = _names(options.co_contraction_coordinates)
        terms.append(CoContractionTerm(model, motion, torques, options.co_contraction, coordinates))
    return tuple(terms)


def loaded_knees(model: Model) -> tuple[str, ...]:
    """Knees that muscles cross, by name, and the joints of their patellae."""
    names = [knee.name for knee in knee_joints(model)]
    patellae = {patella_of(model, knee) for knee in knee_joints(model)}
    names += [joint.name for joint in model.joints if joint.child in patellae]
    crossed = set(crossed_joints(model)) if names and model.muscles and not model.loops else set()
    return tuple(name for name in names if name in crossed)


def joint_load_term(
    model: Model, motion: Motion, wrenches: Wrenches | None, weight: float, joints: Sequence[str] = ()
) -> JointLoadTerm:
    """The term of joint loads.
    `motion`: with velocities and accelerations; `wrenches`: external forces at the motion's times, None for none;
    `weight`: of one body weight squared in units of the effort a^2 of one muscle; `joints`: names; none for all that a
    muscle crosses.
    """
    chosen = crossed_joints(model, joints)
    alone = joint_reactions(model, motion, None, wrenches, joints=chosen, frame="ground").forces
    return JointLoadTerm(model, chosen, alone, weight)


def _names(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())

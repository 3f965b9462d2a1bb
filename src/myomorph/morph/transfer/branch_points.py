"""Where muscles branch: a virtual link comes to rest where the tensions of its lines of action balance ([D] chapter 2).

Nothing holds a branching point but the muscles that end there or run through it. Its file says where it is; the
tensions nearest to equal activation that hold it there are found, and what force they leave over (of pressure, of
fascia) is carried along. In other bones the same tensions and that force put it where sum_i T_i dL_i/dx = R. It is the
least of sum_i T_i L_i - R x, which has one for straight lines of action (the Fermat-Weber problem).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData, check_name
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.functions import linear
from myomorph.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.model.paths import Muscle, TendonWrap
from myomorph.model.series import DEFAULT_POSE, Motion
from myomorph.model.spatial import Transform
from myomorph.muscles.path import compile_paths

FREE = "free branch"
"""Of the names of the body and the coordinates that a branching point moves by while its balance is looked for."""

MIN_SHARE, MAX_SHARE = 0.1, 10.0
"""Tensions may become so many times what equal activation gives, to hold the source's link in balance."""

STIFF = 10.0  # How much more the balance counts than that tensions stay as they are.
ROUNDS = 60
SETTLED = 1e-10  # Newton's steps end when no point moves by more than this share of the length of its lines of action.
STEP = 1e-5  # Of the derivative of the forces, as a share of the lengths of the lines of action.
FLAT = 1e-4
"""A direction in which the stiffness of the lines of action is less than this share of the greatest holds nothing."""


@dataclass(frozen=True)
class Riders:
    """What rides on a branching point."""

    points: Mapping[str, tuple[int, ...]]  # by muscle, the numbers of its path points
    wraps: frozenset[str]  # names of wrap objects
    sides: Mapping[str, tuple[int, ...]]  # by muscle, the numbers of its wraps whose side site rides


@read_only
class BranchLoad:
    """What holds a branching point."""

    link: str  # the body
    muscles: tuple[str, ...]  # its lines of action
    tensions: Array  # (lines of action,) [N]
    rest: Array  # (3,) force that no line of action holds, in the link's frame [N]

    @property
    def share(self) -> float:
        """Of the line tensions, that they do not hold among themselves."""
        return float(np.linalg.norm(self.rest) / self.tensions.sum())


def riders_of(model: Model, link: str) -> Riders:
    """All that is fixed to a body and that muscle paths meet."""
    check_name("body", link, model.body_names)

    def of_muscles(parts: Callable[[Muscle], Iterable[str]]) -> Mapping[str, tuple[int, ...]]:
        riders = {
            muscle.name: tuple(index for index, body in enumerate(parts(muscle)) if body == link)
            for muscle in model.muscles
        }
        return FrozenMap({name: numbers for name, numbers in riders.items() if numbers})

    return Riders(
        of_muscles(lambda muscle: (point.body for point in muscle.path.points)),
        frozenset(item.name for item in model.wrap_objects if item.body == link),
        of_muscles(lambda muscle: (getattr(wrap, "side_body", "") for wrap in muscle.path.wraps)),
    )


def branch_load(model: Model, link: str) -> BranchLoad:
    """The tensions that hold a branching point `link` where the model has it, nearest to those of equal activation."""
    freed = _FreeLink(model, link, riders_of(model, link))
    force = np.array([model.muscle(name).max_isometric_force for name in freed.muscles])
    if not len(force) or not np.all(force > 0.0):
        raise BadData(f"branching point '{link}': it needs muscles with a maximum isometric force above 0")
    slopes = freed.slopes(np.zeros((1, 3)))[1][0]
    # The last of the stiff rows keeps the tensions' sum: less of all of them is no balance.
    rows = np.concatenate([STIFF * np.vstack([slopes, np.ones(len(force))]) * force / force.sum(), np.eye(len(force))])
    wanted = np.concatenate([np.zeros(3), [STIFF], np.ones(len(force))])
    tensions = force * lsq_linear(rows, wanted, (MIN_SHARE, MAX_SHARE)).x
    return BranchLoad(link, freed.muscles, tensions, slopes @ tensions)


def branch_places(
    model: Model, load: BranchLoad, motion: Motion | None = None, riders: Riders | None = None
) -> tuple[Array, Array]:
    """How far a branching point moves until its lines of action balance: (frames, 3) from where the model has it, in
    the link's frame [m], NaN where there is no balance; and (frames,) whether there is one. Source: [D] chapter 2,
    virtual links; the balance is that of a massless body (see docs/bone-maps.md). `riders`: by default all that the
    body has.
    """
    for name in load.muscles:
        check_name("muscle", name, model.muscle_names)
    riding = riders or riders_of(model, load.link)
    branches = {name: numbers for name, numbers in riding.points.items() if name in load.muscles}
    freed = _FreeLink(model, load.link, replace(riding, points=FrozenMap(branches)), motion)
    order = [load.muscles.index(name) for name in freed.muscles]
    tensions = load.tensions[order]
    moved = np.zeros((freed.frames, 3))
    size = float(np.mean(freed.slopes(moved)[0]))
    energy, force, stiffness = _state(freed, moved, tensions, load.rest, size)
    for _ in range(ROUNDS):
        sound = _firm(stiffness)
        step = np.zeros_like(moved)
        step[sound] = -np.linalg.solve(stiffness[sound], force[sound][..., None])[..., 0]
        # Newton's step may pass a line of action's far end: no step is longer than a quarter of a line.
        step *= np.minimum(1.0, 0.25 * size / np.maximum(np.linalg.norm(step, axis=1), 1e-300))[:, None]
        share = np.ones(len(moved))
        for _ in range(12):
            trial = _state(freed, moved + share[:, None] * step, tensions, load.rest, size)
            worse = trial[0] > energy + 1e-14 * np.abs(energy)
            if not worse.any():
                break
            share = np.where(worse, 0.5 * share, share)
        share = np.where(worse, 0.0, share)
        moved = moved + share[:, None] * step
        energy, force, stiffness = _state(freed, moved, tensions, load.rest, size)
        if np.linalg.norm(share[:, None] * step, axis=1).max() < SETTLED * size:
            break
    balanced = _firm(stiffness) & (np.linalg.norm(force, axis=1) < 1e-6 * tensions.sum())
    return np.where(balanced[:, None], moved, np.nan), balanced


def _state(freed: _FreeLink, moved: Array, tensions: Array, rest: Array, size: float) -> tuple[Array, Array, Array]:
    """Energy (frames,), its slope (frames, 3) and second derivatives (frames, 3, 3) by the point's place."""
    steps = STEP * size * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    lengths, slopes = freed.slopes((moved[:, None] + steps).reshape(-1, 3), len(steps))
    pulls = (slopes @ tensions).reshape(-1, 7, 3)
    energy = (lengths @ tensions).reshape(-1, 7)[:, 0] - moved @ rest
    stiffness = (pulls[:, 1:4] - pulls[:, 4:]) / (2.0 * STEP * size)
    return energy, pulls[:, 0] - rest, 0.5 * (stiffness + np.swapaxes(stiffness, 1, 2))


def _firm(stiffness: Array) -> Array:
    """(frames,) whether a point is held against every direction."""
    values = np.linalg.eigvalsh(stiffness)
    firm: Array = values[:, 0] > FLAT * np.abs(values).max(axis=1)
    return firm


class _FreeLink:
    """A model whose points on one link ride on a body that slides along the link's axes."""

    def __init__(self, model: Model, link: str, riders: Riders, motion: Motion | None = None):
        names = tuple(f"{FREE} {letter}" for letter in "xyz")
        still = Transform.identity()
        axes = tuple(Axis("translation", row, linear(1.0), (name,)) for row, name in zip(np.eye(3), names, strict=True))
        freed = replace(
            model,
            bodies=(*model.bodies, Body(FREE, 0.0, np.zeros(3), np.zeros((3, 3)))),
            joints=(*model.joints, Joint(FREE, "CustomJoint", link, FREE, still, still, axes, names)),
            coordinates=(*model.coordinates, *(Coordinate(name, "translational") for name in names)),
            muscles=tuple(_riding(muscle, riders) for muscle in model.muscles if muscle.name in riders.points),
            wrap_objects=tuple(
                replace(item, body=FREE) if item.name in riders.wraps else item for item in model.wrap_objects
            ),
        )
        self.muscles = freed.muscle_names
        self._paths = compile_paths(freed)
        self._values = self._paths.tree.coordinates_of(DEFAULT_POSE if motion is None else motion)
        self._columns = [freed.coordinate_names.index(name) for name in names]
        self.frames = len(self._values)

    def slopes(self, moved: Array, each: int = 1) -> tuple[Array, Array]:
        """Lengths (frames, lines) and their derivatives (frames, 3, lines) by the point's place in the link. `moved`:
        (frames x each, 3) places, `each` of them a frame [m].
        """
        values = np.repeat(self._values, each, axis=0)
        values[:, self._columns] = moved
        lengths, _, arms = self._paths.evaluate(values)
        result = np.zeros((len(values), 3, len(self.muscles)))
        for axis, column in enumerate(self._columns):
            pairs = self._paths.arm_coordinate == column
            # A moment arm is positive where the muscle shortens.
            result[:, axis, self._paths.arm_muscle[pairs]] = -arms[:, pairs]
        return lengths, result


def _riding(muscle: Muscle, riders: Riders) -> Muscle:
    path = muscle.path
    points = tuple(
        replace(point, body=FREE) if index in riders.points[muscle.name] else point
        for index, point in enumerate(path.points)
    )
    turned = riders.sides.get(muscle.name, ())
    wraps: Any = tuple(
        replace(wrap, side_body=FREE) if index in turned and isinstance(wrap, TendonWrap) else wrap
        for index, wrap in enumerate(path.wraps)
    )
    return replace(muscle, path=replace(path, points=points, wraps=wraps))

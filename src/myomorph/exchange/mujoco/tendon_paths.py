"""Muscle paths by the rules of MuJoCo: one sphere or cylinder between two sites.

It has a side site where it needs one. A point that the path goes through only while a coordinate is
in a range becomes a sphere too small to see, with a side site: the path catches on it as soon as it
would pass on the other side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.paths import (
    Muscle,
    Path,
    PathPoint,
    PathWrap,
    TendonWrap,
    WrapObject,
    surface_level,
)
from myomorph.core.model.spatial import Transform, spread_directions
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.exchange.mujoco.joints import range_of
from myomorph.exchange.mujoco.path_fit import Movable, fitted_paths

SIDE_DISTANCE = 4.0  # From a surface's center to its side site, in radii.
CATCH_RADIUS = 1e-5  # Of the sphere in the place of a point that is not always on the path [m].
CATCH_SIDE = 0.05  # From there to its side site [m].
DIRECTIONS = 100  # In which side sites are tried.
# Of differences between poses of a sweep, over errors of lengths, where two paths are compared.
SLOPES = 10.0
EVERY = 3  # Of the poses, those in which side sites are tried.
USUAL = 1.0  # Distance from the default pose within which poses count most [rad or m].
# Of a length, beyond which it does not matter how large it is: the path is another [m].
LARGEST_ERROR = 0.02
VERSIONS = (3, 4)  # Of MuJoCo, with rules of their own for side sites: 3 for all before 4
OTHER = {3: 4, 4: 3}
AGREEMENT = 1e-4  # By which lengths of both versions may differ [m]
SLACK = 1e-5


def tendon_paths(model: Model, coordinates: Array) -> tuple[Model, dict[str, str]]:
    """Replace paths of a model of `mujoco_joints` by MuJoCo's, as far as its surfaces are MuJoCo's.

    Parameters
    ----------
    model : of `mujoco_joints`
    coordinates : (poses, coordinates) over the coordinates' ranges [rad or m]

    Returns
    -------
    model, and what was left out of each muscle whose path is another now, by muscle
    """
    fitted = _Translator(model, coordinates)
    plain = _Translator(model, coordinates, plain=True)
    moved = [movable.muscle for movable in fitted.movables]
    if not moved:
        return fitted.made, fitted.changed
    lengths = fitted.paths.evaluate(coordinates)[0][:, moved]
    weights = np.column_stack([fitted.usual(m) for m in moved])
    best = fitted_paths(fitted.made, fitted.movables, coordinates, lengths, weights)
    muscles = list(best.muscles)
    changed = dict(fitted.changed)
    off = [
        compile_paths(made).evaluate(coordinates)[0][:, moved] - lengths
        for made in (best, plain.made)
    ]
    # Poses of a sweep follow one another: their differences are those of moment arms.
    costs = [
        (weights * errors**2).sum(axis=0)
        + (weights[1:] * (SLOPES * np.diff(errors, axis=0)) ** 2).sum(axis=0)
        for errors in off
    ]
    for i, m in enumerate(moved):
        if costs[1][i] < costs[0][i]:
            muscles[m] = plain.made.muscles[m]
            changed[muscles[m].name] = plain.changed.get(
                muscles[m].name, "the shape of its surface"
            )
    names = {item.name for item in best.wrap_objects}
    surfaces = (
        *best.wrap_objects,
        *(item for item in plain.made.wrap_objects if item.name not in names),
    )
    return replace(best, muscles=tuple(muscles), wrap_objects=surfaces), changed


def _with_sides(model: Model, translator: _Translator, coordinates: Array) -> Model:
    """Choose the side sites by which lengths come nearest to the original's.

    All muscles try one direction after the other, and none, by the rules of side sites of MuJoCo 3
    and 4.
    """
    sided = [
        m
        for m, muscle in enumerate(model.muscles)
        if any(wrap.wrap_object in translator.sided for wrap in muscle.path.wraps)
    ]
    if not sided:
        return model
    coordinates = coordinates[::EVERY]
    lengths = translator.paths.evaluate(coordinates)[0][:, sided]
    weights = np.column_stack([translator.usual(m)[::EVERY] for m in sided])
    muscles = {m: model.muscles[m] for m in sided}
    least = np.full(len(sided), np.inf)
    for direction in (None, *spread_directions(DIRECTIONS)):
        turned = [_turned(model.muscles[m], translator.sided, direction) for m in sided]
        wrong = np.zeros(len(sided))
        tried = replace(model, muscles=tuple(turned))
        for version in VERSIONS:
            errors = np.abs(lengths_of_version(tried, version, coordinates) - lengths)
            wrong += (weights * np.minimum(errors, LARGEST_ERROR)).sum(axis=0)
        for i in np.flatnonzero(wrong < least):
            least[i] = wrong[i]
            muscles[sided[i]] = turned[i]
    return replace(
        model, muscles=tuple(muscles.get(m, muscle) for m, muscle in enumerate(model.muscles))
    )


def _in_agreement(model: Model, translator: _Translator, coordinates: Array) -> Model:
    """Turn side sites that a model of MuJoCo has itself, where versions differ by more than a bit.

    Only sites that change nothing by the rules that the model was read by are taken, and of these
    those by which the other version is nearest. Sites inside of a surface stay.

    Parameters
    ----------
    model : with paths of MuJoCo
    translator : that translated it
    coordinates : (poses, coordinates) [rad or m]

    Returns
    -------
    the model with other side sites
    """
    coordinates = coordinates[::EVERY]
    lengths = translator.paths.evaluate(coordinates)[0]
    off = np.array(list(_version_errors(model, coordinates, lengths).values()))
    own = off.min(axis=0) < AGREEMENT
    differing = [int(m) for m in np.flatnonzero(own & (off.max(axis=0) > AGREEMENT))]
    if not differing:
        return model
    versions = [VERSIONS[int(np.argmin(off[:, m]))] for m in differing]
    other = np.array([off[:, m].max() for m in differing])
    muscles = [model.muscles[m] for m in differing]
    wanted = lengths[:, differing]
    for number in range(max(len(muscle.path.wraps) for muscle in muscles)):
        for direction in spread_directions(DIRECTIONS):
            tried = [_beside(translator, muscle, number, direction) for muscle in muscles]
            trial = replace(model, muscles=tuple(tried))
            errors = _version_errors(trial, coordinates, wanted)
            for i, version in enumerate(versions):
                there = errors[OTHER[version]][i]
                if errors[version][i] < AGREEMENT and there < other[i]:
                    other[i] = there
                    muscles[i] = tried[i]
    found = dict(zip(differing, muscles, strict=True))
    return replace(
        model, muscles=tuple(found.get(m, muscle) for m, muscle in enumerate(model.muscles))
    )


def _version_errors(model: Model, coordinates: Array, lengths: Array) -> dict[int, Array]:
    """Return largest errors (muscles,) of lengths by the rules of each version of MuJoCo [m].

    `coordinates`: (poses, coordinates) [rad or m]; `lengths`: (poses, muscles) [m].
    """
    return {
        version: np.abs(lengths_of_version(model, version, coordinates) - lengths).max(axis=0)
        for version in VERSIONS
    }


def _beside(translator: _Translator, muscle: Muscle, number: int, direction: Array) -> Muscle:
    """Put the side site of a muscle's wrap in one direction from its surface.

    Parameters
    ----------
    number : of the wrap; a muscle that has no such wrap stays
    direction : (3,) unit vector in the body of the surface
    """
    wraps = list(muscle.path.wraps)
    wrap = wraps[number] if number < len(wraps) else None
    if not isinstance(wrap, TendonWrap) or wrap.side is None:
        return muscle
    item = translator.surfaces[wrap.wrap_object]
    if wrap.side_body == item.body:
        inside = surface_level(item, item.pose.inverse().apply(wrap.side)[None])[0] < 1.0
        if inside:
            return muscle
    distance = translator.sided.get(item.name, SIDE_DISTANCE * item.size[0])
    site = item.pose.translation + distance * direction
    wraps[number] = replace(wrap, side=site, side_body=item.body)
    return replace(muscle, path=replace(muscle.path, wraps=tuple(wraps)))


def _turned(muscle: Muscle, sided: dict[str, float], direction: Array | None) -> Muscle:
    """Put a muscle's side sites in one direction from their surfaces, or leave them out."""
    wraps: list[TendonWrap] = []
    for wrap in muscle.path.wraps:
        assert isinstance(wrap, TendonWrap)
        distance = sided.get(wrap.wrap_object)
        if distance is None or wrap.side is None:
            wraps.append(wrap)
        elif direction is None:
            wraps.append(replace(wrap, side=None, side_body=""))
        else:
            wraps.append(replace(wrap, side=wrap.side + distance * direction))
    return replace(muscle, path=replace(muscle.path, wraps=tuple(wraps)))


def lengths_of_version(model: Model, version: int, coordinates: Array) -> Array:
    """Lengths of a model's tendons by the rules of a version of MuJoCo.

    Parameters
    ----------
    model : whose paths follow MuJoCo's rules
    version : 3 for all before 4, or 4
    coordinates : (poses, coordinates) [rad or m]

    Returns
    -------
    (poses, muscles) [m]
    """
    muscles = tuple(_of_version(muscle, version) for muscle in model.muscles)
    tried = replace(model, muscles=muscles, markers=())
    return np.asarray(compile_paths(tried).evaluate(coordinates)[0])


def _of_version(muscle: Muscle, version: int) -> Muscle:
    """Put the muscle's path under the rules of a version of MuJoCo."""
    wraps = tuple(
        replace(wrap, version=version) for wrap in muscle.path.wraps if isinstance(wrap, TendonWrap)
    )
    return replace(muscle, path=replace(muscle.path, wraps=wraps))


@read_only
class _Touch:
    """Contact of a surface with a path.

    It has the fixed point behind which it is, and in each pose the node and both ends in ground.
    """

    wrap: PathWrap
    after: int
    ends: dict[int, tuple[int, Array]]


def _first_behind(wraps: Sequence[TendonWrap], after: int) -> int | None:
    """Return the index of the first surface behind a fixed point; None where there is none."""
    return next((i for i, wrap in enumerate(wraps) if wrap.after == after), None)


class _Translator:
    """Translation of the paths of a model.

    `made`: the model with MuJoCo's paths; `changed`: what was left out, by muscle; `movables`: what
    the fit may move of them, nothing where they are to be `plain`.
    """

    def __init__(self, model: Model, coordinates: Array, plain: bool = False):
        self.model = model
        self.coordinates = coordinates
        self.plain = plain
        self.objects = {item.name: item for item in model.wrap_objects}
        self.surfaces: dict[str, WrapObject] = {}
        self.changed: dict[str, str] = {}
        self.sided: dict[str, float] = {}
        self.fitted: set[str] = set()
        self.movables: list[Movable] = []
        tree = compile_tree(model)
        self.poses: Poses = forward_kinematics(tree, coordinates)
        self.bodies = tree.body_index
        self.paths = compile_paths(model)
        self.nodes = self.paths.nodes(coordinates)
        muscles = tuple(self.translated(m, muscle) for m, muscle in enumerate(model.muscles))
        made = replace(model, muscles=muscles, wrap_objects=tuple(self.surfaces.values()))
        self.made = _in_agreement(_with_sides(made, self, coordinates), self, coordinates)

    def translated(self, m: int, muscle: Muscle) -> Muscle:
        """Give a muscle MuJoCo's path."""
        if isinstance(next(iter(muscle.path.wraps), None), TendonWrap):
            for wrap in muscle.path.wraps:
                self.surfaces[wrap.wrap_object] = self.objects[wrap.wrap_object]
            return muscle
        always = [self._always(each) for each in muscle.path.points if isinstance(each, PathPoint)]
        points = [point for point in always if point is not None]
        fixed = [point for point in points if not point.coordinate]
        wraps = self._catches(muscle, points, len(fixed))
        between: dict[int, PathPoint] = {}
        first: dict[int, _Touch] = {}
        for touch in self._touches(m, muscle, points):
            number = _first_behind(wraps, touch.after)
            if number is None:
                first[touch.after] = touch
                wraps.append(self._wrap(muscle, touch))
                continue
            site = None
            if touch.after not in between:
                site = self._between(muscle, first.get(touch.after), touch)
            if site is None:
                item = touch.wrap.wrap_object
                self._note(
                    muscle, f"'{item}' in {len(touch.ends)} of {len(self.coordinates)} poses"
                )
                continue
            between[touch.after], behind = site
            # Half a segment further: behind the site that is put in.
            new = self._wrap(muscle, touch)
            pair = (wraps[number], new) if behind else (new, wraps[number])
            wraps[number : number + 1] = pair
        return self._with_sites(m, muscle, fixed, wraps, between)

    def _catches(self, muscle: Muscle, points: Sequence[PathPoint], fixed: int) -> list[TendonWrap]:
        """Return surfaces in the place of conditional points, one between two `fixed` points."""
        wraps: list[TendonWrap] = []
        for i, point in enumerate(points):
            if not point.coordinate:
                continue
            after = sum(not other.coordinate for other in points[:i]) - 1
            if any(wrap.after == after for wrap in wraps) or not 0 <= after < fixed - 1:
                self._note(muscle, f"point '{point.name}'")
            else:
                wraps.append(self._catch(muscle, point, after))
        return wraps

    def _with_sites(
        self,
        m: int,
        muscle: Muscle,
        fixed: list[PathPoint],
        wraps: list[TendonWrap],
        between: dict[int, PathPoint],
    ) -> Muscle:
        """Add sites between surfaces that share a segment, all of which the fit may move."""
        points = []
        placed = []
        moving = []
        for i, point in enumerate(fixed):
            points.append(point)
            here = [wrap for wrap in wraps if wrap.after == i]
            if i in between:
                placed += [
                    replace(here[0], after=len(points) - 1),
                    replace(here[1], after=len(points)),
                ]
                moving.append(len(points))
                points.append(between[i])
            else:
                placed += [replace(wrap, after=len(points) - 1) for wrap in here]
        spheres = tuple(wrap.wrap_object for wrap in wraps if wrap.wrap_object in self.fitted)
        if moving or spheres:
            self.movables.append(Movable(m, tuple(moving), spheres))
        return replace(muscle, path=Path(tuple(points), tuple(placed)))

    def _between(
        self, muscle: Muscle, first: _Touch | None, second: _Touch
    ) -> tuple[PathPoint, bool] | None:
        """Return a site where the path goes from one surface to another.

        The second value is whether the second surface comes behind; None for none. The site lies on
        the body of the surface that is farther along.
        """
        both = sorted(set(first.ends) & set(second.ends)) if first is not None else []
        if first is None or not both or self.plain:
            return None
        behind = sum(first.ends[frame][0] < second.ends[frame][0] for frame in both) * 2 > len(both)
        before, after = (first, second) if behind else (second, first)
        body = self.objects[after.wrap.wrap_object].body
        number = self.bodies[body]
        places = np.array(
            [0.5 * (before.ends[frame][1][1] + after.ends[frame][1][0]) for frame in both]
        )
        local = np.einsum(
            "fji,fj->fi",
            self.poses.rotations[both, number],
            places - self.poses.origins[both, number],
        )
        return PathPoint(f"{muscle.name}_between_{second.after}", body, local.mean(axis=0)), behind

    def usual(self, m: int) -> Array:
        """Return the weight of each pose (poses,).

        It falls with the distance of a muscle's coordinates from their defaults.
        """
        moving = self.paths.arm_coordinate[self.paths.arm_muscle == m]
        away = np.abs(self.coordinates[:, moving] - compile_tree(self.model).defaults[moving]).max(
            axis=1, initial=0.0
        )
        return np.asarray(np.exp(-0.5 * (away / USUAL) ** 2))

    def _note(self, muscle: Muscle, text: str) -> None:
        before = self.changed.get(muscle.name)
        self.changed[muscle.name] = f"{before}, {text}" if before else text

    def _always(self, point: PathPoint) -> PathPoint | None:
        """Return the point without its condition where that always holds.

        None where it never does.
        """
        if not point.coordinate:
            return point
        low, high = range_of(self.model.coordinate(point.coordinate))
        if point.range[0] - SLACK <= low and high <= point.range[1] + SLACK:
            return replace(point, coordinate="", range=(-np.inf, np.inf))
        return None if high < point.range[0] - SLACK or low > point.range[1] + SLACK else point

    def _active(self, point: PathPoint) -> np.ndarray:
        """(poses,) whether the path goes through a point."""
        if not point.coordinate:
            return np.ones(len(self.coordinates), np.bool_)
        values = self.coordinates[
            :, index_of("coordinate", point.coordinate, self.model.coordinate_names)
        ]
        return (values >= point.range[0] - SLACK) & (values <= point.range[1] + SLACK)

    def _catch(self, muscle: Muscle, point: PathPoint, after: int) -> TendonWrap:
        """Put a small sphere at a point; `_with_sides` finds its side site."""
        name = point.name if point.name.startswith(muscle.name) else f"{muscle.name}-{point.name}"
        pose = Transform(np.eye(3), point.location)
        self.surfaces[name] = WrapObject(
            name=name, body=point.body, kind="sphere", pose=pose, size=(CATCH_RADIUS,)
        )
        self.sided[name] = CATCH_SIDE
        return TendonWrap(wrap_object=name, after=after, side_body=point.body, side=point.location)

    def _wrap(self, muscle: Muscle, touch: _Touch) -> TendonWrap:
        """Put a surface between two points.

        Where a half of it constrains the path, `_with_sides` finds the side site.
        """
        item = self.objects[touch.wrap.wrap_object]
        kind: Literal["cylinder", "sphere"] = "cylinder" if item.kind == "cylinder" else "sphere"
        if item.kind in ("ellipsoid", "torus"):
            item = self._sphere(muscle, item, touch)
        self.surfaces[item.name] = replace(item, kind=kind, quadrant="")
        if not item.quadrant:
            return TendonWrap(item.name, touch.after)
        self.sided[item.name] = SIDE_DISTANCE * item.size[0]
        return TendonWrap(
            wrap_object=item.name,
            after=touch.after,
            side_body=item.body,
            side=item.pose.translation,
        )

    def _sphere(self, muscle: Muscle, item: WrapObject, touch: _Touch) -> WrapObject:
        """Put a sphere in the place of a surface that MuJoCo lacks.

        It is to be fitted for this muscle alone unless `plain`.
        """
        radius = float(np.mean(item.size)) if item.kind == "ellipsoid" else item.size[0]
        if self.plain:
            return replace(item, size=(radius,))
        name = f"{item.name}_{muscle.name}_{touch.after}"
        self.fitted.add(name)
        return replace(item, name=name, size=(radius,))

    def _touches(self, m: int, muscle: Muscle, points: list[PathPoint]) -> list[_Touch]:
        """Where each surface touches the path, the one with the most poses first."""
        wraps = [wrap for wrap in muscle.path.wraps if isinstance(wrap, PathWrap)]
        if not wraps:
            return []
        active = np.array([self._active(point) for point in points])
        fixed = np.array([not point.coordinate for point in points])
        touches: dict[tuple[int, int], _Touch] = {}
        nodes = self.nodes[:, m]
        for frame, n in zip(*np.nonzero(nodes[:, :, 3] > 0.0), strict=True):
            arcs = int((nodes[frame, : n + 1, 3] > 0.0).sum())
            passed = n + 1 - 2 * arcs
            last = np.flatnonzero(active[:, frame])[passed - 1]
            wrap = (
                0
                if len(wraps) == 1
                else self._nearest(wraps, frame, nodes[frame, n - 1 : n + 1, :3])
            )
            after = int(fixed[: last + 1].sum()) - 1
            touch = touches.setdefault((wrap, after), _Touch(wraps[wrap], after, {}))
            touch.ends[int(frame)] = int(n), nodes[frame, n - 1 : n + 1, :3]
        return sorted(touches.values(), key=lambda touch: -len(touch.ends))

    def _nearest(self, wraps: list[PathWrap], frame: int, ends: Array) -> int:
        """Which surface both ends of an arc lie on."""
        misses = []
        for wrap in wraps:
            item = self.objects[wrap.wrap_object]
            body = self.bodies[item.body]
            local = (ends - self.poses.origins[frame, body]) @ self.poses.rotations[frame, body]
            misses.append(
                float(np.abs(surface_level(item, item.pose.inverse().apply(local)) - 1.0).max())
            )
        return int(np.argmin(misses))

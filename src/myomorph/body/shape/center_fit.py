"""Segment scaling and pose that bring a model's joint centers to given positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
import scipy

from myomorph.body.shape.regions import HINGES, Center, Region, Standing, centers_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Coordinate, Joint, Marker, Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import DEFAULT_POSE, Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics

AXIS_LENGTH = 0.05
AXIS_WEIGHT = 0.001
"""A point beside a knee or elbow on its axis [m], and its weight against a joint center's 1: it
turns limbs.
"""
ROOT = Region("pelvis")
ROOT_WEIGHT = 1e3
"""The pelvis has a shape of its own, so that it can take its place exactly; limbs then follow from
it.
"""
# The spine keeps its default shape while the trunk is scaled: it could bend to any length
TRUNK = Region("torso")
LIMBS = ("thigh", "shank", "upper_arm", "lower_arm")
HINGED = ("shank", "lower_arm")
OFF = 2e-3  # A limb whose joint centers stay further off is searched from other angles [m]
START_INSIDE = 0.1  # Part of a coordinate's range by which the search for the pose starts inside it
# Weight of differences between a region's factors along its axes, where distances leave them open
# [m]
EVEN = 1e-4
QUARTER_SLACK = np.radians(15.0)
"""Headings of the two grounds that differ by nearly a quarter turn are taken to differ by one."""


@dataclass(frozen=True)
class LengthMatch:
    """Distance of two joint centers of a region in both models.

    Attributes
    ----------
    region : that both bound
    centers : their keys
    lower, higher : distances in the two models [m]
    """

    region: Region
    centers: tuple[str, str]
    lower: float
    higher: float


def first_frame(pose: Motion | None, model: Model) -> Motion:
    """Return the first frame of a pose, by default the model's default pose.

    Parameters
    ----------
    pose : (frames, coordinates) [rad or m]; None for the default pose
    model : for the message

    Returns
    -------
    one frame

    Raises
    ------
    BadData : the pose has no first frame of finite coordinates
    """
    if pose is None:
        return DEFAULT_POSE
    if len(pose) == 0 or not np.isfinite(pose.values[0]).all():
        raise BadData(f"the pose of model '{model.name}' has no first frame of finite coordinates")
    return Motion(pose.time[:1], pose.names, pose.values[:1])


def between_grounds(lower: Standing, higher: Standing, shared: Sequence[str]) -> Array:
    """Find the rotation between the grounds of two models.

    Gravity lies on gravity; headings that differ by nearly a quarter turn are taken to differ by
    one.

    Parameters
    ----------
    lower, higher : in their poses
    shared : keys of joint centers that both have

    Returns
    -------
    (3, 3) axes of the lower model's ground in the higher's
    """
    both = lower, higher
    ups = [_upright(standing.model.up) for standing in both]
    flat = [
        np.array([side.places[key] for key in shared]) @ up
        for side, up in zip(both, ups, strict=True)
    ]
    first_points, second_points = flat
    first = first_points[:, [0, 2]] - first_points[:, [0, 2]].mean(axis=0)
    second = second_points[:, [0, 2]] - second_points[:, [0, 2]].mean(axis=0)
    # Angle about the vertical that turns (x, z) of the lower model nearest to the higher's.
    turn = np.arctan2(
        (second[:, 0] * first[:, 1] - second[:, 1] * first[:, 0]).sum(), (first * second).sum()
    )
    quarter = 0.5 * np.pi * np.round(turn / (0.5 * np.pi))
    angle = quarter if abs(turn - quarter) < QUARTER_SLACK else turn
    c = np.cos(angle)
    s = np.sin(angle)
    about_up = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    rotation: Array = ups[1] @ about_up @ ups[0].T
    return np.where(np.abs(rotation) < 1e-15, 0.0, rotation)


def _upright(up: Array) -> Array:
    """Build a frame whose y axis points up.

    Parameters
    ----------
    up : (3,) unit vector

    Returns
    -------
    (3, 3) columns x, y, z
    """
    forward = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
    forward = forward - (forward @ up) * up
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, up, np.cross(forward, up)])


@read_only
class Cue:
    """A point on a hinge's axis beside its center.

    Attributes
    ----------
    name : key of the center and " axis"
    body : the higher model's inner body
    location : (3,) on that body [m]
    target : (3,) where it should be in ground [m]
    """

    name: str
    body: str
    location: Array
    target: Array


def hinge_cues(
    lower: Standing, higher: Standing, shared: Sequence[str], rotation: Array
) -> list[Cue]:
    """Place points that rotate thighs and upper arms about their length.

    There is one where both models have a hinge below.

    Parameters
    ----------
    lower, higher : in their poses
    shared : keys of joint centers that both have
    rotation : (3, 3) from the lower model's ground axes to the higher's

    Returns
    -------
    one for each knee and elbow whose axes are within 60 degrees
    """
    result = []
    for key in shared:
        if lower.centers[key].name not in HINGES:
            continue
        axis = lower.hinge_axis(key)
        current = higher.hinge_axis(key)
        if axis is None or current is None:
            continue
        wanted = rotation @ axis
        if abs(wanted @ current) < 0.5:
            continue
        joint = higher.centers[key].joint
        local = higher.frames[joint.parent][:3, :3].T @ current
        location = joint.parent_frame.translation + AXIS_LENGTH * np.sign(wanted @ current) * local
        result.append(
            Cue(
                name=f"{key} axis",
                body=joint.parent,
                location=location,
                target=rotation @ lower.places[key] + AXIS_LENGTH * wanted,
            )
        )
    return result


def _started(
    coordinate: Coordinate, joint: Joint | None, regions: Mapping[str, Region]
) -> Coordinate:
    """Choose how the search for the pose starts with a coordinate.

    Limbs are a little bent, where no joint is singular. The ranges of limbs do not hold in the
    search: straight knees of two models differ by a degree.
    """
    if joint is None or coordinate.locked:
        return coordinate
    inner = regions.get(joint.parent)
    outer = regions[joint.child]
    if inner == outer == TRUNK:
        return replace(coordinate, locked=True)
    low, high = coordinate.range
    if (
        outer.name not in LIMBS
        or (inner == outer and outer.name in HINGED)
        or not np.isfinite(high - low)
    ):
        return coordinate
    if coordinate.motion != "rotational":
        return replace(coordinate, clamped=False)
    edge = START_INSIDE * (high - low)
    return replace(
        coordinate,
        clamped=False,
        default=float(np.clip(coordinate.default, low + edge, high - edge)),
    )


class CenterFit:
    """Factors and a pose of the higher model that bring its joint centers to the lower's.

    Attributes
    ----------
    targets : name to (3,) joint center of the lower model, in the higher model's ground [m]
    pairs : (region, center, center) whose distances the factors of the region set
    free : regions with factors of their own: one, or three where three centers or more bound the
        region
    """

    def __init__(
        self,
        model: Model,
        regions: Mapping[str, Region],
        centers: Mapping[str, Center],
        targets: Mapping[str, Array],
        cues: Sequence[Cue],
    ):
        self._model = model
        self._regions = regions
        self._centers = centers
        self.targets = targets
        self._cues = cues
        joint_of = {name: joint for joint in model.joints for name in joint.coordinates}
        self._started = tuple(
            _started(coordinate, joint_of.get(coordinate.name), regions)
            for coordinate in model.coordinates
        )
        bounds = grouped(
            (region, key)
            for key, center in centers.items()
            for region in dict.fromkeys((center.inner, center.outer))
        )
        self.pairs = [
            (region, a, b) for region, keys in bounds.items() for a, b in combinations(keys, 2)
        ]
        self.free = {
            region: 3 if len(keys) > 2 else 1 for region, keys in bounds.items() if len(keys) > 1
        }
        if not self.free:
            raise BadData(
                f"no region of model '{model.name}' lies between two joint centers that both models"
                " have"
            )

    def solve(self, rounds: int, tolerance: float) -> tuple[dict[str, Array], Motion]:
        """Scale and pose in turn until no center moves further than the tolerance.

        Parameters
        ----------
        rounds : at most so many
        tolerance : change of a center's distance from the lower model's [m]

        Returns
        -------
        (3,) factors of every body, and the pose
        """
        pose = DEFAULT_POSE
        logs = np.zeros(sum(self.free.values()))
        before: dict[str, float] = {}
        for _ in range(rounds):
            logs = self._scale_segments(logs, pose)
            model = scale(self._model, self.factors(logs))
            pose = self._pose(model)
            places = self._places(model, pose)
            errors = {
                key: float(np.linalg.norm(places[key] - target))
                for key, target in self.targets.items()
            }
            if max(abs(errors[key] - before.get(key, np.inf)) for key in errors) < tolerance:
                break
            before = errors
        return self.factors(logs), pose

    def _places(self, model: Model, pose: Motion) -> dict[str, Array]:
        return Standing(model, pose, self._regions).places

    def factors(self, logs: Array) -> dict[str, Array]:
        """Compute factors of every body from those of the free regions.

        Parameters
        ----------
        logs : (unknowns,) log factors of the free regions

        Returns
        -------
        (3,) by body
        """
        of_region: dict[Region, Array] = {}
        start = 0
        for region, count in self.free.items():
            of_region[region] = np.exp(np.broadcast_to(logs[start : start + count], (3,)))
            start += count
        mean = float(np.exp(np.mean(logs)))
        return {body: self._of(region, of_region, mean) for body, region in self._regions.items()}

    def _of(self, region: Region, of_region: Mapping[Region, Array], mean: float) -> Array:
        if region in of_region:
            return np.array(of_region[region])
        above = region.parent
        while above is not None and above not in of_region:
            above = above.parent
        return np.full(
            3, mean if above is None else float(np.prod(of_region[above])) ** (1.0 / 3.0)
        )

    def _scale_segments(self, logs: Array, pose: Motion) -> Array:
        """Find factors with which distances within regions become the lower model's, in a pose.

        Parameters
        ----------
        logs : (unknowns,) to begin with

        Returns
        -------
        (unknowns,) log factors of the free regions
        """
        wanted = {
            pair: float(np.linalg.norm(self.targets[pair[1]] - self.targets[pair[2]]))
            for pair in self.pairs
        }

        def residuals(x: Array) -> Array:
            model = scale(self._model, self.factors(x))
            places = self._places(model, pose)
            rows = [
                np.linalg.norm(places[a] - places[b]) - wanted[region, a, b]
                for region, a, b in self.pairs
            ]
            start = 0
            for count in self.free.values():
                part = x[start : start + count]
                rows += list(EVEN * (part - part.mean()))
                start += count
            return np.array(rows)

        return np.array(
            scipy.optimize.least_squares(
                residuals, logs, method="lm", xtol=1e-7, ftol=1e-9, gtol=1e-12
            ).x
        )

    def _pose(self, model: Model) -> Motion:
        """Find the pose in which the joint centers lie nearest to the lower model's.

        The angles of a shoulder or hip have poles and two branches, so a limb that stays off is
        tried from other angles; the next rounds start from those that were found.
        """
        best = self._posed(model, self._started)
        for region in dict.fromkeys(self._regions.values()):
            ball = self._ball(model, region)
            below = [key for key, center in self._centers.items() if center.inner == region]
            if not ball or not below or self._off(model, best, below) < OFF:
                continue
            for shares in product((0.25, 0.75), repeat=len(ball)):
                ends = zip(ball.items(), shares, strict=True)
                at = {name: low + share * (high - low) for (name, (low, high)), share in ends}
                other = self._posed(model, self._starts(at))
                if self._off(model, other, below) < 0.9 * self._off(model, best, below):
                    best = other
                    self._started = self._starts({name: float(best[name][0]) for name in ball})
        return best

    def _starts(self, defaults: Mapping[str, float]) -> tuple[Coordinate, ...]:
        """Return the coordinates that the search starts with, some of them from other values."""
        return tuple(
            replace(coordinate, default=defaults.get(coordinate.name, coordinate.default))
            for coordinate in self._started
        )

    def _ball(self, model: Model, region: Region) -> dict[str, tuple[float, float]]:
        """Return the two or three rotations of a thigh or an upper arm, with their ranges.

        Empty where there are more or fewer.
        """
        if region.name not in ("thigh", "upper_arm"):
            return {}
        names = {
            name
            for joint in model.joints
            if self._regions[joint.child] == region
            for name in joint.coordinates
        }
        moved = {
            coordinate.name: coordinate.range
            for coordinate in model.coordinates
            if coordinate.name in names
            and coordinate.name not in model.dependent_coordinates
            and np.isfinite(np.ptp(coordinate.range))
            and coordinate.motion == "rotational"
        }
        return moved if 2 <= len(moved) <= 3 else {}

    def _off(self, model: Model, pose: Motion, keys: Sequence[str]) -> float:
        """Compute the largest distance of some centers from the lower model's [m]."""
        places = self._places(model, pose)
        return max(float(np.linalg.norm(places[key] - self.targets[key])) for key in keys)

    def _posed(self, model: Model, coordinates: tuple[Coordinate, ...]) -> Motion:
        """Run inverse kinematics of the joint centers from the defaults of coordinates."""
        centers = centers_of(model, self._regions)
        virtual = [
            Marker(key, centers[key].joint.child, centers[key].location) for key in self.targets
        ]
        scaled = {joint.child: joint.parent_frame.translation for joint in model.joints}
        origins = {joint.child: joint.parent_frame.translation for joint in self._model.joints}
        points = list(self.targets.values())
        weights = {}
        for key in self.targets:
            weights[key] = ROOT_WEIGHT if ROOT in (centers[key].inner, centers[key].outer) else 1.0
        for cue in self._cues:
            child = self._centers[cue.name.removesuffix(" axis")].joint.child
            virtual.append(
                Marker(cue.name, cue.body, scaled[child] + cue.location - origins[child])
            )
            points.append(cue.target)
            weights[cue.name] = AXIS_WEIGHT
        names = tuple(marker.name for marker in virtual)
        seen = Markers(np.zeros(1), names, np.array(points)[None])
        options = InverseKinematicsOptions(
            marker_weights=weights, tolerance=1e-9, iterations=500, posture_weight=1e-11
        )
        held = replace(model, markers=tuple(virtual), coordinates=coordinates)
        return inverse_kinematics(held, seen, options).motion

    def shifts(
        self, higher: Model, factors: Mapping[str, Array], pose: Motion
    ) -> tuple[dict[str, float], Model]:
        """Move each joint in its inner body so that its center coincides.

        Parameters
        ----------
        higher : the model before scaling
        factors : body to (3,)
        pose : that was found

        Returns
        -------
        distance that each center is moved [m], and the model before scaling with its joints moved
        """
        model = higher
        distances = {}
        order = sorted(
            self._centers.values(), key=lambda center: higher.body_names.index(center.joint.child)
        )
        for center in order:
            larger = Standing(
                scale(replace(self._model, joints=model.joints), factors), pose, self._regions
            )
            missing = self.targets[center.key] - larger.places[center.key]
            local = larger.frames[center.joint.parent][:3, :3].T @ missing
            distances[center.key] = float(np.linalg.norm(missing))
            model = replace(
                model, joints=tuple(_moved(joint, center, local, factors) for joint in model.joints)
            )
        return distances, model

    def lengths(self, places: Mapping[str, Array]) -> tuple[LengthMatch, ...]:
        """List distances of all pairs.

        Parameters
        ----------
        places : key of the center to (3,) in ground [m]

        Returns
        -------
        distances in the lower model and at these positions
        """
        return tuple(
            LengthMatch(
                region=region,
                centers=(a, b),
                lower=float(np.linalg.norm(self.targets[a] - self.targets[b])),
                higher=float(np.linalg.norm(places[a] - places[b])),
            )
            for region, a, b in self.pairs
        )


def _moved(joint: Joint, center: Center, by: Array, factors: Mapping[str, Array]) -> Joint:
    """Move a joint of the model before scaling, so that after scaling it has moved by a vector.

    Parameters
    ----------
    by : (3,) in the inner body, after scaling [m]
    factors : body to (3,)
    """
    if joint.child != center.joint.child:
        return joint
    frame = joint.parent_frame
    moved = Transform(frame.rotation, frame.translation + by / factors[joint.parent])
    return replace(joint, parent_frame=moved)

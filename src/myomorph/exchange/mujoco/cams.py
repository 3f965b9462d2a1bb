"""Cams: a coordinate of a MuJoCo model follows another by a spline.

No polynomial of degree four can do so. A cam is a weighted sum of distances between sites that
stays constant, held by MuJoCo's equality of two tendons with pulleys. One distance measures the
follower; the others are multiquadrics of the leader, sqrt(e^2 + (q - q_k)^2) near the centers q_k,
as a site of the leader's body passes sites of its parent at a distance e. Their weights are fitted
to values and slopes over the leader's range. A cam adds neither bodies nor degrees of freedom.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from myomorph.core.io.mjcf.couplings import Branch, Cam
from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import PiecewisePolynomial
from myomorph.core.model.model import Coupler, Joint, Model
from myomorph.exchange.mujoco.joints import range_of

CENTERS = 24
RADIUS = 0.1  # Of the circle on which a hinge's site passes its centers [m].
REACH = 1.0  # Length of the distance that measures the follower [m].
LEVER = 0.2  # From a follower's hinge to the site that measures it [m].
MIN_SEPARATION = 0.3  # Of centers, over their even distance.
SAMPLES = 300
SLOPE_WEIGHT = 0.3
STEP = 1e-5
SMALLEST_SINGULAR = 3e-6
SMALLEST_WEIGHT = 1e-7
DEGREE = 4  # Of the polynomials of MuJoCo's equality of two joints.


def is_degree_four(coupler: Coupler, model: Model) -> bool:
    """Whether MuJoCo's equality of two joints holds a coupler as it is."""
    function = coupler.function
    on_joints = {name for joint in model.joints for name in joint.coordinates}
    return (
        isinstance(function, PiecewisePolynomial)
        and len(function.breaks) == 1
        and function.coefficients.shape[1] <= DEGREE + 1
        and {coupler.dependent, coupler.independents[0]} <= on_joints
    )


def cams_of(model: Model) -> tuple[tuple[Cam, ...], tuple[Coupler, ...]]:
    """Return cams of the couplers of a model of `mujoco_joints` that need one.

    Where the joints forbid a cam, the coupler's polynomial is returned.
    """
    joints = {name: joint for joint in model.joints for name in joint.coordinates}
    cams = []
    polynomials = []
    for coupler in model.couplers:
        if coupler.dependent not in joints or is_degree_four(coupler, model):
            continue
        curve = _Curve(model, coupler, joints)
        if curve.alone:
            cams.append(curve.cam())
        else:
            polynomials.append(curve.polynomial())
    return tuple(cams), tuple(polynomials)


class _Curve:
    """A follower and all that moves with it, as functions of its leader."""

    def __init__(self, model: Model, coupler: Coupler, joints: dict[str, Joint]):
        self.model = model
        self.coupler = coupler
        leader = coupler.independents[0]
        while leader in model.dependent_coordinates:
            leader = model.dependent_coordinates[leader].independents[0]
        self.leader = model.coordinate(leader)
        self.follower = joints[coupler.dependent]
        self.joint = joints[leader]
        self.low, high = range_of(self.leader)
        self.high = max(high, self.low + 1e-3)

    def values(self, x: Array) -> dict[str, Array]:
        """Return the leader and all that follow it alone, at values x of it."""
        result = {self.leader.name: x}
        waiting = list(self.model.couplers)
        while ready := [coupler for coupler in waiting if set(coupler.independents) <= set(result)]:
            for coupler in ready:
                function: Any = coupler.function
                result[coupler.dependent] = function(
                    *(result[name] for name in coupler.independents)
                )
            waiting = [coupler for coupler in waiting if coupler not in ready]
        return result

    @property
    def alone(self) -> bool:
        """Whether only the leader moves both joints."""
        return {*self.follower.coordinates, *self.joint.coordinates} <= set(
            self.values(np.zeros(1))
        )

    def _poses(self, joint: Joint, x: Array) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and origins (n, 3) of a joint's child in its parent."""
        values = self.values(x)
        poses = []
        for i in range(len(x)):
            pose = joint.parent_frame
            for axis in joint.axes:
                pose = pose @ axis.moved(float(axis.function(values[axis.coordinates[0]][i])))
            poses.append(pose)
        return np.array([pose.rotation for pose in poses]), np.array(
            [pose.translation for pose in poses]
        )

    def polynomial(self) -> Coupler:
        """Fit the coupler by a polynomial of degree four about the leader's default."""
        x = np.append(np.linspace(self.low, self.high, SAMPLES), self.leader.default)
        y = self.values(x)[self.coupler.dependent]
        powers = (x[:-1, None] - x[-1]) ** np.arange(1, DEGREE + 1)
        coefficients = np.linalg.lstsq(powers, y[:-1] - y[-1], rcond=None)[0]
        function = PiecewisePolynomial(x[-1:], np.array([[y[-1], *coefficients]]))
        return Coupler(
            name=self.coupler.name,
            dependent=self.coupler.dependent,
            function=function,
            independents=(self.leader.name,),
        )

    def cam(self) -> Cam:
        """Return the cam that holds the follower to the leader."""
        inside = np.linspace(self.low + 2.0 * STEP, self.high - 2.0 * STEP, SAMPLES)
        x = np.append(inside, self.leader.default)
        branches = [self._measure(), *self._centers()]
        lengths = self._lengths(branches, x + 0.0)
        more = self._lengths(branches, x + STEP)
        less = self._lengths(branches, x + (-STEP))
        inside = lengths[:-1]
        slopes = SLOPE_WEIGHT * (more - less)[:-1] / (2.0 * STEP)
        constant = np.concatenate([np.ones(len(inside)), np.zeros(len(inside))])
        matrix = np.column_stack([np.concatenate([inside[:, 1:], slopes[:, 1:]]), constant])
        right = np.concatenate([inside[:, 0], slopes[:, 0]])
        solution = np.linalg.lstsq(matrix, right, rcond=SMALLEST_SINGULAR)[0]
        weights = np.append(1.0, -solution[:-1])
        weights[np.abs(weights) < SMALLEST_WEIGHT] = 0.0
        offset = solution[-1] - lengths[-1] @ weights
        used = [
            replace(branch, weight=float(w))
            for branch, w in zip(branches, weights, strict=True)
            if w
        ]
        return Cam(self.coupler.dependent, float(offset), tuple(used))

    def _lengths(self, branches: list[Branch], x: Array) -> Array:
        """Return lengths (poses, branches) [m].

        The first measures the follower, the others move with the leader's body.
        """
        joints = [self.follower, *[self.joint] * (len(branches) - 1)]
        poses = {joint.name: self._poses(joint, x) for joint in (self.follower, self.joint)}
        columns = []
        for joint, branch in zip(joints, branches, strict=True):
            rotations, origins = poses[joint.name]
            columns.append(
                np.linalg.norm(rotations @ branch.place_2 + origins - branch.place_1, axis=1)
            )
        return np.column_stack(columns)

    def _measure(self) -> Branch:
        """Return the distance that measures the follower.

        It goes to a site that the leader's hinge leaves in place where it can.
        """
        axis = next(
            axis for axis in self.follower.axes if axis.coordinates == (self.coupler.dependent,)
        )
        lead = next(axis for axis in self.joint.axes if axis.coordinates == (self.leader.name,))
        same = self.follower is self.joint and lead.kind == "rotation"
        place = lead.origin if same else axis.origin
        direction = axis.vector
        if axis.kind == "rotation":
            lever = lead.vector if same else _across(axis.vector)[0]
            place = place + LEVER * lever
            direction = np.cross(axis.vector, place - axis.origin)
            direction = direction / np.linalg.norm(direction)
        if axis.kind == "rotation" and not same:
            # A distance turns back a quarter turn from where it changes most: in the middle.
            rotations, origins = self._poses(self.follower, np.array([self._middle()]))
            far = rotations[0] @ (place - REACH * direction) + origins[0]
        else:
            far = self.follower.parent_frame.apply(place - REACH * direction)
        return Branch(
            weight=1.0,
            body_1=self.follower.parent,
            place_1=far,
            body_2=self.follower.child,
            place_2=place,
        )

    def _middle(self) -> float:
        """Value of the leader at which the follower is in the middle of its range [rad or m]."""
        x = np.linspace(self.low, self.high, SAMPLES)
        y = self.values(x)[self.coupler.dependent]
        return float(x[int(np.argmin(np.abs(y - 0.5 * (y.min() + y.max()))))])

    def _centers(self) -> list[Branch]:
        """Distances to sites that those of the leader's body pass, one center after the other."""
        axis = next(axis for axis in self.joint.axes if axis.coordinates == (self.leader.name,))
        centers = self._spread()
        rotations, origins = self._poses(self.joint, centers)
        across = _across(axis.vector)
        places = [axis.origin]
        aside = across[0]
        if axis.kind == "rotation":
            places = [axis.origin + RADIUS * direction for direction in across]
            aside = RADIUS * axis.vector
        asides = np.gradient(centers)[:, None] * (self.joint.parent_frame.rotation @ aside)
        return [
            Branch(
                weight=0.0,
                body_1=self.joint.parent,
                place_1=rotation @ place + origin + aside,
                body_2=self.joint.child,
                place_2=place,
            )
            for place in places
            for rotation, origin, aside in zip(rotations, origins, asides, strict=True)
        ]

    def _spread(self) -> Array:
        """Centers over the leader's range: evenly spaced, and where the curve's pieces meet."""
        margin = (self.high - self.low) / CENTERS
        centers = np.linspace(self.low - margin, self.high + margin, CENTERS)
        function = self.coupler.function
        if isinstance(function, PiecewisePolynomial):
            breaks = function.breaks
            near = np.concatenate([breaks, 0.5 * (breaks[1:] + breaks[:-1])])
            centers = np.sort(np.append(centers, near[(near > self.low) & (near < self.high)]))
            apart = np.append(True, np.diff(centers) > MIN_SEPARATION * margin)
            centers = centers[apart]
        return centers


def _across(vector: Array) -> Array:
    """(2, 3) unit vectors across a unit vector."""
    return np.asarray(np.linalg.svd(vector[None])[2][1:])

"""Millard's classes: their curves and OpenSim's fibers.

The curves are chains of quintic Bezier corners (Millard, Uchida, Seth and Delp 2013).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import Curve, Piece
from myomorph.core.muscles.fiber_equations import (
    BUCKLED,
    FIBER_LENGTH,
    FiberLengthSearch,
    FiberMuscle,
)
from myomorph.core.muscles.muscle_model import FiberCurves, MuscleModel, StaticOptimization

UNDAMPED = 0.001  # Fiber damping below which there is none
TENDON_STRAIN = 0.049  # At the maximum isometric force, where a muscle has none of its own
BISECTIONS = 64  # Halvings of the bracket of a fiber velocity: to rounding

# Power basis of the quintic Bernstein polynomials: coefficients = POWER @ control points.
_POWER = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.0, 5.0, 0.0, 0.0, 0.0, 0.0],
        [10.0, -20.0, 10.0, 0.0, 0.0, 0.0],
        [-10.0, 30.0, -30.0, 10.0, 0.0, 0.0],
        [5.0, -20.0, 30.0, -20.0, 5.0, 0.0],
        [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0],
    ]
)
_ACTIVE = {
    "min_norm_active_fiber_length": 0.4441,
    "transition_norm_fiber_length": 0.73,
    "max_norm_active_fiber_length": 1.8123,
    "shallow_ascending_slope": 0.8616,
    "minimum_value": 0.1,
}
_VELOCITY = {
    "concentric_slope_at_vmax": 0.0,
    "concentric_slope_near_vmax": 0.25,
    "isometric_slope": 5.0,
    "eccentric_slope_at_vmax": 0.0,
    "eccentric_slope_near_vmax": 0.15,
    "max_eccentric_velocity_force_multiplier": 1.4,
    "concentric_curviness": 0.6,
    "eccentric_curviness": 0.9,
}
_PASSIVE = {"strain_at_zero_force": 0.0, "strain_at_one_norm_force": 0.7}
_PASSIVE_SHAPE = ("stiffness_at_low_force", "stiffness_at_one_norm_force", "curviness")
_TENDON = (
    "strain_at_one_norm_force",
    "stiffness_at_one_norm_force",
    "norm_force_at_toe_end",
    "curviness",
)


class Millard2012Acceleration(MuscleModel):
    """Millard2012AccelerationMuscle on a rigid tendon; its fibers may turn until upright."""

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Millard's curves, the active one from 0."""
        active = _values(muscle, "ActiveForceLengthCurve", _ACTIVE | {"minimum_value": 0.0})
        velocity = _speeds(muscle)
        return FiberCurves(
            active=active_force_length(*active.values()),
            velocity=_not_pushing(*velocity.values()),
            passive=_passive(muscle),
        )

    def greatest_pennation(self, muscle: Muscle) -> float:
        """Greatest pennation: upright [rad]."""
        return np.pi / 2


class Millard2012(FiberMuscle):
    """Millard2012EquilibriumMuscle: damped fibers, whose equilibrium OpenSim seeks at rest."""

    times = (0.010, 0.040)
    damping = 0.1
    undamped = UNDAMPED
    elastic = True
    passive_strain = ("FiberForceLengthCurve/strain_at_one_norm_force", 0.7)
    static_optimization = StaticOptimization(pennation_by=1.0)
    state = FIBER_LENGTH
    rests_when_stuck = True

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Millard's curves, which the class changes by whether an equilibrium can be singular."""
        active, velocity = self._shapes(muscle)
        return FiberCurves(
            active=active_force_length(*active),
            velocity=_not_pushing(*velocity),
            passive=_passive(muscle),
        )

    def smooth_curves(self, muscle: Muscle) -> FiberCurves:
        """Curves with f_V continued by its line beyond the maximum velocity."""
        active, velocity = self._shapes(muscle)
        return FiberCurves(
            active=active_force_length(*active),
            velocity=force_velocity(*velocity),
            passive=_passive(muscle),
        )

    def _shapes(self, muscle: Muscle) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Parameters of f_L and f_V.

        With an elastic tendon and no damping neither curve may reach zero; else both do.
        """
        singular = self._singular(muscle)
        active = _values(muscle, "ActiveForceLengthCurve", _ACTIVE)
        velocity = _speeds(muscle)
        active["minimum_value"] = max(active["minimum_value"], 0.1) if singular else 0.0
        for side in ("concentric", "eccentric"):
            near = 0.5 * velocity[f"{side}_slope_near_vmax"]
            at = f"{side}_slope_at_vmax"
            velocity[at] = max(velocity[at], near) if singular else 0.0
        return tuple(active.values()), tuple(velocity.values())

    def _singular(self, muscle: Muscle) -> bool:
        """Whether an equilibrium can be singular: an elastic tendon on fibers without damping."""
        rigid = bool(muscle.parameters.get("ignore_tendon_compliance", 0.0))
        return not rigid and self.fiber_damping(muscle) < UNDAMPED

    def tendon(self, muscle: Muscle) -> Curve:
        """Tendon curve: a toe and a straight line."""
        values = [muscle.parameters.get(f"TendonForceLengthCurve/{name}") for name in _TENDON]
        strain = TENDON_STRAIN if values[0] is None else values[0]
        return tendon_force_length(strain, *_complete(values[1:]))

    def stretch(self, muscle: Muscle) -> Curve:
        """Tendon length over force, the inverse of the tendon's curve."""
        return _inverse(self.tendon(muscle))

    def greatest_pennation(self, muscle: Muscle) -> float:
        """Greatest pennation, the parameter `maximum_pennation_angle` [rad]."""
        return muscle.parameters.get("maximum_pennation_angle", float(np.arccos(0.1)))

    def stretched_passive(self, parameters: dict[str, float], factor: float) -> dict[str, float]:
        """Scale all strains of the passive curve by a factor, and its stiffnesses by the inverse.

        Parameters
        ----------
        parameters : of the muscle, changed in place
        factor : of the strains
        """
        parameters = super().stretched_passive(parameters, factor)
        changes = {"strain_at_zero_force": factor} | dict.fromkeys(_PASSIVE_SHAPE[:2], 1.0 / factor)
        for name, change in changes.items():
            for key in (f"FiberForceLengthCurve/{name}", name):
                if key in parameters:
                    parameters[key] *= change
        return parameters

    def least_activation(self, muscle: Muscle) -> float:
        """Least activation, `minimum_activation` where an equilibrium can be singular, else 0."""
        return muscle.parameters.get("minimum_activation", 0.01) if self._singular(muscle) else 0.0

    def shortest_fiber(self, muscle: Muscle) -> float:
        """Length at which the active force-length curve begins [m]."""
        start = _values(muscle, "ActiveForceLengthCurve", _ACTIVE)["min_norm_active_fiber_length"]
        return max(self.sizes(muscle).shortest, BUCKLED, start * muscle.optimal_fiber_length)

    def first_state(self, muscle: Muscle, name: str) -> float:
        """Value of a state where no file has it; no fiber is shorter than its least length."""
        state = super().first_state(muscle, name)
        return max(state, self.shortest_fiber(muscle)) if name == FIBER_LENGTH else state

    def balancing_velocity(
        self, muscle: Muscle, a: Array, active: Array, passive: Array, pull: Array
    ) -> tuple[Array, Array]:
        """Find the fiber velocity in balance.

        By bisection with damping, else by the inverse of the force-velocity curve.

        Parameters
        ----------
        muscle : of the class
        a, active, passive : (frames,) activation, f_L and f_PE
        pull : (frames,) normalized tendon force, along the fibers

        Returns
        -------
        v : (frames,) normalized fiber velocity
        f_V : (frames,) there
        """
        rest = pull - passive
        curve = self.curves(muscle).velocity
        if self._singular(muscle):
            f_v = rest / (a * active)
            return _inverse_velocity(*_speeds(muscle).values())(f_v), f_v
        damping = self.fiber_damping(muscle)
        low = (rest - a * active * float(curve(1e6))) / damping
        high = rest / damping
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            above = a * active * curve(middle) + damping * middle > rest
            low = np.where(above, low, middle)
            high = np.where(above, middle, high)
        v = 0.5 * (low + high)
        return v, curve(v)

    def equilibrium(self, muscle: Muscle, length: Array, speed: Array, activation: Array) -> Array:
        """Find the fiber length at which the fiber is at rest.

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        activation : (frames,)

        Returns
        -------
        (frames,) [m], NaN where there is none
        """
        return FiberLengthSearch(
            model=self, muscle=muscle, length=length, speed=speed, activation=activation
        ).solve()


def _values(muscle: Muscle, curve: str, properties: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a curve by name.

    The curve's class and a slash before a name tell apart names that two curves share.

    Parameters
    ----------
    curve : its class
    properties : names with their defaults
    """
    known = muscle.parameters
    return {
        name: float(known.get(f"{curve}/{name}", known.get(name, default)))
        for name, default in properties.items()
    }


def _speeds(muscle: Muscle) -> dict[str, float]:
    """Parameters of the force-velocity curve by name."""
    return _values(muscle, "ForceVelocityCurve", _VELOCITY)


def _passive(muscle: Muscle) -> Curve:
    """Passive force-length curve of a muscle."""
    curve = "FiberForceLengthCurve"
    known = muscle.parameters
    shape = [known.get(f"{curve}/{name}", known.get(name)) for name in _PASSIVE_SHAPE]
    strains = _values(muscle, curve, _PASSIVE).values()
    return passive_force_length(*strains, *_complete(shape))


def _complete(values: Sequence[float | None]) -> tuple[float, ...]:
    """Values that count only together: none of them where one is missing, as in OpenSim."""
    present = tuple(float(value) for value in values if value is not None)
    return present if len(present) == len(values) else ()


@lru_cache(maxsize=256)
def _not_pushing(*velocity: float) -> Curve:
    """Force-velocity curve, not below 0."""
    return force_velocity(*velocity).within(0.0)


@lru_cache(maxsize=64)
def _inverse(tendon: Curve) -> Curve:
    """Inverse of a tendon's curve, made once."""
    return tendon.inverse()


@lru_cache(maxsize=64)
def _inverse_velocity(*velocity: float) -> Curve:
    """Invert the force-velocity curve of an undamped muscle.

    At the ends its slopes are half of those near them.
    """
    shape = dict(zip(_VELOCITY, velocity, strict=True))
    for side in ("concentric", "eccentric"):
        shape[f"{side}_slope_at_vmax"] = 0.5 * shape[f"{side}_slope_near_vmax"]
    return force_velocity(*shape.values()).inverse()


def bezier_corner(
    start: tuple[float, float, float], end: tuple[float, float, float], curviness: float
) -> list[tuple[float, ...]]:
    """Make a C-shaped quintic Bezier curve from one point and slope to another.

    The two middle pairs of control points lie on the tangents, the fraction `curviness` of the way
    to where these meet.

    Source: Millard, Uchida, Seth and Delp 2013.

    Parameters
    ----------
    start, end : (x, y, dy/dx)
    curviness : 0 straight ... 1 sharp; Millard's parameter after scaling to 0.1 ... 0.9

    Returns
    -------
    power coefficients of x and of y

    Raises
    ------
    BadModel : the tangents do not meet between the points
    """
    x0, y0, s0 = start
    x1, y1, s1 = end
    if abs(s0 - s1) > np.sqrt(np.finfo(float).eps):
        x = (y1 - y0 - x1 * s1 + x0 * s0) / (s0 - s1)
    else:
        x = 0.5 * (x0 + x1)
    y = (x - x1) * s1 + y1
    distance = (x1 - x0) ** 2 + (y1 - y0) ** 2
    if not max((x - x0) ** 2 + (y - y0) ** 2, (x - x1) ** 2 + (y - y1) ** 2) < distance:
        raise BadModel(
            f"a muscle curve from ({x0:g}, {y0:g}) of slope {s0:g} to ({x1:g}, {y1:g}) of slope"
            f" {s1:g} has no C-shaped corner: check the parameters of the curve"
        )
    ax = x0 + curviness * (x - x0)
    ay = y0 + curviness * (y - y0)
    bx = x1 + curviness * (x - x1)
    by = y1 + curviness * (y - y1)
    return [
        tuple((_POWER @ points).tolist())
        for points in ([x0, ax, ax, bx, bx, x1], [y0, ay, ay, by, by, y1])
    ]


def _chain(points: Sequence[tuple[float, float, float]], curviness: Sequence[float]) -> Curve:
    """Make a curve of corners through (x, y, slope) points, each of a curviness of 0 ... 1."""
    pieces = []
    for start, stop, bend in zip(points[:-1], points[1:], curviness, strict=True):
        x, y = bezier_corner(start, stop, 0.1 + 0.8 * bend)
        pieces.append(Piece(x[0], y, x))
    return Curve(tuple(pieces), sum(pieces[-1].x), (points[0][2], points[-1][2]))


@lru_cache(maxsize=256)
def active_force_length(
    minimum: float = 0.4441,
    transition: float = 0.73,
    maximum: float = 1.8123,
    shallow_slope: float = 0.8616,
    minimum_value: float = 0.1,
) -> Curve:
    """Millard's active force-length curve over the normalized fiber length, 1 at 1.

    Parameters
    ----------
    minimum, transition, maximum : normalized lengths where it begins, turns to the shallow
        ascending limb, and ends
    shallow_slope : of the shallow ascending limb
    minimum_value : its value outside (0 for a rigid tendon; OpenSim's default is 0.1)
    """
    half_plateau = 0.05
    shoulder = 1.0 - half_plateau
    y_transition = 1.0 - shallow_slope * (shoulder - transition)
    ascending = (
        0.5 * (minimum + transition),
        0.5 * y_transition,
        1.25 * y_transition / (transition - minimum),
    )
    shallow = (0.5 * (transition + shoulder), 0.5 * (1.0 + y_transition), shallow_slope)
    descending = (
        0.5 * (1.0 + half_plateau + maximum),
        0.5,
        -1.0 / ((maximum - half_plateau) - (1.0 + half_plateau)),
    )
    points = [
        (minimum, minimum_value, 0.0),
        ascending,
        shallow,
        (1.0, 1.0, 0.0),
        descending,
        (maximum, minimum_value, 0.0),
    ]
    return _chain(points, [1.0] * 5)


@lru_cache(maxsize=256)
def force_velocity(  # page: the parameters of OpenSim's curve, in its order
    concentric_slope_at_vmax: float = 0.0,
    concentric_slope_near_vmax: float = 0.25,
    isometric_slope: float = 5.0,
    eccentric_slope_at_vmax: float = 0.0,
    eccentric_slope_near_vmax: float = 0.15,
    maximum: float = 1.4,
    concentric_curviness: float = 0.6,
    eccentric_curviness: float = 0.9,
) -> Curve:
    """Millard's force-velocity curve over the normalized fiber velocity.

    It is 0 at -1, 1 at 0 and `maximum` at 1. The parameters are those of OpenSim's
    `ForceVelocityCurve`.

    Parameters
    ----------
    concentric_slope_at_vmax, concentric_slope_near_vmax : slopes at -1 and at -0.9
    isometric_slope : slope at 0
    eccentric_slope_at_vmax, eccentric_slope_near_vmax : slopes at 1 and at 0.9
    maximum : value at 1
    concentric_curviness, eccentric_curviness : of the corners below and above 0
    """
    near = 0.1
    concentric = 0.5 * near * (concentric_slope_near_vmax + concentric_slope_at_vmax)
    eccentric = maximum - 0.5 * near * (eccentric_slope_near_vmax + eccentric_slope_at_vmax)
    points = [
        (-1.0, 0.0, concentric_slope_at_vmax),
        (-1.0 + near, concentric, concentric_slope_near_vmax),
        (0.0, 1.0, isometric_slope),
        (1.0 - near, eccentric, eccentric_slope_near_vmax),
        (1.0, maximum, eccentric_slope_at_vmax),
    ]
    return _chain(points, [concentric_curviness] * 2 + [eccentric_curviness] * 2)


@lru_cache(maxsize=256)
def passive_force_length(
    strain_at_zero: float = 0.0,
    strain_at_one: float = 0.7,
    low_stiffness: float = 0.2,
    stiffness_at_one: float | None = None,
    curviness: float = 0.75,
) -> Curve:
    """Millard's passive force-length curve over the normalized fiber length.

    Parameters
    ----------
    strain_at_zero, strain_at_one : where the curve leaves 0, and where it is 1
    low_stiffness : slope at the end of the toe
    stiffness_at_one : slope at `strain_at_one`; None for 2 / (strain_at_one - strain_at_zero)
    curviness : of both corners
    """
    span = strain_at_one - strain_at_zero
    stiff = 2.0 / span if stiffness_at_one is None else stiffness_at_one
    toe = 0.1 * min(1.0 / stiff, span)
    zero = 1.0 + strain_at_zero
    points = [
        (zero, 0.0, 0.0),
        (zero + toe, 0.5 * toe * low_stiffness, low_stiffness),
        (1.0 + strain_at_one, 1.0, stiff),
    ]
    return _chain(points, [curviness] * 2)


@lru_cache(maxsize=256)
def tendon_force_length(
    strain_at_one: float = 0.049,
    stiffness: float | None = None,
    toe_force: float = 2.0 / 3.0,
    curviness: float = 0.5,
) -> Curve:
    """Millard's tendon force over the tendon length by its slack length.

    Parameters
    ----------
    strain_at_one : where the force is 1
    stiffness : slope of the straight part; None for 1.375 / strain_at_one
    toe_force : force at which the straight part begins
    curviness : of the toe
    """
    slope = 1.375 / strain_at_one if stiffness is None else stiffness
    end = 1.0 + strain_at_one
    toe = (toe_force - 1.0) / slope + end
    foot = 1.0 + (toe - 1.0) / 10.0
    half = (0.5 * toe_force - 1.0) / slope + end
    middle = 0.5 * toe_force / (half - foot)
    corner = foot + 0.5 * (half - foot)
    points = [(1.0, 0.0, 0.0), (corner, middle * (corner - foot), middle), (toe, toe_force, slope)]
    return _chain(points, [curviness] * 2)

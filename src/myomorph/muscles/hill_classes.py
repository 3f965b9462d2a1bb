"""The muscle classes whose curves are known: their parameters, defaults and curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from myomorph.model.paths import Muscle
from myomorph.muscles.hill_curves import (
    Curve,
    active_force_length,
    force_velocity,
    passive_force_length,
    spline_curve,
)

# The first three clamp the fiber at its greatest pennation; the kernels rely on the order.
THELEN, MILLARD, ACCELERATION, DEGROOTE, RIGID, DEPRECATED_THELEN, SCHUTTE, MUJOCO = range(8)

KINDS = {
    "Thelen2003Muscle": THELEN,
    "Millard2012EquilibriumMuscle": MILLARD,
    "Millard2012AccelerationMuscle": ACCELERATION,
    "DeGrooteFregly2016Muscle": DEGROOTE,
    "RigidTendonMuscle": RIGID,
    "Thelen2003Muscle_Deprecated": DEPRECATED_THELEN,
    "Schutte1993Muscle_Deprecated": SCHUTTE,
    "mujoco": MUJOCO,
}

Recipe = tuple[tuple[float, ...], Callable[..., Curve]]

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


def class_parameters(muscle: Muscle, kind: int) -> tuple[list[float], list[Recipe]]:
    """The numbers of the class's formulas and the curves it is made of (active, velocity, passive).

    Parameters
    ----------
    muscle : `parameters` hold OpenSim's property names; those of Millard's curves may be prefixed
        with the curve's class and a slash, which tells apart names that two curves share
    kind : number of the class
    """

    def numbers(**defaults: float) -> list[float]:
        return [muscle.parameters.get(name, default) for name, default in defaults.items()]

    if kind == THELEN:
        shapes = {"KshapeActive": 0.45, "FmaxMuscleStrain": 0.6, "KshapePassive": 5.0, "Af": 0.25, "Flen": 1.4}
        return numbers(**shapes, fv_linear_extrap_threshold=0.95), []
    if kind in (MILLARD, ACCELERATION):
        return [], _millard_curves(muscle, kind)
    if kind == DEGROOTE:
        width, strain = numbers(active_force_width_scale=1.0, passive_fiber_strain_at_one_norm_force=0.6)
        return [width, strain, 1.0 - numbers(ignore_passive_fiber_force=0.0)[0]], []
    if kind == RIGID:
        return [], [((), _generic_active), ((), _generic_velocity), ((), _generic_passive)]
    if kind == DEPRECATED_THELEN:
        return numbers(KshapeActive=0.5, FmaxMuscleStrain=0.6, KshapePassive=4.0, FmaxTendonStrain=0.033), []
    if kind == SCHUTTE:
        return [], [((), _generic_active), ((), _schutte_tendon)]
    return numbers(lmin=0.5, lmax=1.6, fpmax=1.3, fvmax=1.2), []


def _millard_curves(muscle: Muscle, kind: int) -> list[Recipe]:
    def read(curve: str, name: str) -> float | None:
        return muscle.parameters.get(f"{curve}/{name}", muscle.parameters.get(name))

    def values(curve: str, properties: Mapping[str, float]) -> dict[str, float]:
        found = {name: read(curve, name) for name in properties}
        return {name: properties[name] if value is None else float(value) for name, value in found.items()}

    fiber = "FiberForceLengthCurve"
    active = values("ActiveForceLengthCurve", _ACTIVE | ({"minimum_value": 0.0} if kind == ACCELERATION else {}))
    velocity = values("ForceVelocityCurve", _VELOCITY)
    passive = tuple(values(fiber, {"strain_at_zero_force": 0.0, "strain_at_one_norm_force": 0.7}).values())
    optional = [read(fiber, name) for name in ("stiffness_at_low_force", "stiffness_at_one_norm_force", "curviness")]
    passive += tuple(float(value) for value in optional if value is not None) if None not in optional else ()
    if kind == MILLARD:
        _without_singularities(muscle, active, velocity)
    return [
        (tuple(active.values()), active_force_length),
        (tuple(velocity.values()), force_velocity),
        (passive, passive_force_length),
    ]


def inverse_force_velocity(muscle: Muscle) -> Curve:
    """Normalized velocity over f_V of an undamped Millard2012EquilibriumMuscle.

    The inverse of its force-velocity curve but for the ends, where its slopes are half of those near them.
    """
    velocity = {name: float(muscle.parameters.get(name, default)) for name, default in _VELOCITY.items()}
    for name in _VELOCITY:
        velocity[name] = float(muscle.parameters.get(f"ForceVelocityCurve/{name}", velocity[name]))
    for side in ("concentric", "eccentric"):
        velocity[f"{side}_slope_at_vmax"] = 0.5 * velocity[f"{side}_slope_near_vmax"]
    curve = force_velocity(*velocity.values())
    return Curve(curve.pieces[:, ::-1], (1.0 / curve.slopes[0], 1.0 / curve.slopes[1]))


def _without_singularities(muscle: Muscle, active: dict[str, float], velocity: dict[str, float]) -> None:
    """Millard's equilibrium model changes its own curves, by whether an equilibrium can be singular.

    With an elastic tendon and no damping neither curve may reach zero; else both do.
    """
    rigid = bool(muscle.parameters.get("ignore_tendon_compliance", 0.0))
    singular = not rigid and muscle.parameters.get("fiber_damping", 0.1) < 0.001
    active["minimum_value"] = max(active["minimum_value"], 0.1) if singular else 0.0
    for side in ("concentric", "eccentric"):
        near = 0.5 * velocity[f"{side}_slope_near_vmax"]
        at = f"{side}_slope_at_vmax"
        velocity[at] = max(velocity[at], near) if singular else 0.0


# The points of OpenSim's default splines, after SIMM's generic muscle (Delp et al. 1990).
def _generic_active() -> Curve:
    x = [-5.307692, -4.307692, -1.923077, -0.884615, -0.269231, 0.230769, 0.461538, 0.52725, 0.62875, 0.71875, 0.86125]
    x += [1.045, 1.2175, 1.43875, 1.5, 1.615385, 2.0, 2.961538, 3.692308, 5.461538, 9.901902]
    y = [0.012188, 0.021899, 0.036466, 0.052493, 0.075312, 0.114158, 0.157859, 0.226667, 0.636667, 0.856667, 0.95]
    y += [0.993333, 0.77, 0.246667, 0.193821, 0.133252, 0.072683, 0.044417, 0.036341, 0.021899, 0.007332]
    return spline_curve(x, y)


def _generic_passive() -> Curve:
    x = [-5.0, 0.998, 0.999, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5.0]
    y = [0.0, 0.0, 0.0, 0.0, 0.035, 0.12, 0.26, 0.55, 1.17, 2.0, 2.0, 2.0, 2.0]
    return spline_curve(x, y)


def _generic_velocity() -> Curve:
    x = [-1.001, -1.0] + [0.05 * i - 1.0 for i in range(1, 41)]
    y = [0.0, 0.0, 0.010417, 0.021739, 0.034091, 0.047619, 0.0625, 0.078947, 0.097222, 0.117647, 0.140625, 0.166667]
    y += [0.196429, 0.230769, 0.270833, 0.318182, 0.375, 0.444444, 0.53125, 0.642857, 0.791667, 1.0, 1.482014]
    y += [1.601571, 1.655791, 1.686739, 1.706751, 1.720753, 1.731099, 1.739055, 1.745365, 1.75049, 1.754736]
    y += [1.758312, 1.761364, 1.763999, 1.766298, 1.768321, 1.770115, 1.771717, 1.773155, 1.774455]
    return spline_curve(x, y)


def _schutte_tendon() -> Curve:
    x = [-10.0, -0.002, -0.001, 0.0, 0.00131, 0.00281, 0.00431, 0.00581, 0.00731, 0.00881, 0.0103, 0.0118, 0.0123]
    x += [9.2, 9.201, 9.202, 20.0]
    y = [0.0, 0.0, 0.0, 0.0, 0.0108, 0.0257, 0.0435, 0.0652, 0.0915, 0.123, 0.161, 0.208, 0.227]
    y += [345.0, 345.0, 345.0, 345.0]
    return spline_curve(x, y)

"""A model with a person's muscles."""

from __future__ import annotations

from dataclasses import replace

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.tension.personal.fibers import MuscleSizes


def with_sizes(model: Model, sizes: MuscleSizes, before: MuscleSizes) -> Model:
    """The model with other optimal fiber lengths, tendon slack lengths, strengths and passive strains."""
    muscles = []
    for m, muscle in enumerate(model.muscles):
        factor = float(sizes.strain[m] / before.strain[m])
        parameters = _stretched(muscle.kind, dict(muscle.parameters), factor)
        if "default_fiber_length" in parameters:
            parameters["default_fiber_length"] *= float(sizes.fiber[m]) / muscle.optimal_fiber_length
        muscles.append(
            replace(
                muscle,
                optimal_fiber_length=float(sizes.fiber[m]),
                tendon_slack_length=float(sizes.slack[m]),
                max_isometric_force=float(sizes.force[m]),
                parameters=FrozenMap(parameters),
            )
        )
    return replace(model, muscles=tuple(muscles))


_STRAINS = {
    "Millard2012EquilibriumMuscle": ("FiberForceLengthCurve/strain_at_one_norm_force", 0.7),
    "Thelen2003Muscle": ("FmaxMuscleStrain", 0.6),
    "DeGrooteFregly2016Muscle": ("passive_fiber_strain_at_one_norm_force", 0.6),
}


def _stretched(kind: str, parameters: dict[str, float], factor: float) -> dict[str, float]:
    """Parameters of a class whose passive curve is reached at strains larger by a factor."""
    known = _STRAINS.get(kind)
    if known is None or abs(factor - 1.0) < 1e-12:
        return parameters
    name, default = known
    parameters[name] = factor * parameters.get(name, parameters.get(name.split("/")[-1], default))
    zero = "FiberForceLengthCurve/strain_at_zero_force"
    if kind.startswith("Millard"):
        for curve in (zero, zero.split("/")[1]):
            if curve in parameters:
                parameters[curve] *= factor
        for stiffness in ("stiffness_at_low_force", "stiffness_at_one_norm_force"):
            for curve in (f"FiberForceLengthCurve/{stiffness}", stiffness):
                if curve in parameters:
                    parameters[curve] /= factor
    return parameters

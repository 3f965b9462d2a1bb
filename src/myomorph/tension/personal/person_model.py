"""A model with a person's muscles."""

from __future__ import annotations

from dataclasses import replace

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.muscles.hill_arrays import MODELS, muscle_model
from myomorph.tension.personal.fibers import MuscleSizes


def with_sizes(model: Model, sizes: MuscleSizes, before: MuscleSizes) -> Model:
    """The model with other optimal fiber lengths, tendon slack lengths, strengths and passive strains."""
    muscles = []
    for m, muscle in enumerate(model.muscles):
        factor = float(sizes.strain[m] / before.strain[m])
        parameters = dict(muscle.parameters)
        if muscle.kind in MODELS and abs(factor - 1.0) >= 1e-12:
            parameters = muscle_model(muscle).stretched_passive(parameters, factor)
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

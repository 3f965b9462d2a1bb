"""Coordinates whose torque the muscles of a static optimization cannot give, and by how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.messages import Message
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.exchange.causes import TOO_WEAK

MIN_SHARE = 0.01  # Of the largest torque that is missing, below which a coordinate is not named.


def missing_torques(
    model: Model,
    motion: Motion,
    torques: Series,
    tension: Tension,
    actuators: Sequence[Actuator] = (),
) -> list[Message]:
    """Find what is missing in the frames that have no solution.

    Those frames are solved again with a reserve at each coordinate, whose use is dear: what it
    gives is what muscles and actuators cannot.

    Parameters
    ----------
    model, motion, torques, actuators : as solved
    tension : the solution

    Returns
    -------
    a message for each coordinate, the largest missing torque first; none where all frames have a
    solution
    """
    failed = np.flatnonzero(tension.asked & ~tension.optimal)
    if not len(failed):
        return []
    given = default_reserves(model)
    again = solve_tension(
        model,
        motion.frames(failed),
        torques.frames(failed),
        tension.options,
        (*actuators, *given),
        recruitment=EFFORT_ALONE,
    )
    columns = [again.reserve_names.index(actuator.name) for actuator in given]
    missing = np.abs(again.actuator_force[:, columns])
    largest = np.nanmax(missing, axis=0, initial=0.0)
    messages = []
    for index in np.argsort(-largest):
        if largest[index] <= MIN_SHARE * largest.max():
            break
        actuator = given[index]
        frame = int(np.nanargmax(missing[:, index]))
        unit = "N" if actuator.coordinate in _lengths(model) else "N m"
        held = actuator.coordinate or actuator.name
        messages.append(
            TOO_WEAK.message(
                f"muscles and actuators cannot produce the torque of '{held}': {largest[index]:.3g}"
                f" {unit} are"
                f" missing at {again.time[frame]:.2f} s, and {len(failed)} of {len(tension)} frames"
                " have no solution",
                place=held,
                size=float(largest[index]),
                share=len(failed) / len(tension),
            )
        )
    if not messages:
        text = f"{len(failed)} of {len(tension)} frames have no solution"
        messages.append(TOO_WEAK.message(text, share=len(failed) / len(tension)))
    return messages


def _lengths(model: Model) -> set[str]:
    """Names of the coordinates that are lengths."""
    return {one.name for one in model.coordinates if one.motion == "translational"}

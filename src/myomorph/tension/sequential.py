"""Contact forces first, muscle tensions after: what [D] ch. 4 argues against and most programs do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.errors import BadModel
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series
from myomorph.rigid.frames import over_frames
from myomorph.tension.actuators import floating_joints
from myomorph.tension.contacts import ContactTask
from myomorph.tension.emg import EmgTarget
from myomorph.tension.problem import tension_problem
from myomorph.tension.tension import Tension, TensionOptions


def solve_sequential(
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions | None,
    actuators: Sequence[Actuator] | None,
    progress: Callable[[int], None] | None,
    contacts: ContactTask,
    emg: EmgTarget | None,
) -> Tension:
    """Contact forces from the six equations of motion of every floating body, then muscles given these forces.

    The first problem has the costs of contacts and residuals, and joints as ideal torques that cost nothing, which
    is to leave their equations out; the second has the contact forces as known ones. Parameters are those of
    `solve_tension`.

    Raises
    ------
    BadModel
        where no body floats, so that no equation is left for the contacts
    """
    roots = {name for joint in floating_joints(model) for name in joint.coordinates}
    if not roots:
        raise BadModel(
            f"model '{model.name}' has no body that floats freely: contact forces cannot be found before muscle "
            "tensions; use the simultaneous formulation"
        )
    bare = replace(model, muscles=())
    first, _ = tension_problem(bare, motion, torques, options, actuators, contacts=contacts, only=roots)
    over_frames(first.solve, len(motion), None, first.window)
    found = first.result(())
    assert first.contacts is not None
    known = np.array(torques.values)
    order = [model.coordinate_names.index(name) for name in torques.names if name in model.coordinate_names]
    carried = first.contacts.torques_of(first.coordinates, first.amplitudes)
    known[:, [name in model.coordinate_names for name in torques.names]] -= carried[:, order]
    second, names = tension_problem(
        model, motion, Series(torques.time, torques.names, known), options, actuators, emg=emg
    )
    over_frames(second.solve, len(motion), progress, second.window)
    tension = second.result(names)
    worst = np.where(found.status > 0, found.status, tension.status)
    return replace(
        tension,
        contacts=found.contacts,
        status=worst,
        iterations=found.iterations + tension.iterations,
        imbalance=np.maximum(found.imbalance, tension.imbalance),
    )

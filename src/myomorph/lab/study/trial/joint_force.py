"""Loads of joints as part of the step `tension`: their table, and the size of each force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.io.sto import write_sto
from myomorph.core.model.causes import CONTACTS
from myomorph.core.model.findings import spans_of
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.segments import joint_labels
from myomorph.core.model.series import Series
from myomorph.core.tension.load_quantities import JOINT_FORCE_NORM, JOINT_REACTION
from myomorph.core.tension.reaction import JointReactions
from myomorph.core.tension.tension import MAX_UNEXPLAINED, Tension, unexplained_frames
from myomorph.lab.store.quantities import put_value
from myomorph.lab.study.step.step import StepOutput

FEW_LEFT_OUT = 0.1
"""Share of the frames without joint loads up to which what is left is good to use."""


def held_from_nowhere(
    tension: Tension, model: Model, estimated: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """Find frames in which estimated forces of contacts do not carry the body.

    Parameters
    ----------
    tension : result
    model : of the body
    estimated : (frames,) in which forces of contacts are estimated, None for all: what plates
        measured stays

    Returns
    -------
    (frames,)
    """
    lost = unexplained_frames(tension, model.weight)
    return lost if estimated is None else lost & estimated


def without_frames(tension: Tension, lost: NDArray[np.bool_]) -> Tension:
    """Leave muscle forces of some frames out.

    Parameters
    ----------
    tension : result
    lost : (frames,) in which muscle forces become NaN

    Returns
    -------
    the tensions
    """
    force = np.where(lost[:, None], np.nan, tension.muscle_force)
    return replace(tension, muscle_force=force)


def carried_tension(
    tension: Tension, model: Model, estimated: NDArray[np.bool_] | None = None
) -> tuple[Tension, tuple[Message, ...]]:
    """Return tensions without frames in which the body is held from nowhere, and what is left out.

    Parameters
    ----------
    tension : result; muscle forces (frames, muscles) become NaN in those frames [N]
    model : of the body
    estimated : (frames,) see `held_from_nowhere`

    Returns
    -------
    the tensions, and a note where something is left out
    """
    lost = held_from_nowhere(tension, model, estimated)
    if not lost.any():
        return tension, ()
    share = float(lost.mean())
    note = CONTACTS.message(
        f"joint loads are left out in {100.0 * share:.0f} % of the frames, in which more than"
        f" {100.0 * MAX_UNEXPLAINED:.0f} % of the weight is unexplained",
        times=spans_of(tension.time, lost),
        share=share,
        # Frames without numbers change none, as long as most have them.
        severity="good to know" if share < FEW_LEFT_OUT else None,
    )
    return without_frames(tension, lost), (note,)


def write_reactions(reactions: JointReactions, model: Model, output: StepOutput) -> None:
    """Write the loads of all joints as a table, and the sizes of their forces into the result."""
    labels = joint_labels(model)
    write_sto(reactions.table(labels), output.folder / JOINT_REACTION.file)
    forces = joint_forces(reactions, model)
    if forces.names:
        put_value(output.writer, forces)


def joint_forces(reactions: JointReactions, model: Model) -> Series:
    """Return the size of the force in every joint that joins two bodies.

    Parameters
    ----------
    reactions : forces (frames, joints, 3) [N]
    model : whose joints they are

    Returns
    -------
    (frames, joints) by the joints' plain names [N]
    """
    labels = joint_labels(model)
    on_ground = {joint.name for joint in model.joints if joint.parent == GROUND}
    columns = [place for place, name in enumerate(reactions.joints) if name not in on_ground]
    names = tuple(labels[reactions.joints[place]] for place in columns)
    sizes = np.linalg.norm(reactions.forces[:, columns], axis=2)
    return Series(reactions.time, names, sizes, quantity=JOINT_FORCE_NORM)

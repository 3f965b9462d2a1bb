"""Forces at contact points of joints as part of the step `tension`.

They are written, and reported in notes and numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.core.io.sto import write_sto
from myomorph.core.model.causes import JOINT_POINTS
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.tension.joint_contact import JointContactForces, JointPoints
from myomorph.core.tension.load_quantities import JOINT_CONTACT_LOAD
from myomorph.lab.analysis.joint_loads import StrideLoad, stride_loads
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.store.contact_store import get_joint_contacts, put_joint_contacts
from myomorph.lab.store.results import Stored
from myomorph.lab.study.step.step import StepOutput
from myomorph.lab.study.trial.trial_inputs import Signals, Value, tidy_signals
from myomorph.lab.study.trial.trial_strides import TrialStrides

STRIDES = "joint_contact_strides.csv"
COLUMNS = (
    "load",
    "stride",
    "start_s",
    "stop_s",
    "peak_N",
    "peak_body_weights",
    "peak_percent",
    "impulse_N_s",
)

# Of body weight: a joint that bears less may rest on any of its points without a word.
LOADED = 0.25
RARE = 0.05  # Share of the frames below which that is good to know.
LEFT = 0.25  # Of the force times half the distance of the points: a moment left that is said.


def write_joint_contacts(
    contacts: JointContactForces, points: JointPoints, strides: Strides | None, output: StepOutput
) -> tuple[Message, ...]:
    """Write forces at contact points, and return what is to be known of them, one line each."""
    put_joint_contacts(output.writer, contacts)
    write_sto(contacts.table(), output.folder / JOINT_CONTACT_LOAD.file)
    write_csv(output.folder / STRIDES, COLUMNS, _stride_rows(contacts, strides))
    return (*points.notes, *lift_off_notes(contacts, _half_distances(points)))


def _half_distances(points: JointPoints) -> dict[str, float]:
    """Of each joint's points from their middle, the mean of squares [m]."""
    result = {}
    for joint in dict.fromkeys(point.joint for point in points.points):
        places = np.array(
            [point.point for point in points.points if point.joint == joint], dtype=np.float64
        )
        result[joint] = float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return result


def lift_off_notes(contacts: JointContactForces, half: dict[str, float]) -> tuple[Message, ...]:
    """Report where the points of a loaded joint cannot carry it.

    A moment is left, or the bodies are pulled apart.
    """
    notes = []
    for j, joint in enumerate(contacts.joints):
        force = contacts.joint_contact_total[:, j]
        moment = contacts.joint_contact_unbalanced_moment[:, j]
        pull = contacts.joint_contact_unbalanced_force[:, j]
        loaded = force > LOADED * contacts.weight
        bad = loaded & (moment > LEFT * force * half[joint]) & (half[joint] > 0.0)
        if bad.any():
            worst = int(np.argmax(np.where(bad, moment, -1.0)))
            columns = [column for column, name in enumerate(contacts.joint_of) if name == joint]
            up = ", ".join(
                contacts.points[column]
                for column in columns
                if contacts.joint_contact_force[worst, column] <= 1e-6 * force[worst]
            )
            notes.append(
                JOINT_POINTS.message(
                    f"{joint}: in {int(bad.sum())} of {len(bad)} frames a contact point of the"
                    " loaded joint would have to pull; it lifts off, and a moment of up to"
                    f" {moment[worst]:.1f} N m is left (at {contacts.time[worst]:.2f} s,"
                    f" {up or 'none'} off)",
                    severity="good to know" if bad.mean() < RARE else None,
                )
            )
        pulled = pull > LOADED * contacts.weight
        if pulled.any():
            worst = int(np.argmax(np.where(pulled, pull, -1.0)))
            notes.append(
                JOINT_POINTS.message(
                    f"{joint}: in {int(pulled.sum())} of {len(pulled)} frames the joint is pulled"
                    f" apart, which its contact points cannot carry, by up to {pull[worst]:.0f} N"
                    f" (at {contacts.time[worst]:.2f} s); check that the normals point towards the"
                    " child"
                )
            )
    return tuple(notes)


def _stride_rows(
    contacts: JointContactForces, strides: Strides | None
) -> Iterator[tuple[str, ...]]:
    """One row a load and stride; the whole recording as one row where it has no strides."""
    for load in stride_loads(contacts.loads(), strides):
        numbers = (load.peak, load.peak / contacts.weight, load.peak_percent, load.impulse)
        label = str(load.stride) if load.stride else "recording"
        yield (
            load.load,
            label,
            f"{load.start:.4f}",
            f"{load.stop:.4f}",
            *(f"{value:.6g}" if np.isfinite(value) else "" for value in numbers),
        )


def joint_contact_signals(stored: Stored, model: Model) -> tuple[Signals, ...]:
    """Return loads over time for tables of values and curves."""
    joint_contacts = get_joint_contacts(stored)
    if joint_contacts is None:
        return ()
    loads = replace(joint_contacts.loads(), quantity=JOINT_CONTACT_LOAD)
    return (tidy_signals("tension", loads, model),)


def joint_contact_numbers(stored: Stored, strides: TrialStrides | None) -> Iterator[Value]:
    """Yield peak in body weights and impulse of every load.

    They are means over the strides, or of the whole recording.
    """
    joint_contacts = get_joint_contacts(stored)
    if joint_contacts is None or not len(joint_contacts):
        return
    parts = () if strides is None else strides.parts
    each = [
        load for part in parts for load in stride_loads(joint_contacts.loads(), part)
    ] or stride_loads(joint_contacts.loads(), None)
    for name in joint_contacts.loads().names:
        loads = [load for load in each if load.load == name]
        if loads:
            yield from _numbers_of(name, loads, joint_contacts.weight)


def _numbers_of(name: str, loads: Sequence[StrideLoad], weight: float) -> Iterator[Value]:
    """Mean peak and impulse of one load; no impulse where it is not known all the time.

    Parameters
    ----------
    name : of the load
    loads : stride by stride
    weight : of the body [N]
    """
    assert JOINT_CONTACT_LOAD.tidy is not None
    kind = JOINT_CONTACT_LOAD.tidy.ending()
    ending = ", mean of strides" if any(load.stride for load in loads) else ""
    yield Value(
        step="tension",
        quantity=f"{name}{kind}, peak{ending}",
        value=float(np.mean([load.peak for load in loads])) / weight,
        unit="body weight",
    )
    impulse = float(np.mean([load.impulse for load in loads]))
    if np.isfinite(impulse):
        yield Value(
            step="tension",
            quantity=f"{name}{kind}, impulse{ending}",
            value=impulse,
            unit="N s",
        )

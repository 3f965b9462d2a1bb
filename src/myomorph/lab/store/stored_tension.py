"""Muscle tensions, and what belongs to them, to a result file and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.tension.emg_conflicts import EmgConflict
from myomorph.core.tension.emg_quantities import CONFLICTS
from myomorph.core.tension.fiber_quantities import (
    ELASTIC_CERTIFICATE_VALUE,
    FIBERS,
    MUSCLE_RIGID_TENDON,
    UNREACHABLE_FRAME,
    UNREACHABLE_LENGTH,
)
from myomorph.core.tension.quantities import (
    ACTUATOR_COORDINATE,
    MUSCLE_OVERSTRETCHED,
    MUSCLE_PASSIVE_SHARE,
    MUSCLE_PASSIVE_TIME,
    MUSCLE_VISCOUS_FORCE,
    TENSION,
)
from myomorph.core.tension.tension import Certificate, Fibers, Tension, Unreachable
from myomorph.lab.store.quantities import (
    get_fields,
    get_quantity,
    get_rows,
    put_quantity,
    put_rows,
    put_value,
    value_of,
)
from myomorph.lab.store.results import ResultWriter, Stored

if TYPE_CHECKING:
    from myomorph.core.tension.tension import TensionOptions

CERTIFICATE = ("residual", "equilibrium", "steps", "second_activations", "second_forces")
"""Fields of `Certificate`."""


def put_tension(
    writer: ResultWriter, tension: Tension, reserve_coordinates: tuple[str, ...]
) -> None:
    """Muscle tensions, reserves, and whether each frame is an optimum."""
    silent = []
    if not tension.options.has_passive:
        silent += [MUSCLE_PASSIVE_SHARE, MUSCLE_PASSIVE_TIME]
    if not tension.muscle_viscous_force.any():
        silent.append(MUSCLE_VISCOUS_FORCE)
    put_value(writer, tension, leave_out=silent)
    labels = {"actuator": tension.reserve_names}
    put_quantity(writer, ACTUATOR_COORDINATE, reserve_coordinates, labels)
    if tension.fibers is not None:
        _put_certificate(writer, tension.fibers, tension.muscles)


def get_tension(stored: Stored, options: TensionOptions) -> Tension | None:
    """Read what `put_tension` wrote, or None."""
    fields = get_fields(stored, TENSION)
    names = stored.names
    if "activation" not in fields:
        return None
    strained = fields.pop(MUSCLE_OVERSTRETCHED.field)
    without_actuators = {"actuator_force": np.zeros((len(stored.time), 0))}
    others = {
        "time": stored.time,
        "muscles": names["muscle"],
        "reserve_names": names.get("actuator", ()),
        "coordinates": names["balanced_coordinate"],
        "overstretched": tuple(np.array(names["muscle"])[strained].tolist()),
        "options": replace(options, passive=MUSCLE_PASSIVE_SHARE.field in fields),
        "fibers": get_fibers(stored),
    }
    return value_of(Tension, without_actuators, fields, others)


def _put_certificate(writer: ResultWriter, fibers: Fibers, muscles: tuple[str, ...]) -> None:
    """Muscles on rigid tendons, fibers that cannot reach, and how sure the solution is."""
    frames = np.full(len(muscles), -1, np.int32)
    lengths = np.full(len(muscles), np.nan)
    for missed in fibers.unreachable:
        muscle = muscles.index(missed.muscle)
        frames[muscle] = missed.frame
        lengths[muscle] = missed.worst
    rigid = np.array([name in fibers.rigid for name in muscles], bool)
    put_quantity(writer, MUSCLE_RIGID_TENDON, rigid)
    put_quantity(writer, UNREACHABLE_FRAME, frames)
    put_quantity(writer, UNREACHABLE_LENGTH, lengths)
    numbers = np.array([getattr(fibers.certificate, name) for name in CERTIFICATE], np.float64)
    labels = {"elastic_certificate": CERTIFICATE}
    put_quantity(writer, ELASTIC_CERTIFICATE_VALUE, numbers, labels)


def get_fibers(stored: Stored) -> Fibers | None:
    """Fibers and tendons of a result, or None where tendons were rigid."""
    fields = get_fields(stored, FIBERS)
    if "tendon_strain" not in fields:
        return None
    muscles = stored.names["muscle"]
    rigid = get_quantity(stored, MUSCLE_RIGID_TENDON)
    frames = get_quantity(stored, UNREACHABLE_FRAME)
    lengths = get_quantity(stored, UNREACHABLE_LENGTH)
    numbers = get_quantity(stored, ELASTIC_CERTIFICATE_VALUE).tolist()
    certificate = dict(zip(stored.names["elastic_certificate"], numbers, strict=True))
    steps = int(certificate.pop("steps"))
    others = {
        "rigid": tuple(name for name, stiff in zip(muscles, rigid, strict=True) if stiff),
        "unreachable": tuple(
            Unreachable(name, int(frame), float(length))
            for name, frame, length in zip(muscles, frames, lengths, strict=True)
            if frame >= 0
        ),
        "certificate": value_of(Certificate, certificate, {"steps": steps}),
    }
    return value_of(Fibers, fields, others)


def put_conflicts(writer: ResultWriter, conflicts: Sequence[EmgConflict]) -> None:
    """Write conflicts, none of them too.

    An empty table says that EMG took part and nothing contradicts it.
    """
    put_rows(writer, CONFLICTS, conflicts)


def get_conflicts(stored: Stored) -> tuple[EmgConflict, ...] | None:
    """Read what `put_conflicts` wrote, None where EMG took no part."""
    return get_rows(stored, CONFLICTS, EmgConflict)

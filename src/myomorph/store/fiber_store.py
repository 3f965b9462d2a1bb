"""Fibers and tendons of muscles in result files."""

from __future__ import annotations

import numpy as np

from myomorph.store.results import ResultWriter, Stored
from myomorph.tension.fibers import Certificate, Fibers, Unreachable

MEANINGS = {
    "fiber_length": "length of the muscle's fibers",
    "fiber_velocity": "lengthening velocity of the fibers",
    "tendon_strain": "tendon length over slack length, less 1",
    "fiber_power": "power of the fibers, positive where they do work",
    "tendon_power": "power of the tendon, positive where it gives work back",
    "transient": "1 near an end, where what lies beyond it can be felt",
    "bridged": "1 where torques or coordinates were interpolated",
}
"""Variables over time in the order of the fields of `Fibers`."""

CERTIFICATE = ("residual", "equilibrium", "steps", "second_activations", "second_forces")
"""Fields of `Certificate`."""


def put_fibers(writer: ResultWriter, fibers: Fibers, muscles: tuple[str, ...]) -> None:
    """Fibers and tendons; time and muscles are there already."""
    for name, one in fibers.variables().items():
        writer.put(name, one.dimensions, one.values, one.unit or "1", MEANINGS[name])
    rigid = np.array([name in fibers.rigid for name in muscles], bool)
    writer.put("muscle_rigid_tendon", ("muscle",), rigid, "1", "1 where the tendon was taken as rigid")
    frames, worst = np.full(len(muscles), -1, np.int32), np.full(len(muscles), np.nan)
    for one in fibers.unreachable:
        place = muscles.index(one.muscle)
        frames[place], worst[place] = one.frame, one.worst
    writer.put("unreachable_frame", ("muscle",), frames, "1", "first frame that the fibers cannot reach, -1 for none")
    writer.put("unreachable_length", ("muscle",), worst, "1", "normalized fiber length furthest out of reach")
    writer.names("elastic_certificate", CERTIFICATE)
    values = np.array([getattr(fibers.certificate, name) for name in CERTIFICATE], np.float64)
    writer.put("elastic_certificate_value", ("elastic_certificate",), values, "1", "how sure the elastic solution is")


def get_fibers(stored: Stored) -> Fibers | None:
    """What `put_fibers` wrote, or None."""
    values, names = stored.values, stored.names
    if "tendon_strain" not in values:
        return None
    muscles = names["muscle"]
    frames, worst = values["unreachable_frame"], values["unreachable_length"]
    told = dict(zip(names["elastic_certificate"], values["elastic_certificate_value"].tolist(), strict=True))
    return Fibers(
        *(values[name] for name in list(MEANINGS)[:5]),
        transient=values["transient"] != 0,
        bridged=values["bridged"] != 0,
        rigid=tuple(name for name, one in zip(muscles, values["muscle_rigid_tendon"], strict=True) if one),
        unreachable=tuple(
            Unreachable(name, int(frame), float(length))
            for name, frame, length in zip(muscles, frames, worst, strict=True)
            if frame >= 0
        ),
        certificate=Certificate(**(told | {"steps": int(told["steps"])})),
    )

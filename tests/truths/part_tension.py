"""What one of several joined models did, by its own names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.core.model.errors import UnknownName
from myomorph.core.model.join import own_name
from myomorph.core.tension.tension import Fibers, Tension


def tension_of(whole: Tension, part: str) -> Tension:
    """Return activations, tensions, reserves and torques of one part of a joined model.

    Names are the part's own. Status, iterations and equilibrium residual stay those of the whole
    problem. Contact
    forces are not included, as those between parts have a site on one of them only:
    `part_of(whole.contacts.wrenches(), part)` gives all on it.
    """
    muscles = _own(whole.muscles, part)
    if not muscles:
        begins = tuple(dict.fromkeys(name.partition("_")[0] for name in whole.muscles))
        raise UnknownName(
            "part", part, existing=begins, where="the muscles' names begin with what it"
        )
    reserves = _own(whole.reserve_names, part)
    coordinates = _own(whole.coordinates, part)
    columns = list(muscles)
    rows = list(coordinates)
    held = list(reserves)
    return replace(
        whole,
        muscles=tuple(muscles.values()),
        activation=whole.activation[:, columns],
        muscle_force=whole.muscle_force[:, columns],
        muscle_viscous_force=np.array(whole.muscle_viscous_force[:, columns]),
        muscle_passive_share=np.array(whole.muscle_passive_share[columns]),
        muscle_passive_time=np.array(whole.muscle_passive_time[columns]),
        activation_lower=whole.activation_lower[columns],
        activation_upper=whole.activation_upper[columns],
        reserve_names=tuple(reserves.values()),
        actuator_force=whole.actuator_force[:, held],
        coordinates=tuple(coordinates.values()),
        balanced_torque=whole.balanced_torque[:, rows],
        overstretched=tuple(_own(whole.overstretched, part).values()),
        contacts=None,
        fibers=None if whole.fibers is None else _fibers_of(whole.fibers, muscles, whole.muscles),
    )


def _own(names: tuple[str, ...], part: str) -> dict[int, str]:
    """Columns of a part, and its own names of them."""
    return {
        index: own for index, name in enumerate(names) if (own := own_name(name, part)) is not None
    }


def _fibers_of(fibers: Fibers, muscles: Mapping[int, str], names: tuple[str, ...]) -> Fibers:
    """Fibers of some muscles, column to new name; `names`: the present name of every column."""
    columns = list(muscles)
    new = {names[index]: muscle for index, muscle in muscles.items()}
    return replace(
        fibers,
        fiber_length=fibers.fiber_length[:, columns],
        fiber_velocity=fibers.fiber_velocity[:, columns],
        tendon_strain=fibers.tendon_strain[:, columns],
        fiber_power=fibers.fiber_power[:, columns],
        tendon_power=fibers.tendon_power[:, columns],
        rigid=tuple(new[name] for name in fibers.rigid if name in new),
        unreachable=tuple(
            replace(item, muscle=new[item.muscle])
            for item in fibers.unreachable
            if item.muscle in new
        ),
    )

"""Muscle tensions of one subject, out of those of several who were solved as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.errors import UnknownName
from myomorph.model.join import own_name
from myomorph.tension.tension import Tension


def tension_of(whole: Tension, part: str) -> Tension:
    """Activations, tensions, reserves and torques of one part of a joined model, by the part's own names.

    Status, iterations and imbalance stay those of the whole problem. Contact forces are not taken along, as those
    between parts have a site on one of them only: `part_of(whole.contacts.wrenches(), part)` gives all on the part.

    Raises
    ------
    UnknownName
        where no muscle is the part's
    """
    muscles = _own(whole.muscles, part)
    if not muscles:
        begins = tuple(dict.fromkeys(name.partition("_")[0] for name in whole.muscles))
        raise UnknownName("part", part, begins, "the muscles' names begin with what it")
    reserves, coordinates = _own(whole.reserve_names, part), _own(whole.coordinates, part)
    columns, rows, held = list(muscles), list(coordinates), list(reserves)
    return replace(
        whole,
        muscles=tuple(muscles.values()),
        activations=whole.activations[:, columns],
        forces=whole.forces[:, columns],
        viscous=np.array(whole.viscous[:, columns]),
        lower=whole.lower[columns],
        upper=whole.upper[columns],
        reserve_names=tuple(reserves.values()),
        reserves=whole.reserves[:, held],
        coordinates=tuple(coordinates.values()),
        torques=whole.torques[:, rows],
        overstretched=tuple(_own(whole.overstretched, part).values()),
        contacts=None,
    )


def _own(names: tuple[str, ...], part: str) -> dict[int, str]:
    """Columns of a part, and its own names of them."""
    return {k: own for k, name in enumerate(names) if (own := own_name(name, part)) is not None}

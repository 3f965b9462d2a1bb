"""A walk whose ground forces plates measured.

It is `rajagopal-walk-emg` at 100 Hz, filtered at 6 Hz, feet on the floor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from myomorph.core.contact.site_motion import Floor, rest_on_floor
from myomorph.core.contact.sites import foot_sites
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.contacts import Site
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import differentiate

WALK = "rajagopal-walk-emg"


@dataclass(frozen=True, eq=False)
class MeasuredWalk:
    """The walk, and what the plates measured on their own clock."""

    model: Model
    motion: Motion
    sites: tuple[Site, ...]
    floor: Floor
    loads: Wrenches


def measured_walk(data: Callable[[str], Path]) -> MeasuredWalk:
    """Read it."""
    model = read_model(data(f"{WALK}/subject_walk_scaled.osim"))
    whole = motion_from_table(read_sto(data(f"{WALK}/coordinates.sto")), model)
    motion = differentiate(Motion(whole.time[::10], whole.names, whole.values[::10]), 6.0)
    sites, floor = rest_on_floor(model, motion, foot_sites(model), 0.0)
    return MeasuredWalk(
        model=model,
        motion=motion,
        sites=sites,
        floor=floor,
        loads=read_external_loads(data(f"{WALK}/grf_walk.xml")),
    )

"""Forces of joints that statics allow, as part of the step `tension`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.core.model.causes import BENT_KNEES
from myomorph.core.model.messages import Message
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.core.tension.static_loads import StaticLoads
from myomorph.lab.store.quantities import put_value
from myomorph.lab.store.quantity_files import write_series
from myomorph.lab.study.step.step import StepOutput

BENT = np.radians(60.0)  # Beyond which a knee's force depends most on its arms [rad]
LOADED = 1.0  # Least force of a bent knee that is named, in body weights


def write_static_loads(
    loads: StaticLoads, contacts: JointContactForces | None, output: StepOutput
) -> tuple[Message, ...]:
    """Write least and greatest forces, and return a line on each knee that bends far under load."""
    if not loads.joints:
        return ()
    put_value(output.writer, loads)
    for series in loads.series:
        write_series(output.folder, series)
    return tuple(bent_knee_notes(loads, contacts))


def bent_knee_notes(loads: StaticLoads, contacts: JointContactForces | None) -> Iterator[Message]:
    """Name knees that carry a body weight or more beyond 60 degrees of flexion.

    Parameters
    ----------
    loads : by statics
    contacts : estimated forces of the same frames, None for none
    """
    for place, joint in enumerate(loads.joints):
        bend = loads.flexion[:, place]
        least = np.where(bend > BENT, loads.static_load_low[:, place], 0.0)
        if not np.nanmax(least, initial=0.0) > LOADED * loads.weight:
            continue
        worst = int(np.nanargmax(least))
        low = loads.static_load_low[worst, place] / loads.weight
        high = loads.static_load_high[worst, place] / loads.weight
        found = ""
        if contacts is not None and joint in contacts.joints:
            total = contacts.of(joint)[worst] / contacts.weight
            found = f", {total:.1f} are estimated"
        yield BENT_KNEES.message(
            f"{joint}: bends to {np.degrees(bend[worst]):.0f}° under load; there statics with"
            f" published moment arms allow {low:.1f} to {high:.1f} body weights and more{found}"
            f" (at {loads.time[worst]:.2f} s)"
        )

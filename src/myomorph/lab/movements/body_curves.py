"""What squats and rises are seen by: angles, heights and moments over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.quantity import Quantity
from myomorph.lab.movements.part import UNKNOWN
from myomorph.lab.movements.support_force import SupportForce

CARRIES = 0.1
"""By which share the mean force may differ from the weight where all of it is measured."""


@read_only
class BodyCurves:
    """Angles, heights and moments of a body.

    Attributes
    ----------
    time : (frames,) [s]
    bend : (frames,) mean flexion of the knees [degrees], NaN where they were not seen
    center : (frames,) height of the center of mass [m], NaN where it is not known
    hips : (frames,) height of the hips' centers [m], NaN where they were not seen
    lean : (frames,) angle of the trunk with the vertical [degrees], None without a trunk
    clock : (samples,) of the moments [s]
    moments : (samples,) extension moments per body mass [N m/kg], by the quantity of their peaks;
        NaN where they do not hold
    """

    time: Array
    bend: Array
    center: Array
    hips: Array
    lean: Array | None
    clock: Array
    moments: Mapping[Quantity, Array]

    def peaks(self, start: float, stop: float) -> Mapping[Quantity, float]:
        """Return the largest moments in a span of time, NaN where a moment is not known in it.

        Parameters
        ----------
        start, stop : of the span [s]
        """
        inside = (self.clock >= start - 1e-9) & (self.clock <= stop + 1e-9)
        return FrozenMap(
            {
                quantity: float(moment[inside].max())
                if inside.any() and np.isfinite(moment[inside]).all()
                else UNKNOWN
                for quantity, moment in self.moments.items()
            }
        )


def right_load(force: SupportForce | None, start: float, stop: float, carried: bool) -> float:
    """Return the share of the right foot in the mean force under both.

    Parameters
    ----------
    force : under the feet, None without plates
    start, stop : from when to when [s]
    carried : whether the feet carry the whole body then, so that another mean force tells of plates
        that measured only a part

    Returns
    -------
    [%], NaN where it is not known
    """
    if force is None or not stop > start:
        return UNKNOWN
    part = force.inside(start, stop)
    if part.stop - part.start < 2:
        return UNKNOWN
    mean = float(force.total[part].mean())
    if carried and abs(mean - force.weight) > CARRIES * force.weight:
        return UNKNOWN
    return force.right_share(start, stop)

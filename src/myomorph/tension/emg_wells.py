"""EMG in the separable problem: what pulls an activation towards what was measured."""

from __future__ import annotations

import numpy as np

from myomorph.model.errors import BadData
from myomorph.model.model import index_of
from myomorph.model.spatial import Array
from myomorph.tension.emg import EmgTarget
from myomorph.tension.separable import no_wells

STIFFNESS = 1e4
"""Cost of passing the slack of an equality, of the excess squared, in units of the effort a^2 of one muscle."""


def emg_wells(emg: EmgTarget | None, muscles: tuple[str, ...], variables: int, frames: int) -> Array:
    """Intervals that activations are drawn into, and how strongly: (1 or frames, 3, variables), l, h and k.

    The cost gains k dist(a, [l, h])^2: l = h = EMG with a soft target, EMG -+ slack with an equality.

    Raises
    ------
    BadData
        where EMG has another number of frames than the motion, or tells of a muscle twice
    UnknownName
        where it tells of a muscle that the model does not have
    """
    if emg is None:
        return no_wells(variables)
    if len(emg.activations) != frames:
        raise BadData(f"EMG has {len(emg.activations)} frames, the motion {frames}: both must have the same times")
    columns = [index_of("muscle", name, muscles, "the model, for EMG,") for name in emg.muscles]
    if len(set(columns)) != len(columns):
        twice = next(name for name in emg.muscles if emg.muscles.count(name) > 1)
        raise BadData(f"EMG tells of muscle '{twice}' twice: combine its channels first")
    slack, stiffness = (0.0, emg.weight) if emg.mode == "soft" else (emg.slack, STIFFNESS)
    wells = np.zeros((frames, 3, variables))
    wells[:, 0, columns] = emg.activations - slack
    wells[:, 1, columns] = emg.activations + slack
    wells[:, 2, columns] = np.where(np.isfinite(emg.activations), stiffness, 0.0)
    return wells

"""The clock of a force plate against that of the markers, from a limb that swings on it."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.motion.clocks import Clock, ClockOptions, fit_clock


def wrench_clock(
    time: Array,
    rows: Array,
    wrench_time: Array,
    wrench: Array,
    options: ClockOptions | None = None,
    used: np.ndarray | None = None,
) -> Clock:
    """Offset and drift that leave the least of wrench = rows phi + constant, phi and constant unknown.

    The wrench knows the motion it comes from, whatever the masses are ([S] step 1), so it is its own
    synchronisation signal. The constant takes what the plate was tared with. Rows and wrench are low-pass filtered
    alike, so neither needs to be filtered before (`ClockOptions.cutoff`).

    Parameters
    ----------
    time : (frames,) of the markers, the reference [s]
    rows : (frames, 6, parameters) moment and force that unit parameters cause, as `SwingRecording.wrench_rows`
    wrench_time, wrench : (samples,) on the plate's clock [s], (samples, 6) about the same point [N m], [N]
    used : (frames,) whether a frame takes part, False where the limb is touched

    Returns
    -------
    the plate's clock: `clock.apply(wrenches)` brings the recording to the markers' times

    Raises
    ------
    BadData : too little in common, or a limb that hardly moves
    """
    if rows.ndim != 3 or rows.shape[1] != 6 or wrench.shape[1:] != (6,):
        raise BadData(
            f"expected rows (frames, 6, parameters) and a wrench (samples, 6), got {rows.shape}, {wrench.shape}"
        )
    constant = np.broadcast_to(np.eye(6), (len(time), 6, 6))
    return fit_clock(time, np.concatenate((rows, constant), axis=2), wrench_time, wrench, options, used)

"""When torques hold: stretches of time in which loads, markers and residuals are within limits.

A frame holds where torques are known, no foot bears a load that nobody measured, and markers are
within their limit. Of the stretches of such frames those count that last `SHORTEST` and in which
the root mean square of the residual force and moment is under the limits of the checks (Hicks et
al. 2015). So a window may be shorter than the recording although the verdict is "angles only", and
there is none where residuals are too large everywhere.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.contact.undetermined import UNDETERMINED
from myomorph.core.model.arrays import Array
from myomorph.core.model.findings import spans_of
from myomorph.core.model.messages import Span
from myomorph.lab.report.trial.answer.judgement import missed_frames
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.report.trial.tables import RESIDUAL_FORCE, RESIDUAL_MOMENT, residuals

SHORTEST = 0.1
"""Stretches that are shorter are left out [s]."""


def torque_windows(prepared: Prepared) -> tuple[Span, ...]:
    """Find the stretches of time in which torques hold, see the module.

    Parameters
    ----------
    prepared : with torques, and what checks found of external forces

    Returns
    -------
    first and last time of each [s]; none without measured forces
    """
    dynamics = prepared.results.dynamics
    torques = dynamics.torques
    if torques is None or dynamics.wrenches is None or not len(torques):
        return ()
    holds = np.asarray(np.isfinite(torques.values).all(axis=1))
    for start, stop in undetermined_spans(prepared):
        holds &= (torques.time < start) | (torques.time > stop)
    missed = missed_frames(prepared)
    motion = prepared.results.kinematics.motion
    if motion is not None and len(missed) == len(motion):
        holds &= np.interp(torques.time, motion.time, missed) < 0.5
    return tuple(
        span
        for span in spans_of(torques.time, np.asarray(holds))
        if span[1] - span[0] >= SHORTEST and _explained(prepared, torques.time, span)
    )


def undetermined_spans(prepared: Prepared, foot: str = "") -> tuple[Span, ...]:
    """Return when the load of a foot was not measured, of any foot where none is named [s]."""
    wrenches = prepared.results.dynamics.wrenches
    findings = () if wrenches is None else wrenches.findings
    return tuple(
        span
        for finding in findings
        if finding.kind == UNDETERMINED and foot in ("", finding.place)
        for span in finding.times
    )


def _explained(prepared: Prepared, time: Array, span: Span) -> bool:
    """Whether residuals in a span of time [s] are within their limits.

    Parameters
    ----------
    time : (frames,) of the torques [s]
    """
    results = prepared.results
    dynamics = results.dynamics
    torques = dynamics.torques
    wrenches = dynamics.wrenches
    if results.model is None or torques is None or wrenches is None or dynamics.root_note:
        return True
    root = residuals(results.model, torques)
    net = np.linalg.norm(np.nan_to_num(wrenches.forces).sum(axis=1), axis=1)
    peak = float(net.max(initial=0.0))
    if root is None or peak <= 0.0:
        return True
    inside = (time >= span[0]) & (time <= span[1])
    force_size, moment_size = root
    force = float(np.sqrt(np.mean(force_size[inside] ** 2)))
    moment = float(np.sqrt(np.mean(moment_size[inside] ** 2)))
    height = prepared.center_height
    within = force <= RESIDUAL_FORCE * peak
    return bool(within and (not height > 0.0 or moment <= RESIDUAL_MOMENT * peak * height))

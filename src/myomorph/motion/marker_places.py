"""Markers that lie beside their place on the model, as one that was moved or put on the wrong side of a bone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.findings import Finding
from myomorph.model.model import Model
from myomorph.model.series import Markers
from myomorph.model.sides import mirror_names
from myomorph.motion.ik import KinematicsFit
from myomorph.motion.marker_influence import left_out, marker_frames
from myomorph.motion.pose_problem import PoseProblem
from myomorph.rigid.tree import compile_tree

OFF = 0.035
"""Distance from where all others put a marker, from which it is beside its place, on a human body [m]."""

USUAL = 4.0
"""That distance is at least so many times that of the median marker: on a generic model all lie off their places."""

MIDDLE = 0.055
"""The same of a marker without one on the other side to compare with: sacral markers are often 4 cm off [m]."""

STEADY = 0.6
"""Largest share that may change over time: skin and a wrong joint move a marker to and fro."""

ALIKE = 0.5
"""A marker of the other side that is as far off by this share shows that the model, not the marker, is off."""

MAX_COUNT, SAMPLES = 4, 20


def place_findings(
    model: Model, markers: Markers, fit: KinematicsFit, problem: PoseProblem, unit: float
) -> Iterator[Finding]:
    """Markers that lie steadily off the place where all others put them, while those of the other side do not."""
    seen = np.flatnonzero(fit.seen)
    if len(seen) < 3 or len(fit.marker_names) < 6:
        return
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, SAMPLES).astype(int))]
    columns = [markers.names.index(name) for name in fit.marker_names]
    frames = marker_frames(compile_tree(model), problem, markers.values[chosen][:, columns], fit.motion.values[chosen])
    weight = np.array(problem.markers.weight, np.float64)
    partner = mirror_names(fit.marker_names)
    for _ in range(MAX_COUNT):
        away, spread = _steady(left_out(frames, weight))
        size = np.linalg.norm(away, axis=1)
        compared = np.isfinite(size) & (weight > 0.0)
        if compared.sum() < 6:
            return
        limit = max(OFF * unit, USUAL * float(np.median(size[compared])))
        order = [i for i in np.argsort(-np.nan_to_num(size)) if compared[i]]
        worst = order[0]
        if size[worst] < limit:
            return
        name = fit.marker_names[worst]
        # What the others say of the next is clearer without this one.
        weight[worst] = 0.0
        other = fit.marker_names.index(partner[name]) if name in partner else -1
        if other >= 0 and size[other] > ALIKE * size[worst]:
            weight[other] = 0.0
            continue
        if spread[worst] > STEADY * size[worst] or (other < 0 and size[worst] < MIDDLE * unit):
            continue
        beside = f", '{partner[name]}' {100 * size[other]:.1f} cm" if other >= 0 else ""
        usual = 100 * float(np.median(size[compared]))
        text = (
            f"marker '{name}' lies {100 * size[worst]:.1f} cm from where all others put it on "
            f"'{model.marker(name).body}' (median of all {usual:.1f} cm{beside}): was it moved, or placed elsewhere "
            "than on the model? Leave it out (weight 0 in --tasks, or an empty name in --labels) or calibrate the model"
        )
        yield Finding("displaced marker", name, text)


def _steady(away: Array) -> tuple[Array, Array]:
    """Mean over frames (markers, 3), and the root mean square of what changes (markers,) [m]."""
    known: np.ndarray = np.asarray(np.isfinite(away).all(axis=2))
    count = known.sum(axis=0)
    some = np.where(known[:, :, None], away, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = some.sum(axis=0) / count[:, None]
        square = (np.where(known[:, :, None], away - mean, 0.0) ** 2).sum(axis=(0, 2)) / count
    mean[count < 0.5 * len(away)] = np.nan
    return mean, np.sqrt(square)

"""Which frames show most of a body, and how large it is before anything else is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Markers
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.motion.lengths import length_unit, segments_that_stretch
from myomorph.motion.measurements import default_markers
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

CANDIDATES = 1000
"""At most so many frames of all recordings are looked at."""

SAME_POSTURE = 0.01
"""Frames whose markers lie nearer to each other than this, root mean square, show the same posture [length units]."""

SHORTEST = 0.05
"""Markers nearer to each other than this say nothing of a body's size [length units]."""

UNITS = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "kilometres"))


def overall_size(model: Model, names: Sequence[str], recordings: Sequence[Array]) -> float:
    """Size of a recorded body relative to the model: weighted median of the distances within segments. Distances
    between markers of one segment do not change with posture. Each counts by its square on the model; where no segment
    has two markers, all distances to the markers' middle take their place.
    """
    marked, usual = [model.marker(name) for name in names], default_markers(model, names)
    segment = {body: number for number, group in enumerate(segments_that_stretch(model)) for body in group}
    ratios, weights = [], []
    shortest = SHORTEST * length_unit(compile_tree(model))
    for i, marker in enumerate(marked):
        for j in range(i):
            distance = float(np.linalg.norm(usual[i] - usual[j]))
            if segment[marker.body] != segment[marked[j].body] or distance < shortest:
                continue
            seen = np.concatenate([np.linalg.norm(part[:, i] - part[:, j], axis=1) for part in recordings])
            if np.isfinite(seen).any():
                ratios.append(float(np.nanmedian(seen)) / distance)
                weights.append(distance**2)
    if not ratios:
        ratios, weights = [_spread(recordings, usual, shortest)], [1.0]
    order = np.argsort(ratios)
    reached = np.cumsum(np.array(weights)[order])
    size = float(np.array(ratios)[order][np.searchsorted(reached, 0.5 * reached[-1])])
    if not 0.2 < size < 5.0:
        guess = next((unit for factor, unit in UNITS if 0.2 < size / factor < 5.0), "")
        raise BadData(
            f"the recorded markers lie {size:.3g} times as far apart as those of model '{model.name}'; "
            + (f"are the numbers {guess}? Positions are expected in metres" if guess else "do they belong together?")
        )
    return size


def _spread(recordings: Sequence[Array], usual: Array, shortest: float) -> float:
    """Extent of all markers relative to the model's, 1 where there is none."""
    expected = float(np.linalg.norm(usual - usual.mean(axis=0)))
    full = [part[np.isfinite(part).all(axis=(1, 2))] for part in recordings]
    seen = np.concatenate(full)
    if not len(seen) or expected < shortest:
        return 1.0
    return float(np.median(np.linalg.norm(seen - seen.mean(axis=1, keepdims=True), axis=(1, 2)))) / expected


def spread_postures(
    model: Model, trials: Sequence[Markers], options: InverseKinematicsOptions, frames: int, static: bool = False
) -> tuple[tuple[Ints, Array], ...]:
    """Chosen frames, ascending, of all recordings whose postures differ most, and the coordinates in them.

    A posture is where the model's markers lie seen from its first body, after inverse kinematics. The first frame is
    the one nearest to the mean posture (of a last recording that is `static`, if any); then follows the frame farthest
    from all those chosen, until none differs by `SAME_POSTURE`: a second frame of a posture shows the same skin and the
    same errors of the model, so it must not count as evidence. Frames that fit three times worse than usual or show
    fewer than half the markers are not chosen, and of long recordings only `CANDIDATES` frames, evenly spaced, are
    looked at.
    """
    total = sum(len(trial) for trial in trials)
    stride = max(1, -(-total // max(CANDIDATES, 2 * frames)))
    tree = compile_tree(model)
    looked, coordinates, places, misfit, shown = [], [], [], [], []
    for number, trial in enumerate(trials):
        every = np.arange(0, len(trial), stride)
        fit = inverse_kinematics(model, Markers(trial.time[every], trial.names, trial.values[every]), options)
        values = fit.motion.values
        seen = np.isfinite(values).all(axis=1)
        looked += [(number, int(frame)) for frame in every[seen]]
        coordinates.append(values[seen])
        places.append(_seen_from_base(model, values[seen]))
        misfit.append(fit.rms[seen])
        shown.append(np.isfinite(fit.errors[seen]).sum(axis=1))
    table, error, count = np.concatenate(places), np.concatenate(misfit), np.concatenate(shown)
    good = (error <= 3.0 * np.median(error)) & (count >= 0.5 * count.max())
    usable = np.flatnonzero(good)
    still = np.array([looked[place][0] == len(trials) - 1 for place in usable])
    first = still if static and still.any() else np.ones(len(usable), np.bool_)
    chosen = _farthest(table, usable, frames, first, SAME_POSTURE * length_unit(tree))
    q = np.concatenate(coordinates)
    taken = []
    for number in range(len(trials)):
        rows = [place for place in sorted(chosen) if looked[place][0] == number]
        taken.append((np.array([looked[row][1] for row in rows], np.int64), q[rows].reshape(-1, len(tree.defaults))))
    return tuple(taken)


def _seen_from_base(model: Model, values: Array) -> Array:
    """(frames, 3 markers) places of the model's markers in the frame of its first body [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    local = np.einsum("fji,fmj->fmi", poses.rotations[:, 1], poses.markers(model.markers) - poses.origins[:, 1, None])
    return local.reshape(len(values), -1)


def _farthest(table: Array, usable: Ints, count: int, first: NDArray[np.bool_], same: float) -> list[int]:
    """Rows chosen one by one, each as far as can be from those before, none within `same` of one [m RMS]; the first of
    some.
    """
    points = table[usable]
    least = same**2 * table.shape[1] / 3.0
    middle = ((points - points[first].mean(axis=0)) ** 2).sum(axis=1)
    chosen = [int(np.argmin(np.where(first, middle, np.inf)))]
    nearest = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < count and nearest.max() > least:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    return [int(usable[place]) for place in chosen]

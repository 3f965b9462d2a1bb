"""Size of a recorded body relative to a model, before anything else is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.motion.lengths import length_unit, segments_that_stretch
from myomorph.core.motion.measurements import default_markers
from myomorph.core.rigid.tree import compile_tree

# Markers nearer to each other than this say nothing of a body's size [length units]
SHORTEST = 0.05


UNITS = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "kilometres"))


def overall_size(model: Model, names: Sequence[str], recordings: Sequence[Array]) -> float:
    """Estimate the size of a recorded body relative to the model.

    The weighted median of recorded / model distance, over pairs of markers of one segment, whose
    distances do not change with posture. Each counts by its square on the model. Where no segment
    has two markers, all distances to the markers' middle take their place.

    Parameters
    ----------
    model : of any size, with these markers
    names : of the markers
    recordings : each (frames, markers, 3) in the order of the names [m], NaN where hidden

    Returns
    -------
    factor of all lengths [-]

    Raises
    ------
    BadData : a size below 0.2 or above 5, as of positions that are not in metres
    """
    ratios, weights = distance_ratios(model, names, recordings)
    if not len(ratios):
        usual = default_markers(model, names)
        shortest = SHORTEST * length_unit(compile_tree(model))
        ratios = np.array([_spread(recordings, usual, shortest)])
        weights = np.ones(1)
    order = np.argsort(ratios)
    reached = np.cumsum(weights[order])
    size = float(ratios[order][np.searchsorted(reached, 0.5 * reached[-1])])
    if not 0.2 < size < 5.0:
        guess = next((unit for factor, unit in UNITS if 0.2 < size / factor < 5.0), "")
        raise BadData(
            f"the recorded markers lie {size:.3g} times as far apart as those of model"
            f" '{model.name}'; "
            + (
                f"are the numbers {guess}? Positions are expected in metres"
                if guess
                else "are they of the same person?"
            )
        )
    return size


def distance_ratios(
    model: Model, names: Sequence[str], recordings: Sequence[Array]
) -> tuple[Array, Array]:
    """Compare distances between markers of one segment with those of the model.

    Parameters
    ----------
    model : of any size, with these markers
    names : of the markers
    recordings : each (frames, markers, 3) in the order of the names [m], NaN where hidden

    Returns
    -------
    (pairs,) recorded over model distance [-], and (pairs,) the square of that of the model [m^2];
    of pairs that are seen together, and not too near to each other
    """
    marked = [model.marker(name) for name in names]
    usual = default_markers(model, names)
    segment = {
        body: number for number, group in enumerate(segments_that_stretch(model)) for body in group
    }
    ratios: list[float] = []
    weights: list[float] = []
    shortest = SHORTEST * length_unit(compile_tree(model))
    for i, marker in enumerate(marked):
        for j in range(i):
            distance = float(np.linalg.norm(usual[i] - usual[j]))
            if segment[marker.body] != segment[marked[j].body] or distance < shortest:
                continue
            seen = np.concatenate(
                [np.linalg.norm(part[:, i] - part[:, j], axis=1) for part in recordings]
            )
            if np.isfinite(seen).any():
                ratios.append(float(np.nanmedian(seen)) / distance)
                weights.append(distance**2)
    return np.array(ratios), np.array(weights)


def _spread(recordings: Sequence[Array], usual: Array, shortest: float) -> float:
    """Compare the extent of all markers with the model's.

    Parameters
    ----------
    recordings : each (frames, markers, 3) [m], NaN where hidden
    usual : (markers, 3) in the model's default pose [m]
    shortest : extent below which a model shows nothing [m]

    Returns
    -------
    [-]; 1 where no frame shows all markers
    """
    expected = float(np.linalg.norm(usual - usual.mean(axis=0)))
    full = [part[np.isfinite(part).all(axis=(1, 2))] for part in recordings]
    seen = np.concatenate(full)
    if not len(seen) or expected < shortest:
        return 1.0
    return (
        float(np.median(np.linalg.norm(seen - seen.mean(axis=1, keepdims=True), axis=(1, 2))))
        / expected
    )

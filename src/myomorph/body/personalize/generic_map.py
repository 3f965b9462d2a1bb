"""Fiber and tendon lengths of a scaled model whose muscles work as the generic model's.

Modenese et al. 2016: in many poses within the joints' ranges a muscle of the generic model, fully
active and in equilibrium with its tendon, has normalized fiber and tendon lengths x and t; the
scaled model's path L should give the same ones,

    L = lo (x cos(alpha)) + ls t,

which is a linear least-squares problem for lo and ls of each muscle. Poses are spread evenly over
the ranges of all coordinates together, so that one set of paths serves every muscle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from myomorph.body.personalize.fibers import follow, muscle_shapes
from myomorph.body.personalize.prior import sizes_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import Model
from myomorph.core.muscles.path import compile_paths
from myomorph.core.tension.terms.actuators import balanced_coordinates

POSES = 1024
# Normalized fiber lengths of the generic model's poses that count, as in the source
REACH = (0.5, 1.5)
MIN_COUNT = 10


@read_only
class GenericMap:
    """A scaled model whose muscles work where the generic model's do.

    Attributes
    ----------
    model : with optimal fiber and tendon slack lengths mapped
    muscles : names of those that were mapped
    poses : (muscles,) poses that counted
    before, after : (muscles,) root mean square difference of normalized fiber lengths from the
        generic model's, with the scaled model's own lengths and with the mapped ones
    notes : muscles that could not be mapped and why, one line each
    """

    model: Model
    muscles: tuple[str, ...]
    poses: Array
    before: Array
    after: Array
    notes: tuple[str, ...]


def map_generic(generic: Model, scaled: Model, poses: int = POSES) -> GenericMap:
    """Map the operating ranges of a generic model's muscles onto a scaled model.

    Source: Modenese et al. 2016, J Biomech 49:141-148; the equation is at the head of this file.

    Parameters
    ----------
    generic : the model that was scaled
    scaled : with muscles of the same names
    poses : number of poses

    Returns
    -------
    the scaled model with mapped lengths, and how well they fit

    Raises
    ------
    BadModel : the models have no muscle in common
    """
    names = tuple(name for name in scaled.muscle_names if name in generic.muscle_names)
    if not names:
        some = ", ".join(generic.muscle_names[:3])
        raise BadModel(
            f"model '{scaled.name}' has no muscle of the generic model '{generic.name}' ({some}"
            " ...)"
        )
    reference, own = _lengths(generic, scaled, poses)
    shapes = muscle_shapes(generic)
    sizes = sizes_of(generic)
    x = _active_lengths(generic, reference)
    w = np.sqrt(np.maximum(x**2 - shapes.sine**2, 0.0))
    tendon = np.where(
        shapes.rigid, 1.0, (reference - sizes.fiber * w) / np.maximum(sizes.slack, 1e-9)
    )
    before = _active_lengths(scaled, own)
    others = (name for name in scaled.muscle_names if name not in names)
    notes = [
        f"muscle '{name}' is not in the generic model: it keeps its lengths" for name in others
    ]
    muscles = list(scaled.muscles)
    counts = np.zeros(len(names))
    pick = (
        [generic.muscle_names.index(name) for name in names],
        [scaled.muscle_names.index(name) for name in names],
    )
    for index, (name, g, m) in enumerate(zip(names, *pick, strict=True)):
        good = (
            (x[:, g] > REACH[0])
            & (x[:, g] < REACH[1])
            & (tendon[:, g] >= 0.98)
            & np.isfinite(own[:, m])
        )
        counts[index] = good.sum()
        if counts[index] < MIN_COUNT:
            notes.append(
                f"muscle '{name}': its fibers work between {REACH[0]:g} and {REACH[1]:g} optimal"
                f" lengths in {int(counts[index])} of {poses} poses of the generic model: it keeps"
                " its lengths"
            )
            continue
        lo, ls = _least_squares(
            w[good, g], tendon[good, g], own[good, m], sizes.fiber[g], sizes.slack[g]
        )
        if not (lo > 0.0 and ls > 0.0):
            notes.append(
                f"muscle '{name}': no positive lengths map its poses: it keeps its lengths"
            )
            continue
        muscles[m] = replace(muscles[m], optimal_fiber_length=lo, tendon_slack_length=ls)
    mapped = replace(scaled, muscles=tuple(muscles))
    after = _active_lengths(mapped, own)
    counted = (x[:, pick[0]] > REACH[0]) & (x[:, pick[0]] < REACH[1])
    error = [
        np.where(counted, values[:, pick[1]] - x[:, pick[0]], np.nan) for values in (before, after)
    ]
    shown = [
        np.sqrt(np.nansum(item**2, axis=0) / np.maximum(counted.sum(axis=0), 1)) for item in error
    ]
    return GenericMap(
        model=mapped,
        muscles=names,
        poses=counts,
        before=shown[0],
        after=shown[1],
        notes=tuple(notes),
    )


def _least_squares(
    w: Array, t: Array, length: Array, fiber: float, slack: float
) -> tuple[float, float]:
    """Solve for optimal and slack length of one muscle.

    Where its path hardly varies, they keep the generic model's proportion.

    Parameters
    ----------
    w, t : (poses,) normalized fiber length along the tendon, and tendon length, of the generic
        model
    length : (poses,) of the scaled model's path [m]
    fiber, slack : of the generic model [m]

    Returns
    -------
    lo and ls [m]
    """
    A = np.column_stack([w, t])
    if np.ptp(length) < 0.01 * fiber or np.linalg.cond(A / np.linalg.norm(A, axis=0)) > 1e4:
        factor = float(np.mean(length) / np.mean(fiber * w + slack * t))
        return factor * fiber, factor * slack
    (lo, ls), _ = scipy.optimize.nnls(A, length)
    return float(lo), float(ls)


def _lengths(generic: Model, scaled: Model, poses: int) -> tuple[Array, Array]:
    """Compute path lengths of both models in the same poses.

    Returns
    -------
    (poses, muscles) of each [m]
    """
    shared = [
        coordinate
        for coordinate in balanced_coordinates(generic)
        if coordinate in scaled.coordinate_names
    ]
    ranges = {coordinate.name: coordinate.range for coordinate in generic.coordinates}
    unit = (
        scipy.stats.qmc.Halton(len(shared), scramble=False).random(poses)
        if shared
        else np.zeros((poses, 0))
    )
    results = []
    for model in (generic, scaled):
        c = np.tile([coordinate.default for coordinate in model.coordinates], (poses, 1))
        for index, name in enumerate(shared):
            low, high = ranges[name]
            if np.isfinite(low) and np.isfinite(high):
                c[:, model.coordinate_names.index(name)] = low + unit[:, index] * (high - low)
        results.append(compile_paths(model).evaluate(c)[0])
    return results[0], results[1]


def _active_lengths(model: Model, lengths: Array) -> Array:
    """Compute normalized fiber lengths of fully active muscles in equilibrium.

    Parameters
    ----------
    lengths : (poses, muscles) of the paths [m]

    Returns
    -------
    (poses, muscles)
    """
    active = np.ones_like(lengths)[None]
    return follow(
        muscle_shapes(model), sizes_of(model), lengths[None], 0.0 * active, active, np.inf
    ).length[0]

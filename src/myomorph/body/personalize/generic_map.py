"""Fiber and tendon lengths of a scaled model whose muscles work as the generic model's.

Modenese et al. 2016: in many poses within the joints' ranges a muscle of the generic model, fully
active and in equilibrium with its tendon, has normalized fiber and tendon lengths x and t; the
scaled model's path L should give the same ones,

    L = lo (x cos(alpha)) + ls t,

which is a linear least-squares problem for lo and ls of each muscle. Poses are spread evenly over
the ranges of all coordinates together, so that one set of paths serves every muscle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.causes import COUNTERPARTS, PERSONAL_MUSCLES
from myomorph.body.personalize.fiber_kernel import Paths
from myomorph.body.personalize.fibers import follow
from myomorph.body.personalize.muscle_curves import muscle_shapes
from myomorph.body.personalize.prior import sizes_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadModel
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.hill import muscle_model
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.tension.terms.actuators import balanced_coordinates

POSES = 1024
# Normalized fiber lengths of the generic model's poses that count, as in the source
REACH = (0.5, 1.5)
MIN_TENDON = 0.98  # Normalized length of a tendon that carries
MIN_COUNT = 10  # Poses


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
    notes: tuple[Message, ...]


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
    working = _working(generic, reference)
    of_generic = [generic.muscle_names.index(name) for name in names]
    of_scaled = [scaled.muscle_names.index(name) for name in names]
    maps = [
        _mapped(working, g, generic.muscles[g], own[:, m])
        for g, m in zip(of_generic, of_scaled, strict=True)
    ]
    model = _with_lengths(scaled, dict(zip(of_scaled, maps, strict=True)))
    wanted = working.length[:, of_generic]
    before = _active_lengths(scaled, own)[:, of_scaled]
    after = _active_lengths(model, own)[:, of_scaled]
    alone = [name for name in scaled.muscle_names if name not in names]
    notes = [
        COUNTERPARTS.message(f"muscle '{name}' is not in the generic model: it keeps its lengths")
        for name in alone
    ]
    return GenericMap(
        model=model,
        muscles=names,
        poses=np.array([mapped.poses for mapped in maps], np.float64),
        before=_rms_difference(before, wanted),
        after=_rms_difference(after, wanted),
        notes=(*notes, *(mapped.note for mapped in maps if mapped.note)),
    )


def _with_lengths(scaled: Model, maps: Mapping[int, _Mapped]) -> Model:
    """Give muscles, by their number, the lengths that were found."""
    muscles = list(scaled.muscles)
    for m, mapped in maps.items():
        if not mapped.note:
            muscles[m] = replace(
                muscles[m], optimal_fiber_length=mapped.fiber, tendon_slack_length=mapped.slack
            )
    return replace(scaled, muscles=tuple(muscles))


class _Working(NamedTuple):
    """Where fully active muscles of the generic model work, (poses, muscles) each.

    Attributes
    ----------
    length : normalized fiber length
    along : the same along the tendon
    tendon : normalized tendon length
    """

    length: Array
    along: Array
    tendon: Array


def _working(generic: Model, lengths: Array) -> _Working:
    """Bring all muscles to equilibrium in all poses.

    Parameters
    ----------
    lengths : (poses, muscles) of the paths [m]
    """
    shapes = muscle_shapes(generic)
    sizes = sizes_of(generic)
    x = _active_lengths(generic, lengths)
    along = np.sqrt(np.maximum(x**2 - shapes.sine**2, 0.0))
    stretched = (lengths - sizes.fiber * along) / np.maximum(sizes.slack, 1e-9)
    return _Working(length=x, along=along, tendon=np.where(shapes.rigid, 1.0, stretched))


class _Mapped(NamedTuple):
    """Lengths of one muscle [m], the poses that counted, and why it keeps its lengths, if so."""

    fiber: float
    slack: float
    poses: int
    note: Message | None = None


def _mapped(working: _Working, g: int, muscle: Muscle, path: Array) -> _Mapped:
    """Find the lengths of one muscle.

    Parameters
    ----------
    working : of the generic model
    g : number of the muscle there
    muscle : of the generic model
    path : (poses,) of the scaled model [m]
    """
    low, high = REACH
    x = working.length[:, g]
    tendon = working.tendon[:, g]
    good = (x > low) & (x < high) & (tendon >= MIN_TENDON) & np.isfinite(path)
    poses = int(good.sum())
    if poses < MIN_COUNT:
        unused = PERSONAL_MUSCLES.message(
            f"muscle '{muscle.name}': its fibers work between {low:g} and {high:g} optimal"
            f" lengths in {poses} of {len(path)} poses of the generic model: it keeps its lengths"
        )
        return _Mapped(fiber=np.nan, slack=np.nan, poses=poses, note=unused)
    sizes = muscle_model(muscle).sizes(muscle)
    lo, ls = _least_squares(
        working.along[good, g], tendon[good], path[good], sizes.fiber, sizes.tendon
    )
    note: Message | None = None
    if not (lo > 0.0 and ls > 0.0):
        note = PERSONAL_MUSCLES.message(
            f"muscle '{muscle.name}': no positive lengths map its poses: it keeps its lengths"
        )
    return _Mapped(fiber=lo, slack=ls, poses=poses, note=note)


def _rms_difference(lengths: Array, wanted: Array) -> Array:
    """Compute by how much normalized lengths differ where the wanted ones count.

    Parameters
    ----------
    lengths, wanted : (poses, muscles)

    Returns
    -------
    (muscles,) root mean square over poses
    """
    low, high = REACH
    counted = (wanted > low) & (wanted < high)
    error = np.where(counted, lengths - wanted, np.nan)
    return np.sqrt(np.nansum(error**2, axis=0) / np.maximum(counted.sum(axis=0), 1))


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
    free = balanced_coordinates(generic)
    shared = [coordinate for coordinate in free if coordinate in scaled.coordinate_names]
    ranges = {coordinate.name: coordinate.range for coordinate in generic.coordinates}
    unit = np.zeros((poses, 0))
    if shared:
        unit = scipy.stats.qmc.Halton(len(shared), scramble=False).random(poses)
    results = []
    for model in (generic, scaled):
        values = np.tile([coordinate.default for coordinate in model.coordinates], (poses, 1))
        for share, name in zip(unit.T, shared, strict=True):
            low, high = ranges[name]
            if np.isfinite(low) and np.isfinite(high):
                values[:, model.coordinate_names.index(name)] = low + share * (high - low)
        results.append(compile_paths(model).evaluate(values)[0])
    of_generic, of_scaled = results
    return of_generic, of_scaled


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
    paths = Paths(lengths=lengths[None], speeds=0.0 * active, activations=active, step=np.inf)
    return follow(muscle_shapes(model), sizes_of(model), paths).length[0]

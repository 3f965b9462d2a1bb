"""Passes of an animal through the capture volume: parts of a recording worth using."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.lengths import coordinate_units
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.tree import Tree, compile_tree

Bools = NDArray[np.bool_]

STEP = 1e-6  # Of the differences by which coordinates move markers, in units of the coordinates
# How far joints are bent from the default pose, where straight limbs hide what their markers show
# [rad]
BENT = 0.2
SEEN_AT_ALL = 1e-3
"""A direction of the coordinates is shown that moves markers by this share of what the strongest
one does.
"""


@dataclass(frozen=True)
class CrossingOptions:
    """Which frames show enough, and how they are joined.

    Attributes
    ----------
    only : use only the passes through the capture volume, in which enough markers are visible
    min_visible : minimum visible share of a frame in a pass: independent directions of the
        coordinates that its markers determine, relative to all markers of the model; without a
        model, share of the markers
    max_gap : longest gap in a pass that is bridged [s]
    min_duration : shortest pass that is used [s]
    """

    SETTING_PREFIX: ClassVar[str] = "passes_"

    only: bool = False
    min_visible: float = 0.75
    max_gap: float = 0.1
    min_duration: float = 0.2

    def __post_init__(self) -> None:
        if not 0.0 < self.min_visible <= 1.0:
            raise BadData(
                f"passes: min_visible is {self.min_visible:g}; expected a share above 0, 1 at most"
            )
        if not (self.max_gap >= 0.0 and self.min_duration >= 0.0):
            raise BadData(
                f"passes: max_gap {self.max_gap:g} s, min_duration {self.min_duration:g} s:"
                " expected 0 or more"
            )


def crossings(
    markers: Markers, model: Model | None = None, options: CrossingOptions | None = None
) -> tuple[tuple[float, float], ...]:
    """Start and end [s] of every part of a recording in which enough markers are seen.

    With J(S) the derivatives of the places of the markers S in the model's free coordinates,
    slightly bent from its default pose, a frame that sees S shows rank J(S) / rank J(all that are
    ever seen).

    Parameters
    ----------
    markers : as recorded, NaN where a marker is hidden [m]
    model : whose coordinates are to be shown; None counts markers
    options : which frames show enough, times [s]; see `CrossingOptions`

    Returns
    -------
    (start, end) [s] of each part, in order

    Raises
    ------
    BadData : model and recording share no marker

    Examples
    --------
    >>> import myomorph as mm
    >>> mm.crossings(mm.read_recording("reach.trc").markers)
    ((0.0, 0.6),)
    """
    options = options or CrossingOptions()
    return _parts(markers.time, shown_shares(markers, model), options.min_visible, options)


class Passes(NamedTuple):
    """Parts of a recording, (start, end) of each [s], and the share that their frames show."""

    spans: tuple[tuple[float, float], ...]
    share: float


def best_crossings(
    markers: Markers, model: Model | None = None, options: CrossingOptions | None = None
) -> Passes:
    """Find the parts of a recording in which enough markers are seen, else those that show most.

    Where no part shows the share that is wanted, it falls to the largest one that some part of the
    shortest duration shows.

    Parameters
    ----------
    markers : as recorded, NaN where a marker is hidden [m]
    model : whose coordinates are to be shown; None counts markers
    options : which frames show enough, times [s]; see `CrossingOptions`

    Returns
    -------
    the parts, none of them where no part of that duration shows anything

    Raises
    ------
    BadData : model and recording share no marker
    """
    options = options or CrossingOptions()
    shares = shown_shares(markers, model)
    below = [share for share in np.unique(shares) if 0.0 < share < options.min_visible]
    for share in (options.min_visible, *reversed(below)):
        spans = _parts(markers.time, shares, float(share), options)
        if spans:
            return Passes(spans=spans, share=float(share))
    return Passes(spans=(), share=0.0)


def _parts(
    time: Array, shares: Array, share: float, options: CrossingOptions
) -> tuple[tuple[float, float], ...]:
    """Start and end [s] of the parts of frames, at times (frames,), that show a share."""
    return tuple(
        (float(time[start]), float(time[stop - 1]))
        for start, stop in _joined(shares >= share - 1e-9, time, options)
    )


def within_crossings(markers: Markers, spans: tuple[tuple[float, float], ...]) -> Markers:
    """Hide markers outside of some spans of time.

    Parameters
    ----------
    markers : positions over time [m]
    spans : (start, end) of each span [s], as `crossings` gives them

    Returns
    -------
    markers (frames, markers, 3) [m], NaN outside of the spans

    Raises
    ------
    BadData : the changed recording is none, as without frames

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> markers = mm.within_crossings(mm.read_recording("reach.trc").markers, ((0.0, 0.2),))
    >>> int(np.isfinite(markers.values).all(axis=(1, 2)).sum())
    21
    """
    inside = np.zeros(len(markers), np.bool_)
    for start, end in spans:
        inside |= (markers.time >= start - 1e-9) & (markers.time <= end + 1e-9)
    return replace(markers, values=np.where(inside[:, None, None], markers.values, np.nan))


def shown_shares(markers: Markers, model: Model | None = None) -> Array:
    """Compute the share of what could be determined that the markers of each frame determine.

    With J(S) the derivatives of the positions of the markers S in the model's free coordinates,

        rank J(seen in the frame) / rank J(seen in any frame)

    Parameters
    ----------
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    model : whose coordinates are to be shown; None counts markers

    Returns
    -------
    (frames,) from 0 to 1

    Raises
    ------
    BadData : model and recording share no marker
    """
    seen = np.asarray(np.isfinite(markers.values).all(axis=2))
    if model is None:
        ever = int(seen.any(axis=0).sum())
        return np.asarray(seen.sum(axis=1) / max(ever, 1), np.float64)
    names = [name for name in model.marker_names if name in markers.names]
    if not names:
        raise BadData(f"model '{model.name}' and the recording share no marker")
    seen = seen[:, [markers.names.index(name) for name in names]]
    slopes = marker_slopes(compile_tree(model), names)
    patterns, of_frame = np.unique(seen, axis=0, return_inverse=True)
    ranks = np.array([_rank(slopes[pattern]) for pattern in patterns])
    most = _rank(slopes[seen.any(axis=0)])
    return np.asarray(ranks / max(most, 1), np.float64)[of_frame.reshape(-1)]


def marker_slopes(tree: Tree, names: list[str]) -> Array:
    """Differentiate marker positions in the free coordinates.

    By central differences, at a pose with all joints slightly bent, because straight limbs would
    hide what their markers show.

    Parameters
    ----------
    tree : the compiled model
    names : of the markers

    Returns
    -------
    (markers, 3, free coordinates) movement for each coordinate's unit [m]
    """
    model = tree.model
    free = free_coordinates(tree)
    units = coordinate_units(tree)
    pose = tree.defaults.copy()
    for j in free:
        lower, upper = (
            model.coordinates[j].range if model.coordinates[j].clamped else (-np.inf, np.inf)
        )
        if model.coordinates[j].motion == "rotational":
            bent = pose[j] + BENT
            pose[j] = bent if bent <= upper else max(pose[j] - BENT, lower)
    steps = np.zeros((len(free), len(pose)))
    steps[np.arange(len(free)), free] = STEP * units[free]
    values = np.concatenate([pose + steps, pose - steps])
    motion = Motion(np.arange(len(values), dtype=np.float64), model.coordinate_names, values)
    values = tree.coordinates_of(motion)
    poses = forward_kinematics(tree, values)
    places = poses.markers([model.marker(name) for name in names])
    ahead = places[: len(free)]
    behind = places[len(free) :]
    return (ahead - behind).transpose(1, 2, 0) / (2.0 * STEP)


def _rank(slopes: Array) -> int:
    """Count the independent directions of the coordinates that markers show.

    Parameters
    ----------
    slopes : (markers, 3, free coordinates) [m]
    """
    if not slopes.size:
        return 0
    sizes = np.linalg.svd(slopes.reshape(-1, slopes.shape[-1]), compute_uv=False)
    return int(np.count_nonzero(sizes > SEEN_AT_ALL * sizes[0])) if sizes[0] > 0.0 else 0


def _joined(enough: Bools, time: Array, options: CrossingOptions) -> list[tuple[int, int]]:
    """Join spans of frames that show enough.

    Parameters
    ----------
    enough : (frames,) whether a frame shows enough
    time : (frames,) [s]
    options : longest gap to bridge, shortest part to keep

    Returns
    -------
    frames [start, stop) of each part
    """
    spans = runs(enough)
    if not spans:
        return []
    joined = [spans[0]]
    for (_, before), (start, stop) in pairwise(spans):
        if time[start] - time[before - 1] <= options.max_gap + 1e-9:
            joined[-1] = (joined[-1][0], stop)
        else:
            joined.append((start, stop))
    return [
        (start, stop)
        for start, stop in joined
        if time[stop - 1] - time[start] >= options.min_duration - 1e-9
    ]

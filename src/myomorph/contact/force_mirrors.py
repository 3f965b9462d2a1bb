"""Plates of treadmills that are mirrored about their own middle, told apart from forces on the wrong foot.

A mirrored center of pressure goes forwards while the foot is carried backwards by the belt, and so it passes near the
other foot, which swings forwards meanwhile. What tells them apart is that a foot under load moves as the belt does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.foot_stance import belt_velocity, standing
from myomorph.contact.force_inspection import Inspection
from myomorph.contact.force_placement import FITS, MARKED, NEAR
from myomorph.model.arrays import Array

STANDS = 0.6
"""Share of its load during which a foot that carries it stands."""

STEPS = 3
"""Steps on a belt from which on both ways are judged."""

CLEARER = 0.6
"""Of two explanations the one that leaves so much less of the distance is the right one."""

DOUBTFUL = "wrong foot or mirrored plate"


class Mirror(NamedTuple):
    """A reflection of the points of a plate.

    Attributes
    ----------
    axes : horizontal directions that are reversed (axes, 3)
    middle : that stays where it is, along each of the axes [m]
    distance : of the centers of pressure to the feet that carry them afterwards, mean [m]
    """

    axes: Array
    middle: Array
    distance: float


def check_mirrors(inspection: Inspection) -> None:
    """Forces of belts whose center of pressure lies under the foot that they are put on only when it is mirrored."""
    if not np.any(belt_velocity(inspection)):
        return
    stands = standing(inspection)
    for number in map(int, inspection.numbers):
        weights = inspection.weights(number)
        if len(inspection.episodes(number)) < STEPS:
            continue
        feet = inspection.feet
        owner = feet.owners.get(inspection.wrenches.bodies[number])
        carriers = _carriers(stands, owner)
        centers = inspection.samples.centers(feet.up)[:, number]
        before = _distance(inspection, centers, carriers, weights)
        if before < NEAR * feet.unit:
            continue
        exchanged = np.inf
        if owner is not None:
            others = stands.copy()
            others[:, owner] = False
            if _share(np.asarray(others.any(axis=1)), weights) > STANDS:
                exchanged = _distance(inspection, centers, others, weights)
        result = _mirror(inspection, centers, carriers, weights)
        fits = _share(_stands(stands, owner), weights) > STANDS
        if not fits or result.distance > min(FITS * feet.unit, MARKED * before):
            continue
        if result.distance < CLEARER * exchanged:
            _mirrored(inspection, number, result, before)
        elif exchanged > CLEARER * result.distance:
            _doubtful(inspection, number, result, exchanged)


def _carriers(stands: NDArray[np.bool_], own: int | None) -> NDArray[np.bool_]:
    """Feet (frames, feet) that may carry a force: the one it is put on, else those that stand."""
    if own is None:
        return stands
    result = np.zeros_like(stands)
    result[:, own] = True
    return result


def _stands(stands: NDArray[np.bool_], own: int | None) -> NDArray[np.bool_]:
    return np.asarray(stands.any(axis=1) if own is None else stands[:, own])


def _share(frames: NDArray[np.bool_], weights: Array) -> float:
    """Share of a load that acts in some frames."""
    return float(weights[frames].sum() / weights.sum())


def _distance(inspection: Inspection, centers: Array, carriers: NDArray[np.bool_], weights: Array) -> float:
    """Mean distance of centers of pressure (frames, 3) to the nearest foot that may carry them [m]."""
    distances = np.nan_to_num(inspection.feet.distances(centers[:, None])[:, 0], nan=9.0)
    nearest = np.where(carriers, distances, np.inf).min(axis=1)
    known = np.isfinite(nearest) & (weights > 0.0)
    return float(np.average(nearest[known], weights=weights[known])) if known.any() else np.inf


def _mirror(inspection: Inspection, centers: Array, carriers: NDArray[np.bool_], weights: Array) -> Mirror:
    """The reflection of horizontal axes, about a middle that is looked for, that brings forces nearest to feet."""
    up = inspection.feet.up
    level = np.eye(3)[np.sort(np.argsort(np.abs(up))[:2])]
    heels, tips = inspection.feet.soles
    middles = 0.5 * (heels + tips)
    feet = np.where(carriers[..., None], middles, np.nan)
    with np.errstate(invalid="ignore"):
        target = np.nansum(feet, axis=1) / np.maximum(carriers.sum(axis=1), 1)[:, None]
    known = carriers.any(axis=1) & (weights > 0.0)
    best = Mirror(level[:0], np.zeros(0), np.inf)
    for axes in (level[:1], level[1:], level):
        middle = np.array([np.median(0.5 * (centers[known] + target[known]) @ axis) for axis in axes])
        for step in (0.04, 0.01):
            around = step * np.arange(-4, 5)
            for i in range(len(axes)):
                tried = np.tile(middle, (len(around), 1))
                tried[:, i] += around
                left = [
                    _distance(inspection, _reflected(centers, axes, candidate), carriers, weights)
                    for candidate in tried
                ]
                middle = tried[int(np.argmin(left))]
        left_at = _distance(inspection, _reflected(centers, axes, middle), carriers, weights)
        # One axis more has to explain more.
        if left_at < (1.0 if len(axes) == 1 else CLEARER) * best.distance:
            best = Mirror(axes, middle, left_at)
    return best


def _reflected(centers: Array, axes: Array, middle: Array) -> Array:
    """Points (frames, 3) mirrored along axes about a middle."""
    return np.asarray(centers + 2.0 * (middle - centers @ axes.T) @ axes)


def _named(axes: Array) -> str:
    return " and ".join("xyz"[int(np.argmax(np.abs(axis)))] for axis in axes)


def _about(mirror: Mirror) -> str:
    return ", ".join(f"{item:.2f}" for item in mirror.middle)


def _mirrored(inspection: Inspection, number: int, mirror: Mirror, before: float) -> None:
    inspection.kept_as_measured.add(inspection.name(number))
    inspection.found(
        "mirrored plate",
        inspection.name(number),
        f"the center of pressure of force '{inspection.name(number)}' lies {100.0 * before:.0f} cm from the foot that "
        f"the belt carries, {100.0 * mirror.distance:.0f} cm when mirrored along {_named(mirror.axes)} (about "
        f"{_about(mirror)} m)",
        advice="its plate seems mirrored about its own middle, and torques there are wrong: check the plate's corners "
        "or the sign of its moments",
    )


def _doubtful(inspection: Inspection, number: int, mirror: Mirror, exchanged: float) -> None:
    inspection.kept_as_measured.add(inspection.name(number))
    inspection.found(
        DOUBTFUL,
        inspection.name(number),
        f"force '{inspection.name(number)}' is put on the wrong foot ({100.0 * exchanged:.0f} cm from the other one), "
        f"or its plate is mirrored along {_named(mirror.axes)} ({100.0 * mirror.distance:.0f} cm from its own then): "
        "the recording does not say which",
        advice="nothing was changed; check the plate's corners, or name its body (--bodies, --plates)",
    )

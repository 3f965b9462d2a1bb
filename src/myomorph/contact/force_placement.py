"""Checks of where external forces act: units and origins of points and moments, wrong feet, plates under two feet."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.foot_stance import standing
from myomorph.contact.force_inspection import Inspection
from myomorph.contact.force_samples import Change
from myomorph.model.arrays import Array, runs
from myomorph.model.series import Wrenches

NEAR = 0.09
"""A center of pressure that lies nearer to the middle line of a human sole, on average, is under it [m]."""

FITS = 0.07
"""So near must it come by what is put right [m]."""

FAR = 0.15
"""One that lies farther from every foot is under none [m]."""

MARKED = 0.35
"""Share of the distance before that may be left by what is put right."""

BETWEEN = 0.06
"""A center of pressure farther from both soles, and between them, is that of two feet [m]."""

SHARED = 0.1
"""Time from which a plate is called shared [s]."""

MILLI = 2.0
"""Moment over force of a human foot beyond which the moment may be in N mm [m]."""

LARGE = 0.5
"""The same, for moments of a force whose points are in mm [m]."""

SWINGS = 0.4
"""A foot that stands in a smaller share of a step swings."""

FIRM = 0.4
"""Share of the weight that two feet on one plate carry at least."""


class Remedy(NamedTuple):
    """A fault that forces may have, and what puts it right."""

    kind: str
    text: str
    mended: str
    advice: str
    change: Change


def check_origins(inspection: Inspection) -> None:
    """Centers of pressure far from every foot, which other units or another origin of the moments explain."""
    unit = inspection.feet.unit
    for number in map(int, inspection.numbers):
        before = inspection.misfit(number)
        if before < NEAR * unit:
            continue
        best, left = None, np.inf
        for remedy in _remedies(inspection, number):
            after = inspection.misfit(number, inspection.samples.changed(number, remedy.change))
            if after < 0.9 * left:
                best, left = remedy, after
        if best is not None and left < min(FITS * unit, MARKED * before):
            inspection.change(number, best.change)
            inspection.found(best.kind, inspection.name(number), best.text, best.mended, best.advice)


def _remedies(inspection: Inspection, number: int) -> list[Remedy]:
    """What units and origins of one force may be, other than those of the file."""
    weights = inspection.weights(number)
    loaded = weights > 0.0
    if not loaded.any():
        return []
    samples, name = inspection.samples, inspection.name(number)
    force, point, torque = (getattr(samples, part)[loaded, number] for part in ("forces", "points", "torques"))
    away = float(np.median(np.linalg.norm(point, axis=1)))
    arm = float(np.median(np.linalg.norm(torque, axis=1) / np.linalg.norm(force, axis=1)))
    large = float(np.percentile(np.linalg.norm(torque, axis=1) / np.linalg.norm(force, axis=1), 90))
    worst = float(np.linalg.norm(torque, axis=1).max())
    result = []
    if away > 5.0:
        for factor, word in ((1e-3, "mm"), (1e-2, "cm")):
            text = f"points of force '{name}' lie {away:.3g} m from the origin, the feet do not"
            # A free moment is at most a few centimetres of a foot's force; one of metres is in the same unit.
            scaled, also = (factor, " and moments") if large > LARGE * inspection.feet.unit else (1.0, "")
            result.append(
                Remedy(
                    f"{word} for m",
                    text,
                    f"its points{also} were taken as {word}",
                    f"are its points{also} in {word}?",
                    _scaled(factor, scaled),
                )
            )
    if arm < 0.05 * inspection.feet.unit:
        return result
    text = f"the moment of force '{name}' about its center of pressure is up to {worst:.4g} N m"
    result.append(
        Remedy(
            "moments about another origin",
            text,
            "it is that about the ground's origin, and was taken so",
            "it is that about the ground's origin; give the one about the center of pressure",
            lambda f, p, t: (f, p, t - np.cross(p, f)),
        )
    )
    origin = _origin(force, point, torque)
    where = ", ".join(f"{item:.3f}" for item in origin)
    result.append(
        Remedy(
            "moments about another origin",
            text,
            f"it is that about the point ({where}) m, and was taken so",
            f"it is that about the point ({where}) m; give the one about the center of pressure",
            lambda f, p, t: (f, p, t - np.cross(p - origin, f)),
        )
    )
    if arm > MILLI * inspection.feet.unit:
        result.append(
            Remedy(
                "N mm for N m",
                text,
                "its moments were taken as N mm",
                "are they N mm?",
                lambda f, p, t: (f, p, 1e-3 * t),
            )
        )
    return result


def _scaled(points: float, moments: float) -> Change:
    """The change that multiplies points and moments."""
    return lambda force, point, torque: (force, points * point, moments * torque)


def _origin(force: Array, point: Array, torque: Array) -> Array:
    """The point that moments are about (3,), by least squares: torque = (point - origin) x force [m]."""
    rows = np.zeros((len(force), 3, 3))
    # force x origin, as a matrix on the origin
    rows[:, 0, 1], rows[:, 0, 2] = -force[:, 2], force[:, 1]
    rows[:, 1, 0], rows[:, 1, 2] = force[:, 2], -force[:, 0]
    rows[:, 2, 0], rows[:, 2, 1] = -force[:, 1], force[:, 0]
    matrix = rows.reshape(-1, 3)
    # Along the mean force the origin says nothing: a weak pull to 0 settles it.
    weak = 1e-3 * float(np.linalg.norm(matrix))
    solved = np.linalg.lstsq(
        np.vstack([matrix, weak * np.eye(3)]),
        np.concatenate([(torque - np.cross(point, force)).ravel(), np.zeros(3)]),
        rcond=None,
    )[0]
    return np.asarray(solved)


def check_feet(inspection: Inspection) -> None:
    """Forces on one foot whose center of pressure lies under another, or under none."""
    feet, unit = inspection.feet, inspection.feet.unit
    owners: dict[int, list[tuple[slice, str]]] = {}
    stands = standing(inspection)
    for number in _looked_at(inspection):
        body = inspection.wrenches.bodies[number]
        weights = inspection.weights(number)
        distances = feet.distances(inspection.samples.centers(feet.up)[:, [number]])[:, 0]
        wrong: list[slice] = []
        lost: list[slice] = []
        to: list[int] = []
        for span in inspection.episodes(number):
            mean = np.average(np.nan_to_num(distances[span], nan=9.0), axis=0, weights=weights[span])
            nearest = int(np.argmin(mean))
            alone = weights[span] * ~_between(inspection, distances)[span]
            mean[nearest] = np.average(distances[span, nearest], weights=alone) if alone.any() else 0.0
            owner = feet.owners.get(body)
            if mean[nearest] > FAR * unit:
                lost.append(span)
            elif (
                owner is not None
                and owner != nearest
                and mean[owner] > NEAR * unit
                and 2.0 * mean[nearest] < mean[owner]
            ):
                # A foot in the air carries nothing, however near it is.
                if not _swings(stands[span], nearest, owner):
                    wrong.append(span)
                    to.append(nearest)
                elif mean[owner] > FAR * unit:
                    lost.append(span)
            owners.setdefault(number, []).append(
                (span, feet.feet[nearest].heel if wrong and wrong[-1] is span else body)
            )
        if wrong:
            _wrong_foot(inspection, number, wrong, to, distances)
        if lost:
            _lost(inspection, number, lost, np.where(stands | ~stands.any(axis=1, keepdims=True), distances, np.nan))
    changed = {
        name: spans
        for name, spans in owners.items()
        if any(body != inspection.wrenches.bodies[name] for _, body in spans)
    }
    if changed:
        inspection.put(_given(inspection.wrenches, changed, feet.time))


def _looked_at(inspection: Inspection) -> list[int]:
    """Numbers of the forces whose foot is looked for."""
    return [
        int(number) for number in inspection.numbers if inspection.name(int(number)) not in inspection.kept_as_measured
    ]


def _swings(stands: NDArray[np.bool_], foot: int, own: int) -> bool:
    """Whether a foot is in the air in most frames of a step while another one stands: it does not carry the load."""
    return bool(stands[:, foot].mean() < SWINGS and stands[:, own].mean() > 1.0 - SWINGS)


def _wrong_foot(inspection: Inspection, number: int, spans: list[slice], to: list[int], distances: Array) -> None:
    """Note a force that is put on a foot while it acts under another."""
    feet = inspection.feet
    body = inspection.wrenches.bodies[number]
    owner = feet.owners[body]
    here = np.concatenate([np.arange(span.start, span.stop) for span in spans])
    other = feet.feet[to[0]]
    count = f"in {len(spans)} of {len(inspection.episodes(number))} steps "
    text = (
        f"force '{inspection.name(number)}' is put on '{body}', but {count}its center of pressure lies "
        f"{np.nanmean(distances[here, to[0]]):.2f} m from '{other.name}' and "
        f"{np.nanmean(distances[here, owner]):.2f} m from '{feet.feet[owner].name}'"
    )
    inspection.found(
        "wrong foot",
        inspection.name(number),
        text,
        f"there it was put on '{other.heel}'",
        f"put it on '{other.heel}' there",
        tuple(spans),
    )


def _lost(inspection: Inspection, number: int, spans: list[slice], distances: Array) -> None:
    """Note a force under no foot; `distances` (frames, feet) has NaN where a foot is in the air."""
    here = np.concatenate([np.arange(span.start, span.stop) for span in spans])
    near = float(np.nanmean(np.nanmin(distances[here], axis=1)))
    first = inspection.feet.time[spans[0].start]
    inspection.found(
        "under no foot",
        inspection.name(number),
        f"the center of pressure of force '{inspection.name(number)}' lies {near:.2f} m from the nearest foot that "
        f"stands in {len(spans)} steps, first at {first:.2f} s",
        advice="are its axes those of the motion, and does it act on a foot? Name its body (--bodies, --plates) if not",
        times=tuple(spans),
    )


def _given(wrenches: Wrenches, owners: dict[int, list[tuple[slice, str]]], time: Array) -> Wrenches:
    """Wrenches with each step of some of them on a body of its own; what lies between goes half and half."""
    names, bodies, parts = [], [], []
    for index, (name, body) in enumerate(zip(wrenches.names, wrenches.bodies, strict=True)):
        steps = owners.get(index, [])
        met = tuple(dict.fromkeys(step for _, step in steps)) or (body,)
        edges = [0.5 * (time[a.stop - 1] + time[b.start]) for (a, _), (b, _) in pairwise(steps)]
        number = np.searchsorted(edges, wrenches.time) if edges else np.zeros(len(wrenches), np.int64)
        for each_body in met:
            own = np.array([owner == each_body for _, owner in steps] or [True])[
                np.minimum(number, max(len(steps) - 1, 0))
            ]
            names.append(name if len(met) == 1 else f"{name}_{each_body}")
            bodies.append(each_body)
            mine = own[:, None]
            parts.append(
                (
                    np.where(mine, wrenches.forces[:, index], 0.0),
                    wrenches.points[:, index],
                    np.where(mine, wrenches.torques[:, index], 0.0),
                )
            )
    forces, points, torques = (np.stack(item, axis=1) for item in zip(*parts, strict=True))
    return replace(wrenches, names=tuple(names), bodies=tuple(bodies), forces=forces, points=points, torques=torques)


def _between(inspection: Inspection, distances: Array) -> NDArray[np.bool_]:
    """Frames (frames,) in which a center of pressure lies between two soles, by its distances (frames, feet)."""
    feet = inspection.feet
    if len(feet.feet) < 2:
        return np.zeros(len(distances), bool)
    heels, tips = feet.soles
    middles, frames = 0.5 * (heels + tips), np.arange(len(distances))
    order, two = np.sort(distances, axis=1), np.argsort(distances, axis=1)[:, :2]
    apart = np.linalg.norm(middles[frames, two[:, 0]] - middles[frames, two[:, 1]], axis=1)
    inside = (order[:, 1] < 1.1 * apart) & (order[:, 0] < 0.8 * apart)
    return np.asarray((order[:, 0] > BETWEEN * feet.unit) & inside)


def check_shared_plates(inspection: Inspection) -> None:
    """Plates that two feet stand on at once: their center of pressure lies between the soles."""
    feet = inspection.feet
    if len(feet.feet) < 2:
        return
    for number in _looked_at(inspection):
        distances = feet.distances(inspection.samples.centers(feet.up)[:, [number]])[:, 0]
        shared = _between(inspection, distances) & (inspection.weights(number) > FIRM * feet.model.weight)
        spans = [slice(a, b) for a, b in runs(shared) if b - a > 1]
        total = sum(float(feet.time[span.stop - 1] - feet.time[span.start]) for span in spans)
        if total < SHARED or any(
            finding.kind == "under no foot" and finding.place == inspection.name(number)
            for finding in inspection.findings
        ):
            continue
        near = float(np.median(np.concatenate([distances[span].min(axis=1) for span in spans])))
        inspection.found(
            "two feet on one plate",
            inspection.name(number),
            f"two feet seem to stand on '{inspection.name(number)}' for {total:.2f} s, first at "
            f"{feet.time[spans[0].start]:.2f} s: its center of pressure lies between the soles, {near:.2f} m "
            "from the nearer",
            advice="its force goes to one of them; `tension --contacts auto --measured shared` shares it",
            times=tuple(spans),
        )

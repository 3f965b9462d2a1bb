"""Checks of where external forces act: units, origins of moments, wrong feet, shared plates."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.assign import Part, shared_out
from myomorph.core.contact.force_inspection import (
    Change,
    Inspection,
    change_repair,
    changed_wrenches,
    standing,
)
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import FEET_BESIDE, PLATES
from myomorph.core.model.findings import Finding, Repair
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Wrenches

NEAR = 0.09
"""A center of pressure nearer to the middle line of a human sole is under it [m]."""
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
LONGEST_ARM = 0.4
"""Free torque over force of a human foot, some 0.05 m at most, beyond which it is no one's [m]."""
LARGE = 0.5
"""Moment over force from which moments are in mm as well, where the points are [m]."""
SWINGS = 0.4
"""A foot that stands in a smaller share of a step swings."""
TOUCHES = 0.2
"""Share of the weight that a step reaches whose center of pressure shows its foot."""
FIRM = 0.4
"""Share of the weight that two feet on one plate carry at least."""
NO_FOOT = "under no foot"
TWO_FEET = "two feet on one plate"
WRONG_FOOT = "wrong foot"
"""Kinds of findings: a force that acts under no foot that stands, one between two, and one under
another foot than that of its file.
"""


class Remedy(NamedTuple):
    """A fault that forces may have, and the change that corrects it."""

    kind: str
    text: Message
    done: str
    advice: str
    change: Change


def check_origins(inspection: Inspection) -> Iterator[Finding]:
    """Find centers of pressure far from every foot, which other units or origins explain."""
    unit = inspection.feet.unit
    for number in inspection.numbers:
        before = inspection.misfit(number)
        if before < NEAR * unit:
            yield from _torques_in_n_mm(inspection, number)
            continue
        best = None
        left = np.inf
        for remedy in _remedies(inspection, number):
            after = inspection.misfit(
                number, changed_wrenches(inspection.samples, number, remedy.change)
            )
            if after < 0.9 * left:
                best = remedy
                left = after
        if best is not None and left < min(FITS * unit, MARKED * before):
            repair = change_repair(number, best.change, best.done, best.advice)
            yield Finding(best.kind, inspection.name(number), best.text, repair=repair)


def _torques_in_n_mm(inspection: Inspection, number: int) -> Iterator[Finding]:
    """Find a free torque of which only its unit can be wrong, since the points lie under feet.

    It turns about the vertical, so that it moves no center of pressure.
    """
    weights = inspection.weights(number)
    loaded = weights > 0.0
    if not loaded.any():
        return
    torque = np.linalg.norm(inspection.samples.torques[loaded, number], axis=1)
    arm = float(np.median(torque / weights[loaded]))
    if arm < LONGEST_ARM * inspection.feet.unit:
        return
    name = inspection.name(number)
    text = PLATES.message(
        f"the free torque of force '{name}' is up to {torque.max():.4g} N m, {arm:.2g} m times its"
        " force"
    )
    repair = change_repair(
        number, _scaled(1.0, 1e-3), "it was read as N mm", "is it in N mm? Give it in N m"
    )
    yield Finding("N mm for N m", name, text, repair=repair)


def _remedies(inspection: Inspection, number: int) -> list[Remedy]:
    """Units and origins that one force may have, other than those of the file."""
    loaded = inspection.weights(number) > 0.0
    if not loaded.any():
        return []
    samples = inspection.samples
    name = inspection.name(number)
    unit = inspection.feet.unit
    force = samples.forces[loaded, number]
    point = samples.points[loaded, number]
    torque = samples.torques[loaded, number]
    arms = np.linalg.norm(torque, axis=1) / np.linalg.norm(force, axis=1)
    away = float(np.median(np.linalg.norm(point, axis=1)))
    remedies = []
    if away > 5.0:
        # A free moment is at most a few centimetres of a foot's force; one of metres is in the same
        # unit.
        moments_too = float(np.percentile(arms, 90)) > LARGE * unit
        remedies += _other_units(name, away, moments_too)
    arm = float(np.median(arms))
    if arm < 0.05 * unit:
        return remedies
    worst = float(np.linalg.norm(torque, axis=1).max())
    text = PLATES.message(
        f"the moment of force '{name}' about its center of pressure is up to {worst:.4g} N m",
        place=name,
    )
    remedies += _other_origins(text, _origin(force, point, torque))
    if arm > MILLI * unit:
        remedies.append(
            Remedy(
                kind="N mm for N m",
                text=text,
                done="its moments were read as N mm",
                advice="are they N mm?",
                change=_scaled(1.0, 1e-3),
            )
        )
    return remedies


def _other_origins(text: Message, origin: Array) -> list[Remedy]:
    """Moments about the ground's origin, or about the point (3,) [m] that explains them best."""
    where = ", ".join(f"{item:.3f}" for item in origin)
    return [
        Remedy(
            kind="moments about another origin",
            text=text,
            done=f"it is that about {about}, and was taken so",
            advice=f"it is that about {about}; give the one about the center of pressure",
            change=partial(_about, place),
        )
        for place, about in (
            (np.zeros(3), "the ground's origin"),
            (origin, f"the point ({where}) m"),
        )
    ]


def _other_units(name: str, away: float, moments_too: bool) -> list[Remedy]:
    """Points, and maybe moments, in mm or cm; `away` their distance from the origin as read."""
    also = " and moments" if moments_too else ""
    return [
        Remedy(
            kind=f"{word} for m",
            text=PLATES.message(
                f"points of force '{name}' lie {away:.3g} m from the origin, the feet do not"
            ),
            done=f"its points{also} were taken as {word}",
            advice=f"are its points{also} in {word}?",
            change=_scaled(factor, factor if moments_too else 1.0),
        )
        for factor, word in ((1e-3, "mm"), (1e-2, "cm"))
    ]


def _about(origin: Array, force: Array, point: Array, torque: Array) -> tuple[Array, Array, Array]:
    """Move the moment of a force from an origin (3,) to its center of pressure.

    Parameters
    ----------
    force, point, torque : (..., 3) [N], [m], [N m]

    Returns
    -------
    (..., 3) each
    """
    return force, point, torque - np.cross(point - origin, force)


def _scaled(points: float, moments: float) -> Change:
    """Make the change that multiplies points and moments."""
    return lambda force, point, torque: (force, points * point, moments * torque)


def _origin(force: Array, point: Array, torque: Array) -> Array:
    """Point that moments are about, by least squares: torque = (point - origin) x force.

    Parameters
    ----------
    force, point, torque : (samples, 3) [N], [m], [N m]

    Returns
    -------
    (3,) [m]
    """
    rows = np.zeros((len(force), 3, 3))
    # force x origin, as a matrix on the origin
    rows[:, 0, 1] = -force[:, 2]
    rows[:, 0, 2] = force[:, 1]
    rows[:, 1, 0] = force[:, 2]
    rows[:, 1, 2] = -force[:, 0]
    rows[:, 2, 0] = -force[:, 1]
    rows[:, 2, 1] = force[:, 0]
    matrix = rows.reshape(-1, 3)
    # Along the mean force the origin says nothing: a weak pull to 0 settles it.
    weak = 1e-3 * float(np.linalg.norm(matrix))
    solved = np.linalg.lstsq(
        np.vstack([matrix, weak * np.eye(3)]),
        np.concatenate([(torque - np.cross(point, force)).ravel(), np.zeros(3)]),
        rcond=None,
    )[0]
    return np.asarray(solved)


def check_feet(inspection: Inspection) -> Iterator[Finding]:
    """Find forces on one foot whose center of pressure lies under another, or under none."""
    feet = inspection.feet
    stands = standing(inspection)
    for number in inspection.assigned:
        distances = feet.distances(inspection.samples.centers(feet.up)[:, [number]])[:, 0]
        steps = [
            _step(inspection, number, span, distances=distances, stands=stands)
            for span in inspection.episodes(number)
        ]
        if any(step.other is not None for step in steps):
            yield _wrong_foot(
                inspection, number, [(step.span, step.other) for step in steps], distances
            )
        lost = [step.span for step in steps if step.lost]
        if lost:
            yield _lost(
                inspection,
                number,
                lost,
                np.where(stands | ~stands.any(axis=1, keepdims=True), distances, np.nan),
            )


class _Step(NamedTuple):
    """A stretch of time in which a force acts at one foot.

    Attributes
    ----------
    span : its frames
    other : number of the foot that carries it, None where that is its own
    lost : whether it acts under no foot
    """

    span: slice
    other: int | None = None
    lost: bool = False


def _step(
    inspection: Inspection,
    number: int,
    span: slice,
    *,
    distances: Array,
    stands: NDArray[np.bool_],
) -> _Step:
    """Find the foot that carries a force in one step.

    Parameters
    ----------
    inspection : forces and feet
    number : of the force
    span : frames of the step
    distances : (frames, feet) of the center of pressure [m]
    stands : (frames, feet)
    """
    feet = inspection.feet
    unit = feet.unit
    weights = inspection.weights(number)
    mean = np.average(np.nan_to_num(distances[span], nan=9.0), axis=0, weights=weights[span])
    nearest = int(np.argmin(mean))
    alone = weights[span] * ~_between(inspection, distances)[span]
    mean[nearest] = np.average(distances[span, nearest], weights=alone) if alone.any() else 0.0
    if mean[nearest] > FAR * unit:
        return _Step(span, lost=True)
    owner = feet.owners.get(inspection.wrenches.bodies[number])
    if owner is None or owner == nearest:
        return _Step(span)
    if mean[owner] <= NEAR * unit or 2.0 * mean[nearest] >= mean[owner]:
        return _Step(span)
    if mean[nearest] > NEAR * unit:
        return _Step(span, lost=True)
    # A foot in the air carries nothing, however near it is.
    if _swings(stands[span], nearest, owner):
        return _Step(span, lost=bool(mean[owner] > FAR * unit))
    firm = weights[span].max() > TOUCHES * feet.model.weight
    return _Step(span, other=nearest if firm else None)


def _swings(stands: NDArray[np.bool_], foot: int, own: int) -> bool:
    """Return whether a foot is in the air in most frames of a step while another one stands.

    Then it does not carry the load; `stands` (frames, feet).
    """
    return bool(stands[:, foot].mean() < SWINGS and stands[:, own].mean() > 1.0 - SWINGS)


def _wrong_foot(
    inspection: Inspection, number: int, steps: list[tuple[slice, int | None]], distances: Array
) -> Finding:
    """Name a force that is put on a foot while it acts under another in some steps.

    Parameters
    ----------
    steps : frames of each, and the foot that carries it where it is another one
    distances : (frames, feet) [m]
    """
    feet = inspection.feet
    name = inspection.name(number)
    body = inspection.wrenches.bodies[number]
    wrong = [(span, foot) for span, foot in steps if foot is not None]
    here = np.concatenate([np.arange(span.start, span.stop) for span, _ in wrong])
    owner = feet.owners[body]
    foot = wrong[0][1]
    other = feet.feet[foot]
    text = PLATES.message(
        f"force '{name}' is put on '{body}', but in {len(wrong)} of {len(steps)} steps its center"
        f" of pressure lies {np.nanmean(distances[here, foot]):.2f} m from '{other.name}' and"
        f" {np.nanmean(distances[here, owner]):.2f} m from '{feet.feet[owner].name}'"
    )
    carriers = tuple(body if foot is None else feet.feet[foot].heel for _, foot in steps)
    edges = [
        0.5 * (feet.time[a.stop - 1] + feet.time[b.start]) for (a, _), (b, _) in pairwise(steps)
    ]
    carried = partial(on_carriers, name=name, carriers=carriers, edges=edges)
    repair = Repair(
        carried, f"there it was put on '{other.heel}'", f"put it on '{other.heel}' there"
    )
    return Finding(
        kind=WRONG_FOOT,
        place=name,
        text=text,
        times=inspection.times(span for span, _ in wrong),
        repair=repair,
    )


def _lost(inspection: Inspection, number: int, spans: list[slice], distances: Array) -> Finding:
    """Name a force under no foot; `distances` (frames, feet), NaN of feet in the air."""
    here = np.concatenate([np.arange(span.start, span.stop) for span in spans])
    near = float(np.nanmean(np.nanmin(distances[here], axis=1)))
    name = inspection.name(number)
    times = inspection.times(spans)
    text = PLATES.message(
        f"the center of pressure of force '{name}' lies {near:.2f} m from the nearest foot that"
        f" stands in {len(spans)} steps, first at {times[0][0]:.2f} s: are its axes those of the"
        " motion, and does it act on a foot? Name its body (--bodies, --plates) if not",
        severity="changes results",
    )
    return Finding(kind=NO_FOOT, place=name, text=text, times=times)


def on_carriers(
    wrenches: Wrenches, name: str, carriers: tuple[str, ...], edges: list[float]
) -> Wrenches:
    """Put each step of a wrench on its own body, as a wrench for each.

    Parameters
    ----------
    wrenches : at their own times
    name : of the wrench
    carriers : bodies, by step
    edges : times between steps [s]
    """
    index = wrenches.names.index(name)
    bodies = tuple(dict.fromkeys(carriers))
    step = np.searchsorted(edges, wrenches.time)
    always = np.ones(len(wrenches), bool)
    acts = np.array([[carrier == body for carrier in carriers] for body in bodies])[:, step]
    parts = [
        Part(number=number, name=other, body=wrenches.bodies[number], acts=always)
        for number, other in enumerate(wrenches.names)
    ]
    parts[index : index + 1] = [
        Part(
            number=index,
            name=name if len(bodies) == 1 else f"{name}_{body}",
            body=body,
            acts=acts[row],
        )
        for row, body in enumerate(bodies)
    ]
    return shared_out(wrenches, parts)


def _between(inspection: Inspection, distances: Array) -> NDArray[np.bool_]:
    """Flag when a center of pressure lies between two soles.

    Parameters
    ----------
    distances : (frames, feet) of the center of pressure [m]

    Returns
    -------
    (frames,)
    """
    feet = inspection.feet
    if len(feet.feet) < 2:
        return np.zeros(len(distances), bool)
    heels, tips = feet.soles
    middles = 0.5 * (heels + tips)
    frames = np.arange(len(distances))
    order = np.sort(distances, axis=1)
    two = np.argsort(distances, axis=1)[:, :2]
    apart = np.linalg.norm(middles[frames, two[:, 0]] - middles[frames, two[:, 1]], axis=1)
    inside = (order[:, 1] < 1.1 * apart) & (order[:, 0] < 0.8 * apart)
    return np.asarray((order[:, 0] > BETWEEN * feet.unit) & inside)


def shared_frames(inspection: Inspection) -> NDArray[np.bool_]:
    """Flag when a plate carries two feet, and the body: its center of pressure is between them.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    (frames,)
    """
    feet = inspection.feet
    result = np.zeros(len(feet.time), bool)
    for number in inspection.numbers:
        distances = feet.distances(inspection.samples.centers(feet.up)[:, [number]])[:, 0]
        firm = inspection.weights(number) > FIRM * feet.model.weight
        result |= _between(inspection, distances) & firm
    return result


def check_shared_plates(inspection: Inspection) -> Iterator[Finding]:
    """Find plates that two feet stand on: the center of pressure lies between the soles."""
    feet = inspection.feet
    if len(feet.feet) < 2:
        return
    lost = {finding.place for finding in inspection.findings if finding.kind == NO_FOOT}
    for number in inspection.assigned:
        name = inspection.name(number)
        distances = feet.distances(inspection.samples.centers(feet.up)[:, [number]])[:, 0]
        shared = _between(inspection, distances) & (
            inspection.weights(number) > FIRM * feet.model.weight
        )
        spans = [slice(a, b) for a, b in runs(shared) if b - a > 1]
        times = inspection.times(spans)
        total = sum(stop - start for start, stop in times)
        if total < SHARED or name in lost:
            continue
        near = float(np.median(np.concatenate([distances[span].min(axis=1) for span in spans])))
        text = FEET_BESIDE.message(
            f"two feet seem to stand on '{name}' for {total:.2f} s, first at {times[0][0]:.2f} s:"
            f" its center of pressure lies between the soles, {near:.2f} m from the nearer: its"
            " force goes to one of them; `tension --contacts auto --measured shared` shares it"
        )
        yield Finding(kind=TWO_FEET, place=name, text=text, times=times)

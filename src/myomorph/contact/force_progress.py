"""Check of the way of the center of pressure along a foot: it goes where the body goes, or its plate is mirrored."""

from __future__ import annotations

import numpy as np

from myomorph.contact.force_inspection import Inspection

LASTS = 0.25
"""A step that is shorter is not judged [s]."""

PASSES = 0.25
"""Way of the center of mass along a human foot while it stands from which on it steps over the foot [m]."""

AGAINST = 0.06
"""Way of the center of pressure against that of the center of mass, from the first to the last third of a step [m]."""


def check_progress(inspection: Inspection) -> None:
    """Plates whose center of pressure moves along the foot against the body: mirrored about their own middle.

    A foot that a body passes over is left at the end to which the body goes, forwards or backwards. A plate whose
    axis along the foot is mirrored shows the opposite, wherever its middle is. An axis across the foot does not tell:
    the center of pressure hardly moves along it.
    """
    feet, unit = inspection.feet, inspection.feet.unit
    heels, tips = feet.soles
    along = tips - heels
    along = along - (along @ feet.up)[..., None] * feet.up
    along = along / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-12)
    for number in map(int, inspection.numbers):
        centers, weights = inspection.samples.centers(feet.up)[:, number], inspection.weights(number)
        distances = feet.distances(centers[:, None])[:, 0]
        judged, against = [], []
        for span in inspection.episodes(number):
            if feet.time[span.stop - 1] - feet.time[span.start] < LASTS:
                continue
            body = inspection.wrenches.bodies[number]
            foot = feet.owners.get(body, int(np.argmin(np.average(distances[span], axis=0, weights=weights[span]))))
            way = along[span, foot]
            place = ((centers[span] - heels[span, foot]) * way).sum(axis=1)
            center = ((feet.center[span] - heels[span, foot]) * way).sum(axis=1)
            passed = float(center[-1] - center[0])
            if abs(passed) < PASSES * unit:
                continue
            judged.append(span)
            moved = float(np.sign(passed)) * _moved(place, weights[span])
            if moved < -AGAINST * unit:
                against.append((span, moved))
        if against and 2 * len(against) > len(judged):
            first = feet.time[against[0][0].start]
            mean = -float(np.mean([moved for _, moved in against]))
            inspection.found(
                "mirrored plate",
                inspection.name(number),
                f"the center of pressure of force '{inspection.name(number)}' moves {100.0 * mean:.0f} cm along the "
                f"foot against the body in {len(against)} of {len(judged)} steps, first at {first:.2f} s",
                advice="its plate seems mirrored about its own middle along the foot, and torques there are wrong: "
                "check the plate's corners or the sign of its moments",
                times=tuple(span for span, _ in against),
            )


def _moved(place: np.ndarray, weights: np.ndarray) -> float:
    """Way from the first to the last third of a step, weighted by force [m]."""
    third = max(1, len(place) // 3)
    first, last = (
        float(np.average(place[part], weights=weights[part])) for part in (slice(third), slice(-third, None))
    )
    return last - first

"""Which placements on a plate are believed, and what is said of those that are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.contact.plate_placements import Placement
from myomorph.contact.plate_pose import PlateFitOptions, PlatePose, best_pose, residuals, sizes
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData

FEWEST = 3
MIRRORED = 0.1
"""Share of the cost that remains when the sign of the wrench is turned, below which it was wrong."""

STANDARD_GRAVITY = 9.80665


def believed(placements: Sequence[Placement], options: PlateFitOptions) -> tuple[list[Placement], list[str]]:
    """Placements of weights that rested and weigh what they should, and what was left out."""
    kept, notes = [], []
    for one in placements:
        if not one.pushed and one.moved > options.most_moved:
            notes.append(
                f"placement '{one.name}' was left out: the weight was not at rest (moved {1e3 * one.moved:.1f} mm)"
            )
        elif not one.pushed and one.unsteady > options.most_unsteady:
            notes.append(
                f"placement '{one.name}' was left out: its force varied by {100 * one.unsteady:.1f} %, so the weight "
                "was not at rest or was touched"
            )
        else:
            kept.append(one)
    for name in dict.fromkeys(one.weight for one in kept if not one.pushed):
        same = [one for one in kept if one.weight == name and not one.pushed]
        usual = float(np.median([one.size for one in same]))
        odd = [one for one in same if abs(one.size - usual) > options.most_wrong * usual] if len(same) > 2 else []
        for one in odd:
            notes.append(
                f"placement '{one.name}' was left out: it weighs {_kilograms(one.size)}, the other placements of "
                f"'{name}' {_kilograms(usual)}: touched, or not wholly on the plate"
            )
        kept = [one for one in kept if one not in odd]
        expected = same[0].expected
        if np.isfinite(expected) and abs(usual - expected) > options.most_wrong * expected:
            notes.append(
                f"'{name}' was given as {_kilograms(expected)}, but the plate measures {_kilograms(usual)} "
                f"({100 * (usual / expected - 1):+.1f} %): wrong mass, or wrong sensitivity of the plate"
            )
    if len(kept) < FEWEST:
        left = "; ".join(notes)
        raise BadData(
            f"{len(kept)} placements can be used, expected at least {FEWEST}, spread over the plate"
            + (f" ({left})" if left else "")
        )
    points = np.array([one.point for one in kept])
    spread = float(np.max(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    if spread < options.spread and not any(one.pushed for one in kept):
        raise BadData(
            f"all {len(kept)} placements lie within {1e3 * spread:.0f} mm of their middle: the plate's turn about the "
            "vertical is not shown; place the weight near every corner"
        )
    return kept, notes


def _kilograms(force: float) -> str:
    return f"{force / STANDARD_GRAVITY:.2f} kg"


def unknown_notes(pose: PlatePose, kept: Sequence[Placement], known: bool) -> list[str]:
    """What the placements do not show, and what becomes of it."""
    up = np.mean([one.direction for one in kept], axis=0)
    stays = "it stays where the file has it" if known else "it is arbitrary"
    notes = []
    for direction in pose.unknown.T:
        turn, shift = direction[:3], direction[3:]
        moves = np.linalg.norm(shift) > np.linalg.norm(turn)
        axis = (shift if moves else turn) / np.linalg.norm(shift if moves else turn)
        upright = abs(axis @ up) > 0.95 * np.linalg.norm(up)
        if moves:
            what = "the height" if upright else f"the place along ({', '.join(f'{x:.2f}' for x in axis)})"
        else:
            what = (
                "the turn about the vertical" if upright else f"the turn about ({', '.join(f'{x:.2f}' for x in axis)})"
            )
        hint = "forces that are all vertical never show it; push with a marked rod, or give its tip" if moves else ""
        notes.append(f"{what} of the plate is not shown by these placements: {stays}" + (f" ({hint})" if hint else ""))
    return notes


def line_notes(kept: Sequence[Placement], options: PlateFitOptions) -> list[str]:
    """A line if weights stand on a straight line."""
    if any(one.pushed for one in kept):
        return []
    points = np.array([one.point for one in kept])
    level = points - np.outer(points @ kept[0].direction, kept[0].direction)
    width = float(np.linalg.svd(level - level.mean(axis=0), compute_uv=False)[1]) / np.sqrt(len(kept))
    if width > 0.2 * options.spread:
        return []
    return [
        f"the placements lie on a line ({1e3 * width:.0f} mm across it): a wrong sign of one of the plate's axes, or a "
        "place that is off along the line, would not show; place the weight on both sides"
    ]


def outlier_notes(kept: Sequence[Placement], distances: Array, left_out: Array) -> list[str]:
    """The placement that the others contradict, if one does."""
    if len(kept) < 4:
        return []
    worst = int(np.argmax(left_out))
    usual = float(np.median(np.delete(distances, worst)))
    if left_out[worst] < max(6.0 * usual, 0.005):
        return []
    return [
        f"placement '{kept[worst].name}' lies {1e3 * left_out[worst]:.1f} mm off what the others say (they agree "
        f"within {1e3 * usual:.1f} mm): was a marker moved or mislabelled?"
    ]


def sign_notes(kept: Sequence[Placement], pose: PlatePose, options: PlateFitOptions) -> list[str]:
    """A line if the placements say that the wrench has the other sign."""
    if float(np.max(sizes(residuals(kept, pose.rotation, pose.center))[0])) < 0.005:
        return []
    turned = [replace(one, force=-one.force, moment=-one.moment) for one in kept]
    if best_pose(turned, None, options).cost > MIRRORED * pose.cost:
        return []
    return [
        "the placements agree much better with force and moment reversed: the plate's recording holds the force on the "
        "plate, or an axis has the wrong sign"
    ]

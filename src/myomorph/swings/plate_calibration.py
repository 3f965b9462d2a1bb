"""Calibration of a force plate by a marked weight: usable placements, its pose, and what to doubt.

How the pose follows from placements: `plate_pose`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.contact.plate_placements import Placement
from myomorph.core.contact.plates import plate_axes
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.model.series import PlateRecording
from myomorph.swings.plate_pose import (
    LineResiduals,
    Misfits,
    PlatePose,
    Pose,
    best_pose,
    left_out_poses,
    left_out_residuals,
)

MIN_COUNT = 3  # Placements
MAX_MOVED = 0.002  # A weight that moved further while it should have rested is left out [m]
MAX_UNSTEADY = 0.01  # So is one whose force varied by more than this share
MAX_WEIGHT_ERROR = 0.02  # Share by which a force may differ from the weight
MIN_SPREAD = 0.05  # Weights must stand at least so far from their middle [m]
MIN_WIDTH = 0.2 * MIN_SPREAD  # Of the places of weights, across a line through them [m]
MAX_OUTLIER_RATIO = 6.0  # Left-out distance of a placement over the usual distance
MIN_OUTLIER = 0.005  # Left-out distance below which no placement is called wrong [m]
MAX_GOOD_DISTANCE = 0.005  # Where no distance is larger, the sign is not doubted [m]
# Share of the cost that remains when the sign of the wrench is turned, below which it was wrong
MAX_MIRRORED_COST = 0.1
# Cosine to the vertical from which on a direction is called vertical
MIN_VERTICAL = 0.95
SURFACE = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])


@read_only
class PlateCalibration(PlatePose):
    """A plate's pose in the laboratory and how well the placements agree on it.

    Attributes
    ----------
    names : of the placements used
    distances, angles : (placements,) from marked points to measured lines [m], between marked and
        measured directions [rad]
    left_out_distances, left_out_angles : the same, each placement against the pose that the others
        give
    left_out_shifts : (placements,) how far the center moves when one is left out [m]
    scale : mean share of measured in expected forces, NaN where no mass is known
    notes : what is not shown, was left out or looks wrong, one line each
    """

    names: tuple[str, ...]
    distances: Array
    angles: Array
    left_out_distances: Array
    left_out_angles: Array
    left_out_shifts: Array
    scale: float
    notes: tuple[str, ...] = ()

    @property
    def distance_rms(self) -> float:
        """Root mean square of the distances [m]."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def angle_rms(self) -> float:
        """Root mean square of the angles [rad]."""
        return float(np.sqrt(np.mean(self.angles**2)))


@dataclass(frozen=True, kw_only=True)
class Usable:
    """Placements of weights that rested and weigh what they should.

    Attributes
    ----------
    placements : `MIN_COUNT` or more
    notes : what was left out and which weights look wrong, one line each
    """

    placements: list[Placement]
    notes: list[str]


def calibrate_plate(
    placements: Sequence[Placement], nominal: PlateRecording | None = None
) -> PlateCalibration:
    """Pose of a plate from placements of marked weights and pushes of marked rods.

    Parameters
    ----------
    placements : three or more, spread over the plate
    nominal : the plate as its file has it; what the placements do not show stays as it is there

    Raises
    ------
    BadData : too few placements, or too close to each other
    """
    usable = usable_placements(placements)
    kept = usable.placements
    lines = LineResiduals.of(kept)
    pose = best_pose(lines, None if nominal is None else nominal_pose(nominal))
    others = left_out_poses(lines, pose)
    misfits = Misfits.of(lines.unweighted(pose))
    left_out = Misfits.of(left_out_residuals(lines, others))
    notes = [
        *usable.notes,
        *_tare_notes(kept),
        *unknown_notes(pose, kept, nominal is not None),
        *line_notes(kept),
        *outlier_notes(kept, misfits, left_out),
        *sign_notes(kept, pose, misfits),
    ]
    shifts = [np.linalg.norm(other.center - pose.center) for other in others]
    shares = [item.size / item.expected for item in kept if np.isfinite(item.expected)]
    return PlateCalibration(
        rotation=pose.rotation,
        center=pose.center,
        posterior=pose.posterior,
        cost=pose.cost,
        names=tuple(item.name for item in kept),
        distances=misfits.distances,
        angles=misfits.angles,
        left_out_distances=left_out.distances,
        left_out_angles=left_out.angles,
        left_out_shifts=np.array(shifts),
        scale=float(np.mean(shares)) if shares else float("nan"),
        notes=tuple(notes),
    )


def nominal_pose(recording: PlateRecording) -> Pose:
    """Read the pose that a recording's file gives its plate."""
    return Pose(rotation=plate_axes(recording.corners), center=recording.corners.mean(axis=0))


def place_plate(recording: PlateRecording, calibration: PlateCalibration) -> PlateRecording:
    """Place the recording's plate where the calibration says, of the size it had."""
    sides = [recording.corners[0] - recording.corners[index] for index in (1, 3)]
    half = [0.5 * np.linalg.norm(side) for side in sides]
    local = SURFACE * np.array([*half, 0.0])
    return replace(recording, corners=local @ calibration.rotation.T + calibration.center)


def usable_placements(placements: Sequence[Placement]) -> Usable:
    """Placements of weights that rested and weigh what they should, and what was left out.

    Raises
    ------
    BadData : too few are left, or too close to each other
    """
    kept = []
    notes = []
    for placement in placements:
        note = _unrest_note(placement)
        if note:
            notes.append(note)
        else:
            kept.append(placement)
    for name in dict.fromkeys(item.weight for item in kept if not item.pushed):
        weighed = _weighed(kept, name)
        kept = weighed.placements
        notes += weighed.notes
    if len(kept) < MIN_COUNT:
        left_out = f" ({'; '.join(notes)})" if notes else ""
        raise BadData(
            f"{len(kept)} placements can be used, expected at least {MIN_COUNT}, spread over the"
            f" plate{left_out}"
        )
    points = np.array([item.point for item in kept])
    spread = float(np.max(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    if spread < MIN_SPREAD and not any(item.pushed for item in kept):
        raise BadData(
            f"all {len(kept)} placements lie within {1e3 * spread:.0f} mm of their middle: the"
            " plate's rotation about the vertical is not determined; place the weight near every"
            " corner"
        )
    return Usable(placements=kept, notes=notes)


def _unrest_note(placement: Placement) -> str:
    """Why a weight was not at rest; empty where it was, and of a rod, which need not be."""
    if placement.pushed:
        return ""
    if placement.moved > MAX_MOVED:
        return (
            f"placement '{placement.name}' was left out: the weight was not at rest (moved "
            f"{1e3 * placement.moved:.1f} mm)"
        )
    if placement.unsteady > MAX_UNSTEADY:
        return (
            f"placement '{placement.name}' was left out: its force varied by "
            f"{100 * placement.unsteady:.1f} %, so the weight was not at rest or was touched"
        )
    return ""


def _weighed(placements: Sequence[Placement], name: str) -> Usable:
    """Placements without those in which a weight (its name) weighs other than usual."""
    same = [item for item in placements if item.weight == name and not item.pushed]
    usual = float(np.median([placement.size for placement in same]))
    expected = same[0].expected
    # Of two that differ nobody knows which is wrong.
    judged = same if len(same) > 2 else []
    odd = [item for item in judged if abs(item.size - usual) > MAX_WEIGHT_ERROR * usual]
    notes = [
        f"placement '{placement.name}' was left out: it weighs"
        f" {_kilograms(placement.size)}, the other placements of '{name}'"
        f" {_kilograms(usual)}: touched, or not wholly on the plate"
        for placement in odd
    ]
    if np.isfinite(expected) and abs(usual - expected) > MAX_WEIGHT_ERROR * expected:
        notes.append(
            f"'{name}' was given as {_kilograms(expected)}, but the plate measures"
            f" {_kilograms(usual)} ({100 * (usual / expected - 1):+.1f} %): wrong mass, or"
            " wrong sensitivity of the plate"
        )
    return Usable(placements=[item for item in placements if item not in odd], notes=notes)


def _kilograms(force: float) -> str:
    return f"{force / STANDARD_GRAVITY:.2f} kg"


def _tare_notes(kept: Sequence[Placement]) -> list[str]:
    """Note if the unloaded plate was not recorded."""
    if all(item.tared for item in kept):
        return []
    return [
        "a recording never shows the plate unloaded: what the plate reads then could not be"
        " subtracted"
    ]


def unknown_notes(pose: PlatePose, kept: Sequence[Placement], known: bool) -> list[str]:
    """Note what the placements do not show, and what becomes of it.

    Parameters
    ----------
    pose : with its directions that are not shown
    kept : the placements
    known : whether the file's pose stays where the placements do not show it
    """
    up = np.mean([item.direction for item in kept], axis=0)
    stays = "it stays where the file has it" if known else "it is arbitrary"
    notes = []
    for direction in pose.unknown.T:
        turn = direction[:3]
        shift = direction[3:]
        moves = bool(np.linalg.norm(shift) > np.linalg.norm(turn))
        vector = shift if moves else turn
        what = _unknown(vector / np.linalg.norm(vector), up, moves)
        hint = (
            " (forces that are all vertical never show it; push with a marked rod, or give its tip)"
            if moves
            else ""
        )
        notes.append(f"{what} of the plate is not determined by these placements: {stays}{hint}")
    return notes


def _unknown(axis: Array, up: Array, moves: bool) -> str:
    """Name of a shift along an axis (3,) or of a turn about it; `up` (3,) is the vertical."""
    if abs(axis @ up) > MIN_VERTICAL * np.linalg.norm(up):
        return "the height" if moves else "the turn about the vertical"
    numbers = ", ".join(f"{x:.2f}" for x in axis)
    return f"the place along ({numbers})" if moves else f"the turn about ({numbers})"


def line_notes(kept: Sequence[Placement]) -> list[str]:
    """Note if weights stand on a straight line."""
    if any(item.pushed for item in kept):
        return []
    points = np.array([item.point for item in kept])
    level = points - np.outer(points @ kept[0].direction, kept[0].direction)
    extents = np.linalg.svd(level - level.mean(axis=0), compute_uv=False)
    width = float(extents[1]) / np.sqrt(len(kept))
    if width > MIN_WIDTH:
        return []
    return [
        f"the placements lie on a line ({1e3 * width:.0f} mm across it): a wrong sign of one of the"
        " plate's axes, or a place that is off along the line, would not show; place the weight on"
        " both sides"
    ]


def outlier_notes(kept: Sequence[Placement], misfits: Misfits, left_out: Misfits) -> list[str]:
    """Note the placement that the others contradict, if one does."""
    if len(kept) < 4:
        return []
    worst = int(np.argmax(left_out.distances))
    distance = left_out.distances[worst]
    usual = float(np.median(np.delete(misfits.distances, worst)))
    if distance < max(MAX_OUTLIER_RATIO * usual, MIN_OUTLIER):
        return []
    return [
        f"placement '{kept[worst].name}' lies {1e3 * distance:.1f} mm off the others (they agree"
        f" within {1e3 * usual:.1f} mm): was a marker moved or mislabelled?"
    ]


def sign_notes(kept: Sequence[Placement], pose: PlatePose, misfits: Misfits) -> list[str]:
    """Note if the placements say that the wrench has the other sign."""
    if float(np.max(misfits.distances)) < MAX_GOOD_DISTANCE:
        return []
    reversed_placements = [replace(item, force=-item.force, moment=-item.moment) for item in kept]
    if best_pose(LineResiduals.of(reversed_placements), None).cost > MAX_MIRRORED_COST * pose.cost:
        return []
    return [
        "the placements agree much better with force and moment reversed: the plate's recording"
        " holds the force on the plate, or an axis has the wrong sign"
    ]

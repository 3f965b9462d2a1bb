"""Axes of a converted recording: which way is up, where the walk goes, or as written out."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Z_UP_TO_Y_UP
from myomorph.core.model.spatial import axis_rotation
from myomorph.lab.convert.recording import Recording

Up: TypeAlias = Literal["", "y", "z", "keep"]
Forward: TypeAlias = Literal["", "x", "-x", "y", "-y", "z", "-z"]

WALKED = 0.5  # Way of the markers' middle from which a recording has a walking direction [m].


def axes_of_text(text: str) -> Array:
    """Rotation to axes that a text names, each old one once, in a right-handed frame.

    Parameters
    ----------
    text : new axes along the old ones, as "x,z,-y"

    Returns
    -------
    (3, 3)

    Raises
    ------
    BadData : the text names no such axes
    """
    parts = [part.strip() for part in text.lower().split(",")]
    if len(parts) != 3 or not all(re.fullmatch(r"[+-]?[xyz]", part) for part in parts):
        raise BadData(
            f"--axes {text}: expected three axes as x,z,-y: where the new x, y and z point in the"
            " old frame"
        )
    matrix = np.zeros((3, 3))
    for row, part in enumerate(parts):
        matrix[row, "xyz".index(part[-1])] = -1.0 if part.startswith("-") else 1.0
    if abs(np.linalg.det(matrix)) < 0.5:
        raise BadData(f"--axes {text}: names an axis twice")
    if np.linalg.det(matrix) < 0.0:
        raise BadData(
            f"--axes {text}: is a left-handed frame, in which right and left would be exchanged:"
            " turn one sign"
        )
    return matrix


def vertical(recording: Recording) -> str:
    """Find which axis points up.

    "z" where plates lie level with it or a body is tallest along it, else "y", or "" if unknown.
    """
    if recording.level:
        return "z"
    values = np.zeros((0, 0, 3)) if recording.markers is None else recording.markers.values
    seen = np.asarray(np.isfinite(values).all(axis=2))
    values = values[seen.any(axis=1)]
    if len(values):
        extent = np.median(np.nanmax(values, axis=1) - np.nanmin(values, axis=1), axis=0)
        if extent[2] > 1.3 * max(extent[0], extent[1]):
            return "z"
        if extent[1] > 1.3 * max(extent[0], extent[2]):
            return "y"
    if recording.wrenches is not None:
        total = np.abs(np.nan_to_num(recording.wrenches.forces).sum(axis=(0, 1)))
        if total.max() > 2.0 * np.sort(total)[1]:
            return "xyz"[int(np.argmax(total))]
    return ""


def turned(recording: Recording, up: Up, forward: Forward, axes: str) -> Recording:
    """Give a recording other axes.

    Parameters
    ----------
    recording : as it was read
    up : axis that points up afterwards, "" or "keep" for as it is
    forward : axis that the walk goes along, "" for as it is
    axes : instead of both, the new axes in the old frame, as "x,z,-y"
    """
    if axes:
        return rotated(
            recording, axes_of_text(axes), READING.message(f"axes were changed to {axes}")
        )
    if up in ("y", "z"):
        is_up = vertical(recording)
        if not is_up:
            raise BadData(
                "markers and plates do not determine which axis points up: give --axes, as x,z,-y"
                " for"
                " z up to y up"
            )
        if is_up != up:
            matrix = {"zy": Z_UP_TO_Y_UP, "yz": Z_UP_TO_Y_UP.T}.get(is_up + up)
            if matrix is None:
                raise BadData(f"{is_up} points up: give --axes")
            recording = rotated(
                recording,
                matrix,
                READING.message(f"{is_up} points up in the recording: it was rotated to {up} up"),
            )
    if forward:
        recording = _facing(recording, forward)
    return recording


def _facing(recording: Recording, forward: Forward) -> Recording:
    """Turn a recording about the vertical by right angles, so that it walks along an axis."""
    up = vertical(recording)
    if not up or up == forward[-1]:
        raise BadData(
            f"--forward {forward}: expected a horizontal axis; {up or 'no axis'} points up"
        )
    if recording.markers is None:
        raise BadData(f"--forward {forward}: a walking direction needs markers")
    middle = np.nanmean(recording.markers.values, axis=1)
    middle = middle[np.isfinite(middle).all(axis=1)]
    level = np.eye(3)["xyz".index(up)]
    # Who walks out and back ends where he began: where he was farthest away counts.
    away = middle - middle[:1] if len(middle) else np.zeros((1, 3))
    away = away - np.outer(away @ level, level)
    way = away[int(np.argmax(np.linalg.norm(away, axis=1)))]
    if np.linalg.norm(way) < WALKED:
        raise BadData(
            f"--forward {forward}: the markers' middle moves by {np.linalg.norm(way):.2f} m only,"
            " so there is no walking direction: give --axes"
        )
    target = (-1.0 if forward.startswith("-") else 1.0) * np.eye(3)["xyz".index(forward[-1])]
    angle = np.arctan2(np.cross(way, target) @ level, way @ target)
    quarter = int(np.round(angle / (0.5 * np.pi))) % 4
    if not quarter:
        return recording
    matrix = np.round(axis_rotation(level, 0.5 * np.pi * quarter)) + 0.0
    angle = 90 * quarter if quarter < 3 else -90
    return rotated(
        recording,
        matrix,
        READING.message(f"rotated by {angle} degrees: the walk goes along {forward}"),
    )


def rotated(recording: Recording, matrix: Array, note: Message) -> Recording:
    """Express a recording in another frame.

    Parameters
    ----------
    recording : as it was read
    matrix : (3, 3) whose rows are the axes of the frame
    note : that says so

    Returns
    -------
    the recording
    """
    return replace(
        recording,
        markers=None if recording.markers is None else recording.markers.rotated(matrix),
        wrenches=None if recording.wrenches is None else recording.wrenches.rotated(matrix),
        plates=tuple(
            replace(plate, corners=plate.corners @ matrix.T) for plate in recording.plates
        ),
        level=False,
        notes=(*recording.notes, note),
    )

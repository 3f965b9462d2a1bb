"""What errors of the instruments and of the model, the same in all swings, add to each result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.model.errors import BadData
from myomorph.viscosity.swings.recording import SwingRecording

MAX_FRAMES = 600
"""Frames of a trial from which changes are found: an error that all frames share needs no more."""


@dataclass(frozen=True)
class ErrorOptions:
    """Standard deviations of errors that all swings share; 0 leaves a source out. The defaults are assumptions.

    Attributes
    ----------
    plate_position : of the plate among the markers, each axis [m]
    plate_rotation : of the plate among the markers, about each axis [rad]
    force_gain : of each force channel, relative
    moment_gain : of each moment channel, about the plate's center, relative
    plate_clock : of the plate's clock against the markers', after it was estimated [s]
    joint_center : of the joint's center on the fixed bone, each axis [m]
    """

    plate_position: float = 0.002
    plate_rotation: float = 0.003
    force_gain: float = 0.005
    moment_gain: float = 0.01
    plate_clock: float = 0.0005
    joint_center: float = 0.003

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise BadData(f"standard deviation {one.name} is {value:g}: expected 0 or above")

    @property
    def sources(self) -> tuple[tuple[str, int], ...]:
        """Name and axis of every error whose standard deviation is above 0."""
        named = ((one.name, 1 if one.name == "plate_clock" else 3) for one in fields(self))
        return tuple((name, axis) for name, count in named if getattr(self, name) > 0.0 for axis in range(count))


@dataclass(frozen=True)
class ErrorShare:
    """What one source adds to one result.

    Attributes
    ----------
    source : an attribute of `ErrorOptions`, or "swings" for what differs from swing to swing
    prior_sd : assumed standard deviation of the source, NaN of the swings
    quantity : as in `cohort.QUANTITIES`
    sd : standard deviation of the result from this source alone, in the result's unit
    share : of the result's variance
    """

    source: str
    prior_sd: float
    quantity: str
    sd: float
    share: float


def thinned(one: SwingRecording) -> SwingRecording:
    """The recording with at most `MAX_FRAMES` frames, evenly chosen."""
    keep = slice(None, None, -(-len(one) // MAX_FRAMES))
    names = ("time", "wrench_rows", "wrench", "torque_rows", "rates", "angles", "lengthening", "rotations", "swing")
    return replace(one, **{name: getattr(one, name)[keep] for name in names})


def disturbed(one: SwingRecording, source: str, axis: int, size: float) -> SwingRecording:
    """The recording as it would be had an instrument this error.

    Parameters
    ----------
    source, axis : as in `ErrorOptions.sources`
    size : of the error, in the unit of its standard deviation
    """
    moment, force = one.wrench[:, :3].copy(), one.wrench[:, 3:].copy()
    along = np.eye(3)[axis]
    if source in ("plate_position", "joint_center"):
        # A center and a plate that are off do the same: the wrench is taken about another point.
        moment += (1.0 if source == "plate_position" else -1.0) * size * np.cross(along, force)
    elif source == "plate_rotation":
        turn = Rotation.from_rotvec(size * along).as_matrix()
        about = moment - np.cross(one.origin, force)
        force, about = force @ turn.T, about @ turn.T
        moment = about + np.cross(one.origin, force)
    elif source == "force_gain":
        about = moment - np.cross(one.origin, force)
        force[:, axis] *= 1.0 + size
        moment = about + np.cross(one.origin, force)
    elif source == "moment_gain":
        about = moment - np.cross(one.origin, force)
        moment += size * about[:, axis, None] * along
    else:
        wrench = one.wrench + size * np.gradient(one.wrench, one.time, axis=0)
        return replace(one, wrench=np.where(np.isfinite(wrench), wrench, one.wrench))
    return replace(one, wrench=np.hstack([moment, force]))


def error_shares(
    swings: Mapping[str, float], changes: Sequence[tuple[str, Mapping[str, float]]], options: ErrorOptions
) -> tuple[ErrorShare, ...]:
    """The table of sources and results.

    Parameters
    ----------
    swings : standard deviation of each result from the scatter of swings
    changes : source, and what one standard deviation of it about or along one axis changes of each result
    """
    names = list(dict.fromkeys(source for source, _ in changes))
    found = []
    for quantity, scatter in swings.items():
        variances = {"swings": scatter**2} | {
            name: sum(change.get(quantity, 0.0) ** 2 for source, change in changes if source == name) for name in names
        }
        total = sum(variances.values())
        for name, variance in variances.items():
            prior = float("nan") if name == "swings" else float(getattr(options, name))
            share = variance / total if total > 0.0 else 0.0
            found.append(ErrorShare(name, prior, quantity, float(np.sqrt(variance)), float(share)))
    return tuple(found)

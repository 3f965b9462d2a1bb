"""What errors of the instruments and of the model, the same in all swings, add to each result."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.swings.recording import SwingRecording

# Frames of a trial from which changes are found: an error that all frames share needs no more.
MAX_FRAMES = 600
# How many errors there are of a source that is not one of three axes.
AXES = {"plate_clock": 1, "soft_tissue": 2}


@dataclass(frozen=True)
class ErrorOptions:
    """Standard deviations of errors that all swings share.

    0 leaves a source out. The defaults are assumptions.

    Attributes
    ----------
    plate_position : of the plate among the markers, each axis [m]
    plate_rotation : of the plate among the markers, about each axis [rad]
    force_gain : of each force channel, relative
    moment_gain : of each moment channel, about the plate's center, relative
    plate_clock : of the plate's clock against the markers', after it was estimated [s]
    joint_center : of the joint's center on the fixed bone, each axis [m]
    soft_tissue : how far the mass center gives way on the bones, over the limb's acceleration:
        share of the mass that is loose over the square of its angular frequency [s^2]; by default 4
        % at 8 Hz, for a dissected limb. Of limbs without their muscles and with them (axis 0 and 1)
        each by itself; never estimated
    estimate : find these errors from the swings themselves and take them off; without, they only
        widen intervals
    """

    plate_position: float = 0.002
    plate_rotation: float = 0.003
    force_gain: float = 0.005
    moment_gain: float = 0.01
    plate_clock: float = 0.0005
    joint_center: float = 0.003
    soft_tissue: float = 1.5e-5
    estimate: bool = True

    def __post_init__(self) -> None:
        for name in self.names:
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise BadData(f"standard deviation {name} is {value:g}: expected 0 or above")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the sources."""
        return tuple(field.name for field in fields(self) if field.name != "estimate")

    @property
    def sources(self) -> tuple[tuple[str, int], ...]:
        """Name and axis of every error whose standard deviation is above 0."""
        named = ((name, AXES.get(name, 3)) for name in self.names)
        return tuple(
            (name, axis)
            for name, count in named
            if getattr(self, name) > 0.0
            for axis in range(count)
        )


@dataclass(frozen=True)
class ErrorShare:
    """What one source of errors adds to one result.

    Attributes
    ----------
    source : an attribute of `ErrorOptions`, or "swings" for what differs from swing to swing
    prior_sd : assumed of the source, NaN of the swings
    quantity : of `cohort.QUANTITIES`
    sd : root of the variance that the result would lose were the source known, in its unit
    share : of its variance, one for sources that the swings show only together
    """

    source: str
    prior_sd: float
    quantity: str
    sd: float
    share: float


def thinned(swing_recording: SwingRecording) -> SwingRecording:
    """Choose at most `MAX_FRAMES` frames of a recording, evenly."""
    keep = slice(None, None, -(-len(swing_recording) // MAX_FRAMES))
    names = (
        "time",
        "wrench_rows",
        "wrench",
        "torque_rows",
        "rates",
        "angles",
        "lengthening",
        "rotations",
        "swing",
        "resisting",
    )
    return replace(
        swing_recording, **{name: getattr(swing_recording, name)[keep] for name in names}
    )


def disturbed(
    swing_recording: SwingRecording, source: str, axis: int, size: float
) -> SwingRecording:
    """Put an error of an instrument into a recording.

    Parameters
    ----------
    swing_recording : without it
    source, axis : of `ErrorOptions.sources`
    size : of the error, in the unit of its standard deviation
    """
    moment = swing_recording.wrench[:, :3].copy()
    force = swing_recording.wrench[:, 3:].copy()
    along = np.eye(3)[axis]
    if source in ("plate_position", "joint_center"):
        # A center and a plate that are off do the same: the wrench is taken about another point.
        moment += (1.0 if source == "plate_position" else -1.0) * size * np.cross(along, force)
    elif source in ("plate_rotation", "force_gain", "moment_gain"):
        about = moment - np.cross(swing_recording.origin, force)
        if source == "plate_rotation":
            turn = Rotation.from_rotvec(size * along).as_matrix()
            force = force @ turn.T
            about = about @ turn.T
        else:
            (force if source == "force_gain" else about)[:, axis] *= 1.0 + size
        moment = about + np.cross(swing_recording.origin, force)
    elif source == "soft_tissue":
        # The mass center lags by size * force / mass, which the joint feels as force alone: it
        # passes on no moment.
        if bool(swing_recording.muscles) == (axis == 1):
            change = np.gradient(
                np.gradient(force, swing_recording.time, axis=0), swing_recording.time, axis=0
            )
            force -= size * np.where(np.isfinite(change), change, 0.0)
    else:
        wrench = swing_recording.wrench + size * np.gradient(
            swing_recording.wrench, swing_recording.time, axis=0
        )
        return replace(
            swing_recording, wrench=np.where(np.isfinite(wrench), wrench, swing_recording.wrench)
        )
    return replace(swing_recording, wrench=np.hstack([moment, force]))

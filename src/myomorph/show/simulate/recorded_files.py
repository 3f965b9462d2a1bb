"""Files of a simulated recording as a laboratory has them.

They hold markers on skin, one force plate, and raw EMG of 16 channels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfilt

from myomorph.core.io.c3d.write import write_c3d
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, PlateRecording, Series, Table
from myomorph.show.simulate.pair import CHANNELS
from myomorph.show.simulate.performer import Performance, worn
from myomorph.show.simulate.squat import SimulationOptions, measured_markers

EMG_RATE = 1000.0
EMG_LATE = 0.04  # Of raw EMG [Hz], and how much later force comes [s].
GAIN_SPREAD = 0.5  # Standard deviation of the logarithm of a channel's gain.
ON_SKIN = SimulationOptions(tissue=0.003, marker_noise=0.0005)
PLATE_RATE = 10
PLATE_DEPTH = 0.035
PLATE_NOISE = 1.0  # Samples a frame, depth of the sensors [m], white noise [N].
# Columns: of a plate in ground.
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def skin_markers(model: Model, motion: Motion, random: np.random.Generator) -> Markers:
    """Simulate markers some millimeters from where the model has them.

    They slide on the skin, with white noise.
    """
    return measured_markers(worn(model, random), motion, ON_SKIN, random)


def write_plate_c3d(
    shown: Performance, path: Path, middle: Array, size: tuple[float, float], seed: int
) -> None:
    """Write markers and one plate that all contacts press on.

    Parameters
    ----------
    shown : the performance
    path : of the C3D file
    middle : (3,) point of the floor under the plate [m]
    size : of the plate along x and z [m]
    seed : of the noise
    """
    random = np.random.default_rng(seed)
    markers = skin_markers(shown.body, shown.motion, random)
    frames = np.arange(len(shown.motion) * PLATE_RATE) / PLATE_RATE
    wrench = np.stack(
        [np.interp(frames, np.arange(len(shown.wrench)), one) for one in shown.wrench.T], axis=1
    )
    force = (wrench[:, 3:] + PLATE_NOISE * random.standard_normal((len(frames), 3))) @ AXES
    moment = (wrench[:, :3] - np.cross(middle, wrench[:, 3:])) @ AXES
    origin = np.array([0.0, 0.0, -PLATE_DEPTH])
    x, z = 0.5 * np.array(size)
    corners = middle + np.array([[x, 0.0, z], [-x, 0.0, z], [-x, 0.0, -z], [x, 0.0, -z]])
    channels = np.hstack([force, moment - np.cross(force, origin)])
    write_c3d(
        path,
        markers,
        PlateRecording(name="plate", kind=2, corners=corners, origin=origin, channels=channels),
    )


def write_markers(model: Model, motion: Motion, path: Path, seed: int) -> None:
    """Write the markers to a TRC file."""
    write_trc(skin_markers(model, motion, np.random.default_rng(seed)), path)


def write_raw_emg(activations: Series, path: Path, seed: int) -> tuple[str, ...]:
    """Write raw EMG of both sides of [D]'s eight muscles; return their names.

    Each channel has a gain that nobody knows.
    """
    random = np.random.default_rng(seed)
    names = tuple(name for name in activations.names if name.startswith(CHANNELS))
    time = np.arange(activations.time[0], activations.time[-1], 1.0 / EMG_RATE)
    band = butter(4, (20.0, 400.0), "bandpass", fs=EMG_RATE, output="sos")
    columns = []
    for name in names:
        level = np.interp(time + EMG_LATE, activations.time, activations[name]) + 0.005
        noise = sosfilt(band, random.standard_normal(len(time)))
        columns.append(
            2e-3 * np.exp(GAIN_SPREAD * random.standard_normal()) * level * noise / noise.std()
        )
    write_sto(Table(time, names, np.stack(columns, axis=1)), path)
    return names

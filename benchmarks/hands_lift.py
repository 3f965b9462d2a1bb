"""One man who lifts a box of 15 kg: his motion on a calibrated model, the box's, and what was measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.hands_markers import with_plug_in_gait
from myomorph.io.c3d import read_c3d
from myomorph.io.models import read_model
from myomorph.model.model import Model
from myomorph.model.series import Z_UP_TO_Y_UP, Markers, Motion
from myomorph.model.spatial import Array
from myomorph.motion.calibrate import Calibration, CalibrationOptions, calibrate
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import KinematicsFit, inverse_kinematics

FOLDER = "lifting-box-15kg"
GENERIC = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
LIFTS = ("stoop1", "stoop2")
MASS = 81.68
CUTOFF = 6.0


@dataclass(frozen=True, eq=False)
class Recorded:
    """What the laboratory gives of one lift, in a ground whose y points up.

    Attributes
    ----------
    markers : time from 0 [s]
    plate, plate_point : (frames, 3) force of the plate on the feet [N] and its center of pressure [m]
    unloaded : (frames, 3) force of the plate under the box on it, less that of the box at rest [N]
    box : (frames, 3) of the box: forward, up [m], pitch [rad]
    bottom_up, top_down : (frames, 3) moments at L5/S1 by the laboratory [N m]
    """

    markers: Markers
    plate: Array
    plate_point: Array
    unloaded: Array
    box: Array
    bottom_up: Array
    top_down: Array


def recorded(folder: Path, lift: str) -> Recorded:
    """One lift's files."""
    here = folder / FOLDER
    forces = np.loadtxt(here / f"{lift}_F1Cop1F2Cop2.csv", delimiter=",")
    turn = Z_UP_TO_Y_UP.T
    return Recorded(
        _markers(here / f"{lift}.c3d"),
        forces[:, 7:10] @ turn,
        forces[:, 10:13] @ turn,
        forces[:, 1:4] @ turn,
        np.loadtxt(here / f"{lift}_box_2D.csv", delimiter=",")[:, 1:],
        np.loadtxt(here / f"{lift}_l5s1_bottom_up.csv", delimiter=",")[:, 1:] @ turn,
        np.loadtxt(here / f"{lift}_l5s1_top_down.csv", delimiter=",")[:, 1:] @ turn,
    )


def _markers(path: Path) -> Markers:
    trial = read_c3d(path).rotated(Z_UP_TO_Y_UP)
    assert trial.markers is not None
    return trial.markers


@lru_cache(maxsize=2)
def lifter(folder: Path) -> Calibration:
    """The Rajagopal model with Plug-in Gait's markers, calibrated on standing and both lifts, of the man's mass."""
    generic = with_plug_in_gait(read_model(folder / GENERIC))
    trials = [recorded(folder, lift).markers for lift in LIFTS]
    static = _markers(folder / FOLDER / "neutral.c3d")
    return calibrate(generic, trials, CalibrationOptions(static=static, mass=MASS))


@lru_cache(maxsize=4)
def tracked(folder: Path, lift: str) -> KinematicsFit:
    """Inverse kinematics of one lift."""
    return inverse_kinematics(lifter(folder).model, recorded(folder, lift).markers)


def moving(folder: Path, lift: str, cutoff: float = CUTOFF) -> tuple[Model, Motion]:
    """The man's model and his motion with derivatives."""
    return lifter(folder).model, differentiate(tracked(folder, lift).motion, cutoff)

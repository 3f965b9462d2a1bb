"""Muscles fitted to measured passive torques.

The torques are curves of healthy adults (Silder et al. 2007), some of them held out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat

import myomorph as mm
from benchmarks.errors import rms_known
from myomorph.core.model.arrays import Array
from truths.simulated_muscles import resting_torques

Row = dict[str, object]

STUDY = "passive-joint-moments"
JOINTS = {"hip": "hip_flexion_r", "knee": "knee_angle_r", "ankle": "ankle_angle_r"}
COLUMNS = (0, 2, 3)
"""Of the three angles in the file."""
WALKING = {"hip": (-15.0, 40.0), "knee": (0.0, 75.0), "ankle": (-30.0, 30.0)}
"""Angles that the published calibration was made for (Uhlrich et al. 2022) [degrees]."""
EVERY = 4
"""Curves were digitized at every degree; neighbours tell the same."""


@dataclass(frozen=True, eq=False)
class Curve:
    """The passive torque of one joint over its angle, the others held.

    `joint`: "hip", "knee" or "ankle"; `angles`: (poses, 3) of hip, knee and ankle [degrees];
    `torques`: (poses,) about the joint [N m].
    """

    joint: str
    angles: Array
    torques: Array

    def motion(self, model: mm.Model) -> mm.Motion:
        """Its poses, other coordinates at their defaults."""
        values = np.tile([one.default for one in model.coordinates], (len(self.angles), 1))
        for k, name in enumerate(JOINTS.values()):
            values[:, model.coordinate_names.index(name)] = np.radians(self.angles[:, k])
        still = np.zeros_like(values)
        return mm.Motion(
            np.arange(float(len(values))), model.coordinate_names, values, still, still
        )


def curves(folder: Path) -> tuple[Curve, ...]:
    """Four of each joint."""
    read = loadmat(folder / STUDY / "DigitizedPassiveMoments_Silder2007.mat")
    found = []
    for j, joint in enumerate(JOINTS):
        angles = np.asarray(read["JAngles"][0, j], dtype=np.float64)[:, COLUMNS]
        torques = np.asarray(read["PassiveM"][0, j], dtype=np.float64).ravel()
        held = np.delete(angles, j, axis=1)
        for key in dict.fromkeys(map(tuple, held)):
            here = np.flatnonzero((held == key).all(axis=1))[::EVERY]
            found.append(Curve(joint, angles[here], torques[here]))
    return tuple(found)


def recording(model: mm.Model, some: Sequence[Curve]) -> mm.PersonalTrial:
    """Curves as one recording, each pose with the torque of one joint."""
    motions = [one.motion(model) for one in some]
    values = np.vstack([one.values for one in motions])
    still = np.zeros_like(values)
    time = np.arange(float(len(values)))
    torques = np.full((len(values), len(JOINTS)), np.nan)
    row = 0
    for one in some:
        torques[row : row + len(one.torques), list(JOINTS).index(one.joint)] = one.torques
        row += len(one.torques)
    motion = mm.Motion(time, model.coordinate_names, values, still, still)
    return mm.PersonalTrial(
        "passive", motion, mm.Series(time, tuple(JOINTS.values()), torques), passive=True
    )


def errors(model: mm.Model, some: Sequence[Curve]) -> dict[str, tuple[Array, Array]]:
    """Return the torques of a model's resting muscles less the measured ones.

    Parameters
    ----------
    model : with the muscles
    some : measured curves

    Returns
    -------
    By joint, (poses,) differences [N m], and (poses,) whether the pose is in the range of walking
    """
    found: dict[str, list[tuple[Array, Array]]] = {}
    for one in some:
        given = resting_torques(model, one.motion(model))[
            :, model.coordinate_names.index(JOINTS[one.joint])
        ]
        within = [
            (low <= one.angles[:, k]) & (one.angles[:, k] <= high)
            for k, (low, high) in enumerate(WALKING.values())
        ]
        found.setdefault(one.joint, []).append((given - one.torques, np.all(within, axis=0)))
    return {
        joint: tuple(map(np.concatenate, zip(*parts, strict=True)))
        for joint, parts in found.items()
    }  # type: ignore[misc]


def measure(folder: Path) -> Iterator[Row]:
    """Measure the torque that muscles miss.

    The muscles are generic, of a published calibration, of ours fitted to all, and of ours held
    out.
    """
    every = curves(folder)
    generic = mm.read_model(folder / STUDY / "Rajagopal_modifiedAbductors.osim")
    published = mm.read_model(
        folder / STUDY / "Rajagopal_abductorsModified_PassiveCalibration.osim"
    )
    models = {"generic": generic, "Uhlrich et al. 2022": published}
    for tendons in ("elastic", "rigid"):
        options = mm.PersonalizeOptions(tendons=tendons, hold_out=False)  # type: ignore[arg-type]
        fitted = mm.personalize(generic, [recording(generic, every)], options).model
        models[f"fitted to all, {tendons} tendons"] = fitted
    rows = {name: errors(model, every) for name, model in models.items()}
    parts = []
    for fold in range(4):
        # One curve of each joint is left out at a time.
        unseen = [one for k, one in enumerate(every) if k % 4 == fold]
        seen = [one for k, one in enumerate(every) if k % 4 != fold]
        options = mm.PersonalizeOptions(hold_out=False)
        parts.append(
            errors(mm.personalize(generic, [recording(generic, seen)], options).model, unseen)
        )
    rows["held out, elastic tendons"] = {
        joint: tuple(map(np.concatenate, zip(*(part[joint] for part in parts), strict=True)))  # type: ignore[misc]
        for joint in JOINTS
    }
    for name, found in rows.items():
        yield {
            "muscles": name,
            **{f"{joint} [N m]": rms_known(found[joint][0]) for joint in JOINTS},
            **{
                f"{joint}, walking [N m]": rms_known(found[joint][0][found[joint][1]])
                for joint in JOINTS
            },
        }

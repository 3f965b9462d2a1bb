"""The morphed mouse on recordings of mice.

It has a man's leg muscles on both sides, with the mouse's marker tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import myomorph as mm
from benchmarks.species_cases import from_arm, from_man, mouse
from myomorph.body.calibrate.calibration import Calibration
from myomorph.bones.morph.mirror.model import with_other_muscles
from myomorph.bones.morph.species.masses import (
    with_markers_of,
    with_possible_inertias,
    with_segment_shares,
)
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.contact.plates import wrenches_from_plates
from myomorph.core.model.arrays import Array
from myomorph.core.model.findings import repaired
from myomorph.core.motion.crossings import crossings, within_crossings
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.lengths import length_unit
from myomorph.core.motion.marker_checks import checked_kinematics, time_findings
from myomorph.core.muscles.hill import hill_forces
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.tension import Tension
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.groups import Animal
from myomorph.lab.analysis.length_analysis import LengthAnalysis
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.analysis.walking import walking_strides
from myomorph.lab.study.inputs.reading import fitted_to
from truths.mouse_motion import CUTOFF, PAW, lengths_over, longest, part_of, place_of
from truths.mouse_recordings import TREADMILL, gait_files

MASS = 0.025
"""Of each mouse [kg]; no recording tells it."""

NOSE = 0.088
"""From the root of the tail to the nose on the skeleton as it is [m]."""

KNEE = 0.1
"""Weight of the markers over the knees, on loose skin."""

NEAR = 0.006
"""A center of pressure so near to the toes' joint that a forepaw 40 mm ahead can bear at most an
eighth of the force, wherever it is [m].
"""

COMPARED = ("iliacus", "recfem", "vaslat", "bflh", "semiten", "tibant", "gasmed", "soleus")
"""Muscles whose lengths are compared: flexors and extensors of hip, knee and ankle, without their
side.
"""

FULL = 0.99
"""A muscle is fully active above."""

JOINTS = ("Hip_flexion", "Hip_adduction", "Hip_rotation", "Knee_flexion", "Ankle_flexion")


@dataclass(frozen=True, eq=False)
class Followed:
    """A recording on the morphed mouse, calibrated to it.

    `trial`: in the model's ground; `used`: its markers in crossings; `seen`: (frames,) in which any
    is used.
    """

    name: str
    trial: mm.Trial
    used: mm.Markers
    calibration: Calibration
    fit: KinematicsFit

    @property
    def model(self) -> mm.Model:
        """Of this animal."""
        return self.calibration.model

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(frames,) in which any marker is used."""
        return np.asarray(np.isfinite(self.fit.marker_error).any(axis=1))

    @property
    def body(self) -> float:
        """Length of the animal from the root of its tail to its nose, as calibrated [m]."""
        return NOSE * self.calibration.size

    @property
    def motion(self) -> mm.Motion:
        """Filtered coordinates with derivatives."""
        return mm.differentiate(self.fit.motion, CUTOFF)

    @property
    def knees(self) -> tuple[str, ...]:
        """Markers over the knees."""
        return tuple(one for one in self.model.marker_names if "knee" in one.lower())


@lru_cache(maxsize=1)
def whole_mouse(folder: Path) -> mm.Model:
    """Both legs' muscles on the skeleton, in the mass of a mouse."""
    legs, _ = with_other_muscles(from_man(folder, "SSD").model, "x")
    legs, _ = with_possible_inertias(legs, mouse(folder).surfaces)
    return with_segment_shares(legs, read_species("human-mouse").masses, MASS)[0]


def with_arms(folder: Path, legs: mm.Model) -> mm.Model:
    """Return the same mouse with both arms' muscles too."""
    arms, _ = with_other_muscles(from_arm(folder, "SSD").model, "x")
    return replace(
        legs,
        muscles=(*legs.muscles, *arms.muscles),
        wrap_objects=(*legs.wrap_objects, *arms.wrap_objects),
    )


@lru_cache(maxsize=8)
def followed(folder: Path, path: Path) -> Followed:
    """Calibrate on a recording and fit its motion by inverse kinematics.

    Markers are checked as the commands check them.
    """
    table = "mouse-treadmill" if path == folder / TREADMILL else "mouse-gait"
    model, _ = with_markers_of(whole_mouse(folder), read_species("human-mouse").markers, table)
    trial = fitted_to(model, mm.read_recording(path))
    assert trial.markers is not None
    used = within_crossings(trial.markers, crossings(trial.markers, model))
    used, _ = repaired(used, time_findings(model, used, length_unit(compile_tree(model))))
    weights = {name: KNEE for name in model.marker_names if "knee" in name.lower()}
    options = mm.CalibrationOptions(marker_weights=weights, mass=MASS)
    found = mm.calibrate(model, [used], options, path_lengths=default_path_lengths)
    fit = checked_kinematics(
        found.model, used, mm.InverseKinematicsOptions(marker_weights=weights)
    ).fit
    name = (
        "treadmill"
        if table == "mouse-treadmill"
        else path.stem.split("_trial")[0].removeprefix("Cage6_")
    )
    return Followed(name=name, trial=trial, used=used, calibration=found, fit=fit)


def recordings(folder: Path) -> tuple[Path, ...]:
    """Files of markers of mice that are there."""
    belt = folder / TREADMILL
    return (*gait_files(folder), *((belt,) if belt.is_file() else ()))


def strides_of(one: Followed) -> Strides | None:
    """Strides of the hindlimbs over ground."""
    return walking_strides(one.model, one.motion, one.fit)


def lengths_of(one: Followed) -> LengthAnalysis | None:
    """Muscle lengths over the strides, None where it does not walk."""
    strides = strides_of(one)
    return None if strides is None else lengths_over(one.model, one.motion, strides)


def stride_units(one: Followed) -> tuple[Animal, ...]:
    """Return each whole stride as a unit of a comparison, in the order of time.

    A unit has excursions and lengths of its limb's muscles. What such units show is whether two
    animals differ in these recordings, not whether two kinds of animals do.
    """
    found = lengths_of(one)
    units: list[tuple[float, Animal]] = []
    if found is None:
        return ()
    for limb, strides in found.strides.items():
        columns = [
            k
            for k, owner in enumerate(found.limbs)
            if owner == limb and found.muscles[k][:-2] in COMPARED
        ]
        names = tuple(found.muscles[k][:-2] for k in columns)
        curves = np.stack(
            [found.curves(found.muscles[k]) / found.fiber[k] for k in columns], axis=2
        )
        for number, (stride, lengths) in enumerate(zip(strides, curves, strict=True)):
            if not np.isfinite(lengths).all():
                continue
            excursions = np.ptp(lengths, axis=0)
            scalars = {f"{name} excursion": excursions[k : k + 1] for k, name in enumerate(names)}
            scalars["stride duration"] = np.array([stride.duration])
            own = Animal(
                name=f"{one.name} {limb} {number}",
                scalars=scalars,
                curves={"length": Cycles(names, lengths[None])},
                strides=1,
            )
            units.append((stride.start, own))
    return tuple(own for _, own in sorted(units, key=lambda unit: unit[0]))


def whole_animal(name: str, strides: tuple[Animal, ...]) -> Animal:
    """Strides of one animal as that animal."""
    scalars = {
        key: np.concatenate([one.scalars[key] for one in strides]) for key in strides[0].scalars
    }
    cycles = [one.curves["length"] for one in strides]
    lengths = Cycles(cycles[0].names, np.concatenate([one.values for one in cycles]))
    return Animal(name=name, scalars=scalars, curves={"length": lengths}, strides=len(strides))


@dataclass(frozen=True, eq=False)
class OnOnePaw:
    """Frames in which a hind paw bears the force of the plate, and what its muscles do.

    `side`: "R" or "L"; `motion`, `torques`, `tension`: in these frames.
    """

    side: str
    motion: mm.Motion
    torques: mm.Series
    tension: Tension

    def coordinate(self, joint: str) -> str:
        """Of a joint of that leg."""
        return f"mouse__{self.side}{joint}"

    def acceleration(self, joint: str) -> Array:
        """Return the acceleration of a joint's coordinate.

        Parameters
        ----------
        joint : of the leg

        Returns
        -------
        (frames,) [rad/s²]
        """
        assert self.motion.accelerations is not None
        return np.asarray(
            self.motion.accelerations[:, self.motion.names.index(self.coordinate(joint))]
        )

    def shares(self) -> dict[str, float]:
        """Root mean square of the reserve over that of the torque, by joint."""
        found = {}
        for joint in JOINTS:
            name = self.coordinate(joint)
            reserve = self.tension.actuator_force[
                :, self.tension.reserve_names.index(f"reserve_{name}")
            ]
            found[joint] = float(np.sqrt(np.mean(reserve**2) / np.mean(self.torques[name] ** 2)))
        return found

    def share(self) -> float:
        """Return the same of all joints together."""
        names = [self.coordinate(joint) for joint in JOINTS]
        columns = [self.tension.reserve_names.index(f"reserve_{name}") for name in names]
        asked = np.stack([self.torques[name] for name in names])
        return float(
            np.sqrt(np.mean(self.tension.actuator_force[:, columns] ** 2) / np.mean(asked**2))
        )

    @property
    def worst(self) -> int:
        """Frame of the largest reserves."""
        names = [
            self.tension.reserve_names.index(f"reserve_{self.coordinate(joint)}")
            for joint in JOINTS
        ]
        return int(np.argmax(np.linalg.norm(self.tension.actuator_force[:, names], axis=1)))

    def full(self, model: mm.Model) -> tuple[str, ...]:
        """List muscles of that leg that are fully active where reserves are largest.

        Each is named with its normalized fiber length.
        """
        pose = part_of(self.motion, np.array([self.worst]))
        lengths = mm.muscle_kinematics(
            model, pose, moment_arms=False, velocities=False
        ).muscle_length[0]
        found = []
        for k, muscle in enumerate(model.muscles):
            if (
                muscle.name.endswith(f"_{self.side.lower()}")
                and self.tension.activation[self.worst, k] > FULL
            ):
                fiber = (lengths[k] - muscle.tendon_slack_length) / muscle.optimal_fiber_length
                found.append(f"{muscle.name} ({fiber:.2f})")
        return tuple(found)

    def moments(self, model: mm.Model) -> Array:
        """Return the moment of each fully active muscle where reserves are largest.

        Parameters
        ----------
        model : with the muscles

        Returns
        -------
        (muscles, joints) [N m]
        """
        pose = part_of(self.motion, np.array([self.worst]))
        found = mm.muscle_kinematics(model, pose)
        assert found.muscle_velocity is not None
        force = hill_forces(model, found.muscle_length, found.muscle_velocity).active[0]
        columns = [model.coordinate_names.index(self.coordinate(joint)) for joint in JOINTS]
        moments: Array = force[:, None] * found.moment_arm[0][:, columns]
        return moments


def on_one_paw(one: Followed, at_toes: bool = False) -> OnOnePaw | None:
    """Find the longest run of loaded frames in which one hind paw alone bears the plate's force.

    That is decided by geometry. `at_toes`: the force acts at the toes' joint, not at the plate's
    center of pressure.
    """
    if not one.trial.plates:
        return None
    motion = one.motion
    wrenches = wrenches_from_plates(one.trial.plates, one.trial.plate_time, motion.time)
    paws = {
        side: place_of(one.model, motion, f"mouse__{side}Metatarsus3", np.array([0.0, 7e-3, 0.0]))
        for side in "RL"
    }
    best = _alone_on_plate(one, wrenches, paws)
    if best is None:
        return None
    side, frames = best
    part = part_of(motion, frames)
    loads = mm.Wrenches(
        part.time,
        wrenches.names,
        (f"mouse__{side}Tarsus",),
        wrenches.forces[frames],
        paws[side][frames, None] if at_toes else wrenches.points[frames],
        wrenches.torques[frames],
    )
    torques = mm.inverse_dynamics(one.model, part, loads)
    return OnOnePaw(
        side=side, motion=part, torques=torques, tension=mm.solve_tension(one.model, part, torques)
    )


def _alone_on_plate(
    one: Followed, wrenches: mm.Wrenches, paws: Mapping[str, Array]
) -> tuple[str, NDArray[np.int64]] | None:
    """Return the side and the frames of the longest run in which one hind paw bears the force.

    The other hind paw is not over the plate. The center of pressure is within `NEAR` of the paw, or
    within `PAW` while no forelimb is over the plate. `paws`: (frames, 3) by side [m].
    """
    model = one.model
    motion = one.motion
    known = np.isfinite(motion.values).all(axis=1)
    press = wrenches.forces[:, 0] @ model.up
    loaded = known & (press > 0.1 * np.nanmax(press[known]))
    fore_over = np.zeros(len(motion), dtype=bool)
    for side in "RL":
        shoulder = place_of(model, motion, f"mouse__{side}Scapula", np.zeros(3))
        fore_over |= _over_plate(one, shoulder)
    flat = np.abs(model.up) < 0.5
    best: tuple[str, NDArray[np.int64]] | None = None
    for side, other in (("R", "L"), ("L", "R")):
        beside = np.linalg.norm((wrenches.points[:, 0] - paws[side])[:, flat], axis=1)
        beside = np.nan_to_num(beside, nan=np.inf)
        alone = (beside < NEAR) | ((beside < PAW) & ~fore_over)
        hind = _over_plate(one, paws[side]) & ~_over_plate(one, paws[other])
        frames = longest(loaded & hind & alone)
        if len(frames) and (best is None or len(frames) > len(best[1])):
            best = side, frames
    return best


def _over_plate(one: Followed, places: Array) -> NDArray[np.bool_]:
    """Return whether positions (frames, 3) are over the plate."""
    corners = one.trial.plates[0].corners
    flat = np.abs(one.model.up) < 0.5
    low = corners.min(axis=0)[flat]
    high = corners.max(axis=0)[flat]
    return np.asarray(((places[:, flat] >= low) & (places[:, flat] <= high)).all(axis=1))

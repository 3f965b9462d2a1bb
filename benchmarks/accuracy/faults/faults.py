"""Faults that recordings have, put into clean ones.

Counted are those that are found, repaired or missed, and what is reported of clean ones. Each
fault is a function from a trial's inputs to faulty ones, in a table: `FORCE_FAULTS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.recordings import RECORDINGS
from myomorph.core.model.findings import Finding
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.motion.sync import cut
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.external_forces import ForceFile, on_feet, raw_loads

Row = dict[str, object]


@dataclass(frozen=True)
class Recorded:
    """Inputs of a trial, any of which a fault may change.

    `markers`: None where only forces are looked at.
    """

    name: str
    model: mm.Model
    motion: mm.Motion
    wrenches: mm.Wrenches
    markers: mm.Markers | None = None


@dataclass(frozen=True)
class Fault:
    """A fault and what finds it.

    `kinds`: of findings that name it; `change`: from clean inputs to faulty ones; None where the
    recording cannot have it.
    """

    name: str
    kinds: tuple[str, ...]
    change: Callable[[Recorded], Recorded | None]


@dataclass(frozen=True)
class Walk:
    """Files of a recording with forces: model, motion and forces, below the data collection.

    `time`: start and end [s], None for all; `mass`: what its plates carry, where the model weighs
    something else [kg].
    """

    name: str
    model: str
    motion: str
    loads: str
    time: tuple[float, float] | None = None
    mass: float | None = None


def _walk(
    name: str, recording: str, time: tuple[float, float] | None = None, heavy: bool = False
) -> Walk:
    files = RECORDINGS[recording]
    # The tables of forces, not the loads that name the feet.
    loads = files.loads.replace("external_forces.xml", "grf.mot")
    return Walk(
        name=name,
        model=files.model,
        motion=files.motion or files.markers,
        loads=loads,
        time=time,
        mass=files.mass if heavy else None,
    )


CLEAN = (
    _walk("gait2354 walk", "gait2354-dynamics", (0.5, 2.5)),
    _walk("Rajagopal walk", "rajagopal"),
    _walk("OpenCap walk", "opencap-walk"),
    _walk("OpenCap drop jump", "opencap-jump"),
    _walk("OpenCap sit-to-stand", "opencap-rise"),
    _walk("treadmill walk", "treadmill", (10.0, 18.0)),
    _walk("knee implant, stride 1", "implant-1", heavy=True),
    _walk("knee implant, stride 3", "implant-3", heavy=True),
    _walk("gait10dof18musc walk", "gait10"),
    _walk("CEINMS walk (generic model)", "gait2392", (10.0, 20.0), heavy=True),
    _walk("Hamner run, 2 m/s (unscaled model)", "run-2", heavy=True),
    _walk("Hamner run, 5 m/s (unscaled model)", "run-5", heavy=True),
    _walk("Lenhart walk", "lenhart", heavy=True),
)


@cache
def recorded(folder: Path, walk: Walk) -> Recorded:
    """Read the inputs of a recording, with forces on the feet that carry them."""
    model = mm.read_model(folder / walk.model)
    if walk.motion.endswith(".trc"):
        markers = mm.read_recording(folder / walk.motion).markers
        assert markers is not None
        motion = mm.inverse_kinematics(model, markers).motion
    else:
        motion = mm.read_motion(folder / walk.motion, model)
    wrenches = raw_loads(ForceFile(path=folder / walk.loads), model, motion).wrenches
    if walk.time is not None:
        motion = cut(motion, *walk.time)
    wrenches = on_feet(wrenches, model, motion, ForceOptions(force_checks="none"))
    inside = (motion.time >= wrenches.time[0] - 1e-9) & (motion.time <= wrenches.time[-1] + 1e-9)
    motion = mm.Motion(motion.time[inside], motion.names, motion.values[inside])
    return Recorded(name=walk.name, model=model, motion=motion, wrenches=wrenches)


def of_its_mass(folder: Path, walk: Walk) -> Recorded:
    """Read the same, with a model as heavy as what the plates carry."""
    one = recorded(folder, walk)
    return one if walk.mass is None else scaled_mass(walk.mass / one.model.mass)(one)


def _with(one: Recorded, **parts: object) -> Recorded:
    return replace(one, wrenches=replace(one.wrenches, **parts))


def wrong_foot(one: Recorded) -> Recorded | None:
    """Right and left exchanged."""
    names = sorted(set(one.wrenches.bodies))
    if len(names) != 2:
        return None
    other = dict(zip(names, reversed(names), strict=True))
    return _with(one, bodies=tuple(other[body] for body in one.wrenches.bodies))


def one_foot(one: Recorded) -> Recorded | None:
    """All forces on the first foot."""
    return _with(one, bodies=(one.wrenches.bodies[0],) * len(one.wrenches.bodies))


def mirrored(one: Recorded) -> Recorded | None:
    """Mirror the axis to the side, in forces, points and moments."""
    sign = np.array([1.0, 1.0, -1.0])
    wrenches = one.wrenches
    return _with(
        one,
        forces=wrenches.forces * sign,
        points=wrenches.points * sign,
        torques=-wrenches.torques * sign,
    )


def turned(one: Recorded) -> Recorded | None:
    """Rotate the axes of forces by 90 degrees about the vertical."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    return _with(
        one,
        **{part: getattr(one.wrenches, part) @ turn.T for part in ("forces", "points", "torques")},
    )


def millimetres(one: Recorded) -> Recorded | None:
    """Points and moments in mm."""
    return _with(one, points=1e3 * one.wrenches.points, torques=1e3 * one.wrenches.torques)


def about_the_origin(one: Recorded) -> Recorded | None:
    """Moments about the ground's origin beside centers of pressure."""
    wrenches = one.wrenches
    points = np.nan_to_num(wrenches.points)
    return _with(one, torques=wrenches.torques + np.cross(points, wrenches.forces))


def about_a_plate(one: Recorded) -> Recorded | None:
    """Moments about the middle of each plate, beside centers of pressure in ground."""
    wrenches = one.wrenches
    loaded = np.linalg.norm(wrenches.forces, axis=2) > 0.1 * one.model.weight
    torques = np.array(wrenches.torques)
    for k in range(len(wrenches.names)):
        if loaded[:, k].any():
            middle = np.mean(wrenches.points[loaded[:, k], k], axis=0) + [0.3, 0.0, 0.2]
            torques[:, k] += np.cross(
                np.nan_to_num(wrenches.points[:, k]) - middle, wrenches.forces[:, k]
            )
    return _with(one, torques=torques)


def idle_plate(one: Recorded) -> Recorded | None:
    """Add a plate that nobody steps on and that reads noise, on a body that nobody named."""
    wrenches = one.wrenches
    noise = np.random.default_rng(3).normal(0.0, 2.0, (len(wrenches), 1, 3))
    still = np.tile([0.4, 0.0, 0.9], (len(wrenches), 1, 1))
    return _with(
        one,
        names=(*wrenches.names, "idle"),
        bodies=(*wrenches.bodies, ""),
        forces=np.concatenate([wrenches.forces, noise], axis=1),
        points=np.concatenate([wrenches.points, still], axis=1),
        torques=np.concatenate([wrenches.torques, 0.0 * noise], axis=1),
    )


def scaled_mass(factor: float) -> Callable[[Recorded], Recorded]:
    """Return a fault: a model of another mass."""

    def change(one: Recorded) -> Recorded:
        return replace(
            one, model=with_inertial_parameters(one.model, factor * inertial_parameters(one.model))
        )

    return change


def late(shift: float) -> Callable[[Recorded], Recorded]:
    """Return a fault: forces on a clock that is late [s]."""

    def change(one: Recorded) -> Recorded:
        return _with(one, time=one.wrenches.time + shift)

    return change


def swapped_sign(one: Recorded) -> Recorded | None:
    """Replace the force of the plate on the foot by that of the foot on the plate."""
    return _with(one, forces=-one.wrenches.forces, torques=-one.wrenches.torques)


def one_plate(one: Recorded) -> Recorded | None:
    """Both feet on one plate: a single force with the center of pressure of all."""
    wrenches = one.wrenches
    force = wrenches.forces.sum(axis=1, keepdims=True)
    moment = (wrenches.torques + np.cross(np.nan_to_num(wrenches.points), wrenches.forces)).sum(
        axis=1, keepdims=True
    )
    lift = force[..., 1:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        point = np.cross(np.array([0.0, 1.0, 0.0]), moment) / lift
    usable = np.abs(lift) > 20.0
    point = np.where(usable, point, 0.0)
    force = np.where(usable, force, 0.0)
    both = (np.linalg.norm(wrenches.forces, axis=2) > 0.1 * one.model.weight).sum(axis=1) > 1
    if both.sum() * float(np.median(np.diff(wrenches.time))) < 0.15:
        return None
    torque = np.where(usable, moment - np.cross(point, force), 0.0)
    return _with(one, names=("plate",), bodies=("",), forces=force, points=point, torques=torque)


def mirrored_plate(one: Recorded) -> Recorded | None:
    """Mirror each plate about its own middle along the axis in which the body walks.

    The result is None where it does not walk.
    """
    wrenches = one.wrenches
    points = np.array(wrenches.points)
    loaded = np.linalg.norm(wrenches.forces, axis=2) > 0.1 * one.model.weight
    on_belt = max(
        float(np.nanpercentile(points[on, k, 0], 95) - np.nanpercentile(points[on, k, 0], 5))
        if on.any()
        else 0.0
        for k, on in enumerate(loaded.T)
    )
    if np.ptp(one.motion["pelvis_tx"]) < 0.5 and on_belt < 0.3:
        return None
    for k in range(len(wrenches.names)):
        if loaded[:, k].any():
            own = points[loaded[:, k], k, 0]
            # Feet are put down where the middle of the plate is, so that no distance tells it.
            points[:, k, 0] = np.nanmin(own) + np.nanmax(own) - points[:, k, 0]
    return _with(one, points=points)


FORCE_FAULTS = (
    Fault("feet exchanged", ("wrong foot",), wrong_foot),
    Fault("all forces on one foot", ("wrong foot",), one_foot),
    Fault("axis to the side mirrored", ("mirrored axis",), mirrored),
    Fault("plate mirrored about its own middle", ("mirrored plate",), mirrored_plate),
    Fault("axes of forces turned by 90 degrees", ("walking direction",), turned),
    Fault("mm for m", ("mm for m",), millimetres),
    Fault("moments about the ground's origin", ("moments about another origin",), about_the_origin),
    Fault("moments about a plate", ("moments about another origin",), about_a_plate),
    Fault("plate that nobody steps on", ("idle plate",), idle_plate),
    Fault("model 20 % too heavy", ("mass",), scaled_mass(1.2)),
    Fault("model 20 % too light", ("mass",), scaled_mass(0.8)),
    Fault("forces 40 ms late", ("clock",), late(0.04)),
    Fault("forces 40 ms early", ("clock",), late(-0.04)),
    Fault("sign of forces swapped", ("swapped sign",), swapped_sign),
    Fault("two feet on one plate", ("two feet on one plate",), one_plate),
)
"""What may be wrong with forces."""


def verdict(fault: Fault, findings: Sequence[Finding]) -> str:
    """Return whether a fault is corrected, found or missed."""
    named = [one for one in findings if set(one.kind.split(" or ")) & set(fault.kinds)]
    if not named:
        return "missed"
    if all(one.repaired for one in named):
        return "corrected"
    return "found"


def torque_error(
    clean: Recorded, wrenches: mm.Wrenches, motion: mm.Motion, torques: np.ndarray
) -> float:
    """Return the largest difference of a joint's generalized force from that with the clean forces.

    Parameters
    ----------
    clean : recording without faults
    wrenches : faulty forces
    motion : of the faulty recording
    torques : (frames, coordinates) inverse dynamics by the clean forces [N m or N]

    Returns
    -------
    [N m or N]
    """
    found = mm.inverse_dynamics(
        clean.model, motion, mm.resample_wrenches(wrenches, motion.time, 6.0)
    ).values
    return float(np.nanmax(np.abs(found - torques)))


def _error_of(
    clean: Recorded, wrenches: mm.Wrenches, motion: mm.Motion, torques: np.ndarray
) -> float | str:
    """Return the error of faulty forces, where each acts on a body."""
    return (
        torque_error(clean, wrenches, motion, torques) if all(wrenches.bodies) else "refused before"
    )


def injected_force_faults(folder: Path) -> Iterator[Row]:
    """Put faults of forces into clean recordings, and count those corrected, found and missed."""
    return counted_faults(FORCE_FAULTS, [of_its_mass(folder, walk) for walk in CLEAN])


def counted_faults(faults: Sequence[Fault], recordings: Sequence[Recorded]) -> Iterator[Row]:
    """Yield a row for each fault, put into every recording that can have it."""
    for fault in faults:
        verdicts = []
        for clean in recordings:
            faulty = fault.change(clean)
            if faulty is not None:
                findings = on_feet(faulty.wrenches, faulty.model, faulty.motion).findings
                verdicts.append((verdict(fault, findings), clean.name))
        yield counted(fault.name, verdicts)


def counted(fault: str, verdicts: Sequence[tuple[str, str]]) -> Row:
    """Return the row of a fault from its verdict (corrected, found or missed) in each recording."""
    counts = {
        word: [name for given, name in verdicts if given == word]
        for word in ("corrected", "found", "missed")
    }
    return {
        "fault": fault,
        "recordings": len(verdicts),
        **{word: len(names) for word, names in counts.items()},
        "missed in": ", ".join(counts["missed"]) or "none",
    }


def texts_of(findings: Sequence[Finding], nothing: str = "none") -> str:
    """Join the texts of some findings."""
    return "; ".join(finding.text for finding in findings) or nothing


def clean_forces(folder: Path) -> Iterator[Row]:
    """List the findings on the same recordings without faults.

    The second row of a recording is of its model as heavy as the plates show.
    """
    for walk in CLEAN:
        plain = recorded(folder, walk)
        heavy = of_its_mass(folder, walk)
        found = on_feet(plain.wrenches, plain.model, plain.motion).findings
        left = on_feet(heavy.wrenches, heavy.model, heavy.motion).findings
        yield {
            "recording": walk.name,
            "model [kg]": plain.model.mass,
            "frames": len(plain.motion),
            "findings": texts_of(found),
            "with the mass of the plates": texts_of(left),
        }


def corrected_torques(folder: Path) -> Iterator[Row]:
    """Joint torques with forces put right, against those with the clean forces."""
    for walk in CLEAN[:4]:
        clean = recorded(folder, walk)
        motion = mm.differentiate(clean.motion, 6.0)
        torques = mm.inverse_dynamics(
            clean.model, motion, mm.resample_wrenches(clean.wrenches, motion.time, 6.0)
        ).values
        for fault in FORCE_FAULTS:
            faulty = fault.change(clean)
            if faulty is None:
                continue
            found = on_feet(faulty.wrenches, faulty.model, faulty.motion)
            if verdict(fault, found.findings) == "corrected":
                faulty_error = _error_of(clean, faulty.wrenches, motion, torques)
                yield {
                    "recording": walk.name,
                    "fault": fault.name,
                    "error, faulty [N m]": faulty_error,
                    "error, corrected [N m]": torque_error(clean, found, motion, torques),
                }

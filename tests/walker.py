"""A small body that walks.

Pelvis with three translations and a rotation, two legs, a muscle or two on each.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.tension.tension import TensionOptions
from myomorph.lab.report.page.parts import Note, PageHead, SourceFile, Step
from myomorph.lab.report.trial.report_input import ReportInput

RATE = 100.0
GRAVITY = 9.80665
MUSCLES = (
    (
        "recfem",
        ((0.05, 0.1, 0.0, "pelvis"), (0.05, -0.3, 0.0, "femur"), (0.04, -0.05, 0.0, "tibia")),
        1200.0,
    ),
    ("bflh", ((-0.05, 0.0, 0.0, "pelvis"), (-0.04, -0.05, 0.0, "tibia")), 900.0),
    ("glmax1", ((-0.08, 0.1, 0.0, "pelvis"), (-0.03, -0.1, 0.0, "femur")), 500.0),
    ("glmax2", ((-0.08, 0.05, 0.0, "pelvis"), (-0.03, -0.12, 0.0, "femur")), 1500.0),
)
"""Names, points in bodies and maximum isometric forces [N] of the muscles of a leg."""


def _at(*point: float) -> Transform:
    return Transform(np.eye(3), np.array(point))


def _axis(kind: str, vector: tuple[float, float, float], name: str) -> Axis:
    return Axis(kind=kind, vector=np.array(vector), function=linear(1.0), coordinates=(name,))  # type: ignore[arg-type]


def _hinge(name: str, parent: str, child: str, place: Transform) -> Joint:
    return Joint(
        name=name,
        kind="PinJoint",
        parent=parent,
        child=child,
        parent_frame=place,
        child_frame=_at(0, 0, 0),
        axes=(_axis("rotation", (0, 0, 1), name),),
        coordinates=(name,),
    )


def _muscle(
    name: str,
    side: str,
    z: float,
    points: tuple[tuple[float, float, float, str], ...],
    force: float,
    size: float,
) -> Muscle:
    path = tuple(
        PathPoint(
            f"{name}-{i}",
            body if body == "pelvis" else f"{body}_{side}",
            np.array([x, y, zz + (z if body == "pelvis" else 0.0)]) * [size, size, 1],
        )
        for i, (x, y, zz, body) in enumerate(points)
    )
    return Muscle(
        name=f"{name}_{side}",
        kind="Thelen2003Muscle",
        path=Path(path),
        max_isometric_force=force * size**2,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.2,
    )


def model(size: float = 1.0, mass: float = 60.0) -> Model:
    """Pelvis 0.9 m above the ground, y up, right along z; `size` scales lengths."""
    inertia = 0.01 * mass * size**2 * np.eye(3)
    bodies = [
        Body(
            name="pelvis",
            mass=0.6 * mass,
            mass_center=np.array([0.0, 0.2, 0.0]) * size,
            inertia=inertia,
        )
    ]
    translations = [
        _axis("translation", axis, name)
        for axis, name in (
            ((1, 0, 0), "pelvis_tx"),
            ((0, 1, 0), "pelvis_ty"),
            ((0, 0, 1), "pelvis_tz"),
        )
    ]
    names = ("pelvis_tx", "pelvis_ty", "pelvis_tz", "pelvis_tilt")
    root = (*translations, _axis("rotation", (0, 0, 1), "pelvis_tilt"))
    joints = [
        Joint(
            name="root",
            kind="CustomJoint",
            parent="ground",
            child="pelvis",
            parent_frame=_at(0, 0, 0),
            child_frame=_at(0, 0, 0),
            axes=root,
            coordinates=names,
        )
    ]
    coordinates = [Coordinate(name, "translational") for name in names[:3]]
    coordinates += [Coordinate("pelvis_tilt", "rotational", range=(-1.5, 1.5))]
    coordinates[1] = Coordinate("pelvis_ty", "translational", default=0.9 * size)
    muscles = []
    for side, z in (("r", 0.1 * size), ("l", -0.1 * size)):
        thigh = f"femur_{side}"
        shank = f"tibia_{side}"
        bodies += [
            Body(
                name=name,
                mass=share * mass,
                mass_center=np.array([0.0, -0.2 * size, 0.0]),
                inertia=inertia,
            )
            for name, share in ((thigh, 0.15), (shank, 0.05))
        ]
        joints += [
            _hinge(f"hip_flexion_{side}", "pelvis", thigh, _at(0, 0, z)),
            _hinge(f"knee_angle_{side}", thigh, shank, _at(0, -0.4 * size, 0)),
        ]
        coordinates += [
            Coordinate(joint.name, "rotational", range=(-2.0, 2.0)) for joint in joints[-2:]
        ]
        muscles += [_muscle(name, side, z, points, force, size) for name, points, force in MUSCLES]
    return Model(
        name="walker",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=np.array([0.0, -GRAVITY, 0.0]),
        muscles=tuple(muscles),
    )


def motion(body: Model, frames: int = 200, size: float = 1.0) -> Motion:
    """Hips and knees that swing against each other at 1 Hz while the pelvis goes forward."""
    time = np.arange(frames) / RATE
    values = np.tile([one.default for one in body.coordinates], (frames, 1)).astype(float)
    for i, name in enumerate(body.coordinate_names):
        phase = np.pi if name.endswith("_l") else 0.0
        if name.startswith("hip"):
            values[:, i] = 0.4 * np.sin(2 * np.pi * time + phase)
        elif name.startswith("knee"):
            values[:, i] = -0.5 + 0.4 * np.cos(2 * np.pi * time + phase)
        elif name == "pelvis_tx":
            values[:, i] = 1.2 * size * time
    return Motion(time, body.coordinate_names, values)


def steps(time: np.ndarray, weight: float) -> Wrenches:
    """Make right stance from 0.2 s to 0.9 s, left from 0.7 s to 1.4 s.

    They are half sine waves of one body weight.

    Parameters
    ----------
    time : (frames,) [s]
    weight : of the body [N]

    Returns
    -------
    Wrenches of two plates under the tibias
    """
    forces = np.zeros((len(time), 2, 3))
    for k, start in enumerate((0.2, 0.7)):
        inside = (time >= start) & (time <= start + 0.7)
        forces[inside, k, 1] = weight * np.sin(np.pi * (time[inside] - start) / 0.7)
    points = np.where(forces[..., 1:2] > 0, np.array([0.1, 0.0, 0.1]), np.nan)
    return Wrenches(
        time=time,
        names=("plate 1", "plate 2"),
        bodies=("tibia_r", "tibia_l"),
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )


class Tension:
    """Activations that follow a wave, and the forces that belong to them."""

    def __init__(self, body: Model, time: np.ndarray):
        self.time = time
        self.muscles = body.muscle_names
        phase = np.arange(len(self.muscles))
        self.activation = 0.5 + 0.4 * np.sin(2 * np.pi * time[:, None] + phase)
        self.muscle_force = self.activation * np.array(
            [one.max_isometric_force for one in body.muscles]
        )
        self.actuator_force = np.stack([0.5 * np.sin(time), 2.0 * np.cos(time)], axis=1)
        self.optimal = np.ones(len(time), dtype=bool)
        self.asked = np.ones(len(time), dtype=bool)
        self.overstretched: tuple[str, ...] = ()
        self.options = TensionOptions()
        self.large_passive = ()
        self.fibers = None


def fitted(movement: Motion, size: float = 0.01) -> KinematicsFit:
    """Return a fit with known marker errors.

    The second marker is three times as far off as the first.
    """
    frames = len(movement)
    errors = np.tile([size, 3 * size], (frames, 1))
    flags = np.ones(frames, dtype=bool)
    return KinematicsFit(
        motion=movement,
        marker_names=("RASI", "RKNE"),
        marker_error=errors,
        marker_weight=np.ones(2),
        converged=flags,
        iterations=np.ones(frames, np.int64),
        unused_markers=("extra",),
        missing_markers=(),
    )


def having(given: ReportInput, **values: Any) -> ReportInput:
    """Contents of a report with other values, each put into the part that has its field."""
    parts = {one.name for one in fields(given)}
    for name, value in values.items():
        if name in parts:
            given = replace(given, **{name: value})
            continue
        kinds = ("head", "recorded", "kinematics", "dynamics", "muscles", "contacts", "analysis")
        kind = next(
            one for one in kinds if name in {each.name for each in fields(getattr(given, one))}
        )
        given = replace(given, **{kind: replace(getattr(given, kind), **{name: value})})
    return given


def shown(title: str, **values: Any) -> ReportInput:
    """Return what a report shows, given by the names of its values."""
    return having(ReportInput(PageHead(title)), **values)


def everything(frames: int = 200) -> ReportInput:
    """Return a report with all of its parts."""
    body = model()
    movement = motion(body, frames)
    time = movement.time
    torques = Series(time, body.coordinate_names, 20.0 * np.sin(time[:, None] * 5 + np.arange(8)))
    markers = Markers(time, ("RASI", "RKNE"), np.zeros((frames, 2, 3)))
    return shown(
        "walker: first steps",
        subject="a walker",
        date="2026-01-02",
        version="1.2.3",
        notes=(Note("simulated", "everything here is made up"),),
        sources=(SourceFile("model", "walker.osim", "ab" * 32),),
        steps=(
            Step(
                name="inverse kinematics", options={"tolerance": "1e-6"}, seconds=0.5, frames=frames
            ),
        ),
        model=body,
        markers=markers,
        fit=fitted(movement),
        wrenches=steps(time, body.mass * GRAVITY),
        torques=torques,
        tension=Tension(body, time),
        reserve_coordinates=("hip_flexion_r", "knee_angle_r"),
        warnings=("one thing was odd",),
    )

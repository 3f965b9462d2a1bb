"""Anatomy of myo-sim's legs as measured: knees, patellae, gluteal paths, fibers and strength."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import PiecewisePolynomial
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.paths import Muscle, PathPoint, PathWrap, WrapObject
from myomorph.core.model.sides import split_side
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.knees import knee_joints

KNEE_CENTER = np.array([-0.0080895, -0.0035348, -0.0014847])
"""Of the right knee in the tibia's frame (Rajagopal et al. 2016), in which myo-sim's tibia is too
[m].

myo-sim bends the knee about the tibia's origin, 9 mm from there: moment arms of hamstrings come out
8 mm too large, those of the patellar tendon 6 mm too small near extension.
"""
PATELLA_TRACK = {
    "knee_angle_beta_translation1": (
        0.05238345,
        -0.01566967,
        -0.02782212,
        -0.00178209,
        0.0137605,
        -0.00597871,
        0.00086048,
    ),
    "knee_angle_beta_translation2": (
        -0.01082157,
        -0.04853198,
        0.00796886,
        0.01404748,
        -0.00148646,
        -0.00247609,
        0.00067642,
    ),
}
"""Polynomials of the knee's angle by the patella's coordinate, forward and up on the thigh [m].

Up to 60 degrees as in Rajagopal et al. (2016), beyond up to 1.5 mm from there: so that quadriceps'
moment arm over that of the patellar tendon is 0.68 at 75 degrees and stays at 0.6 from 90 on, as
the measured ratio of their forces does (Buff et al. 1988). Before it fell to 0.5 and rose above 1.
"""
SPECIFIC_TENSION = 60.0
OF_ARMS = 50.8
"""Maximum isometric force of a cross-section of legs (Rajagopal et al. 2016), of arms (Saul et al.
2015) [N/cm^2].
"""
MASS = 75.0
HEIGHT = 1.70  # Of the body whose cross-sections the table has [kg], [m].


class Cylinder(NamedTuple):
    """A surface of the right side that muscles go around, where myo-sim has none.

    Attributes
    ----------
    muscles : names without the side
    body : with "_" where it has a side
    radius, length : [m]
    center : (3,) in the body [m]
    angles : (3,) body-fixed x-y-z [rad]
    side : of the surface that counts, "" for all
    between : numbers of the path points between which it counts, -1 for the ends

    Notes
    -----
    Source: Rajagopal et al. 2016.
    """

    muscles: tuple[str, ...]
    body: str
    radius: float
    length: float
    side: str
    center: tuple[float, float, float]
    angles: tuple[float, float, float]
    between: tuple[int, int] = (-1, -1)


CYLINDERS = (
    Cylinder(
        muscles=("glmax1",),
        body="pelvis",
        radius=0.04,
        length=0.15,
        side="-x",
        center=(-0.077, -0.099, 0.061),
        angles=(-0.6, 0.45, 0.0),
    ),
    Cylinder(
        muscles=("glmax2",),
        body="pelvis",
        radius=0.04,
        length=0.10,
        side="",
        center=(-0.080, -0.083, 0.068),
        angles=(-0.75, 0.39, 0.0),
    ),
    Cylinder(
        muscles=("glmax3",),
        body="pelvis",
        radius=0.04,
        length=0.10,
        side="",
        center=(-0.083, -0.088, 0.068),
        angles=(-0.1, 0.0, 0.0),
    ),
    Cylinder(
        muscles=("psoas",),
        body="pelvis",
        radius=0.05,
        length=0.10,
        side="-y",
        center=(-0.074, -0.060, 0.0656),
        angles=(-0.25, -0.27, 0.1),
        between=(2, 3),
    ),
    Cylinder(
        muscles=("iliacus",),
        body="pelvis",
        radius=0.0549,
        length=0.10,
        side="-y",
        center=(-0.071, -0.065, 0.0756),
        angles=(-0.32, -0.24, 0.9),
        between=(2, 3),
    ),
    Cylinder(
        muscles=("gasmed", "gaslat"),
        body="femur_",
        radius=0.025,
        length=0.10,
        side="",
        center=(0.005, -0.410, 0.0),
        angles=(0.0, 0.0, 0.0),
    ),
)
"""Without them gluteus maximus has no moment arm where a hip is bent by 100 degrees, psoas half of
its own where it is straight, and gastrocnemius half of its own where the knee is.
"""


ABDUCTORS = {
    "glmed1": {0: (-0.04914, 0.02615, 0.11529), 1: (-0.01389, -0.01829, 0.05919)},
    "glmed2": {0: (-0.08473, 0.05463, 0.08198), 1: (-0.02204, -0.00996, 0.05613)},
    "glmed3": {0: (-0.09987, 0.01556, 0.06390)},
    "glmin1": {0: (-0.02958, -0.00011, 0.11845), 1: (0.00549, -0.01549, 0.05604)},
    "glmin2": {0: (-0.06160, 0.01000, 0.10115), 1: (0.00354, -0.00901, 0.05246)},
    "glmin3": {1: (-0.00358, -0.00127, 0.05126)},
    "tfl": {0: (-0.02034, 0.01085, 0.12930)},
}
"""Attachments of abductors by the number of the path's point, of the right side (Uhlrich et al.
2022) [m].

myo-sim has those of Rajagopal et al. (2016): arms to abduct by are up to 0.8 cm shorter, and fore
parts extend the hip.
"""


class Architecture(NamedTuple):
    """Of one muscle: a line of `architecture.toml`.

    Attributes
    ----------
    fiber : optimal length [cm]
    pennation : at that length [deg]
    section : physiological cross-section [cm^2]
    at_zero : length of the fiber in the anatomical pose over its optimal length, on a tendon at its
        slack length
    """

    fiber: float
    pennation: float
    section: float
    at_zero: float


@cache
def architectures() -> Mapping[str, Architecture]:
    """Lines of the table by the muscle's name without its side."""
    text = (files("myomorph.lab.analyze") / "data" / "architecture.toml").read_text("utf-8")
    return FrozenMap(
        {
            name: Architecture(
                fiber=float(fiber),
                pennation=float(pennation),
                section=float(section),
                at_zero=float(at_zero),
            )
            for name, (fiber, pennation, section, at_zero) in tomllib.loads(text).items()
        }
    )


def with_anatomical_knees(model: Model) -> Model:
    """Let knees turn about `KNEE_CENTER`, and patellae go on `PATELLA_TRACK`.

    At 0 degrees they look as before.
    """
    knees = {joint.name for joint in knee_joints(model)}
    joints = tuple(_centered(joint) if joint.name in knees else joint for joint in model.joints)
    tracks = {
        f"{name}_{side}": np.array([values])
        for name, values in PATELLA_TRACK.items()
        for side in "rl"
    }
    couplers = tuple(
        replace(coupler, function=PiecewisePolynomial(np.zeros(1), tracks[coupler.dependent]))
        if coupler.dependent in tracks
        else coupler
        for coupler in model.couplers
    )
    return replace(model, joints=joints, couplers=couplers)


def _centered(knee: Joint) -> Joint:
    place = KNEE_CENTER * (1.0, 1.0, 1.0 if split_side(knee.child)[1] == "right" else -1.0)
    parent = knee.parent_frame
    child = knee.child_frame
    moved = parent.rotation @ child.rotation.T @ place
    return replace(
        knee,
        parent_frame=Transform(parent.rotation, parent.translation + moved),
        child_frame=Transform(child.rotation, child.translation + place),
    )


def with_abductors(model: Model) -> Model:
    """Give a model the attachments of `ABDUCTORS`."""
    return replace(model, muscles=tuple(_attached(muscle) for muscle in model.muscles))


def _attached(muscle: Muscle) -> Muscle:
    stem, side = split_side(muscle.name)
    points = list(muscle.path.points)
    for number, place in ABDUCTORS.get(stem, {}).items():
        location = np.array(place) * (1.0, 1.0, 1.0 if side == "right" else -1.0)
        points[number] = PathPoint(points[number].name, points[number].body, location)
    return replace(muscle, path=replace(muscle.path, points=tuple(points)))


def with_cylinders(model: Model) -> Model:
    """Let muscles go around `CYLINDERS`, in OpenSim's form.

    Gluteus maximus and iliacus go around these alone.
    """
    made: list[WrapObject] = []
    uses: dict[str, PathWrap] = {}
    for cylinder in CYLINDERS:
        for side, mirror in (("r", 1.0), ("l", -1.0)):
            body = f"{cylinder.body}{side}" if cylinder.body.endswith("_") else cylinder.body
            turn = rotation_from_euler_xyz(np.array(cylinder.angles) * (mirror, mirror, 1.0))
            pose = Transform(turn, np.array(cylinder.center) * (1.0, 1.0, mirror))
            name = f"{cylinder.muscles[0]}_{side}_at_{cylinder.body.rstrip('_')}"
            made.append(
                WrapObject(
                    name=name,
                    body=body,
                    kind="cylinder",
                    pose=pose,
                    size=(cylinder.radius, cylinder.length),
                    quadrant=cylinder.side,
                )
            )
            first, last = cylinder.between
            wrap = PathWrap(wrap_object=name, method="hybrid", first=first, last=last)
            uses |= {f"{muscle}_{side}": wrap for muscle in cylinder.muscles}
    muscles = tuple(_around(muscle, uses.get(muscle.name)) for muscle in model.muscles)
    return replace(model, muscles=muscles, wrap_objects=(*model.wrap_objects, *made))


def _around(muscle: Muscle, wrap: PathWrap | None) -> Muscle:
    if wrap is None:
        return muscle
    kept = () if muscle.name.startswith(("glmax", "iliacus")) else muscle.path.wraps
    return replace(muscle, path=replace(muscle.path, wraps=(*kept, wrap)))


def with_architecture(model: Model) -> Model:
    """Give muscles fibers, pennation and strengths of the table, and tendons that fit their paths.

    With the path in the model's default pose,

        l_slack = l_path - l_opt sqrt(at_zero^2 - sin(pennation)^2)

    Raises
    ------
    BadData : the table lacks a muscle
    """
    lengths = default_path_lengths(model)
    return replace(
        model,
        muscles=tuple(
            _built(muscle, float(length))
            for muscle, length in zip(model.muscles, lengths, strict=True)
        ),
    )


def _built(muscle: Muscle, length: float) -> Muscle:
    table = architectures()
    stem = split_side(muscle.name)[0]
    if stem not in table:
        raise BadData(f"muscle '{muscle.name}' is not in the table of muscle architecture")
    line = table[stem]
    fiber = 0.01 * line.fiber
    pennation = np.radians(line.pennation)
    return replace(
        muscle,
        # Muscles of arms have capitals for names in both sources.
        max_isometric_force=(OF_ARMS if stem[0].isupper() else SPECIFIC_TENSION) * line.section,
        optimal_fiber_length=fiber,
        pennation_at_optimal=float(pennation),
        tendon_slack_length=length
        - fiber * float(np.sqrt(line.at_zero**2 - np.sin(pennation) ** 2)),
        parameters=FrozenMap({}),
    )


def strength_of(mass: float, height: float) -> float:
    """Ratio of the forces of a body's leg muscles to those of the table's body.

    Volumes of leg muscles grow by 47.05 cm^3 per kg m from 1289.6 cm^3; cross-sections are these
    over lengths.

    Parameters
    ----------
    mass : of the body [kg]
    height : of the body [m]

    Notes
    -----
    Source: Handsfield et al. 2014.
    """
    volume = 47.05 * mass * height + 1289.6
    table = 47.05 * MASS * HEIGHT + 1289.6
    return volume / table * HEIGHT / height


def with_strength(model: Model, factor: float) -> Model:
    """Multiply maximum isometric forces by a factor."""
    return replace(
        model,
        muscles=tuple(
            replace(muscle, max_isometric_force=factor * muscle.max_isometric_force)
            for muscle in model.muscles
        ),
    )

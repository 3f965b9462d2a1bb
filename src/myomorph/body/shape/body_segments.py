"""Segments of a person's body: the skin's inside cut at the joints, and what each part weighs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.shape.people import People
from myomorph.body.shape.points import fill, reference_masses
from myomorph.body.shape.shape import RIGHT, UP, Shape
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.segments import Segment

SPACING = 0.008  # Of the grid of mass points [m]
SHAPE_SD = 0.06
"""Relative standard deviation of a segment's mass that girths and lengths do not explain: how
segments of the average man and woman differ from those of de Leva 1996 (table `body_average`).
"""
GIRTHS_OF: Mapping[str, tuple[str, ...]] = {
    "thigh": ("thigh", "knee"),
    "shank": ("calf", "ankle"),
    "foot": ("ankle",),
    "upper_arm": ("upper arm",),
    "lower_arm": ("forearm", "wrist"),
    "hand": ("wrist",),
}
TOUCHED = 0.05
"""Share of a limb in the nearest skin from which a point of the trunk may belong to the limb."""


@read_only
class SegmentMass:
    """Mass, mass center and inertia of a segment of the standing body.

    Attributes
    ----------
    segment : of the body
    mass : [kg]
    center : (3,) mass center, x forward, y up from the floor, z right [m]
    inertia : (3, 3) about the mass center, in the same axes [kg m^2]
    sd : relative standard deviation of the mass among people with the same measurements; NaN where
        no survey says it
    """

    segment: Segment
    mass: float
    sd: float
    center: Array
    inertia: Array


class Cut(NamedTuple):
    """A plane through a joint center between two segments.

    Attributes
    ----------
    inner, outer : the segments
    center : (3,) joint center [m]
    normal : (3,) unit vector to the outer segment
    """

    inner: Segment
    outer: Segment
    center: Array
    normal: Array


def segment_masses(shape: Shape, mass: float, spacing: float = SPACING) -> list[SegmentMass]:
    """Cut a body at its joints and weigh the parts.

    Planes pass through joint centers: horizontal at the hips, so that thighs begin there with all
    that lies below, upright at the shoulders, so that arms are what lies beside them, across the
    limb at wrists and ankles, and halfway between the limbs at elbows and knees (Yeadon 1990).
    Parts weigh their volume times `DENSITIES`, scaled to the whole mass.

    Parameters
    ----------
    shape : of the person
    mass : of the whole body [kg]
    spacing : of the grid of mass points [m]

    Returns
    -------
    one for each of the shape's segments, in their order [kg, m, kg m^2]
    """
    points = fill(shape.skin, spacing)
    owner = _owners(shape, points)
    names = np.array([segment.name for segment in shape.segments])[owner]
    masses = reference_masses(points, mass, names)
    weights = [float(masses[owner == i].sum()) for i in range(len(shape.segments))]
    errors = mass_errors(shape, dict(zip(shape.segments, weights, strict=True)))
    result = []
    for i, segment in enumerate(shape.segments):
        mine = owner == i
        part = masses[mine]
        total = weights[i]
        center = part @ points[mine] / total
        offsets = points[mine] - center
        products = (part[:, None] * offsets).T @ offsets + np.eye(3) * total * spacing**2 / 12.0
        inertia = np.trace(products) * np.eye(3) - products
        result.append(
            SegmentMass(
                segment=segment, mass=total, center=center, inertia=inertia, sd=errors[segment]
            )
        )
    return result


def mass_errors(shape: Shape, masses: Mapping[Segment, float]) -> dict[Segment, float]:
    """Compute by how much masses of segments differ among people with the same measurements.

    A limb's mass goes with the squares of its circumferences and with its length,

        d ln m = 2 mean(d ln girth) + d ln length,

    whose covariance is that of `people`. Trunk and head have what limbs leave of the whole. To this
    comes `SHAPE_SD`.

    Parameters
    ----------
    shape : with people alike
    masses : of the segments [kg]

    Returns
    -------
    relative standard deviation by segment; NaN where the shape has no people alike
    """
    alike = shape.alike
    if alike is None:
        return dict.fromkeys(masses, np.nan)
    rows: dict[Segment, Array] = {}
    whole = _row(alike, {"mass": 1.0}) if "mass" in alike.names else np.zeros(len(alike.names))
    hip = alike.expected("hip height")
    knee = alike.expected("knee height")
    lengths = {
        "thigh": {"hip height": hip / (hip - knee), "knee height": -knee / (hip - knee)},
        "shank": {"knee height": 1.0},
        "foot": {"knee height": 1.0},
        "upper_arm": {"upper arm length": 1.0},
        "lower_arm": {"forearm length": 1.0},
        "hand": {"forearm length": 1.0},
    }
    rest = whole * sum(masses.values())
    for segment in masses:
        if segment.name in GIRTHS_OF:
            around = dict.fromkeys(GIRTHS_OF[segment.name], 2.0 / len(GIRTHS_OF[segment.name]))
            rows[segment] = _row(alike, {**around, **lengths[segment.name]})
            rest = rest - masses[segment] * rows[segment]
    middle = sum(mass for segment, mass in masses.items() if segment.name not in GIRTHS_OF)
    result = {}
    for segment in masses:
        row = rows.get(segment, rest / middle)
        variance = float(row @ alike.covariance @ row)
        result[segment] = float(np.sqrt(variance + SHAPE_SD**2))
    return result


def _row(alike: People, slopes: Mapping[str, float]) -> Array:
    """Lay slopes of logarithms into the order of the survey's measurements."""
    return np.array([slopes.get(name, 0.0) for name in alike.names])


def _owners(shape: Shape, points: Array) -> np.ndarray:
    """Find the segment of each point: that of the nearest skin, then by the cuts.

    Parameters
    ----------
    points : (points, 3) [m]

    Returns
    -------
    (points,) numbers of segments
    """
    _, nearest = scipy.spatial.cKDTree(shape.skin.surface.vertices).query(points)
    return _cut(shape, points, shape.skinning.toarray()[nearest])


def skin_owners(shape: Shape) -> np.ndarray:
    """Find the segment of each vertex of the skin.

    Parameters
    ----------
    shape : of the person

    Returns
    -------
    (vertices,) numbers of segments
    """
    return _cut(shape, shape.skin.surface.vertices, shape.skinning.toarray())


def _cut(shape: Shape, points: Array, shares: Array) -> np.ndarray:
    """Give points to segments by shares, and by the cuts near the joints.

    Parameters
    ----------
    points : (points, 3) [m]
    shares : (points, segments) of the nearest skin

    Returns
    -------
    (points,) numbers of segments
    """
    owner = shares.argmax(axis=1)
    number = {segment: i for i, segment in enumerate(shape.segments)}
    for cut in cuts(shape):
        inner = number[cut.inner]
        outer = number[cut.outer]
        beyond = (points - cut.center) @ cut.normal > 0.0
        # Below the hips nothing but legs is left; elsewhere a limb is where its own skin is near.
        if cut.outer.name == "thigh":
            out = 1.0 if cut.outer.side == "right" else -1.0
            near = out * points[:, 2] > 0.0
        else:
            near = shares[:, outer] > TOUCHED
        owner[(owner == inner) & beyond & near] = outer
        owner[(owner == outer) & ~beyond] = inner
    return owner


def cuts(shape: Shape) -> list[Cut]:
    """Lay planes through the joints, from the limbs' ends to the trunk.

    Parameters
    ----------
    shape : with joint centers

    Returns
    -------
    for each joint
    """
    result = []
    for side in ("right", "left"):
        place = {
            name: shape.centers[f"{side} {name}"]
            for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
        }
        leg = [place["hip"], place["knee"], place["ankle"]]
        arm = [place["shoulder"], place["elbow"], place["wrist"]]
        for names, limb in (
            (("lower_trunk", "thigh", "shank", "foot"), leg),
            (("upper_trunk", "upper_arm", "lower_arm", "hand"), arm),
        ):
            first = _unit(limb[1] - limb[0])
            second = _unit(limb[2] - limb[1])
            outward = RIGHT if side == "right" else -RIGHT
            start = -UP if names[1] == "thigh" else outward
            normals = [start, _unit(first + second), second]
            for j in (2, 1, 0):
                inner = Segment(names[j], "" if j == 0 else side)
                outer = Segment(names[j + 1], side)
                result.append(Cut(inner=inner, outer=outer, center=limb[j], normal=normals[j]))
    for below, above, name in (
        ("upper_trunk", "head", "neck"),
        ("lower_trunk", "upper_trunk", "lumbar"),
    ):
        inner = Segment(below)
        outer = Segment(above)
        result.append(Cut(inner=inner, outer=outer, center=shape.centers[name], normal=UP))
    return result


def _unit(vector: Array) -> Array:
    """Scale a vector (3,) to length 1."""
    return vector / np.linalg.norm(vector)

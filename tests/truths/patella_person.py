"""A person with markers on the patellae, made by OpenSim and a bone's mesh.

Nothing of what estimates the distance of patellae takes part: bodies are scaled and posed by
OpenSim, markers stand on the hull of the bone, skin slides over it. What is not known has other
distributions than the estimate assumes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim
import scipy

from myomorph.core.model.series import Markers

opensim.Logger.setLevelString("Off")

WAY = np.array([0.975, -0.223, 0.0])
"""Out from the knee's axis on a patella of Rajagopal's model, which turns by half of the knee."""
MIDDLE = np.array([0.0072, 0.0264, 0.0])
"""Of the muscle paths there [m]."""
TRUNK = ("RASI", "LASI", "RPSI", "LPSI", "RACR", "LACR", "C7", "CLAV")
LEG = ("TH1", "TH2", "TH3", "LFC", "MFC", "TB1", "TB2", "TB3", "LMAL", "MMAL")
FOOT = ("CAL", "TOE", "MT5")
PLACED = (
    *TRUNK,
    *(f"{side}{name}" for side in "RL" for name in LEG),
    *(f"{side}{name}" for side in "RL" for name in FOOT),
)
BONY = ("ASI", "PSI", "LFC", "MFC", "LMAL", "MMAL", "CAL")
RADII = (0.0055, 0.0068, 0.0075, 0.0085, 0.0100)
"""Of markers with their bases [m]."""
SECONDS = 2.0
RATE = 30.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PatellaPerson:
    """What was recorded of a person, and the truth.

    Attributes
    ----------
    walk, static : markers
    farther : how much farther out the patellae are than in Rajagopal's model of the person's size
        [m]
    reach : from the knee's center to the muscle paths on the patella along the way out at
        `FLEXION`, mean of both knees [m]
    """

    walk: Markers
    static: Markers
    farther: float
    reach: float


FLEXION = np.radians(60.0)


@dataclass(frozen=True, kw_only=True)
class Traits:
    """What of a person is drawn.

    Attributes
    ----------
    farther : of the patellae [m]; None draws it
    skin : before the patella [m]; None draws it
    size : of the body; None draws it
    skin_moves : whether skin slides, and noise
    patella_markers : whether there are any
    offsets : standard deviation of a knee's axis and of a patella's track along each axis [m]
    """

    farther: float | None = None
    skin: float | None = None
    size: float | None = None
    skin_moves: bool = True
    patella_markers: bool = True
    offsets: tuple[float, float] = (0.0045, 0.004)


def recorded_person(model: Path, mesh: Path, seed: int, traits: Traits | None = None):
    """Record a person who stands, and walks.

    Parameters
    ----------
    model : Rajagopal's, with markers
    mesh : of the right patella (.vtp)
    seed : of all that is drawn
    traits : what is not drawn

    Returns
    -------
    the recordings with the truth
    """
    traits = traits or Traits()
    random = np.random.default_rng(seed)
    drawn = traits.farther if traits.farther is not None else 0.005 * random.standard_normal()
    person = opensim.Model(str(model))
    _scale(person, random, traits)
    _move_joints(person, random, traits, drawn)
    state = person.initSystem()
    places = _places(person, random)
    if traits.patella_markers:
        places |= _on_patellae(person, mesh, random, traits)
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    phase = 2.0 * np.pi * time / 1.1
    walk = _recorded(person, state, time, _walk(phase), places, random, traits)
    still = {name: np.full(10, value) for name, value in STANDING.items()}
    static = _recorded(person, state, time[:10], still, places, random, traits)
    return PatellaPerson(walk=walk, static=static, farther=drawn, reach=_reach(person, state))


STANDING = {"pelvis_ty": 0.95, "hip_flexion_r": 0.02, "hip_flexion_l": 0.02}


def _walk(phase):
    """Coordinates of a walk (frames,) [rad or m]."""
    values = {
        "pelvis_tx": 0.2 * phase,
        "pelvis_ty": 0.95 + 0.02 * np.sin(2.0 * phase),
        "pelvis_rotation": 0.08 * np.sin(phase),
        "pelvis_list": 0.06 * np.sin(phase),
        "lumbar_extension": np.full(len(phase), -0.05),
    }
    for side, shift in (("r", 0.0), ("l", np.pi)):
        here = phase + shift
        values[f"hip_flexion_{side}"] = 0.15 + 0.42 * np.sin(here)
        values[f"hip_rotation_{side}"] = 0.08 * np.cos(here)
        values[f"hip_adduction_{side}"] = 0.07 * np.cos(here)
        values[f"knee_angle_{side}"] = 0.55 - 0.45 * np.cos(here + 0.6)
        values[f"ankle_angle_{side}"] = 0.2 * np.sin(here + 1.0)
    return values


def _scale(person, random, traits) -> None:
    """Stretch every segment, both sides alike; nobody is Rajagopal's man."""
    size = traits.size if traits.size is not None else 1.0 + 0.06 * random.standard_normal()
    scales = opensim.ScaleSet()
    factors: dict[str, np.ndarray] = {}
    for number in range(person.getBodySet().getSize()):
        name = person.getBodySet().get(number).getName()
        stem = re.sub(r"_[rl]$", "", name).replace("patella", "femur")
        if stem not in factors:
            factors[stem] = size * (1.0 + 0.03 * random.standard_normal(3))
        scale = opensim.Scale()
        scale.setSegmentName(name)
        scale.setScaleFactors(opensim.Vec3(*factors[stem]))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    person.scale(person.initSystem(), scales, False, 75.0)


def _move_joints(person, random, traits, farther: float) -> None:
    """Move patellae out, their tracks anywhere, and the axes of the knees."""
    axis_sd, track_sd = traits.offsets
    for side in "rl":
        axis = axis_sd * random.standard_normal(3)
        knee = person.updJointSet().get(f"walker_knee_{side}")
        for number in (0, 1):
            _shift(knee.upd_frames(number), axis)
        patella = person.updJointSet().get(f"patellofemoral_{side}")
        _shift(patella.upd_frames(0), track_sd * random.standard_normal(3))
        _shift(patella.upd_frames(1), -farther * WAY)


def _shift(frame, move) -> None:
    before = frame.get_translation()
    frame.set_translation(opensim.Vec3(*(before.get(k) + move[k] for k in range(3))))


def _places(person, random) -> dict[str, tuple[str, np.ndarray]]:
    """Body and place of every marker but those on patellae, as an examiner puts them [m]."""
    places = {}
    for name in PLACED:
        marker = person.getMarkerSet().get(name)
        at = marker.get_location()
        body = marker.getParentFrameName().rsplit("/", 1)[-1]
        spread = 0.005 if name[1:] in BONY else 0.010
        place = np.array([at.get(k) for k in range(3)]) + spread * random.standard_normal(3)
        places[name] = (body, place)
    return places


def _on_patellae(person, mesh: Path, random, traits) -> dict[str, tuple[str, np.ndarray]]:
    """Markers on the skin before the patellae, somewhere about their middles."""
    hull = scipy.spatial.ConvexHull(_points(mesh))
    skin = traits.skin if traits.skin is not None else random.uniform(0.001, 0.010)
    radius = random.choice(RADII)
    thickness = 1.0 + 0.09 * random.standard_normal()
    places = {}
    for side in "RL":
        site = np.array([0.0, 0.026 + random.uniform(-0.01, 0.01), random.uniform(-0.008, 0.008)])
        mirrored = site * (1.0, 1.0, 1.0 if side == "R" else -1.0)
        normals = hull.equations[:, :3]
        offsets = hull.equations[:, 3]
        ahead = normals @ WAY > 1e-9
        front = np.min(-(offsets[ahead] + normals[ahead] @ mirrored) / (normals[ahead] @ WAY))
        depth = front + (site - MIDDLE) @ WAY
        place = site + (thickness * depth - depth + front + skin + radius) * WAY
        places[f"{side}PAT"] = (f"patella_{side.lower()}", place)
    return places


def _points(mesh: Path) -> np.ndarray:
    text = mesh.read_text()
    found = re.search(r"<Points>.*?<DataArray[^>]*>(.*?)</DataArray>", text, re.DOTALL)
    assert found is not None
    return np.array(found.group(1).split(), np.float64).reshape(-1, 3)


def _recorded(person, state, time, values, places, random, traits) -> Markers:
    """Pose the person, and let skin slide over the bones."""
    swings = {
        name: _sliding(name, random) if traits.skin_moves else np.zeros((2, 3)) for name in places
    }
    seen = np.empty((len(time), len(places), 3))
    coordinates = person.getCoordinateSet()
    for frame in range(len(time)):
        _pose(person, state, {name: float(series[frame]) for name, series in values.items()})
        for number, (name, (body, place)) in enumerate(places.items()):
            side = "r" if name[0] == "R" else "l"
            knee = coordinates.get(f"knee_angle_{side}").getValue(state)
            flexed = (knee - 0.5) / 0.5
            other = np.sin(3.0 * time[frame] + number)
            moved = place + flexed * swings[name][0] + other * swings[name][1]
            if body.startswith("patella") and traits.skin_moves:
                slide = 0.009 * flexed
                moved = moved + np.array([-(slide**2) / 0.1, slide, 0.0])
            station = (
                person.getBodySet()
                .get(body)
                .findStationLocationInGround(state, opensim.Vec3(*moved))
            )
            seen[frame, number] = [station.get(k) for k in range(3)]
    if traits.skin_moves:
        seen += 0.0005 * random.standard_normal(seen.shape)
    return Markers(time, tuple(places), seen)


def _pose(person, state, values) -> None:
    """Set coordinates [rad or m]; patellae turn as their knees."""
    for name, value in values.items():
        person.getCoordinateSet().get(name).setValue(state, value, False)
        if name.startswith("knee_angle"):
            person.getCoordinateSet().get(f"{name}_beta").setValue(state, value, False)
    person.realizePosition(state)


def _sliding(name: str, random) -> np.ndarray:
    """Sliding with flexion and without it (2, 3) [m]."""
    size = 0.008 if "TH" in name else 0.004
    if "PAT" in name:
        size = 0.0015
    return size / np.sqrt(2.0) * random.standard_normal((2, 3))


def _reach(person, state) -> float:
    """From the knees' centers to the muscle paths on the patellae, along the way out [m]."""
    found = []
    _pose(person, state, {"knee_angle_r": FLEXION, "knee_angle_l": FLEXION})
    for side in "rl":
        patella = person.getBodySet().get(f"patella_{side}")
        knee = person.getJointSet().get(f"walker_knee_{side}").get_frames(1)
        center = knee.getPositionInGround(state)
        scaled = _middle(person, state, side)
        out = patella.getTransformInGround(state).R()
        way = np.array([[out.get(i, k) for k in range(3)] for i in range(3)]) @ WAY
        found.append(float((scaled - np.array([center.get(k) for k in range(3)])) @ way))
    return float(np.mean(found))


def _middle(person, state, side: str) -> np.ndarray:
    """Middle of the muscle points on a patella in ground (3,) [m]."""
    points = []
    for name in ("recfem", "vasint", "vaslat", "vasmed"):
        path = opensim.Muscle.safeDownCast(
            person.getMuscles().get(f"{name}_{side}")
        ).getGeometryPath()
        for number in range(path.getPathPointSet().getSize()):
            point = path.getPathPointSet().get(number)
            if point.getParentFrame().getName() == f"patella_{side}":
                at = point.getLocationInGround(state)
                points.append([at.get(k) for k in range(3)])
    return np.mean(points, axis=0)

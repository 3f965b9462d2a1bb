"""Inertial sensors on a person, by SciPy alone: nothing here is shared with the estimator.

The chain of joints is read from an OpenSim model by a parser of its own. The person differs from
that model: other joint axes, skin that follows the joints and wobbles when a foot strikes, a
calibration pose that is off in every joint and on both sides alike, headings that differ and drift.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

Angles = Mapping[str, np.ndarray]
"""Coordinates over time by name [rad]."""
SEGMENTS = ("pelvis", "torso", "femur_r", "tibia_r", "calcn_r", "femur_l", "tibia_l", "calcn_l")
"""Bodies of the usual set of eight sensors."""
OWN_ANGLE = {
    "pelvis": "pelvis_tilt",
    "torso": "lumbar_extension",
    "femur": "hip_flexion",
    "tibia": "knee_angle",
    "calcn": "ankle_angle",
}
"""Coordinate that the skin below a sensor follows, by the body's name without its side."""
SKIN = {"pelvis": 0.03, "torso": 0.03, "femur": 0.06, "tibia": 0.04, "calcn": 0.02}
"""Standard deviation of the skin's rotation about each axis [rad]."""
STANCE = {
    "pelvis_tilt": 0.0,
    "hip_adduction": -0.04,
    "hip_rotation": -0.08,
    "knee_angle": 0.03,
}
"""How people stand against the model's default pose, by the beginning of a coordinate [rad]."""
WOBBLE_RATE = 9.0  # Of skin after a foot strike [Hz]
WOBBLE_TIME = 0.08  # In which it dies out [s]


@dataclass(frozen=True, kw_only=True)
class PersonErrors:
    """Standard deviations of what is wrong with a person and their sensors.

    Attributes
    ----------
    axes : of a joint's axes about each axis [rad]
    skin : factor on `SKIN`
    settled : of a sensor's rotation after the calibration pose, as it settles [rad]
    stance : of each joint in the calibration pose, shared by both sides [rad]
    one_sided : of each joint in the calibration pose, of its own side [rad]
    heading : of each sensor's heading [rad]
    drift : of each sensor's heading in a minute, a random walk [rad]
    noise : of each sensor's inclination and heading, correlated over a second [rad]
    """

    axes: float = 0.05
    skin: float = 1.0
    settled: float = 0.02
    stance: float = 0.05
    one_sided: float = 0.04
    heading: float = 0.05
    drift: float = 0.0
    noise: float = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class SensedPerson:
    """Sensors of a person, and the truth.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the bodies that carry sensors
    earth : (frames, sensors, 3, 3) from sensors to an earth whose z points up
    pose : (sensors, 3, 3) the same in the calibration pose
    mounted : (sensors, 3, 3) from sensors to bodies
    """

    time: np.ndarray
    names: tuple[str, ...]
    earth: np.ndarray
    pose: np.ndarray
    mounted: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Turn:
    """A rotation of a joint about an axis by a function of a coordinate."""

    axis: np.ndarray
    coordinate: str
    function: object


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joint:
    """A joint as an OpenSim file has it."""

    parent: str
    child: str
    before: Rotation
    after: Rotation
    turns: tuple[_Turn, ...]


class Chain:
    """Rotations of the bodies of an OpenSim model.

    Attributes
    ----------
    joints : child to joint
    """

    def __init__(self, path: Path):
        root = etree.parse(str(path)).getroot()
        self.joints = {joint.child: joint for joint in _joints(root)}

    def rotations(
        self, body: str, angles: Angles, tilts: Mapping[str, Rotation] | None = None
    ) -> Rotation:
        """Rotations of a body to ground.

        Parameters
        ----------
        body : name
        angles : over time
        tilts : by child, how a person's joint axes are tilted

        Returns
        -------
        of all times
        """
        count = len(next(iter(angles.values())))
        result = Rotation.identity(count)
        while body != "ground":
            joint = self.joints[body]
            result = _rotation_of(joint, angles, (tilts or {}).get(body), count) * result
            body = joint.parent
        return result


def sensed_person(
    chain: Chain, time: np.ndarray, angles: Angles, errors: PersonErrors, seed: int
) -> SensedPerson:
    """Simulate eight sensors on a person who moves.

    Parameters
    ----------
    chain : of the model
    time : (frames,) even [s]
    angles : coordinates over time [rad]
    errors : sizes of what is wrong
    seed : of the random numbers

    Returns
    -------
    orientations over time and in the calibration pose
    """
    rng = np.random.default_rng(seed)
    rate = 1.0 / float(np.median(np.diff(time)))
    tilts = {child: _random(rng, errors.axes) for child in chain.joints}
    common = rng.uniform(-np.pi, np.pi)
    stance = {name: np.array([value]) for name, value in _stance(rng, angles, errors).items()}
    earths = []
    poses = []
    mountings = [Rotation.random(random_state=rng) for _ in SEGMENTS]
    for body, mounted in zip(SEGMENTS, mountings, strict=True):
        skin = Rotation.from_rotvec(_skin(rng, body, time, angles, errors.skin))
        settled = _random(rng, errors.settled)
        noise = Rotation.from_rotvec(errors.noise * _slow(rng, len(time), rate))
        walk = rng.normal(size=len(time)).cumsum() * errors.drift / np.sqrt(60.0 * rate)
        heading = common + errors.heading * rng.normal() + walk
        moving = chain.rotations(body, angles, tilts) * skin * settled * mounted
        earths.append(_to_earth(heading) * noise * moving)
        poses.append(_to_earth(heading[:1]) * chain.rotations(body, stance, tilts) * mounted)
    return SensedPerson(
        time=time,
        names=SEGMENTS,
        earth=np.stack([one.as_matrix() for one in earths], axis=1),
        pose=np.concatenate([one.as_matrix() for one in poses]),
        mounted=np.stack([one.as_matrix() for one in mountings]),
    )


def quaternions(matrices: np.ndarray) -> np.ndarray:
    """Convert rotations to quaternions w, x, y, z.

    Parameters
    ----------
    matrices : (..., 3, 3)

    Returns
    -------
    (..., 4)
    """
    flat = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat()
    return np.roll(flat, 1, axis=1).reshape(*matrices.shape[:-2], 4)


def _joints(root: etree._Element) -> list[_Joint]:
    joints = []
    for kind in ("CustomJoint", "PinJoint", "WeldJoint"):
        for element in root.iter(kind):
            frames = {frame.get("name"): frame for frame in element.iter("PhysicalOffsetFrame")}
            parent = frames[element.findtext("socket_parent_frame").strip()]
            child = frames[element.findtext("socket_child_frame").strip()]
            joints.append(
                _Joint(
                    parent=parent.findtext("socket_parent").split("/")[-1],
                    child=child.findtext("socket_parent").split("/")[-1],
                    before=_euler(parent.findtext("orientation")),
                    after=_euler(child.findtext("orientation")).inv(),
                    turns=_turns(element),
                )
            )
    return joints


def _turns(element: etree._Element) -> tuple[_Turn, ...]:
    if element.tag == "PinJoint":
        name = next(element.iter("Coordinate")).get("name")
        return (_Turn(axis=np.array([0.0, 0.0, 1.0]), coordinate=name, function=lambda q: q),)
    turns = []
    for axis in element.iter("TransformAxis"):
        if axis.get("name").startswith("rotation"):
            turns.append(
                _Turn(
                    axis=np.array(axis.findtext("axis").split(), dtype=float),
                    coordinate=(axis.findtext("coordinates") or "").strip(),
                    function=_function(axis),
                )
            )
    return tuple(turns)


def _function(axis: etree._Element) -> object:
    linear = next(axis.iter("LinearFunction"), None)
    if linear is not None:
        slope, offset = np.array(linear.findtext("coefficients").split(), dtype=float)
        return lambda q: slope * q + offset
    spline = next(axis.iter("SimmSpline"), None)
    factor = float(axis.findtext(".//scale") or 1.0)
    if spline is None:
        value = float(axis.findtext(".//value") or 0.0)
        return lambda q: np.full_like(q, factor * value)
    x = np.array(spline.findtext("x").split(), dtype=float)
    y = np.array(spline.findtext("y").split(), dtype=float)
    curve = CubicSpline(x, factor * y)
    return lambda q: curve(np.clip(q, x[0], x[-1]))


def _euler(text: str) -> Rotation:
    return Rotation.from_euler("XYZ", np.array(text.split(), dtype=float))


def _rotation_of(joint: _Joint, angles: Angles, tilt: Rotation | None, count: int) -> Rotation:
    turned = Rotation.identity(count)
    for turn in joint.turns:
        q = angles.get(turn.coordinate, np.zeros(count))
        turned = turned * Rotation.from_rotvec(turn.function(q)[:, None] * turn.axis)
    if tilt is not None and joint.parent != "ground":
        turned = tilt * turned * tilt.inv()
    return joint.before * turned * joint.after


def _random(rng: np.random.Generator, sd: float) -> Rotation:
    return Rotation.from_rotvec(sd * rng.normal(size=3))


def _to_earth(heading: np.ndarray) -> Rotation:
    # Ground has y up, earth z up; the earth is turned about the vertical.
    upright = Rotation.from_rotvec([0.5 * np.pi, 0.0, 0.0])
    vertical = np.array([0.0, 0.0, 1.0])
    return Rotation.from_rotvec(-heading[:, None] * vertical) * upright


def _stance(rng: np.random.Generator, angles: Angles, errors: PersonErrors) -> dict[str, float]:
    stance = dict[str, float]()
    shared = dict[str, float]()
    for name in angles:
        start = name.removesuffix("_r").removesuffix("_l")
        # The heading of the pose is the person's own: there is no error of it.
        if name == "pelvis_rotation":
            stance[name] = 0.0
            continue
        if start not in shared:
            shared[start] = STANCE.get(start, 0.0) + errors.stance * rng.normal()
        stance[name] = shared[start] + errors.one_sided * rng.normal()
    return stance


def _skin(
    rng: np.random.Generator, body: str, time: np.ndarray, angles: Angles, factor: float
) -> np.ndarray:
    kind, _, side = body.partition("_")
    name = OWN_ANGLE[kind] + (f"_{side}" if side else "")
    size = factor * SKIN[kind]
    own = angles[name] - angles[name].mean()
    followed = 0.7 * rng.normal(size=3) * (own / max(own.std(), 1e-9))[:, None]
    rate = 1.0 / float(np.median(np.diff(time)))
    free = 0.5 * _slow(rng, len(time), 0.1 * rate)
    return size * (followed + free + _wobble(rng, time, angles, side or "r"))


def _wobble(rng: np.random.Generator, time: np.ndarray, angles: Angles, side: str) -> np.ndarray:
    # A foot strikes about when its hip is flexed most.
    hip = gaussian_filter1d(angles[f"hip_flexion_{side}"], 3.0)
    strikes = np.flatnonzero((hip[1:-1] > hip[:-2]) & (hip[1:-1] >= hip[2:]))
    pulse = np.zeros(len(time))
    pulse[strikes + 1] = 1.0
    clock = np.arange(0.0, 5.0 * WOBBLE_TIME, float(np.median(np.diff(time))))
    ringing = np.exp(-clock / WOBBLE_TIME) * np.sin(2.0 * np.pi * WOBBLE_RATE * clock)
    return 0.5 * np.convolve(pulse, ringing)[: len(time), None] * rng.normal(size=3)


def _slow(rng: np.random.Generator, frames: int, width: float) -> np.ndarray:
    smooth = gaussian_filter1d(rng.normal(size=(frames, 3)), max(width, 1.0), axis=0)
    return smooth / np.maximum(smooth.std(axis=0), 1e-12)

"""The curves of clinical gait analysis over the strides of each side.

They are angles, moments, powers and vertical force. Angles are those of the gait profile score
(Baker et al. 2009), pelvis and foot seen along the direction of the stride. The pelvis turns by
rotation, obliquity and tilt in this order (Baker 2001). Moments are those of muscles, per body
mass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.cycles import Cycles, over_cycles
from myomorph.lab.analysis.stood_strides import leg_force, stood_strides
from myomorph.lab.analysis.strides import Stride, Strides
from myomorph.lab.analysis.walking import chains, walking_limbs

SIDES = ("right", "left")
SAMPLES = 51  # Every 2 % of the cycle, as gait scores are defined


@dataclass(frozen=True)
class GaitVariable:
    """One curve of the page: its key, its words, and its unit in print."""

    key: str
    title: str
    unit: str
    kind: Literal["angle", "moment", "power", "force"]


VARIABLES: tuple[GaitVariable, ...] = (
    GaitVariable(key="pelvic_tilt", title="Pelvic tilt, anterior", unit="°", kind="angle"),
    GaitVariable(key="pelvic_obliquity", title="Pelvic obliquity, up", unit="°", kind="angle"),
    GaitVariable(key="pelvic_rotation", title="Pelvic rotation, forward", unit="°", kind="angle"),
    GaitVariable(key="hip_flexion", title="Hip flexion", unit="°", kind="angle"),
    GaitVariable(key="hip_adduction", title="Hip adduction", unit="°", kind="angle"),
    GaitVariable(key="hip_rotation", title="Hip rotation, internal", unit="°", kind="angle"),
    GaitVariable(key="knee_flexion", title="Knee flexion", unit="°", kind="angle"),
    GaitVariable(key="ankle_dorsiflexion", title="Ankle dorsiflexion", unit="°", kind="angle"),
    GaitVariable(
        key="foot_progression", title="Foot progression, internal", unit="°", kind="angle"
    ),
    GaitVariable(key="hip_moment", title="Hip extension moment", unit="N·m/kg", kind="moment"),
    GaitVariable(key="knee_moment", title="Knee extension moment", unit="N·m/kg", kind="moment"),
    GaitVariable(
        key="ankle_moment", title="Ankle plantarflexion moment", unit="N·m/kg", kind="moment"
    ),
    GaitVariable(key="hip_power", title="Hip power", unit="W/kg", kind="power"),
    GaitVariable(key="knee_power", title="Knee power", unit="W/kg", kind="power"),
    GaitVariable(key="ankle_power", title="Ankle power", unit="W/kg", kind="power"),
    GaitVariable(
        key="hip_abduction_moment", title="Hip abduction moment", unit="N·m/kg", kind="moment"
    ),
    GaitVariable(
        key="vertical_force", title="Vertical ground force", unit="body weights", kind="force"
    ),
)
KEYS: tuple[str, ...] = tuple(variable.key for variable in VARIABLES)
ANGLES = 9  # The first ones, which scores are of

SPELLINGS: Mapping[str, tuple[str, ...]] = {
    "hip_flexion": ("hip_flexion",),
    "hip_adduction": ("hip_adduction",),
    "hip_rotation": ("hip_rotation",),
    "knee_flexion": ("knee_angle", "knee_flexion"),
    "ankle_dorsiflexion": ("ankle_angle", "ankle_flexion"),
}
"""Coordinates of each joint angle, as models of the OpenSim family spell them."""
POWERS: Mapping[str, tuple[str, ...]] = {
    "hip_power": ("hip_flexion", "hip_adduction", "hip_rotation"),
    "knee_power": ("knee_flexion",),
    "ankle_power": ("ankle_dorsiflexion",),
}
MOMENTS: Mapping[str, str] = {
    "hip_moment": "hip_flexion",
    "knee_moment": "knee_flexion",
    "ankle_moment": "ankle_dorsiflexion",
    "hip_abduction_moment": "hip_adduction",
}
"""Moments against the angle of each, and angles whose moments do the work of a joint."""


@read_only
class GaitCurves:
    """Curves of both sides over their strides.

    A side has (strides, SAMPLES, `KEYS`) values, NaN where not known.

    Attributes
    ----------
    right, left : curves
    strides : by side
    peak_force : by side (strides,) the largest vertical force of each stride as measured, which
        lies between samples of the curve [body weights]; NaN where the foot was not on plates, {}
        without forces as measured
    """

    right: Cycles
    left: Cycles
    strides: Mapping[str, tuple[Stride, ...]]
    peak_force: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))

    def of(self, side: str) -> Array:
        """Return the curves of a side.

        Parameters
        ----------
        side : "right" or "left"

        Returns
        -------
        (strides, samples, variables) in the units of `KEYS`, NaN where not known
        """
        return self.right.values if side == "right" else self.left.values

    def mean(self, side: str) -> Array:
        """Return the mean over the strides that are known.

        Parameters
        ----------
        side : "right" or "left"

        Returns
        -------
        (samples, variables) NaN where no stride is known
        """
        return known_mean(self.of(side))


def joined_curves(parts: Sequence[GaitCurves]) -> GaitCurves:
    """Join the strides of several recordings of one person."""
    cycles = {
        side: Cycles(KEYS, np.concatenate([part.of(side) for part in parts])) for side in SIDES
    }
    strides = {
        side: tuple(stride for part in parts for stride in part.strides[side]) for side in SIDES
    }
    peaks = {}
    if all(part.peak_force for part in parts):
        peaks = {side: np.concatenate([part.peak_force[side] for part in parts]) for side in SIDES}
    return GaitCurves(
        right=cycles["right"], left=cycles["left"], strides=strides, peak_force=FrozenMap(peaks)
    )


def known_mean(values: Array) -> Array:
    """Average over the first axis what is known.

    Parameters
    ----------
    values : (n, ...) NaN where not known

    Returns
    -------
    (...) NaN where nothing is known
    """
    count = np.isfinite(values).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)


@dataclass(frozen=True, kw_only=True)
class WalkLoads:
    """What is known of the loads of a walk; without any of it there are curves of angles alone.

    Attributes
    ----------
    torques : (frames, coordinates) [N m]
    filtered : motion that the torques are of; the speeds of powers are its own, while angles stay
        those of the motion as it was found
    wrenches : on the feet; a stride whose foot did not stand on plates has angles alone
    measured : (samples, bodies) vertical force on each body as measured [N], which the curve of
        the force is of; by default it is that of the wrenches, which may be filtered
    """

    torques: Series | None = None
    filtered: Motion | None = None
    wrenches: Wrenches | None = None
    measured: Series | None = None


UNLOADED = WalkLoads()


def gait_curves(
    model: Model, motion: Motion, strides: Strides, loads: WalkLoads = UNLOADED
) -> GaitCurves | None:
    """Return the curves of a walk.

    Parameters
    ----------
    model : of the body
    motion : with the velocities of powers, else their differences are taken
    strides : of both feet
    loads : of the joints and the feet

    Returns
    -------
    None for a model whose hips and knees have no coordinates that the field knows
    """
    limbs = {split_side(limb)[1]: limb for limb in strides.strikes}
    wanted = [
        joint_coordinate(model, key, side)
        for side in SIDES
        for key in ("hip_flexion", "knee_flexion")
    ]
    if set(limbs) != set(SIDES) or not all(wanted):
        return None
    body = _Body.of(model, motion, limbs)
    cycles = {}
    peaks = {}
    for side in SIDES:
        own = strides.of(limbs[side])
        spans = [(stride.start, stride.stop) for stride in own]
        series = Series(motion.time, KEYS, _columns(body, strides, side, loads))
        values = np.array(over_cycles(series, spans, SAMPLES).values)
        leg = chains(model, walking_limbs(model))[limbs[side]]
        force = leg_force(model, leg, loads.wrenches, loads.measured)
        if force is not None:
            over_strides = over_cycles(force, spans, SAMPLES).values
            values[..., KEYS.index("vertical_force")] = over_strides[..., 0]
        stood = stood_strides(own, values[..., KEYS.index("vertical_force")])
        values[~stood, :, ANGLES:] = np.nan
        cycles[side] = Cycles(KEYS, values)
        if force is not None and loads.measured is not None:
            peaks[side] = np.where(stood, _largest(force, spans), np.nan)
    own_strides = {side: strides.of(limbs[side]) for side in SIDES}
    by_side = FrozenMap(peaks if len(peaks) == len(SIDES) else {})
    return GaitCurves(
        right=cycles["right"], left=cycles["left"], strides=own_strides, peak_force=by_side
    )


def _largest(force: Series, spans: Sequence[tuple[float, float]]) -> Array:
    """Largest sample (spans,) of a force within each span of time [s], NaN where there is none."""
    largest = np.full(len(spans), np.nan)
    for index, (start, stop) in enumerate(spans):
        inside = (force.time >= start) & (force.time <= stop)
        if inside.any():
            largest[index] = force.values[inside, 0].max()
    return largest


def joint_coordinate(model: Model, key: str, side: str) -> str:
    """Name of the coordinate of a joint angle of `SPELLINGS`, "" where the model has none."""
    spellings = [(base, side) for base in SPELLINGS[key]]
    return next((name for name in model.coordinate_names if split_side(name) in spellings), "")


def flexion_sign(model: Model, key: str, name: str) -> float:
    """-1 for a knee's coordinate that goes down as it bends, as in OpenSim's gait2392, else 1."""
    low, high = model.coordinate(name).range
    return -1.0 if key == "knee_flexion" and -low > high else 1.0


@read_only
class _Body:
    """A motion with the rotations of pelvis and feet from the default pose.

    Components are along travel: forward, up, right.
    """

    model: Model
    motion: Motion
    limbs: Mapping[str, str]
    pelvis: Array  # (frames, 3, 3)
    place: Array  # (frames, 3) of the pelvis
    feet: Mapping[str, Array]  # by side, (frames, 3, 3)
    axes: Array  # (3, 3) forward, up and right of the default pose, by its hips, as columns

    @classmethod
    def of(cls, model: Model, motion: Motion, limbs: Mapping[str, str]) -> _Body:
        """Find pelvis and feet in every frame; frames without a pose are NaN."""
        tree = compile_tree(model)
        values = tree.coordinates_of(motion)
        known = np.asarray(np.isfinite(values).all(axis=1), np.bool_)
        values[~known] = tree.defaults
        # The default pose, upright and facing forward, joints straight.
        turns = np.array([coordinate.motion == "rotational" for coordinate in model.coordinates])
        standing = np.where(turns, 0.0, tree.defaults)
        poses = forward_kinematics(tree, values)
        neutral = forward_kinematics(tree, standing[None])
        names = [joint_coordinate(model, "hip_flexion", side) for side in SIDES]
        hips = [
            next(joint for joint in model.joints if name in joint.coordinates) for name in names
        ]
        pelvis = hips[0].parent

        def turned(name: str) -> Array:
            index = tree.body_index[name]
            rotations = poses.rotations[:, index] @ neutral.rotations[0, index].T
            return np.where(known[:, None, None], rotations, np.nan)

        right, left = neutral.origins[0, [tree.body_index[hip.child] for hip in hips]]
        place = np.where(known[:, None], poses.origins[:, tree.body_index[pelvis]], np.nan)
        feet = {side: turned(limb) for side, limb in limbs.items()}
        axes = _axes(np.asarray(model.up), right - left)
        return cls(model, motion, FrozenMap(limbs), turned(pelvis), place, feet, axes)


def _axes(up: Array, rightward: Array) -> Array:
    """Make axes (3, 3), one a column: forward, up, right, of a way to the right."""
    forward = np.cross(up, rightward)
    forward /= np.linalg.norm(forward)
    return np.stack([forward, up, np.cross(forward, up)], axis=1)


def _speeds(motion: Motion, filtered: Motion | None) -> Array:
    """Return speeds (frames, coordinates) of a motion, of its filtered one where that is known."""
    known = motion if filtered is None else filtered
    speeds = known.velocities
    if speeds is None:
        speeds = np.gradient(known.values, known.time, axis=0)
    if known is motion:
        return np.array(speeds)
    columns = [known.names.index(name) for name in motion.names]
    return np.stack(
        [
            np.interp(motion.time, known.time, speeds[:, column], np.nan, np.nan)
            for column in columns
        ],
        axis=1,
    )


def _columns(body: _Body, strides: Strides, side: str, loads: WalkLoads) -> Array:
    """(frames, `KEYS`) of one side, but for the force."""
    motion = body.motion
    out = {key: np.full(len(motion), np.nan) for key in KEYS}
    ways = _ways(body, strides, strides.of(body.limbs[side]))
    frames = np.stack(
        [ways, np.broadcast_to(body.axes[:, 1], ways.shape), np.cross(ways, body.axes[:, 1])],
        axis=2,
    )
    pelvis = np.swapaxes(frames, 1, 2) @ body.pelvis @ body.axes
    foot = np.swapaxes(frames, 1, 2) @ body.feet[side] @ body.axes
    mirrored = 1.0 if side == "right" else -1.0
    out["pelvic_tilt"] = -np.degrees(np.arctan2(pelvis[:, 1, 0], pelvis[:, 1, 1]))
    out["pelvic_obliquity"] = mirrored * np.degrees(np.arcsin(np.clip(pelvis[:, 1, 2], -1.0, 1.0)))
    out["pelvic_rotation"] = mirrored * np.degrees(np.arctan2(pelvis[:, 0, 2], pelvis[:, 2, 2]))
    out["foot_progression"] = -mirrored * np.degrees(np.arctan2(foot[:, 2, 0], foot[:, 0, 0]))
    out |= _joint_columns(body.model, motion, side, loads)
    return np.stack([out[key] for key in KEYS], axis=1)


def _joint_columns(model: Model, motion: Motion, side: str, loads: WalkLoads) -> dict[str, Array]:
    """Angles, moments and powers (frames,) of the joints of one side, by key."""
    out = {}
    torques = loads.torques
    velocities = _speeds(motion, loads.filtered)
    moments = {}
    rates = {}
    for key in SPELLINGS:
        name = joint_coordinate(model, key, side)
        if not name:
            continue
        sign = flexion_sign(model, key, name)
        column = motion.names.index(name)
        out[key] = np.degrees(sign * motion.values[:, column])
        rates[key] = sign * velocities[:, column]
        if torques is not None and name in torques.names:
            moments[key] = (
                sign
                * np.interp(motion.time, torques.time, torques[name], np.nan, np.nan)
                / model.mass
            )
    for key, angle in MOMENTS.items():
        if angle in moments:
            out[key] = -moments[angle]
    for key, angles in POWERS.items():
        works = [moments[angle] * rates[angle] for angle in angles if angle in moments]
        if works:
            out[key] = np.sum(works, axis=0)
    return out


def _ways(body: _Body, strides: Strides, own: Sequence[Stride]) -> Array:
    """Find the direction of travel of each frame, (frames, 3).

    Over ground it is that of the pelvis in each stride, for walks to and fro.
    """
    time = body.motion.time
    flat = np.eye(3) - np.outer(body.axes[:, 1], body.axes[:, 1])
    ways = np.tile(strides.direction, (len(time), 1))
    if strides.travel is not None:
        ways = np.array(strides.travel.along_at(time))
    if strides.ground_speed != 0.0:
        return ways
    step = float(np.median(np.diff(time)))
    for stride in own:
        during = (time >= stride.start - step) & (time <= stride.stop + step)
        seen = body.place[during]
        seen = seen[np.isfinite(seen[:, 0])]
        way = flat @ (seen[-1] - seen[0]) if len(seen) > 1 else np.zeros(3)
        # In place, as on a belt that was not told of, the pelvis only drifts.
        if np.linalg.norm(way) > 0.5 * abs(stride.length) > 0.0:
            ways[during] = way / np.linalg.norm(way)
    return ways

"""One body that is played again, at any of its frames.

Everything is in arrays that a page can take.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Wrenches
from myomorph.core.muscles.drawn_paths import drawn_paths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.selection import Subject, centroids, subjects
from myomorph.lab.report.scene.image import activation_color
from myomorph.lab.report.scene.scene import Acting, Scene, make_scene, nearest_samples
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.viewer.web_page import DEEPER

Bytes = NDArray[np.uint8]
Single = NDArray[np.float32]

TALL = 1.2  # Most size of a body against its height.
FRAMES_LOOKED_AT = 24  # Frames that tell how far the body reaches and where it looks.
SLACK = 0.002
TIGHT = 0.0085
"""Radius of a muscle without tension, and what its maximum isometric force adds, as shares of the
body's size.
"""

FOUND = 1.5
OTHERS = 0.82  # How much thicker muscles are that were searched for, and how far the others fade.
UNKNOWN_COLOR = (0.72, 0.24, 0.24)  # Color of muscles whose activation was not asked for.
FADED = np.array([0.80, 0.77, 0.72])  # Color towards which the others fade.
WEIGHT = 0.45  # Length of an arrow of one body weight, as a share of the body's size.
MIN_FORCE = 0.005  # Smaller forces are not drawn, as a share of body weight.
SHAFT = 0.006
HEAD = 0.045
"""Radius of an arrow's shaft and length of its head, as shares of the body's size; both of a short
one are smaller.
"""


@dataclass(frozen=True, eq=False)
class Tubes:
    """Muscle paths as straight tubes along z.

    They have middles, turns (w, x, y, z) and sizes (radius, radius, half length).
    """

    positions: Single
    wxyzs: Single
    scales: Single
    colors: Bytes


@read_only
class Instant:
    """A body at one time, in ground."""

    known: bool  # whether the coordinates of this frame are
    # rotations, origins: (bodies + 1, 3, 3), (bodies + 1, 3) poses, the ground first
    rotations: Array
    origins: Array
    tubes: Tubes  # of the muscles
    # recorded, modelled: (markers, 3) NaN where hidden [m]
    recorded: Array
    modelled: Array
    # measured, estimated: (forces, 2, 3) start and end of the arrows of plates and of contacts, NaN
    # without a force
    measured: Array
    estimated: Array
    centers: Array  # (subjects, 3) of mass [m]

    @property
    def middle(self) -> Array:
        """The mean of the centers of mass, (3,) [m].

        Where nothing has a mass, it is the first body's origin.
        """
        seen = self.centers[np.isfinite(self.centers).all(axis=1)]
        return seen.mean(axis=0) if len(seen) else self.origins[1]


class PlayedBody:
    """One body with all that was found of it, frame by frame on demand, at `time` (frames,) [s].

    Attributes
    ----------
    time : (frames,) [s]
    known : (frames,) whether the coordinates of each frame are
    size : that all that is drawn is thick by [m]
    centers : (frames, subjects, 3) of mass [m]
    activations, tensions : (frames, `muscles`), tensions [N]; NaN where unknown
    measured, estimated : (frames, forces, 2, 3) start and end of the arrows of plates and of
        contacts, NaN without a force [m]
    fibers : normalized lengths and tendon strains, None unless tendons were elastic
    """

    def __init__(self, results: ReportInput):
        model = results.model
        motion = results.kinematics.motion
        if model is None or motion is None or not len(motion):
            raise BadData(
                f"{results.head.title}: has no motion to show: run 'ik', or a step that takes a"
                " motion"
            )
        self.results = results
        self.model = model
        self.motion = motion
        self.time = motion.time
        self._tree = compile_tree(model)
        self._coordinates = np.ascontiguousarray(
            self._tree.coordinates_of(motion), dtype=np.float64
        )
        self.known = np.asarray(np.isfinite(self._coordinates).all(axis=1))
        if not self.known.any():
            raise BadData(
                f"{results.head.title}: no frame of the motion has a value for every coordinate"
            )
        shown = np.flatnonzero(self.known)
        self._some = np.unique(shown[np.linspace(0, len(shown) - 1, FRAMES_LOOKED_AT).astype(int)])
        bare = replace(model, muscles=())
        wrenches = results.dynamics.wrenches
        self.scene: Scene = make_scene(
            bare, motion, self._some.tolist(), results.surfaces, Acting(wrenches=wrenches)
        )
        # Two people far apart, or one who leaps, do not make a body larger.
        self.size = min(self.scene.size, TALL * (self.scene.high - self.scene.low))
        self._paths = compile_paths(model)
        self.muscles = model.muscle_names
        self._muscles = _Muscles(model, results, motion.time)
        self.activations = self._muscles.activations
        self.tensions = self._muscles.tensions
        self.fibers = self._muscles.fibers
        self._markers = _Markers(model, results, motion.time, self._tree.body_index)
        self.subjects = subjects(model) or (
            Subject(name="", prefix="", bodies=model.body_names, muscles=model.muscle_names),
        )
        self.centers: Array = np.stack(
            [each.values for each in centroids(model, motion, self.subjects)], axis=1
        )
        masses = [
            sum(model.body(name).mass for name in subject.bodies) for subject in self.subjects
        ]
        # Arrows are drawn by the weight of the heaviest subject.
        weight = self.scene.weight * (max(masses) / model.mass if model.mass > 0.0 else 1.0)
        self.measured = _arrows(wrenches, motion.time, weight, self.size)
        estimated = (
            None if results.contacts.forces is None else results.contacts.forces.wrenches("group")
        )
        self.estimated = _arrows(estimated, motion.time, weight, self.size)

    @cached_property
    def tube_muscles(self) -> np.ndarray:
        """(tubes,) the index of the muscle of each tube."""
        owner = drawn_paths(self._paths, self._coordinates[np.flatnonzero(self.known)[:1]]).muscle
        return owner[1:][owner[1:] == owner[:-1]]

    @property
    def travelled(self) -> float:
        """How far the root gets from where it begins, over the floor [m]."""
        roots = forward_kinematics(self._tree, self._coordinates[self._some]).origins[:, 1]
        way = roots - roots[0]
        return float(
            np.linalg.norm(way - np.outer(way @ self.scene.up, self.scene.up), axis=1).max()
        )

    def frame_at(self, time: float) -> int:
        """Return the frame nearest to a time [s]."""
        return int(nearest_samples(self.time, np.array([time]))[0])

    def posed_frame(self, frame: int) -> int:
        """Return the frame whose pose is shown at a frame.

        It is the last one that is known, else the first.
        """
        before = np.flatnonzero(self.known[: frame + 1])
        return int(before[-1] if len(before) else np.flatnonzero(self.known)[0])

    def at(self, frame: int, chosen: Collection[int] = ()) -> Instant:
        """Pose the body at a frame; muscles `chosen` by index stand out.

        An unknown frame shows the last known pose.
        """
        known = bool(self.known[frame])
        posed = self.posed_frame(frame)
        coordinates = self._coordinates[posed : posed + 1]
        poses = forward_kinematics(self._tree, coordinates)
        rotations = poses.rotations[0]
        origins = poses.origins[0]
        points = drawn_paths(self._paths, coordinates)
        return Instant(
            known=known,
            rotations=rotations,
            origins=origins,
            tubes=tubes(
                points.places[0], points.muscle, *self._muscles.look(frame, self.size, chosen)
            ),
            recorded=self._markers.recorded[frame],
            modelled=self._markers.modelled(rotations, origins),
            measured=self.measured[frame],
            estimated=self.estimated[frame],
            centers=self.centers[posed],
        )

    def middle_of(self, frame: int, muscle: int) -> Array:
        """Find a position in the middle of a muscle, for its label.

        Parameters
        ----------
        frame : of the motion
        muscle : index

        Returns
        -------
        (3,) in ground [m]
        """
        posed = frame if self.known[frame] else int(np.flatnonzero(self.known)[0])
        drawn = drawn_paths(self._paths, self._coordinates[posed : posed + 1])
        segments = drawn.places[0, drawn.muscle == muscle]
        segments = segments[np.isfinite(segments).all(axis=1)]
        steps = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(segments, axis=0), axis=1))]
        return np.array([np.interp(0.5 * steps[-1], steps, segments[:, i]) for i in range(3)])


def arrows(ends: Array, size: float, color: Array) -> tuple[Tubes, Tubes]:
    """Make shafts and heads of arrows.

    Parameters
    ----------
    ends : (arrows, 2, 3) start and end of each [m], NaN where there is none
    size : of the body beside them [m]
    color : (3,) red, green, blue from 0 to 1

    Returns
    -------
    Shafts and heads
    """
    along = ends[:, 1] - ends[:, 0]
    lengths = np.nan_to_num(np.linalg.norm(along, axis=1))
    neck = (
        ends[:, 1]
        - along * (np.minimum(HEAD * size, 0.4 * lengths) / np.maximum(lengths, 1e-12))[:, None]
    )
    radii = np.minimum(SHAFT * size, 0.06 * lengths)
    owner = np.repeat(np.arange(len(ends)), 2)
    colors = np.tile(color, (len(ends), 1))
    shafts = np.stack([ends[:, 0], neck], axis=1).reshape(-1, 3)
    heads = np.stack([neck, ends[:, 1]], axis=1).reshape(-1, 3)
    return tubes(shafts, owner, radii, colors, 0.0), tubes(heads, owner, 2.6 * radii, colors, 0.0)


def tubes(
    points: Array, muscle: np.ndarray, radii: Array, colors: Array, beyond: float = 0.35
) -> Tubes:
    """Make a tube between every two points that follow each other on a muscle.

    There are as many at any frame; those that do not exist have no size.

    Parameters
    ----------
    points : (points, 3) [m], NaN where there is none
    muscle : (points,) index of each point's muscle
    radii : (muscles,) [m]
    colors : (muscles, 3) red, green, blue from 0 to 1
    beyond : how far a tube goes on at both ends, in radii, so that no gap opens where a path bends

    Returns
    -------
    The tubes, in order of the points
    """
    joined = muscle[1:] == muscle[:-1]
    start = points[:-1][joined]
    end = points[1:][joined]
    owner = muscle[1:][joined]
    along = end - start
    lengths = np.linalg.norm(along, axis=1)
    exists = np.isfinite(lengths) & (lengths > 1e-9)
    unit = np.where(
        exists[:, None], along / np.where(exists, lengths, 1.0)[:, None], [0.0, 0.0, 1.0]
    )
    # The shortest turn of z to the direction; (0, 1, 0, 0) turns z to -z.
    turns = np.stack([1.0 + unit[:, 2], -unit[:, 1], unit[:, 0], np.zeros(len(unit))], axis=1)
    turns[unit[:, 2] < -1.0 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    radius = np.where(exists, radii[owner], 0.0)
    half = np.where(exists, 0.5 * lengths + beyond * radius, 0.0)
    return Tubes(
        positions=np.where(exists[:, None], 0.5 * (start + end), 0.0).astype(np.float32),
        wxyzs=turns.astype(np.float32),
        scales=np.stack([radius, radius, half], axis=1).astype(np.float32),
        colors=np.round(255.0 * colors[owner]).astype(np.uint8),
    )


class _Muscles:
    """How muscles look: activation as color, tension as cross-section."""

    def __init__(self, model: Model, results: ReportInput, time: Array):
        shape = (len(time), len(model.muscles))
        self.activations = np.full(shape, np.nan)
        self.tensions = np.full(shape, np.nan)
        self._strengths = np.array(
            [max(muscle.max_isometric_force, 0.0) for muscle in model.muscles]
        )
        self._solved = results.tension is not None
        self.fibers: tuple[Array, Array] | None = None
        if results.tension is not None and len(results.tension.time):
            columns = {name: i for i, name in enumerate(results.tension.muscles)}
            order = np.array([columns.get(name, -1) for name in model.muscle_names])
            clock = results.tension.time
            fibers = results.tension.fibers

            def of_muscles(recorded: Array) -> Array:
                values = np.full(shape, np.nan)
                values[:, order >= 0] = _nearest(clock, recorded, time)[:, order[order >= 0]]
                return values

            self.activations, self.tensions = map(
                of_muscles, (results.tension.activation, results.tension.muscle_force)
            )
            if fibers is not None:
                optimal = np.array([muscle.optimal_fiber_length for muscle in model.muscles])
                self.fibers = (
                    of_muscles(fibers.fiber_length) / optimal,
                    of_muscles(fibers.tendon_strain),
                )

    def look(self, frame: int, size: float, chosen: Collection[int]) -> tuple[Array, Array]:
        """Radii (muscles,) [m] and colors (muscles, 3) in 0..1 at a frame."""
        most = max(float(self._strengths.max(initial=0.0)), 1e-9)
        # A cross-section grows as the force; without tensions a muscle is as thick as it is strong.
        force = np.abs(self.tensions[frame]) if self._solved else 0.35 * self._strengths
        share = np.sqrt(np.clip(np.nan_to_num(force) / most, 0.0, 1.0))
        radii = size * (SLACK + TIGHT * share)
        colors = (
            activation_color(self.activations[frame])
            if self._solved
            else np.tile(UNKNOWN_COLOR, (len(share), 1))
        )
        colors = colors**DEEPER
        if chosen:
            other = np.ones(len(radii), dtype=bool)
            other[list(chosen)] = False
            radii[~other] = np.maximum(FOUND * radii[~other], size * (SLACK + 0.5 * TIGHT))
            radii[other] = np.minimum(radii[other], size * 1.2 * SLACK)
            colors[other] = (1.0 - OTHERS) * colors[other] + OTHERS * FADED
        return radii, colors


class _Markers:
    """Markers as recorded, and where the model has them."""

    def __init__(self, model: Model, results: ReportInput, time: Array, numbers: Mapping[str, int]):
        recorded = results.kinematics.markers
        self.recorded = np.full(
            (len(time), 0 if recorded is None else len(recorded.names), 3), np.nan
        )
        markers = model.markers
        if recorded is not None and len(recorded):
            self.recorded = _nearest(recorded.time, recorded.values, time)
            markers = tuple(marker for marker in markers if marker.name in recorded.names)
        self._bodies = np.array([numbers[marker.body] for marker in markers], dtype=np.int64)
        self._places = np.array([marker.location for marker in markers]).reshape(-1, 3)

    def modelled(self, rotations: Array, origins: Array) -> Array:
        """(markers, 3) of the model in ground [m]."""
        return (
            np.einsum("mij,mj->mi", rotations[self._bodies], self._places) + origins[self._bodies]
        )


def _arrows(wrenches: Wrenches | None, time: Array, weight: float, size: float) -> Array:
    """Find start and end of arrows of external forces at times, (frames, forces, 2, 3) [m].

    They are NaN where none acts.
    """
    if wrenches is None or not len(wrenches) or not wrenches.names:
        return np.zeros((len(time), 0, 2, 3))
    start = _nearest(wrenches.time, wrenches.points, time)
    force = _nearest(wrenches.time, wrenches.forces, time)
    acts = np.isfinite(start).all(axis=-1) & (np.linalg.norm(force, axis=-1) > MIN_FORCE * weight)
    ends = np.stack([start, start + WEIGHT * size / weight * force], axis=-2)
    return np.where(acts[..., None, None], ends, np.nan)


def _nearest(clock: Array, values: Array, time: Array) -> Array:
    """Look up values at times, each the nearest of a clock that may be coarser.

    They are NaN beyond one and a half of its steps.
    """
    beyond = 1.5 * float(np.median(np.diff(clock))) if len(clock) > 1 else 1e-6
    nearest = np.array(values[nearest_samples(clock, time)])
    nearest[(time < clock[0] - beyond) | (time > clock[-1] + beyond)] = np.nan
    return nearest

"""Errors of the poses of live frames, of all draws at once.

They come from the derivatives of inverse kinematics. Markers move on skin and are misplaced, joints
are elsewhere; of a body without markers, angles have errors themselves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import rotation_from_vector
from myomorph.core.motion.causal import CausalFilter, CausalStream
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem, tracked_markers
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.drawn_inputs import free_angles, skin_sizes

TOGETHER = 8  # Draws between two pauses
FORGETS = 6.0  # Delays after which the filter of noise has forgotten how it began


class SlowNoise:
    """Standard normal noise that is correlated over time.

    It has `count` numbers at a rate of about [Hz], correlated by a bell of SD `width` [s]: white
    noise through the filter of poses, nearly a Gaussian. Of a Bessel filter of fourth order with
    delay T, |H|^2 is nearly exp(-w^2 T^2 / 7): a Gaussian of T / sqrt(7).
    """

    def __init__(self, width: float, count: int, seed: int, rate: float):
        delay = np.sqrt(7.0) * width
        filter = CausalFilter(CausalFilter().delay * CausalFilter().cutoff / delay)
        self._random = np.random.default_rng(seed)
        self._step = 1.0 / rate
        self._stream = CausalStream(filter, count)
        self._clock = 0.0
        impulse = CausalStream(filter, 1)
        answer = []
        first = int(np.ceil(FORGETS * delay / self._step))
        for index in range(-1, first):
            impulse.push(np.array([index * self._step]), np.array([[1.0 if index == 0 else 0.0]]))
            answer.append(float(impulse.state[0]))
        self._scale = 1.0 / float(np.linalg.norm(answer))
        self._count = count
        self._until = np.nan
        self._most = first
        for _ in range(first):
            self._push()

    def _push(self) -> None:
        self._clock += self._step
        self._stream.push(np.array([self._clock]), self._random.standard_normal((1, self._count)))

    def at(self, time: float) -> Array:
        """Draw the numbers at a time, or up to a step after it.

        Parameters
        ----------
        time : [s]

        Returns
        -------
        (count,)
        """
        if not abs(time - self._until) < self._most * self._step:
            self._until = time
        while self._until < time - 1e-6:
            self._push()
            self._until += self._step
        return self._scale * self._stream.state


class MarkerErrors:
    """Errors of poses that markers show, by the trees of each draw's model.

    Parameters
    ----------
    names : of the markers that arrive, None for those of the model, in poses that arrive themselves
    rate : of poses drawn [Hz]
    thinned : their share of the frames: of the variance of the cameras' noise so much is left
    """

    def __init__(
        self,
        model: Model,
        drawn: Sequence[Tree],
        draws: Sequence[Draw],
        names: Sequence[str] | None,
        rate: float,
        thinned: float,
    ):
        known = tuple(model.marker_names if names is None else names)
        empty = Markers(np.zeros(1), known, np.full((1, len(known), 3), np.nan))
        options = InverseKinematicsOptions()
        self._names, weights = tracked_markers(model, empty, options)
        self._columns = [known.index(name) for name in self._names]
        self._posed = names is None
        self._model = model
        self._draw = draws[0]
        self._slopes = SlopeFinder(model=model, names=self._names, weights=weights, options=options)
        self._places = [_Places(tree, self._names) for tree in (compile_tree(model), *drawn)]
        bodies = [model.marker(name).body for name in self._names]
        hold = list(dict.fromkeys(bodies))
        self._of = [hold.index(body) for body in bodies]
        self._shape = len(draws), len(self._names) + len(hold), 3
        sources = draws[0].sources
        seed = draws[0].normals.seed
        self._random = np.random.default_rng((seed, 1))
        self._noise = sources.marker_noise * np.sqrt(thinned)
        self._skin = SlowNoise(
            width=sources.skin_time, count=int(np.prod(self._shape)), seed=seed, rate=rate
        )
        self._squares = np.zeros(len(self._names))
        self._seen = np.zeros(len(self._names))

    def forget(self) -> None:
        """Begin anew with the next frame."""
        self._squares[:] = self._seen[:] = 0.0

    def fill(self, time: float, pose: Array, row: Array, errors: Array) -> Iterator[None]:
        """Fill in the errors of a pose; stop between parts of the work.

        Parameters
        ----------
        time : of the frame [s]
        pose : (coordinates,) [rad or m]
        row : (markers, 3) as recorded [m], or coordinates
        errors : (draws, coordinates) to be filled [rad or m]

        Yields
        ------
        None between the parts
        """
        seen = np.ones(len(self._names), np.bool_)
        if not self._posed:
            seen[:] = np.isfinite(row[self._columns]).all(axis=1)
        places = self._places[0].at(pose[None])[0]
        if not self._posed:
            away = np.where(
                seen, np.sum((row[self._columns] - places) ** 2, axis=1, where=seen[:, None]), 0.0
            )
            self._squares += away
            self._seen += seen
        slopes = self._slopes.at(pose[None], seen[None])[0]
        yield
        apart = self._moved(time)
        for index, place in enumerate(self._places[1:]):
            apart[index] -= place.at(pose[None])[0] - places
            if index % TOGETHER == TOGETHER - 1:
                yield
        apart[:, ~seen] = 0.0
        errors[:] = apart.reshape(len(apart), -1) @ slopes.T

    def _moved(self, time: float) -> Array:
        """Draw how far markers are from where they should be, (draws, markers, 3) [m].

        They should be where they would be seen without noise and skin.
        """
        residuals = np.sqrt(self._squares / np.maximum(self._seen, 1.0))
        by_name = skin_sizes(
            self._model, self._draw, dict(zip(self._names, residuals.tolist(), strict=True))
        )
        # (markers, 2) movement of the segment's skin and of each marker's own.
        sizes = np.array([by_name[name] for name in self._names])
        slow = self._skin.at(time).reshape(self._shape)
        markers = len(self._names)
        moved = sizes[:, 1:] * slow[:, :markers] + sizes[:, :1] * slow[:, markers:][:, self._of]
        if self._noise:
            moved += self._noise * self._random.standard_normal(moved.shape)
        return np.asarray(moved)


class AngleErrors:
    """Errors of angles of a body without markers, as of `drawn_angles`.

    `rate` is as of `MarkerErrors`.
    """

    def __init__(self, model: Model, draws: Sequence[Draw], rate: float):
        free = np.isin(model.coordinate_names, free_angles(model))
        self._sizes = draws[0].sources.angle * free.astype(np.float64)
        self._noise = SlowNoise(
            width=draws[0].sources.skin_time,
            count=len(draws) * len(free),
            seed=draws[0].normals.seed,
            rate=rate,
        )

    def forget(self) -> None:
        """Begin anew with the next frame: nothing is kept."""

    def fill(self, time: float, pose: Array, row: Array, errors: Array) -> Iterator[None]:
        """Fill in the errors of a pose.

        Parameters
        ----------
        time : of the frame [s]
        pose : (coordinates,) [rad or m]
        row : (coordinates,) as recorded
        errors : (draws, coordinates) to be filled [rad or m]

        Yields
        ------
        None, once
        """
        errors[:] = self._sizes * self._noise.at(time).reshape(errors.shape)
        yield


class _Places:
    """Where a model's markers are in poses."""

    def __init__(self, tree: Tree, names: Sequence[str]):
        self._tree = tree
        marked = [tree.model.marker(name) for name in names]
        self._bodies = np.array(
            [self._tree.body_number(marker.body) for marker in marked], np.int64
        )
        self._locations = np.array([marker.location for marker in marked]).reshape(-1, 3)

    def at(self, poses: Array) -> Array:
        """(frames, markers, 3) in ground [m]."""
        return forward_kinematics(self._tree, poses).points(self._bodies, self._locations)


CARRIES = 1.0  # Vertical force from which on a center of pressure is taken from a wrench [N]


class OnlineInputs:
    """The output of a causal filter with a delay [s], with the errors of all draws.

    Those of the pose are not among them.
    """

    def __init__(self, draws: Sequence[Draw], bodies: Sequence[str], delay: float, up: Array):
        shifts = _each(draws, bodies, "plate_position")
        self._shifts = shifts - (shifts @ up)[..., None] * up
        self._up = up
        self._gains = np.exp(_each(draws, bodies, "plate_gain"))
        self._rotations = rotation_from_vector(_each(draws, bodies, "plate_rotation"))
        self._late = np.array([draw.of("clock", "forces")[0] for draw in draws])
        # A filter with a delay r T passes exp(-w^2 T^2 (r^2 - 1) / 14) of what one with T does: for
        # slow motion the second derivative, times this share of T^2.
        ratios = np.array([1.0 / draw.factor("filter_cutoff", "cutoff") for draw in draws])
        self._smooth = delay**2 * (ratios**2 - 1.0) / 14.0

    def motion(self, motion: Array) -> Array:
        """Draw value, velocity and acceleration as through other filters.

        Parameters
        ----------
        motion : (5, coordinates) value and four derivatives [rad or m, s]

        Returns
        -------
        (draws, 3, coordinates)
        """
        return np.asarray(motion[:3] + self._smooth[:, None, None] * motion[2:])

    def loads(self, loads: Array) -> Array:
        """Draw wrenches of plates that stand elsewhere, with other gains, clocks and filters.

        Parameters
        ----------
        loads : (3, bodies, 6) filtered moment about the ground's origin [N m] and force [N], and
            their first two derivatives

        Returns
        -------
        (draws, bodies, 6)
        """
        shifted = (
            loads[0] + self._smooth[:, None, None] * loads[2] - self._late[:, None, None] * loads[1]
        )
        moments = shifted[..., :3]
        forces = shifted[..., 3:]
        lift = forces @ self._up
        acts = np.abs(lift) > CARRIES
        points = np.where(
            acts[..., None], np.cross(self._up, moments) / np.where(acts, lift, 1.0)[..., None], 0.0
        )
        torques = moments - np.cross(points, forces)
        other = np.einsum("dbij,dbj->dbi", self._rotations, self._gains * forces)
        turned = np.einsum("dbij,dbj->dbi", self._rotations, torques)
        moments = turned + np.cross(points + self._shifts, other)
        return np.concatenate([moments, other], axis=2)


def _each(draws: Sequence[Draw], bodies: Sequence[str], source: str) -> Array:
    """(draws, bodies, 3) errors of a source."""
    return np.array([[draw.of(source, name, 3) for name in bodies] for draw in draws]).reshape(
        len(draws), -1, 3
    )


# Of the finite differences, in units of the coordinates: markers move smoothly with them
STEP = 1e-6
BLOCK = 32  # Frames whose poses, each with every coordinate moved, are computed in one go
BOUND = 1e-9  # Nearer to its bound than this a coordinate is held by it [rad or m]


class SlopeFinder:
    """Derivatives of poses in the places of markers, set up once."""

    def __init__(
        self,
        model: Model,
        names: tuple[str, ...],
        weights: Array,
        options: InverseKinematicsOptions,
    ):
        self.names = names
        self._weights = weights
        self._tree = compile_tree(model)
        self._places = _Places(self._tree, names)
        self._problem = pose_problem(self._tree, names, weights, options)
        self._posture = options.posture_weight

    def at(self, coordinates: Array, seen: np.ndarray) -> Array:
        """Compute the derivatives of coordinates by markers at poses.

        Parameters
        ----------
        coordinates : (frames, coordinates) [rad or m]
        seen : (frames, markers) whether each is seen; what is not seen has no derivative

        Returns
        -------
        (frames, coordinates, 3 markers) [rad/m or 1]
        """
        blocks = range(0, len(coordinates), BLOCK)
        parts = [
            self._block(coordinates[block : block + BLOCK], seen[block : block + BLOCK])
            for block in blocks
        ]
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def _block(self, coordinates: Array, seen: np.ndarray) -> Array:
        problem = self._problem
        free = self._problem.free
        frames = len(coordinates)
        width = 3 * len(self.names)
        values = np.array(coordinates)
        # All poses, and behind them each with one coordinate after the other moved, in one go.
        steps = STEP * problem.unit[free]
        shifted = np.tile(values, (len(free) + 1, 1)).reshape(len(free) + 1, frames, -1)
        for index, j in enumerate(free):
            shifted[index + 1, :, j] += steps[index]
        flat = shifted.reshape(-1, values.shape[1])
        couple_frames(self._tree.arrays, flat)
        places = self._places.at(flat).reshape(len(free) + 1, frames, width)
        shifted = flat.reshape(shifted.shape)
        J = np.moveaxis((places[1:] - places[0]) / steps[:, None, None], 0, 2)
        C = np.moveaxis((shifted[1:] - shifted[0]) / steps[:, None, None], 0, 2)
        # Variables on a bound do not move.
        J *= (
            (values[:, free] > problem.lower + BOUND) & (values[:, free] < problem.upper - BOUND)
        )[:, None]
        share = np.repeat(seen * self._weights, 3, axis=1)
        share /= np.maximum(share.sum(axis=1, keepdims=True) / 3.0, 1e-12)
        weighted = J * share[:, :, None]
        H = np.swapaxes(J, 1, 2) @ weighted
        own_weight = problem.coordinates.weight[free] + self._posture * np.einsum("fii->f", H)[
            :, None
        ] / len(free)
        # What no marker shows has no derivative: it stays.
        H += np.maximum(own_weight / problem.unit[free] ** 2, 1e-12)[:, :, None] * np.eye(len(free))
        return np.asarray(C @ np.linalg.solve(H, np.swapaxes(weighted, 1, 2)))

"""Stairs and ladders that measure force ([D] chapter 7): a load cell under each tread or rung.

In the axes of a tread (z out of its surface) a cell measures some of force and moment about a point
of its own,

    w = C (s - s_0),   F = R f,   M = R m + (R o) x F   about the middle of the tread,

with C from channels s to components, R and o the cell's orientation and origin. What a cell does
not measure is unknown, not zero. Thresholds count in body weights and in the cell's own noise: a
mouse weighs a quarter of a newton.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from myomorph.core.contact.states import hysteresis, steady
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Series
from myomorph.core.model.spatial import Transform

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
SQUARE = 1e-6  # An axis of ground that a cell's axis leans to by less than this has no part of it


@read_only
class Step:
    """A tread or a rung and its load cell."""

    name: str
    # of the tread in ground: origin in the middle of its surface, z out of it, x and y along its
    # edges
    pose: Transform
    size: tuple[float, float]  # extents of the surface along x and y [m]
    # which of `COMPONENTS` the cell gives, in the order of its channels (or of the rows of
    # `matrix`)
    measures: tuple[str, ...]
    channels: tuple[str, ...]  # names of its channels
    # (components, channels) from channels to [N] and [N m], with cross-talk; None for one to one
    matrix: Array | None = None
    # (3,) point of the tread's frame about which the cell's moments are [m]
    origin: Array = field(default_factory=lambda: np.zeros(3))
    # 1 where the cell gives the force on the animal, -1 where that on the step
    sense: Literal[1, -1] = 1

    def __post_init__(self) -> None:
        freeze(self, origin=(3,))
        unknown = [measure for measure in self.measures if measure not in COMPONENTS]
        if unknown or len(set(self.measures)) != len(self.measures) or not self.measures:
            raise BadData(
                f"step '{self.name}' measures {self.measures}: expected some of"
                f" {', '.join(COMPONENTS)}, once each"
            )
        if not all(np.isfinite(item) and item > 0.0 for item in self.size):
            raise BadData(
                f"step '{self.name}' has the size {self.size}: expected two lengths above 0 m"
            )
        if self.matrix is None and len(self.channels) != len(self.measures):
            raise BadData(
                f"step '{self.name}' measures {len(self.measures)} components by"
                f" {len(self.channels)} channels: give its matrix"
            )
        if self.matrix is not None:
            shape = (len(self.measures), len(self.channels))
            matrix = np.asarray(self.matrix, dtype=np.float64)
            if matrix.shape != shape:
                raise BadData(
                    f"the matrix of step '{self.name}' has shape {matrix.shape}: expected {shape}"
                )
            object.__setattr__(self, "matrix", frozen_array(matrix))

    def rotated(self, rotation: Array) -> Step:
        """The same step in a ground whose axes are the rows of `rotation` (3, 3)."""
        turn = Transform(rotation, np.zeros(3))
        return replace(self, pose=turn @ self.pose)


@dataclass(frozen=True)
class StairOptions:
    """When a step is loaded, and how near a foot must be."""

    # loaded, unloaded: shares of body weight between which a step begins and ceases to be loaded
    loaded: float = 0.04
    unloaded: float = 0.02
    noise: float = 5.0  # and as many standard deviations of the cell's noise
    shortest: float = 0.02  # loadings and gaps that last less are taken for noise [s]
    # distance from a foot to the tread it stands on, at most, over the height of the center of mass
    search_range: float = 0.25
    still: float = 0.3  # a foot that stands moves slower than this, over the speed sqrt(g height)
    # "quiet" subtracts what the cells read unloaded, "none" takes channels as they are
    tare: Literal["quiet", "none"] = "quiet"

    def __post_init__(self) -> None:
        if not 0.0 < self.unloaded <= self.loaded:
            raise BadData(
                f"steps are loaded from {self.loaded:g} of body weight and unloaded below"
                f" {self.unloaded:g}: expected shares above 0, the second not the larger one"
            )


@read_only
class StepLoads:
    """What the cells measure, in ground."""

    time: Array  # (samples,) [s]
    steps: tuple[Step, ...]
    # forces, moments: (samples, steps, 3) on the animal, moments about the tread's middle [N], [N
    # m]; NaN where the cell does not measure them
    forces: Array
    moments: Array
    # (samples, steps) along the tread's normal, the part of it that is measured [N]
    pressing: Array
    loaded: np.ndarray  # (samples, steps)
    noise: Array  # (steps,) standard deviation of `pressing` while nothing is on the step [N]
    notes: tuple[str, ...] = ()  # what looks wrong, one line each


def step_loads(
    steps: Sequence[Step], channels: Series, weight: float, options: StairOptions | None = None
) -> StepLoads:
    """Forces and moments on each step, and when it is loaded.
    `channels` (samples, channels) as recorded; those of all steps among them; `weight`: of the body
    [N].
    """
    options = options or StairOptions()
    _check(steps, channels, weight)
    notes: list[str] = []
    count = len(steps)
    frames = len(channels)
    forces = np.full((frames, count, 3), np.nan)
    moments = np.full((frames, count, 3), np.nan)
    pressing = np.zeros((frames, count))
    loaded = np.zeros((frames, count), np.bool_)
    noise = np.zeros(count)
    for index, step in enumerate(steps):
        raw = channels.values[:, [channels.names.index(channel) for channel in step.channels]]
        # Of force on the animal, in the cell's axes.
        components = float(step.sense) * (raw if step.matrix is None else raw @ step.matrix.T)
        if options.tare == "quiet":
            components -= _idle(components, step, weight, options)
        pressing[:, index] = np.nan_to_num(components[:, step.measures.index("fz")])
        noise[index] = _noise(pressing[:, index])
        level = max(options.loaded * weight, options.noise * noise[index])
        if options.noise * noise[index] > options.loaded * weight:
            notes.append(
                f"step '{step.name}': its noise of {1e3 * noise[index]:.3g} mN hides loads below "
                f"{100 * level / weight:.0f} % of body weight"
            )
        lower = level * options.unloaded / options.loaded
        smooth = _averaged(pressing[:, index], channels.time, options.shortest)
        state = hysteresis(smooth > level, smooth < lower)
        loaded[:, index] = steady(state, channels.time, options.shortest)
        forces[:, index], moments[:, index] = _in_ground(step, components)
    return StepLoads(
        time=channels.time,
        steps=tuple(steps),
        forces=forces,
        moments=moments,
        pressing=pressing,
        loaded=loaded,
        noise=noise,
        notes=tuple(notes),
    )


def _check(steps: Sequence[Step], channels: Series, weight: float) -> None:
    if not steps:
        raise BadData("no step is given: stairs need at least one")
    if not (np.isfinite(weight) and weight > 0.0):
        raise BadData(f"the body weighs {weight:g} N: thresholds of steps need its weight")
    names = [step.name for step in steps]
    if len(set(names)) != len(names):
        raise BadData(
            f"two steps are named '{next(name for name in names if names.count(name) > 1)}'"
        )
    for step in steps:
        if "fz" not in step.measures:
            raise BadData(
                f"step '{step.name}' measures {', '.join(step.measures)}, but not fz: who stands on"
                " it cannot be found"
            )
        for channel in step.channels:
            if channel not in channels.names:
                raise BadData(
                    f"step '{step.name}' has no channel '{channel}' in the recording: it has "
                    f"{', '.join(channels.names)}"
                )


def _idle(own: Array, step: Step, weight: float, options: StairOptions) -> Array:
    """What the components read with nobody on the step: the mode of what presses least, all medians
    of it.
    """
    press = own[:, step.measures.index("fz")]
    known = np.isfinite(press)
    if known.sum() < 10:
        return np.zeros(own.shape[1])
    # The half of the samples that lies closest together is the unloaded one, for a step that is
    # mostly free.
    order = np.sort(press[known])
    half = max(1, len(order) // 2)
    start = int(np.argmin(order[half:] - order[: len(order) - half]))
    middle = float(np.median(order[start : start + half + 1]))
    near = known & (np.abs(press - middle) < max(options.unloaded * weight, 3.0 * _noise(press)))
    return np.asarray(np.nanmedian(own[near], axis=0), dtype=np.float64)


def _noise(values: Array) -> float:
    """Standard deviation of the noise, from the differences of neighboring samples (median: steps
    do not count).
    """
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    return float(np.median(steps) / (0.6744897501960817 * np.sqrt(2.0))) if len(steps) else 0.0


def _averaged(values: Array, time: Array, over: float) -> Array:
    width = max(1, round(0.5 * over / float(np.median(np.diff(time))))) if len(time) > 1 else 1
    kernel = np.ones(width) / width
    return np.convolve(np.pad(values, width, mode="edge"), kernel, mode="same")[width:-width]


def _in_ground(step: Step, own: Array) -> tuple[Array, Array]:
    """Force and moment about the tread's middle (samples, 3) in ground, NaN where an axis is not
    measured.
    """
    known = np.array([item in step.measures for item in COMPONENTS])
    full = np.zeros((len(own), 6))
    for column, name in enumerate(step.measures):
        full[:, COMPONENTS.index(name)] = own[:, column]
    rotation = step.pose.rotation
    shift = np.cross(np.eye(3), step.origin)
    moment = full[:, 3:] + full[:, :3] @ shift.T
    moment_known = known[3:] & _reached(np.abs(shift) > 0.0, known[:3])
    force_in = np.where(
        _reached(np.abs(rotation) > SQUARE, known[:3]), full[:, :3] @ rotation.T, np.nan
    )
    moment_in = np.where(
        _reached(np.abs(rotation) > SQUARE, moment_known), moment @ rotation.T, np.nan
    )
    return force_in, moment_in


def _reached(uses: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(3,) whether all that a component is made of is known."""
    return np.all(~uses | known[None, :], axis=1)

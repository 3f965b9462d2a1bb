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

from myomorph.core.contact.cell_units import (
    cell_units,
    component_factor,
    moments_in_millimeters,
)
from myomorph.core.contact.spells import hysteresis, steady
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.causes import PLATES, UNITS
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Series
from myomorph.core.model.spatial import Transform

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
SQUARE = 1e-6
"""An axis of ground that a cell's axis leans to by less than this has no part of it."""


@read_only
class Step:
    """A tread or a rung and its load cell.

    Attributes
    ----------
    pose : of the tread in ground: origin in the middle of its surface, z out of it, x and y along
        its edges
    size : extents of the surface along x and y [m]
    measures : which of `COMPONENTS` the cell gives, in the order of its channels (or of the rows of
        `matrix`)
    channels : names of its channels
    matrix : (components, channels) from channels in the recording's units to [N] and [N m], with
        cross-talk; None for one to one, by the units that the recording names
    origin : (3,) point of the tread's frame about which the cell's moments are [m]
    sense : 1 where the cell gives the force on the animal, -1 where that on the step
    """

    name: str
    pose: Transform
    size: tuple[float, float]
    measures: tuple[str, ...]
    channels: tuple[str, ...]
    matrix: Array | None = None
    origin: Array = field(default_factory=lambda: np.zeros(3))
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
        """Turn the step into a ground of other axes.

        Parameters
        ----------
        rotation : (3, 3) whose rows are the axes

        Returns
        -------
        the step in that ground
        """
        turn = Transform(rotation, np.zeros(3))
        return replace(self, pose=turn @ self.pose)


@dataclass(frozen=True)
class StairOptions:
    """Thresholds of a step's load, and of a foot that stands on it.

    Attributes
    ----------
    loaded, unloaded : shares of body weight between which a step begins and ceases to be loaded
    noise : and as many standard deviations of the cell's noise
    shortest : loadings and gaps that last less are taken for noise [s]
    search_range : distance from a foot to the tread it stands on, at most, over the height of the
        center of mass
    still : a foot that stands moves slower than this, over the speed sqrt(g height)
    tare : "quiet" subtracts what the cells read unloaded, "none" takes channels as they are
    """

    loaded: float = 0.04
    unloaded: float = 0.02
    noise: float = 5.0
    shortest: float = 0.02
    search_range: float = 0.25
    still: float = 0.3
    tare: Literal["quiet", "none"] = "quiet"

    def __post_init__(self) -> None:
        if not 0.0 < self.unloaded <= self.loaded:
            raise BadData(
                f"steps are loaded from {self.loaded:g} of body weight and unloaded below"
                f" {self.unloaded:g}: expected shares above 0, the second not the larger one"
            )


@read_only
class StepLoads:
    """Loads of steps in ground, as their cells measure them.

    Attributes
    ----------
    time : (samples,) [s]
    forces, moments : (samples, steps, 3) on the animal, moments about the tread's middle [N],
        [N m]; NaN where the cell does not measure them
    pressing : (samples, steps) along the tread's normal, the part of it that is measured [N]
    loaded : (samples, steps)
    noise : (steps,) standard deviation of `pressing` while nothing is on the step [N]
    notes : what looks wrong, one line each
    """

    time: Array
    steps: tuple[Step, ...]
    forces: Array
    moments: Array
    pressing: Array
    loaded: np.ndarray
    noise: Array
    notes: tuple[Message, ...] = ()


def step_loads(
    steps: Sequence[Step], channels: Series, weight: float, options: StairOptions | None = None
) -> StepLoads:
    """Find forces and moments on each step, and when it is loaded.

    Parameters
    ----------
    steps : with their load cells
    channels : (samples, channels) as recorded, in the units that they name (`Analog`, or brackets
        at the end of a name), else in N and N m; those of all steps among them
    weight : of the body [N]
    options : thresholds

    Raises
    ------
    BadData : no step, two of one name, a step without fz, or without its channels
    """
    options = options or StairOptions()
    _check(steps, channels, weight)
    notes: list[Message] = []
    shape = (len(channels), len(steps))
    forces = np.full((*shape, 3), np.nan)
    moments = np.full((*shape, 3), np.nan)
    pressing = np.zeros(shape)
    loaded = np.zeros(shape, np.bool_)
    noise = np.zeros(len(steps))
    for index, step in enumerate(steps):
        components = _components(step, channels, weight, options, notes)
        normal = np.nan_to_num(components[:, step.measures.index("fz")])
        pressing[:, index] = normal
        noise[index] = _noise(normal)
        level = max(options.loaded * weight, options.noise * noise[index])
        if options.noise * noise[index] > options.loaded * weight:
            notes.append(
                PLATES.message(
                    f"step '{step.name}': its noise of {1e3 * noise[index]:.3g} mN hides loads"
                    f" below {100 * level / weight:.0f} % of body weight",
                    place=step.name,
                )
            )
        lower = level * options.unloaded / options.loaded
        smooth = _averaged(normal, channels.time, options.shortest)
        state = hysteresis(smooth > level, smooth < lower)
        loaded[:, index] = steady(state, channels.time, options.shortest)
        corner = 0.5 * float(np.hypot(*step.size)) + float(np.linalg.norm(step.origin))
        if moments_in_millimeters(step.measures, components, loaded[:, index], corner):
            components = components * [1e-3 if name[0] == "m" else 1.0 for name in step.measures]
            notes.append(
                UNITS.message(
                    f"step '{step.name}': its moments put the force far off the tread, taken as"
                    " N mm",
                    place=step.name,
                )
            )
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


def _components(
    step: Step, channels: Series, weight: float, options: StairOptions, notes: list[Message]
) -> Array:
    """Components (samples, components) on the animal, in the cell's axes [N], [N m]."""
    raw = channels.values[:, [channels.names.index(channel) for channel in step.channels]]
    if step.matrix is None:
        components = float(step.sense) * raw * _factors(step, channels, notes)
    else:
        components = float(step.sense) * raw @ step.matrix.T
    if options.tare == "quiet":
        components -= _idle(components, step, weight, options)
    return components


def _factors(step: Step, channels: Series, notes: list[Message]) -> Array:
    """Factors (components,) of a step's channels to N and N m."""
    units = cell_units(step.channels, channels)
    factors = np.ones(len(units))
    unknown = set()
    for index, (measure, unit) in enumerate(zip(step.measures, units, strict=True)):
        factor = component_factor(measure, unit)
        if factor is None:
            unknown.add(unit)
        else:
            factors[index] = factor
    if unknown:
        texts = ", ".join(sorted(unknown))
        notes.append(
            UNITS.message(
                f"step '{step.name}': its channels are in '{texts}', taken as N and N m: if they"
                " are not, give its matrix",
                place=step.name,
            )
        )
    return factors


def _check(steps: Sequence[Step], channels: Series, weight: float) -> None:
    """Refuse steps that the recording cannot serve."""
    if not steps:
        raise BadData("no step is specified: stairs need at least one")
    if not (np.isfinite(weight) and weight > 0.0):
        raise BadData(f"the body weighs {weight:g} N: thresholds of steps need its weight")
    names = [step.name for step in steps]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BadData(f"two steps are named '{twice}'")
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


def _idle(components: Array, step: Step, weight: float, options: StairOptions) -> Array:
    """Median of the components with nobody on the step: at the mode of what presses least.

    Parameters
    ----------
    components : (samples, components) [N], [N m]
    weight : of the body [N]

    Returns
    -------
    (components,) medians
    """
    press = components[:, step.measures.index("fz")]
    known = np.isfinite(press)
    if known.sum() < 10:
        return np.zeros(components.shape[1])
    # The half of the samples that lies closest together is the unloaded one, for a step that is
    # mostly free.
    order = np.sort(press[known])
    half = max(1, len(order) // 2)
    start = int(np.argmin(order[half:] - order[: len(order) - half]))
    middle = float(np.median(order[start : start + half + 1]))
    near = known & (np.abs(press - middle) < max(options.unloaded * weight, 3.0 * _noise(press)))
    return np.asarray(np.nanmedian(components[near], axis=0), dtype=np.float64)


def _noise(values: Array) -> float:
    """Find the noise of values (samples,) by differences of neighbouring samples.

    It is that of a normal distribution with their median size: steps do not count.
    """
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    return float(np.median(steps) / (0.6744897501960817 * np.sqrt(2.0))) if len(steps) else 0.0


def _averaged(values: Array, time: Array, over: float) -> Array:
    """Average values (samples,) over half of a duration [s], at times (samples,)."""
    width = max(1, round(0.5 * over / float(np.median(np.diff(time))))) if len(time) > 1 else 1
    kernel = np.ones(width) / width
    return np.convolve(np.pad(values, width, mode="edge"), kernel, mode="same")[width:-width]


def _in_ground(step: Step, components: Array) -> tuple[Array, Array]:
    """Force and moment about the tread's middle in ground, NaN where an axis is not measured.

    F = R f,   M = R m + (R o) x F

    Parameters
    ----------
    components : (samples, components) in the cell's axes [N], [N m]

    Returns
    -------
    (samples, 3) [N] and (samples, 3) [N m]
    """
    known = np.array([item in step.measures for item in COMPONENTS])
    measured = np.zeros((len(components), 6))
    for column, name in enumerate(step.measures):
        measured[:, COMPONENTS.index(name)] = components[:, column]
    rotation = step.pose.rotation
    leans = np.abs(rotation) > SQUARE
    shift = np.cross(np.eye(3), step.origin)
    moment = measured[:, 3:] + measured[:, :3] @ shift.T
    moment_known = known[3:] & _reached(np.abs(shift) > 0.0, known[:3])
    force = measured[:, :3] @ rotation.T
    return (
        np.where(_reached(leans, known[:3]), force, np.nan),
        np.where(_reached(leans, moment_known), moment @ rotation.T, np.nan),
    )


def _reached(uses: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return whether all that a component is made of is known.

    Parameters
    ----------
    uses : (3, 3) which inputs a component has
    known : (3,)

    Returns
    -------
    (3,)
    """
    return np.all(~uses | known[None, :], axis=1)

"""What a passive joint may do along its axes, fitted from sums over swings.

That is damping, stiffness and friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from itertools import combinations

import numpy as np

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import check_name
from myomorph.swings.viscosity.identification.inertia import (
    InertiaOptions,
    LimbInertia,
    limb_inertia,
)
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, swing_sums

WIDTH = 0.1
"""Angular velocity within which Coulomb friction turns its sign [rad/s]: about what the rate
changes by at a turn in the 20 ms over which a low-pass of 8 Hz spreads the jump of the measured
torque.
"""


TERMS = (
    "viscosity",
    "viscosity by axis",
    "stiffness",
    "stiffness by axis",
    "coulomb",
    "quadratic",
    "muscles",
    "hinges",
)
"""What a law can be made of."""

LAST = {"coulomb": -6, "quadratic": -5, "muscles": -4}
"""Where among a law's coefficients those stand that all axes share; those of the hinges follow."""
HINGES = ("first", "second", "third")
LEVEL = 0.95  # Of the intervals of a law's coefficients
# Least volume of three hinges' unit axes; less where the middle has turned the first along the
# last.
SINGULAR = 0.1

Groups = list[list[int]]
"""Columns of coefficients: the first of each group is at least 0, the rest are free where the first
is not 0.
"""


@read_only
class PassiveLaw:
    """Torque of a joint from its angles and rates.

        tau = -d w - k theta + s - c w / sqrt(|w|^2 + width^2) - e |w| w
              - d_M J_M^T J_M w - S^-T d_h S^-1 w

    For a ball w and theta have three components and friction acts against the direction of w; d and
    k may differ by axis; S are the axes in the limb of three hinges one after another, each at a
    right angle to the next: [S]'s diagonal matrix in joint angles. The spring is linear in the
    rotation vector from wherever angles are counted.

    Attributes
    ----------
    viscosity : (axes,) d [N m s/rad]
    stiffness : (axes,) k [N m/rad]
    rest_moment : (axes,) s = k theta_0, theta_0 the angle where the spring is at rest [N m]
    coulomb : c [N m]
    quadratic : e [N m s^2/rad^2]
    muscle : d_M, the same for every muscle [N s/m]
    hinges : (3,) d_h [N m s/rad]
    width : within which friction turns its sign [rad/s]
    """

    viscosity: Array
    stiffness: Array
    rest_moment: Array
    coulomb: float
    quadratic: float
    muscle: float
    hinges: Array = field(default_factory=lambda: np.zeros(3))
    width: float = WIDTH

    @classmethod
    def of(cls, coefficients: Array, width: float = WIDTH) -> PassiveLaw:
        """Make a law of its coefficients.

        Parameters
        ----------
        coefficients : (3 axes + 6,) in the order of the attributes
        width : of friction [rad/s]

        Returns
        -------
        the law
        """
        *first, c, e, muscle, h1, h2, h3 = np.asarray(coefficients, dtype=np.float64)
        d, k, s = np.reshape(first, (3, -1))
        return cls(d, k, s, float(c), float(e), float(muscle), np.array([h1, h2, h3]), width)

    @property
    def coefficients(self) -> Array:
        """(3 axes + 6,) the attributes in their order, without the width."""
        last = [self.coulomb, self.quadratic, self.muscle, *self.hinges]
        return np.concatenate([self.viscosity, self.stiffness, self.rest_moment, last])

    def torque(self, recording: SwingRecording) -> Array:
        """Find the torque in the motion of a recording.

        Parameters
        ----------
        recording : of a swing

        Returns
        -------
        (frames, axes) [N m]
        """
        motion = recording.angles, recording.rates, recording.lengthening
        return -resistances(*motion, self.width, slopes_of(recording)) @ self.coefficients

    def values(self, axis: Array) -> Array:
        """Order the law's numbers for swinging forward, along the limb's axes.

        Parameters
        ----------
        axis : (3,) of a hinge, zeros for a ball

        Returns
        -------
        (16,)
        """
        each = [np.broadcast_to(values, (3,)) for values in (self.viscosity, self.stiffness)]
        rest = self.rest_moment * axis if axis.any() else self.rest_moment
        return np.concatenate(
            [*each, rest, [self.coulomb, self.width, self.quadratic, self.muscle], self.hinges]
        )

    def fastest(self, rate: float, lengthening: Array) -> float:
        """Find a bound of the slope of torque against rate.

        Parameters
        ----------
        rate : largest that occurs [rad/s]
        lengthening : (frames, strands, axes) [m/rad]

        Returns
        -------
        [N m s/rad]
        """
        arms = float(np.square(lengthening).sum(axis=(1, 2)).max(initial=0.0))
        slope = self.coulomb / self.width + 2.0 * self.quadratic * rate + self.muscle * arms
        return float(self.viscosity.max()) + slope + 2.0 * float(self.hinges.max()) / SINGULAR**2


def hinge_slopes(rotations: Array, hinges: Array) -> Array:
    """Find S^-1, by which rates along the limb's axes are those of three hinges.

    The first axis is fixed in ground, the last in the limb, the middle one is at a right angle to
    both.

    Parameters
    ----------
    rotations : (frames, 3, 3) of the limb
    hinges : (2, 3) see `SwingRecording.hinges`

    Returns
    -------
    (frames, 3, 3)
    """
    first = hinges[0] @ rotations
    last = np.broadcast_to(hinges[1], (len(rotations), 3))
    middle = np.cross(last, first)
    volume = np.linalg.norm(middle, axis=1, keepdims=True)
    middle /= np.maximum(volume, 1e-12)
    duals = np.stack(
        [np.cross(middle, last), np.cross(last, first), np.cross(first, middle)], axis=1
    )
    return duals / np.maximum(volume, SINGULAR)[:, None]


def slopes_of(recording: SwingRecording) -> Array:
    """Find `hinge_slopes` of a recording.

    Parameters
    ----------
    recording : of a swing

    Returns
    -------
    (frames, 3, 3); (frames, 0, axes) where it has no hinges
    """
    if not len(recording.hinges):
        return np.zeros((len(recording), 0, len(recording.axes)))
    return hinge_slopes(recording.rotations, recording.hinges)


def resistances(
    angles: Array, rates: Array, lengthening: Array, width: float, slopes: Array | None = None
) -> Array:
    """Find the torque that each coefficient of a law adds.

    Parameters
    ----------
    angles, rates : (frames, axes) [rad], [rad/s]
    lengthening : (frames, strands, axes) [m/rad]
    width : of friction [rad/s]
    slopes : see `slopes_of`; by default no hinges

    Returns
    -------
    (frames, axes, 3 axes + 6)
    """
    frames, axes = rates.shape
    columns = np.zeros((frames, axes, 3 * axes + 6))
    speed = np.linalg.norm(rates, axis=1)[:, None]
    each = np.arange(axes)
    columns[:, each, each] = rates
    columns[:, each, axes + each] = angles
    columns[:, each, 2 * axes + each] = -1.0
    columns[:, :, LAST["coulomb"]] = rates / np.hypot(speed, width)
    columns[:, :, LAST["quadratic"]] = speed * rates
    speeds = np.einsum("fma,fa->fm", lengthening, rates)
    columns[:, :, LAST["muscles"]] = np.einsum("fma,fm->fa", lengthening, speeds)
    if slopes is not None and slopes.shape[1]:
        columns[:, :, -len(HINGES) :] = np.einsum(
            "fha,fh->fah", slopes, np.einsum("fha,fa->fh", slopes, rates)
        )
    return columns


@read_only
class PassiveProblem:
    """The torques of one condition, and what each coefficient of a law explains of them.

    Attributes
    ----------
    recordings : of the condition
    sums : over single swings
    products : (blocks, 10 + 3 axes + 6, same) of [torque_rows, resistances], all axes together
    width : of Coulomb friction [rad/s]
    inertial : how the limb's parameters are identified
    noise : (6,) of the wrench [N m], [N]
    """

    recordings: tuple[SwingRecording, ...]
    sums: SwingSums
    products: Array
    width: float
    inertial: InertiaOptions
    noise: Array

    @staticmethod
    def of(
        recordings: Sequence[SwingRecording], width: float, inertial: InertiaOptions
    ) -> PassiveProblem:
        """Condense recordings of one condition.

        Parameters
        ----------
        recordings : of the condition
        width : of Coulomb friction [rad/s]
        inertial : how the limb's parameters are identified
        """
        sums = swing_sums(recordings)
        products = [
            _products(recordings[i], use, width)
            for i, use in zip(sums.trial, sums.uses, strict=True)
        ]
        noise = limb_inertia(sums, None, inertial).noise
        return PassiveProblem(
            recordings=tuple(recordings),
            sums=sums,
            products=np.stack(products),
            width=width,
            inertial=inertial,
            noise=noise,
        )

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the free axes."""
        return self.sums.axes

    def samples(self, counts: Array) -> float:
        """Count frames times axes.

        Parameters
        ----------
        counts : (blocks,) how often each counts

        Returns
        -------
        the count
        """
        return float(counts @ [len(use) for use in self.sums.uses]) * len(self.axes)

    def parameters(self, counts: Array) -> Array:
        """Identify the limb from the wrench of some blocks.

        Parameters
        ----------
        counts : (blocks,) how often each counts

        Returns
        -------
        (10,)
        """
        return self.inertia(counts).parameters

    def inertia(self, counts: Array) -> LimbInertia:
        """Identify the limb from the wrench of some blocks.

        Parameters
        ----------
        counts : (blocks,) how often each counts

        Returns
        -------
        its parameters, and how far these may be off
        """
        return limb_inertia(self.sums, counts, self.inertial, self.noise)

    def fit(self, terms: Sequence[str], counts: Array, parameters: Array) -> tuple[Array, Array]:
        """Fit a law to the torques of some blocks.

        Parameters
        ----------
        terms : of the law
        counts : (..., blocks) how often each block counts
        parameters : (..., 10) of the limb

        Returns
        -------
        coefficients (..., 3 axes + 6), and what they leave of the sum of squares
        """
        products = np.tensordot(counts, self.products, axes=1)
        phi = np.asarray(parameters)
        mapping, groups = law_columns(terms, len(self.axes))
        H = mapping.T @ products[..., PARAMETERS:, PARAMETERS:] @ mapping
        g = -np.einsum("...ij,...j->...i", products[..., PARAMETERS:, :PARAMETERS], phi) @ mapping
        square = np.einsum(
            "...i,...ij,...j->...", phi, products[..., :PARAMETERS, :PARAMETERS], phi
        )
        solution, gain = bounded_least_squares(H, g, groups)
        return solution @ mapping.T, np.maximum(square - gain, 0.0)

    def left(self, parameters: Array, law: PassiveLaw) -> list[Array]:
        """Find the torque that a law leaves.

        Parameters
        ----------
        parameters : (10,) of the limb
        law : that is taken off

        Returns
        -------
        (frames, axes) of every unbroken run of frames [N m]
        """
        result = []
        for number, recording in enumerate(self.recordings):
            torque = recording.torque_rows @ parameters - law.torque(recording)
            used = np.zeros(len(recording), bool)
            for i, use in zip(self.sums.trial, self.sums.uses, strict=True):
                used[use] |= i == number
            result += [torque[start:stop] for start, stop in runs(used)]
        return result


def term_places(term: str, axes: Sequence[str]) -> dict[str, list[int]]:
    """Name the coefficients of a term.

    Parameters
    ----------
    term : of `TERMS`
    axes : names of the free axes

    Returns
    -------
    by name, columns among the 3 axes + 6 of `PassiveLaw`
    """
    kind, _, by_axis = term.partition(" by ")
    if kind in LAST:
        return {kind: [LAST[kind]]}
    if kind == "hinges":
        return {f"hinge {name}": [i - len(HINGES)] for i, name in enumerate(HINGES)}
    places = [i if kind == "viscosity" else len(axes) + i for i in range(len(axes))]
    return (
        {f"{kind} {axis}": [i] for axis, i in zip(axes, places, strict=True)}
        if by_axis
        else {kind: places}
    )


def law_columns(terms: Sequence[str], axes: int) -> tuple[Array, Groups]:
    """Find what a law's own coefficients are among those of `PassiveLaw`.

    Parameters
    ----------
    terms : of the law
    axes : how many

    Returns
    -------
    (3 axes + 6, coefficients), and the groups of coefficients
    """
    eye = np.eye(3 * axes + 6)
    columns: list[Array] = []
    groups: Groups = []
    for term in terms:
        check_name("term", term, TERMS, "a passive law")
        kind, _, by_axis = term.partition(" by ")
        first = len(columns)
        columns += [eye[places].sum(axis=0) for places in term_places(term, "xyz"[:axes]).values()]
        groups += [[i] for i in range(first, len(columns))]
        if kind == "stiffness":
            rest = len(columns) + np.arange(axes)
            columns += list(eye[2 * axes : 3 * axes])
            if by_axis:
                groups[-axes:] = [
                    [*group, int(i)] for group, i in zip(groups[-axes:], rest, strict=True)
                ]
            else:
                groups[-1] += rest.tolist()
    return np.array(columns).T, groups


def bounded_least_squares(H: Array, g: Array, groups: Groups) -> tuple[Array, Array]:
    """Minimize x H x / 2 - g x, the first coefficient of each group at least 0.

    Every choice of groups that are not 0 is solved and the best feasible one taken: exact, for a
    few groups.

    Parameters
    ----------
    H : (..., n, n)
    g : (..., n)
    groups : of coefficients

    Returns
    -------
    x (..., n), and g x (...,)
    """
    scale = np.sqrt(np.maximum(np.diagonal(H, axis1=-2, axis2=-1), 1e-300))
    scaled = H / scale[..., :, None] / scale[..., None, :]
    right = g / scale
    best = np.zeros(g.shape)
    gain = np.zeros(g.shape[:-1])
    for size in range(1, len(groups) + 1):
        for chosen in combinations(groups, size):
            columns = [column for group in chosen for column in group]
            part = scaled[..., columns, :][..., :, columns] + 1e-12 * np.eye(len(columns))
            x = np.linalg.solve(part, right[..., columns, None])[..., 0]
            value = np.sum(x * right[..., columns], axis=-1)
            at = np.cumsum([0, *(len(group) for group in chosen[:-1])])
            better = (x[..., at] >= 0.0).all(axis=-1) & (value > gain)
            full = np.zeros(g.shape)
            full[..., columns] = x
            best = np.where(better[..., None], full, best)
            gain = np.where(better, value, gain)
    return best / scale, gain


def _products(swing_recording: SwingRecording, use: np.ndarray, width: float) -> Array:
    """Condense the frames of a block: products of [torque_rows, resistances], all axes together."""
    names = ("angles", "rates", "lengthening")
    angles_name, rates_name, lengthening_name = names
    angles = getattr(swing_recording, angles_name)[use]
    rates = getattr(swing_recording, rates_name)[use]
    lengthening = getattr(swing_recording, lengthening_name)[use]
    columns = resistances(angles, rates, lengthening, width, slopes_of(swing_recording)[use])
    rows = np.concatenate([swing_recording.torque_rows[use], columns], axis=2)
    rows = rows.reshape(-1, rows.shape[2])
    return rows.T @ rows

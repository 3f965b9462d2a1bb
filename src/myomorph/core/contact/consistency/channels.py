"""Signals of force plates on their own clock, filtered as the motion is, and corrected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.consistency.body_needs import smoothed
from myomorph.core.contact.consistency.corrections import Correction
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Wrenches

FIRM = 0.05
"""Share of the weight from which a plate's center of pressure is believed."""
HEAVY = 0.1
"""The same of the load that shows where a plate lies."""


class PlateForces(NamedTuple):
    """Forces, moments about the ground's origin, and points of plates, (frames, plates, 3) each.

    Attributes
    ----------
    forces, moments, points : [N], [N m], [m]
    """

    forces: Array
    moments: Array
    points: Array


class Sampled(NamedTuple):
    """Filtered signals at the times of a motion.

    Attributes
    ----------
    forces, torques : (frames, plates, 3) [N], [N m]
    products : (frames, plates, 3, 3) of points and forces [N m]
    """

    forces: Array
    torques: Array
    products: Array


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Channels:
    """Filtered signals of plates.

    The filter acts on forces and on products of points and forces, since points alone leap where a
    foot comes and goes.

    Attributes
    ----------
    time : (samples,) evenly spaced [s]
    forces, torques : (samples, plates, 3) [N], [N m]
    products : (samples, plates, 3, 3) of points and forces, p_i F_j [N m]
    exchanged : the same of every pair of plates whose forces are exchanged
    middles : (plates, 3) of the centers of pressure [m]
    up : number of the vertical axis
    weight : of the body [N]
    """

    time: Array
    forces: Array
    torques: Array
    products: Array
    exchanged: dict[tuple[int, int], Array]
    middles: Array
    up: int
    weight: float

    def at(self, time: Array, correction: Correction) -> PlateForces:
        """Sample and correct them.

        Parameters
        ----------
        time : (frames,) of the motion [s]
        correction : of clocks, forces and points

        Returns
        -------
        forces, moments about the ground's origin, and points
        """
        return self.corrected(self.sampled(time, correction), correction)

    def sampled(self, time: Array, correction: Correction) -> Sampled:
        """Sample them at the times of a motion, on clocks that are corrected.

        Parameters
        ----------
        time : (frames,) of the motion [s]
        correction : of clocks, and of plates that are exchanged

        Returns
        -------
        (frames, plates, ...) signals
        """
        samples = self._samples(time, correction)
        products = self.products
        order = np.arange(self.forces.shape[1])
        if correction.exchanged is not None:
            first, second = correction.exchanged
            order[[first, second]] = second, first
            products = self.exchanged[correction.exchanged]
        return Sampled(
            forces=_between(self.forces[:, order], samples),
            torques=_between(self.torques[:, order], samples),
            products=_between(products, samples),
        )

    def corrected(self, sampled: Sampled, correction: Correction) -> PlateForces:
        """Correct forces and points that were sampled.

        Parameters
        ----------
        sampled : signals at the times of a motion
        correction : of forces and points

        Returns
        -------
        forces, moments about the ground's origin, and points
        """
        force = np.einsum("pij,tpj->tpi", correction.force, sampled.forces)
        product = correction.point @ sampled.products @ np.swapaxes(correction.force, -1, -2)
        product = product + correction.shift[..., None] * force[:, :, None, :]
        load = force[..., self.up]
        firm = np.where(np.abs(load) > FIRM * self.weight, load, np.inf)
        points = product[..., self.up] / firm[..., None]
        product = product + self.middles[:, :, None] * correction.offset[:, None, :]
        turned = product - np.swapaxes(product, -1, -2)
        moments = np.stack([turned[..., 1, 2], turned[..., 2, 0], turned[..., 0, 1]], axis=-1)
        return PlateForces(force + correction.offset, moments + sampled.torques, points)

    def _samples(self, time: Array, correction: Correction) -> Array:
        """Numbers of the samples (frames, plates), with fractions, on the plates' clocks.

        Where a corrected clock leaves the recording, frames keep the samples that they have: what
        was not recorded speaks neither for nor against a correction.
        """
        late = correction.lost * (time > correction.lost_from)
        late = late + correction.rate * (time - self.time[0])
        at = (time + late)[:, None] + correction.lag
        recorded = (at >= self.time[0]) & (at <= self.time[-1])
        at = np.where(recorded, at, time[:, None])
        last = len(self.time) - 1
        share = (at - self.time[0]) / (self.time[-1] - self.time[0])
        return np.clip(share * last, 0.0, last - 1e-3)


def _between(values: Array, samples: Array) -> Array:
    """Interpolate values (samples, plates, ...) at sample numbers (frames, plates)."""
    before = samples.astype(int)
    plates = np.arange(values.shape[1])
    share = (samples - before).reshape(*samples.shape, *(1,) * (values.ndim - 2))
    return np.asarray(values[before, plates] * (1.0 - share) + values[before + 1, plates] * share)


def channels(wrenches: Wrenches, usable: NDArray[np.bool_], up: int, weight: float) -> Channels:
    """Filter the signals of plates.

    Parameters
    ----------
    wrenches : as recorded, (samples, plates, 3)
    usable : (plates,) whose channels work and are stepped on; the others are taken as empty
    up : number of the vertical axis
    weight : of the body [N]

    Returns
    -------
    (samples, plates, ...) filtered signals
    """
    rate = 1.0 / float(np.median(np.diff(wrenches.time)))
    forces = np.nan_to_num(wrenches.forces) * usable[:, None]
    points = np.nan_to_num(wrenches.points)
    torques = np.nan_to_num(wrenches.torques) * usable[:, None]
    heavy = np.abs(forces[..., up]) > HEAVY * weight
    exchanged = {}
    for first in np.flatnonzero(usable):
        for second in np.flatnonzero(usable[:first]):
            order = np.arange(forces.shape[1])
            order[[first, second]] = second, first
            exchanged[int(first), int(second)] = smoothed(_products(points, forces[:, order]), rate)
    return Channels(
        time=wrenches.time,
        forces=smoothed(forces, rate),
        torques=smoothed(torques, rate),
        products=smoothed(_products(points, forces), rate),
        exchanged=exchanged,
        middles=np.array(
            [
                np.median(points[on, plate], axis=0) if on.any() else np.zeros(3)
                for plate, on in enumerate(heavy.T)
            ]
        ),
        up=up,
        weight=weight,
    )


def _products(points: Array, forces: Array) -> Array:
    """Products p_i F_j (samples, plates, 3, 3) of points and forces (samples, plates, 3)."""
    return np.asarray(points[..., :, None] * forces[..., None, :])

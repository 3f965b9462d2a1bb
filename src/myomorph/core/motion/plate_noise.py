"""Noise of a motion, as forces of plates show it.

By Newton's law all external forces together are the mass times the acceleration of its center, less
gravity. At frequencies at which the motion's own acceleration a has more power than the forces f
account for, that is noise of the motion:

    share = 1 - r / r_0,    r = |mean of a* f / m| / mean of |a|^2

with r_0 the largest ratio of all frequencies, at most 1: masses that are not the body's, or the
gain of a plate, part motion and forces at all frequencies alike, and are no noise. The mean product
knows no error of one that the other does not have, and its magnitude no delay of one clock. What
chance alone would make of it is taken off its square: mean |a|^2 mean |f / m|^2 / n for n samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.fit.spectra import SEGMENT, sine_tapers
from myomorph.core.fit.trends import detrended, running_mean
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree

SLOW = 6.0  # Filter through which weight is compared, as which contacts are measured [Hz]
WINDOW = 0.2  # Over which weight is compared [s]
MAX_MISSING = 0.2  # Share of the weight that may be missing
MIN_DURATION = 0.5  # Of a part in which plates carry the body [s]
BAND = 1.3  # Highest frequency over the lowest of a bin
FASTEST = 0.4  # Of the rate: forces have nothing beyond


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class PlateNoise:
    """Share of the power of accelerations that plates show to be noise.

    Attributes
    ----------
    frequency : (bins,) [Hz]
    share : (bins,) of the power, 0 to 1
    """

    frequency: Array
    share: Array

    def at(self, frequency: Array) -> Array:
        """Interpolate the share.

        Parameters
        ----------
        frequency : (n,) [Hz]

        Returns
        -------
        (n,), none below the lowest frequency
        """
        return np.asarray(np.interp(frequency, self.frequency, self.share, left=0.0))


def plate_noise(model: Model, motion: Motion, wrenches: Wrenches) -> PlateNoise | None:
    """Find what measured forces say about the noise of a motion.

    Parameters
    ----------
    model : with masses
    motion : (frames, coordinates) as recorded, without gaps, at even times [rad or m]
    wrenches : all external forces, as measured; NaN where missing

    Returns
    -------
    None where plates carry the whole body for less than half a second
    """
    if not model.mass > 0.0 or not wrenches.names or len(motion) < 3:
        return None
    rate = motion.rate
    tree = compile_tree(model)
    path = center_of_mass(tree, forward_kinematics(tree, tree.coordinates_of(motion)))
    accelerations = np.diff(path, 2, axis=0) * rate**2 - np.asarray(model.gravity)
    measured = _specific_forces(wrenches, motion.time[1:-1], rate, model.mass)
    carried = _carried(model, accelerations, measured, rate)
    start, stop = max(runs(carried), key=lambda run: run[1] - run[0], default=(0, 0))
    if stop - start < MIN_DURATION * rate:
        return None
    spectra = _CrossSpectra.of(accelerations[start:stop], measured[start:stop], rate)
    return spectra.compared()


def _specific_forces(wrenches: Wrenches, time: Array, rate: float, mass: float) -> Array:
    """Divide the sum of all forces by the mass.

    Parameters
    ----------
    wrenches : as measured; NaN where missing
    time : (frames,) [s]
    rate : of the frames [Hz]
    mass : [kg]

    Returns
    -------
    (frames, 3) [m/s^2]; NaN where a force is missing
    """
    within = (time >= wrenches.time[0] - 1e-9) & (time <= wrenches.time[-1] + 1e-9)
    result = np.full((len(time), 3), np.nan)
    if within.sum() >= 2:
        at_frames = resample_wrenches(wrenches, time[within], FASTEST * rate)
        result[within] = at_frames.forces.sum(axis=1) / mass
    return result


def _carried(model: Model, accelerations: Array, measured: Array, rate: float) -> np.ndarray:
    """Mark frames (frames,) in which plates carry the whole body.

    Parameters
    ----------
    model : whose gravity says what is up
    accelerations : (frames, 3) of the center of mass, less gravity [m/s^2]
    measured : (frames, 3) forces over the mass [m/s^2]
    rate : of the frames [Hz]
    """
    known: np.ndarray = np.asarray(np.isfinite(measured).all(axis=1))
    gravity = float(np.linalg.norm(model.gravity))
    if not known.any() or not gravity > 0.0 or rate <= 2.5 * SLOW:
        return np.zeros(len(known), bool)
    up = -np.asarray(model.gravity) / gravity
    needed = lowpass(accelerations @ up, rate, SLOW)
    weighed = lowpass(np.where(known, np.nan_to_num(measured) @ up, needed), rate, SLOW)
    frames = max(1, round(WINDOW * rate))
    missing = running_mean(needed - weighed, frames)
    return np.asarray(known & (np.abs(missing) < MAX_MISSING * gravity))


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _CrossSpectra:
    """Spectra of accelerations and forces, summed over samples.

    Attributes
    ----------
    frequency : (n,) [Hz]
    product : (n, 3) complex, of motion and force
    motion, force : (n, 3) power of each
    samples : of each frequency
    """

    frequency: Array
    product: np.ndarray
    motion: Array
    force: Array
    samples: int

    @staticmethod
    def of(accelerations: Array, measured: Array, rate: float) -> _CrossSpectra:
        """Transform both (frames, 3) [m/s^2], at a rate [Hz], with sine tapers."""
        frames = len(measured)
        length = min(frames, int(SEGMENT * rate))
        tapers = sine_tapers(length)[:, :, None]
        starts = np.linspace(0, frames - length, frames // length).astype(int)
        # Second differences are smaller than derivatives.
        turn = 2.0 * np.pi * np.fft.rfftfreq(length)[1:]
        gain = (2.0 - 2.0 * np.cos(turn)) / turn**2
        shape = (len(turn), 3)
        product = np.zeros(shape, complex)
        motion = np.zeros(shape)
        force = np.zeros(shape)
        for start in starts:
            part = slice(start, start + length)
            moved = tapers * detrended(accelerations[part])
            forced = tapers * detrended(measured[part])
            of_motion = np.fft.rfft(moved, axis=1)[:, 1:] / gain[:, None]
            of_force = np.fft.rfft(forced, axis=1)[:, 1:]
            product += (np.conj(of_motion) * of_force).sum(axis=0)
            motion += np.square(np.abs(of_motion)).sum(axis=0)
            force += np.square(np.abs(of_force)).sum(axis=0)
        return _CrossSpectra(
            frequency=np.asarray(turn / (2.0 * np.pi) * rate, np.float64),
            product=product,
            motion=motion,
            force=force,
            samples=len(tapers) * len(starts),
        )

    def compared(self) -> PlateNoise:
        """Compare motion and force within bins that are even in log f."""
        f = self.frequency
        number = np.floor(np.log(f / f[0]) / np.log(BAND) + 1e-9).astype(int)
        starts = np.flatnonzero(np.diff(number, prepend=-1))
        counts = np.diff(starts, append=len(f))
        motion = np.add.reduceat(self.motion, starts, axis=0)
        force = np.add.reduceat(self.force, starts, axis=0)
        squares = np.square(np.abs(np.add.reduceat(self.product, starts, axis=0)))
        samples = (self.samples * counts)[:, None]
        beyond_chance = np.maximum(squares - motion * force / samples, 0.0)
        common = np.sqrt(beyond_chance / (1.0 - 1.0 / samples)).sum(axis=1)
        whole = motion.sum(axis=1)
        ratio = np.divide(common, whole, out=np.zeros_like(common), where=whole > 0.0)
        usual = min(float(ratio.max()), 1.0)
        share = 1.0 - ratio / usual if usual > 0.0 else np.zeros_like(ratio)
        return PlateNoise(
            frequency=np.add.reduceat(f, starts) / counts, share=np.clip(share, 0.0, 1.0)
        )

"""One recording of the problem: what was measured, and its motion at a point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.body.refine.frame_kernels import Rates
from myomorph.body.refine.spline_basis import Basis
from myomorph.core.model.arrays import Array, read_only


@read_only
class TrialData:
    """One recording on the markers' clock.

    Attributes
    ----------
    name : of the recording
    time : (frames,) [s]
    observed : (frames, markers, 3), NaN where unseen [m]
    measured : (frames, 6) moment about the ground's origin and force [N m], [N]; 0 where not used
    use : (frames,) whether the plates carry all that touches the ground, so that the residual
        counts
    trust : (frames,) weight of the residual, 1 unless nothing explains it
    start : (frames, coordinates) by inverse kinematics [rad or m]
    basis : splines of its coordinates
    gain : by which what was measured is multiplied, so that the plates weigh the body
    """

    name: str
    time: Array
    observed: Array
    measured: Array
    use: np.ndarray
    trust: Array
    start: Array
    basis: Basis
    gain: float = 1.0

    @property
    def wrench(self) -> Array:
        """(frames, 6) that the residual is against."""
        return self.gain * self.measured

    @property
    def seen(self) -> np.ndarray:
        """(frames, markers) which markers were seen."""
        return np.asarray(np.isfinite(self.observed).all(axis=2))

    @cached_property
    def start_coefficients(self) -> Array:
        """(coefficients, coordinates) of splines through inverse kinematics."""
        return self.basis.fitted(self.start)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrialState:
    """A recording at a point.

    Attributes
    ----------
    number : of the recording
    data : what was measured
    rates : of its motion; predicting sets dependent coordinates in place
    wrench : (frames, 6) that the residual is against, moment about the ground's origin and force
    """

    number: int
    data: TrialData
    rates: Rates
    wrench: Array

    def with_rates(self, rates: Rates) -> TrialState:
        """Replace the motion."""
        return replace(self, rates=rates)

    def with_wrench(self, wrench: Array) -> TrialState:
        """Replace the wrench.

        Parameters
        ----------
        wrench : (frames, 6) moment about the ground's origin and force

        Returns
        -------
        the state with it
        """
        return replace(self, wrench=wrench)


class Predicted(NamedTuple):
    """A recording predicted by a body and a motion.

    Attributes
    ----------
    errors : (frames, markers, 3) predicted less observed [m], 0 where unseen
    residual : (frames, 6) needed less measured, moment about the base and force [N m], [N]; 0 where
        not used
    """

    errors: Array
    residual: Array

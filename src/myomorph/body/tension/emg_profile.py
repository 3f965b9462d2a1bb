"""Delay and shape of all EMG channels by the profile of the posterior.

At each delay and shape that is tried, the gains are the most probable ones (an estimate of
`core/fit`); the delay and shape whose estimate is most probable are taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.tension.emg_groups import (
    calibration_of,
    kept_level,
    settled_gains,
    some_names,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import EMG
from myomorph.core.motion.emg_activation import LIKELIHOOD_95, USUAL, EmgCalibration
from myomorph.core.tension.emg_gains import Prior
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.core.tension.emg_tracking import TorqueTracking

SHAPES = (-0.5, -1.0, -1.5, -2.0, -2.5, -3.0)
"""Shape factors that are tried beside a straight line; -3 is the limit of Lloyd and Besier (2003).
"""
# Standard deviation of delays about the usual one, before any torque is seen [s]
DELAY_SPREAD = 0.03
LONGEST = 0.150
COARSE = 0.01
FINE = 0.002  # Of the delays that are tried, and between them first and last [s]
ROUNDS = 4  # Searches of delay and shape in turn, at most
NO_DELAY = "the torques determine no delay of the EMG channels: {delay:.3f} s assumed"
LATE = (
    "the delay of all EMG channels is {delay:g} s or more: EMG and motion may not be on one clock"
)
SILENT = "torques hardly determine the EMG gain of {channels}: a usual one is used"


class Course(NamedTuple):
    """How activations follow envelopes, alike in all channels.

    Attributes
    ----------
    delay : [s]
    shape : factor of `shaped`, 0 for a straight line
    """

    delay: float
    shape: float


class FoundDelay(NamedTuple):
    """The most probable delay at a shape.

    Attributes
    ----------
    delay : [s]
    warning : where torques say nothing of it, or want one beyond the range; "" for none
    """

    delay: float
    warning: str = ""


@dataclass(eq=False, kw_only=True)
class Profile:
    """The posterior of all trials over delay and shape.

    Attributes
    ----------
    tracking : the regression over all trials, which learns the errors of torques on the way
    names : of the channels
    options : of EMG; a delay or a shape that they state is kept
    level : prior of gains whose common level is known
    prior : the one of both that is kept, see `kept_level`
    """

    tracking: TorqueTracking
    names: tuple[str, ...]
    options: EmgOptions
    level: Prior
    prior: Prior = field(init=False)

    def __post_init__(self) -> None:
        self.prior = self.tracking.prior

    def calibration(self, muscles: tuple[str, ...]) -> EmgCalibration:
        """Alternate the search with errors of the torques, and build the calibration.

        Parameters
        ----------
        muscles : names of all muscles of the model
        """
        tracking = self.tracking
        stated = self.options.delay
        at = Course(delay=USUAL if stated is None else stated, shape=self.options.shape or 0.0)
        warning = ""
        tracking.learn_errors(*self._each(at))
        self.prior = kept_level(tracking, self.level, *self._each(at))
        for _ in range(ROUNDS):
            before = at
            at, warning = self._most_probable(at)
            if np.abs(np.subtract(before, at)).max() < COARSE:
                break
            tracking.learn_errors(*self._each(at), self.prior)
        settled = settled_gains(tracking, self.prior, *self._each(at))
        result = calibration_of(tracking, settled, self.names, muscles)
        warnings = [EMG.message(warning)] if warning else []
        silent = [name for name, told in zip(self.names, result.by_torque, strict=True) if not told]
        if silent:
            warnings.append(
                EMG.message(SILENT.format(channels=some_names(silent)), severity="good to know")
            )
        return replace(result, warnings=tuple(warnings))

    def _each(self, at: Course) -> tuple[Array, Array]:
        """Repeat a delay and a shape for all channels.

        Returns
        -------
        (channels,) delays [s], and (channels,) shape factors
        """
        return np.full(len(self.names), at.delay), np.full(len(self.names), at.shape)

    def _cost(self, at: Course) -> float:
        """Compute minus the logarithm of the posterior of delay and shape."""
        unusual = (at.delay - USUAL) / DELAY_SPREAD
        estimate = self.tracking.fit(*self._each(at), self.prior)
        return estimate.cost + 0.5 * float(unusual**2)

    def _most_probable(self, at: Course) -> tuple[Course, str]:
        """Find the most probable delay and shape at the errors of torques known so far.

        The shape is not straight only where torques are more likely so.

        Parameters
        ----------
        at : delay and shape so far

        Returns
        -------
        both, and a warning of the delay, "" for none
        """
        shapes = (0.0, *SHAPES) if self.options.shape is None else (at.shape,)
        tried = list[tuple[float, Course]]()
        warning = ""
        for shape in shapes:
            found = FoundDelay(at.delay) if self.options.delay is not None else self._delay(shape)
            warning = found.warning
            course = Course(delay=found.delay, shape=shape)
            tried.append((self._cost(course), course))
        straight = tried[0]
        best = min(tried, key=lambda candidate: candidate[0])
        bent = len(tried) > 1 and best[0] <= straight[0] - LIKELIHOOD_95
        return (best if bent else straight)[1], warning

    def _delay(self, shape: float) -> FoundDelay:
        """Find the most probable delay at a shape.

        Parameters
        ----------
        shape : factor of all channels
        """
        coarse = np.append(np.arange(0.0, LONGEST, COARSE), LONGEST)
        costs = np.array([self._cost(Course(delay=delay, shape=shape)) for delay in coarse])
        best = int(np.argmin(costs))
        low = coarse[max(best - 1, 0)]
        high = coarse[min(best + 1, len(coarse) - 1)]
        fine = np.arange(low, high + 0.5 * FINE, FINE)
        fine_costs = [self._cost(Course(delay=delay, shape=shape)) for delay in fine]
        delay = float(fine[int(np.argmin(fine_costs))])
        likely = costs - 0.5 * ((coarse - USUAL) / DELAY_SPREAD) ** 2
        if float(np.ptp(likely)) < LIKELIHOOD_95:
            return FoundDelay(delay, NO_DELAY.format(delay=delay))
        if delay >= LONGEST - 0.5 * FINE:
            return FoundDelay(delay, LATE.format(delay=delay))
        return FoundDelay(delay)

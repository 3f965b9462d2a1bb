"""The clock of the forces as an unknown of `refine`: an offset from that of the markers.

Plates and cameras that are started by hand, or whose samples pass different filters, are some
milliseconds apart, and inertia then looks like a force that is missing.
"""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.recordings import REACH
from myomorph.body.refine.kind import Here, Kind, KindSlopes, PriorRows, Setup
from myomorph.body.refine.options import CLOCK
from myomorph.body.refine.trial import TrialData
from myomorph.core.fit.unknowns import Block, Unknown
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.splines import Spline, natural_spline
from myomorph.core.rigid.regressor import base_wrench

ALL = "all recordings"
MILLISECOND = 1e-3  # An offset of this size matters [s]


@read_only
class Clock(Kind):
    """Offsets of the clock of the forces: to be added to their times.

    At a time t of the markers the forces are those of t - offset on their own clock. The filter
    blurs forces over `REACH` of a period of its cutoff: larger offsets than this are not looked
    for, and anything in it is as likely as another before anything is measured.

    Attributes
    ----------
    names : of the recordings, or `ALL` alone
    forces : of each recording its filtered wrench (times, 6) about the ground's origin
    begun : (recordings,) offsets that the times of these forces hold already [s]
    bound : largest offset either way [s]
    """

    names: tuple[str, ...]
    forces: tuple[Spline, ...]
    begun: Array
    bound: float

    name = CLOCK

    @classmethod
    def of(cls, setup: Setup) -> Clock:
        """Take the filtered forces of all recordings, between their samples too."""
        forces = []
        for recorded in setup.recorded:
            recording = recorded.usable.recording
            wrench = base_wrench(setup.model, recording.motion, recording.wrenches, np.zeros(3))
            forces.append(natural_spline(recording.motion.time, np.nan_to_num(wrench)))
        each = tuple(recorded.trial.name for recorded in setup.recorded)
        return cls(
            names=(ALL,) if setup.options.shared_clock else each,
            forces=tuple(forces),
            begun=np.array([recorded.shift for recorded in setup.recorded]),
            bound=REACH / setup.options.cutoff,
        )

    def start(self) -> Array:
        """Return the offsets that the forces hold already.

        Returns
        -------
        (clocks,) [s]
        """
        begun = self.begun[:1] if len(self.names) < len(self.begun) else self.begun
        return np.clip(begun, -self.bound, self.bound)

    def block(self, values: Array) -> Block:
        """List the offsets.

        Parameters
        ----------
        values : (clocks,) where the search begins [s]

        Returns
        -------
        an unknown for each clock
        """
        unknowns = [
            Unknown(
                name=clock_name(name),
                unit="s",
                where=f"{name}: added to the times of forces",
                start=float(offset),
                low=-self.bound,
                high=self.bound,
                scale=MILLISECOND,
            )
            for name, offset in zip(self.names, values, strict=True)
        ]
        return Block(name=CLOCK, unknowns=tuple(unknowns))

    def wrench(self, number: int, data: TrialData, values: Array, wrench: Array) -> Array:
        """Take the wrench at times of the forces' clock.

        Parameters
        ----------
        number : of the recording
        data : the recording
        values : (clocks,) [s]
        wrench : (frames, 6) of the kinds before; not used

        Returns
        -------
        (frames, 6) w(t - offset) about the ground's origin [N m], [N]
        """
        return data.gain * self.forces[number](self._times(number, data, values))

    def slopes(self, here: Here) -> KindSlopes:
        """Differentiate the residual in the offset of the recording.

        The wrench w(t - offset) has the slope -w'(t - offset), and the residual is linear in it.

        Returns
        -------
        (frames, 6, clocks) 0 for clocks of other recordings
        """
        state = here.state
        number = state.number
        values = here.point[CLOCK]
        times = self._times(number, state.data, values)
        slope = -state.data.gain * self.forces[number](times, order=1)
        other = here.problem.predict(here.setting, state.with_wrench(state.wrench + slope))
        residual = np.zeros((len(times), 6, len(values)))
        residual[:, :, self._place(number)] = other.residual - here.predicted.residual
        return KindSlopes(residual=residual)

    def prior_rows(self, values: Array) -> PriorRows:
        """Compare offsets with 0.

        Parameters
        ----------
        values : (clocks,) [s]

        Returns
        -------
        misses in the standard deviation of a uniform distribution over the bounds
        """
        sd = self.bound / np.sqrt(3.0)
        return PriorRows(rows=np.eye(len(values)) / sd, misses=values / sd)

    def _place(self, number: int) -> int:
        """Return the place of a recording's clock among the offsets."""
        return number if len(self.names) == len(self.begun) else 0

    def _times(self, number: int, data: TrialData, values: Array) -> Array:
        """Convert the frames' times to those of the spline; at its ends the forces stay.

        Parameters
        ----------
        number : of the recording
        data : the recording
        values : (clocks,) [s]

        Returns
        -------
        (frames,) [s]
        """
        knots = self.forces[number].knots
        times = data.time - (values[self._place(number)] - self.begun[number])
        return np.clip(times, knots[0], knots[-1])


def clock_name(recording: str) -> str:
    """Name the offset of a recording's clock among unknowns."""
    return f"clock of {recording}"

"""A causal filter: value, velocity and acceleration, all late by one known delay.

A Bessel low-pass of fourth order (Thomson 1949) with unit gain,

    H(s) = 105 / (x^4 + 10 x^3 + 45 x^2 + 105 x + 105),   x = s T

Its delay T is the same for all that it lets pass (maximally flat), so that everything filtered by
it, coordinates as well as forces, comes T late and otherwise unshifted. Velocity and acceleration
are states of the filter, and need no differences. Between samples the input is a straight line, and
the filter's equation is solved exactly along it: frames may come at uneven times, and one that is
missing is bridged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kernels import inner, kernel

# Frequency times delay at which this filter halves the power, in radians
HALF_POWER = 2.1139176749042158
SETTLING = 3.0  # Delays after which what the filter began with has fallen below 0.2 %


@dataclass(frozen=True)
class CausalFilter:
    """The filter, with half the power at `cutoff` [Hz].

    Raises
    ------
    BadData : a cutoff that is not above 0 and finite
    """

    cutoff: float = 6.0

    def __post_init__(self) -> None:
        if not (self.cutoff > 0.0 and np.isfinite(self.cutoff)):
            raise BadData(f"cutoff {self.cutoff:g} Hz: expected a positive frequency")

    @property
    def delay(self) -> float:
        """Delay of all results [s]: T = 2.114 / (2 pi cutoff)."""
        return HALF_POWER / (2.0 * np.pi * self.cutoff)

    @property
    def settling(self) -> float:
        """Time after the first sample from which results hold [s]."""
        return SETTLING * self.delay

    def response(self, frequency: Array) -> Array:
        """Compute the complex gain at frequencies, H(2 pi i f).

        Parameters
        ----------
        frequency : of any shape [Hz]

        Returns
        -------
        of the same shape [-]
        """
        x = 2j * np.pi * np.asarray(frequency, dtype=np.float64) * self.delay
        return 105.0 / ((((x + 10.0) * x + 45.0) * x + 105.0) * x + 105.0)

    def motion(self, motion: Motion) -> Motion:
        """Filter a recorded motion frame by frame, with derivatives, on the recording's own times.

        The result at time t is that of t less `delay`.

        Parameters
        ----------
        motion : (frames, coordinates) [rad or m]; a frame with a NaN is bridged

        Returns
        -------
        with `velocities` and `accelerations`, each (frames, coordinates), NaN before `settling`
        """
        stream = CausalStream(self, len(motion.names))
        filtered = np.empty((len(motion), 3, len(motion.names)))
        for frame, time in enumerate(motion.time):
            stream.push(motion.time[frame : frame + 1], motion.values[frame : frame + 1])
            filtered[frame] = stream.at(float(time))
        return Motion(
            time=motion.time,
            names=motion.names,
            values=filtered[:, 0],
            velocities=filtered[:, 1],
            accelerations=filtered[:, 2],
        )

    def values(self, time: Array, samples: Array, at: Array) -> Array:
        """Filter the samples of one clock and evaluate them, late, at the times of another.

        Parameters
        ----------
        time : (samples,) ascending [s]
        samples : (samples, ...)
        at : (frames,) ascending [s]

        Returns
        -------
        (frames, ...), NaN before `settling`
        """
        flat = samples.reshape(len(time), -1)
        stream = CausalStream(self, flat.shape[1])
        filtered = np.full((len(at), flat.shape[1]), np.nan)
        done = 0
        for frame, stop in enumerate(np.searchsorted(time, at, side="right")):
            stream.push(time[done:stop], flat[done:stop])
            done = int(stop)
            filtered[frame] = stream.at(float(at[frame]))[0]
        return filtered.reshape(len(at), *samples.shape[1:])


class CausalStream:
    """State of the filter for rows of `width` numbers that keep coming."""

    def __init__(self, filter: CausalFilter, width: int):
        self.filter = filter
        self._delay = filter.delay
        # [value, T velocity, T^2 acceleration, T^3 jerk], the newest row, and room for a look ahead
        # of it.
        self._state = np.zeros((4, width))
        self._last = np.zeros(width)
        self._ahead = np.zeros((4, width))
        self._found = np.full((3, width), np.nan)
        # Time of the first and the newest row, and the step that the transition is of.
        self._clock = np.full(3, np.nan)
        self._transition = np.eye(4)
        self._room = np.zeros((3, 4, 4))
        self._scales = np.array([1.0, 1.0 / self._delay, 1.0 / self._delay**2])[:, None]

    @property
    def last(self) -> float:
        """Time of the newest row, nan before there is one [s]."""
        return float(self._clock[1])

    def settled(self, time: float) -> bool:
        """Return whether the filter has forgotten its first values at a time [s]."""
        return bool(time - self._clock[0] >= self.filter.settling - 1e-9)

    def push(self, time: Array, rows: Array) -> None:
        """Add rows.

        Parameters
        ----------
        time : (n,) ascending [s]; rows that are not later than the newest are ignored
        rows : (n, width); one with a NaN is ignored, as if it had never come
        """
        _advance(
            # Copies, because a kernel is compiled anew for arrays that are read-only.
            np.array(time, dtype=np.float64),
            np.array(rows, dtype=np.float64),
            self._delay,
            self._clock,
            self._state,
            self._last,
            self._transition,
            self._room,
        )

    def at(self, time: float) -> Array:
        """Evaluate the filter at the newest row or later, its input held at the newest row.

        Parameters
        ----------
        time : at or after the newest row [s]

        Returns
        -------
        (3, width) value, velocity [per s] and acceleration [per s^2], NaN until settled; the array
        is reused by the next call
        """
        if not self.settled(time):
            self._found[:] = np.nan
            return self._found
        if time > self._clock[1]:
            self._ahead[:] = self._state
            _step(
                time - self._clock[1],
                self._delay,
                self._last,
                self._last,
                self._ahead,
                self._room[2],
                self._room,
            )
            np.multiply(self._ahead[:3], self._scales, out=self._found)
        else:
            np.multiply(self._state[:3], self._scales, out=self._found)
        return self._found

    @property
    def state(self) -> Array:
        """(width,) value at the newest row, whether the filter has settled or not."""
        return np.asarray(self._state[0].copy())

    def derivatives(self, time: float) -> Array:
        """Evaluate the filter as `at`, with the third derivative in addition.

        Parameters
        ----------
        time : at or after the newest row [s]

        Returns
        -------
        (4, width) value and its first three derivatives; a copy, only the first three NaN until
        settled
        """
        lower = self.at(time)
        state = self._ahead if time > self._clock[1] else self._state
        return np.concatenate([lower, (state[3] / self._delay**3)[None]])

    def forget(self) -> None:
        """Begin anew with the next row."""
        self._clock[:] = np.nan


@inner
def _exponential(step, E, room):
    """Compute E = exp(step A), with A the filter's companion matrix in units of the delay.

        A = [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [-105, -105, -45, -10]]

    by a Taylor series of a step halved to at most 1/32, then squared.

    Parameters
    ----------
    step : length in delays [-]
    E : (4, 4) filled
    room : (2 or more, 4, 4) scratch
    """
    A = np.zeros((4, 4))
    term = room[0]
    product = room[1]
    halvings = 0
    while step > 0.03125:
        step *= 0.5
        halvings += 1
    for i in range(3):
        A[i, i + 1] = step
    A[3, 0] = -105.0 * step
    A[3, 1] = -105.0 * step
    A[3, 2] = -45.0 * step
    A[3, 3] = -10.0 * step
    E[:] = 0.0
    term[:] = 0.0
    for i in range(4):
        E[i, i] = term[i, i] = 1.0
    for order in range(1, 19):
        _multiply(term, A, product)
        for i in range(4):
            for j in range(4):
                term[i, j] = product[i, j] / order
                E[i, j] += term[i, j]
    for _ in range(halvings):
        _multiply(E, E, product)
        E[:] = product


@inner
def _multiply(A, B, C):
    """Compute C = A B of (4, 4) matrices."""
    for i in range(4):
        for j in range(4):
            total = 0.0
            for m in range(4):
                total += A[i, m] * B[m, j]
            C[i, j] = total


@inner
def _follow(transition, share, before, now, state):
    """Advance the states along a straight line of input.

    Less the steady answer to the line, [u - v, v, 0, 0] with the input u and its slope v in units
    of the delay, the states move freely: they are multiplied by the transition.

    Parameters
    ----------
    transition : (4, 4) of the step
    share : length of the step in delays [-]
    before, now : (width,) input at its start and end
    state : (4, width) advanced
    """
    for m in range(state.shape[1]):
        slope = (now[m] - before[m]) / share
        a = state[0, m] - (before[m] - slope)
        b = state[1, m] - slope
        c = state[2, m]
        d = state[3, m]
        for i in range(4):
            state[i, m] = (
                transition[i, 0] * a
                + transition[i, 1] * b
                + transition[i, 2] * c
                + transition[i, 3] * d
            )
        state[0, m] += now[m] - slope
        state[1, m] += slope


@kernel
def _step(step, delay, before, now, state, transition, room):
    """Advance the states by one step of any length.

    Parameters
    ----------
    step, delay : [s]
    before, now : (width,) input at its start and end
    state : (4, width) advanced
    transition : (4, 4) filled
    room : (2 or more, 4, 4) scratch
    """
    _exponential(step / delay, transition, room)
    _follow(transition, step / delay, before, now, state)


@kernel
def _advance(time, rows, delay, clock, state, last, transition, room):
    """Advance the states by rows, one after the other.

    Parameters
    ----------
    time : (n,) [s]
    rows : (n, width); one with a NaN, or that is not later than the newest, is ignored
    delay : [s]
    clock : (3,) first and newest time and the step that `transition` is of [s], updated
    state : (4, width) [value, T velocity, T^2 acceleration, T^3 jerk], updated
    last : (width,) the newest row, updated
    transition : (4, 4) of the last step, updated
    room : (2 or more, 4, 4) scratch
    """
    for index in range(time.shape[0]):
        unknown = 0.0
        for m in range(rows.shape[1]):
            unknown += rows[index, m] - rows[index, m]
        if unknown != 0.0:
            continue
        if np.isnan(clock[0]):
            # As if it had always stood there.
            clock[0] = clock[1] = time[index]
            clock[2] = np.nan
            state[:] = 0.0
            for m in range(rows.shape[1]):
                state[0, m] = last[m] = rows[index, m]
            continue
        step = time[index] - clock[1]
        if not step > 0.0:
            continue
        if not abs(step - clock[2]) <= 1e-9 * step:
            _exponential(step / delay, transition, room)
            clock[2] = step
        _follow(transition, step / delay, last, rows[index], state)
        for m in range(rows.shape[1]):
            last[m] = rows[index, m]
        clock[1] = time[index]

"""Recordings as personalization takes them.

Paths, moment arms, torques and EMG in windows of even frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.shown import shown
from myomorph.core.muscles.hill import compile_hill
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.core.tension.terms.emg import EmgTarget

FRAME = 0.01  # Between the frames at which fibers are followed [s]
WINDOW = 1.2
LEAD = 0.15
"""Fibers are followed in windows so long [s]; of each the first part only lets them find their
lengths.
"""
MIN_COUNT = 6  # Frames of a recording
MAX_GAP = 1.5  # To the nearest sample, in median distances of samples: beyond, nothing is known
LEAST_ERROR = 0.1
LEAST_SHARE = 0.01
"""Least errors of torques: a share of the reserves' strength, and of the torques' root mean square.
"""
LEAST_ARM = 1e-3
"""Coordinates about which no muscle has a moment arm of this share of the longest say nothing of
muscles.
"""


@shown
@dataclass(frozen=True, eq=False)
class PersonalTrial:
    """A recording that muscles are fitted to.

    Attributes
    ----------
    name : for messages and reports
    motion : with velocities
    torques : of inverse dynamics (frames, coordinates), at the motion's times [N m or N]
    emg : activations that EMG shows, at the motion's times, before gains; None for none
    passive : whether muscles were at rest and every frame held still, as where passive torques were
        measured; torques are then those that muscles and joints apply, NaN or without a column
        where nothing was measured
    """

    name: str
    motion: Motion
    torques: Series
    emg: EmgTarget | None = None
    passive: bool = False


@read_only
class Windows:
    """One recording, cut into windows that overlap by what lets the fibers find their lengths.

    Attributes
    ----------
    name : of the recording
    time : (windows, frames) [s]
    lengths : (windows, frames, muscles) of the paths [m]
    speeds : (windows, frames, muscles) of the paths [m/s]
    arms : (windows, frames, rows, muscles) [m/rad or m/m]
    torques : (windows, frames, rows) that muscles have to give, NaN where not measured [N m or N]
    emg : (windows, frames, muscles) NaN where unknown
    counted : (windows, frames) whether the frame is compared
    step : between frames [s], infinite where every frame is held still
    """

    name: str
    time: Array
    lengths: Array
    speeds: Array
    arms: Array
    torques: Array
    emg: Array
    counted: np.ndarray
    step: float

    @property
    def at_rest(self) -> bool:
        """Whether muscles were at rest and every frame held still."""
        return not np.isfinite(self.step)


def windows_of(
    model: Model, trials: Sequence[PersonalTrial]
) -> tuple[list[Windows], tuple[str, ...]]:
    """Cut recordings into windows, and find the coordinates whose torques are compared.

    Parameters
    ----------
    model : with the muscles
    trials : recordings

    Returns
    -------
    windows of each, and names of the coordinates

    Raises
    ------
    BadData : a motion has no velocities, a recording has too few known frames, or no muscle has a
        moment arm about a free coordinate whose torque is known
    """
    read = [_Read(model, trial) for trial in trials]
    longest = [np.abs(np.nan_to_num(recording.arms)).max(axis=(0, 2)) for recording in read]
    reach = np.max(longest, axis=0)
    kept = reach > LEAST_ARM * reach.max(initial=0.0)
    # What no recording measured, as joints without a passive torque, is not compared.
    kept &= np.any([np.isfinite(recording.torques).any(axis=0) for recording in read], axis=0)
    if not kept.any():
        raise BadData(
            f"model '{model.name}': no muscle has a moment arm about a free coordinate whose torque"
            " is known"
        )
    names = tuple(name for name, keep in zip(read[0].rows, kept, strict=True) if keep)
    return [recording.windows(kept) for recording in read], names


class _Read:
    """One recording on its own clock: paths, moment arms, torques and EMG.

    Attributes
    ----------
    trial : the recording
    time : (frames,) [s]
    lengths, speeds : (frames, muscles) of the paths [m], [m/s]
    rows : names of the coordinates whose torques muscles can give
    arms : (frames, rows, muscles) [m/rad or m/m]
    torques : (frames, rows) NaN where not measured [N m or N]
    emg : (frames, muscles) NaN where unknown
    """

    def __init__(self, model: Model, trial: PersonalTrial):
        motion = trial.motion
        if motion.velocities is None:
            raise BadData(f"'{trial.name}': the motion has no velocities: differentiate it first")
        self.trial = trial
        self.time = np.array(motion.time)
        moved = muscle_kinematics(model, motion, moment_arms=False)
        assert moved.muscle_velocity is not None
        self.lengths = np.array(moved.muscle_length)
        self.speeds = np.array(moved.muscle_velocity)

        torques = trial.torques
        measured = None
        if trial.passive:
            torques, measured = _measured(model, trial)
        # With a force of F0 at any length, columns of A are moment arms times F0: couplers and
        # loops are folded in.
        options = TensionOptions(curves="constant", passive=False)
        problem = tension_problem(
            TensionInputs(model=model, motion=motion, torques=torques, options=options)
        )
        balance = problem.balance(0, len(motion))
        force = np.maximum(compile_hill(model).force, 1e-9)
        self.rows = problem.assembly.coordinates
        columns = problem.separable.dense(balance.values)
        columns = columns[:, problem.assembly.coordinate_row, : len(force)]
        self.arms = np.ascontiguousarray(columns / force)
        self.torques = np.array(balance.torques)
        if measured is not None:
            of_rows = [model.coordinate_names.index(name) for name in self.rows]
            self.torques[~measured[:, of_rows]] = np.nan
        self.emg = _emg(model, trial, self.lengths.shape)

    def windows(self, kept: np.ndarray) -> Windows:
        """Cut the recording at even times.

        Parameters
        ----------
        kept : (rows,) coordinates that are compared

        Raises
        ------
        BadData : fewer than `MIN_COUNT` frames have coordinates and torques
        """
        arms = self.arms[:, kept]
        torques = self.torques[:, kept]
        good = _finite(self.lengths) & _finite(self.speeds) & _finite(arms)
        if self.trial.passive:
            good &= np.isfinite(torques).any(axis=1)
        else:
            good &= _finite(torques) & np.isfinite(torques).any(axis=1)
        if good.sum() < MIN_COUNT:
            raise BadData(
                f"'{self.trial.name}': {int(good.sum())} frames have coordinates and torques,"
                f" expected {MIN_COUNT}"
            )
        if self.trial.passive:
            return self._still(good, arms, torques)
        return self._moving(good, arms, torques)

    def _still(self, good: np.ndarray, arms: Array, torques: Array) -> Windows:
        """Put all poses that count into one window.

        Parameters
        ----------
        good : (frames,) which count
        arms, torques : (frames, rows, muscles) and (frames, rows) of the compared coordinates
        """
        speeds = self.speeds[good][None]
        return Windows(
            name=self.trial.name,
            time=self.time[good][None],
            lengths=self.lengths[good][None],
            speeds=np.zeros_like(speeds),
            arms=arms[good][None],
            torques=torques[good][None],
            emg=self.emg[good][None],
            counted=np.ones((1, int(good.sum())), bool),
            step=np.inf,
        )

    def _moving(self, good: np.ndarray, arms: Array, torques: Array) -> Windows:
        """Interpolate a movement at even times, and cut it into windows.

        Parameters
        ----------
        good : (frames,) which are known
        arms, torques : (frames, rows, muscles) and (frames, rows) of the compared coordinates
        """
        known = self.time[good]
        count = max(int(np.floor((known[-1] - known[0]) / FRAME + 1e-6)) + 1, 2)
        time = known[0] + FRAME * np.arange(count)
        lengths = scipy.interpolate.CubicSpline(known, self.lengths[good])(time)
        speeds = scipy.interpolate.CubicSpline(known, self.speeds[good])(time)
        arms = scipy.interpolate.CubicSpline(known, arms[good])(time)
        torques = scipy.interpolate.CubicSpline(known, torques[good])(time)
        emg = np.array([_known_at(time, self.time, column) for column in self.emg.T]).T

        # A frame is compared where its neighbours in the recording are known.
        near = _gap(known, time) < MAX_GAP * np.median(np.diff(self.time))
        cuts = _cuts(count)
        return Windows(
            name=self.trial.name,
            time=time[cuts.frame],
            lengths=lengths[cuts.frame],
            speeds=speeds[cuts.frame],
            arms=arms[cuts.frame],
            torques=torques[cuts.frame],
            emg=emg[cuts.frame],
            counted=near[cuts.frame] & cuts.counted,
            step=FRAME,
        )


class _Cuts(NamedTuple):
    """Frames of overlapping windows.

    Attributes
    ----------
    frame : (windows, frames) of the recording; the last one fills up the last window
    counted : (windows, frames) whether it is within the recording, and its fibers have found their
        lengths
    """

    frame: NDArray[np.int64]
    counted: np.ndarray


def _cuts(count: int) -> _Cuts:
    """Cut so many frames into windows that overlap by `LEAD`."""
    size = round(WINDOW / FRAME)
    lead = round(LEAD / FRAME)
    body = size - lead
    number = max(int(np.ceil((count - lead) / body)), 1)
    frame = np.arange(min(size, count))
    every = np.arange(number)[:, None] * body + frame
    return _Cuts(
        frame=np.minimum(every, count - 1),
        counted=(every < count) & (frame >= min(lead, count // 3)),
    )


def _finite(values: Array) -> np.ndarray:
    """Find frames whose values are all known.

    Parameters
    ----------
    values : (frames, ...)

    Returns
    -------
    (frames,)
    """
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))


def _emg(model: Model, trial: PersonalTrial, shape: tuple[int, ...]) -> Array:
    """Arrange EMG by muscle.

    Parameters
    ----------
    shape : (frames, muscles)

    Returns
    -------
    (frames, muscles) not below 0, NaN where unknown; 0 at rest
    """
    emg = np.full(shape, np.nan)
    if trial.passive:
        emg[:] = 0.0
    elif trial.emg is not None:
        columns = [model.muscle_names.index(name) for name in trial.emg.muscles]
        emg[:, columns] = np.maximum(trial.emg.activations, 0.0)
    return emg


def _measured(model: Model, trial: PersonalTrial) -> tuple[Series, np.ndarray]:
    """Arrange passive torques by coordinate, 0 where not measured.

    Returns
    -------
    torques of all coordinates [N m or N], and (frames, coordinates) where they were measured

    Raises
    ------
    BadData : no column is the torque of a coordinate
    """
    values = np.full((len(trial.motion), len(model.coordinates)), np.nan)
    known = [name for name in trial.torques.names if name in model.coordinate_names]
    if not known:
        raise BadData(
            f"'{trial.name}': no column is the torque of a coordinate of model '{model.name}'"
        )
    for name in known:
        values[:, model.coordinate_names.index(name)] = trial.torques[name]
    measured = np.isfinite(values)
    return (
        Series(trial.motion.time, model.coordinate_names, np.where(measured, values, 0.0)),
        measured,
    )


def _known_at(time: Array, own: Array, values: Array) -> Array:
    """Interpolate values at other times, NaN beside gaps.

    Parameters
    ----------
    time : (frames,) [s]
    own : (samples,) ascending [s]
    values : (samples,) NaN where unknown

    Returns
    -------
    (frames,)
    """
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.full(len(time), np.nan)
    result = np.interp(time, own[known], values[known])
    far = _gap(own[known], time) > MAX_GAP * np.median(np.diff(own))
    return np.where(far, np.nan, result)


def _gap(own: Array, time: Array) -> Array:
    """Compute how far each time is from the nearest sample.

    Parameters
    ----------
    own : (samples,) ascending [s]
    time : (frames,) [s]

    Returns
    -------
    (frames,) [s]
    """
    after = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
    return np.minimum(np.abs(own[after] - time), np.abs(own[after - 1] - time))


def torque_floors(model: Model, names: Sequence[str], windows: Sequence[Windows]) -> Array:
    """Compute the least error of the torques.

    It is 0.1 N m on a body of human size, and 1 % of what is carried.

    Parameters
    ----------
    model : whose size counts
    names : of the coordinates that are compared
    windows : recordings

    Returns
    -------
    (rows,) [N m or N]
    """
    size = {reserve.coordinate: reserve.optimal_force for reserve in default_reserves(model)}
    least = np.array([size.get(name, 1.0) for name in names])
    every = np.concatenate([window.torques[window.counted] for window in windows])
    counts = np.maximum(np.isfinite(every).sum(axis=0), 1)
    carried = np.sqrt(np.nansum(every**2, axis=0) / counts)
    return np.maximum(LEAST_ERROR * least, LEAST_SHARE * carried)

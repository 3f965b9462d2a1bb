"""A hand on an instrumented wheel: what the wheel's angle alone tells of the rim's force."""

from __future__ import annotations

import itertools
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.spells import hysteresis
from myomorph.core.model.arrays import Array, runs
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.splines import natural_spline

FOLDER = "wheelchair-pushrim"
RATE = 240.0
CUTOFF = 6.0
RIM = 0.267
"""Radius of the push rim of a wheel of 24 inches [m]."""

BEGINS = 2.0
ENDS = 1.0
SHORTEST = 0.1
"""A push begins above and ends below these moments [N m], and lasts at least so long [s]."""


@dataclass(frozen=True, eq=False)
class Wheel:
    """A wheel's record, forward positive.

    `time`: (frames,) [s]; `angle`, `rate`, `acceleration`: (frames,) low-pass filtered [rad],
    [rad/s], [rad/s^2]; `forces`: (frames, 3) of the hand, the third along the axle [N]; `moment`:
    (frames,) of the hand about the axle [N m]; `pushes`: first frame of each push and the one
    behind its last.
    """

    name: str
    time: Array
    angle: Array
    rate: Array
    acceleration: Array
    forces: Array
    moment: Array
    pushes: tuple[tuple[int, int], ...]


def wheels(folder: Path) -> tuple[Wheel, ...]:
    """Read the recordings with pushes: over ground, and a sprint on a basketball court."""
    here = folder / FOLDER
    return (
        _over_ground(here / "pushrimkinetics"),
        _sprint(here / "inversedynamics" / "basketball_kinetics.ktk.zip"),
    )


def _over_ground(here: Path) -> Wheel:
    """Read the recording over ground (Chenier 2017).

    The rim's weight, which turns with the wheel, is known by a trial that an operator pushed.
    """
    tables = [
        np.genfromtxt(here / f"sample_swl_overground_{kind}_withrubber.csv", delimiter=",")
        for kind in ("baseline", "propulsion")
    ]
    angles = [np.unwrap(np.deg2rad(one[:, 3])) for one in tables]
    waves = [np.column_stack([np.sin(one), np.cos(one), np.ones_like(one)]) for one in angles]
    weight = np.linalg.lstsq(waves[0], tables[0][:, 18:24], rcond=None)[0]
    load = tables[1][:, 18:24] - waves[1] @ weight
    return _wheel("over ground", np.arange(len(load)) / RATE, angles[1], load)


def _sprint(path: Path) -> Wheel:
    data = json.loads(zipfile.ZipFile(path).read("data.json"))
    load = np.hstack([np.array(data["data"][kind])[:, :3] for kind in ("Forces", "Moments")])
    time = np.array(data["time"])
    # It turns backwards; after the last of its pushes the player brakes and turns.
    last = max(one["time"] for one in data["events"] if one["name"] == "recovery") + 0.3
    kept = time < last
    return _wheel("sprint", time[kept], -np.array(data["data"]["Angle"])[kept], -load[kept])


def _wheel(name: str, time: Array, angle: Array, load: Array) -> Wheel:
    spline = natural_spline(time, lowpass(angle[:, None], RATE, CUTOFF))
    rate = spline.derivative(1)(time)[:, 0]
    acceleration = spline.derivative(2)(time)[:, 0]
    moment = lowpass(load[:, 5:6], RATE, CUTOFF)[:, 0]
    pushing = hysteresis(moment > BEGINS, moment < ENDS)
    pushes = tuple((a, b) for a, b in runs(pushing) if time[b - 1] - time[a] > SHORTEST)
    return Wheel(
        name=name,
        time=time,
        angle=angle,
        rate=rate,
        acceleration=acceleration,
        forces=lowpass(load[:, :3], RATE, CUTOFF),
        moment=moment,
        pushes=pushes,
    )


@dataclass(frozen=True, eq=False)
class Prediction:
    """A moment from the wheel's angle, tested where it was not fitted.

    It is inertia times acceleration plus resistance. `inertia`, `resistance`: mean of both halves
    [kg m^2], [N m]; `predicted`, `measured`: [N m].
    """

    inertia: float
    resistance: float
    predicted: Array
    measured: Array

    @property
    def rms(self) -> float:
        """Root mean square error [N m]."""
        return float(np.sqrt(np.mean((self.predicted - self.measured) ** 2)))

    @property
    def correlation(self) -> float:
        """Of predicted and measured."""
        return float(np.corrcoef(self.predicted, self.measured)[0, 1])


def predict(acceleration: Array, moment: Array, half: NDArray[np.bool_]) -> Prediction:
    """Fit M = I a + c on one half, predict the other, and the other way round.

    Parameters
    ----------
    acceleration : (samples,) a of the wheel [rad/s^2]
    moment : (samples,) M about the axle [N m]
    half : (samples,) whether a sample is in the first half

    Returns
    -------
    The mean of both fits, and what they predict
    """
    X = np.column_stack([acceleration, np.ones_like(acceleration)])
    predicted = np.empty_like(moment)
    found = []
    for shown in (half, ~half):
        found.append(np.linalg.lstsq(X[shown], moment[shown], rcond=None)[0])
        predicted[~shown] = X[~shown] @ found[-1]
    inertia, resistance = np.mean(found, axis=0)
    return Prediction(
        inertia=float(inertia), resistance=float(resistance), predicted=predicted, measured=moment
    )


def at_each_time(wheel: Wheel) -> Prediction:
    """Moments from the first push to the last; cycles are fitted and tested in turn."""
    starts = [first for first, _ in wheel.pushes]
    frames = np.arange(starts[0], starts[-1])
    cycle = np.searchsorted(starts, frames, side="right")
    return predict(wheel.acceleration[frames], wheel.moment[frames], cycle % 2 == 0)


def of_each_cycle(wheel: Wheel) -> Prediction:
    """Predict the mean moment from push to push, by which the trunk's swing has come back."""
    starts = np.array([first for first, _ in wheel.pushes])
    acceleration = np.diff(wheel.rate[starts]) / np.diff(wheel.time[starts])
    moment = np.array([wheel.moment[a:b].mean() for a, b in itertools.pairwise(starts)])
    return predict(acceleration, moment, np.arange(len(moment)) % 2 == 0)


def directions(wheel: Wheel) -> dict[str, float]:
    """Return the mean force of the pushes by its direction [N].

    Along the rim it is what the wheel can show. The rest is undetermined.
    """
    pushing = np.concatenate([np.arange(a, b) for a, b in wheel.pushes])
    force = wheel.forces[pushing]
    along = wheel.moment[pushing] / RIM
    size = np.linalg.norm(force, axis=1)
    across = np.sqrt(np.maximum(0.0, (force[:, :2] ** 2).sum(axis=1) - along**2))
    return {
        "whole": float(size.mean()),
        "along the rim": float(along.mean()),
        "towards the axle": float(across.mean()),
        "along the axle": float(np.abs(force[:, 2]).mean()),
        "share": float(np.mean(along) / np.mean(size)),
    }


def hands_off(wheel: Wheel, told: Prediction) -> float:
    """Return the moment of that fit while no hand is at the rim, root mean square [N m].

    Those times are between the pushes.
    """
    free = np.concatenate([np.arange(a, b) for (_, a), (b, _) in itertools.pairwise(wheel.pushes)])
    return float(np.sqrt(np.mean((told.inertia * wheel.acceleration[free] + told.resistance) ** 2)))

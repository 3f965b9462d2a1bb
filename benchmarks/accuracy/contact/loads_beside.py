"""Loads that plates do not determine, by foot and frame, of simulated recordings.

A person puts a foot on a step that is no plate, leans a hand on a plate beside a foot, holds a
rail, or balances on one leg, at random heights, times and speeds. Frames that are found are held
against those in which the load of a foot is not known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.results import Row
from myomorph.core.contact.undetermined import undetermined_loads
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Wrenches

SEED = 860
PEOPLE = 40
RATE = 100.0
LASTS = 3.0
"""Of a recording [s]."""
UP = np.array([0.0, 1.0, 0.0])
FEET = ("calcn_r", "calcn_l")
NOISE = 0.002
"""Of markers on heels and balls [m]."""


@dataclass(frozen=True)
class Case:
    """What happens in a recording.

    Attributes
    ----------
    name : in the table
    raised : whether the left foot is put on something higher
    carries : share of the weight that plates lose meanwhile, from and to
    aside : by how much a center of pressure moves sideways meanwhile, from and to [m]
    foot : whose load is not known meanwhile, "" for nobody's
    """

    name: str
    raised: bool
    carries: tuple[float, float]
    aside: tuple[float, float] = (0.0, 0.0)
    foot: str = ""


CASES = (
    Case("foot on a step that is no plate", raised=True, carries=(0.3, 0.8), foot="calcn_l"),
    Case(
        "foot on a step, a tenth to a fifth on it", raised=True, carries=(0.1, 0.2), foot="calcn_l"
    ),
    Case("balance on one leg", raised=True, carries=(0.0, 0.0)),
    Case(
        "hand on the plate, center 15 to 25 cm beside",
        raised=False,
        carries=(0.0, 0.0),
        aside=(0.15, 0.25),
        foot="calcn_r",
    ),
    Case("hand on a rail, both feet on plates", raised=False, carries=(0.1, 0.4)),
    Case("standing on two plates", raised=False, carries=(0.0, 0.0)),
)


def measure(folder: Path) -> Iterator[Row]:
    """One row for each case."""
    random = np.random.default_rng(SEED)
    for case in CASES:
        counts = np.zeros(4)
        for _ in range(PEOPLE):
            counts += _person(case, random)
        unknown, found, known, falsely = counts
        yield {
            "recording": case.name,
            "recordings": PEOPLE,
            "frames not known": int(unknown),
            "of these found [%]": float(100.0 * found / unknown) if unknown else "",
            "known frames": int(known),
            "of these left out [%]": float(100.0 * falsely / known),
        }


@dataclass(frozen=True, eq=False)
class Recording:
    """One simulated recording.

    Attributes
    ----------
    wrenches : of both plates
    places : foot -> heel and ball (frames, 2, 3) [m]
    weight : of the body [N]
    during : (frames,) whether it happens
    """

    wrenches: Wrenches
    places: dict[str, Array]
    weight: float
    during: np.ndarray


def _person(case: Case, random: np.random.Generator) -> Array:
    """Count frames of both feet: not known, of these found, known, of these left out."""
    made = _recording(case, random)
    time = made.wrenches.time
    findings = undetermined_loads(made.wrenches, made.places, made.weight, UP)
    counts = np.zeros(4)
    for foot in FEET:
        left_out = np.zeros(len(time), bool)
        for finding in findings:
            for start, stop in finding.times if finding.place == foot else ():
                left_out |= (time >= start) & (time <= stop)
        unknown = made.during & (foot == case.foot)
        counts += [
            unknown.sum(),
            (unknown & left_out).sum(),
            (~unknown).sum(),
            (~unknown & left_out).sum(),
        ]
    return counts


def _recording(case: Case, random: np.random.Generator) -> Recording:
    """Simulate one recording of a case."""
    time = np.arange(0.0, LASTS, 1.0 / RATE)
    weight = random.uniform(500.0, 1000.0)
    begin = random.uniform(0.6, 1.0)
    end = begin + random.uniform(0.4, 1.2)
    moves = random.uniform(0.35, 0.6)
    # 0 on the floor, 1 while it happens.
    happens = _smooth((time - begin + moves) / moves) * _smooth((end + moves - time) / moves)
    during = (time >= begin) & (time <= end)
    places = _places(case, random, happens)
    lost = random.uniform(*case.carries) * during
    of_left = np.where(happens > 0.0, 0.0, 0.5) if case.raised else 0.5 * np.ones_like(time)
    shares = np.stack([1.0 - of_left - lost, of_left], axis=1)
    shares += random.normal(0.0, 0.01, shares.shape) * (shares > 0.0)
    points = np.stack([places[foot].mean(axis=1) * (1.0, 0.0, 1.0) for foot in FEET], axis=1)
    points[:, 0, 2] += random.uniform(*case.aside) * during
    wrenches = Wrenches(
        time=time,
        names=FEET,
        bodies=FEET,
        forces=weight * shares[:, :, None] * UP,
        points=points,
        torques=np.zeros_like(points),
    )
    return Recording(wrenches=wrenches, places=places, weight=weight, during=during)


def _places(case: Case, random: np.random.Generator, happens: Array) -> dict[str, Array]:
    """Heels and balls of both feet; `happens` (frames,) from 0 to 1."""
    height = random.uniform(0.15, 0.82)
    places = {}
    for foot, side in zip(FEET, (0.1, -0.1), strict=True):
        up = height * happens * (case.raised and foot == "calcn_l")
        heel = np.stack([0.3 * up, up, np.full_like(up, side)], axis=1)
        both = np.stack([heel, heel + [0.2, 0.0, 0.0]], axis=1)
        places[foot] = both + NOISE * _noise(random, both.shape)
    return places


def _smooth(share: Array) -> Array:
    """Rise from 0 to 1 without a jump of speed; `share` (frames,)."""
    inside = np.clip(share, 0.0, 1.0)
    return np.asarray(inside - np.sin(2.0 * np.pi * inside) / (2.0 * np.pi))


def _noise(random: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """White noise of unit size that a usual filter has smoothed (frames, ...)."""
    white = random.normal(size=shape)
    window = np.hanning(17)[:, None, None]
    window = window / window.sum()
    smooth = np.stack(
        [
            np.convolve(column, window[:, 0, 0], mode="same")
            for column in white.reshape(len(white), -1).T
        ],
        axis=1,
    ).reshape(shape)
    return np.asarray(smooth / smooth.std())

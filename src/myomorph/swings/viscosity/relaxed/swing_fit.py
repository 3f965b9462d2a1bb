"""A passive law fitted to the swings of a relaxed limb, as unknowns and residuals.

Unknown are the law's coefficients, the same in all drops, and the state in which each part (a
stretch of swings without a gap) begins. Residuals are the measured less the swung angles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Measured
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.relaxed.drops import Drop
from myomorph.swings.viscosity.trust.law import (
    PassiveLaw,
    bounded_least_squares,
    law_columns,
    resistances,
)

WIDTH = 0.02
"""Angular velocity within which friction turns its sign [rad/s]: nothing here is low-passed, which
would spread it.
"""
NEAR = 0.06  # Time either side of a turn over which its angle is fitted [s].
METHOD = Method(iterations=30, min_gain=1e-9)
STEP = 1e-6  # Of forward differences, in units of the value or of 1
MAX_HALF_SWINGS = 1000  # Of a drop, so that numbers of half swings are unique over the parts
LAW = "law"  # The block of the coefficients
COEFFICIENTS = 9  # Of a law of one axis
NEUTRAL_TORQUE = 2  # Place of the spring's torque at the angle 0, the only one that may be negative

LawOf = Callable[[Values], PassiveLaw]


@read_only
class SwingFit:
    """A law fitted to drops.

    Attributes
    ----------
    terms : of the law
    law : with its coefficients
    states : (parts, 2) in which the parts begin [rad], [rad/s]
    left : (frames,) measured less swung angles, 0 where nothing was measured [rad]
    slopes : (frames, coefficients + states) derivatives of `left`
    block : (frames,) which half swing each frame is of
    """

    terms: tuple[str, ...]
    law: PassiveLaw
    states: Array
    left: Array
    slopes: Array
    block: NDArray[np.intp]


@read_only
class Part:
    """A stretch of swings of one drop, as residuals of the law and of the state where it begins.

    Attributes
    ----------
    drop : whose equation of motion it follows
    frames : of the drop
    state : name of the block of its angle [rad] and rate [rad/s]
    blocks : of unknowns that it depends on
    law : the law by the values of all unknowns
    """

    drop: Drop
    frames: slice
    state: str
    blocks: tuple[str, ...]
    law: LawOf

    def left(self, values: Values) -> Array:
        """Compare the measured with the swung angles.

        Parameters
        ----------
        values : of the unknowns

        Returns
        -------
        (frames,) measured less swung, 0 where nothing was measured [rad]
        """
        angle, rate = values[self.state]
        frames = self.frames
        swung = self.drop.equation.swing(
            frames.start, frames.stop, float(angle), float(rate), self.law(values)
        )
        return np.nan_to_num(self.drop.measured[frames] - swung)

    def slopes(self, values: Values) -> Mapping[str, Array]:
        """Slopes of `left` by forward differences.

        Parameters
        ----------
        values : of the unknowns

        Returns
        -------
        (frames, unknowns of the block) by block
        """
        here = self.left(values)
        by_block = {}
        for block in self.blocks:
            columns = []
            for index in values.unknowns.index([block]):
                size = STEP * max(1.0, abs(float(values.x[index])))
                columns.append((self.left(values.nudged(int(index), size)) - here) / size)
            by_block[block] = np.column_stack(columns)
        return by_block

    @property
    def half_swings(self) -> NDArray[np.intp]:
        """(frames,) numbers of the half swings within the drop."""
        frames = np.arange(self.frames.start, self.frames.stop)
        return np.searchsorted(self.drop.turns, frames, side="right")


def fit_swings(
    drops: Sequence[Drop],
    terms: Sequence[str],
    start: SwingFit | None = None,
    law: PassiveLaw | None = None,
) -> SwingFit:
    """Fit a law, and the states in which parts begin, by least squares of the angles.

    Parameters
    ----------
    drops : with the half swings that are used
    terms : of the law
    start : a fit of the same parts to begin at; by default `guess`
    law : held as it is, so that only the states are sought

    Returns
    -------
    law, states and what they leave

    Raises
    ------
    BadData : no half swing is used
    """
    mapping = law_columns(terms, 1)[0] if law is None else np.zeros((COEFFICIENTS, 0))
    spans = [(drop, frames) for drop in drops for frames in drop.parts]
    if not spans:
        raise BadData(
            "no half swing is left to identify a limb from: record it anew, muscles relaxed,"
            " several drops"
        )
    if start is None:
        first = law or guess(drops, terms)
        states = np.array([state_at(drop, frames.start) for drop, frames in spans])
    else:
        first = start.law
        states = start.states
    shared = () if law is not None else (_law_block(terms, mapping, first),)
    law_of: LawOf = partial(_law, mapping) if law is None else lambda values: law
    state_blocks = [_state_block(number, state) for number, state in enumerate(states)]
    parts = [
        Part(
            drop=drop,
            frames=frames,
            state=block.name,
            blocks=(*(each.name for each in shared), block.name),
            law=law_of,
        )
        for (drop, frames), block in zip(spans, state_blocks, strict=True)
    ]
    residuals = tuple(
        Measured(name=part.state, blocks=part.blocks, function=part.left, slopes=part.slopes)
        for part in parts
    )
    unknowns = Unknowns((*shared, *state_blocks))
    solution = minimize(Problem(unknowns, residuals), method=METHOD)
    return _fit(terms, parts, Values(unknowns, solution.x))


def _law_block(terms: Sequence[str], mapping: Array, first: PassiveLaw) -> Block:
    """Coefficients of a law, which begin at those of another one.

    Parameters
    ----------
    mapping : (9, coefficients) see `law_columns`
    """
    low = np.where(mapping[NEUTRAL_TORQUE] == 1.0, -np.inf, 0.0)
    begin = np.maximum(np.linalg.pinv(mapping) @ first.coefficients, low)
    where = "passive law " + ", ".join(terms)
    pairs = zip(begin.tolist(), low.tolist(), strict=True)
    return Block(
        name=LAW,
        unknowns=tuple(
            Unknown(name=f"coefficient {number}", where=where, start=value, low=least)
            for number, (value, least) in enumerate(pairs)
        ),
    )


def _state_block(number: int, state: Array) -> Block:
    """Angle and rate (2,) in which a part begins."""
    name = f"start {number}"
    angle, rate = state.tolist()
    return Block(
        name=name,
        unknowns=(
            Unknown(name=f"{name}: angle", unit="rad", start=angle),
            Unknown(name=f"{name}: rate", unit="rad/s", start=rate),
        ),
    )


def _law(mapping: Array, values: Values) -> PassiveLaw:
    return PassiveLaw.of(mapping @ values[LAW], WIDTH)


def _fit(terms: Sequence[str], parts: Sequence[Part], values: Values) -> SwingFit:
    """Evaluate a law and the states that were found in all parts."""
    rows = []
    for part in parts:
        row = np.zeros((part.frames.stop - part.frames.start, len(values.x)))
        for block, slopes in part.slopes(values).items():
            row[:, values.unknowns.slices[block]] = slopes
        rows.append(row)
    return SwingFit(
        terms=tuple(terms),
        law=parts[0].law(values),
        states=np.array([values[part.state] for part in parts]),
        left=np.concatenate([part.left(values) for part in parts]),
        slopes=np.concatenate(rows),
        block=np.concatenate(
            [MAX_HALF_SWINGS * number + part.half_swings for number, part in enumerate(parts)]
        ),
    )


def guess(drops: Sequence[Drop], terms: Sequence[str]) -> PassiveLaw:
    """Fit a law to torques by inverse dynamics, from angles differentiated twice.

    Parameters
    ----------
    drops : with the half swings that are used
    terms : of the law

    Returns
    -------
    where the search begins
    """
    mapping, groups = law_columns(terms, 1)
    H = np.zeros((mapping.shape[1],) * 2)
    g = np.zeros(mapping.shape[1])
    for drop in drops:
        accelerations = np.gradient(drop.rates, drop.equation.time)
        torque = drop.equation.torque(drop.angles, drop.rates, accelerations)
        rows = resistances(
            drop.angles[:, None], drop.rates[:, None], np.zeros((len(torque), 0, 1)), WIDTH
        )
        for part in drop.parts:
            A = rows[part, 0] @ mapping
            H = H + A.T @ A
            g = g - A.T @ torque[part]
    return PassiveLaw.of(mapping @ bounded_least_squares(H, g, groups)[0], WIDTH)


def state_at(drop: Drop, frame: int) -> tuple[float, float]:
    """Angle and rate at a frame, by a parabola through its neighborhood [rad], [rad/s]."""
    time = drop.equation.time - drop.equation.time[frame]
    near = (np.abs(time) <= NEAR) & np.isfinite(drop.measured)
    if frame in drop.turns[:1]:
        near &= time >= 0.0
    if near.sum() < 4:
        return float(drop.angles[frame]), float(drop.rates[frame])
    _, rate, angle = np.polyfit(time[near], drop.measured[near], 2)
    return float(angle), float(rate)

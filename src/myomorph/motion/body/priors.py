"""What is held likely of lengths and marker places before any marker is seen, and which sides may differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Model
from myomorph.motion.body.shared_problem import Prior
from myomorph.motion.calibration import CalibrationOptions, Distances
from myomorph.motion.lengths import Length, mirrored_lengths

ASYMMETRIC_SD = 0.1
"""Of the difference of two sides that the data show to differ, as a share of the length."""

ASYMMETRIC_SHARE = 0.1
"""Of pairs of lengths that differ so: the odds at which the data must show it."""


@read_only
@dataclass(frozen=True, eq=False)
class SideDifference:
    """Lengths `first` of the right and `second` of the left side: their difference without any prior on sides [factor],
    and by how much a wide prior makes the data likelier, less the odds against it [natural logarithm].
    """

    first: int
    second: int
    difference: float
    sd: float
    gain: float
    differs: bool


def usual_shifts(model: Model, names: Sequence[str], distances: Distances) -> Array:
    """(markers,) how far each lies from its place on the model, as a standard deviation along one axis [m]."""
    return np.array([distances.fixed if model.marker(name).fixed else distances.marker for name in names])


def calibration_prior(
    lengths: Sequence[Length],
    shift_sd: Array,
    options: CalibrationOptions,
    size: float,
    differing: Sequence[tuple[int, int]] = (),
) -> Prior:
    """Rows of the prior over lengths, shifts (markers,) and overall size; those in `differing` are not held alike."""
    n, shifts = len(lengths), 3 * len(shift_sd)
    main = {length.segment: i for i, length in enumerate(lengths) if length.along}
    rows, right = [], []

    def add(entries: Mapping[int, float], value: float, sd: float) -> None:
        row = np.zeros(n + shifts + 1)
        for i, factor in entries.items():
            row[i] += factor / sd
        rows.append(row)
        right.append(value / sd)

    add({n + shifts: 1.0}, size, 0.5)
    for i, length in enumerate(lengths):
        if length.along:
            add({i: 1.0, n + shifts: -1.0}, 0.0, options.length_sd)
        else:
            add({i: 1.0, main[length.segment]: -1.0}, 0.0, options.shape_sd)
    for i in range(shifts):
        add({n + i: 1.0}, 0.0, float(shift_sd[i // 3]))
    for pair in mirrored_lengths(lengths):
        sd = ASYMMETRIC_SD if pair in differing else options.side_sd
        add({pair[0]: 1.0, pair[1]: -1.0}, 0.0, sd)
    return Prior(np.array(rows), np.array(right))


def side_differences(
    lengths: Sequence[Length],
    x: Array,
    H: Array,
    prior: Prior,
    options: CalibrationOptions,
) -> tuple[SideDifference, ...]:
    """Pairs of lengths from joint to joint whose sides differ more than `side_sd` explains.

    Of two Gaussian priors, narrow (`side_sd`) and wide (`ASYMMETRIC_SD`), the one is taken that makes the data
    likelier, at odds of `ASYMMETRIC_SHARE`; pair after pair, the most telling first. The evidence is that of the
    differences without a prior on sides, about the minimum x, with the information H of the data alone [1/variance].
    """
    pairs = mirrored_lengths(lengths)
    along = [pair for pair, (i, j) in enumerate(pairs) if lengths[i].along and lengths[i].between_joints]
    if not along:
        return ()
    sides = len(prior.rows) - len(pairs) + np.array(along)
    rest = np.setdiff1d(np.arange(len(prior.rows)), sides)
    rows = prior.rows[rest]
    information = H + rows.T @ rows
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    covariance = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    # At the minimum the data and the rest pull against the rows of sides: without these it lies one step away.
    pull = prior.rows[sides].T @ (prior.rows[sides] @ x - prior.right[sides])
    freed = x + covariance @ pull
    D = np.zeros((len(along), len(x)))
    for row, pair in enumerate(along):
        D[row, pairs[pair][0]], D[row, pairs[pair][1]] = 1.0, -1.0
    seen, spread = D @ freed, D @ covariance @ D.T
    sd = np.full(len(along), options.side_sd)
    gains = np.full(len(along), -np.inf)
    wide_sd = max(ASYMMETRIC_SD, options.side_sd)
    for _ in along:
        # Where one length differs, others of the same limb are as likely to.
        share = 0.5 if (sd >= wide_sd).any() else ASYMMETRIC_SHARE
        odds = float(np.log(share / (1.0 - share)))
        now = _log_evidence(seen, spread, sd)
        for difference in map(int, np.flatnonzero(sd < wide_sd)):
            wide = sd.copy()
            wide[difference] = wide_sd
            gains[difference] = _log_evidence(seen, spread, wide) - now + odds
        best = int(np.argmax(np.where(sd < wide_sd, gains, -np.inf)))
        if sd[best] >= wide_sd or gains[best] <= 0.0:
            break
        sd[best] = wide_sd
    return tuple(
        SideDifference(*pairs[pair], float(seen[row]), float(np.sqrt(spread[row, row])), float(gains[row]),
                       bool(sd[row] > options.side_sd))
        for row, pair in enumerate(along)
    )  # fmt: skip


def _log_evidence(seen: Array, spread: Array, sd: Array) -> float:
    """Of differences (pairs,) with covariance `spread`, where they vary by `sd`; a constant left out."""
    total = spread + np.diag(sd**2)
    return -0.5 * float(np.linalg.slogdet(total)[1] + seen @ np.linalg.solve(total, seen))

"""Which frames of a trial show a limb that swings freely, and where one swing ends and the next begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter1d

from myomorph.model.arrays import Array

REACH = 2.0
"""How far ends, gaps and hands reach through the filter, times 1 / cutoff: what is left of the ends there changes the
viscosity of virtual limbs without noise by 0.02 %, with 1.5 by 0.08 % and with 0.75 by 0.3 %."""

WINDOW = 0.1
"""Time over which a mismatch is averaged before it counts as a hand on the limb [s]."""

OUTLYING = 6.0
"""Standard deviations of the usual mismatch, from which it may be a hand."""

ROUNDS = 12
SAMPLES = 3000
"""Frames of a trial that take part in the robust fit, at most."""


def near(flags: np.ndarray, time: Array, distance: float) -> np.ndarray:
    """(frames,) whether a flagged frame lies within a distance in time [s]."""
    frames = round(distance / float(np.median(np.diff(time)))) if len(time) > 1 else 0
    found: np.ndarray = binary_dilation(flags, iterations=frames) if frames > 0 else flags.copy()
    return found


def whole_frames(time: Array, finite: np.ndarray, cutoff: float | None) -> np.ndarray:
    """(frames,) finite frames out of the reach of ends and gaps through the filter."""
    lacking = np.concatenate([[True], ~finite, [True]])
    if cutoff is None or len(time) < 2:
        return ~lacking[1:-1]
    step = float(np.median(np.diff(time)))
    wide = np.concatenate([[time[0] - step], time, [time[-1] + step]])
    whole: np.ndarray = ~near(lacking, wide, REACH / cutoff)[1:-1]
    return whole


def touched_frames(
    rows: Sequence[Array],
    wrenches: Sequence[Array],
    times: Sequence[Array],
    candidates: Sequence[np.ndarray],
    share: float,
    reach: float,
) -> list[np.ndarray]:
    """Per trial, (frames,) where something besides the joint carries the limb.

    While nobody touches the limb, force = rows phi + constant with one phi over all trials. A robust fit finds
    phi from the frames that agree, which must be the most; frames whose mismatch, averaged over `WINDOW`,
    passes both `OUTLYING` of its usual size and a share of what the swing's force varies are touched. Moments
    tell nothing: a joint carries hardly any, whether the limb is held or not.

    Parameters
    ----------
    rows, wrenches : (frames, 6, 10) and (frames, 6) of each trial, filtered alike
    candidates : (frames,) frames that may count
    share : mismatch below which nothing is called a touch, as part of the swing's largest change of force
    reach : how far a touch spoils its neighbours [s]
    """
    mismatch, largest = force_mismatch([Y[:, 3:, :4] for Y in rows], [wrench[:, 3:] for wrench in wrenches], candidates)
    found = []
    for one, time, use in zip(mismatch, times, candidates, strict=True):
        error = np.where(use[:, None], one, 0.0)
        frames = max(1, round(WINDOW / float(np.median(np.diff(time))))) if len(time) > 1 else 1
        count = np.maximum(uniform_filter1d(use.astype(float), frames), 1.0 / frames)
        size = np.linalg.norm(uniform_filter1d(error, frames, axis=0) / count[:, None], axis=1)
        usual = float(np.median(size[use])) if use.any() else 0.0
        found.append(near(use & (size > max(OUTLYING * usual, share * largest)), time, reach))
    return found


def force_mismatch(
    rows: Sequence[Array], forces: Sequence[Array], candidates: Sequence[np.ndarray]
) -> tuple[list[Array], float]:
    """Measured less predicted force (frames, 3) of each trial, and how far the predicted one moves from its mean [N].

    Least absolute errors first, then weights that forget what is far off.

    Parameters
    ----------
    rows : (frames, 3, 4) force of unit mass and first moments
    """
    trials = len(rows)
    chosen = [np.flatnonzero(use)[:: max(1, int(use.sum()) // SAMPLES)] for use in candidates]
    tables = []
    for k, (Y, frames) in enumerate(zip(rows, chosen, strict=True)):
        constant = np.zeros((len(frames), 3, 3 * trials))
        constant[:, np.arange(3), 3 * k + np.arange(3)] = 1.0
        tables.append(np.concatenate([Y[frames], constant], axis=2))
    A = np.concatenate(tables)
    b = np.concatenate([force[frames] for force, frames in zip(forces, chosen, strict=True)])
    trust = np.ones(len(A))
    for turn in range(2 * ROUNDS):
        root = np.sqrt(trust)[:, None]
        x = np.linalg.lstsq((A * root[..., None]).reshape(-1, A.shape[2]), (b * root).ravel(), rcond=1e-9)[0]
        far = np.linalg.norm(b - A @ x, axis=1)
        scale = max(float(np.median(far)), 1e-9 * float(np.abs(b).max(initial=1e-9)))
        trust = 1.0 / np.maximum(far, scale) if turn < ROUNDS else 1.0 / np.square(1.0 + np.square(far / (3.0 * scale)))
    wanted = [Y @ x[:4] + x[4 + 3 * k : 7 + 3 * k] for k, Y in enumerate(rows)]
    moving = [
        np.linalg.norm(one[use] - one[use].mean(axis=0), axis=1)
        for one, use in zip(wanted, candidates, strict=True)
        if use.any()
    ]
    largest = float(np.quantile(np.concatenate(moving), 0.98)) if moving else 0.0
    return [force - one for force, one in zip(forces, wanted, strict=True)], largest


def swing_numbers(angle: Array, rate: Array, free: np.ndarray, least: float) -> np.ndarray:
    """(frames,) number of the swing, -1 where the limb is not free.

    In every unbroken run of free frames a swing lasts from one turn to the next but one; the first begins with
    the release. A turn counts if the limb has come `least` [rad] away from the turn before. What follows the
    last turn is cut into pieces as long as the swings before.

    Parameters
    ----------
    angle, rate : (frames,) along the dominant rotation [rad], [rad/s]
    """
    numbers = np.full(len(angle), -1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    following = 0
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        turns = _turns(angle[start:stop], rate[start:stop], least)
        starts = [0, *turns[1::2]] if turns else [0]
        usual = int(np.median(np.diff(turns))) * 2 if len(turns) > 1 else 0
        if usual:
            while stop - start - starts[-1] > 1.75 * usual:
                starts.append(starts[-1] + usual)
            if len(starts) > 1 and stop - start - starts[-1] < usual // 2:
                starts.pop()
        numbers[start:stop] = following + np.searchsorted(starts, np.arange(stop - start), side="right") - 1
        following += len(starts)
    return numbers


def _turns(angle: Array, rate: Array, least: float) -> list[int]:
    """Frames at which the limb turns back, with more than `least` between one turn and the next."""
    turns: list[int] = []
    last = angle[0]
    for frame in np.flatnonzero(np.diff(np.signbit(rate))) + 1:
        if abs(angle[frame] - last) > least:
            turns.append(int(frame))
            last = angle[frame]
    return turns

"""What a fit explains of recordings that it was not made from, and groups whose generic values do so better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.tension.personal.curves import MuscleShapes
from myomorph.tension.personal.fit import Fitted, check, fit
from myomorph.tension.personal.prior import Prior
from myomorph.tension.personal.recordings import Windows

BETTER = 0.005  # Of the score per frame: by so much generic values must be better to be kept, or rounding would choose
SHARE = 2.0 / 3.0  # Of a single recording that muscles are fitted to; the rest is held out


@read_only
class HeldOut:
    """Recordings that were not fitted to.

    Attributes
    ----------
    recordings : their names
    frames : of them
    score_generic, score : negative logarithm of the probability per frame, of the generic and of the person's muscles
    left_generic, left : (rows,) torque left root mean square [N m or N]
    kept : groups that keep their generic values, because those explain the held-out frames better
    """

    recordings: tuple[str, ...]
    frames: int
    score_generic: float
    score: float
    left_generic: Array
    left: Array
    kept: tuple[str, ...]


def split(windows: Sequence[Windows]) -> tuple[list[Windows], list[Windows]]:
    """Recordings to fit to, passive ones among them, and to hold out: the last one, or the last third of one alone."""
    moving = [window for window in windows if np.isfinite(window.step)]
    rest = [window for window in windows if not np.isfinite(window.step)]
    if not moving:
        return (rest[:-1], rest[-1:]) if len(rest) > 1 else (rest, [])
    if len(moving) > 1:
        return [*moving[:-1], *rest], [moving[-1]]
    one = moving[0]
    times = one.time[one.counted]
    end = float(np.quantile(times, SHARE))
    first = replace(one, counted=one.counted & (one.time <= end))
    last = replace(one, name=f"{one.name} from {end:.2f} s", counted=one.counted & (one.time > end))
    if first.counted.sum() < 20 or last.counted.sum() < 10:
        return list(windows), []
    return [first, *rest], [last]


def held_out(
    prior: Prior,
    shapes: MuscleShapes,
    fitted_to: Sequence[Windows],
    unseen: Sequence[Windows],
    floors: Array,
    fitted: Fitted,
    keep: bool = True,
) -> tuple[HeldOut, Array]:
    """Compare generic and fitted muscles on unseen recordings; returns also the parameters, generic where better.
    `keep`: whether generic values are kept where they are better; else it is only said.
    """
    gains = np.zeros(len(fitted.p), bool)
    gains[prior.parts[4]] = True
    # The generic muscles get gains of EMG and errors of torques of their own, so that muscles alone are compared.
    # Stopped early: gains that settle on one stride of the knee's man leave more torque of the next (15 N m, not 10),
    # and with both settled that was no longer reported.
    generic = fit(prior, shapes, fitted_to, floors, gains, steps=8) if gains.any() else None
    plain = np.zeros(len(fitted.p)) if generic is None else generic.p
    noise = fitted.noise
    first = check(prior, shapes, unseen, plain, noise)
    result = check(prior, shapes, unseen, fitted.p, noise)
    best, kept = result, []
    p = fitted.p.copy()
    for g, name in enumerate(prior.groups):
        tried = generic_group(prior, p, g)
        if np.allclose(tried, p, atol=0.01):
            continue
        other = check(prior, shapes, unseen, tried, noise)
        if other.score < best.score - BETTER * max(abs(best.score), 1.0):
            p, best = tried, other
            kept.append(name)
    if best.score > first.score and keep:
        everything = fitted.p.copy()
        everything[: prior.parts[4].start] = 0.0
        p, best, kept = np.where(gains, plain, everything), first, list(prior.groups)
    if not keep:
        p, best = fitted.p, result
    frames = sum(int(recording.counted.sum()) for recording in unseen)
    names = tuple(recording.name for recording in unseen)
    return HeldOut(names, frames, first.score, best.score, first.left, best.left, tuple(kept)), p


def generic_group(prior: Prior, p: Array, g: int) -> Array:
    """Parameters with those of one group of muscles at the prior."""
    p = p.copy()
    members = np.flatnonzero(prior.group == g)
    fiber, point, force, strain, _ = prior.parts
    for part in (fiber, point):
        p[part.start + members] = 0.0
    p[force.start + g] = p[strain.start + g] = 0.0
    return p

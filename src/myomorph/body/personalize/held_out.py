"""Recordings that were not fitted to: whether the person's muscles explain them better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.body.personalize.fit import Fitted, fit
from myomorph.body.personalize.muscle_problem import MuscleProblem
from myomorph.body.personalize.prior import Prior
from myomorph.body.personalize.recorded import Recorded
from myomorph.body.personalize.recording_at import Noise, RecordingAt, recording_at
from myomorph.body.personalize.recordings import Windows
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array, read_only

BETTER = 0.005
"""Of the score per frame: by so much generic values must be better to be kept, or rounding would
choose.
"""
SHARE = 2.0 / 3.0  # Of a single recording that muscles are fitted to; the rest is held out
MIN_SEEN = 20
MIN_UNSEEN = 10  # Frames of a single recording that are fitted to, and held out
PASSES = 6  # In which activations find their means
GENERIC_STEPS = 8
"""Steps of the generic muscles' gains. Stopped early: gains that settle on one stride of the knee's
man leave more torque of the next (15 N m, not 10), and with both settled that was no longer
reported.
"""


class Split(NamedTuple):
    """Recordings to fit to, and recordings that are held out."""

    seen: tuple[Windows, ...]
    unseen: tuple[Windows, ...]


def split(windows: Sequence[Windows]) -> Split:
    """Split recordings into those to fit to and those to hold out.

    Held out is the last one in motion, or the last third of one alone; of passive ones alone the
    last. Nothing is held out where too few frames would be left.

    Parameters
    ----------
    windows : recordings

    Returns
    -------
    to fit to, passive ones among them, and held out
    """
    moving = [window for window in windows if not window.at_rest]
    rest = [window for window in windows if window.at_rest]
    if not moving:
        last = len(rest) - 1 if len(rest) > 1 else len(rest)
        return Split(seen=tuple(rest[:last]), unseen=tuple(rest[last:]))
    if len(moving) > 1:
        return Split(seen=(*moving[:-1], *rest), unseen=(moving[-1],))
    one = moving[0]
    end = float(np.quantile(one.time[one.counted], SHARE))
    first = replace(one, counted=one.counted & (one.time <= end))
    last_part = replace(
        one, name=f"{one.name} from {end:.2f} s", counted=one.counted & (one.time > end)
    )
    if first.counted.sum() < MIN_SEEN or last_part.counted.sum() < MIN_UNSEEN:
        return Split(seen=tuple(windows), unseen=())
    return Split(seen=(first, *rest), unseen=(last_part,))


@read_only
class Checked:
    """Quality with which muscles explain recordings.

    Attributes
    ----------
    score : negative logarithm of the marginal probability, per frame
    left : (rows,) root mean square of the torque that activations within what is known of them
        leave, NaN where none was measured [N m or N]
    misfits : (recordings,) root mean square of that torque over its error, over all coordinates
    """

    score: float
    left: Array
    misfits: Array


def check(problem: MuscleProblem, p: Array, noise: Noise) -> Checked:
    """Score how well parameters explain recordings that they need not have been fitted to.

    Parameters
    ----------
    problem : muscles and the recordings
    p : (parameters,)
    noise : errors of torques and EMG

    Returns
    -------
    score per frame, and torques left
    """
    score = 0.0
    frames = 0
    squares = np.zeros(len(noise.torque))
    counts = np.zeros(len(noise.torque))
    misfits = []
    for recorded in problem.recordings:
        part, lowest = _explained(problem, recorded, p, noise)
        score += lowest
        frames += len(recorded.torques)
        left = part.torques.left**2
        squares += np.sum(left, axis=0)
        counts += np.sum(recorded.known, axis=0)
        in_errors = np.where(recorded.known, left / part.torques.variance, 0.0)
        misfits.append(np.sqrt(in_errors.sum() / recorded.known.sum()))
    left_rms = np.sqrt(squares / np.maximum(counts, 1))
    return Checked(
        score=score / frames,
        left=np.where(counts > 0, left_rms, np.nan),
        misfits=np.array(misfits),
    )


def _explained(
    problem: MuscleProblem, recorded: Recorded, p: Array, noise: Noise
) -> tuple[RecordingAt, float]:
    """Let activations find their means.

    Parameters
    ----------
    p : (parameters,)

    Returns
    -------
    the recording at the last pass, and the lowest score of the last passes
    """
    activations = recorded.first_activations()
    scores = []
    for _ in range(PASSES + 1):
        part = recording_at(problem.muscles, recorded, p, activations, noise)
        scores.append(part.score())
        activations = part.settled(np.zeros(0))
    # Activations that change their bounds at once can spoil a single pass.
    return part, min(scores[PASSES // 2 :])


@read_only
class HeldOut:
    """Recordings that were not fitted to.

    Attributes
    ----------
    recordings : their names
    frames : of them
    score_generic, score : negative logarithm of the probability per frame, of the generic and of
        the person's muscles
    left_generic, left : (rows,) torque left root mean square [N m or N]
    kept : groups that keep their generic values, because those explain the held-out frames better
    verdict : torque left by the person's and by generic muscles, in standard deviations of its
        error
    """

    recordings: tuple[str, ...]
    frames: int
    score_generic: float
    score: float
    left_generic: Array
    left: Array
    kept: tuple[str, ...]
    verdict: Verdict


class Chosen(NamedTuple):
    """What was chosen on recordings that were held out.

    Attributes
    ----------
    p : (parameters,)
    checked : how they explain the recordings
    kept : groups that keep, or that would better keep, their generic values
    """

    p: Array
    checked: Checked
    kept: tuple[str, ...]


def held_out(
    problem: MuscleProblem, unseen: Sequence[Windows], fitted: Fitted, keep: bool = True
) -> tuple[HeldOut, Array]:
    """Compare generic and fitted muscles on unseen recordings.

    Parameters
    ----------
    problem : muscles and the recordings of the fit
    unseen : recordings that were held out
    fitted : result of the fit
    keep : whether generic values are kept where they are better; else it is only reported

    Returns
    -------
    the comparison, and (parameters,) generic where better
    """
    tested = problem.of(unseen)
    noise = fitted.noise
    plain = _generic(problem)
    generic = check(tested, plain, noise)
    chosen = _without_worse_groups(tested, fitted.p, noise)
    if chosen.checked.score > generic.score and keep:
        chosen = Chosen(
            p=_with_gains(problem.prior, fitted.p, plain),
            checked=generic,
            kept=problem.prior.groups,
        )
    if not keep:
        checked = check(tested, fitted.p, noise)
        chosen = Chosen(p=fitted.p, checked=checked, kept=chosen.kept)
    return _report(unseen, generic, chosen), chosen.p


def _generic(problem: MuscleProblem) -> Array:
    """Give the generic muscles gains of EMG of their own, so that muscles alone are compared.

    Returns
    -------
    (parameters,) 0 but for the gains
    """
    prior = problem.prior
    if not len(prior.deviation[prior.parts.gains]):
        return np.zeros(len(prior.deviation))
    return fit(problem, ("gains",), steps=GENERIC_STEPS).p


def _with_gains(prior: Prior, fitted: Array, plain: Array) -> Array:
    """Take generic muscles with the gains of the generic fit (parameters,)."""
    p = np.zeros(len(fitted))
    p[prior.parts.gains] = plain[prior.parts.gains]
    return p


def _without_worse_groups(tested: MuscleProblem, p: Array, noise: Noise) -> Chosen:
    """Give groups of muscles their generic values where these explain the recordings better.

    Parameters
    ----------
    tested : muscles and recordings that were held out
    p : (parameters,) that were fitted
    noise : errors of torques and EMG
    """
    best = check(tested, p, noise)
    kept = []
    for g, name in enumerate(tested.prior.groups):
        tried = generic_group(tested.prior, p, g)
        if np.allclose(tried, p, atol=0.01):
            continue
        other = check(tested, tried, noise)
        if other.score < best.score - BETTER * max(abs(best.score), 1.0):
            p = tried
            best = other
            kept.append(name)
    return Chosen(p=p, checked=best, kept=tuple(kept))


def _report(unseen: Sequence[Windows], generic: Checked, chosen: Chosen) -> HeldOut:
    """Put numbers of generic and chosen muscles side by side."""
    frames = np.array([int(window.counted.sum()) for window in unseen], np.float64)
    names = tuple(window.name for window in unseen)
    verdict = Verdict(
        kinds=(("torque left", "SD"),),
        parts=names,
        estimate=chosen.checked.misfits[:, None],
        generic=generic.misfits[:, None],
        weights=frames,
        what=", ".join(names),
    )
    return HeldOut(
        recordings=names,
        frames=int(frames.sum()),
        score_generic=generic.score,
        score=chosen.checked.score,
        left_generic=generic.left,
        left=chosen.checked.left,
        kept=chosen.kept,
        verdict=verdict,
    )


def generic_group(prior: Prior, p: Array, g: int) -> Array:
    """Set the parameters of one group of muscles to the prior's mean.

    Parameters
    ----------
    prior : with the groups
    p : (parameters,)
    g : number of the group

    Returns
    -------
    (parameters,)
    """
    p = p.copy()
    parts = prior.parts
    members = np.flatnonzero(prior.group == g)
    p[parts.fibers.start + members] = 0.0
    p[parts.points.start + members] = 0.0
    p[parts.strength.start + g] = 0.0
    p[parts.passive.start + g] = 0.0
    return p

"""Muscles from recordings: torques that must be borne, and activations as EMG shows them.

    tau = R^T F(p, a) + e_tau,   a = g e + e_a   (or a = l + e_a where no EMG is),   p = prior + e_p

Of every frame the activations are marginalized to first order: with G = R^T dF/da the misfit r has
the covariance S = var(e_tau) + G var(a) G^T, so that least effort weighs no more than what is known
of activations says. Gauss-Newton steps in p use S^-1; activations follow as their mean given p,
within 0 and 1. Errors of neighboring frames are alike: frames count by 1 / (1 + 2 sum rho_k), rho_k
the correlation of the whitened misfit over k frames. Errors of torques and activations are
estimated beside p from the squared misfits (Rasmussen and Williams 2006 for the marginal).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from myomorph.body.personalize.fibers import MuscleShapes, rigid_lengths
from myomorph.body.personalize.fit_part import Noise, Part, frame_products
from myomorph.body.personalize.prior import OUTSIDE, PHYSIOLOGICAL, Prior
from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.arrays import Array, read_only

REST_ERROR = 0.01
REST_FLOOR = 0.1
"""Least standard deviation of a measured passive torque: a share of its root mean square, and in N
m or N.
"""
SCALES = (0.1, 9.0)  # Within which the variances of activations are adjusted to the misfits
HASTE = 2.0
CHANGES = (0.6, 1.25)
"""Power of the steps by which errors change, and the least and largest factor of a step."""
MAX_ERROR = 0.5  # Of the root mean square of a torque: more of it is not taken for an error


def noise_of(parts: Sequence[Part], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Estimate errors of torques and of EMG as their means given the misfits.

    A step of expectation and maximization.

    Parameters
    ----------
    parts : linearized recordings; those at rest are left out
    noise : before
    floors : (rows,) least standard deviation of the torques [N m or N]
    covariance : (parameters, parameters) after the recordings

    Returns
    -------
    noise with other errors of torques and EMG; those at rest stay
    """
    moving = [part for part in parts if not part.rest]
    if not moving:
        return noise
    squares = np.zeros(len(noise.torque))
    carried = np.zeros(len(noise.torque))
    frames = 0
    apart = 0.0
    known = 0.0
    for part in moving:
        among, mean_squares = torque_errors(part, covariance)
        squares += mean_squares
        carried += np.sum(part.torques**2, axis=0)
        frames += len(part.error)
        free = part.measured[part.windows.counted] & (part.variance > 0.0)
        moved = frame_products(part.gain.transpose(0, 2, 1), part.error)
        after = part.variance - part.variance * np.einsum("frm,frm->fm", part.gain, part.columns)
        after = after + np.einsum("frm,frm->fm", part.gain, among @ part.gain)
        own = np.where(free, part.variance, 1.0) / noise.emg
        apart += float(np.sum(np.where(free, (moved**2 + after) / own, 0.0)))
        known += float(free.sum())
    most = np.maximum(MAX_ERROR**2 * carried / frames, floors**2)
    torque = np.sqrt(np.clip(squares / frames, floors**2, most))
    emg = float(np.clip(apart / known, *SCALES)) if known else 1.0
    return replace(noise, torque=torque, emg=emg)


def hastened(old: Noise, new: Noise, floors: Array, floors_at_rest: Array) -> Noise:
    """Lengthen a step of expectation and maximization.

    Its own steps are short where much of a misfit is errors'. Upwards it is a short one: a misfit
    that the parameters have yet to follow is no error.

    Parameters
    ----------
    old, new : noise before and after the step
    floors, floors_at_rest : (rows,) least standard deviations of torques [N m or N]

    Returns
    -------
    noise
    """
    torque = old.torque * np.clip((new.torque / old.torque) ** HASTE, *CHANGES)
    rest = old.rest * np.clip((new.rest / old.rest) ** HASTE, *CHANGES)
    emg = old.emg * np.clip((new.emg / old.emg) ** HASTE, *CHANGES)
    return Noise(
        np.maximum(torque, floors), np.maximum(rest, floors_at_rest), float(np.clip(emg, *SCALES))
    )


def torque_errors(part: Part, covariance: Array) -> tuple[Array, Array]:
    """Compute what parameters leave open of torques, and squared errors of the torques.

    Parameters
    ----------
    part : a linearized recording
    covariance : (parameters, parameters) after the recordings

    Returns
    -------
    (frames, rows, rows) covariance of each frame's torques from the parameters [(N m)^2 or N^2],
        and (rows,) summed squares of errors
    """
    solved = np.asarray(np.linalg.inv(part.covariance), dtype=np.float64)
    # What the parameters leave open is no part of the errors, but of what is known of them.
    among = part.slopes @ covariance @ part.slopes.transpose(0, 2, 1)
    by_torque = part.of_torque[..., None] * solved
    mean = frame_products(by_torque, part.error)
    left = part.of_torque - part.of_torque * np.einsum("frr->fr", by_torque)
    left += np.einsum("frs,fst,frt->fr", by_torque, among, by_torque)
    return among, np.sum(np.where(part.known, mean**2 + left, 0.0), axis=0)


def floors_of_rest(parts: Sequence[Part], floors: Array) -> Array:
    """Compute the least error of measured passive torques.

    Parameters
    ----------
    parts : recordings
    floors : (rows,) least errors of torques in motion [N m or N]

    Returns
    -------
    (rows,) [N m or N]
    """
    still = [part for part in parts if part.rest]
    if not still:
        return np.full(len(floors), REST_FLOOR)
    counts = np.maximum(np.sum([recording.known.sum(axis=0) for recording in still], axis=0), 1)
    squares = np.sum([np.sum(recording.torques**2, axis=0) for recording in still], axis=0)
    return np.maximum(np.minimum(REST_FLOOR, floors), REST_ERROR * np.sqrt(squares / counts))


def noise_at_rest(parts: Sequence[Part], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Estimate errors of measured passive torques.

    Among them is what is no muscle's: ligaments, capsules, the poses' errors.

    Parameters
    ----------
    parts : linearized recordings; those in motion are left out
    noise : before
    floors : (rows,) least errors at rest [N m or N]
    covariance : (parameters, parameters) after the recordings

    Returns
    -------
    noise with other errors at rest
    """
    still = [part for part in parts if part.rest]
    if not still:
        return noise
    counts = np.sum([recording.known.sum(axis=0) for recording in still], axis=0)
    squares = np.sum([torque_errors(recording, covariance)[1] for recording in still], axis=0)
    rest = np.sqrt(squares / np.maximum(counts, 1))
    return replace(noise, rest=np.where(counts > 0, np.maximum(rest, floors), floors))


STEPS = 40
TRUSTING = (4, 16)
"""First steps, in which errors are what was assumed of them: at least and, while steps are still
long, at most.
"""
FIRST_ERRORS = 5.0
"""Of the least errors of torques: with which the fit begins, so that it does not run after each of
them at first.
"""
INFORMATION = 0.85
"""Share of what the misfits show that counts, as the marginal is one of first order; chosen on
simulated people.
"""
LONGEST = 1.0  # Step of a parameter, in standard deviations before the recordings
STIFFNESS = (0.5, 64.0)
"""Added to the curvature of a parameter whose steps go back and forth, in shares of it: first and
at most.
"""
SETTLED = 0.02  # Steps end where no parameter moves by more of its standard deviation


@read_only
class Fitted:
    """Parameters, how sure they are, and what became of the recordings.

    Attributes
    ----------
    p : (parameters,) see `Prior`
    covariance : (parameters, parameters) after the recordings
    noise : errors of torques and activations that the misfits show
    activations : of each recording, (windows, frames, muscles)
    weights : of each recording: what a frame counts
    steps : number of steps done
    moved : largest change of a parameter in the last step, in its standard deviations
    """

    p: Array
    covariance: Array
    noise: Noise
    activations: tuple[Array, ...]
    weights: tuple[float, ...]
    steps: int
    moved: float


def fit(
    prior: Prior,
    shapes: MuscleShapes,
    windows: Sequence[Windows],
    floors: Array,
    free: np.ndarray | None = None,
    advance: Callable[[int], None] | None = None,
    steps: int = STEPS,
) -> Fitted:
    """Find the most probable parameters given the recordings.

    The model and its marginal are at the head of this file.

    Parameters
    ----------
    prior : of the parameters
    shapes : curves of the muscles
    windows : recordings
    floors : (rows,) least standard deviation of the torques [N m or N]
    free : (parameters,) which ones are estimated; None for all that have a prior spread
    advance : called with the number of steps just done
    steps : at most

    Returns
    -------
    parameters with covariance, errors and activations
    """
    free = (prior.deviation > 0.0) if free is None else free & (prior.deviation > 0.0)
    parts = [Part(prior, shapes, window) for window in windows]
    floors_at_rest = floors_of_rest(parts, floors)
    p = np.zeros(len(prior.deviation))
    noise = Noise(FIRST_ERRORS * floors, FIRST_ERRORS * floors_at_rest)
    covariance = np.asarray(np.linalg.inv(prior.precision), dtype=np.float64)
    moved = np.inf
    done = 0
    shrink = INFORMATION
    trusting = True
    stiff = np.zeros(len(p))
    settled = 0
    before = np.zeros(len(p))
    for done in range(1, steps + 1):
        normal = prior.precision.copy()
        right = -prior.precision @ p
        for part in parts:
            part.linearize(p, noise, widening=done <= 4 or done % 3 == 0)
            weight = shrink * part.weight
            normal += weight * part.jacobian.T @ part.jacobian
            right += weight * (part.jacobian.T @ part.misfit - part.widening)
        rows, misfit = _outside(prior, shapes, windows, p)
        known = normal.copy()
        normal += rows.T @ rows
        right += rows.T @ misfit
        covariance = np.zeros_like(normal)
        covariance[np.ix_(free, free)] = np.linalg.inv(normal[np.ix_(free, free)])
        step = np.zeros(len(p))
        step[free] = np.linalg.solve(
            (normal + np.diag(stiff * np.diag(normal)))[np.ix_(free, free)], right[free]
        )
        longest = float((np.abs(step) / np.maximum(prior.deviation, 1e-12))[free].max(initial=0.0))
        step *= min(1.0, LONGEST / max(longest, 1e-12))
        new = prior.kept(p + step)
        step = new - p
        p = new
        # Activations that reach a bound and leave it in turns, and muscles their physiological
        # lengths, make steps go back and forth. Held are the parameters that do, as all would be
        # slow for the sake of two.
        stiff = np.where(step * before < 0.0, np.clip(2.0 * stiff, *STIFFNESS), 0.7 * stiff)
        before = step
        for part in parts:
            part.settle(step)
        # Before the parameters have found their places, misfits are theirs and not errors of the
        # recordings.
        trusting = trusting and (done < TRUSTING[0] or (longest > LONGEST and done < TRUSTING[1]))
        if not trusting:
            better = noise_at_rest(
                parts, noise_of(parts, noise, floors, covariance), floors_at_rest, covariance
            )
            noise = hastened(noise, better, floors, floors_at_rest)
            for part in parts:
                part.weigh()
            shrink = _left_to_errors(
                parts, float(np.sum(free) - np.trace(covariance @ prior.precision))
            )
        spread = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        moved = float((np.abs(step) / spread)[free].max(initial=0.0))
        if advance is not None:
            advance(1)
        settled = 0 if trusting or moved >= SETTLED else settled + 1
        if settled == 3:
            break
    # How far fibers work is an assumption: it moves what recordings leave open, but they say no
    # more for it.
    covariance[np.ix_(free, free)] = np.linalg.inv(known[np.ix_(free, free)])
    return Fitted(
        p=p,
        covariance=covariance,
        noise=noise,
        activations=tuple(part.activations for part in parts),
        weights=tuple(shrink * part.weight for part in parts),
        steps=done,
        moved=moved,
    )


@read_only
class Checked:
    """Quality with which muscles explain recordings.

    Attributes
    ----------
    score : negative logarithm of the marginal probability, per frame
    left : (rows,) root mean square of the torque that activations within what is known of them
        leave, NaN where none was measured [N m or N]
    """

    score: float
    left: Array


def check(
    prior: Prior, shapes: MuscleShapes, windows: Sequence[Windows], p: Array, noise: Noise
) -> Checked:
    """Score how well parameters explain recordings that they need not have been fitted to.

    Parameters
    ----------
    prior : of the parameters
    shapes : curves of the muscles
    windows : recordings
    p : (parameters,)
    noise : errors of torques and EMG

    Returns
    -------
    score per frame, and torques left
    """
    score = 0.0
    frames = 0
    left = np.zeros(len(noise.torque))
    known = np.zeros(len(noise.torque))
    for window in windows:
        part = Part(prior, shapes, window)
        scores = []
        for _ in range(6):
            part.linearize(p, noise, slopes=False)
            scores.append(part.score())
            part.settle(np.zeros(0))
        part.linearize(p, noise, slopes=False)
        # Activations that change their bounds at once can spoil a single pass.
        score += min(*scores[3:], part.score())
        frames += int(window.counted.sum())
        left += np.sum(part.plain**2, axis=0)
        known += np.sum(part.known, axis=0)
    return Checked(
        score / frames, np.where(known > 0, np.sqrt(left / np.maximum(known, 1)), np.nan)
    )


def _left_to_errors(parts: Sequence[Part], effective: float) -> float:
    """Compute how much of the independent misfits the parameters do not follow.

    It is squared: so much less is known than it looks. Once because the misfits are smaller for it,
    and once because what is followed is slow: left misfits are alike over a shorter time than
    errors are.

    Parameters
    ----------
    effective : number of parameters that the recordings determine
    """
    seen = sum(part.weight * part.known.sum() for part in parts)
    return float(np.clip(1.0 - effective / max(seen, 1e-12), 0.5, 1.0)) ** 2 * INFORMATION


def path_ends(windows: Sequence[Windows]) -> Array:
    """Find the ends of the paths' ranges in frames that count.

    Parameters
    ----------
    windows : recordings

    Returns
    -------
    (2, muscles) least and greatest lengths [m]
    """
    every = np.concatenate([window.lengths[window.counted] for window in windows])
    return np.array([every.min(axis=0), every.max(axis=0)])


def _outside(
    prior: Prior, shapes: MuscleShapes, windows: Sequence[Windows], p: Array
) -> tuple[Array, Array]:
    """Build rows that pull muscles into physiological lengths.

    Parameters
    ----------
    p : (parameters,)

    Returns
    -------
    (2 muscles, parameters) rows and (2 muscles,) misfits in standard deviations (`OUTSIDE`)
    """
    muscles = len(prior.names)
    ends = path_ends(windows)
    sizes = prior.sizes(p)
    before = rigid_lengths(shapes, prior.start, ends)
    now = rigid_lengths(shapes, sizes, ends)
    low = np.minimum(PHYSIOLOGICAL[0], before[0])
    high = np.maximum(PHYSIOLOGICAL[1], before[1])
    along = (ends - sizes.slack) / sizes.fiber
    slope = np.clip(along / np.maximum(now, 1e-6), 0.0, 1.0)
    rows = np.zeros((2 * muscles, len(p)))
    misfit = np.zeros(2 * muscles)
    index = np.arange(muscles)
    for number, beyond in enumerate(
        (np.minimum(now[0] - low, 0.0), np.maximum(now[1] - high, 0.0))
    ):
        out = (beyond != 0.0).astype(np.float64)
        rows[number * muscles + index, index] = (
            -out * slope[number] * (ends[number] - prior.reference) / sizes.fiber / OUTSIDE
        )
        rows[number * muscles + index, muscles + index] = out * slope[number] / OUTSIDE
        misfit[number * muscles : (number + 1) * muscles] = -beyond / OUTSIDE
    return rows, misfit


# Of the score per frame: by so much generic values must be better to be kept, or rounding would
# choose
BETTER = 0.005
SHARE = 2.0 / 3.0  # Of a single recording that muscles are fitted to; the rest is held out


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
    """

    recordings: tuple[str, ...]
    frames: int
    score_generic: float
    score: float
    left_generic: Array
    left: Array
    kept: tuple[str, ...]


def split(windows: Sequence[Windows]) -> tuple[list[Windows], list[Windows]]:
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
    """Compare generic and fitted muscles on unseen recordings.

    Parameters
    ----------
    prior : of the parameters
    shapes : curves of the muscles
    fitted_to : recordings of the fit
    unseen : recordings that were held out
    floors : (rows,) least standard deviation of the torques [N m or N]
    fitted : result of the fit
    keep : whether generic values are kept where they are better; else it is only reported

    Returns
    -------
    the comparison, and (parameters,) generic where better
    """
    gains = np.zeros(len(fitted.p), bool)
    gains[prior.parts[4]] = True
    # The generic muscles get gains of EMG and errors of torques of their own, so that muscles alone
    # are compared. Stopped early: gains that settle on one stride of the knee's man leave more
    # torque of the next (15 N m, not 10), and with both settled that was no longer reported.
    generic = fit(prior, shapes, fitted_to, floors, gains, steps=8) if gains.any() else None
    plain = np.zeros(len(fitted.p)) if generic is None else generic.p
    noise = fitted.noise
    first = check(prior, shapes, unseen, plain, noise)
    result = check(prior, shapes, unseen, fitted.p, noise)
    best = result
    kept = []
    p = fitted.p.copy()
    for g, name in enumerate(prior.groups):
        tried = generic_group(prior, p, g)
        if np.allclose(tried, p, atol=0.01):
            continue
        other = check(prior, shapes, unseen, tried, noise)
        if other.score < best.score - BETTER * max(abs(best.score), 1.0):
            p = tried
            best = other
            kept.append(name)
    if best.score > first.score and keep:
        everything = fitted.p.copy()
        everything[: prior.parts[4].start] = 0.0
        p = np.where(gains, plain, everything)
        best = first
        kept = list(prior.groups)
    if not keep:
        p = fitted.p
        best = result
    frames = sum(int(recording.counted.sum()) for recording in unseen)
    names = tuple(recording.name for recording in unseen)
    return (
        HeldOut(
            recordings=names,
            frames=frames,
            score_generic=first.score,
            score=best.score,
            left_generic=first.left,
            left=best.left,
            kept=tuple(kept),
        ),
        p,
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
    members = np.flatnonzero(prior.group == g)
    fiber, point, force, strain, _ = prior.parts
    for part in (fiber, point):
        p[part.start + members] = 0.0
    p[force.start + g] = p[strain.start + g] = 0.0
    return p

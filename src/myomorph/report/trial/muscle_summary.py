"""What `muscles` prints of its result: where fibers work, how fast they shorten, and whether paths jump."""

from __future__ import annotations

import itertools

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import few
from myomorph.model.model import Model
from myomorph.report.trial.summary_lines import plain

FIBER_RANGE = (0.5, 1.5)  # Lengths over the optimal one between which fibers pull actively (Zajac 1989).
JUMP = 1e-3  # A path whose length changes by so much more between two frames than its velocity explains jumps [m].
UNUSUAL = 10.0  # And by so many times what is usual for the muscle, so that coarse frames of fast motions are no jumps.
MAX_NAMED = 3


def muscles_line(model: Model, time: Array, lengths: Array, velocities: Array) -> str:
    """Frames, muscles, shortest and longest fibers with muscle and time, the fastest shortening, and jumps of paths.
    Fibers are those on a tendon at its slack length. Source: Zajac 1989 (active force between 0.5 and 1.5 optimal fiber
    lengths).
    """
    text = f"{len(time)} frames, {len(model.muscles)} muscles"
    known = np.isfinite(lengths).all(axis=1)
    fibers = _fiber_lengths(model, lengths)
    if not known.any() or not np.isfinite(fibers).any():
        return text
    parts = _range(model, time, fibers), _fastest(model, time, velocities), _jumps(model, time, lengths, velocities)
    return f"{text}: {'; '.join(parts)}"


def _fiber_lengths(model: Model, lengths: Array) -> Array:
    """(frames, muscles) fiber lengths over optimal ones, tendons at slack length; NaN where a muscle has none."""
    optimal = np.array([muscle.optimal_fiber_length for muscle in model.muscles])
    slack = np.array([muscle.tendon_slack_length for muscle in model.muscles])
    sine = np.sin([muscle.pennation_at_optimal for muscle in model.muscles])
    optimal = np.where(optimal > 0.0, optimal, np.nan)
    return np.asarray(np.hypot(np.maximum(lengths - slack, 0.0) / optimal, sine))


def _range(model: Model, time: Array, fibers: Array) -> str:
    """The shortest and the longest fibers, and which leave the range of active force."""
    names, ends = model.muscle_names, []
    for at in (np.nanargmin(fibers), np.nanargmax(fibers)):
        frame, muscle = np.unravel_index(int(at), fibers.shape)
        ends.append(f"{fibers[frame, muscle]:.2f} ({names[muscle]} at {time[frame]:.2f} s)")
    low, high = FIBER_RANGE
    with np.errstate(invalid="ignore"):
        out = np.any((fibers < low) | (fibers > high), axis=0)
    verdict = f"within {low:g} to {high:g} (Zajac 1989)"
    if out.any():
        verdict = f"{few(itertools.compress(names, out), MAX_NAMED)} outside {low:g} to {high:g} (Zajac 1989)"
    return f"fibers {ends[0]} to {ends[1]} optimal lengths, tendons at slack length: {verdict}"


def _fastest(model: Model, time: Array, velocities: Array) -> str:
    """The greatest shortening velocity as a share of what the muscle can do at all."""
    limit = np.array([muscle.optimal_fiber_length * muscle.max_contraction_velocity for muscle in model.muscles])
    shares = -velocities / np.where(limit > 0.0, limit, np.nan)
    if not np.isfinite(shares).any():
        return "no velocities"
    frame, column = np.unravel_index(int(np.nanargmax(shares)), shares.shape)
    share = float(shares[frame, column])
    with np.errstate(invalid="ignore"):
        over = np.any(shares >= 1.0, axis=0)
    verdict = (
        "below it"
        if not over.any()
        else f"{few(itertools.compress(model.muscle_names, over), MAX_NAMED)} too fast to pull"
    )
    return (
        f"fastest shortening {plain(100 * share)} % of the greatest velocity ({model.muscle_names[column]} at "
        f"{time[frame]:.2f} s): {verdict}"
    )


def _jumps(model: Model, time: Array, lengths: Array, velocities: Array) -> str:
    """Paths whose length changes between two frames by what no velocity explains, as where a path leaves a surface."""
    if len(time) < 3:
        return "too few frames to see jumps"
    step = np.diff(time)[:, None]
    odd = np.abs(np.diff(lengths, axis=0) - 0.5 * step * (velocities[1:] + velocities[:-1]))
    odd = np.where(np.isfinite(odd), odd, 0.0)
    jumping = odd > np.maximum(JUMP, UNUSUAL * np.median(odd, axis=0))
    if not jumping.any():
        return "no path jumps"
    frame, muscle = np.unravel_index(int(np.argmax(np.where(jumping, odd, 0.0))), odd.shape)
    where = f"{model.muscle_names[muscle]} by {1e3 * odd[frame, muscle]:.1f} mm at {time[frame + 1]:.2f} s"
    count = int(jumping.any(axis=0).sum())
    some = "1 path jumps" if count == 1 else f"{count} paths jump"
    return f"{some} ({where}): moment arms there are unreliable"

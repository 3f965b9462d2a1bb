"""Fibers and tendons of an animal's muscles that suit its own postures.

Tables of anatomists have fiber lengths, and tendons keep the source's mean normalized length over
the ranges of joints. An animal uses a part of these ranges, often near an end: a mouse runs on bent
hips and knees. Over the postures that it was recorded in, fibers are to work between 0.5 and 1.5
optimal lengths l_0, with the tendon slack length l_T,

    n = (l_MT - l_T) / (l_0 cos(alpha_0)),   0.5 <= n <= 1.5

Of all lengths that do so those nearest to the given ones are taken: the tendon is moved first, and
fibers change only where no tendon brings them between these limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.bones.morph.morphed import Morph, MuscleChange
from myomorph.bones.morph.transfer.muscles import Growth, with_lengths
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.series import Motion
from myomorph.core.model.sides import other_side
from myomorph.core.muscles.kinematics import muscle_kinematics

WORKING = 0.5, 1.5
"""Normalized fiber lengths between which muscles can pull."""
TAILS = 0.01
"""Share of the frames at either end that does not count: a path that jumps there says nothing."""
MIN_FRAMES = 10
MAX_CHANGE = 1.5
"""Factor by which fibers of a table may change: muscles left out of tables are known so well."""


def fitted_to_postures(morph: Morph, motions: Sequence[Motion]) -> Morph:
    """Change tendons, and fibers where they must, so that they suit the postures of motions.

    Muscles of both sides that are each other's counterparts stay alike: the postures of both count
    for both.

    Parameters
    ----------
    morph : muscles on the skeleton of the animal
    motions : coordinates of that skeleton over time [rad or m]; frames without a pose are left out

    Returns
    -------
    the morph with other lengths, and notes on what was changed and what could not be

    Raises
    ------
    BadData : the motions have fewer than ten frames with a pose
    """
    model = morph.model
    lengths = _path_lengths(model, motions)
    columns = {name: index for index, name in enumerate(model.muscle_names)}
    muscles = {muscle.name: muscle for muscle in model.muscles}
    growths: dict[str, Growth] = {}
    too_long = []
    for name, muscle in muscles.items():
        other = columns.get(other_side(name), columns[name])
        seen = lengths[:, [columns[name], other]]
        shortest, longest = np.quantile(seen, [TAILS, 1.0 - TAILS]).tolist()
        growth = _growth(muscle, shortest, longest)
        if growth is None:
            continue
        if 1.0 / MAX_CHANGE <= growth.slope <= MAX_CHANGE:
            growths[name] = growth
        else:
            too_long.append(name)
    changed = tuple(
        with_lengths(muscle, growths[name]) if name in growths else muscle
        for name, muscle in muscles.items()
    )
    changes = tuple(
        _grown(change, muscles[change.name], growths[change.name])
        if change.name in growths
        else change
        for change in morph.muscles
    )
    return replace(
        morph,
        model=replace(model, muscles=changed),
        muscles=changes,
        notes=(*morph.notes, *_notes(growths, too_long)),
    )


def _notes(growths: Mapping[str, Growth], too_long: Sequence[str]) -> Iterator[str]:
    """Say what was changed, and what could not be, one line each."""
    tendons = [name for name, growth in growths.items() if growth.slope == 1.0]
    fibers = [name for name in growths if name not in tendons]
    if tendons:
        yield (
            f"tendons follow the animal's own postures, fibers between {WORKING[0]:g} and"
            f" {WORKING[1]:g} optimal lengths: {quoted(tendons)}"
        )
    if fibers:
        factors = ", ".join(f"{growths[name].slope:.2f}" for name in fibers)
        yield (
            "no tendon alone suits the animal's own postures, fibers changed too, by factors of"
            f" {factors}: {quoted(fibers)}"
        )
    if too_long:
        yield (
            f"no fiber within a factor of {MAX_CHANGE:g} suits the animal's own postures, left as"
            f" they are; a jumping path may cause this: {quoted(too_long)}"
        )


def _grown(change: MuscleChange, muscle: Muscle, growth: Growth) -> MuscleChange:
    """Add what a further growth does to the change of a muscle."""
    tendon = muscle.tendon_slack_length
    ratio = (growth.slope * tendon + growth.shift) / tendon if tendon > 0.0 else 1.0
    moved = (tendon - growth.slope * tendon - growth.shift) / muscle.optimal_fiber_length
    low, high = change.range_target
    return replace(
        change,
        fiber=change.fiber * growth.slope,
        tendon=change.tendon * ratio,
        range_target=((low + moved) / growth.slope, (high + moved) / growth.slope),
    )


def _path_lengths(model: Model, motions: Sequence[Motion]) -> Array:
    """Lengths (frames, muscles) in all frames that have a pose [m]."""
    found = []
    for motion in motions:
        posed = np.isfinite(motion.values).all(axis=1)
        if posed.any():
            part = Motion(motion.time[posed], motion.names, motion.values[posed])
            kinematics = muscle_kinematics(model, part, moment_arms=False, velocities=False)
            found.append(kinematics.muscle_length)
    count = sum(len(lengths) for lengths in found)
    if count < MIN_FRAMES:
        raise BadData(
            f"the animal's own postures: {count} frames have a pose: expected {MIN_FRAMES} or more"
        )
    return np.concatenate(found)


def _growth(muscle: Muscle, shortest: float, longest: float) -> Growth | None:
    """Find the least growth that suits paths from a shortest to a longest one [m].

    None where the muscle's own lengths suit them, or where it has no fibers.
    """
    own = muscle.optimal_fiber_length * float(np.cos(muscle.pennation_at_optimal))
    if not own > 0.0:
        return None
    least, most = WORKING
    # A tendon has a length: fibers that are too long for the shortest path are shortened.
    fiber = min(max(own, (longest - shortest) / (most - least)), shortest / least)
    lowest = max(longest - most * fiber, 0.0)
    highest = max(shortest - least * fiber, lowest)
    tendon = float(np.clip(muscle.tendon_slack_length, lowest, highest))
    slope = fiber / own
    shift = tendon - slope * muscle.tendon_slack_length
    return None if slope == 1.0 and shift == 0.0 else Growth(slope, shift)

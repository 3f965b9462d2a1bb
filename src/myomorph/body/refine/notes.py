"""What may not be believed of what was refined, one line each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.body import causes
from myomorph.body.causes import HELD_OUT
from myomorph.body.refine.options import (
    CLOCK,
    LENGTHS,
    MARKERS,
    MASSES,
    MOTIONS,
    RefineOptions,
)
from myomorph.body.refine.point import Point
from myomorph.body.refine.predictions import LEAVES_MARKERS
from myomorph.body.refine.problem import Problem
from myomorph.body.refine.refinement import ClockOffset, Prediction, RefinedTrial
from myomorph.core.fit.verdict import WORSE
from myomorph.core.model.causes import CLOCKS
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model

PARTS = {LENGTHS: "lengths", MARKERS: "marker positions", MASSES: "masses", CLOCK: "clocks"}
"""Of a subject, in words."""
MAX_MASS_CHANGE = 0.5
MIN_MASS_SHARE = 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a
link does not count.
"""


def kept_note(
    tried: Sequence[tuple[str, Sequence[Prediction]]], options: RefineOptions
) -> Iterator[Message]:
    """Report that parts of the given model were kept, and how much worse refined ones predict.

    Parameters
    ----------
    tried : what was refined but not taken, with its predictions; empty where the first was taken
    options : of what was refined in the end

    Yields
    ------
    one line, or none
    """
    if not tried:
        return
    kept = "lengths and marker positions" if options.fits_masses else "body and masses"
    texts = []
    for what, predictions in tried:
        worst = max(
            predictions,
            key=lambda each: max(each.ratio, each.markers_ratio * WORSE / LEAVES_MARKERS),
        )
        texts.append(f"refined {what} predict {_numbers(worst)}")
    yield (
        HELD_OUT.message(
            f"{kept} are those of the given model, only {refined_parts(options.fit)} were refined:"
            f" {'; '.join(texts)}"
        )
    )


def markers_left(trials: Sequence[RefinedTrial]) -> Iterator[Message]:
    """Report refined motions that lie farther from their markers than inverse kinematics does.

    Inverse kinematics is that on the given model, and farther is `LEAVES_MARKERS` times.
    """
    left = [
        trial for trial in trials if trial.after.markers > LEAVES_MARKERS * trial.before.markers
    ]
    if left:
        listed = ", ".join(
            f"{trial.name} {1e3 * trial.after.markers:.1f} mm (before"
            f" {1e3 * trial.before.markers:.1f})"
            for trial in left[:4]
        )
        yield (
            causes.MASSES.message(
                f"forces pull {len(left)} of {len(trials)} refined motions away from their markers:"
                f" {listed}; check whether the subject's mass, the plates' zeros and clock are"
                " right, and whether anything else touched the body"
            )
        )


def refined_parts(fit: Sequence[str]) -> str:
    """Name in words what is refined beside motions.

    Parameters
    ----------
    fit : names of kinds
    """
    if {LENGTHS, MARKERS, MASSES} <= set(fit):
        parts = ["body", "masses"]
    else:
        parts = [PARTS[name] for name in (LENGTHS, MARKERS, MASSES) if name in fit]
    parts += [PARTS.get(name, name) for name in fit if name not in (LENGTHS, MARKERS, MASSES)]
    parts = [part for part in parts if part != MOTIONS]
    if not parts:
        return MOTIONS
    first = ", ".join(parts[:-1])
    return f"{first} and {parts[-1]}" if first else parts[-1]


def worse_note(predictions: Sequence[Prediction]) -> Iterator[Message]:
    """Report recordings that are predicted worse than by the given model.

    All together they are not.
    """
    left = [
        prediction
        for prediction in predictions
        if prediction.refined.markers > LEAVES_MARKERS * prediction.given.markers
    ]
    worse = [
        prediction
        for prediction in predictions
        if max(prediction.ratios) > WORSE
        or (prediction.markers_ratio > WORSE and prediction not in left)
    ]
    if worse:
        listed = "; ".join(_numbers(prediction) for prediction in worse[:4])
        yield (
            HELD_OUT.message(
                f"{len(worse)} of {len(predictions)} predictions of what was not used are more than"
                f" {100.0 * (WORSE - 1.0):.0f} % worse than the given model's: {listed}"
            )
        )
    if left:
        listed = "; ".join(_numbers(prediction) for prediction in left[:4])
        yield (
            HELD_OUT.message(
                f"bodies that were refined without them lie farther from the markers of {len(left)}"
                f" of {len(predictions)} predictions than the given model, which may have been"
                f" calibrated with them: {listed}; add recordings, or keep lengths and marker"
                " positions (--fit masses)"
            )
        )


def _numbers(prediction: Prediction) -> str:
    return (
        f"{prediction.name} at {prediction.refined.force:.1f} N, {prediction.refined.moment:.1f} N"
        f" m, markers {1e3 * prediction.refined.markers:.1f} mm (given model"
        f" {prediction.given.force:.1f} N, {prediction.given.moment:.1f} N m,"
        f" {1e3 * prediction.given.markers:.1f} mm; a body refined without forces"
        f" {1e3 * prediction.markers_alone:.1f} mm)"
    )


def far_from_given(problem: Problem, at: Point) -> Iterator[Message]:
    """Report links that got a mass that is hard to believe, as one line.

    Parameters
    ----------
    problem : with the masses before
    at : optimum

    Yields
    ------
    one line, or none
    """
    before = inertial_parameters(problem.model)[:, 0]
    after = at[MASSES][:, 0]
    counts = before > MIN_MASS_SHARE * before.sum()
    far = np.flatnonzero(counts & (np.abs(after - before) > MAX_MASS_CHANGE * before))
    if not len(far):
        return
    names = problem.model.body_names
    listed = ", ".join(f"'{names[i]}' {after[i]:.2f} kg (given {before[i]:.2f})" for i in far[:4])
    swung = dict.fromkeys(name for i in far[:4] for name in _joint_above(problem.model, names[i]))
    how = f" that swings {', '.join(map(repr, swung))} fast and far" if swung else ""
    yield (
        causes.MASSES.message(
            f"{len(far)} of {len(names)} links have an implausible mass: {listed}; add a"
            f" recording{how} with nothing but plates to touch (a chair, a rail or a hand carries a"
            " part of the body), or keep the given masses (--fit lengths markers)"
        )
    )


def _joint_above(model: Model, body: str) -> tuple[str, ...]:
    """Return the coordinates of the nearest joint above a body that moves it.

    None where only the floating base does.
    """
    above = {joint.child: joint for joint in model.joints}
    while body in above and not above[body].coordinates:
        body = above[body].parent
    joint = above.get(body)
    return () if joint is None or joint.parent == GROUND else joint.coordinates


def clock_notes(clocks: Sequence[ClockOffset]) -> Iterator[Message]:
    """Report clocks that the recordings do not show, or that are farther off than is looked for.

    Parameters
    ----------
    clocks : of all recordings

    Yields
    ------
    one line for each
    """
    for clock in clocks:
        if clock.at_bound:
            yield (
                CLOCKS.message(
                    f"{clock.recording}: its forces are {1e3 * clock.offset.value:.0f} ms off or"
                    " more, the end of the search range: move them by --force-shift first"
                )
            )
        elif not clock.shown:
            low = 1e3 * clock.offset.low
            high = 1e3 * clock.offset.high
            yield (
                CLOCKS.message(
                    f"{clock.recording}: the clock of its forces is not determined, it may be"
                    f" {low:.0f}"
                    f" to {high:.0f} ms off; record a jump or a fast step, whose forces change"
                    " quickly"
                )
            )

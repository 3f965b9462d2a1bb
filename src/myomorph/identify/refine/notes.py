"""What may not be believed of a refinement, in lines whose first is the worst."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.identify.refine.options import RefineOptions
from myomorph.identify.refine.predictions import LEAVES_MARKERS, WORSE
from myomorph.identify.refine.problem import Problem, Unknowns
from myomorph.identify.refine.refinement import Prediction, RefinedTrial
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import GROUND, Model

MAX_MASS_CHANGE, MIN_MASS_SHARE = 0.5, 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a link does not count."""


def kept_note(tried: Sequence[tuple[str, Sequence[Prediction]]], options: RefineOptions) -> Iterator[str]:
    """That parts of the given model were kept, and by how much refined ones predict worse.
    `tried`: what was refined but not taken, with its predictions; nothing where the first was taken; `options`: of what
    was refined in the end.
    """
    if not tried:
        return
    kept = "lengths and marker positions" if options.masses else "body and masses"
    texts = []
    for what, predictions in tried:
        worst = max(
            predictions, key=lambda prediction: max(prediction.ratio, prediction.markers_ratio * WORSE / LEAVES_MARKERS)
        )
        texts.append(f"refined {what} predict {_numbers(worst)}")
    yield f"{kept} are those of the given model, only {refined_parts(options)} were refined: {'; '.join(texts)}"


def markers_left(trials: Sequence[RefinedTrial]) -> Iterator[str]:
    """That refined motions lie farther from their own markers than inverse kinematics on the given model."""
    left = [trial for trial in trials if trial.after.markers > LEAVES_MARKERS * trial.before.markers]
    if left:
        listed = ", ".join(
            f"{trial.name} {1e3 * trial.after.markers:.1f} mm (before {1e3 * trial.before.markers:.1f})"
            for trial in left[:4]
        )
        yield (
            f"forces pull {len(left)} of {len(trials)} refined motions away from their markers: {listed}; see whether "
            "the subject's mass, the plates' zeros and clock are right, and what else touched the body"
        )


def refined_parts(options: RefineOptions) -> str:
    """What options refine beside motions, in words."""
    words = {(True, True): "body and masses", (True, False): "lengths and marker positions", (False, True): "masses"}
    return words.get((options.body, options.masses), "motions")


def worse_note(predictions: Sequence[Prediction]) -> Iterator[str]:
    """That some recordings are predicted worse than by the given model, although all together are not."""
    left = [
        prediction
        for prediction in predictions
        if prediction.refined.markers > LEAVES_MARKERS * prediction.given.markers
    ]
    worse = [
        prediction
        for prediction in predictions
        if max(prediction.ratios) > WORSE or (prediction.markers_ratio > WORSE and prediction not in left)
    ]
    if worse:
        listed = "; ".join(_numbers(prediction) for prediction in worse[:4])
        yield (
            f"{len(worse)} of {len(predictions)} predictions of what was not used are more than "
            f"{100.0 * (WORSE - 1.0):.0f} % worse than the given model's: {listed}"
        )
    if left:
        listed = "; ".join(_numbers(prediction) for prediction in left[:4])
        yield (
            f"bodies that were refined without them lie farther from the markers of {len(left)} of {len(predictions)} "
            f"predictions than the given model, which may have been calibrated with them: {listed}; add recordings, or "
            "keep lengths and marker positions (--no-body)"
        )


def _numbers(prediction: Prediction) -> str:
    return (
        f"{prediction.name} at {prediction.refined.force:.1f} N, {prediction.refined.moment:.1f} N m, markers "
        f"{1e3 * prediction.refined.markers:.1f} mm (given model {prediction.given.force:.1f} N, "
        f"{prediction.given.moment:.1f} N m, "
        f"{1e3 * prediction.given.markers:.1f} mm; a body refined without forces "
        f"{1e3 * prediction.markers_alone:.1f} mm)"
    )


def far_from_given(problem: Problem, at: Unknowns) -> Iterator[str]:
    """Links that got a mass that is hard to believe, as one line."""
    before, after = inertial_parameters(problem.model)[:, 0], at.parameters[:, 0]
    counts = before > MIN_MASS_SHARE * before.sum()
    far = np.flatnonzero(counts & (np.abs(after - before) > MAX_MASS_CHANGE * before))
    if not len(far):
        return
    names = problem.model.body_names
    listed = ", ".join(f"'{names[i]}' {after[i]:.2f} kg (given {before[i]:.2f})" for i in far[:4])
    swung = dict.fromkeys(name for i in far[:4] for name in _joint_above(problem.model, names[i]))
    how = f" that swings {', '.join(map(repr, swung))} fast and far" if swung else ""
    yield (
        f"{len(far)} of {len(names)} links have a mass that is hard to believe: {listed}; add a recording{how} with "
        "nothing but plates to touch (a chair, a rail or a hand carries a part of the body), or keep the given masses "
        "(--no-masses)"
    )


def _joint_above(model: Model, body: str) -> tuple[str, ...]:
    """Coordinates of the nearest joint above a body that moves it; none where only the floating base does."""
    above = {joint.child: joint for joint in model.joints}
    while body in above and not above[body].coordinates:
        body = above[body].parent
    joint = above.get(body)
    return () if joint is None or joint.parent == GROUND else joint.coordinates

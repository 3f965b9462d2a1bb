"""What several sections need, worked out once from what was given."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from myomorph.analysis.center_of_mass import centroid
from myomorph.analysis.length_analysis import LengthAnalysis, length_analysis
from myomorph.analysis.phases import Movement, find_movement
from myomorph.analysis.strides import Strides
from myomorph.analysis.walking import walking_strides
from myomorph.model.arrays import Array, read_only
from myomorph.model.series import Event, Motion, Series
from myomorph.report.page.parts import Verdict
from myomorph.report.trial.estimated_forces import contact_verdicts
from myomorph.report.trial.given import ReportInput
from myomorph.report.trial.tables import (
    body_scale,
    gap_verdicts,
    marker_verdicts,
    range_verdicts,
    reserve_verdicts,
    residual_verdicts,
    saturation_verdicts,
    stretch_verdict,
    unsolved_verdict,
)

MOST_CENTROID_FRAMES = 40000
LONGEST_PLAY = 7.5
LONGEST_WHOLE = 20.0
GAITS = ("", "gait")
"""Presets in which strides are looked for."""


@read_only
@dataclass(frozen=True, eq=False)
class Prepared:
    """The given parts with what follows from them.

    Attributes
    ----------
    up : against gravity, (3,)
    span : first and last time of the report [s]
    movement : kind, events and measures
    centroid : center of mass over time, or None
    floor : height of the ground along `up` [m]
    weight : of the body [N], None if unknown
    scale : of the body against an adult, for limits
    verdicts : everything held against a limit
    """

    given: ReportInput
    up: Array
    span: tuple[float, float]
    movement: Movement
    centroid: Series | None
    floor: float
    weight: float | None
    scale: float
    verdicts: tuple[Verdict, ...]

    @property
    def events(self) -> tuple[Event, ...]:
        """Events within the span."""
        return tuple(event for event in self.movement.events if self.span[0] <= event.time <= self.span[1])

    @property
    def played(self) -> tuple[float, float]:
        """What is played: a short recording whole, of a long one some seconds around its events [s]."""
        start, stop = self.span
        if self.events:
            start, stop = max(start, self.events[0].time - 0.5), min(stop, self.events[-1].time + 1.0)
        if stop - start > LONGEST_PLAY:
            middle = (start + stop) / 2
            start, stop = middle - LONGEST_PLAY / 2, middle + LONGEST_PLAY / 2
        return start, stop

    @property
    def detail(self) -> tuple[float, float]:
        """What charts show: the whole, or of a long recording the part that is played [s]."""
        return self.span if self.span[1] - self.span[0] <= LONGEST_WHOLE else self.played

    @property
    def detail_note(self) -> str:
        """A sentence for charts that show a part, else ""."""
        if self.detail == self.span:
            return ""
        first, last = self.detail
        return (
            f" Charts show {first:.1f} to {last:.1f} s, the part that plays above, of a recording of "
            f"{self.span[1] - self.span[0]:.0f} s; tables cover all of it."
        )

    @cached_property
    def strides(self) -> Strides | None:
        """Of the motion, None where it is no walk."""
        model, motion = self.given.model, self.given.kinematics.motion
        if model is None or motion is None:
            return None
        return walking_strides(
            model,
            motion,
            self.given.kinematics.fit,
            wrenches=self.given.dynamics.wrenches,
            events=self.given.recorded.events or (),
        )

    @cached_property
    def lengths(self) -> LengthAnalysis | None:
        """Muscle lengths over the strides of a walk; None where lengths, feet or strides are not there."""
        model, muscles = self.given.model, self.given.muscles
        if model is None or muscles.lengths is None or self.given.analysis.preset not in GAITS or self.strides is None:
            return None
        return length_analysis(model, muscles.lengths, self.strides, muscles.velocities)

    @property
    def center_height(self) -> float:
        """Mean height of the center of mass over the ground [m], nan if unknown."""
        if self.centroid is None or not np.isfinite(self.centroid.values).any():
            return float("nan")
        return float(np.nanmean(self.centroid.values @ self.up)) - self.floor


def prepare(report_input: ReportInput) -> Prepared:
    """Span, events, center of mass and verdicts of what was given."""
    up = np.array([0.0, 1.0, 0.0]) if report_input.model is None else report_input.model.up
    span = _span(report_input)
    motion = report_input.kinematics.motion
    com = None
    if report_input.model is not None and motion is not None and len(motion) and report_input.model.mass > 0.0:
        # It is drawn, not computed with.
        com = centroid(report_input.model, thinned(motion, MOST_CENTROID_FRAMES))
    weight = None
    if report_input.model is not None and report_input.model.mass > 0.0 and np.any(report_input.model.gravity):
        weight = report_input.model.weight
    # A model of part of a body does not weigh what stands on the plates.
    whole = weight if not report_input.dynamics.root_note else None
    movement = Movement()
    pressing = report_input.dynamics.wrenches
    if pressing is None and report_input.contacts.forces is not None:
        pressing = report_input.contacts.forces.wrenches()
    if pressing is not None and len(pressing.names):
        movement = find_movement(pressing, up, whole, com)
    if report_input.recorded.events is not None:
        kind = movement.kind if not report_input.recorded.events else movement.kind or "movement"
        movement = Movement(
            kind, tuple(sorted(report_input.recorded.events, key=lambda event: event.time)), movement.measures
        )
    scale = body_scale(report_input.kinematics.markers)
    prepared = Prepared(report_input, up, span, movement, com, _floor(report_input, up), whole, scale, ())
    return replace(prepared, verdicts=tuple(_verdicts(prepared)))


def _span(report_input: ReportInput) -> tuple[float, float]:
    for one in (
        report_input.kinematics.motion,
        report_input.dynamics.torques,
        report_input.tension,
        report_input.kinematics.markers,
        report_input.dynamics.wrenches,
        report_input.recorded.emg,
    ):
        if one is not None and len(one.time):
            return float(one.time[0]), float(one.time[-1])
    return 0.0, 1.0


def thinned(motion: Motion, max_frames: int) -> Motion:
    """Every few frames of a motion that is longer than `max_frames`."""
    step = -(-len(motion) // max_frames)
    return motion if step <= 1 else Motion(motion.time[::step], motion.names, motion.values[::step])


def _floor(report_input: ReportInput, up: Array) -> float:
    """Height of the ground: the plates', else of loaded points of application, else zero."""
    if report_input.recorded.plates:
        return float(np.mean([plate.corners @ up for plate in report_input.recorded.plates]))
    if report_input.dynamics.wrenches is not None and len(report_input.dynamics.wrenches.names):
        loaded = np.nan_to_num(report_input.dynamics.wrenches.forces @ up)
        points = report_input.dynamics.wrenches.points @ up
        shown = points[(loaded > 0.1 * max(float(loaded.max(initial=0.0)), 1e-12)) & np.isfinite(points)]
        if shown.size:
            return float(np.median(shown))
    return 0.0


def _verdicts(prepared: Prepared) -> list[Verdict]:
    given, motion, tension = prepared.given, prepared.given.kinematics.motion, prepared.given.tension
    model, torques, wrenches = given.model, given.dynamics.torques, given.dynamics.wrenches
    rows: list[Verdict] = []
    if given.kinematics.fit is not None:
        rows += marker_verdicts(given.kinematics.fit, prepared.scale)
    if given.kinematics.markers is not None:
        rows += gap_verdicts(given.kinematics.markers)
    if model is not None and motion is not None and len(motion):
        rows += range_verdicts(model, motion)
    # What contacts were solved for is still in the torques of inverse dynamics.
    judged = not given.dynamics.root_note and given.contacts.forces is None and prepared.center_height > 0
    if judged and model is not None and torques is not None and wrenches is not None:
        rows += residual_verdicts(model, torques, wrenches, prepared.center_height)
    rows += contact_verdicts(given, prepared.center_height)
    if tension is not None:
        rows.append(unsolved_verdict(tension.solved, tension.time))
        if model is not None and torques is not None:
            names, reserves = tension.reserve_coordinates, tension.reserves
            rows += reserve_verdicts(model, torques, names, reserves, tension.time, given.muscles.driven)
        bounds = {} if model is None else {muscle.name: muscle.max_activation for muscle in model.muscles}
        most = np.array([bounds.get(name, 1.0) for name in tension.muscles])
        if tension.passive is not None or tension.overstretched:
            rows.append(stretch_verdict(tension.overstretched, len(tension.muscles), tension.passive or ()))
        rows += saturation_verdicts(tension.muscles, tension.activations, most, tension.time)
    return rows

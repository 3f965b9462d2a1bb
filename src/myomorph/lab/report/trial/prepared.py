"""What several sections need, worked out once from what was given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Event, Motion, Series
from myomorph.lab.analysis.center_of_mass import centroid
from myomorph.lab.analysis.gait_curves import SIDES, GaitCurves, WalkLoads, gait_curves
from myomorph.lab.analysis.length_analysis import LengthAnalysis, length_analysis
from myomorph.lab.analysis.phases import GroundPhases, ground_phases
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.analysis.walking import walking_strides
from myomorph.lab.movements.part import MovementNumbers
from myomorph.lab.movements.recorded_movement import MAKERS, RecordedMovement
from myomorph.lab.report.page.parts import Quantity, Verdict
from myomorph.lab.report.trial import tables
from myomorph.lab.report.trial.estimated_forces import contact_verdicts
from myomorph.lab.report.trial.report_input import ReportInput

if TYPE_CHECKING:
    from myomorph.core.tension.tension import Tension

MAX_CENTER_FRAMES = 40000
MAX_PLAYED = 7.5
MAX_WHOLE = 20.0
GAITS = ("", "gait")  # Presets in which strides are looked for.
MIN_PERSON = 2.0
"""A body that weighs less is an animal's [kg]."""
MIN_WALK = 0.5
"""Who has each foot on the ground for a smaller share of the stride flies between, and runs."""
STEPPING: tuple[Movement, ...] = ("walking", "running", "stairs")
"""Movements with strides; only of walking there are norms."""
STEPLESS: tuple[Movement, ...] = ("standing", "jumping", "squatting", "rising", "upper limb")


@read_only
class Prepared:
    """The given parts with what follows from them."""

    results: ReportInput
    up: Array  # against gravity, (3,)
    span: tuple[float, float]  # first and last time of the report [s]
    ground: GroundPhases  # kind, events and measures that forces show
    centroid: Series | None  # center of mass over time, or None
    floor: float  # height of the ground along `up` [m]
    weight: float | None  # of the body [N], None if unknown
    scale: float  # of the body against an adult, for limits
    verdicts: tuple[Verdict, ...]  # everything held against a limit

    @property
    def events(self) -> tuple[Event, ...]:
        """Events within the span."""
        return tuple(
            event for event in self.ground.events if self.span[0] <= event.time <= self.span[1]
        )

    @property
    def played(self) -> tuple[float, float]:
        """First and last time of what is played [s].

        A short recording is played whole, of a long one some seconds around its events.
        """
        start, stop = self.span
        if self.events:
            start = max(start, self.events[0].time - 0.5)
            stop = min(stop, self.events[-1].time + 1.0)
        if stop - start > MAX_PLAYED:
            middle = (start + stop) / 2
            start = middle - MAX_PLAYED / 2
            stop = middle + MAX_PLAYED / 2
        return start, stop

    @property
    def detail(self) -> tuple[float, float]:
        """What charts show: the whole, or of a long recording the part that is played [s]."""
        return self.span if self.span[1] - self.span[0] <= MAX_WHOLE else self.played

    @property
    def detail_note(self) -> str:
        """A sentence for charts that show a part, else ""."""
        if self.detail == self.span:
            return ""
        first, last = self.detail
        whole = f"a recording of {self.span[1] - self.span[0]:.0f} s; tables cover all of it."
        return f" Charts show {first:.1f} to {last:.1f} s, the part that plays above, of {whole}"

    @cached_property
    def strides(self) -> Strides | None:
        """Of the motion, None where it is no walk, or the recording of a movement without steps."""
        if self.results.recorded.movement.value in STEPLESS:
            return None
        model = self.results.model
        kinematics = self.results.kinematics
        events = self.results.recorded.events or ()
        if model is None or kinematics.motion is None:
            return None
        wrenches = self.results.dynamics.wrenches
        return walking_strides(
            model, kinematics.motion, kinematics.fit, wrenches=wrenches, events=events
        )

    @property
    def gait(self) -> GaitCurves | None:
        """Curves of clinical gait analysis over the strides.

        They are None where the motion is no walk of two legs, or the recording is of another
        movement.
        """
        return self.stride_curves if self.walks else None

    @property
    def walks(self) -> bool:
        """Whether somebody walks on two legs that were seen.

        Where nobody said so, a foot is on the ground for more than half of a stride. An animal, and
        a body of more limbs, is no patient of a clinic for gait.
        """
        strides = self.strides
        model = self.results.model
        if strides is None or model is None or len(strides.strikes) != len(SIDES):
            return False
        if model.mass < MIN_PERSON:
            return False
        movement = self.results.recorded.movement.value
        if movement is not None:
            return movement == "walking"
        duties = [stride.duty for stride in strides.strides if np.isfinite(stride.duty)]
        return not duties or float(np.median(duties)) > MIN_WALK

    @cached_property
    def stride_curves(self) -> GaitCurves | None:
        """The same of any movement with strides of two legs."""
        model = self.results.model
        motion = self.results.kinematics.motion
        if (
            model is None
            or motion is None
            or self.strides is None
            or self.results.analysis.preset not in GAITS
        ):
            return None
        dynamics = self.results.dynamics
        loads = WalkLoads(
            torques=dynamics.torques,
            filtered=dynamics.motion,
            wrenches=dynamics.wrenches,
            measured=dynamics.measured,
        )
        return gait_curves(model, motion, self.strides, loads)

    @cached_property
    def recorded_movement(self) -> RecordedMovement | None:
        """What the numbers of a run, a jump, a squat or a rise come from; None for others."""
        results = self.results
        dynamics = results.dynamics
        motion = dynamics.motion or results.kinematics.motion
        movement = results.recorded.movement.value
        if movement is None and self.ground.kind == "jump":
            movement = "jumping"
        if movement is None or movement not in MAKERS:
            return None
        if results.model is None or motion is None or not len(motion):
            return None
        return RecordedMovement(
            movement=movement,
            model=results.model,
            motion=motion,
            fit=results.kinematics.fit,
            torques=dynamics.torques,
            measured=dynamics.measured,
            shared=results.contacts.situation == "shared",
            strides=self.strides,
            center=self.centroid,
            up=self.up,
            floor=self.floor,
            weight=self.weight or 0.0,
        )

    @cached_property
    def movement_numbers(self) -> MovementNumbers | None:
        """Of a run, a jump, a squat or a rise; None for other movements, or where none is seen."""
        recorded = self.recorded_movement
        return None if recorded is None else recorded.numbers()

    @cached_property
    def lengths(self) -> LengthAnalysis | None:
        """Muscle lengths over the strides of a walk or a run.

        They are None where lengths, feet or strides are not there.
        """
        if self.results.recorded.movement.value not in (None, *STEPPING):
            return None
        model = self.results.model
        muscles = self.results.muscles
        preset = self.results.analysis.preset
        if model is None or muscles.lengths is None or preset not in GAITS or self.strides is None:
            return None
        return length_analysis(model, muscles.lengths, self.strides, muscles.velocities)

    @property
    def center_height(self) -> float:
        """Mean height of the center of mass over the ground [m], nan if unknown."""
        if self.centroid is None or not np.isfinite(self.centroid.values).any():
            return float("nan")
        return float(np.nanmean(self.centroid.values @ self.up)) - self.floor


def prepare(results: ReportInput) -> Prepared:
    """Span, events, center of mass and verdicts of what was given."""
    model = results.model
    up = np.array([0.0, 1.0, 0.0]) if model is None else model.up
    com = _center_of_mass(results)
    weight = None
    # A model of part of a body does not weigh what stands on the plates.
    if model is not None and model.mass > 0.0 and not results.dynamics.root_note:
        weight = model.weight if np.any(model.gravity) else None
    prepared = Prepared(
        results=results,
        up=up,
        span=_span(results),
        ground=_ground(results, up, weight, com),
        centroid=com,
        floor=_floor(results, up),
        weight=weight,
        scale=tables.body_scale(results.kinematics.markers),
        verdicts=(),
    )
    return replace(prepared, verdicts=tuple(_verdicts(prepared)))


def _center_of_mass(results: ReportInput) -> Series | None:
    """Compute the center of mass over time, None without a model and a motion."""
    model = results.model
    motion = results.kinematics.motion
    if model is None or motion is None or not len(motion) or not model.mass > 0.0:
        return None
    # It is drawn, not computed with.
    return centroid(model, thinned(motion, MAX_CENTER_FRAMES))


def _ground(
    results: ReportInput, up: Array, weight: float | None, com: Series | None
) -> GroundPhases:
    """Events and phases: those of the recording, else those that the ground forces show."""
    ground = GroundPhases()
    pressing = results.dynamics.wrenches
    estimated = results.contacts.forces
    # A plate that feet share is on the nearest one among the measured forces.
    if estimated is not None and (pressing is None or results.contacts.situation == "shared"):
        pressing = estimated.wrenches()
    if pressing is not None and len(pressing.names):
        as_measured = pressing is results.dynamics.wrenches
        measured = results.dynamics.measured if as_measured else None
        ground = ground_phases(pressing, up, weight, com, measured)
    if results.recorded.events is None:
        return ground
    kind = ground.kind if not results.recorded.events else ground.kind or "movement"
    events = tuple(sorted(results.recorded.events, key=lambda event: event.time))
    return GroundPhases(kind, events, ground.measures)


def _span(results: ReportInput) -> tuple[float, float]:
    for series in (
        results.kinematics.motion,
        results.dynamics.torques,
        results.tension,
        results.kinematics.markers,
        results.dynamics.wrenches,
        results.recorded.emg,
    ):
        if series is not None and len(series.time):
            return float(series.time[0]), float(series.time[-1])
    return 0.0, 1.0


def thinned(motion: Motion, max_frames: int) -> Motion:
    """Every few frames of a motion that is longer than `max_frames`."""
    step = -(-len(motion) // max_frames)
    return motion if step <= 1 else Motion(motion.time[::step], motion.names, motion.values[::step])


def _floor(results: ReportInput, up: Array) -> float:
    """Height of the ground: the plates', else of loaded points of application, else zero."""
    if results.recorded.plates:
        return float(np.mean([plate.corners @ up for plate in results.recorded.plates]))
    if results.dynamics.wrenches is not None and len(results.dynamics.wrenches.names):
        return tables.loaded_height(results.dynamics.wrenches, up)
    return 0.0


def _verdicts(prepared: Prepared) -> list[Verdict]:
    results = prepared.results
    motion = prepared.results.kinematics.motion
    tension = prepared.results.tension
    model = results.model
    torques = results.dynamics.torques
    wrenches = results.dynamics.wrenches
    rows: list[Verdict] = []
    if results.kinematics.fit is not None:
        rows += tables.marker_verdicts(results.kinematics.fit, prepared.scale)
    if results.kinematics.markers is not None:
        rows += tables.gap_verdicts(results.kinematics.markers)
    if model is not None and motion is not None and len(motion):
        rows += tables.range_verdicts(model, motion)
    # What contacts were solved for is still in the torques of inverse dynamics.
    judged = (
        not results.dynamics.root_note
        and results.contacts.forces is None
        and prepared.center_height > 0
    )
    if judged and model is not None and torques is not None and wrenches is not None:
        rows += tables.residual_verdicts(model, torques, wrenches, prepared.center_height)
    rows += contact_verdicts(results, prepared.center_height)
    if tension is not None:
        rows += _tension_verdicts(results, tension)
    return rows


def _tension_verdicts(results: ReportInput, tension: Tension) -> Iterator[Verdict]:
    model = results.model
    torques = results.dynamics.torques
    asked = tension.asked
    yield tables.counted_verdict(Quantity.NOT_OPTIMAL, ~tension.optimal[asked], tension.time[asked])
    if model is not None and torques is not None:
        names = results.reserve_coordinates
        reserves = Series(tension.time, names, tension.actuator_force[:, : len(names)])
        yield from tables.reserve_verdicts(model, torques, reserves, results.muscles.driven)
    if tension.options.has_passive or tension.overstretched:
        yield tables.stretch_verdict(
            tension.overstretched, len(tension.muscles), tension.large_passive
        )
    most = np.ones(len(tension.muscles))
    if model is not None:
        most = tables.largest_activations(model, tension.muscles)
    yield from tables.saturation_verdicts(tension.muscles, tension.activation, most, tension.time)

"""A trial computed anew with drawn errors: the same chain of steps on other inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
import scipy

from myomorph.body.tension.task import TensionTask
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.contact.site_motion import root_places, walked
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.cutoff_choice import recording_noise
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    KinematicsFit,
    poses_near,
    posture_of,
)
from myomorph.core.motion.sensors.mounting import (
    SensorMounting,
    SensorOptions,
    orientation_tasks,
    trunk_acceleration,
    weights_seen,
)
from myomorph.core.motion.sensors.sensor_fit import SensorFit
from myomorph.core.motion.sync import cut
from myomorph.core.motion.unseen import AssumedMode
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.joint_contact import JointPoints
from myomorph.core.tension.recruitment import KNEES, RecruitmentOptions
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.contacts import ContactOptions
from myomorph.lab.store.settings import Differentiation
from myomorph.lab.study.inputs.emg import RecordedEmg
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.refined import RefinedMotion
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.trial.default_filter import ChosenFilter, chosen_filter, cutoff_of
from myomorph.lab.study.trial.root_support import with_default_contacts
from myomorph.lab.study.trial.steps.drawn_quantities import (
    DrawnTable,
    TooWeak,
    WithoutErrors,
    muscle_quantities,
    series_table,
    torque_quantity,
)
from myomorph.lab.study.trial.steps.id import Torques, solve_dynamics
from myomorph.lab.study.trial.steps.ik import Poses, solve_kinematics
from myomorph.lab.study.trial.steps.tension import recruitment_of, task_of
from myomorph.lab.study.trial.trial_inputs import TrialInputs
from myomorph.lab.uncertainty import drawn_inputs
from myomorph.lab.uncertainty.bodies import Draw, drawn_subject, stronger
from myomorph.lab.uncertainty.sources import GROUPS, Sources

Held = TypeVar("Held", Markers, Motion)
FAILURES = (MyomorphError, ArithmeticError, ValueError, np.linalg.LinAlgError)
"""What a draw may end in that has no solution."""
MOVED = ("markers", "placement", "sensors", "untracked coordinates", "joints")
LOADED = ("forces", "masses", "filter")
"""Groups of sources that change the motion, and those that change the torques of the same motion.
"""
EXPONENTS = (1.5, 2.0, 3.0)
LOADS = (0.0, 1.0, 2.0)
"""Of the effort, as published, below and above the usual one; weights of joint loads over the
trial's.
"""
BESIDE = 1.0
"""Of a motion that was given, so much before and after the time that is used is drawn, for the
filter's sake [s].
"""
STRONGER = (1.4, 1.4, 1.4)
"""Factors by which all muscles of a body grow, one after the other, until it can do what was
recorded.
"""
POSES = 50.0
TENSIONS = 25.0  # Poses and tensions that are drawn a second.
COARSE = 4  # Of so many tensions one is drawn for contributions, which are means over all frames.


@dataclass(frozen=True)
class ShareDraw(Draw):
    """A draw that only contributions are computed from."""


@dataclass(frozen=True, eq=False)
class Chain:
    """What was computed of a trial without errors, and from what.

    `markers` that draws move are those recorded, else the model's own on the motion that was given,
    `base` what inverse kinematics makes of them; `modes`: how what it assumed of coordinates that
    no marker shows may differ, at the times of `recorded`; `residuals`: root mean square error of
    each marker in the recording [m]; `loads` on bodies, the `plates` that they are of, and
    `sensors` as recorded. Of so many frames (`*_step`) one is drawn: errors change slowly, and
    frames do not depend on each other. The second divides the third.
    """

    trial: TrialInputs
    recorded: Motion
    torques: Torques | None
    tense: bool
    markers: Markers | None
    base: Motion | None
    residuals: Mapping[str, float]
    loads: Wrenches | None
    plates: PlateForces | None = None
    sensors: SensorFit | None = None
    modes: tuple[AssumedMode, ...] = ()
    pose_step: int = 1
    torque_step: int = 1
    tension_step: int = 1

    @cached_property
    def without_errors(self) -> WithoutErrors:
        """What draws need of the tensions without errors."""
        assert self.torques is not None
        task = task_of(self.trial, self.recorded, every(self.tension_step, self.torques))
        return WithoutErrors.of(task)

    @cached_property
    def cutoff(self) -> float | None:
        """Of the low-pass filter [Hz], None for none."""
        return cutoff_of(self.trial, self.recorded)

    @cached_property
    def chosen(self) -> ChosenFilter | None:
        """The filter that the recording chose, None where it was stated."""
        return chosen_filter(self.trial, self.recorded)

    @cached_property
    def posture(self) -> Array | None:
        """Values that coordinates are weakly drawn to in every draw.

        They are (frames, coordinates) at the poses that are drawn; None where no markers are.
        """
        if self.markers is None or self.base is None:
            return None
        every_pose = slice(None, None, self.pose_step)
        near = Motion(self.markers.time[every_pose], self.base.names, self.base.values[every_pose])
        return posture_of(
            self.trial.model,
            self.markers.frames(every_pose),
            near,
            self.trial.options[InverseKinematicsOptions],
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of sources that can change a result."""
        marked = self.markers is not None and bool(self.markers.names)
        forced = self.torques is not None and self.trial.get(RecordedTorques) is None
        acting = {
            "placement": marked,
            "sensors": self.sensors is not None,
            "untracked coordinates": bool(self.modes),
            "joints": self.markers is not None or forced,
            "forces": forced and self.loads is not None,
            "masses": forced,
            "filter": forced,
            "joint contacts": self.tense and self.trial.get(JointPoints) is not None,
            "contacts": self.tense and self.trial.get(ContactPlan) is not None,
            "EMG": self.tense and self.trial.get(RecordedEmg) is not None,
        } | dict.fromkeys(("paths", "muscles", "criterion"), self.tense)
        return tuple(group for group in GROUPS if acting.get(group, True))

    def quantities(self) -> tuple[tuple[DrawnTable, DrawnTable], ...]:
        """Tables without errors, of all frames and of those that are drawn."""
        whole = self._made(self.trial, self.recorded, self.torques, 1)
        if self.tension_step == 1:
            return tuple((quantity, quantity) for quantity in whole)
        torques = None if self.torques is None else every(self.torque_step, self.torques)
        part = self._made(self.trial, self.recorded, torques, self.tension_step // self.torque_step)
        return tuple(zip(whole, part, strict=True))

    def drawn(self, draw: Draw) -> dict[str, Array]:
        """Compute values of all tables under a draw's errors at the drawn frames.

        Raises one of `FAILURES` for no solution.

        Parameters
        ----------
        draw : errors of the sources

        Returns
        -------
        (frames, names) by the name of the quantity
        """
        trial = drawn_trial(self, draw)
        sources = draw.sources
        moved = acts(sources, MOVED)
        recorded = self._moved(trial, draw) if moved else self.recorded
        torques = self.torques
        if torques is not None and (moved or acts(sources, LOADED)):
            torques = solve_dynamics(trial, recorded, self.torque_step)
        elif torques is not None:
            torques = every(self.torque_step, torques)
        step = self.tension_step // self.torque_step
        if isinstance(draw, ShareDraw) and self.tension_step > 1:
            step *= COARSE
        for more in STRONGER if self.tense else ():
            try:
                return {
                    quantity.name: quantity.values
                    for quantity in self._made(trial, recorded, torques, step, draw)
                }
            except TooWeak:
                trial = replace(trial, model=stronger(trial.model, more))
        return {
            quantity.name: quantity.values
            for quantity in self._made(trial, recorded, torques, step, draw)
        }

    def attempt(self, draw: Draw) -> dict[str, Array] | None:
        """Compute `drawn`, or say why it has no values.

        Parameters
        ----------
        draw : errors of the sources

        Returns
        -------
        as of `drawn`; None where the drawn trial has no solution, {} where its body is too weak for
        what was recorded
        """
        try:
            return self.drawn(draw)
        except TooWeak:
            return {}
        except FAILURES:
            return None

    def _moved(self, trial: TrialInputs, draw: Draw) -> Motion:
        """Return the motion that inverse kinematics finds under the errors of a draw."""
        if self.markers is None or self.base is None:
            noise = None
            if self.chosen is not None and self.cutoff is not None:
                noise = recording_noise(self.recorded, self.chosen.choice)
            return drawn_inputs.drawn_angles(trial.model, self.recorded, draw, noise)
        if self.cutoff is None:
            # What is not filtered holds no noise that a filter would take off.
            draw = replace(draw, sources=replace(draw.sources, marker_noise=0.0))
        every_pose = slice(None, None, self.pose_step)
        markers = self.markers.frames(every_pose)
        moved = drawn_inputs.drawn_markers(trial.model, markers, draw, self.residuals)
        near = Motion(markers.time, self.base.names, self.base.values[every_pose])
        options = trial.options[InverseKinematicsOptions]
        mounting = None if self.sensors is None else self._mounted(draw)
        if self.sensors is not None and mounting is not None:
            options = self._sensed(options, moved, mounting, draw)
        posture = None if mounting is not None else self.posture
        solved = poses_near(trial.model, moved, near, options, posture)
        if (
            self.sensors is not None
            and mounting is not None
            and not markers.names
            and root_places(trial.model)
        ):
            solved = walked(
                trial.model,
                solved,
                trunk_acceleration(trial.model, mounting, self.sensors.sensors, solved.time),
            )
            near = walked(
                trial.model,
                near,
                trunk_acceleration(
                    trial.model, self.sensors.mounting, self.sensors.sensors, near.time
                ),
            )
        errors = solved.values - near.values
        if self.pose_step > 1:
            known = np.isfinite(errors).all(axis=1)
            errors = scipy.interpolate.make_interp_spline(markers.time[known], errors[known])(
                self.recorded.time
            )
        errors = errors + drawn_inputs.drawn_unseen(self.modes, self.recorded.time, draw)
        return replace(self.recorded, values=self.recorded.values + errors)

    def _mounted(self, draw: Draw) -> SensorMounting:
        """Mounting and headings of the sensors under the errors of a draw."""
        assert self.sensors is not None
        mounting = self.sensors.mounting
        scale = draw.sources.sensor_mounting
        numbers = draw.normals.of(draw.number, "sensor mounting", "", mounting.factor.shape[1])
        return mounting.moved(scale * numbers) if scale else mounting

    def _sensed(
        self,
        options: InverseKinematicsOptions,
        markers: Markers,
        mounting: SensorMounting,
        draw: Draw,
    ) -> InverseKinematicsOptions:
        """Options of inverse kinematics with the sensors under the errors of a draw."""
        assert self.sensors is not None
        reported = mounting.body_rotations(self.sensors.sensors, markers.time, self.trial.model)
        reported = drawn_inputs.drawn_rotations(reported, mounting.sensors, markers.time, draw)
        seen = weights_seen(
            self.trial.model, markers, options.marker_weights, options.only_weighted
        )
        tasks = orientation_tasks(mounting, reported, seen, self.trial.options[SensorOptions])
        return drawn_inputs.drawn_places(
            self.sensors.added(options, tasks), self.sensors.spreads, draw
        )

    def _made(
        self,
        trial: TrialInputs,
        recorded: Motion,
        torques: Torques | None,
        step: int,
        draw: Draw | None = None,
    ) -> list[DrawnTable]:
        """All tables; tensions of every so manieth frame of the torques."""
        model = self.trial.model
        shown = recorded if trial.time is None else cut(recorded, *trial.time)
        made = [series_table(COORDINATE_VALUE, shown, model)]
        if torques is None:
            return made
        if self.trial.get(RecordedTorques) is None:
            made.append(torque_quantity(trial, torques))
        if self.tense:
            task = task_of(trial, recorded, every(step, torques))
            if draw is not None:
                task = _with_contacts(task, draw)
            made += muscle_quantities(trial, task, None if draw is None else self.without_errors)
        return made


def _with_contacts(task: TensionTask, draw: Draw) -> TensionTask:
    """Return a task with the errors of contacts whose forces are estimated."""
    if task.setting is None:
        return task
    contact_task = task.setting.task
    changed = replace(
        contact_task,
        sites=drawn_inputs.drawn_sites(contact_task.sites, draw),
        activations=drawn_inputs.drawn_activations(
            contact_task.activations, contact_task.sites, draw
        ),
    )
    return replace(task, setting=replace(task.setting, task=changed))


def every(step: int, torques: Torques) -> Torques:
    """Every so manieth frame of a motion with its torques and external forces."""
    some = slice(None, None, step)
    wrenches = None if torques.wrenches is None else torques.wrenches.frames(some)
    return Torques(torques.motion.frames(some), torques.torques.frames(some), wrenches)


def _supported(trial: TrialInputs, torques: Torques | None) -> TrialInputs:
    """Return the trial with contacts where forces do not carry the body, as its tensions have."""
    if torques is None:
        return trial
    return with_default_contacts(trial, torques.motion, torques.wrenches).trial


def chain_of(
    trial: TrialInputs, poses: Poses, torques: Torques | None, tense: bool, thin: bool
) -> Chain:
    """Return what a trial's results are drawn around.

    `thin`, at most `POSES` poses and `TENSIONS` tensions a second.
    """
    recorded = poses.recorded
    if trial.time is not None:
        recorded = cut(recorded, trial.time[0] - BESIDE, trial.time[1] + BESIDE)
    posed = _PosedMarkers()
    if poses.fit is not None:
        posed = _recorded_markers(trial, recorded)
    elif trial.model.markers:
        posed = _model_markers(trial, recorded)
    if torques is None and tense:
        torques = solve_dynamics(trial, recorded)
    trial = _supported(trial, torques if tense else None)
    external = trial.get(ExternalLoads)
    chain = Chain(
        trial=trial,
        recorded=recorded,
        torques=torques,
        tense=tense,
        markers=posed.markers,
        base=posed.base,
        residuals=posed.residuals,
        loads=None if external is None else external.of(recorded),
        plates=None if external is None else external.as_measured(recorded),
        sensors=posed.sensors,
        modes=posed.modes,
    )
    return _thinned(chain) if thin else chain


class _PosedMarkers(NamedTuple):
    """Markers that draws move, and the motion that follows from them, as `Chain` has them."""

    markers: Markers | None = None
    base: Motion | None = None
    residuals: Mapping[str, float] = FrozenMap({})
    sensors: SensorFit | None = None
    modes: tuple[AssumedMode, ...] = ()


def _recorded_markers(trial: TrialInputs, recorded: Motion) -> _PosedMarkers:
    """Fit the model to the recorded markers and sensors."""
    checked = solve_kinematics(trial)
    markers = checked.markers
    base = checked.fit.motion
    if trial.get(RefinedMotion) is not None:
        # Forces may be shorter than markers, and a refined motion is as long as both.
        span = float(recorded.time[0]), float(recorded.time[-1])
        markers = cut(markers, *span)
        base = cut(base, *span)
    errors = np.sqrt(np.nanmean(checked.fit.marker_error**2, axis=0))
    return _PosedMarkers(
        markers=markers,
        base=base,
        residuals=dict(zip(checked.fit.marker_names, errors.tolist(), strict=True)),
        sensors=checked.sensors,
        modes=_modes_at(checked.fit, recorded.time),
    )


def _model_markers(trial: TrialInputs, recorded: Motion) -> _PosedMarkers:
    """Put the model's own markers on a motion that was given."""
    markers = marker_positions(trial.model, recorded)
    near = whole(recorded, trial.model)
    options = trial.options[InverseKinematicsOptions]
    return _PosedMarkers(markers=markers, base=poses_near(trial.model, markers, near, options))


def _thinned(chain: Chain) -> Chain:
    """Draw one of several frames; contacts and elastic tendons tie frames to each other."""
    trial = chain.trial
    time = chain.recorded.time
    rate = 1.0 / float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    tied = trial.get(ContactPlan) is not None or trial.options[TensionOptions].tendons == "elastic"
    pose_step = max(1, int(rate / POSES))
    return replace(
        chain,
        pose_step=pose_step,
        torque_step=1 if tied else pose_step,
        tension_step=1 if tied else pose_step * max(1, int(rate / pose_step / TENSIONS)),
    )


def _modes_at(fit: KinematicsFit, time: Array) -> tuple[AssumedMode, ...]:
    """How what was assumed may differ, at other times (frames,) [s]."""
    clock = fit.motion.time

    def at(sizes: Array) -> Array:
        return np.asarray(np.interp(time, clock, sizes))

    return tuple(
        replace(mode, lasting=at(mode.lasting), changing=at(mode.changing)) for mode in fit.modes
    )


def whole(motion: Motion, model: Model) -> Motion:
    """Return a motion with all coordinates of the model, missing ones at their defaults."""
    return Motion(motion.time, model.coordinate_names, compile_tree(model).coordinates_of(motion))


def drawn_trial(chain: Chain, draw: Draw) -> TrialInputs:
    """Return a trial's inputs with the errors of a draw; markers and motion are drawn apart."""
    trial = chain.trial
    sources = draw.sources
    options = trial.options
    # As of the result: errors are not to choose a filter of their own.
    factor = draw.factor("filter_cutoff", "cutoff")
    chosen = None if chain.chosen is None else replace(chain.chosen, factor=factor)
    if chosen is None:
        cutoff = (chain.cutoff or 0.0) * factor
        options = options.having(replace(options[Differentiation], cutoff=cutoff))
    if sources.criterion:
        criterion = drawn_criterion(options[TensionOptions], draw)
        options = options.having(criterion, drawn_costs(recruitment_of(trial), draw))
        if (
            trial.get(ContactPlan) is not None
            and draw.normals.uniform(draw.number, "criterion", "contacts") > 0.5
        ):
            options = options.having(replace(options[ContactOptions], formulation="sequential"))
    model = drawn_subject(trial.model, draw)
    recorded = trial.get(RecordedEmg)
    return replace(trial, model=model, options=options).having(
        chosen,
        _drawn_points(trial.get(JointPoints), draw),
        _drawn_loads(chain, draw),
        None
        if recorded is None
        else replace(recorded, emg=drawn_inputs.drawn_emg(recorded.emg, draw)),
    )


def _drawn_loads(chain: Chain, draw: Draw) -> ExternalLoads | None:
    """Return external forces with errors, on bodies and as plates measured them.

    They are as recorded where the sources leave them so.
    """
    loads = chain.loads
    plates = chain.plates
    if loads is None or plates is None:
        return None
    external = chain.trial.inputs[ExternalLoads]
    if acts(draw.sources, ("forces",)):
        up = chain.trial.model.up
        loads = drawn_inputs.drawn_wrenches(loads, up, draw)
        plates = replace(plates, wrenches=drawn_inputs.drawn_wrenches(plates.wrenches, up, draw))
    return replace(external, measured=lambda motion: plates, on_bodies=lambda unused, motion: loads)


def _drawn_points(points: JointPoints | None, draw: Draw) -> JointPoints | None:
    """Contact points of joints that lie elsewhere."""
    if points is None or not draw.sources.joint_contact_point:
        return points
    moved = (
        replace(
            point,
            point=tuple(
                (
                    point.point + draw.of("joint_contact_point", f"{point.joint} {point.name}", 3)
                ).tolist()
            ),
        )
        for point in points.points
    )
    return replace(points, points=tuple(moved))


def drawn_criterion(options: TensionOptions, draw: Draw) -> TensionOptions:
    """Another effort that is least; of minmax nothing is drawn."""
    if options.recruitment == "minmax":
        return options
    exponent = EXPONENTS[
        int(len(EXPONENTS) * draw.normals.uniform(draw.number, "criterion", "exponent"))
    ]
    volume = draw.normals.uniform(draw.number, "criterion", "weights") > 0.5
    return replace(options, exponent=exponent, weights="volume" if volume else "equal")


def drawn_costs(costs: RecruitmentOptions, draw: Draw) -> RecruitmentOptions:
    """Another weight of joint loads, none among them."""
    share = LOADS[int(len(LOADS) * draw.normals.uniform(draw.number, "criterion", "joint load"))]
    joints = costs.joint_load_joints if share else KNEES
    return replace(costs, joint_load=share * (costs.joint_load or 0.0), joint_load_joints=joints)


def acts(sources: Sources, groups: tuple[str, ...]) -> bool:
    """Whether any source of some groups has a size."""
    return any(size for group in groups for size in sources.of(group).values())


def alone(sources: Sources, group: str) -> Sources:
    """Only the sources of one group."""
    return without(sources, *(other for other in GROUPS if other != group))


def without(sources: Sources, *groups: str) -> Sources:
    """All sources but those of some groups."""
    return replace(sources, **{name: 0.0 for group in groups for name in GROUPS[group]})

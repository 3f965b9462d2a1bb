"""The tensions of one recording as a whole: contacts and EMG, the problem, and warnings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial, held_out_line
from myomorph.core.model.causes import EMG, SETTINGS
from myomorph.core.model.contacts import ContactForces
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Emg, Motion, Series, Table, Wrenches
from myomorph.core.motion.emg_activation import EmgCalibration
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.certificates import (
    CertificateOptions,
    ContactIntervals,
    contact_intervals,
)
from myomorph.core.tension.contact_setting import (
    ContactSetting,
    Measurements,
    all_loads,
    set_contacts,
)
from myomorph.core.tension.emg_conflicts import EmgConflict, emg_conflicts
from myomorph.core.tension.emg_targets import EmgOptions, emg_targets
from myomorph.core.tension.joint_contact import (
    JointContactForces,
    JointPoints,
    pointed_joints,
    shared_reactions,
)
from myomorph.core.tension.problem import TensionInputs
from myomorph.core.tension.reaction import JointReactions, joint_reactions
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    RecruitmentOptions,
    recruitment_terms,
)
from myomorph.core.tension.relaxation import Relaxation, relaxations
from myomorph.core.tension.solve import (
    ContactSolution,
    solve_contacts,
    solve_tension,
    with_contacts,
)
from myomorph.core.tension.static_loads import StaticLoads, static_joint_loads
from myomorph.core.tension.tension import Tension, TensionOptions, passive_notes
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.core.tension.terms.term import Term

if TYPE_CHECKING:
    from myomorph.core.contact.plan import ContactPlan

OBJECT_RESIDUAL = 0.01
"""Optimal force of what holds an object beside its contacts, as a share of that of a body's
residuals.
"""
AT_ONCE = 8
"""Number of instants between two reports of progress."""
LARGE = 250
"""Number of muscles from which on solutions near the optimum are not asked for: they take seconds
per instant there.
"""


@dataclass(frozen=True, eq=False)
class EmgRecording:
    """EMG that takes part in the tensions.

    Attributes
    ----------
    emg : envelopes of the channels
    muscles : channel to the muscles it was measured on
    maxima : envelope of channels in maximum voluntary contractions
    options : how EMG takes part
    calibration : delays and gains from elsewhere, as of all trials of a subject; None finds them on
        this recording
    """

    emg: Emg
    muscles: Mapping[str, tuple[str, ...]]
    maxima: Mapping[str, float]
    options: EmgOptions
    calibration: EmgCalibration | None = None


@dataclass(frozen=True, eq=False)
class EmgTargets:
    """Activations that EMG shows in a recording.

    Attributes
    ----------
    target : None where no channel is of a muscle, or channels disagree
    calibration : delays and gains; None where no channel is of a muscle
    notes : on channels that take no part, one line each
    """

    target: EmgTarget | None
    calibration: EmgCalibration | None
    notes: tuple[Message, ...] = ()

    def conflicts(self, model: Model, tension: Tension) -> tuple[EmgConflict, ...]:
        """Find stretches in which EMG and torques contradict each other."""
        return () if self.target is None else emg_conflicts(model, tension, self.target)


@dataclass(frozen=True, eq=False)
class ContactWarnings:
    """Warnings about the contact forces of a solution.

    Attributes
    ----------
    intervals : what the data leave open, None where no instant was asked for
    infeasible : frames whose contacts cannot carry the motion
    """

    intervals: ContactIntervals | None
    infeasible: tuple[Relaxation, ...]

    def table(self) -> Table:
        """Contact forces with what the data leave open [N].

        Columns are `<group>_fx`, `<group>_fx_low`, `<group>_fx_high`, ...
        """
        intervals = self.intervals
        assert intervals is not None
        names = tuple(
            f"{group}_f{axis}{ending}"
            for group in intervals.groups
            for axis in "xyz"
            for ending in ("", "_low", "_high")
        )
        values = np.stack([intervals.forces, intervals.low, intervals.high], axis=3)
        return Table(
            intervals.time,
            names,
            values.reshape(len(intervals), -1),
            facts=FrozenMap({"name": "Undetermined parts of contact forces"}),
        )


@dataclass(frozen=True, eq=False)
class TensionTask:
    """The tension problem of a recording.

    Attributes
    ----------
    model : of the body
    motion : coordinates over time
    torques : of those external forces alone that are known exactly [N m or N]
    options : settings
    actuators : beside the model's own
    setting : contacts, where their forces are asked for
    emg : what EMG shows, where it takes part
    wrenches : external forces that act as they were measured, at the motion's times
    terms : further costs
    recruitment : costs that need all joint torques, which are known only once contact forces are;
        None for none
    """

    model: Model
    motion: Motion
    torques: Series
    options: TensionOptions
    actuators: tuple[Actuator, ...]
    setting: ContactSetting | None
    emg: EmgTargets | None
    wrenches: Wrenches | None
    terms: tuple[Term, ...] = ()
    recruitment: RecruitmentOptions | None = None

    def solved(self, advance: Callable[[int], None]) -> tuple[Tension, ContactSolution | None]:
        """Solve for the tensions.

        With contacts, joint loads and co-contraction are costs of the tensions under the contact
        forces.

        Parameters
        ----------
        advance : called with the number of frames just done

        Returns
        -------
        the tensions, and the problem that contact forces come from, where it can be asked what it
        leaves open of them
        """
        tension, solution = self._solved(advance)
        if self.recruitment is None:
            return tension, solution
        loads, carried = self.loads(tension)
        terms = recruitment_terms(self.model, self.motion, carried, loads, self.recruitment)
        emg = None if self.emg is None else self.emg.target
        again = solve_tension(
            self.model,
            self.motion,
            carried,
            self.options,
            self.actuators,
            emg=emg,
            recruitment=EFFORT_ALONE,
            terms=terms,
        )
        return with_contacts(again, tension), solution

    def _solved(self, advance: Callable[[int], None]) -> tuple[Tension, ContactSolution | None]:
        """Solve without the costs that need contact forces first."""
        inputs = TensionInputs(
            model=self.model,
            motion=self.motion,
            torques=self.torques,
            options=self.options,
            actuators=self.actuators,
            contacts=None if self.setting is None else self.setting.task,
            emg=None if self.emg is None else self.emg.target,
            terms=self.terms,
        )
        if self._can_be_asked(inputs.contacts):
            return solve_contacts(inputs, advance)
        tension = solve_tension(
            inputs.model,
            inputs.motion,
            inputs.torques,
            inputs.options,
            inputs.actuators,
            advance,
            contacts=inputs.contacts,
            emg=inputs.emg,
            recruitment=EFFORT_ALONE,
            terms=inputs.terms,
        )
        return tension, None

    def _can_be_asked(self, contacts: ContactTask | None) -> bool:
        """Tell whether the problem can be asked what it leaves open of contact forces.

        That is asked of the power criterion and rigid tendons alone.
        """
        if contacts is None or contacts.options.formulation == "sequential":
            return False
        return self.options.tendons == "rigid" and self.options.recruitment != "minmax"

    def notes(self, tension: Tension) -> tuple[Message, ...]:
        """Say what a reader of the solution has to know, one line each."""
        notes = passive_notes(tension)
        if self.setting is not None and self.options.recruitment == "minmax":
            notes += (
                SETTINGS.message(
                    "recruitment minmax: no intervals of the contact forces, and no list of"
                    " contacts that cannot carry"
                ),
            )
        return notes

    def joint_loads(
        self, tension: Tension, frame: str, points: JointPoints | None
    ) -> tuple[JointReactions | None, JointContactForces | None]:
        """Find the loads of all joints, and forces at contact points.

        Parameters
        ----------
        tension : of this problem
        frame : whose axes the loads are in, see `joint_reactions`; "none" for no loads
        points : where surfaces touch, None for nowhere

        Returns
        -------
        forces [N] and moments [N m] over time, None of what is not asked for
        """
        every = () if frame == "none" else tuple(joint.name for joint in self.model.joints)
        pointed = () if points is None else pointed_joints(self.model, points.points)
        if not every and not pointed:
            return None, None
        found = joint_reactions(
            self.model,
            self.motion,
            tension,
            self.wrenches,
            (*every, *pointed),
            frame=(*(frame for _ in every), *("ground" for _ in pointed)),
            actuators=self.actuators,
        )
        contacts = None
        if points is not None:
            of_points = found.part(slice(len(every), None))
            contacts = shared_reactions(self.model, self.motion, of_points, points.points)
        return found.part(slice(0, len(every))) if every else None, contacts

    def static_loads(self, tension: Tension) -> StaticLoads | None:
        """Find the forces of knees and ankles that statics allow.

        Parameters
        ----------
        tension : of this problem; its contact forces count

        Returns
        -------
        forces over time [N], None where external forces are not known
        """
        wrenches = self.wrenches
        if tension.contacts is not None:
            wrenches = self.loads(tension)[0]
        if wrenches is None:
            return None
        return static_joint_loads(self.model, self.motion, wrenches)

    def contact_forces(self, tension: Tension) -> ContactForces:
        """Find the forces at all contact sites: those estimated, of impacts, and alone on plates.

        Parameters
        ----------
        tension : with contacts

        Returns
        -------
        over time [N]
        """
        assert self.setting is not None
        assert tension.contacts is not None
        return self.setting.with_known(tension.contacts)

    def contact_groups(self, tension: Tension) -> Table:
        """Sum the forces of every contact over its sites, on the body in ground [N].

        Columns are `<group>_fx`, `_fy`, `_fz`, `_f`.

        Parameters
        ----------
        tension : with contacts

        Returns
        -------
        one row for each frame
        """
        shown = self.contact_forces(tension)
        sites = shown.sites
        forces = shown.contact_force
        groups = tuple(dict.fromkeys(site.group for site in sites))
        sums = np.stack(
            [forces[:, [site.group == name for site in sites]].sum(axis=1) for name in groups],
            axis=1,
        )
        values = np.concatenate([sums, np.linalg.norm(sums, axis=2, keepdims=True)], axis=2)
        names = tuple(f"{name}_{end}" for name in groups for end in ("fx", "fy", "fz", "f"))
        facts = FrozenMap({"name": "Forces of contacts"})
        return Table(tension.time, names, values.reshape(len(values), -1), facts=facts)

    def loads(self, tension: Tension) -> tuple[Wrenches, Series]:
        """Join measured forces with estimated ones, and find the torques that they leave.

        Parameters
        ----------
        tension : with contacts

        Returns
        -------
        all external forces, and the torques under them [N m or N]
        """
        assert self.setting is not None
        assert tension.contacts is not None
        loads = all_loads(self.setting.exact, tension.contacts)
        return loads, inverse_dynamics(self.model, self.motion, loads)


def tension_task(  # page: what a recording has, most of it optional
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions,
    actuators: tuple[Actuator, ...],
    measured: Measurements,
    plan: ContactPlan | None = None,
    contact_options: ContactOptions | None = None,
    emg: EmgRecording | None = None,
    recruitment: RecruitmentOptions | None = None,
) -> TensionTask:
    """Set up the tension problem of a recording.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    torques : of the measured external forces (frames, coordinates) [N m or N]
    options : settings
    actuators : beside the model's own
    measured : forces of plates, at the motion's times
    plan : contacts whose forces are to be estimated, None for none
    contact_options : how contact forces are chosen
    emg : EMG that takes part, None for none
    recruitment : costs beside the effort, None for none
    """
    setting = None
    wrenches = measured.wrenches
    if plan is not None:
        setting = set_contacts(plan, model, motion, measured, contact_options or ContactOptions())
        if setting.exact is not wrenches:
            wrenches = setting.exact
            torques = inverse_dynamics(model, motion, wrenches)
    targets = None
    if emg is not None:
        inputs = TensionInputs(
            model=model,
            motion=motion,
            torques=torques,
            options=options,
            actuators=actuators,
            contacts=None if setting is None else setting.task,
        )
        targets = emg_targets_of(emg, inputs)
    wanted = recruitment is not None and recruitment.has_costs
    terms: tuple[Term, ...] = ()
    if recruitment is not None and wanted and plan is None:
        terms = recruitment_terms(model, motion, torques, wrenches, recruitment)
    return TensionTask(
        model=model,
        motion=motion,
        torques=torques,
        options=options,
        actuators=actuators,
        setting=setting,
        emg=targets,
        wrenches=wrenches,
        terms=terms,
        recruitment=recruitment if wanted and plan is not None else None,
    )


def emg_targets_of(recorded: EmgRecording, inputs: TensionInputs) -> EmgTargets:
    """Make targets of activations, with delay and gains of this recording (`calibrate_emg`).

    Parameters
    ----------
    recorded : EMG
    inputs : the tension problem without EMG

    Returns
    -------
    targets, and notes on channels that take no part
    """
    muscles = recorded.muscles
    options = recorded.options
    if not muscles:
        names = ", ".join(recorded.emg.names)
        note = EMG.message(
            "EMG is not used: no channel's name contains a muscle; name them in emg_muscles"
            f" ({names})"
        )
        return EmgTargets(None, None, (note,))
    calibration = recorded.calibration
    if calibration is None:
        calibration = _calibrated(recorded, inputs)
    # Gains of all trials may lack a channel that is noise, or absent, in another trial.
    missing = [name for name in muscles if name not in calibration.channels]
    notes: tuple[Message, ...] = ()
    if missing:
        notes = (EMG.message(f"EMG of {', '.join(missing)} is not used: its gains were not found"),)
    known = {name: muscle for name, muscle in muscles.items() if name in calibration.channels}
    target = emg_targets(
        recorded.emg, known or muscles, inputs.model, inputs.motion.time, options, calibration
    )
    return EmgTargets(
        target=target if target.weight or options.mode == "driven" else None,
        calibration=calibration,
        notes=(*notes, *held_out_line(calibration), *calibration.warnings),
    )


def _calibrated(recorded: EmgRecording, inputs: TensionInputs) -> EmgCalibration:
    """Find delays and gains on the recording itself."""
    trial = EmgTrial(
        motion=inputs.motion,
        torques=inputs.torques,
        emg=recorded.emg,
        contacts=inputs.contacts,
    )
    muscles = recorded.muscles
    maxima = {name: maximum for name, maximum in recorded.maxima.items() if name in muscles}
    return calibrate_emg(
        inputs.model,
        [trial],
        muscles,
        recorded.options,
        inputs.options,
        inputs.actuators,
        maxima,
    )


def added_reserves(
    model: Model, options: TensionOptions, objects: Collection[str] = ()
) -> tuple[Actuator, ...]:
    """Add a weak reserve to every free coordinate.

    What holds an object is weaker still: nothing but its contacts does.

    Parameters
    ----------
    model : of the body
    options : settings
    objects : names of their bodies

    Returns
    -------
    one for each coordinate, as `default_reserves`
    """
    reserves = default_reserves(model, options.reserve, options.residual)
    return tuple(
        replace(reserve, optimal_force=OBJECT_RESIDUAL * reserve.optimal_force)
        if reserve.body in objects
        else reserve
        for reserve in reserves
    )


def contact_warnings(
    solution: ContactSolution, frames: Sequence[int], advance: Callable[[int], None]
) -> ContactWarnings:
    """Find what the data leave open at some instants, and frames that contacts do not carry.

    Parameters
    ----------
    solution : the problem with contacts, and its result
    frames : numbers of the instants
    advance : called with the number of instants just done

    Returns
    -------
    intervals of the contact forces [N], and infeasible frames
    """
    options = CertificateOptions(
        near=CertificateOptions.near if len(solution.tension.muscles) <= LARGE else 0.0
    )
    intervals = contact_intervals(*solution, frames, options, advance, AT_ONCE) if frames else None
    return ContactWarnings(intervals, relaxations(*solution))


def evenly_spaced(count: int, frames: int) -> list[int]:
    """Choose at most so many frames, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, frames - 1, min(count, frames)).round().astype(int)).tolist()

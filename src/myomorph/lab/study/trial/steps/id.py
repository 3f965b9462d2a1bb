"""Inverse dynamics of a trial: the generalized force of every coordinate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.io.sto import write_sto
from myomorph.core.model.causes import FILTER, SETTINGS
from myomorph.core.model.findings import messages_of_findings
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.motion_errors import MotionErrors
from myomorph.core.model.series import Motion, Series, Table, Wrenches
from myomorph.core.model.series_quantities import (
    COORDINATE_UNIT,
    FILTERED_MOTION,
    FORCE_TIME,
    MEASURED_VERTICAL_FORCE,
    MOTION_ERRORS,
    WRENCHES,
)
from myomorph.core.model.severity import severity_of
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.sync import cut, resample_wrenches, torques_at
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.loops import closed_motion, loop_torques
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.lab.report.trial.report_input import Dynamics, ReportInput
from myomorph.lab.report.trial.summary_lines import dynamics_line
from myomorph.lab.report.trial.tables import residuals
from myomorph.lab.store import stored as store
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.quantities import get_value, put_value
from myomorph.lab.store.quantity_files import quantity_table
from myomorph.lab.store.results import Stored, get_findings, put_findings
from myomorph.lab.store.settings import Differentiation, ForceOptions, TorqueTable
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.reading import has_mass
from myomorph.lab.study.inputs.refined import RefinedMotion
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.step.step import Step, StepCommand, StepOutput
from myomorph.lab.study.trial.default_filter import (
    Differentiated,
    chosen_filter,
    cutoff_of,
    differentiated,
    filter_key,
)
from myomorph.lab.study.trial.measured_force import put_measured, vertical_forces
from myomorph.lab.study.trial.steps.ik import Poses
from myomorph.lab.study.trial.trial_inputs import (
    Signals,
    TrialInputs,
    Value,
    tidy_signals,
)

if TYPE_CHECKING:
    from myomorph.lab.study.trial.trial_strides import TrialStrides


FINDINGS = "force_findings"  # Findings about external forces in a result file.


MAX_EFFECT = 0.25
"""Change of the largest joint torque by a filter at twice the automatic cutoff, from which noise
may make it.
"""


@dataclass(frozen=True, kw_only=True)
class FilterEffect:
    """Relative change of the largest joint torque when a motion is filtered at another cutoff.

    Attributes
    ----------
    half : at half the automatic cutoff
    double : at twice the automatic cutoff
    """

    half: float
    double: float


@dataclass(frozen=True, eq=False)
class Torques:
    """Generalized forces of a motion.

    Attributes
    ----------
    motion : with derivatives, filtered where requested
    torques : (frames, coordinates) [N m or N]
    wrenches : external forces at its times, as measured
    notes : what was done, one line each
    filter_effect : what an automatic cutoff decides, None where that was not examined
    errors : that the filter leaves in the motion, None where they are not known
    """

    motion: Motion
    torques: Series
    wrenches: Wrenches | None
    notes: tuple[Message, ...] = ()
    filter_effect: FilterEffect | None = None
    errors: MotionErrors | None = None


def filter_summary(trial: TrialInputs, recorded: Motion, dynamics: Torques | None = None) -> str:
    """Return what the motion was filtered with where none was specified, as the end of a line.

    It also says what depends on that.
    """
    if trial.options[Differentiation].cutoff is not None:
        return ""
    chosen = chosen_filter(trial, recorded)
    if chosen is None or chosen.cutoff is None:
        return "; smooth motion, not filtered"
    cutoff = chosen.cutoff
    effect = "automatic"
    if chosen.choice.origin != "noise":
        effect += f", {chosen.choice.sentence}"
    if dynamics is not None and dynamics.filter_effect is not None:
        changed = dynamics.filter_effect
        effect += (
            f"; largest joint torque {round(100 * changed.half):+d} % at half of it,"
            f" {round(100 * changed.double):+d} % at double"
        )
    return f"; low-pass filter at {cutoff:.3g} Hz ({effect})"


def filter_effect(trial: TrialInputs, recorded: Motion, dynamics: Torques) -> FilterEffect | None:
    """Relative changes of the largest torque of a joint by half and double of an automatic cutoff.

    Returns
    -------
    None where the cutoff was given, the motion is not filtered, or the torques were recorded
    """
    chosen = chosen_filter(trial, recorded)
    if chosen is None or chosen.cutoff is None or trial.get(RecordedTorques) is not None:
        return None
    largest = _largest_joint_torque(trial.model, dynamics.torques)
    changes = []
    for factor in (0.5, 2.0):
        other = trial.having(replace(chosen, factor=factor * chosen.factor))
        torques = solve_dynamics(other, recorded).torques
        value = _largest_joint_torque(trial.model, torques)
        changes.append(value / largest - 1.0 if largest > 0.0 else 0.0)
    half, double = changes
    return FilterEffect(half=half, double=double)


def _largest_joint_torque(model: Model, torques: Series) -> float:
    """Largest magnitude [N m] over all frames and rotations that are not of a free root."""
    root = floating_coordinates(model)
    turning = [
        coordinate.motion == "rotational" and coordinate.name not in root
        for coordinate in model.coordinates
    ]
    return float(np.nanmax(np.abs(torques.values[:, turning]), initial=0.0))


def with_derivatives(trial: TrialInputs, recorded: Motion) -> Differentiated:
    """Return the motion with velocities and accelerations, and notes.

    It is cut to the time that is used, with closed loops closed. Where soft tissue is known, it is
    that of the body's mass; a refined motion is that already. Derivatives are taken of all frames
    first, as OpenSim does, so the cut leaves no edges; those of a body that turns over, in angles
    that do not jump (`root_chart`).
    """
    whole = differentiated(trial, recorded)
    motion = whole.motion
    tissue = trial.get(SoftTissue)
    if tissue is not None and trial.get(RefinedMotion) is None:
        motion = tissue.of(motion)
    used = motion if trial.time is None else cut(motion, *trial.time)
    closed, notes = closed_motion(trial.model, used)
    errors = None if whole.errors is None else whole.errors.at(closed.time)
    return Differentiated(motion=closed, errors=errors, notes=(*whole.notes, *notes))


def solve_dynamics(trial: TrialInputs, recorded: Motion, step: int = 1) -> Torques:
    """Solve inverse dynamics of one in `step` frames, forces filtered as the motion.

    Torques that a file gives take the place of the solution.
    """
    recorded_torques = trial.get(RecordedTorques)
    loads = trial.get(ExternalLoads)
    if recorded_torques is not None:
        whole = with_derivatives(trial, recorded)
        motion = whole.motion.frames(slice(None, None, step))
        notes = (
            *whole.notes,
            SETTINGS.message(
                "joint torques are those of the file that was given: no inverse dynamics was"
                " computed"
            ),
        )
        return Torques(
            motion=motion,
            torques=torques_at(recorded_torques.torques, motion),
            wrenches=None,
            notes=notes,
        )
    has_mass(trial.model, "inverse dynamics")
    whole = with_derivatives(trial, recorded)
    motion = whole.motion.frames(slice(None, None, step))
    notes = whole.notes
    wrenches = None
    if loads is not None:
        cutoff = cutoff_of(trial, recorded)
        wrenches = resample_wrenches(loads.of(recorded), motion.time, cutoff)
        notes = (*wrenches.notes, *notes)
    return Torques(
        motion=motion,
        torques=inverse_dynamics(trial.model, motion, wrenches),
        wrenches=wrenches,
        notes=notes,
        errors=None if whole.errors is None else whole.errors.at(motion.time),
    )


def put_dynamics(output: StepOutput, torques: Torques, model: Model) -> None:
    """Write a motion with its derivatives, generalized and external forces into a file.

    Findings about these are written, too.
    """
    if torques.wrenches is not None and torques.wrenches.findings:
        put_findings(output.writer, FINDINGS, torques.wrenches.findings)
    store.put_derivatives(output.writer, torques.motion, model)
    if torques.errors is not None:
        put_value(output.writer, torques.errors)
    store.put_torques(output.writer, torques.torques, torques.wrenches)


def shown_torques(trial: TrialInputs, result: Torques) -> Series:
    """Return the torques of the table of inverse dynamics: all, or those its options leave."""
    torques = result.torques
    options = trial.options[TorqueTable]
    if options.net:
        from myomorph.core.muscles.passive import passive_generalized_forces

        passive = passive_generalized_forces(trial.model, result.motion).values
        torques = replace(torques, values=torques.values - passive)
    if options.independent_coordinates:
        torques = loop_torques(trial.model, result.motion, torques).torques
    return torques


def torque_table(torques: Series, model: Model) -> Table:
    """Return generalized forces under the names of OpenSim's inverse dynamics.

    Such names are `hip_flexion_r_moment`, `pelvis_tx_force`.
    """
    return quantity_table(replace(torques, quantity=GENERALIZED_FORCE), model)


def _run(trial: TrialInputs, output: StepOutput, poses: Poses) -> Torques:
    dynamics = solve_dynamics(trial, poses.recorded)
    put_measured(trial, poses.recorded, output)
    effect = filter_effect(trial, poses.recorded, dynamics)
    dynamics = replace(dynamics, filter_effect=effect)
    if effect is not None and abs(effect.double) > MAX_EFFECT:
        change = 100.0 * effect.double
        text = FILTER.message(
            f"double the automatic cutoff changes the largest joint torque by {change:+.0f} %: see"
            " --cutoff",
            size=change,
            severity=severity_of(change, 100.0 * MAX_EFFECT),
        )
        dynamics = replace(dynamics, notes=(*dynamics.notes, text))
    write_sto(
        torque_table(shown_torques(trial, dynamics), trial.model),
        output.folder / GENERALIZED_FORCE.file,
    )
    put_dynamics(output, dynamics, trial.model)
    return dynamics


def _hashed(trial: TrialInputs) -> Sequence[object]:
    """Return what is done with forces where it is not the default.

    The default does not count: results from before there were checks still hold.
    """
    options = trial.options
    forces = options[ForceOptions]
    return (
        options[Differentiation],
        options[TorqueTable],
        *(() if forces == ForceOptions() else (forces,)),
        *filter_key(trial),
    )


def _read(stored: Stored, options: OptionSet) -> Torques | None:
    motion = store.get_derivatives(stored)
    torques = store.get_torques(stored)
    if motion is None or torques is None:
        return None
    return Torques(
        motion=motion,
        torques=torques,
        wrenches=_checked_wrenches(stored),
        errors=get_value(stored, MotionErrors),
    )


def _checked_wrenches(stored: Stored) -> Wrenches | None:
    """External forces of a result with what checks found of them, or None."""
    wrenches = store.get_wrenches(stored)
    if wrenches is None:
        return None
    return replace(wrenches, findings=get_findings(stored, FINDINGS))


def _show(report_input: ReportInput, stored: Stored) -> ReportInput:
    report_input = report_input.with_warnings(messages_of_findings(get_findings(stored, FINDINGS)))
    errors = get_value(stored, MotionErrors)
    dynamics = Dynamics(
        torques=store.get_torques(stored),
        wrenches=_checked_wrenches(stored),
        root_note=stored.facts.get("root_note", ""),
        motion=store.get_derivatives(stored),
        measured=store.get_measured_force(stored),
        less_sure=() if errors is None else errors.less_sure,
    )
    return replace(report_input, dynamics=dynamics)


def _signals(stored: Stored, model: Model, mass: float) -> Sequence[Signals]:
    """Torques, named as OpenSim names them, and vertical forces on each body."""
    torques = store.get_torques(stored)
    signals = []
    if torques is not None:
        made = tidy_signals("id", torques, model)
        if mass > 0.0:
            curve = made.curve.replace("N·m", "N·m/kg")
            made = replace(made, curve=curve, factor=made.factor / mass)
        signals.append(made)
    return *signals, *_ground_forces(stored, model)


def _ground_forces(stored: Stored, model: Model) -> Sequence[Signals]:
    """Vertical force on each body as measured; as filtered in results without it, of older runs."""
    measured = store.get_measured_force(stored)
    wrenches = store.get_wrenches(stored)
    series = measured
    if series is None and wrenches is not None:
        series = vertical_forces(wrenches, model)
    if series is None or not len(series.names) or not model.weight > 0.0:
        return ()
    count = len(series.names)
    return (
        Signals(
            step="id",
            series=series,
            endings=("_vertical_force",) * count,
            units=("N",) * count,
            statistics=("maximum", "mean"),
            curve="vertical force [body weight]",
            factor=np.full(count, 1.0) / model.weight,
            drawn=tuple(range(count)),
            as_measured=measured is not None,
        ),
    )


def _numbers(stored: Stored, model: Model, strides: TrialStrides | None) -> Iterator[Value]:
    """Residuals at a free root."""
    torques = store.get_torques(stored)
    root = None if torques is None else residuals(model, torques)
    for name, values, unit in zip(("force", "moment"), root or (), ("N", "N m"), strict=False):
        yield Value(
            step="id",
            quantity=f"residual {name}, largest",
            value=float(np.nanmax(values)),
            unit=unit,
        )
        yield Value(
            step="id",
            quantity=f"residual {name}, RMS",
            value=float(np.sqrt(np.nanmean(values**2))),
            unit=unit,
        )


def _outcome(outcome: Outcome, torques: Torques) -> Outcome:
    """Return the outcome with what checks of external forces found."""
    wrenches = torques.wrenches
    texts = () if wrenches is None else messages_of_findings(wrenches.findings)
    return replace(outcome, findings=(*outcome.findings, *texts))


def _line(trial: TrialInputs, results: ByType) -> str:
    """Frames, residuals of the root, and the filter."""
    found = results[Torques]
    count = 0 if found.wrenches is None else len(found.wrenches.names)
    text = (
        f"{len(found.torques)} frames, {len(found.torques.names)} coordinates, {count} external"
        " forces"
    )
    residual = dynamics_line(trial.model, found.motion, found.torques, found.wrenches)
    return (
        text
        + (f"; {residual}" if residual else "")
        + filter_summary(trial, results[Poses].recorded, found)
    )


STEP = Step(
    name="id",
    title="inverse dynamics",
    gives=Torques,
    quantities=(
        *(*FILTERED_MOTION, *MOTION_ERRORS, COORDINATE_UNIT, GENERALIZED_FORCE, *WRENCHES),
        *(FORCE_TIME, MEASURED_VERTICAL_FORCE),
    ),
    needs=(Poses,),
    options=(Differentiation, ForceOptions, TorqueTable),
    inputs=("loads", "laboratory", "soft tissue", "time"),
    hashed=_hashed,
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
    numbers=_numbers,
    outcome=_outcome,
    outcome_variables=(
        *(
            "time",
            "coordinate",
            "coordinate_filtered",
            "generalized_force",
            "axis",
            "external_force",
        ),
        *(
            "external_force_body",
            "external_force_vector",
            "external_force_point",
            "external_free_torque",
        ),
    ),
    command=StepCommand(_line, GENERALIZED_FORCE.file, draws=True),
)

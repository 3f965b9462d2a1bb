"""A step that the package does not have: the power of every joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.io.sto import write_sto
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series, Table
from myomorph.lab.report.page.parts import Grid, Section
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.store.results import Stored
from myomorph.lab.study.inputs.input import OptionSet
from myomorph.lab.study.step.step import Step, StepOutput
from myomorph.lab.study.trial.steps.id import Torques
from myomorph.lab.study.trial.trial_inputs import Signals, TrialInputs, all_drawn


@dataclass(frozen=True)
class PowerOptions:
    """What joint power counts.

    Attributes
    ----------
    generated : only the power that the joints generate; what they absorb counts as zero
    """

    generated: bool = False


@dataclass(frozen=True, eq=False)
class Power:
    """Power of every coordinate (frames, coordinates) [W]."""

    power: Series


def _run(trial: TrialInputs, output: StepOutput, torques: Torques) -> Power:
    values = torques.torques.values * torques.motion.velocities
    if trial.options[PowerOptions].generated:
        values = np.maximum(values, 0.0)
    found = Series(torques.torques.time, torques.torques.names, values)
    output.writer.time(found.time)
    output.writer.names("coordinate", found.names)
    output.writer.put(
        "joint_power", ("time", "coordinate"), values, "W", "power of the generalized force"
    )
    write_sto(Table(found.time, found.names, values), output.folder / "joint_power.sto")
    return Power(found)


def _read(stored: Stored, options: OptionSet) -> Power | None:
    values = stored.values.get("joint_power")
    return (
        None if values is None else Power(Series(stored.time, stored.names["coordinate"], values))
    )


def _show(given: ReportInput, stored: Stored) -> ReportInput:
    found = _read(stored, OptionSet())
    if found is None:
        return given
    peaks = np.nanmax(np.abs(found.power.values), axis=0)
    rows = tuple(
        (name, f"{peak:.1f} W") for name, peak in zip(found.power.names, peaks, strict=True)
    )
    section = Section("power", "Joint power", grids=(Grid(("Coordinate", "Peak"), rows),))
    return replace(given, more=(*given.more, section))


def _signals(stored: Stored, model: Model, mass: float) -> tuple[Signals, ...]:
    found = _read(stored, OptionSet())
    if found is None:
        return ()
    return (all_drawn("power", found.power, "_power", "W", ("maximum", "mean"), "joint power [W]"),)


STEP = Step(
    name="power",
    title="joint power",
    gives=Power,
    needs=(Torques,),
    options=(PowerOptions,),
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
)

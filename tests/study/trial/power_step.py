"""A step and a quantity that the package does not have: the power of every joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.quantity import Quantity, Tidy
from myomorph.lab.report.page.parts import Grid, Section
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.store.quantities import get_value
from myomorph.lab.store.results import Stored
from myomorph.lab.study.step.step import Step, StepOutput
from myomorph.lab.study.trial.steps.id import Torques
from myomorph.lab.study.trial.trial_inputs import TrialInputs

JOINT_POWER = Quantity(
    name="joint_power",
    dims=("time", "coordinate"),
    unit="W",
    meaning="power of the generalized force",
    file="joint_power.sto",
    tidy=Tidy(
        statistics=("maximum", "mean"), endings=("_power",), curve="joint power", curve_unit="W"
    ),
)


@dataclass(frozen=True)
class PowerOptions:
    """What joint power counts.

    Attributes
    ----------
    generated : only the power that the joints generate; what they absorb counts as zero
    """

    generated: bool = False


@read_only
class Power(Labelled):
    """Power of every coordinate.

    Attributes
    ----------
    time : (frames,) [s]
    coordinates : names
    joint_power : (frames, coordinates) [W]
    """

    quantities = (JOINT_POWER,)
    axes = FrozenMap({"time": "time", "coordinate": "coordinates"})

    time: Array
    coordinates: tuple[str, ...]
    joint_power: Array


def _run(trial: TrialInputs, output: StepOutput, torques: Torques) -> Power:
    power = torques.torques.values * torques.motion.velocities
    if trial.options[PowerOptions].generated:
        power = np.maximum(power, 0.0)
    return Power(time=torques.torques.time, coordinates=torques.torques.names, joint_power=power)


def _show(given: ReportInput, stored: Stored) -> ReportInput:
    found = get_value(stored, Power)
    if found is None:
        return given
    peaks = np.nanmax(np.abs(found.joint_power), axis=0)
    rows = tuple(
        (name, f"{peak:.1f} W") for name, peak in zip(found.coordinates, peaks, strict=True)
    )
    section = Section("power", "Joint power", grids=(Grid(("Coordinate", "Peak"), rows),))
    return replace(given, more=(*given.more, section))


STEP = Step(
    name="power",
    title="joint power",
    gives=Power,
    needs=(Torques,),
    options=(PowerOptions,),
    run=_run,
    show=_show,
)

"""What the report on a cohort of swinging limbs is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.interval import Interval
from myomorph.lab.report.page.parts import Figure, Note, SourceFile, Step
from myomorph.swings.viscosity.cohort import Row, specimen_row
from myomorph.swings.viscosity.identification.budget import ErrorShare
from myomorph.swings.viscosity.identification.identify import (
    Condition,
    MuscleViscosity,
    SpecimenViscosity,
)
from myomorph.swings.viscosity.identification.instruments import Instruments
from myomorph.swings.viscosity.swings.recording import SwingRecording

MAX_FRAMES = 1200  # Frames of a trial that charts are drawn from.


@read_only
class SwingCurves:
    """One trial as charts show it, thinned. In frames that are not used wrenches are NaN.

    Attributes
    ----------
    name : of the trial
    time : (frames,) [s]
    swing : (frames,) number of the swing, -1 where frames are not used
    axes : names
    angles, rates : (frames, axes) [rad], [rad/s]
    torque : (frames, axes) by inverse dynamics [N m]
    wrench : (frames, 6) on the base, measured [N m], [N]
    predicted : (frames, 6) by the inertial parameters
    """

    trial: str
    axes: tuple[str, ...]
    time: Array
    swing: np.ndarray
    angles: Array
    rates: Array
    torque: Array
    wrench: Array
    predicted: Array


@read_only
class ShownCondition:
    """A specimen with its muscles, or without them.

    Viscosities are over all axes and of each [N m s/rad]; `excited` are axes that swings moved
    enough; `residual` (6,) is the root mean square of measured less predicted wrench; `curves` are
    of the trial with the most swings; `plate_viscosity` is from the moment that the plate measures,
    a check; `by_trial` names intervals that are by trial, because trials differ more than their
    swings explain.
    """

    axes: tuple[str, ...]
    viscosity: Interval
    axis_viscosity: tuple[Interval, ...]
    excited: tuple[bool, ...]
    residual: Array
    trials: int
    swings: int
    seconds: float
    curves: SwingCurves
    plate_viscosity: Interval | None = None
    by_trial: tuple[str, ...] = ()


@dataclass(frozen=True)
class PassiveModel:
    """One model of the passive torque, fitted to the swings "without" or "with" muscles.

    Its terms are as "viscosity + stiffness", its values printed with units; `viscosity` [N m
    s/rad]; criteria above those of the best model, smaller is better; root mean square errors of
    held-out swings [rad], [N m], NaN where not known; `chosen`: the simplest of those that the data
    cannot tell from the best.
    """

    condition: str
    terms: str
    values: str
    viscosity: float
    aic: float
    bic: float
    angle_error: float = float("nan")
    wrench_error: float = float("nan")
    chosen: bool = False


@read_only
class HeldOutSwing:
    """A swing held out: angles (frames, axes) [rad], measured and predicted by each model."""

    condition: str
    time: Array
    axes: tuple[str, ...]
    measured: Array
    predicted: Mapping[str, Array]


@read_only
class CutoffScan:
    """What the choice of the filter changes.

    `values` are (choices,) of each of `cohort.QUANTITIES`, cutoffs in [Hz].
    """

    cutoffs: Array
    chosen: float
    values: Mapping[str, Array]
    reason: str = ""


@dataclass(frozen=True)
class ArmError:
    """One kind of error of the moment arms.

    It has relative SD and bias of d_M, and 2.5, 50 and 97.5 % of draws [N s/m].
    """

    kind: str
    size: str
    sd: float
    bias: float
    low: float
    median: float
    high: float


@read_only
class ArmSpread:
    """2.5, 50 and 97.5 % of draws of d_M at relative errors of the arms (levels,), and other kinds.

    They are in [N s/m].
    """

    errors: Array
    low: Array
    median: Array
    high: Array
    draws: int
    kinds: tuple[ArmError, ...] = ()


@dataclass(frozen=True)
class Residual:
    """How well a calibration fits: a line of the table, e.g. "plate position", "0.4", "mm"."""

    what: str
    value: float
    unit: str
    detail: str = ""


@dataclass(frozen=True, eq=False)
class SpecimenReport:
    """All that is shown of one specimen; what was not made is None or empty.

    `row` are its values in the tables; `truth` those of a virtual specimen and `paper` the printed
    ones, by quantity; `scans` residual maps of scanned bones; `failure` why it could not be done,
    else ""; `errors` what swings, instruments and model add to each result; `instruments` their
    errors, assumed and as the swings show them; `law` that acts in the joint where it is not one
    viscosity alone, with those that are not excluded; `shoulder`: the joint is the glenohumeral
    one, of which literature and paper have values.
    """

    name: str
    row: Row = field(default_factory=lambda: FrozenMap({}))
    without: ShownCondition | None = None
    intact: ShownCondition | None = None
    muscles: MuscleViscosity | None = None
    models: tuple[PassiveModel, ...] = ()
    held_out: tuple[HeldOutSwing, ...] = ()
    cutoff: CutoffScan | None = None
    arms: ArmSpread | None = None
    calibration: tuple[Residual, ...] = ()
    truth: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    paper: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    scans: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()
    failure: str = ""
    errors: tuple[ErrorShare, ...] = ()
    instruments: Instruments | None = None
    shoulder: bool = True
    law: str = ""

    @property
    def conditions(self) -> dict[str, ShownCondition]:
        """What there is of "without" and "with" muscles."""
        pairs = (("without", self.without), ("with", self.intact))
        return {name: condition for name, condition in pairs if condition is not None}


@read_only
class DropCurves:
    """One drop (frames,).

    Attributes
    ----------
    name : of the drop
    time : [s]
    measured, fitted : angle, and as the fitted law swings, NaN where it is not used [rad]
    turns : (half swings + 1,) times of the release and of every turn [s]
    """

    name: str
    time: Array
    measured: Array
    fitted: Array
    turns: Array


@dataclass(frozen=True, eq=False)
class LimbReport:
    """All that is shown of a limb; `failure` why it could not be done, else "".

    `row`: estimates by the names of `UNITS`; `errors`: standard deviation of each, by source;
    `laws`: held-out error by law [rad]; `chosen`: among them; `alike`: others that are not
    excluded; `drops`: curves; `notes`: the first on the silence of muscles.
    """

    name: str
    coordinate: str = ""
    row: Mapping[str, Interval] = field(default_factory=lambda: FrozenMap({}))
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: FrozenMap({}))
    laws: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    chosen: str = ""
    alike: tuple[str, ...] = ()
    drops: tuple[DropCurves, ...] = ()
    truth: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    notes: tuple[str, ...] = ()
    failure: str = ""

    @property
    def law(self) -> str:
        """The chosen law, and those that the swings do not exclude."""
        others = f"; not excluded: {', '.join(self.alike)}" if self.alike else ""
        return f"{self.chosen}{others}"


@dataclass(frozen=True, eq=False)
class ViscosityInput:
    """Everything the report on a cohort shows.

    Its notes, on what is real, simulated and assumed, come first.
    """

    title: str
    specimens: tuple[SpecimenReport, ...]
    notes: tuple[Note, ...] = ()
    sources: tuple[SourceFile, ...] = ()
    steps: tuple[Step, ...] = ()
    date: str = ""
    version: str = ""
    limbs: tuple[LimbReport, ...] = ()

    @property
    def done(self) -> tuple[SpecimenReport, ...]:
        """The specimens of which something is known."""
        return tuple(specimen for specimen in self.specimens if specimen.row)


def specimen_report(specimen_viscosity: SpecimenViscosity) -> SpecimenReport:
    """Collect what is shown of an identified specimen, without what trust in it adds."""
    shown = {
        name: shown_condition(condition)
        for name, condition in specimen_viscosity.conditions.items()
    }
    return SpecimenReport(
        name=specimen_viscosity.name,
        row=specimen_row(specimen_viscosity),
        without=shown.get("without"),
        intact=shown.get("with"),
        muscles=specimen_viscosity.muscles,
        notes=specimen_viscosity.notes,
    )


def shown_condition(condition: Condition) -> ShownCondition:
    """Show a condition with the curves of its longest trial."""
    swings = [len(np.unique(recording.swing[recording.used])) for recording in condition.recordings]
    seconds = [
        float(recording.used.sum()) * float(np.median(np.diff(recording.time)))
        for recording in condition.recordings
    ]
    longest = condition.recordings[int(np.argmax(swings))]
    return ShownCondition(
        axes=longest.axes,
        trials=len(condition.recordings),
        swings=sum(swings),
        seconds=sum(seconds),
        curves=swing_curves(longest, condition.parameters),
        viscosity=condition.viscosity,
        axis_viscosity=condition.axis_viscosity,
        excited=condition.excited,
        residual=condition.residual,
        plate_viscosity=condition.plate_viscosity,
        by_trial=condition.by_trial,
    )


def swing_curves(recording: SwingRecording, parameters: Array) -> SwingCurves:
    """Choose a trial's curves, at most `MAX_FRAMES`.

    Parameters
    ----------
    recording : of the trial
    parameters : (10,) of the limb

    Returns
    -------
    the curves
    """
    keep = slice(None, None, -(-len(recording) // MAX_FRAMES))
    unused = ~recording.used[keep][:, None]
    predicted = np.where(unused, np.nan, recording.wrench_rows[keep] @ parameters)
    measured = np.where(unused, np.nan, recording.wrench[keep])
    return SwingCurves(
        trial=recording.name,
        axes=recording.axes,
        time=recording.time[keep],
        swing=recording.swing[keep],
        angles=recording.angles[keep],
        rates=recording.rates[keep],
        torque=recording.torque_rows[keep] @ parameters,
        wrench=measured,
        predicted=predicted,
    )

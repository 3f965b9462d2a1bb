"""One trial as its steps take it: the recording, the options of the steps, and results as named columns."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Actuator, Model
from myomorph.model.provenance import Source
from myomorph.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Wrenches
from myomorph.motion.emg_delay import EmgCalibration
from myomorph.store import stored as store
from myomorph.store.results import ResultWriter
from myomorph.store.settings import ReportOptions
from myomorph.study.inputs.by_type import OptionSet
from myomorph.study.inputs.refined import RefinedMotion
from myomorph.uncertainty.error_sizes import NOTHING, ErrorSizes

if TYPE_CHECKING:
    from myomorph.contact.plan import ContactPlan
    from myomorph.tension.joint_contact import JointPoints

IN_STRIDE = "in a stride"
"""With which quantities end that are the mean over strides of each stride's own."""
EXTREMES = ("minimum", "maximum", "range", "mean")
LOADED = 0.05
"""Of body weight: a foot that never carries more in a cycle did not stand on a plate."""


@dataclass(frozen=True)
class TrialNotes:
    """Sentences about a recording.

    Attributes
    ----------
    real, assumed, simulated : for the first lines of the report
    root : what the forces at the root are where they are not residuals, see `report.trial.report_input.Dynamics`
    """

    real: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    root: str = ""


@read_only
@dataclass(frozen=True, eq=False)
class TrialInputs:
    """One recording of one subject with all that the steps need, whatever files or programs it came from.

    Attributes
    ----------
    options : of all steps
    markers : as recorded, None where the steps begin with coordinates
    motion : coordinates of a file, in the place of inverse kinematics; None to compute them
    refined : coordinates that the step `refine` found, which take the place of those of inverse kinematics
    loads : external forces of a motion, or None where there are none
    torques : generalized forces from a file, in the place of inverse dynamics; None to compute them
    emg, emg_muscles : envelopes, and each channel's muscles
    emg_maxima : envelope of channels in maximum voluntary contractions
    emg_scale : what each channel's envelope was divided by, in the units of its file
    emg_gains : delays and gains of the channels, None to find them on this recording
    events : of the recording
    plates : force plates, for pictures and for feet that share one
    plate_time : clock of their forces (samples,) [s]
    mass : of the subject [kg], None where only the model has one
    time : start and end of what is used [s], None for all
    contacts : what is known of contacts whose forces are to be estimated, None to estimate none
    contact_points : of joints whose forces are shared among them, None for none
    actuators : beside the model's own; None adds a weak reserve for every coordinate
    error_sizes : how far off the model may be, as the steps found that made it
    phases : parts of the motion that the report shows apart, name to start and end [s]
    truth : where the recording was simulated, what is known of it: "motion", "torques", "activations"
    parts : of a recording that joins those of several subjects and objects: each part's name, and the file of its
        model or what makes the model of an object
    sources : inputs by their hashes
    warnings : what the readers of the files reported, one line each
    """

    name: str
    subject: str
    model: Model
    options: OptionSet = field(default_factory=OptionSet)
    markers: Markers | None = None
    motion: Motion | None = None
    refined: RefinedMotion | None = None
    loads: Callable[[Motion], Wrenches] | None = None
    torques: Series | None = None
    emg: Emg | None = None
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    emg_maxima: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    emg_scale: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    emg_gains: EmgCalibration | None = None
    events: tuple[Event, ...] = ()
    plates: tuple[ForcePlate, ...] = ()
    plate_time: Array = field(default_factory=lambda: np.zeros(0))
    mass: float | None = None
    time: tuple[float, float] | None = None
    contacts: ContactPlan | None = None
    contact_points: JointPoints | None = None
    actuators: tuple[Actuator, ...] | None = None
    error_sizes: ErrorSizes = NOTHING
    phases: Mapping[str, tuple[float, float]] = field(default_factory=lambda: FrozenMap({}))
    truth: Mapping[str, Series] = field(default_factory=lambda: FrozenMap({}))
    parts: Mapping[str, str | dict[str, object]] = field(default_factory=lambda: FrozenMap({}))
    notes: TrialNotes = field(default_factory=TrialNotes)
    sources: tuple[Source, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def facts(self) -> dict[str, str]:
        """What result files hold of the recording beside its values, by name."""
        notes = self.notes
        return {
            "trial": self.name,
            "subject": self.subject,
            "mass": "" if self.mass is None else repr(self.mass),
            "root_note": notes.root,
            "notes": json.dumps({"real": notes.real, "assumed": notes.assumed, "simulated": notes.simulated}),
            "warnings": json.dumps(self.warnings),
            "preset": self.options[ReportOptions].preset,
            "phases": json.dumps({name: list(span) for name, span in self.phases.items()}),
            "parts": json.dumps(dict(self.parts)),
            "emg_muscles": json.dumps({channel: list(names) for channel, names in self.emg_muscles.items()}),
        }

    def put(self, writer: ResultWriter) -> None:
        """Write what every result file holds of the recording, so that a report can be made of it alone."""
        store.put_events(writer, self.events)
        store.put_plates(writer, self.plates)
        store.put_truth(writer, self.truth)
        if self.emg is not None:
            store.put_emg(writer, self.emg)
        for name, text in self.facts.items():
            writer.fact(name, text)


class Value(NamedTuple):
    """One number of a trial: the step it comes from, what it is, and its unit.

    Attributes
    ----------
    low, high, sd : limits of 90 % and standard deviation of draws, NaN where nothing was drawn
    """

    step: str
    quantity: str
    value: float
    unit: str
    low: float = math.nan
    high: float = math.nan
    sd: float = math.nan


@read_only
@dataclass(frozen=True, eq=False)
class Signals:
    """Columns of one kind.

    Attributes
    ----------
    step : that made them
    series : named as the model names coordinates, bodies and muscles, so that sides can be told
    endings : added to each name in tables of values
    units : of each column
    statistics : of each column that tables of values have, some of `EXTREMES`
    curve : what the curves over the cycle are called, with their unit; "" where none are drawn
    factor : from the columns to the curves (names,)
    drawn : columns of the curves
    """

    step: str
    series: Series
    endings: tuple[str, ...]
    units: tuple[str, ...]
    statistics: tuple[str, ...]
    curve: str
    factor: Array
    drawn: tuple[int, ...]


def all_drawn(
    step: str,
    series: Series,
    ending: str,
    unit: str,
    statistics: tuple[str, ...],
    curve: str,
    factor: float = 1.0,
) -> Signals:
    """Columns of one unit that are all drawn."""
    count = len(series.names)
    return Signals(
        step, series, (ending,) * count, (unit,) * count, statistics, curve, np.full(count, factor), tuple(range(count))
    )


def statistics_of(values: Array, axis: int = 0) -> dict[str, Array]:
    """`EXTREMES` of values along an axis, NaN where none is known."""
    known = np.isfinite(values)
    if known.size and known.all():
        low, high = values.min(axis=axis), values.max(axis=axis)
        return {"minimum": low, "maximum": high, "range": high - low, "mean": values.mean(axis=axis)}
    some = known.any(axis=axis)
    low = np.where(some, np.min(np.where(known, values, np.inf), axis=axis), np.nan)
    high = np.where(some, np.max(np.where(known, values, -np.inf), axis=axis), np.nan)
    count = np.maximum(known.sum(axis=axis), 1)
    mean = np.where(some, np.where(known, values, 0.0).sum(axis=axis) / count, np.nan)
    return {"minimum": low, "maximum": high, "range": high - low, "mean": mean}

"""One trial: its files, and what its steps take, opened from them.

The inputs are the recording, the options, named columns.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located, messages_text
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.series import Series, Trial
from myomorph.lab.analysis.presets import preset_of
from myomorph.lab.analysis.stride_spread import StrideSpread
from myomorph.lab.store.quantity_files import motions_of
from myomorph.lab.store.results import ResultWriter, file_source
from myomorph.lab.store.settings import ReportOptions, with_settings
from myomorph.lab.study.inputs.imu import ImuFiles
from myomorph.lab.study.inputs.input import ByType, Opened, Opening, OptionSet, Recorded
from myomorph.lab.study.inputs.markers import MarkersFile, Recording
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.inputs.motion import MotionFile
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.inputs.table import INPUTS, input_of, inputs_of
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.step.step import step_head
from myomorph.lab.study.step.step_table import REPORT, STEPS

Held = TypeVar("Held")
Settings = Mapping[str, Mapping[str, Any]]  # The settings of each step, by step and setting.
# With which quantities end that are the mean over strides of each stride's own.
IN_STRIDE = "in a stride"
NO_FACTS = {
    "mass": "",
    "age": "",
    "sex": "",
    "height": "",
    "phases": "{}",
    "parts": "{}",
    "emg_muscles": "{}",
}
"""Facts of a recording without these inputs, as result files of every version have them."""
EXTREMES = ("minimum", "maximum", "range", "mean")


@dataclass(frozen=True)
class TrialFiles:
    """The files of one recording of one subject.

    Attributes
    ----------
    model : its file
    name : of the trial, "" for that of its recording
    subject : whose it is
    inputs : settings of its inputs (`study.inputs.table`)
    condition : that it was recorded in
    """

    model: Path
    name: str = ""
    subject: str = ""
    inputs: ByType = field(default_factory=ByType)
    condition: str = ""

    def get(self, kind: type[Held]) -> Held:
        """Return settings of an input, its defaults where none are specified."""
        return self.inputs.or_default(kind)

    def having(self, *settings: object) -> Self:
        """Return the same with other settings of inputs."""
        return replace(self, inputs=self.inputs.having(*settings))

    @property
    def markers(self) -> Path | None:
        """The recording of markers, None where the trial begins with coordinates."""
        return self.get(MarkersFile).markers

    @property
    def recording(self) -> Path | None:
        """The recording of markers, the coordinates or the sensors that the trial begins with."""
        sensors = self.get(ImuFiles).imu
        return self.markers or self.get(MotionFile).motion or (sensors[0] if sensors else None)

    @property
    def time(self) -> tuple[float, float] | None:
        """Start and end of what is used [s]."""
        return self.get(TimeSpan).time

    @property
    def paths(self) -> tuple[Path, ...]:
        """All files but the model, in the order in which they are opened."""
        return tuple(
            path
            for name, settings in inputs_of(self.inputs).items()
            for key in input_of(name).keys
            for path in key.kind.files(getattr(settings, key.name))
        )


@dataclass(frozen=True)
class TrialNotes:
    """Sentences for the first lines of the report.

    `root` says what forces at the root are, see `Dynamics`.
    """

    real: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    root: str = ""


@dataclass(frozen=True, eq=False)
class JoinedParts(Recorded):
    """Parts of a joined recording by name: the file of its model or the table of an object."""

    models: Mapping[str, str | dict[str, object]]

    @property
    def facts(self) -> Mapping[str, str]:
        """The models."""
        return FrozenMap({"parts": json.dumps(dict(self.models))})


@dataclass(frozen=True, eq=False)
class TrialInputs:
    """One recording of one subject with all that the steps need, from any files or programs.

    `inputs` are opened and fitted to the model, found by their types: `Recording`, `ExternalLoads`,
    `RecordedEmg`, ...; `sources` are inputs by their hashes; `warnings` come from the readers of
    the files.
    """

    name: str
    subject: str
    model: Model
    options: OptionSet = field(default_factory=OptionSet)
    inputs: ByType = field(default_factory=ByType)
    notes: TrialNotes = field(default_factory=TrialNotes)
    sources: tuple[Source, ...] = ()
    warnings: tuple[Message, ...] = ()

    def get(self, kind: type[Held]) -> Held | None:
        """Return an input of a type, None where the trial has none."""
        return self.inputs.get(kind)

    def having(self, *inputs: object) -> Self:
        """Return the same with other inputs; each takes the place of the one of its type."""
        return replace(self, inputs=self.inputs.having(*inputs))

    @property
    def recording(self) -> Trial:
        """Markers, events and plates; one without any where the trial begins with coordinates."""
        return self.inputs.or_default(Recording).trial

    @property
    def time(self) -> tuple[float, float] | None:
        """Start and end of what is used [s], None for all."""
        span = self.inputs.get(TimeSpan)
        return None if span is None else span.time

    @property
    def mass(self) -> float | None:
        """Of the subject [kg], None where only the model has one."""
        weighed = self.inputs.get(BodyMass)
        return None if weighed is None else weighed.mass

    @property
    def facts(self) -> dict[str, str]:
        """What result files hold of the recording beside its values, by name."""
        notes = self.notes
        facts = {
            "trial": self.name,
            "subject": self.subject,
            "root_note": notes.root,
            "notes": json.dumps(
                {"real": notes.real, "assumed": notes.assumed, "simulated": notes.simulated}
            ),
            "warnings": messages_text(self.warnings),
            "preset": self.options[ReportOptions].preset,
            "muscles": json.dumps(self.options[ReportOptions].muscles),
        } | NO_FACTS
        for value in self._recorded:
            facts |= value.facts
        return facts

    @property
    def _recorded(self) -> tuple[Recorded, ...]:
        return tuple(value for value in self.inputs if isinstance(value, Recorded))

    def put(self, writer: ResultWriter) -> None:
        """Write what every result file holds of the recording.

        A report can be made of it alone.
        """
        for value in self._recorded:
            value.put(writer)
        for name, text in self.facts.items():
            writer.fact(name, text)


class Value(NamedTuple):
    """One number of a trial.

    Attributes
    ----------
    step : that gives it
    quantity, value, unit : what it is
    low, high, sd : 90 % interval and standard deviation of draws, NaN for none
    strides : of a mean over strides, how these differ
    """

    step: str
    quantity: str
    value: float
    unit: str
    low: float = math.nan
    high: float = math.nan
    sd: float = math.nan
    strides: StrideSpread | None = None


@read_only
class Signals:
    """Columns of one kind that a step made.

    They are named as the model names coordinates, bodies and muscles, so that sides can be found.

    In tables of values each name gets its ending, unit, and statistics, some of `EXTREMES`; `curve`
    is what the curves over the cycle of the columns `drawn` are called, with their unit ("" where
    none are), `factor` (names,) from the columns to these. Of signals `as_measured` the largest
    value in a stride is that of all its samples, not of those that the curve has.
    """

    step: str
    series: Series
    endings: tuple[str, ...]
    units: tuple[str, ...]
    statistics: tuple[str, ...]
    curve: str
    factor: Array
    drawn: tuple[int, ...]
    as_measured: bool = False


def tidy_signals(step: str, series: Series, model: Model) -> Signals:
    """Return columns of a quantity as its declaration has them in tables of values and curves.

    Parameters
    ----------
    step : that gives it
    series : (frames, names), whose quantity has a place in these tables; ends that are to be left
        out are NaN
    model : whose coordinates the columns are, where they are
    """
    quantity = series.known
    assert quantity is not None
    tidy = quantity.tidy
    assert tidy is not None
    motions = motions_of(quantity, series.names, model)
    scale = np.array([quantity.tidy_factor(motion) for motion in motions])
    curves = [quantity.curve_factor(motion) for motion in motions]
    return Signals(
        step=step,
        series=Series(series.time, series.names, series.values * scale),
        endings=tuple(map(tidy.ending, motions)),
        units=tuple(map(quantity.tidy_unit, motions)),
        statistics=tidy.statistics,
        curve=tidy.heading,
        factor=np.array([1.0 if factor is None else factor for factor in curves]),
        drawn=tuple(place for place, factor in enumerate(curves) if factor is not None),
    )


def statistics_of(values: Array, axis: int = 0) -> dict[str, Array]:
    """Return the `EXTREMES` of values along an axis.

    Parameters
    ----------
    values : of any shape, NaN or infinite where not known
    axis : along which they are taken

    Returns
    -------
    by name, in the shape of the values without the axis; NaN where no value is known
    """
    values = np.where(np.isfinite(values), values, np.nan)
    with warnings.catch_warnings():
        # Of columns in which nothing is known.
        warnings.simplefilter("ignore", RuntimeWarning)
        low = np.nanmin(values, axis=axis)
        high = np.nanmax(values, axis=axis)
        mean = np.nanmean(values, axis=axis)
    return {"minimum": low, "maximum": high, "range": high - low, "mean": mean}


def open_trial(files: TrialFiles, settings: Settings, model: Model | None = None) -> TrialInputs:
    """Read the files of a recording, and make of them what the steps take.

    They are read in the order of the inputs' table.
    """
    model = open_model(files.model) if model is None else model
    opening = Opening(
        model_file=files.model,
        model=model,
        options=options_of(settings),
        settings=files.inputs,
        values=ByType(),
    )
    opening, parts = _opened(opening)
    of_inputs = (warning for part in parts for warning in part.warnings)
    return TrialInputs(
        name=files.name or (files.recording or files.model).stem,
        subject=files.subject or model.name,
        model=model,
        options=opening.options,
        inputs=opening.values,
        notes=_notes_of(parts),
        sources=(
            file_source("model", files.model),
            *(source for part in parts for source in part.sources),
        ),
        warnings=(*located(files.model.name, model.warnings), *of_inputs),
    )


def _opened(opening: Opening) -> tuple[Opening, list[Opened]]:
    """Open a trial's inputs in their order; each sees the values and options of those before it."""
    wanted = inputs_of(opening.settings)
    parts = list[Opened]()
    for name in INPUTS:
        if name not in wanted:
            continue
        declared = input_of(name)
        settings = declared.settings() if wanted[name] is None else wanted[name]
        opened = declared.open(settings, opening)
        parts.append(opened)
        if opened.values:
            wanted = dict.fromkeys(declared.holds) | wanted
        options = opening.options.having(*opened.options)
        values = opening.values.having(*opened.values)
        opening = replace(opening, options=options, values=values)
    return opening, parts


def _notes_of(parts: Sequence[Opened]) -> TrialNotes:
    """Sentences of inputs for the first lines of the report; what was recorded is one sentence."""
    real = ", ".join(part.real for part in parts if part.real)
    return TrialNotes(
        real=(f"{real[0].upper()}{real[1:]}.",) if real else (),
        assumed=tuple(text for part in parts for text in part.assumed),
        simulated=tuple(text for part in parts for text in part.simulated),
    )


def options_of(settings: Settings) -> OptionSet:
    """Return what a study file or a command specifies for the steps, as values of their options.

    Options that several steps have, such as the low-pass filter, are one for all: the last step
    that names one counts. Steps for which nothing is specified are not read, so that commands
    without them start faster.
    """
    result = OptionSet()
    for name in (*STEPS["trial"], REPORT):
        if settings.get(name):
            kinds = step_head(name).options
            result = result.having(*(with_settings(result[kind], settings[name]) for kind in kinds))
    if result[ReportOptions].preset:
        preset_of(result[ReportOptions].preset)
    return result

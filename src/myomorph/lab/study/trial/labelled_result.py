"""Results of steps that know their quantities: stored, tabled and tidied without a further line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from myomorph.core.model.labelled import Labelled
from myomorph.core.model.model import Model
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Series
from myomorph.lab.store.quantities import put_value
from myomorph.lab.store.quantity_files import write_series
from myomorph.lab.store.results import Stored
from myomorph.lab.study.inputs.input import OptionSet
from myomorph.lab.study.step.step import Step, StepOutput
from myomorph.lab.study.trial.trial_inputs import Signals, tidy_signals


def write_labelled(result: object, output: StepOutput, model: Model) -> None:
    """Write the quantities of a result into the result file, and the tables of those that have one.

    Parameters
    ----------
    result : of a step; one that is no `Labelled` was written by its step
    output : of the step
    model : whose coordinates columns may be
    """
    if not isinstance(result, Labelled):
        return
    put_value(output.writer, result)
    labels = result.labels()
    for quantity, values in result.held_arrays():
        if has_plain_table(quantity):
            clock, columns = quantity.dims
            names = tuple(str(name) for name in labels[columns])
            series = Series(np.asarray(labels[clock]), names, values, quantity=quantity)
            write_series(output.folder, series, model)


def has_plain_table(quantity: Quantity) -> bool:
    """Return whether a quantity has a table with one column a name."""
    return bool(quantity.file) and quantity.over_time and len(quantity.dims) == 2


def labelled_signals(step: Step[Any], stored: Stored, model: Model) -> Sequence[Signals]:
    """Return the columns over time of a step whose result is `Labelled`, as declared."""
    if not issubclass(step.gives, Labelled):
        return ()
    result = step.read(stored, OptionSet())
    if result is None:
        return ()
    labels = result.labels()
    return tuple(
        tidy_signals(
            step.name,
            Series(
                labels[quantity.dims[0]],
                tuple(labels[quantity.dims[1]]),
                values,
                quantity=quantity,
            ),
            model,
        )
        for quantity, values in result.held_arrays()
        if quantity.tidy is not None
    )

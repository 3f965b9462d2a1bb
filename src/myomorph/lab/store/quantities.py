"""Quantities to the variables of a result file, and back: one loop over their declarations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from myomorph.core.model.labelled import Labelled
from myomorph.core.model.quantity import CLOCK, STORED_KINDS, Quantity
from myomorph.lab.store.results import ResultWriter, Stored

Item = TypeVar("Item")
Value = TypeVar("Value", bound=Labelled)
Labels = Mapping[str, Sequence[object] | np.ndarray]


def put_value(writer: ResultWriter, value: Labelled, leave_out: Iterable[Quantity] = ()) -> None:
    """Write all that a value holds, under the names of its quantities.

    Parameters
    ----------
    writer : of the result file
    value : whose axes are written too
    leave_out : quantities that say nothing in this value
    """
    labels = value.labels()
    omitted = {quantity.name for quantity in leave_out}
    for quantity, values in value.held_arrays():
        if quantity.stored and quantity.name not in omitted:
            put_quantity(writer, quantity, values, labels)


def put_quantity(
    writer: ResultWriter, quantity: Quantity, values: Any, labels: Labels | None = None
) -> None:
    """Write one quantity; nothing where an axis that has names has none.

    Parameters
    ----------
    writer : of the result file
    quantity : declared
    values : on the quantity's axes as a result file has them; of texts one for each entry
    labels : times and names of the axes, where these are not in the file already
    """
    labels = labels or {}
    if quantity.kind == "text":
        values = [str(text) for text in values]
    if quantity.dims == (quantity.name,) and quantity.kind == "text":
        # Names of an axis of their own.
        writer.names(quantity.name, values)
        return
    shape = np.shape(values)
    if any(
        not size and axis in labels and not axis.endswith("time")
        for axis, size in zip(quantity.stored_dims, shape, strict=True)
    ):
        return
    for axis, size in zip(quantity.stored_dims, shape, strict=True):
        _make_axis(writer, axis, size, labels.get(axis))
    if quantity.kind == "text":
        writer.texts(quantity.name, quantity.dims[0], values)
        return
    writer.put(
        quantity.name,
        quantity.stored_dims,
        quantity.stored_array(values),
        quantity.unit,
        quantity.meaning,
    )


def create_quantity(writer: ResultWriter, quantity: Quantity) -> Any:
    """Make a variable on axes that are there, to be filled part by part."""
    return writer.create(
        quantity.name,
        quantity.stored_dims,
        quantity.unit,
        quantity.meaning,
        STORED_KINDS[quantity.kind],
    )


def _make_axis(
    writer: ResultWriter, axis: str, size: int, labels: Sequence[object] | np.ndarray | None
) -> None:
    if axis == "time" and labels is not None:
        writer.time(np.asarray(labels, np.float64))
    elif labels is None or axis.endswith("time"):
        writer.sizes(axis, size)
    else:
        writer.names(axis, [str(label) for label in labels])


def put_rows(writer: ResultWriter, quantities: Sequence[Quantity], items: Sequence[object]) -> None:
    """Write a table of items, one entry each; none of them too, so that it is known to be empty."""
    for quantity in quantities:
        writer.sizes(quantity.dims[0], len(items))
        put_quantity(writer, quantity, [quantity.of(item) for item in items])


def get_quantity(stored: Stored, quantity: Quantity) -> Any:
    """Return the array, or the texts, of a quantity in a result; None where it is not there."""
    if quantity.kind == "text":
        return stored.names.get(quantity.name)
    values = stored.values.get(quantity.name)
    return None if values is None else quantity.restored(values)


def get_fields(stored: Stored, quantities: Iterable[Quantity]) -> dict[str, Any]:
    """Return the quantities that a result has, by the fields of the value that holds them."""
    found = {quantity.field: get_quantity(stored, quantity) for quantity in quantities}
    return {name: values for name, values in found.items() if values is not None}


def value_of(kind: type[Item], *parts: Mapping[str, Any]) -> Item:
    """Make a value of its fields by name; those of a later part count where two name one."""
    fields: dict[str, Any] = {}
    for part in parts:
        fields |= part
    # The only place where quantities become the fields of a value: names come from declarations.
    return kind(**fields)


def get_value(stored: Stored, kind: type[Value]) -> Value | None:
    """Return a value that `put_value` wrote, None where the result has none of its quantities.

    Its fields are its quantities and their axes.
    """
    fields = get_fields(stored, kind.quantities)
    if not fields:
        return None
    labels = {
        field: stored.time if axis == CLOCK else stored.names.get(axis, ())
        for axis, field in kind.axes.items()
    }
    return value_of(kind, fields, labels)


def get_rows(
    stored: Stored, quantities: Sequence[Quantity], kind: type[Item]
) -> tuple[Item, ...] | None:
    """Return the items that `put_rows` wrote, None where it wrote no table."""
    numbers = [quantity for quantity in quantities if quantity.kind != "text"]
    if any(quantity.name not in stored.values for quantity in numbers):
        return None
    columns = {
        quantity.field: stored.values[quantity.name].tolist()
        if quantity.kind != "text"
        else stored.names.get(quantity.name, ())
        for quantity in quantities
    }
    rows = zip(*columns.values(), strict=True)
    return tuple(value_of(kind, dict(zip(columns, row, strict=True))) for row in rows)

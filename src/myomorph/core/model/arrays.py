"""Arrays of values: checked against a shape in one way, and read-only where a value is frozen."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from functools import cache, wraps
from operator import is_
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap

Array = NDArray[np.float64]
PLAIN = re.compile(r"(tuple\[)?(str|int|float|bool)(, \.\.\.\])?( \| None)?")
"""Types of fields that hold no array, as they are written."""
_Class = TypeVar("_Class", bound=type)
_Value = TypeVar("_Value")


def checked_array(values: ArrayLike, shape: tuple[int | str, ...], name: str) -> Array:
    """`values` as a contiguous float64 array, copied only where it has to be.
    `shape`: wanted size of each dimension; a word, e.g. "frames", stands for any size; `name`: for
    the message.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    fits = np.ndim(values) == len(shape) and all(
        isinstance(want, str) or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = f"({', '.join(str(length) for length in shape)}{',' if len(shape) == 1 else ''})"
        raise BadData(f"expected {name} of shape {wanted}, but got {np.shape(values)}")
    return array


def frozen_array(values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Read-only float64 copy of `values`, checked against `shape` (-1 matches anything)."""
    array = np.array(values, dtype=np.float64)
    # Most often the shape is the one wanted, to the letter: thousands of small transforms are made
    # for every model.
    if (
        shape is not None
        and array.shape != shape
        and (
            array.ndim != len(shape)
            or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True))
        )
    ):
        raise ValueError(f"expected an array of shape {shape}, but got {array.shape}")
    array.setflags(write=False)
    return array


def freeze(value: object, **shapes: tuple[int, ...] | None) -> None:
    """Fields of a frozen value as read-only arrays of some shape, in its `__post_init__`; what is
    None stays so.
    """
    for name, shape in shapes.items():
        field = getattr(value, name)
        if field is not None:
            object.__setattr__(value, name, frozen_array(field, shape))


def unit_vector(values: ArrayLike, what: str, of: str) -> Array:
    """Read-only (3,) vector of length 1 along `values`."""
    vector = frozen_array(values, (3,))
    length = float(np.linalg.norm(vector))
    if not (np.isfinite(length) and length > 0.0):
        raise BadData(f"{what} {vector.tolist()} of {of}: expected a vector with a length")
    return frozen_array(vector / length)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """(start, stop) of the unbroken runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


@dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(dataclasses.field,))
def read_only(cls: _Class) -> _Class:
    """Class decorator: a frozen dataclass, compared by identity, the arrays of whose fields are
    read-only, too.

    What is a dataclass already (`@read_only` above `@dataclass(...)` with other options) stays as
    it is otherwise. Each array, also in tuples and mappings, becomes a read-only view of itself,
    without a copy: when an object is made, by `dataclasses.replace`, and when it is unpickled or
    copied. A class derived from such a one needs the decorator itself. Kernels are compiled anew
    for read-only arrays: what they take as it is stays without.
    """
    kind: Any = (
        cls
        if "__dataclass_fields__" in vars(cls)
        else dataclasses.dataclass(frozen=True, eq=False)(cls)
    )
    made = kind.__init__
    restored = getattr(cls, "__setstate__", None)

    @wraps(made)
    def initialize(self: Any, *args: Any, **options: Any) -> None:
        made(self, *args, **options)
        _lock(self)

    def restore(self: Any, state: Any) -> None:
        if restored is not None:
            restored(self, state)
        else:
            # Without a method of its own, a class with slots is given (what has no slot, what has
            # one).
            for part in state if isinstance(state, tuple) else (state,):
                for name, value in (part or {}).items():
                    object.__setattr__(self, name, value)
        _lock(self)

    kind.__init__ = initialize
    kind.__setstate__ = restore
    kind._arrays_are_read_only = True
    return kind


def changed(value: _Value, **fields: Any) -> _Value:
    """`dataclasses.replace` without the checks of the class, where fields are surely right: ten
    times as fast. `fields`: arrays among them have been made for this alone; they become read-only.
    """
    made = object.__new__(type(value))
    for field in fields.values():
        if isinstance(field, np.ndarray):
            field.setflags(write=False)
    made.__dict__.update(value.__dict__, **fields)
    return made


@cache
def _may_hold_arrays(kind: Any) -> tuple[str, ...]:
    """Fields of a class but for names and plain numbers: of these, what is made for every frame may
    have hundreds.
    """
    fields: dict[str, Any] = kind.__dataclass_fields__
    return tuple(name for name, field in fields.items() if not PLAIN.fullmatch(str(field.type)))


def _lock(value: Any) -> None:
    kind: Any = type(value)
    for name in _may_hold_arrays(kind):
        # Where a derived class calls this one's __init__ first, its own fields come later.
        held = getattr(value, name, None)
        sort: Any = type(held)
        change = _change_of(sort)
        if change is not None and (locked := change(held)) is not held:
            object.__setattr__(value, name, locked)


def _locked(value: Any) -> Any:
    """The value with read-only arrays; itself where it has none that can be written."""
    kind: Any = type(value)
    change = _change_of(kind)
    return value if change is None else change(value)


def _locked_array(value: np.ndarray) -> np.ndarray:
    if value.flags.writeable:
        value = value.view()
        value.setflags(write=False)
    return value


def _locked_tuple(value: tuple[Any, ...]) -> tuple[Any, ...]:
    parts = [_locked(item) for item in value]
    if all(map(is_, parts, value)):
        return value
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def _locked_mapping(value: Mapping[Any, Any]) -> Mapping[Any, Any]:
    entries = {key: _locked(item) for key, item in value.items()}
    return (
        value if all(entry is value[key] for key, entry in entries.items()) else FrozenMap(entries)
    )


@cache
def _change_of(kind: type) -> Callable[[Any], Any] | None:
    """What makes values of a type read-only, None for types that hold no arrays of their own: found
    once a type.
    """
    for base, change in (
        (np.ndarray, _locked_array),
        (tuple, _locked_tuple),
        (Mapping, _locked_mapping),
    ):
        if issubclass(kind, base):
            return change
    return None

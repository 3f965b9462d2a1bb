"""Arrays of values: checked against a shape in one way, and read-only where a value is frozen."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from operator import is_
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.shown import shown

Array = NDArray[np.float64]
# Types of fields that hold no array, as they are written
PLAIN = re.compile(r"(tuple\[)?(str|int|float|bool)(, \.\.\.\])?( \| None)?")
_Class = TypeVar("_Class", bound=type)
_Value = TypeVar("_Value")


def checked_array(values: ArrayLike, shape: tuple[int | str, ...], name: str) -> Array:
    """Make a contiguous float64 array of a shape, copied only where it has to be.

    Parameters
    ----------
    values : of any kind of number
    shape : length of each dimension; a word, e.g. "frames", stands for any length
    name : of the values, for the message

    Returns
    -------
    the array

    Raises
    ------
    BadData : the shape is another one
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    lengths = [None if isinstance(length, str) else length for length in shape]
    if np.ndim(values) == len(shape) and _fits(array.shape, lengths):
        return array
    listed = ", ".join(str(length) for length in shape)
    expected = f"({listed},)" if len(shape) == 1 else f"({listed})"
    raise BadData(f"expected {name} of shape {expected}, but got {np.shape(values)}")


def _fits(shape: tuple[int, ...], lengths: Sequence[int | None]) -> bool:
    """Whether an array's shape has some lengths; None stands for any."""
    pairs = zip(shape, lengths, strict=True)
    return all(expected in (None, length) for length, expected in pairs)


def frozen_array(values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Make a read-only float64 copy.

    Parameters
    ----------
    values : of any kind of number
    shape : that is expected; -1 stands for any length, None for any shape

    Returns
    -------
    the copy

    Raises
    ------
    ValueError : the shape is another one
    """
    array = np.array(values, dtype=np.float64)
    # Most often the shape is the expected one to the letter: thousands of small transforms are made
    # for every model.
    if shape is not None and array.shape != shape:
        lengths = [None if length == -1 else length for length in shape]
        if array.ndim != len(shape) or not _fits(array.shape, lengths):
            raise ValueError(f"expected an array of shape {shape}, but got {array.shape}")
    array.setflags(write=False)
    return array


def freeze(value: object, **shapes: tuple[int, ...] | None) -> None:
    """Make fields of a frozen value read-only arrays of some shape, in its `__post_init__`.

    Parameters
    ----------
    value : whose fields are changed; what is None stays so
    shapes : by field, as of `frozen_array`
    """
    for name, shape in shapes.items():
        field = getattr(value, name)
        if field is not None:
            object.__setattr__(value, name, frozen_array(field, shape))


def unit_vector(values: ArrayLike, what: str, of: str) -> Array:
    """Scale a vector to length 1.

    Parameters
    ----------
    values : (3,)
    what, of : names of the vector and of what has it, for the message

    Returns
    -------
    (3,) read-only

    Raises
    ------
    BadData : the vector has no length
    """
    vector = frozen_array(values, (3,))
    length = float(np.linalg.norm(vector))
    if not (np.isfinite(length) and length > 0.0):
        raise BadData(f"{what} {vector.tolist()} of {of}: expected a vector with a length")
    return frozen_array(vector / length)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Find the unbroken runs of True.

    Parameters
    ----------
    flags : (n,)

    Returns
    -------
    (start, stop) of each run, the stop not included
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


@dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(dataclasses.field,))
def read_only(cls: _Class) -> _Class:
    """Make a class a frozen dataclass, compared by identity, with read-only arrays.

    What is a dataclass already (`@read_only` above `@dataclass(...)` with other options) stays as
    it is otherwise. Each array, also in tuples and mappings, becomes a read-only view of itself,
    without a copy: when an object is made, by `dataclasses.replace`, and when it is unpickled or
    copied. A class derived from such a one needs the decorator itself. Kernels are compiled anew
    for read-only arrays: what they take as it is stays without. Its `repr` is one line (`shown`).
    """
    kind: Any = (
        cls
        if "__dataclass_fields__" in vars(cls)
        else dataclasses.dataclass(frozen=True, eq=False)(cls)
    )
    kind = shown(kind)
    plain_init = kind.__init__
    restored = getattr(cls, "__setstate__", None)

    @wraps(plain_init)
    def initialize(self: Any, *args: Any, **options: Any) -> None:
        plain_init(self, *args, **options)
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
    """`dataclasses.replace` without the checks of the class: ten times as fast.

    For fields that are right for certain.

    Parameters
    ----------
    value : of a class with `read_only`
    fields : new values; arrays among them belong to this value alone, and become read-only
    """
    result = object.__new__(type(value))
    for field in fields.values():
        if isinstance(field, np.ndarray):
            field.setflags(write=False)
    result.__dict__.update(value.__dict__, **fields)
    return result


@cache
def _may_hold_arrays(kind: Any) -> tuple[str, ...]:
    """Fields of a class but for names and plain numbers.

    What is made for every frame may have hundreds of these.
    """
    fields: dict[str, Any] = kind.__dataclass_fields__
    return tuple(name for name, field in fields.items() if not PLAIN.fullmatch(str(field.type)))


def _lock(value: Any) -> None:
    """Make the arrays of a value's fields read-only, in place."""
    kind: Any = type(value)
    for name in _may_hold_arrays(kind):
        # Where a derived class calls this one's __init__ first, its own fields come later.
        held = getattr(value, name, None)
        sort: Any = type(held)
        change = _change_of(sort)
        if change is not None and (locked := change(held)) is not held:
            object.__setattr__(value, name, locked)


def _locked(value: Any) -> Any:
    """Replace writable arrays by read-only views; the value itself where it has none."""
    kind: Any = type(value)
    change = _change_of(kind)
    return value if change is None else change(value)


def _locked_array(value: np.ndarray) -> np.ndarray:
    """Make a read-only view of an array, itself where it is read-only."""
    if value.flags.writeable:
        value = value.view()
        value.setflags(write=False)
    return value


def _locked_tuple(value: tuple[Any, ...]) -> tuple[Any, ...]:
    """`_locked` for each item."""
    parts = [_locked(item) for item in value]
    if all(map(is_, parts, value)):
        return value
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def _locked_mapping(value: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """`_locked` for each entry."""
    entries = {key: _locked(item) for key, item in value.items()}
    unchanged = all(entry is value[key] for key, entry in entries.items())
    return value if unchanged else FrozenMap(entries)


@cache
def _change_of(kind: type) -> Callable[[Any], Any] | None:
    """Find the function that makes values of a type read-only, once a type.

    None for types that hold no arrays of their own.
    """
    for base, change in (
        (np.ndarray, _locked_array),
        (tuple, _locked_tuple),
        (Mapping, _locked_mapping),
    ):
        if issubclass(kind, base):
            return change
    return None

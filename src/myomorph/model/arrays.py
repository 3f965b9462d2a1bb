"""Arrays of values: checked against a shape in one way, and read-only where a value is frozen."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.model.errors import BadData

Array = NDArray[np.float64]


class FrozenArrays:
    """Base of frozen dataclasses: the arrays among their fields are read-only, also of copies and after pickling.

    Nothing is copied, so an array that is handed over is read-only from then on.
    """

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        FrozenArrays.__post_init__(self)


def checked_array(values: ArrayLike, shape: tuple[int | str, ...], name: str, *, finite: bool = False) -> Array:
    """`values` as a contiguous float64 array, copied only where it has to be.

    Parameters
    ----------
    shape : wanted size of each dimension; a word, e.g. "frames", stands for any size
    name : of the values, for the message
    finite : whether NaN and infinity are refused

    Raises
    ------
    BadData
        where the shape is another, or a value is not finite though it must be
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    fits = np.ndim(values) == len(shape) and all(
        isinstance(want, str) or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = f"({', '.join(str(one) for one in shape)}{',' if len(shape) == 1 else ''})"
        raise BadData(f"expected {name} of shape {wanted}, but got {np.shape(values)}")
    if finite and not np.isfinite(array).all():
        raise BadData(f"expected finite {name}, but {int((~np.isfinite(array)).sum())} of {array.size} values are not")
    return array


def frozen_array(values: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Read-only float64 copy of `values`, checked against `shape` (-1 matches anything)."""
    array = np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"expected an array of shape {shape}, but got {array.shape}")
    array.setflags(write=False)
    return array

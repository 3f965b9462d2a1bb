"""The nouns: a model, time series, spatial values and errors. Reads no file, knows no Numba."""

import copyreg
from collections.abc import Callable
from typing import Any

from myomorph.model.frozen_map import FrozenMap


def _read_only(entries: dict[Any, Any]) -> FrozenMap[Any, Any]:
    return FrozenMap(entries)


def _reduced(mapping: FrozenMap[Any, Any]) -> tuple[Callable[..., Any], tuple[dict[Any, Any]]]:
    return _read_only, (dict(mapping),)


# Python cannot pickle a read-only mapping by itself, and every noun has to travel to other processes.
copyreg.pickle(FrozenMap, _reduced)

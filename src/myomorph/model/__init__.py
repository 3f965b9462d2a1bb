"""The nouns: a model, time series, spatial values and errors. Reads no file, knows no Numba."""

import copyreg
from collections.abc import Callable
from types import MappingProxyType
from typing import Any


def _read_only(entries: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(entries)


def _reduced(mapping: MappingProxyType[Any, Any]) -> tuple[Callable[..., Any], tuple[dict[Any, Any]]]:
    return _read_only, (dict(mapping),)


# Python cannot pickle a read-only mapping by itself, and every noun has to travel to other processes.
copyreg.pickle(MappingProxyType, _reduced)

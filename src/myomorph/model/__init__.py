"""The nouns: a model, time series, spatial values and errors. Reads no file, knows no Numba."""

import copyreg
from types import MappingProxyType
from typing import Any


def _pickled(mapping: "MappingProxyType[Any, Any]") -> tuple[type, tuple[dict[Any, Any]]]:
    return MappingProxyType, (dict(mapping),)


# Python cannot pickle a read-only mapping by itself, and every noun has to travel to other processes.
copyreg.pickle(MappingProxyType, _pickled)

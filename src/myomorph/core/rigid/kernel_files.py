"""Where machine code of kernels lies on disk, and from which sources it was made."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

from myomorph.core.model.cache_folder import kernel_folder

OURS = "myomorph."


def can_keep_kernels() -> bool:
    """Whether code of kernels can be saved in their folder, which is made where it is missing."""
    folder = kernel_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


@cache
def source_digest(module: str) -> str:
    """Hash of the sources of a module and of all modules whose kernels it calls.

    Those of a class with `kernels`, in a module or a tuple of one, are found by type when a kernel
    is compiled.
    """
    sources: dict[str, bytes] = {}
    pending = [module]
    while pending:
        name = pending.pop()
        if name in sources:
            continue
        sources[name] = Path(str(sys.modules[name].__file__)).read_bytes()
        for value in vars(sys.modules[name]).values():
            for part in value if isinstance(value, tuple) else (value,):
                pending += _modules_of(part)
    return hashlib.sha256(b"".join(sources[name] for name in sorted(sources))).hexdigest()


def _modules_of(value: Any) -> list[str]:
    """Names of the modules whose kernels a value of a module's namespace brings in."""
    if inspect.ismodule(value):
        return [value.__name__] if value.__name__.startswith(OURS) else []
    if isinstance(value, type):
        return [value.__module__] if hasattr(value, "kernels") else []
    if callable(value) and hasattr(value, "py_func"):
        return [value.py_func.__module__]
    return []

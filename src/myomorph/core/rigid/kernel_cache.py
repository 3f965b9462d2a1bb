"""Machine code of kernels and its own place on disk; importing this imports Numba.

Numba would keep machine code beside the sources, where a newer version finds what an older one has
left, and two processes that compile at once can give one file name to the code of two signatures:
either is then called with the arguments of the other. These kernels lie in a folder of their own
for each version and each copy of the package, under `NUMBA_CACHE_DIR` or the user's cache folder;
they are saved by one process at a time; and they are compiled anew where their own source or that
of a kernel they call has changed. Other packages' kernels are not touched, and nothing is read or
written before the first kernel is called.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import sys
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import numba.np.linalg
from numba import config, njit
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.misc.appdirs import AppDirs

from myomorph import __version__

LOCK = "kernels.lock"
MAX_WAIT = 60.0  # For others to save a kernel [s]; after that a process does not save its own
PACKAGE = Path(__file__).resolve().parents[2]
OURS = "myomorph."


def _load_array_functions() -> None:
    """Import what Numba knows of arrays without scipy's linear algebra.

    Numba imports that only to learn whether it is there, which takes as long as reading a model;
    what is compiled with it imports it still.
    """
    check = numba.np.linalg.ensure_blas
    numba.np.linalg.ensure_blas = lambda: None
    try:
        import_module("numba.np.arraymath")
    finally:
        numba.np.linalg.ensure_blas = check


_load_array_functions()


def dispatcher_of(
    function: Callable[..., Any], options: Mapping[str, Any], announce: Callable[[], None]
) -> Any:
    """Numba's dispatcher of a function, with our cache.

    Parameters
    ----------
    function : to compile
    options : of `numba.njit`
    announce : called before the function is compiled
    """
    dispatcher: Any = njit(nogil=True, **{"error_model": "numpy", **options})(function)
    dispatcher._cache = KernelCache(function, announce)
    return dispatcher


def kernel_folder() -> Path:
    """Folder of the kernels of this version and copy of the package; it need not exist."""
    root = Path(config.CACHE_DIR or AppDirs("myomorph", appauthor=False).user_cache_dir)
    copy = hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:8]
    return root / f"myomorph-{__version__}-{copy}"


def can_keep_kernels() -> bool:
    """Whether code of kernels can be saved in their folder, which is made where it is missing."""
    folder = kernel_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


@cache
def _fingerprint(module: str) -> str:
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


def _ours(kind: Any) -> bool:
    """Whether all classes that an argument's type names come with the package.

    Others may be absent when the code is read again.
    """
    named = getattr(kind, "instance_class", None)
    if named is not None and not named.__module__.startswith(OURS):
        return False
    return all(_ours(part) for part in getattr(kind, "types", ()))


class KernelFile(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one kernel, one process at a time: code first, then the index that names it."""

    def _load_index(self) -> dict[Any, str]:
        """Read the files by signature; none where classes of the arguments moved or are gone."""
        try:
            files: dict[Any, str] = super()._load_index()
        except (ImportError, AttributeError):
            return {}
        return files

    def save(self, key: Any, data: Any) -> None:
        """Save the code of one signature.

        It is not saved where other processes hold the lock or nothing can be written.
        """
        # Only what has compiled needs it.
        from filelock import FileLock

        folder = Path(self._cache_path)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with FileLock(folder / LOCK, timeout=MAX_WAIT):
                named = self._load_index()
                candidates = map(self._data_name, range(1, len(named) + 2))
                unused = (name for name in candidates if name not in named.values())
                name = named.get(key) or next(unused)
                self._save_data(name, data)
                self._save_index(named | {key: name})
        except OSError:
            return


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Folder of the files of one kernel, and the sources they were made from."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._py_file = function.__code__.co_filename
        self._module = function.__module__
        self._line = function.__code__.co_firstlineno

    def ensure_cache_path(self) -> None:
        """Do nothing: the folder is made where a kernel is saved."""

    def get_cache_path(self) -> str:
        """Return the folder in which kernels are saved."""
        return str(kernel_folder())

    def get_source_stamp(self) -> str:
        """Return what changes where the source of a kernel does."""
        return _fingerprint(self._module)

    def get_disambiguator(self) -> str:
        """Return what distinguishes kernels of one module: the line."""
        return str(self._line)


class _Code(CompileResultCacheImpl):  # type: ignore[misc]
    """How code is packed; its file is named by room, module, function and line."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._locator = _Locator(function)
        self._lineno = function.__code__.co_firstlineno
        name = f"{function.__module__.removeprefix('myomorph.')}.{function.__qualname__}"
        self._filename_base = self.get_filename_base(name, getattr(sys, "abiflags", ""))


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, in our folder, looked up at the first call."""

    def __init__(self, function: Callable[..., Any], announce: Callable[[], None]) -> None:
        self._name = repr(function)
        self._py_func = function
        self._announce = announce
        self.enable()

    @cached_property
    def _impl(self) -> _Code:
        return _Code(self._py_func)

    @cached_property
    def _cache_path(self) -> str:
        return str(self._impl.locator.get_cache_path())

    @cached_property
    def _cache_file(self) -> KernelFile:
        stamp = self._impl.locator.get_source_stamp()
        return KernelFile(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the code of a signature.

        None where it is absent, damaged or out of reach; then it is compiled, which is announced.
        """
        loaded = None
        if all(_ours(kind) for kind in sig):
            with contextlib.suppress(OSError, EOFError):
                loaded = super().load_overload(sig, target_context)
        if loaded is None:
            self._announce()
        return loaded

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code of a signature, unless it has a type from outside the package."""
        if all(_ours(kind) for kind in sig):
            super().save_overload(sig, data)

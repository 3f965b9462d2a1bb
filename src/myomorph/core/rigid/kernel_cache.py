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
import sys
from collections.abc import Callable, Mapping
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import numba.np.linalg
import numpy as np
from numba import njit, types
from numba.core import intrinsics
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)

from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.rigid.kernel_code import (
    NUMBERS,
    CodeHead,
    Key,
    array_name,
    class_name,
    code_digest,
    is_stored,
    kernel_name,
    store_code,
)
from myomorph.core.rigid.kernel_files import OURS, source_digest

LOCK = "kernels.lock"
LOCKS = "locks"
"""Folder of a lock for each kernel, held by the process that compiles it."""
MAX_COMPILING = 300.0  # For another process to compile a kernel [s]; then this one does so, too
MAX_WAIT = 60.0  # For others to save a kernel [s]; after that a process does not save its own
LAYOUTS = ("A", "C", "F")


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
    kernel_cache = KernelCache(function, announce)
    dispatcher._cache = kernel_cache
    compile_now = dispatcher._compiler.compile

    def compile_or_release(*arguments: Any) -> Any:
        try:
            return compile_now(*arguments)
        except BaseException:
            kernel_cache.release()
            raise

    dispatcher._compiler.compile = compile_or_release
    return dispatcher


def type_key(kinds: tuple[Any, ...]) -> Key | None:
    """Name Numba's types of arguments as `call_key` names those of values.

    Parameters
    ----------
    kinds : Numba's types

    Returns
    -------
    None where a value of one of them is not distinguished by `call_key`
    """
    key = tuple(map(_type_name, kinds))
    return None if None in key else key


def _type_name(kind: Any) -> Any:
    if isinstance(kind, types.Array):
        number = _number_name(kind.dtype)
        if number is None or kind.layout not in LAYOUTS or not kind.aligned:
            return None
        return array_name(number, kind.ndim, kind.layout, kind.mutable)
    if isinstance(kind, types.BaseTuple):
        parts = tuple(map(_type_name, kind.types))
        name = class_name(getattr(kind, "instance_class", tuple))
        return None if name is None or None in parts else (name, *parts)
    if isinstance(kind, types.NoneType):
        return "none"
    return _number_name(kind)


def _number_name(kind: Any) -> str | None:
    name = str(kind)
    return name if name in NUMBERS.values() else None


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
        return source_digest(self._module)

    def get_disambiguator(self) -> str:
        """Return what distinguishes kernels of one module: the line."""
        return str(self._line)


class _Code(CompileResultCacheImpl):  # type: ignore[misc]
    """How code is packed; its file is named by room, module, function and line."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._locator = _Locator(function)
        self._lineno = function.__code__.co_firstlineno
        self._function = function
        name = f"{function.__module__.removeprefix(OURS)}.{function.__qualname__}"
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

    @cached_property
    def _lock(self) -> Any:
        # Only what compiles needs it.
        from filelock import FileLock

        folder = kernel_folder() / LOCKS
        folder.mkdir(parents=True, exist_ok=True)
        return FileLock(folder / f"{kernel_name(self._py_func)}.lock")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the code of a signature.

        None where it is absent, damaged or out of reach; then it is compiled, which is announced.
        Where another process compiles the kernel, its code is waited for: what several workers need
        is compiled once.
        """
        if not all(_ours(kind) for kind in sig):
            self._announce()
            return None
        loaded = self._from_disk(sig, target_context)
        if loaded is None and self._hold():
            loaded = self._from_disk(sig, target_context)
            if loaded is not None:
                self.release()
        if loaded is None:
            self._announce()
        return loaded

    def _from_disk(self, sig: Any, target_context: Any) -> Any:
        key = type_key(sig)
        if key is not None and not is_stored(self._py_func, key):
            return None  # Left by a version that wrote no code that runs without Numba
        with contextlib.suppress(OSError, EOFError):
            return super().load_overload(sig, target_context)
        return None

    def _hold(self) -> bool:
        """Whether this process now holds the lock of the kernel, after other processes."""
        try:
            self._lock.acquire(timeout=0.0)
        except TimeoutError:
            self._announce()
            return self._held_later()
        except (OSError, NotImplementedError):
            return False
        return True

    def _held_later(self) -> bool:
        try:
            self._lock.acquire(timeout=MAX_COMPILING)
        except OSError:
            return False
        return True

    def release(self) -> None:
        """Let other processes compile the kernel, or load what was compiled."""
        lock = vars(self).get("_lock")
        if lock is not None and lock.is_locked:
            lock.release()

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code of a signature, unless it has a type from outside the package."""
        try:
            if all(_ours(kind) for kind in sig):
                super().save_overload(sig, data)
                with contextlib.suppress(OSError, ImportError, RuntimeError):
                    _store_alone(self._py_func, sig, data)
        finally:
            self.release()


def _store_alone(function: Callable[..., Any], kinds: tuple[Any, ...], compiled: Any) -> None:
    """Store code that runs without Numba, or that it cannot: what only kernels call has no wrapper.

    Parameters
    ----------
    function : that was compiled
    kinds : Numba's types of its arguments
    compiled : what Numba made of it
    """
    key = type_key(kinds)
    environments = _environments(compiled)
    whole = compiled.library._final_module
    symbols = [*whole.functions, *whole.global_variables]
    wrapper = compiled.fndesc.llvm_cpython_wrapper_name
    inside = {symbol.name for symbol in symbols if not symbol.is_declaration}
    outside = {symbol.name for symbol in symbols if symbol.is_declaration}
    if key is None:
        return
    code = b""
    if environments is not None and wrapper in inside and not compiled.reload_init:
        _, _, (code, _) = compiled.library.serialize_using_object_code()
    head = CodeHead(
        kernel=kernel_name(function),
        key=key,
        wrapper=wrapper if code else "",
        environments=environments or (),
        symbols=sorted(name for name in outside if not name.startswith("llvm.")),
        mathematics=sorted(intrinsics.INTR_MATH),
        digest=code_digest(code),
    )
    store_code(function, head, code)


def _environments(compiled: Any) -> list[tuple[str, list[str]]] | None:
    """List the environments of code, the wrapper's first, with the kinds of numbers they hold.

    None where one holds another object.
    """
    named = []
    for environment in (compiled.environment, *compiled._find_referenced_environments()):
        if not all(
            isinstance(value, np.dtype) and value in NUMBERS for value in environment.consts
        ):
            return None
        named.append((environment.env_name, [NUMBERS[value] for value in environment.consts]))
    return named

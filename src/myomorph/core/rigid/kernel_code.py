"""Machine code of kernels that runs without Numba, which takes longer to import than to use.

Whoever compiles a kernel with Numba leaves the object code that came out in a file of its own (see
`kernel_cache`). A later process gives that to LLVM and calls it: what Numba's code needs from
outside is in three small extension modules of Numba, which are loaded without the package around
them. Whatever differs (another version, another processor, a symbol that is missing, an argument
of a kind that is not listed here, a damaged file) leads to Numba itself, with the same results.
"""

from __future__ import annotations

import builtins
import ctypes
import hashlib
import importlib.util
import json
import os
import pickle
import platform
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.rigid.kernel_files import OURS, source_digest

FORM = 1  # Of the files; those of another are not read
SUFFIX = ".code"
NUMBA_ALONE = "MYOMORPH_NUMBA"
"""Environment variable by which all kernels run through Numba."""
TRIED = sys.platform == "linux" and platform.machine() == "x86_64"
"""Whether code has been tried without Numba on such a machine.

LLVM ends a process whose code it cannot link, so elsewhere kernels run through Numba.
"""
LAYOUTS = {0: "A", 1: "C", 2: "F", 3: "C"}
"""Order of an array's values by the first two of its flags."""
CONTIGUOUS = 0x3
ALIGNED = 0x100
WRITEABLE = 0x400
NUMBERS = {
    np.dtype(name): name
    for name in (
        "bool",
        "int8",
        "int16",
        "int32",
        "int64",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "float32",
        "float64",
        "complex64",
        "complex128",
    )
}
"""Kinds of numbers that arrays and scalars may have, in this machine's order of bytes."""
LONGEST_INTEGER = 63  # Bits of one without its sign

Key = tuple[Any, ...]
"""Types of the arguments of a call: strings, and tuples of them that begin with a class's name."""


class CodeHead(NamedTuple):
    """What is written before the object code of a kernel.

    Attributes
    ----------
    kernel : its module, function and line
    key : of its arguments
    wrapper : symbol of the function that Python calls; "" where the code runs through Numba alone
    environments : symbols that hold an environment, the wrapper's own first, each with the kinds
        of numbers of the arrays that it makes
    symbols : that are looked for outside
    mathematics : functions of C that Numba takes from Python's own library
    digest : of the object code
    """

    kernel: str
    key: Key
    wrapper: str
    environments: Sequence[tuple[str, Sequence[str]]]
    symbols: Sequence[str]
    mathematics: Sequence[str]
    digest: str


def call_key(arguments: Iterable[Any]) -> Key | None:
    """Name the types of the arguments of a call, as `kernel_cache` names Numba's.

    Parameters
    ----------
    arguments : numbers, arrays, None and tuples of them

    Returns
    -------
    None where one of them is of another kind
    """
    key = tuple(map(_kind, arguments))
    return None if None in key else key


def _kind(value: Any) -> Any:
    kind = type(value)
    if kind is np.ndarray:
        return array_kind(value.dtype, value.ndim, value.flags.num)
    if issubclass(kind, tuple):
        named = (class_name(kind), *map(_kind, value))
        return None if None in named else named
    if kind is int:
        return "int64" if value.bit_length() <= LONGEST_INTEGER else None
    if kind is float:
        return "float64"
    if kind is bool:
        return "bool"
    if value is None:
        return "none"
    return NUMBERS.get(value.dtype) if issubclass(kind, np.generic) else None


@cache
def array_kind(dtype: np.dtype[Any], ndim: int, flags: int) -> str | None:
    """Name the type of an array as Numba distinguishes them; None where no code is stored for it.

    Parameters
    ----------
    dtype, ndim : of the array
    flags : its flags as a number
    """
    if dtype not in NUMBERS or not flags & ALIGNED:
        return None
    return array_name(NUMBERS[dtype], ndim, LAYOUTS[flags & CONTIGUOUS], bool(flags & WRITEABLE))


def array_name(number: str, ndim: int, layout: str, writeable: bool) -> str:
    """Name the type of an array.

    Parameters
    ----------
    number : kind of its values
    ndim : number of its dimensions
    layout : order of its values, C, F or A for neither
    writeable : whether its values may be changed
    """
    access = "w" if writeable else "r"
    return f"{number} {ndim} {layout} {access}"


@cache
def class_name(kind: type) -> str | None:
    """Name a class of tuples; None for one from outside the package, which may be absent later."""
    if kind is tuple:
        return "tuple"
    return f"{kind.__module__}.{kind.__qualname__}" if kind.__module__.startswith(OURS) else None


def kernel_name(function: Callable[..., Any]) -> str:
    """Name a kernel by its room, module, function and line."""
    module = function.__module__.removeprefix(OURS)
    # No file name of Windows has such brackets, as of a function inside another.
    name = re.sub("[<>]", "", function.__qualname__)
    return f"{module}.{name}-{function.__code__.co_firstlineno}"


def stored_code(function: Callable[..., Any], key: Key | None) -> Callable[..., Any] | None:
    """Load the machine code of a kernel for arguments of some types.

    Parameters
    ----------
    function : that was compiled
    key : of `call_key`

    Returns
    -------
    the compiled function; None where it is not on disk or cannot run without Numba
    """
    if not TRIED or key is None or os.environ.get(NUMBA_ALONE) or not kernel_folder().is_dir():
        return None
    try:
        head, code = _read(_code_file(function, key))
        if head.kernel != kernel_name(function) or head.key != key or not head.wrapper:
            return None
        return _machine().function(function, head, code)
    except (OSError, ValueError, TypeError, KeyError, ImportError, AttributeError, RuntimeError):
        return None


def is_stored(function: Callable[..., Any], key: Key) -> bool:
    """Whether it is on disk how a kernel runs for arguments of some types, alone or by Numba.

    Parameters
    ----------
    function : that was compiled
    key : of `call_key`
    """
    return _code_file(function, key).is_file()


def stored_keys(function: Callable[..., Any]) -> list[Key]:
    """List the types of arguments for which code of the present sources is on disk."""
    name = kernel_name(function)
    keys = []
    for path in kernel_folder().glob(f"{name}-*{SUFFIX}"):
        try:
            head, _ = _read(path)
        except (OSError, ValueError, TypeError, KeyError):
            continue
        if path == _code_file(function, head.key):
            keys.append(head.key)
    return keys


def store_code(function: Callable[..., Any], head: CodeHead, code: bytes) -> None:
    """Write the machine code of a kernel, and remove what older sources of it have left.

    Parameters
    ----------
    function : that was compiled
    head : what describes the code
    code : the object file

    Raises
    ------
    OSError : where the folder cannot be written
    """
    path = _code_file(function, head.key)
    path.parent.mkdir(parents=True, exist_ok=True)
    for old in path.parent.glob(f"{head.kernel}-*{SUFFIX}"):
        if not old.name.startswith(f"{head.kernel}-{_stamp(function)}"):
            old.unlink(missing_ok=True)
    unfinished = path.with_suffix(f".{os.getpid()}")
    line = json.dumps({"form": FORM, **head._asdict()})
    unfinished.write_bytes(line.encode() + b"\n" + code)
    unfinished.replace(path)


def code_digest(code: bytes) -> str:
    """Digest of an object file."""
    return hashlib.sha256(code).hexdigest()


def _code_file(function: Callable[..., Any], key: Key) -> Path:
    kind = hashlib.sha256(json.dumps(key).encode()).hexdigest()[:16]
    return kernel_folder() / f"{kernel_name(function)}-{_stamp(function)}-{kind}{SUFFIX}"


def _stamp(function: Callable[..., Any]) -> str:
    """Hash of all but the arguments that code depends on: sources, Numba, Python, the processor."""
    whole = source_digest(function.__module__) + _versions()
    return hashlib.sha256(whole.encode()).hexdigest()[:16]


@cache
def _versions() -> str:
    import llvmlite.binding as llvm

    numba = hashlib.sha256((_numba_home() / "_version.py").read_bytes()).hexdigest()
    try:
        features = llvm.get_host_cpu_features().flatten()
    except RuntimeError:
        # LLVM knows no features of this processor, and so uses none.
        features = ""
    parts = (numba, sys.version, np.__version__, llvm.get_host_cpu_name(), features)
    return "\n".join(parts)


@cache
def _numba_home() -> Path:
    """Folder of the package, which is not imported."""
    found = importlib.util.find_spec("numba")
    if found is None or found.origin is None:
        raise ImportError("Numba is not installed")
    return Path(found.origin).parent


def _read(path: Path) -> tuple[CodeHead, bytes]:
    line, _, code = path.read_bytes().partition(b"\n")
    values = json.loads(line)
    if values["form"] != FORM or values["digest"] != code_digest(code):
        raise ValueError(f"{path} is not code of this version, or is damaged")
    head = CodeHead(
        kernel=values["kernel"],
        key=_as_tuple(values["key"]),
        wrapper=values["wrapper"],
        environments=values["environments"],
        symbols=values["symbols"],
        mathematics=values["mathematics"],
        digest=values["digest"],
    )
    return head, code


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value


class Machine:
    """LLVM with the symbols that code of Numba needs, to which object files are given."""

    def __init__(self) -> None:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        self._llvm = llvm
        self._lock = RLock()
        self._files: list[Any] = []
        self._bound: set[str] = set()
        self._dynamic = _extension("_dynfunc")
        self._helpers = _extension("_helperlib").c_helpers
        for name, address in {**self._helpers, **self._dynamic.c_helpers}.items():
            llvm.add_symbol(f"numba_{name}", address)
        self._unpickle = UNPICKLE(_unpickled)
        unpickle = ctypes.cast(self._unpickle, ctypes.c_void_p).value
        llvm.add_symbol("numba_unpickle", unpickle)
        for name, address in _extension("core/runtime/_nrt_python").c_helpers.items():
            llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
        llvm.add_symbol("_Py_NoneStruct", id(None))
        for value in vars(builtins).values():
            if isinstance(value, type) and issubclass(value, BaseException):
                llvm.add_symbol(f"PyExc_{value.__name__}", id(value))
        target = llvm.Target.from_default_triple().create_target_machine(
            opt=3, jit=True, codemodel="jitdefault", reloc="default"
        )
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)

    def function(
        self, function: Callable[..., Any], head: CodeHead, code: bytes
    ) -> Callable[..., Any]:
        """Make a function of Python from object code.

        Parameters
        ----------
        function : that was compiled
        head : of its file
        code : the object file

        Returns
        -------
        what takes the same arguments

        Raises
        ------
        ValueError : where a symbol that the code asks for is unknown, which LLVM would end on
        """
        for name in set(head.mathematics) - self._bound:
            self._llvm.add_symbol(name, self._helpers[name])
        self._bound |= set(head.mathematics)
        missing = [name for name in head.symbols if not self._llvm.address_of_symbol(name)]
        if missing:
            raise ValueError(f"code of {head.kernel} asks for {', '.join(missing)}")
        with self._lock:
            file = self._llvm.ObjectFileRef.from_data(code)
            self._engine.add_object_file(file)
            self._engine.finalize_object()
            self._files.append(file)
            address = self._engine.get_function_address(head.wrapper)
        if not address:
            raise ValueError(f"code of {head.kernel} has no {head.wrapper}")
        module = sys.modules[function.__module__]
        environments = []
        for name, numbers in head.environments:
            environment = self._dynamic.Environment(vars(module))
            environment.consts.extend(map(np.dtype, numbers))
            environments.append(environment)
            place = self._engine.get_global_value_address(name)
            if place:
                ctypes.c_void_p.from_address(place).value = id(environment)
        made: Callable[..., Any] = self._dynamic.make_function(
            module,
            function.__name__,
            function.__doc__ or "",
            address,
            environments[0],
            (environments, self),
        )
        return made


UNPICKLE = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
"""Of the function by which code gets objects that it holds: classes of results, errors."""
_OBJECTS: dict[tuple[int, int], Any] = {}


def _unpickled(address: int, length: int, digest: int) -> Any:
    """Make an object that code holds at an address, once."""
    place = (address, length)
    if place not in _OBJECTS:
        _OBJECTS[place] = pickle.loads(ctypes.string_at(address, length))
    return _OBJECTS[place]


@cache
def _machine() -> Machine:
    return Machine()


def _extension(name: str) -> ModuleType:
    """Load an extension module of Numba alone, or take the one in use."""
    loaded = sys.modules.get(f"numba.{name.replace('/', '.')}")
    if loaded is not None:
        return loaded
    for suffix in EXTENSION_SUFFIXES:
        path = _numba_home() / f"{name}{suffix}"
        if path.is_file():
            loader = ExtensionFileLoader(path.name.split(".")[0], str(path))
            spec = importlib.util.spec_from_loader(loader.name, loader)
            if spec is None:
                break
            module = importlib.util.module_from_spec(spec)
            loader.exec_module(module)
            return module
    raise ImportError(f"Numba has no {name}")

"""Kernels: functions over frames that Numba compiles when they are first called.

Numba takes longer to import than a recording to read, so the decorators here import nothing: what
only reads, checks or prints never meets Numba. Where machine code is kept is stated in
`kernel_cache`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import update_wrapper
from threading import RLock
from typing import Any

from myomorph.core.rigid.compile_notices import announce
from myomorph.core.rigid.kernel_code import Key, call_key, stored_code, stored_keys

_INTERPRETED = ContextVar("_INTERPRETED", default=False)
_UNCOMPILED = ContextVar("_UNCOMPILED", default=False)
_LOCK = RLock()
_OVERLOADS: list[tuple[Callable[..., Any], Callable[..., Any]]] = []
"""Functions that kernels call, with what makes their code, of which Numba does not know yet."""


class Kernel:
    """A function that is compiled at its first call, with its code kept on disk.

    Attributes
    ----------
    py_func : the function itself
    options : of `numba.njit`
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]):
        update_wrapper(self, function)
        self.py_func = function
        self.options = dict(options)
        self._dispatcher: Any = None
        self._forms: dict[Key | None, Callable[..., Any]] = {}

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the compiled function, or within `interpreted` the function itself."""
        if _INTERPRETED.get():
            return self.py_func(*arguments, **named)
        if named:
            return self.dispatcher(*arguments, **named)
        key = call_key(arguments)
        form = self._forms.get(key) or self._new_form(key)
        return form(*arguments)

    def _new_form(self, key: Key | None) -> Callable[..., Any]:
        """Take the code for arguments of some types from the disk, or else Numba's dispatcher."""
        with _LOCK:
            form = self._forms.get(key) or stored_code(self.py_func, key)
            if form is None and _UNCOMPILED.get():
                return interpreted()(self.py_func)
            self._forms[key] = form or self.dispatcher
        return self._forms[key]

    @property
    def forms(self) -> int:
        """For how many kinds of arguments this process has code, loaded or compiled."""
        return len(self._forms)

    @property
    def dispatcher(self) -> Any:
        """Numba's dispatcher of the function."""
        if self._dispatcher is None:
            with _LOCK:
                self._dispatcher = self._dispatcher or self._new_dispatcher()
        return self._dispatcher

    def _new_dispatcher(self) -> Any:
        # What only reads never comes here, and so never imports Numba.
        from myomorph.core.rigid.kernel_cache import dispatcher_of

        _register_overloads()
        return dispatcher_of(self.py_func, self.options, announce)

    @property
    def _numba_type_(self) -> Any:
        """The type by which Numba knows a kernel that another one calls."""
        return self.dispatcher._numba_type_

    @property
    def targetoptions(self) -> Any:
        """Options that Numba reads where it compiles a kernel as a part of another one."""
        return self.dispatcher.targetoptions

    def __reduce__(self) -> str:
        """Pickle a kernel by the name of its function."""
        return self.py_func.__qualname__


def kernel(
    function: Callable[..., Any] | None = None, /, counted: bool = True, **options: Any
) -> Any:
    """Compile a function with Numba at its first call, and store the code on disk.

    Used as `@kernel` or `@kernel(fastmath=True)`. It runs without the interpreter's lock.

    Parameters
    ----------
    function : to compile; None where options are given
    counted : whether it counts the users of the arrays it touches. Where a tuple of many arrays
        goes from function to function, that costs more than the arithmetic. A kernel that makes no
        array needs no count, and Numba refuses to compile one that makes some
    options : further ones of `numba.njit`
    """
    if function is None:
        return lambda function: kernel(function, counted, **options)
    if not counted:
        options["_nrt"] = False
    return Kernel(function, options)


def inner(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """`kernel` for what only kernels call: less to compile, but Python would crash on a call."""
    return kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)


def bare(function: Callable[..., Any], /) -> Any:
    """`inner` for what makes no arrays.

    Those that it reads are not counted by reference, which costs small kernels much. Views are
    allowed. What it calls must be bare, too.
    """
    return inner(function, _nrt=False)


def in_place(function: Callable[..., Any], /) -> Any:
    """`kernel` for what one kernel alone calls: compiled as a part of it, and not by itself."""
    return kernel(function, inline="always")


def overload(function: Callable[..., Any], /) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """`numba.extending.overload`, registered when Numba is first needed."""

    def register(implementation: Callable[..., Any]) -> Callable[..., Any]:
        _OVERLOADS.append((function, implementation))
        return implementation

    return register


def _register_overloads() -> None:
    """Let Numba know of the overloads that were declared since the last time."""
    from numba.extending import overload as numba_overload

    while _OVERLOADS:
        function, implementation = _OVERLOADS.pop(0)
        numba_overload(function)(implementation)


@contextmanager
def interpreted() -> Iterator[None]:
    """Kernels run as Python in here: slower by a hundred times, and at once.

    So do those that `over_frames` calls from here in other threads. Functions with an `overload`
    run their own bodies. Results are the same to the bit, but a division of Python's numbers by
    zero raises `ZeroDivisionError` where compiled code gives an infinite value.
    """
    before = _INTERPRETED.set(True)
    try:
        yield
    finally:
        _INTERPRETED.reset(before)


@contextmanager
def uncompiled() -> Iterator[None]:
    """Nothing is compiled in here: kernels whose code is not on disk run as Python."""
    before = _UNCOMPILED.set(True)
    try:
        yield
    finally:
        _UNCOMPILED.reset(before)


def signatures_on_disk(kernel: Kernel) -> list[Key]:
    """List the argument types for which code of a kernel, of the present sources, is on disk."""
    return stored_keys(kernel.py_func)

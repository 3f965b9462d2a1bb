"""Who is to know before kernels are compiled, which takes half a minute."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

_ANNOUNCED: dict[Callable[[Path, bool], None], bool] = {}
"""Listeners of `before_compiling`, and whether each was called."""


def before_compiling(listener: Callable[[Path, bool], None]) -> None:
    """Call a listener once, before the first kernel of this process is compiled.

    Parameters
    ----------
    listener : takes the folder of kernels and whether their code can be stored there
    """
    _ANNOUNCED.setdefault(listener, False)


def announce() -> None:
    """Call the listeners that were not called yet."""
    # Commands that compile nothing ask for listeners only.
    from myomorph.core.model.cache_folder import kernel_folder
    from myomorph.core.rigid.kernel_files import can_keep_kernels

    for listener in [listener for listener, called in _ANNOUNCED.items() if not called]:
        _ANNOUNCED[listener] = True
        listener(kernel_folder(), can_keep_kernels())

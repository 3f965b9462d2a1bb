"""Public names of a package, imported when they are first used.

A stub (`__init__.pyi`) beside the package says which module each name comes from. Type checkers
and editors read the same file, so a public name is written once, and `import myomorph` loads
nothing that takes time.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import resolve_name
from pathlib import Path
from typing import Any, NamedTuple


class Source(NamedTuple):
    """Where a public name comes from."""

    module: str
    name: str


class LazyNames(NamedTuple):
    """What a package assigns to `__getattr__`, `__dir__` and `__all__`."""

    get: Callable[[str], Any]
    list_names: Callable[[], list[str]]
    names: list[str]


def lazy_names(package: str, init_file: str) -> LazyNames:
    """Public names of a package from the stub beside its `__init__.py`.

    Parameters
    ----------
    package : dotted name, the `__name__` of the package
    init_file : path of its `__init__.py`, its `__file__`

    Returns
    -------
    Functions that import a name and list all names, and the names
    """
    sources = _sources(package, Path(init_file).with_suffix(".pyi"))

    def get(name: str) -> Any:
        source = sources.get(name)
        if source is None:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = _imported(source)
        setattr(sys.modules[package], name, value)
        return value

    def list_names() -> list[str]:
        return sorted(sources)

    return LazyNames(get=get, list_names=list_names, names=list_names())


def _sources(package: str, stub: Path) -> dict[str, Source]:
    """Public names that a stub imports."""
    sources = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.ImportFrom):
            continue
        module = resolve_name("." * node.level + (node.module or ""), package)
        for alias in node.names:
            sources[alias.asname or alias.name] = Source(module=module, name=alias.name)
    return sources


def _imported(source: Source) -> Any:
    """Import a name of a module, or a module of a package."""
    module = import_module(source.module)
    if hasattr(module, source.name):
        return getattr(module, source.name)
    return import_module(f"{source.module}.{source.name}")

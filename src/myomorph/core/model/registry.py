"""The extensions that there are: wings of the package, and installed packages.

A wing is a folder of the package with a file `extension.py`, an installed package one with an entry
point of the group `myomorph`; either is an `Extension`. The tables of commands, steps, inputs,
formats, muscle models, contact laws and demos take up what they declare.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TypeVar

from myomorph.core.model.errors import one_line
from myomorph.core.model.extension import OWN, Extension

GROUP = "myomorph"
"""Of the entry points of installed packages."""
DECLARATION = "extension"  # Module of a wing that declares it, and there its `EXTENSION`.
METADATA = (".dist-info", ".egg-info")  # Endings of folders that describe installed packages.

Entry = TypeVar("Entry")

_remarks: dict[str, bool] = {}  # What is wrong with extensions, and whether it was printed.


@dataclass(frozen=True, kw_only=True)
class Provider:
    """An extension and the wing or the package that brings it, in words."""

    name: str
    extension: Extension


@lru_cache(maxsize=1)
def providers() -> tuple[Provider, ...]:
    """List all extensions that can be loaded: wings, then installed packages, by name."""
    return (*_wings(), *_installed())


def extensions() -> tuple[Extension, ...]:
    """Return what they declare."""
    return tuple(provider.extension for provider in providers())


def with_extensions(
    own: Mapping[str, Entry], kind: str, added: Callable[[Extension], Mapping[str, Entry]]
) -> dict[str, Entry]:
    """Return a table with what extensions add to it.

    A name that is taken stays with its owner, and the other one is remarked.

    Parameters
    ----------
    own : entries of the table itself
    kind : what its names are, for the remark
    added : from an extension to what it has for the table
    """
    table = dict(own)
    for provider in providers():
        for name, entry in added(provider.extension).items():
            if name in table:
                remark(f"{provider.name}: there is a {kind} '{name}' already: this one is left out")
            else:
                table[name] = entry
    return table


def remark(text: str) -> None:
    """Note what is wrong with an extension, to be printed once."""
    _remarks.setdefault(text, False)


def new_remarks() -> tuple[str, ...]:
    """Return what was noted since the last call."""
    new = tuple(text for text, printed in _remarks.items() if not printed)
    _remarks.update(dict.fromkeys(new, True))
    return new


def _wings() -> Iterator[Provider]:
    homes = chain.from_iterable(Path(place).iterdir() for place in import_module(OWN).__path__)
    for name in sorted(home.name for home in homes if (home / f"{DECLARATION}.py").is_file()):
        declared = import_module(f"{OWN}.{name}.{DECLARATION}").EXTENSION
        yield Provider(name=f"wing {name}", extension=declared)


def _installed() -> Iterator[Provider]:
    # Python's own reader of metadata takes 0.1 s to import: only where there is something to find.
    if not any(map(_has_extension, dict.fromkeys(sys.path))):
        return
    from importlib.metadata import entry_points

    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value)):
        package = point.dist.name if point.dist is not None else point.module
        name = f"package '{package}'"
        try:
            declared = point.load()
        except Exception as error:
            reason = one_line(f"{type(error).__name__}: {error}")
            remark(
                f"{name}: its extension '{point.name}' is left out, since {point.value} cannot be"
                f" imported ({reason}): update the package or uninstall it"
            )
            continue
        if not isinstance(declared, Extension):
            remark(
                f"{name}: its extension '{point.name}' is left out, since {point.value} is a"
                f" {type(declared).__name__} and no Extension: update the package or uninstall it"
            )
            continue
        yield Provider(name=name, extension=declared)


def _has_extension(place: str) -> bool:
    """Whether a folder of Python's path has a package with an entry point of the group."""
    try:
        with os.scandir(place or ".") as found:
            folders = [entry.path for entry in found if entry.name.endswith(METADATA)]
    except OSError:
        return False
    return any(map(_declares, folders))


def _declares(folder: str) -> bool:
    try:
        with open(os.path.join(folder, "entry_points.txt"), "rb") as stream:
            lines = stream.read().splitlines()
    except OSError:
        return False
    return any(line.strip() == b"[%s]" % GROUP.encode() for line in lines)

"""Folders of results as users name them: those of extensions, and of demonstrations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph.core.model.errors import check_name
from myomorph.core.model.extension import Extension, FolderReader, load
from myomorph.core.model.registry import extensions

if TYPE_CHECKING:
    from myomorph.core.model.model import Model


def folder_reader(
    folder: Path, kinds: Callable[[Extension], Sequence[FolderReader]]
) -> FolderReader | None:
    """Return what shows a folder of results of an extension; None for those of a trial or a study.

    Parameters
    ----------
    folder : of results
    kinds : readers of an extension that come into question
    """
    readers = (reader for extension in extensions() for reader in kinds(extension))
    return next((reader for reader in readers if reader.knows(folder)), None)


def demo_model(name: str) -> Model:
    """Make the model of a demonstration's results.

    Raises
    ------
    UnknownName : no demonstration has that name
    """
    demos = {name: demo for each in extensions() for name, demo in each.demos.items() if demo.model}
    check_name("demo", name, demos, "the installation")
    return load(demos[name].model)(name)

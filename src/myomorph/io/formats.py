"""A model file of any kind, told apart by its name."""

from __future__ import annotations

import os
from pathlib import Path

from myomorph.io.osim.read import read_osim
from myomorph.model.errors import BadFile
from myomorph.model.model import Model


def read_model(path: str | os.PathLike[str]) -> Model:
    """The model in an OpenSim (`.osim`) or MuJoCo (`.xml`, `.mjcf`) file.

    Raises
    ------
    BadFile
        The file cannot be read, or its name ends in something else.
    """
    ending = Path(path).suffix.lower()
    if ending == ".osim":
        return read_osim(path)
    if ending in (".xml", ".mjcf"):
        # MuJoCo takes a moment to import, and OpenSim's users never need it.
        from myomorph.io.mjcf.read import read_mjcf

        return read_mjcf(Path(path))
    raise BadFile(path, f"is not a model: its name ends in '{ending}'", "expected .osim or .xml")

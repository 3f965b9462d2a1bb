"""Kinds of model and recording files by the endings of their names, and the reader of each.

The one place where formats are registered.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from myomorph.core.model.errors import BadFile
from myomorph.core.model.extension import Format
from myomorph.core.model.model import Model
from myomorph.core.model.registry import extensions
from myomorph.core.model.series import Trial

MODELS: tuple[Format, ...] = (
    Format("OpenSim model", (".osim",), "myomorph.core.io.osim.read:read_osim"),
    Format("MuJoCo model", (".xml", ".mjcf"), "myomorph.core.io.mjcf.read:read_mjcf"),
    *(kind for extension in extensions() for kind in extension.models),
)
"""Each reader gives a `Model`."""

COMPOSED = "myo-sim:"
"""Before the name of a model that the package `myo-sim` composes, where a file's path may stand:
`myo-sim:myoarm`.
"""

TRIALS: tuple[Format, ...] = (
    Format("TRC markers", (".trc",), "myomorph.core.io.trc:read_trc"),
    Format("C3D recording", (".c3d",), "myomorph.core.io.c3d.read:read_c3d"),
    Format("Qualisys recording", (".mat",), "myomorph.core.io.qualisys_mat:read_qualisys_mat"),
    Format("keypoints", (".h5", ".hdf5"), "myomorph.core.io.keypoints:read_keypoints"),
    *(kind for extension in extensions() for kind in extension.recordings),
)
"""Each reader gives a `Trial` with markers in metres."""

CHANNELS: tuple[Format, ...] = tuple(
    kind for extension in extensions() for kind in extension.channels
)
"""Files of channels alone, as EMG, besides tables; each reader gives a `Series`."""


def model_format(path: str | os.PathLike[str]) -> Format | None:
    """Find the kind of model file by the ending of a name.

    Parameters
    ----------
    path : of the file, which need not exist

    Returns
    -------
    the first of the `MODELS` with that ending, in any case of letters; None if none has it
    """
    return _format(path, MODELS)


def trial_format(path: str | os.PathLike[str]) -> Format | None:
    """Find the kind of recording by the ending of a name.

    Parameters
    ----------
    path : of the file, which need not exist

    Returns
    -------
    the first of the `TRIALS` with that ending, in any case of letters; None if none has it
    """
    return _format(path, TRIALS)


def channel_format(path: str | os.PathLike[str]) -> Format | None:
    """Find the kind of a file of channels by the ending of a name.

    Parameters
    ----------
    path : of the file, which need not exist

    Returns
    -------
    the first of the `CHANNELS` with that ending, in any case of letters; None if none has it
    """
    return _format(path, CHANNELS)


def is_part(path: Path) -> bool:
    """Return whether a file is read along with another recording, by a format's `part`.

    Parameters
    ----------
    path : searched whole, folders included, with / between its parts
    """
    return any(kind.part and re.search(kind.part, path.as_posix()) for kind in TRIALS)


def is_composed(path: str | os.PathLike[str]) -> bool:
    """Return whether this names a model of `myo-sim` and no file.

    Parameters
    ----------
    path : of a file, or a name such as "myo-sim:myoarm"
    """
    return os.fspath(path).startswith(COMPOSED)


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read the model in a file of one of the `MODELS`.

    Source: Seth et al. 2018 (OpenSim); Todorov, Erez and Tassa 2012 (MJCF).

    Parameters
    ----------
    path : of the file (.osim, .xml of MuJoCo, ...), or a model of the package `myo-sim` by name
        ("myo-sim:myoarm")

    Returns
    -------
    the model in meters, radians and kilograms; `warnings` say what was odd in the file

    Raises
    ------
    BadFile : the file cannot be read, or its name ends in something else

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> model.coordinate_names, model.muscle_names
    (('shoulder_flexion', 'elbow_flexion'), ('flexor', 'extensor'))
    """
    kind = model_format(path)
    if is_composed(path):
        kind = Format("model of myo-sim", (), "myomorph.core.io.mjcf.composed:composed_model")
    if kind is None:
        raise BadFile(
            path, f"is not a model: its name ends in '{_ending(path)}'", "expected .osim or .xml"
        )
    return kind.read(Path(path))


def read_trial(path: str | os.PathLike[str]) -> Trial:
    """Read a recording of one of the `TRIALS`.

    Parameters
    ----------
    path : of the file (.trc, .c3d, .mat, .h5, ...)

    Returns
    -------
    markers (frames, markers, 3) [m] in the file's axes, with analog channels and force plates as
    the file stores them

    Raises
    ------
    BadFile : the file cannot be read, or its name ends in something else
    """
    kind = trial_format(path)
    if kind is None:
        expected = ", ".join(ending for kind in TRIALS for ending in kind.endings)
        raise BadFile(
            path,
            f"does not hold markers: its name ends in '{_ending(path)}'",
            f"expected {expected}",
        )
    return kind.read(Path(path))


def _format(path: str | os.PathLike[str], formats: tuple[Format, ...]) -> Format | None:
    return next((kind for kind in formats if os.fspath(path).lower().endswith(kind.endings)), None)


def _ending(path: str | os.PathLike[str]) -> str:
    return Path(path).suffix.lower()

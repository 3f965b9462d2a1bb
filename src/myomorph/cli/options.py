"""Command-line options made of the steps' option dataclasses, and those that many commands share."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from myomorph.model.frozen_map import FrozenMap
from myomorph.store.settings import settings_of

ModelFile = Annotated[Path, Parameter(name="--model", help="OpenSim (.osim) or MuJoCo (.xml) model.")]
MotionFile = Annotated[Path, Parameter(name="--motion", help="Coordinates over time (.mot or .sto).")]
LOADS_HELP = (
    "an OpenSim external loads file (.xml), a table of forces (.mot, .sto, .csv), or a recording with force plates "
    "(.c3d)"
)
LoadsFile = Annotated[Path | None, Parameter(name="--loads", help=f"External forces: {LOADS_HELP}.")]
ForceBodies = Annotated[
    tuple[str, ...],
    Parameter(
        name="--bodies",
        help="PREFIX=BODY ...: what the columns of each force of a table begin with, and the body it acts on; the foot "
        "that is nearest to its center of pressure by default.",
        consume_multiple=True,
    ),
]
PlateBodies = Annotated[
    str,
    Parameter(
        name="--plates",
        help="BODY,BODY,...: bodies on a recording's force plates in their order, none for one that is left out; the "
        "foot that is nearest to the center of pressure, step by step, by default.",
    ),
]
OutFile = Annotated[Path, Parameter(name="--out", help="File to write; the same values go into a .nc file beside it.")]
OutFolder = Annotated[Path, Parameter(name="--out", help="Folder to write; it is made where it does not exist.")]
Time = Annotated[
    tuple[float, float] | None,
    Parameter(name="--time", help="START END: use only this part of the recording [s].", consume_multiple=True),
]
LabelsFile = Annotated[
    Path | None,
    Parameter(
        name="--labels",
        help='Map of marker labels (.csv of lines "recorded,model", or .toml); an empty model name drops a marker.',
    ),
]
EmgMuscles = Annotated[
    tuple[str, ...],
    Parameter(
        name="--emg-muscles",
        help="CHANNEL=MUSCLE[,MUSCLE...] of EMG channels whose names contain no muscle, one or more.",
        consume_multiple=True,
    ),
]
DrawCount = Annotated[
    int | None,
    Parameter(
        name="--draws",
        help="Compute it anew so many times with errors in all inputs, 200 for example; beside every table stand its "
        "limits of 90 % (NAME_low, NAME_high), and uncertainty.csv says what contributes.",
    ),
]
DrawProcesses = Annotated[
    int | None,
    Parameter(
        name="--workers",
        help="Processes that share the draws; by default as many as threads, where that is worth their start.",
    ),
]
UncertaintyFile = Annotated[
    Path | None,
    Parameter(
        name="--uncertainty",
        help="Sizes of the errors (.toml of lines 'placement = 0.008'), in the place of usual ones; "
        "'myomorph uncertainty --help' lists them.",
    ),
]
Threads = Annotated[int | None, Parameter(name="--threads", help="Threads to use; all cores by default.")]


def options_class(*sources: type, leave_out: tuple[str, ...] = ()) -> Any:
    """A dataclass whose fields are the settings of option dataclasses, each a command-line option.

    Parameters
    ----------
    sources : option dataclasses of steps
    leave_out : settings that another option gives
    """
    fields: list[tuple[str, Any, Any]] = []
    for source in sources:
        for setting in settings_of(source):
            if setting.name in leave_out or setting.name in {name for name, _, _ in fields}:
                continue
            text = f"{setting.help[:1].upper()}{setting.help[1:]}".rstrip(".") + "."
            kind = Annotated[setting.kind, Parameter(help=text)]  # type: ignore[name-defined]
            fields.append((setting.name, kind, dataclasses.field(default=setting.default)))
    made = dataclasses.make_dataclass("Options", fields, frozen=True, namespace={"__module__": __name__})
    return Annotated[made, Parameter(name="*")]


def labels_of(path: Path | None) -> Mapping[str, str]:
    """What `LabelsFile` says."""
    # Most commands run without: loaded where labels are given.
    from myomorph.io.labels import read_labels

    return FrozenMap({} if path is None else read_labels(path))


def settings_dict(options: Any) -> dict[str, Any]:
    """The options as a mapping; empty where there are none."""
    return {} if options is None else dataclasses.asdict(options)


def use_threads(threads: int | None) -> None:
    """Let the kernels use so many threads.

    Raises
    ------
    BadData
        where that is less than one
    """
    # Imported by the command that needs it: --help and the others start without.
    import os

    from myomorph.model.errors import BadData

    if threads is None:
        return
    if threads < 1:
        raise BadData(f"--threads {threads}: expected 1 or more")
    os.environ["MYOMORPH_THREADS"] = str(threads)

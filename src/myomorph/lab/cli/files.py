"""Commands on files and folders of results: `info`, `convert` and `report`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from myomorph.lab.cli.options import documented, inputs_class, inputs_of_flags
from myomorph.lab.cli.output import said, warn

ConvertInputs = inputs_class("loads", "time", leave_out=("loads", "bodies"))


@documented
def info_command(file: Path, /, *, reasons: bool = False) -> int:
    """Print what is in a model, C3D, TRC, MOT or STO file, and what is wrong with it.

    Of a folder of recordings it prints who was recorded, when, and in which movements.

    Parameters
    ----------
    file : model, recording, table, or folder of recordings
    reasons : for a folder, print the evidence for each statement
    """
    from myomorph.lab.info.inspect import inspect

    for line in inspect(file, reasons).lines():
        said(line)
    return 0


@documented
@dataclass(frozen=True, kw_only=True)
class Conversion:
    """How a recording is converted.

    Attributes
    ----------
    up : vertical axis of the written files; by default y, as in OpenSim, and unchanged in a C3D
        file
    forward : axis of the walking direction, reached by rotations of 90 degrees; unchanged by
        default
    axes : new axes expressed in the old ones, instead of --up and --forward; x,z,-y rotates z up to
        y up
    units : unit of lengths in a TRC file
    labels : table of new names (.csv: label, new name); an empty new name drops the marker or
        channel
    """

    up: Literal["", "y", "z", "keep"] = ""
    forward: Literal["", "x", "-x", "y", "-y", "z", "-z"] = ""
    axes: str = ""
    units: Literal["mm", "cm", "m"] = "mm"
    labels: Path | None = None


AS_IT_IS = Conversion()


@documented
def convert_command(
    files: list[Path],
    /,
    *,
    out: Path,
    conversion: Annotated[Conversion, Parameter(name="*")] = AS_IT_IS,
    inputs: ConvertInputs | None = None,  # type: ignore[valid-type]
) -> int:
    """Write a recording as other files: C3D to TRC, MOT with external loads and STO, and back.

    Parameters
    ----------
    files : recording (.c3d, .trc, .mat), tables of forces and EMG (.mot, .sto, .csv), or several of
        them
    out : file to write, whose ending determines the content: .trc for markers, .mot for forces with
        external loads (.xml), .sto or .csv for EMG or a table, .c3d for everything; or a folder for
        all files
    conversion : axes, units and names
    inputs : plates and time
    """
    from myomorph.core.io.labels import read_labels
    from myomorph.lab.convert.convert import ConvertOptions, convert
    from myomorph.lab.study.inputs.loads import LoadsFile
    from myomorph.lab.study.inputs.time_span import TimeSpan

    named = inputs_of_flags(inputs)
    options = ConvertOptions(
        up=conversion.up,
        forward=conversion.forward,
        axes=conversion.axes,
        units=conversion.units,
        labels={} if conversion.labels is None else read_labels(conversion.labels),
        plates=named.or_default(LoadsFile).plates,
        time=named.or_default(TimeSpan).time,
    )
    made = convert(files, out, options)
    warn(made.notes, "'myomorph info FILE' lists those of the file")
    for path, held in made.files:
        said(f"wrote {path}: {held}")
    return 0

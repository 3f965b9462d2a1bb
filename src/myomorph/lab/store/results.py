"""Results as files: NetCDF with provenance, whole or not at all, and the folders that hold them."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from myomorph import __version__
from myomorph.core.io.formats import is_composed
from myomorph.core.io.parsing.hdf5 import ERRORS
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.findings import Finding
from myomorph.core.model.messages import Message, messages_of, messages_text, unique
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance, Source
from myomorph.lab.store.digests import file_digest, seal
from myomorph.lab.store.netcdf import (
    HeldFile,
    NetcdfFile,
    NetcdfSource,
    NetcdfVariable,
    as_text,
    new_netcdf,
    open_netcdf,
)
from myomorph.lab.store.table_digests import read_digests, table_digests

STORED = ".nc"
PROVENANCE = "provenance_"
REMARKS = "warnings_"
TABLES = "tables_"
"""What facts of a single step begin with: what its values were made from, its warnings, and the
digests of its tables.
"""
STEP = "step"
BLOCK_ROWS = 512
BLOCK_COLUMNS = 64
# What every result file tells first.
WHOSE = {"Conventions": "CF-1.10", "source": f"myomorph {__version__}"}


def file_source(role: str, path: str | os.PathLike[str]) -> Source:
    """Name a file as input of a step, by its hash; a model of `myo-sim` by its version."""
    if is_composed(path):
        # It takes long to import, and few models are of `myo-sim`.
        from importlib.metadata import version

        return value_source(role, str(path), str(path), version("myo-sim"))
    try:
        return Source(role, str(path), file_digest(path))
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror or error})") from None


def file_sources(*named: tuple[str, Path | None]) -> tuple[Source, ...]:
    """Files as inputs of a step, each with its role; those that are None are left out."""
    return tuple(file_source(role, path) for role, path in named if path is not None)


def value_source(role: str, name: str, *values: object) -> Source:
    """Name a value that was made in memory as input of a step.

    Arrays count by their bytes, the rest by its text.
    """
    digest = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            digest.update(np.ascontiguousarray(value).tobytes())
        else:
            digest.update(repr(value).encode())
    return Source(role, name, digest.hexdigest())


def provenance_of(
    step: str, sources: Iterable[Source], options: Mapping[str, object]
) -> Provenance:
    """Provenance of a result that is being made now, by this version."""
    return Provenance(
        step=step,
        sources=tuple(sources),
        options=dict(options),
        version=__version__,
        date=made_at(),
    )


def fixed_date() -> int | None:
    """Read the time that results are to be dated with [s since 1970], from SOURCE_DATE_EPOCH.

    None for that of the clock. Results of the same inputs are then equal byte for byte, whenever
    they were made.
    """
    seconds = os.environ.get("SOURCE_DATE_EPOCH", "")
    return int(seconds) if seconds.isdigit() else None


def made_at() -> str:
    """Return the date of a result that is made now, ISO 8601 with time zone."""
    fixed = fixed_date()
    now = datetime.now(UTC) if fixed is None else datetime.fromtimestamp(fixed, UTC)
    return now.isoformat(timespec="seconds")


class ResultWriter:
    """An open NetCDF file that takes named values.

    It is made by `new_result`, or held in memory.
    """

    def __init__(self, file: NetcdfFile | HeldFile, step: str = ""):
        self._file = file
        self._step = step

    def names(self, dimension: str, names: Sequence[str]) -> None:
        """Make a dimension whose entries have names, unless it exists already; none makes none."""
        if dimension in self._file.dimensions or not names:
            return
        self.sizes(dimension, len(names))
        self.texts(dimension, dimension, names)

    def sizes(self, dimension: str, size: int) -> None:
        """Make a dimension without names, unless it exists already."""
        if dimension not in self._file.dimensions:
            self._file.dimensions[dimension] = size

    def texts(self, name: str, dimension: str, texts: Sequence[str]) -> None:
        """Write a text for every entry of a dimension, unless it is there already."""
        if name not in self._file and dimension in self._file.dimensions:
            self._file.variable(name, (dimension,), _texts(), np.array(list(texts), dtype=object))

    def time(self, time: Array) -> None:
        """Make the dimension of time.

        Parameters
        ----------
        time : (frames,) [s]
        """
        if "time" not in self._file.dimensions:
            self.sizes("time", len(time))
            self._file.variable("time", ("time",), np.float64, np.asarray(time)).attrs["units"] = (
                "s"
            )

    def create(
        self,
        name: str,
        dimensions: tuple[str, ...],
        unit: str,
        meaning: str,
        kind: Any = np.float64,
    ) -> Any:
        """Make a variable to be filled part by part: `variable[start:stop] = values`."""
        attributes = {"units": unit, "long_name": meaning} | (
            {STEP: self._step} if self._step else {}
        )
        return self._create(name, dimensions, kind, attributes)

    def _create(
        self, name: str, dimensions: tuple[str, ...], kind: Any, attributes: Mapping[str, Any]
    ) -> Any:
        shape = tuple(self._file.dimensions[dimension] for dimension in dimensions)
        chunks = None
        if shape and min(shape) > 0 and np.prod(shape) > BLOCK_ROWS * BLOCK_COLUMNS:
            limits = (BLOCK_ROWS, *(BLOCK_COLUMNS,) * (len(shape) - 1))
            chunks = tuple(min(size, limit) for size, limit in zip(shape, limits, strict=True))
        variable = self._file.variable(name, dimensions, kind, chunks=chunks)
        self._file.tell(variable, attributes)
        return variable

    def put(
        self, name: str, dimensions: tuple[str, ...], values: Any, unit: str, meaning: str
    ) -> None:
        """Make a variable and fill it; truth values become 0 and 1."""
        values = np.asarray(values)
        kind = np.int8 if values.dtype == bool else values.dtype
        variable = self.create(name, dimensions, unit, meaning, kind)
        if values.size:
            variable[...] = values.astype(kind)

    def fact(self, name: str, value: str) -> None:
        """Write a text about the whole file."""
        self._file.attributes[name] = value

    def provenance(self, provenance: Provenance) -> None:
        """Write what a step's values were made from."""
        self.fact(PROVENANCE + provenance.step, provenance.to_json())

    def remarks(self, step: str, texts: Sequence[str]) -> None:
        """Write the warnings of a step, one line each."""
        self.fact(REMARKS + step, messages_text(texts))

    def tables(self, step: str, folder: Path, leave_out: str = "") -> None:
        """Write the digests of the tables of a step, which lie in a folder."""
        self.fact(TABLES + step, json.dumps(table_digests(folder, leave_out)))

    def gather_remarks(self, steps: Sequence[str], others: Sequence[str]) -> None:
        """Put the warnings of the steps of this file together, in their order.

        They come before other lines. A step of a result that an older version wrote left its lines
        among all of them.
        """
        facts = self._file.attributes
        known = [step for step in steps if REMARKS + step in facts]
        remarks = [text for step in known for text in messages_of(facts[REMARKS + step])]
        kept = () if len(known) == len(steps) else messages_of(facts.get("warnings", "[]"))
        self.fact("warnings", messages_text(unique([*remarks, *others, *kept])))

    def copy(self, path: Path, steps: Sequence[str]) -> None:
        """Take over what some steps wrote into another result, block by block.

        What is here already stays.
        """
        with open_netcdf(path) as other:
            self.take(other, steps)

    def take(self, other: NetcdfSource | HeldFile, steps: Sequence[str]) -> None:
        """Take the same over from a file that is open, or held in memory."""
        for variable in other.variables():
            made_by = as_text(variable.told.get(STEP, ""))
            if variable.name not in self._file and (not made_by or made_by in steps):
                self._copy_variable(variable)
        for name, value in other.attributes.items():
            marked = any(
                name.startswith(prefix) and name[len(prefix) :] not in steps
                for prefix in (PROVENANCE, REMARKS, TABLES)
            )
            if name not in self._file.attributes and not marked:
                self.fact(name, value)

    def _copy_variable(self, variable: NetcdfVariable) -> None:
        name = variable.name
        values = variable.values
        dimensions = variable.dimensions
        for dimension, size in zip(dimensions, values.shape, strict=True):
            known = self._file.dimensions.setdefault(dimension, size)
            if known != size:
                raise BadData(f"'{name}' has {size} of {dimension}, what is there already {known}")
        if values.dtype.kind in "OSU":
            texts = np.array([as_text(value) for value in values[...]], dtype=object)
            copied = self._file.variable(name, dimensions, _texts(), texts)
            self._file.tell(copied, variable.told)
            return
        copied = self._create(name, dimensions, values.dtype, variable.told)
        if not values.shape:
            copied[...] = values[...]
        for start in range(0, values.shape[0] if values.shape else 0, BLOCK_ROWS):
            copied[start : start + BLOCK_ROWS] = values[start : start + BLOCK_ROWS]


def _texts() -> Any:
    """Return the type of texts in a file."""
    import h5py

    return h5py.string_dtype()


@contextmanager
def new_result(path: str | os.PathLike[str], step: str = "") -> Iterator[ResultWriter]:
    """Make a NetCDF file that appears under its name only when it is whole, with its digest.

    Parameters
    ----------
    path : of the file
    step : what makes its values
    """
    path = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    try:
        with new_netcdf(name) as file:
            file.attributes |= WHOSE
            yield ResultWriter(file, step)
        seal(name)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


@read_only
class Stored:
    """A result as read back: values by name, the names along each dimension, and its provenance.

    Attributes
    ----------
    path : of the result file
    values : numeric variables
    names : of the entries of each dimension that has names, and other variables of texts
    provenance : by step
    facts : texts about the whole
    """

    path: Path
    values: Mapping[str, Array]
    names: Mapping[str, tuple[str, ...]]
    provenance: Mapping[str, Provenance]
    facts: Mapping[str, str]

    @property
    def time(self) -> Array:
        """(frames,) [s]."""
        return self.values["time"]


def result_files(folder: Path) -> list[Path]:
    """List the result files in a folder, or the file itself; raises `BadFile` if there are none."""
    if not folder.exists():
        raise BadFile(
            folder, "does not exist", "give a folder that run, tension, muscles or demo wrote"
        )
    inside = [folder] if folder.is_file() else sorted(folder.rglob(f"*{STORED}"))
    paths = [path for path in inside if ".steps" not in path.parts]
    if not paths:
        raise BadFile(
            folder,
            f"holds no results: no file in it ends in {STORED}",
            "give the --out of run or tension",
        )
    return paths


DAMAGED = (*ERRORS, BadFile)
"""What is raised on a damaged file, or on one of another kind: links to nothing, groups, sizes
beyond all memory.
"""


def read_result(path: str | os.PathLike[str], leave_out: Sequence[str] = ()) -> Stored:
    """Read a NetCDF that `new_result` wrote.

    Parameters
    ----------
    path : of the file
    leave_out : variables that are not needed and may be large
    """
    try:
        with open_netcdf(path) as file:
            return stored_values(path, file, leave_out)
    except BadFile:
        raise
    except DAMAGED as error:
        raise BadFile(
            path, f"is not a result of Myomorph ({error})", "give a NetCDF file that a step wrote"
        ) from None


def stored_values(
    path: str | os.PathLike[str],
    file: NetcdfSource | HeldFile,
    leave_out: Sequence[str] = (),
    only: Sequence[str] = (),
) -> Stored:
    """Read what a file holds that is open, or in memory until it has that path.

    Parameters
    ----------
    path : of the file
    file : open, or in memory
    leave_out : variables that are not needed
    only : variables, () for all
    """
    values = {}
    names = {}
    for name, variable in file.data(only):
        if name in leave_out:
            continue
        if variable.dtype.kind in "OSU":
            names[name] = tuple(as_text(text) for text in variable[...])
        else:
            values[name] = variable[...]
    attributes = dict(file.attributes)
    facts = {name: text for name, text in attributes.items() if not name.startswith(PROVENANCE)}
    return Stored(
        path=Path(path), values=values, names=names, provenance=made_from(attributes), facts=facts
    )


def made_from(attributes: Mapping[str, str]) -> dict[str, Provenance]:
    """Provenance by step, from the texts about a whole file."""
    marked = {name: text for name, text in attributes.items() if name.startswith(PROVENANCE)}
    return {name[len(PROVENANCE) :]: Provenance.from_json(text) for name, text in marked.items()}


def stored_provenance(path: str | os.PathLike[str]) -> dict[str, Provenance]:
    """Provenance by step of a result file, empty where there is none or it is damaged."""
    if not Path(path).is_file():
        return {}
    try:
        with open_netcdf(path) as file:
            return made_from(file.attributes)
    except DAMAGED:
        return {}


def stored_tables(path: str | os.PathLike[str]) -> dict[str, dict[str, str]]:
    """Digests of the tables of each step of a result file, by their paths; empty as above."""
    if not Path(path).is_file():
        return {}
    try:
        with open_netcdf(path) as file:
            marked = {
                name.removeprefix(TABLES): text
                for name, text in file.attributes.items()
                if name.startswith(TABLES)
            }
    except DAMAGED:
        return {}
    return {step: read_digests(text) for step, text in marked.items()}


@contextmanager
def whole_folder(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Make a folder whose new files appear all together.

    They are written beside it and then moved in. Files that are in the folder already stay, unless
    a new one has their name.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise BadFile(folder, "is a file, but results go into a folder", "give --out another name")
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        yield temporary
        os.chmod(temporary, 0o755)
        if not folder.exists():
            os.replace(temporary, folder)
        else:
            for path in sorted(path for path in temporary.rglob("*") if path.is_file()):
                (folder / path.relative_to(temporary)).parent.mkdir(parents=True, exist_ok=True)
                os.replace(path, folder / path.relative_to(temporary))
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def file_name(name: str) -> str:
    """Make a name of the model part of a file's name.

    Other characters than letters, digits, - . _ become _.
    """
    return "".join(
        character if character.isalnum() or character in "-._" else "_" for character in name
    )


def coordinate_units(model: Model, names: Sequence[str]) -> tuple[str, ...]:
    """Name the unit of each coordinate: "rad", "m", or "" where it is the file's own."""
    units = {"rotational": "rad", "translational": "m", "coupled": ""}
    return tuple(units[model.coordinate(name).motion] for name in names)


def put_findings(writer: ResultWriter, name: str, findings: Sequence[Finding]) -> None:
    """Write findings as a text about the whole file."""
    writer.fact(name, findings_text(findings))


def get_findings(stored: Stored, name: str) -> tuple[Finding, ...]:
    """Read what `put_findings` wrote; none where an older version wrote the file."""
    return findings_of(stored.facts.get(name, "[]"))


def findings_text(findings: Sequence[Finding]) -> str:
    """Write findings as JSON."""
    return json.dumps([finding.record for finding in findings])


def findings_of(text: str) -> tuple[Finding, ...]:
    """Read what `findings_text` wrote."""
    records = json.loads(text)
    return tuple(
        Finding(
            kind=record["kind"],
            place=record["place"],
            text=Message.of_record(record.get("message", record["text"])),
            times=tuple((start, stop) for start, stop in record["times"]),
            repaired=record.get("repaired", record.get("mended", False)),
        )
        for record in records
    )

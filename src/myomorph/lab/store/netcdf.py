"""NetCDF-4 files as the HDF5 that they are: dimensions are scales that variables refer to.

Libraries for NetCDF look through the whole file for every variable they make, which for the many
small ones of a short recording takes longer than the recording's steps. A result that is quickly
computed is held in memory, not on disk, until it is whole.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.parsing.hdf5 import MAX_BYTES, open_hdf5
from myomorph.core.model.errors import BadFile
from myomorph.lab.store.digests import Seal, seal_of

BARE = "This is a netCDF dimension but not a netCDF variable."
SCALE = "DIMENSION_SCALE"
INTERNAL = (
    "CLASS",
    "NAME",
    "DIMENSION_LIST",
    "REFERENCE_LIST",
    "_FillValue",
    "_Netcdf4Dimid",
    "_Netcdf4Coordinates",
)
"""Attributes that belong to the format itself."""


NUMBERS = {"mass": "kg"}
"""Attributes of a whole file that are numbers, with their units; one that is not known is left out.
"""


class NetcdfFile:
    """An open file that takes dimensions, variables and attributes; made by `new_netcdf`."""

    def __init__(self, file: Any):
        self._file = file
        self._write_text = _texts_of()
        self.dimensions: dict[str, int] = {}
        self._variables: dict[str, tuple[Any, tuple[str, ...]]] = {}
        self.attributes: dict[str, str] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._variables

    def variable(
        self,
        name: str,
        dimensions: tuple[str, ...],
        kind: Any,
        values: Any = None,
        chunks: tuple[int, ...] | None = None,
    ) -> Any:
        """Make a variable; its values may also come later, part by part."""
        shape = tuple(self.dimensions[dimension] for dimension in dimensions)
        filler = np.nan if np.dtype(kind).kind == "f" and values is None else None
        made = self._file.create_dataset(
            name, shape, kind, data=values, chunks=chunks, fillvalue=filler
        )
        if filler is not None:
            made.attrs["_FillValue"] = np.array([filler], kind)
        self._variables[name] = (made, dimensions)
        return made

    def tell(self, variable: Any, told: Mapping[str, Any]) -> None:
        """Write attributes of a variable that was made just now."""
        for name, value in told.items():
            if isinstance(value, str):
                self._write_text(variable, name, value)
            else:
                variable.attrs[name] = value

    def finish(self) -> None:
        """Make the dimensions, let the variables refer to them, and write the attributes."""
        scales = {}
        for number, (name, size) in enumerate(self.dimensions.items()):
            if name in self._variables:
                scale, _ = self._variables[name]
                scale.make_scale(name)
            else:
                scale = self._file.create_dataset(name, (size,), ">f4")
                scale.make_scale(f"{BARE}{size:10d}")
            scale.attrs["_Netcdf4Dimid"] = np.int32(number)
            scales[name] = scale
        for name, (variable, dimensions) in self._variables.items():
            if name not in scales:
                for axis, dimension in enumerate(dimensions):
                    variable.dims[axis].attach_scale(scales[dimension])
        for name, text in self.attributes.items():
            if name in NUMBERS:
                if text:
                    self._file.attrs[name] = float(text)
                    self._write_text(self._file, f"{name}_unit", NUMBERS[name])
            elif name.removesuffix("_unit") not in NUMBERS:
                self._write_text(self._file, name, text)


def _texts_of() -> Callable[[Any, str, str], None]:
    """Make a function that writes a new attribute as the library does, without looking for it.

    There are many.
    """
    import h5py

    kind = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
    space = h5py.h5s.create(h5py.h5s.SCALAR)

    def write(owner: Any, name: str, text: str) -> None:
        h5py.h5a.create(owner.id, name.encode(), kind, space).write(np.array(text, dtype=object))

    return write


class _Disk:
    """A file for HDF5, whose first failed write is reported after.

    HDF5 ends the whole process where a write fails.
    """

    def __init__(self, path: str | os.PathLike[str]):
        # Without a buffer of Python's: what fails must fail here and not when the file is closed.
        self._file = open(path, "w+b", buffering=0)  # noqa: SIM115 - closed by close
        self.failure: OSError | None = None

    def write(self, content: Any) -> int:
        """Write all bytes, or remember why not."""
        left = memoryview(content)
        try:
            while left and self.failure is None:
                left = left[self._file.write(left) :]
        except OSError as error:
            self.failure = error
        return len(content)

    def readinto(self, content: Any) -> int:
        """Read as many bytes as there is place for; none come after the end."""
        size = self._file.readinto(content) or 0
        memoryview(content)[size:] = bytes(len(content) - size)
        return len(content)

    def read(self, size: int = -1) -> bytes:
        """Bytes from here on; `readinto` is used instead, but this is what tells a file."""
        return self._file.read(size) or b""

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the position."""
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        """Make the file as long as this."""
        try:
            self._file.truncate(size)
        except OSError as error:
            self.failure = self.failure or error
        return self._file.tell() if size is None else size

    def flush(self) -> None:
        """Nothing: writes are not held back."""

    def close(self) -> None:
        """Close the file; raises what failed."""
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or error
        if self.failure is not None:
            raise self.failure


@contextmanager
def new_netcdf(path: str | os.PathLike[str]) -> Iterator[NetcdfFile]:
    """Make a new file; where an error ends the block, it is left unfinished."""
    import h5py

    with closing(_Disk(path)) as disk, h5py.File(disk, "w", track_order=True) as file:
        made = NetcdfFile(file)
        yield made
        made.finish()


@dataclass(frozen=True)
class NetcdfVariable:
    """A variable of an open file: its data set, attributes and names of dimensions.

    The data set is read by its parts; attributes of the format are left out.
    """

    name: str
    values: Any
    told: Mapping[str, Any]
    dimensions: tuple[str, ...]


class NetcdfSource:
    """An open file with variables by name, written by `new_netcdf` or by another library.

    `largest` : bytes that a variable may have, None for any.
    """

    def __init__(self, file: Any, largest: int | None = None):
        self._file = file
        self._largest = largest
        self._names: dict[Any, str] = {}

    @cached_property
    def attributes(self) -> dict[str, str]:
        """Texts about the whole file."""
        return {
            name: as_text(value)
            for name, value in self._file.attrs.items()
            if not name.startswith("_NC")
        }

    def data(self, only: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
        """Yield name and data set of variables, in the order in which they were made where known.

        Parameters
        ----------
        only : names, () for all
        """
        for name in [name for name in only if name in self._file] if only else self._file:
            values = self._file[name]
            if self._largest is not None and values.nbytes > self._largest:
                raise ValueError(f"'{name}' has {values.nbytes / 2**30:.1f} GiB")
            if "NAME" not in values.attrs or not as_text(values.attrs["NAME"]).startswith(BARE):
                yield name, values

    def variables(self) -> Iterator[NetcdfVariable]:
        """Yield the same with all their attributes."""
        for name, values in self._file.items():
            # Attributes are slow to find: they are read once, but never the long list of who refers
            # to a dimension.
            attributes = {
                attr: values.attrs[attr] for attr in values.attrs if attr != "REFERENCE_LIST"
            }
            if as_text(attributes.get("NAME", "")).startswith(BARE):
                continue
            told = {
                attribute: value
                for attribute, value in attributes.items()
                if attribute not in INTERNAL
            }
            dimensions = tuple(
                self._name(first) for first, *_ in attributes.get("DIMENSION_LIST", ())
            )
            own = (name,) if as_text(attributes.get("CLASS", "")) == SCALE else ()
            yield NetcdfVariable(name=name, values=values, told=told, dimensions=dimensions or own)

    def _name(self, reference: Any) -> str:
        """Look up what a reference to a dimension leads to, once."""
        if reference not in self._names:
            self._names[reference] = self._file[reference].name.removeprefix("/")
        return self._names[reference]


@contextmanager
def open_netcdf(path: str | os.PathLike[str]) -> Iterator[NetcdfSource]:
    """Open a file to read from.

    One that fits its own digest is read at once, one without is a stranger's: a child reads it
    first.

    Parameters
    ----------
    path : of the file

    Yields
    ------
    its variables and attributes

    Raises
    ------
    BadFile : its digest shows that it is damaged, or the door refuses it
    OSError : it is no HDF5
    """
    sealed = seal_of(path)
    if sealed is Seal.DAMAGED:
        raise BadFile(
            path,
            "is damaged: it does not match its digest",
            "run the command that wrote it again, or take a copy of it",
        )
    if sealed is Seal.NONE:
        with open_hdf5(Path(path), in_order=True) as file:
            yield NetcdfSource(file, MAX_BYTES)
        return
    import h5py

    with h5py.File(path, "r", track_order=True) as file:
        yield NetcdfSource(file)


def as_text(value: Any) -> str:
    """Read a text of the file, however it is stored."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


@dataclass(eq=False)
class HeldVariable:
    """Values with their attributes, used like a data set of a file."""

    values: Any
    dimensions: tuple[str, ...]
    attrs: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, part: Any) -> Any:
        return self.values[part]

    def __setitem__(self, part: Any, values: Any) -> None:
        self.values[part] = values


class HeldFile:
    """A file that is held in memory.

    It takes dimensions, variables and attributes as `NetcdfFile` does, and gives them as
    `NetcdfSource` does.
    """

    def __init__(self) -> None:
        self.dimensions: dict[str, int] = {}
        self.attributes: dict[str, str] = {}
        self._variables: dict[str, HeldVariable] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._variables

    def variable(
        self,
        name: str,
        dimensions: tuple[str, ...],
        kind: Any,
        values: Any = None,
        chunks: tuple[int, ...] | None = None,
    ) -> HeldVariable:
        """Make a variable; values may follow later, part by part. Chunks are those on the disk."""
        kind = np.dtype(kind)
        if values is None:
            shape = tuple(self.dimensions[dimension] for dimension in dimensions)
            values = np.full(shape, np.nan if kind.kind == "f" else 0, kind)
        else:
            # A copy, since whoever gave them may go on to use them.
            values = np.array(values, kind)
        self._variables[name] = HeldVariable(values, dimensions)
        return self._variables[name]

    @staticmethod
    def tell(variable: HeldVariable, told: Mapping[str, Any]) -> None:
        """Write attributes of a variable."""
        variable.attrs.update(told)

    def data(self, only: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
        """Yield name and values of variables, in the order in which they were made.

        Parameters
        ----------
        only : names, () for all
        """
        for name in [name for name in only if name in self] if only else self._variables:
            yield name, self._variables[name].values

    def variables(self) -> Iterator[NetcdfVariable]:
        """Yield the same with all their attributes."""
        for name, variable in self._variables.items():
            # In the order in which a file gives them.
            told = dict(sorted(variable.attrs.items()))
            yield NetcdfVariable(
                name=name, values=variable.values, told=told, dimensions=variable.dimensions
            )

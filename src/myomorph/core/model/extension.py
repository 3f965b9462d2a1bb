"""What a wing of the package, or an installed package, adds to Myomorph.

Everything is declared by a name and by the place where it is found, "module:attribute". A place is
imported when it is first used, so that a declaration costs nothing. `registry` finds the
extensions; docs/adding.md has an example.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadExtension
from myomorph.core.model.frozen_map import FrozenMap

OWN = "myomorph"  # This package.

_failed: dict[str, BadExtension] = {}


def is_own(place: str) -> bool:
    """Whether a place is in this package, so that a failure there is a fault of ours."""
    return place.split(".")[0] == OWN


def load(place: str, attribute: str = "") -> Any:
    """Import what is at a place.

    Parameters
    ----------
    place : "module:attribute", or "module" alone
    attribute : of the module, where the place names none

    Raises
    ------
    BadExtension : a place of an installed package cannot be imported
    """
    module, _, name = place.partition(":")
    if is_own(place):
        return getattr(import_module(module), name or attribute)
    if place in _failed:
        raise _failed[place]
    try:
        return getattr(import_module(module), name or attribute)
    except Exception as error:
        _failed[place] = BadExtension(module.partition(".")[0], place, error)
        raise _failed[place] from error


@dataclass(frozen=True, kw_only=True)
class CommandEntry:
    """A command.

    Attributes
    ----------
    function : place of the command, see `lab.cli.app`
    help : its line in the program's help
    example : of its use
    panel : of the program's help that it stands in
    first_options : what its `--help` shows where it has many options
    rare_options : those that no help lists, for study files above all
    option_panels : by the title of a panel, options of its own that stand there
    """

    function: str
    help: str
    example: str = ""
    panel: str = ""
    first_options: tuple[str, ...] = ()
    rare_options: tuple[str, ...] = ()
    option_panels: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))


@dataclass(frozen=True, kw_only=True)
class StepEntry:
    """A step of a study.

    Attributes
    ----------
    name : in study files, and on the command line where it is a step of a trial
    place : of the `Step`
    scope : what it is done once for, see `lab.study.step.step_table`
    before : step of the scope that it runs before; by default it is the last
    help : its line in the program's help
    """

    name: str
    place: str
    scope: str = "trial"
    before: str = ""
    help: str = ""


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    name : of the kind, in a few words
    endings : of the names of such files, in small letters
    reader : place of the function from a path to what the file holds
    part : regular expression of paths of files that are read with those of another recording
    """

    name: str
    endings: tuple[str, ...]
    reader: str
    part: str = ""

    def read(self, path: Path) -> Any:
        """Read a file of this kind; raises what its reader raises."""
        return load(self.reader)(path)


@dataclass(frozen=True, kw_only=True)
class DemoEntry:
    """A demonstration, which `myomorph demo --study NAME` runs.

    Attributes
    ----------
    run : place of the function from its name and the folder to write to an exit status
    help : what is shown
    model : place of the function from its name to the model of its results, "" where their model is
        a file
    needs : packages that are not there with every installation, by the module that each brings
    extra : of Myomorph that brings them
    """

    run: str
    help: str
    model: str = ""
    needs: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    extra: str = ""


@dataclass(frozen=True, kw_only=True)
class SampleEntry:
    """A small recording that comes by its name.

    Attributes
    ----------
    make : place of the function that gives the `Sample`
    repeats : the function takes a number: each gives another recording
    needs : packages that are not there with every installation, by the module that each brings
    extra : of Myomorph that brings them
    """

    make: str
    repeats: bool = False
    needs: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    extra: str = ""


@dataclass(frozen=True, kw_only=True)
class FolderReader:
    """A page for a kind of folders of results.

    Attributes
    ----------
    files : patterns of files of which such a folder holds one or more
    function : place of the function of the folder
    """

    files: tuple[str, ...]
    function: str

    def knows(self, folder: Path) -> bool:
        """Whether the folder is of this kind."""
        return any(any(folder.glob(pattern)) for pattern in self.files)

    def read(self, folder: Path) -> Any:
        """Call the function with the folder."""
        return load(self.function)(folder)


@dataclass(frozen=True, kw_only=True)
class MotionRequest:
    """What `identify` needs from a source of motions.

    Attributes
    ----------
    motions, loads : files, one each per recording
    mass : of the subject [kg]; the model's where None
    time : first and last time of what is used [s]; None for all
    settings : options by name
    """

    motions: tuple[Path, ...]
    loads: tuple[Path, ...]
    mass: float | None
    time: tuple[float, float] | None
    settings: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class MotionSource:
    """A way by which motions come to `identify`, besides files.

    Attributes
    ----------
    help : of the switch that asks for it
    options : place of its option dataclass
    open : place of the function from model and `MotionRequest` to the motions
    """

    help: str
    options: str
    open: str


@dataclass(frozen=True, kw_only=True)
class Extension:
    """Parts that a wing or an installed package adds, each by its name.

    Attributes
    ----------
    commands : of the program
    steps : of studies
    inputs : of trials: places of their `Input`
    recordings : formats whose readers give a `Trial`
    models : formats whose readers give a `Model`
    sensors : formats whose readers give `InertialSensors`
    channels : formats whose readers give a `Series` of channels, as EMG
    muscle_models : places of subclasses of `MuscleModel`, by the class of the muscles in files
    contact_laws : places of subclasses of `Cone`, by the name in contact files
    quantities : places of tuples of `Quantity` that are no step's own
    demos : of the program
    samples : small recordings by name
    pictures : places of functions that draw a value for notebooks as HTML, by its class
    motion_sources : of `identify`, by the switch that asks for each
    reports : what makes the report of a folder again, and gives its path
    replays : what gives the recordings of a folder by name, as a page plays them
    """

    commands: Mapping[str, CommandEntry] = field(default_factory=lambda: FrozenMap({}))
    steps: tuple[StepEntry, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    recordings: tuple[Format, ...] = ()
    models: tuple[Format, ...] = ()
    sensors: tuple[Format, ...] = ()
    channels: tuple[Format, ...] = ()
    muscle_models: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    contact_laws: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    quantities: tuple[str, ...] = ()
    demos: Mapping[str, DemoEntry] = field(default_factory=lambda: FrozenMap({}))
    pictures: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    samples: Mapping[str, SampleEntry] = field(default_factory=lambda: FrozenMap({}))
    motion_sources: Mapping[str, MotionSource] = field(default_factory=lambda: FrozenMap({}))
    reports: tuple[FolderReader, ...] = ()
    replays: tuple[FolderReader, ...] = ()

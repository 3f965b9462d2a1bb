"""Command-line options from the steps' option dataclasses, and those shared by commands."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable, Mapping
from inspect import signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_origin, get_type_hints

from cyclopts import Parameter

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store.settings import attribute_help, settings_of
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.keys import Key, flag_of
from myomorph.lab.study.inputs.table import input_of, settings_of_keys
from myomorph.lab.study.step.step import StepHead

Documented = TypeVar("Documented", bound=Callable[..., Any])
ModelFile = Annotated[
    Path, Parameter(name="--model", help="OpenSim (.osim) or MuJoCo (.xml) model.")
]
MotionFile = Annotated[
    Path, Parameter(name="--motion", help="Coordinates over time (.mot or .sto).")
]
LOADS_HELP = (
    "an OpenSim external loads file (.xml), a table of forces (.mot, .sto, .csv), or a recording"
    " with force plates (.c3d)"
)
Loads = Annotated[
    tuple[Path, ...],
    Parameter(
        name="--loads",
        help=f"External forces, one file per recording, in the same order: {LOADS_HELP}.",
    ),
]
OutFile = Annotated[
    Path,
    Parameter(
        name="--out", help="File to write; a .nc file with the same values is written next to it."
    ),
]
OutFolder = Annotated[
    Path,
    Parameter(name="--out", help="Folder for the results; it is created if it does not exist."),
]
DrawCount = Annotated[
    int | None,
    Parameter(
        name="--draws",
        help=(
            "Number of repetitions with random errors in all inputs, for example 200;"
            " every table gets the bounds of its 90 % interval (NAME_low, NAME_high), and"
            " uncertainty.csv lists the contribution of each source of error."
        ),
    ),
]
DrawProcesses = Annotated[
    int | None,
    Parameter(
        name="--workers",
        help=(
            "Number of processes that share the draws; by default as many as threads, if that saves"
            " time."
        ),
    ),
]
UncertaintyFile = Annotated[
    Path | None,
    Parameter(
        name="--uncertainty",
        help=(
            "Standard deviations of the errors that replace the defaults (.toml with lines such as"
            " 'placement = 0.008'); 'myomorph uncertainty --help' lists them."
        ),
    ),
]
Threads = Annotated[
    int | None, Parameter(name="--threads", help="Number of threads; all cores by default.")
]


def options_class(
    *sources: type, leave_out: tuple[str, ...] = (), switches: Mapping[str, str] = FrozenMap({})
) -> Any:
    """Make a dataclass of the settings of option dataclasses, each a command-line option.

    Parameters
    ----------
    sources : option dataclasses of steps
    leave_out : settings that another option gives
    switches : texts in the help of switches that are off by default, by name
    """
    fields: list[tuple[str, Any, Any]] = []
    for source in sources:
        for setting in settings_of(source):
            if setting.name in leave_out or setting.name in {name for name, _, _ in fields}:
                continue
            kind = Annotated[setting.kind, Parameter(help=_sentence(setting.help))]  # type: ignore[name-defined]
            fields.append((setting.name, kind, dataclasses.field(default=setting.default)))
    fields += [
        (name, Annotated[bool, Parameter(help=_sentence(text), negative=())], False)
        for name, text in switches.items()
    ]
    made = dataclasses.make_dataclass(
        "Options", fields, frozen=True, namespace={"__module__": __name__}
    )
    return Annotated[made, Parameter(name="*")]


def inputs_class(*names: str, leave_out: tuple[str, ...] = ()) -> Any:
    """Make a dataclass of the keys of a trial's inputs, each a command-line option.

    Parameters
    ----------
    names : of inputs, see `study.inputs.table`
    leave_out : keys that the command has of its own, as several files of one
    """
    keys = [key for name in names for key in input_of(name).keys if key.name not in leave_out]
    fields = [(key.name, flag(key), dataclasses.field(default=_no_flag(key))) for key in keys]
    made = dataclasses.make_dataclass(
        "Inputs", fields, frozen=True, namespace={"__module__": __name__, "NAMES": names}
    )
    return Annotated[made, Parameter(name="*")]


def flag(key: Key) -> Any:
    """Make the annotation of a command's parameter from a key of an input."""
    return Annotated[key.flag, Parameter(name=flag_of(key.name), help=_sentence(key.help))]


def documented(owner: Documented) -> Documented:
    """Give each parameter of a command, or attribute of its options, the help in its docstring.

    A parameter whose annotation has help keeps it. What is off by default is only switched on.
    """
    kinds = get_type_hints(owner, include_extras=True)
    defaults = {name: parameter.default for name, parameter in signature(owner).parameters.items()}
    for name, text in attribute_help(
        owner, "Attributes" if isinstance(owner, type) else "Parameters"
    ).items():
        if not _has_help(kinds[name]):
            described = Parameter(help=_sentence(text))
            if defaults[name] is False:
                described = Parameter(help=_sentence(text), negative=())
            kinds[name] = Annotated[kinds[name], described]
    owner.__annotations__ = kinds
    return owner


def _has_help(kind: Any) -> bool:
    parts = getattr(kind, "__metadata__", ())
    return any(isinstance(part, Parameter) and part.help for part in parts)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}".rstrip(".") + "."


def _no_flag(key: Key) -> Any:
    """Return what a command gets where a flag is not there."""
    if key.kind.flag is None:
        return key.default
    if key.flag is str:
        return ""
    if get_origin(key.flag) is tuple:
        return ()
    return None


def inputs_of_flags(flags: Any, near: bool = False) -> ByType:
    """Collect settings of inputs from a value of `inputs_class`, None where no flag is there.

    Parameters
    ----------
    flags : value of `inputs_class`, or None
    near : files are looked for near the recordings too, so that options of a file may stand without
        it

    Raises
    ------
    BadData : a flag stands without the one that it belongs to
    """
    if flags is None:
        return ByType()
    values: dict[str, Any] = {}
    for declared in map(input_of, flags.NAMES):
        keys = [key for key in declared.keys if hasattr(flags, key.name)]
        written = [key for key in keys if getattr(flags, key.name) != _no_flag(key)]
        main = next((key for key in keys if key.name == declared.main), None)
        if written and main is not None and main not in written and not near:
            value = getattr(flags, written[0].name)
            word = f" {value}" if isinstance(value, str) else ""
            alone = flag_of(written[0].name) + word
            needed = flag_of(main.name)
            raise BadData(f"{alone} without {needed}: give {needed} too, or leave both out")
        values |= {key.name: key.kind.parsed(key.name, getattr(flags, key.name)) for key in written}
    return settings_of_keys(values, flags.NAMES)


def settings_dict(options: Any) -> dict[str, Any]:
    """Return the options as a mapping; empty where there are none."""
    return {} if options is None else dataclasses.asdict(options)


def settings_by_step(options: Any, steps: Iterable[StepHead]) -> dict[str, dict[str, Any]]:
    """Options that are not the usual ones, by the first step that has them."""
    changed = settings_dict(options)
    settings: dict[str, dict[str, Any]] = {}
    for step in steps:
        for setting in step.settings:
            if setting.name in changed and changed.pop(setting.name) != setting.default:
                settings.setdefault(step.name, {})[setting.name] = getattr(options, setting.name)
    return settings


def use_threads(threads: int | None) -> None:
    """Let the kernels use so many threads. Raises `BadData` where that is less than one."""
    if threads is None:
        return
    if threads < 1:
        raise BadData(f"--threads {threads}: expected 1 or more")
    os.environ["MYOMORPH_THREADS"] = str(threads)

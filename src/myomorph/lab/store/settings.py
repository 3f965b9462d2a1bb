"""Options of steps as settings that command line and study files share, by option dataclasses."""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import (
    Any,
    Literal,
    Self,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from myomorph.core.model.errors import BadData

Options = TypeVar("Options")

Measured: TypeAlias = Literal["exact", "shared", "hidden"]
"""What measured forces are used for where contacts are estimated."""

Preset: TypeAlias = Literal["", "taichi", "tap", "drum", "judo", "gait", "lift", "motion"]
"""A kind of motion that reports know (`report.presets`), "" for the one that fits."""

Side: TypeAlias = Literal["", "right", "left"]  # Side of a body, "" where it is not specified.

SIMPLE = (bool, int, float, str)


@dataclass(frozen=True)
class Setting:
    """An option of a command or a study file.

    Attributes
    ----------
    name : of the option
    kind : bool, int, float, str, a Literal of texts, or one of these or None
    default : where nothing is given
    help : for the command line
    """

    name: str
    kind: Any
    default: Any
    help: str


@dataclass(frozen=True)
class Differentiation:
    """Low-pass filter before derivatives.

    Attributes
    ----------
    cutoff : Cutoff frequency of the low-pass filter of coordinates and external forces [Hz]; 0 for
        none, as OpenSim's default; by default it is chosen by the noise of the recording, and
        smooth motions are not filtered (`choose_cutoff`).
    """

    cutoff: float | None = None

    def __post_init__(self) -> None:
        if self.cutoff is not None and not 0.0 <= self.cutoff < float("inf"):
            raise BadData(
                f"cutoff {self.cutoff} Hz: expected a positive frequency, or 0 for no filter"
            )


@dataclass(frozen=True)
class ForceOptions:
    """What is done with external forces before they act.

    Attributes
    ----------
    force_checks : comparison of external forces with the motion: repair (correct certain errors),
        report (only report them) or none
    force_shift : offset added to the times of external forces, if their clock differs from the
        motion's [s]
    force_columns : names of the columns of a table of forces in order, separated by commas, if its
        header does not state them: time,Fx1,Fy1,Fz1,COPx1,COPy1,COPz1,Mx1, ...; - skips a column
    force_rate : sampling rate of a table of forces without times [Hz]
    force_origins : reference points of the moments of forces without a center of pressure, along
        the table's axes [m]: x,y,z of each force, separated by semicolons; by default the origin
    """

    force_checks: Literal["repair", "report", "none"] = "repair"
    force_shift: float = 0.0
    force_columns: str = ""
    force_rate: float = 0.0
    force_origins: str = ""

    def __post_init__(self) -> None:
        if not abs(self.force_shift) < float("inf"):
            raise BadData(f"force shift {self.force_shift} s: expected a number of seconds")


@dataclass(frozen=True)
class TorqueTable:
    """What the table of inverse dynamics holds.

    Attributes
    ----------
    net : subtract the forces of springs, dampers and limits of joints and of the muscles'
        viscosity, as OpenSim's tool does with forces_to_exclude Muscles; by default nothing is
        subtracted, as with ALL
    independent_coordinates : write only independent coordinates, with the forces of dependent ones
        (of couplers and closed loops) projected onto them; by default every coordinate has its own
        column, as in OpenSim
    """

    net: bool = False
    independent_coordinates: bool = False


@dataclass(frozen=True)
class EmgUse:
    """Show EMG with the activations, but do not use it for muscle tensions."""

    emg_display_only: bool = False


@dataclass(frozen=True)
class TensionTables:
    """What is written beside muscle tensions.

    Attributes
    ----------
    reactions : write the loads that joints transmit to their child bodies (joint_reactions.sto), in
        the axes of the child, the parent or the ground (OpenSim's default)
    intervals : number of evenly spaced times at which the range of estimated contact forces that
        the data allow is computed (contact_intervals.sto); 0 for none
    """

    reactions: Literal["none", "child", "parent", "ground"] = "none"
    intervals: int = 25

    def __post_init__(self) -> None:
        if self.intervals < 0:
            raise BadData(f"intervals at {self.intervals} instants: expected 0 or more")


@dataclass(frozen=True)
class ReportOptions:
    """How a report looks at a motion.

    Attributes
    ----------
    preset : kind of motion, which determines panels, muscles and phases shown; by default the one
        that fits the recording
    muscles : muscles shown, by the report's names ("Soleus") or the model's, instead of those of
        the preset
    """

    preset: Preset = ""
    muscles: tuple[str, ...] = ()


def settings_of(options: type) -> tuple[Setting, ...]:
    """Collect the settings of an option dataclass: what a number, a text or a switch can give.

    Fields of other types (mappings, motions) are not settings: they come from files. Where a
    dataclass has a `SETTING_PREFIX`, names begin with it, so that they are known from those of
    other steps.
    """
    return _settings_of(options)


@cache
def _settings_of(options: type) -> tuple[Setting, ...]:
    hints = get_type_hints(options)
    helps = attribute_help(options)
    return tuple(
        Setting(
            name=prefix_of(options) + field.name,
            kind=hints[field.name],
            default=field.default,
            help=helps.get(field.name, ""),
        )
        for field in dataclasses.fields(options)
        if _is_simple(hints[field.name]) and field.default is not dataclasses.MISSING
    )


def prefix_of(options: type) -> str:
    """Return what the names of an option dataclass's settings begin with."""
    return getattr(options, "SETTING_PREFIX", "")


def attribute_help(owner: Any, heading: str = "Attributes") -> dict[str, str]:
    """Read what a section of a numpydoc docstring says of each attribute, as one line.

    Those of bases are read too. Of an only attribute the docstring itself says it.
    """
    text = inspect.cleandoc(owner.__doc__ or "")
    if (
        dataclasses.is_dataclass(owner)
        and len(alone := dataclasses.fields(owner)) == 1
        and "\n---" not in text
    ):
        return {alone[0].name: " ".join(text.split())}
    section = re.search(rf"^{heading}\n-+\n(.*?)(?=\n\S+\n-+\n|\Z)", text, re.DOTALL | re.MULTILINE)
    result = {
        name: text
        for base in getattr(owner, "__bases__", ())
        for name, text in attribute_help(base).items()
    }
    names: list[str] = []
    for line in section.group(1).splitlines() if section else []:
        start = re.match(r"(\w+(?:, \w+)*) : (.*)", line)
        if start:
            names = start.group(1).split(", ")
            result |= dict.fromkeys(names, start.group(2).strip())
        elif line.strip():
            result |= {name: f"{result[name]} {line.strip()}" for name in names}
    return result


def with_settings(options: Options, settings: Mapping[str, Any]) -> Options:
    """Give options the settings that are theirs; None leaves a default as it is."""
    names = {setting.name for setting in settings_of(type(options))}
    prefix = prefix_of(type(options))
    changes = {
        name.removeprefix(prefix): value
        for name, value in settings.items()
        if name in names and value is not None
    }
    return dataclasses.replace(options, **changes)  # type: ignore[type-var]


def plain_settings(options: object) -> dict[str, object]:
    """List the settings of an option value as plain values, for provenance and reports."""
    prefix = prefix_of(type(options))
    names = [setting.name for setting in settings_of(type(options))]
    return {name: getattr(options, name.removeprefix(prefix)) for name in names}


@dataclass(frozen=True)
class TrialMotion:
    """The motion that trials go on with.

    Attributes
    ----------
    use_motions : Trials go on with the refined motion, forces filtered alike; else with that of
        inverse kinematics on the refined model.
    """

    use_motions: bool = True


@dataclass(frozen=True)
class SettingGroup:
    """Option values of several kinds in fields of their own, each with a default."""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Each with the settings of a command line or a study file that are its own."""
        empty = cls()
        return cls(
            **{
                field.name: with_settings(getattr(empty, field.name), values)
                for field in dataclasses.fields(cls)
            }
        )

    def plain(self) -> dict[str, object]:
        """All settings as plain values, for provenance."""
        parts = (getattr(self, field.name) for field in dataclasses.fields(self))
        return {name: value for part in parts for name, value in plain_settings(part).items()}


def _is_simple(kind: Any) -> bool:
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return all(arg is type(None) or _is_simple(arg) for arg in get_args(kind))
    return kind in SIMPLE or origin is Literal or kind == tuple[str, ...]

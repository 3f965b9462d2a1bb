"""Names that changed: the old ones keep working until `REMOVED_IN`, each with one line of notice.

`docs/deprecated.md` shows the tables of this file; a test compares them.
"""

from __future__ import annotations

import functools
import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from myomorph.model.errors import BadData

REMOVED_IN = "0.2"
"""The release that no longer knows the old names."""

Made = TypeVar("Made", bound=Callable[..., Any])
Kind = TypeVar("Kind", bound=type)


class Renamed(NamedTuple):
    """A name that changed, in one table of files of a kind or in one command.

    Attributes
    ----------
    place : command; or the end of the dotted path of the table that holds the key, "" for the file itself
    old, new : the name before and now
    """

    place: str
    old: str
    new: str


OPTIONS = (
    Renamed("id", "folded", "independent-coordinates"),
    Renamed("identify", "least-time", "min-duration"),
    Renamed("ik", "crossings-only", "passes-only"),
    Renamed("ik", "crossings-shown", "passes-min-visible"),
    Renamed("ik", "crossings-gap", "passes-max-gap"),
    Renamed("ik", "crossings-shortest", "passes-min-duration"),
    Renamed("live", "late", "max-age"),
    Renamed("morph", "reach", "match-kernel-width"),
    Renamed("tension", "emg-shown-only", "emg-display-only"),
    Renamed("viscosity", "with", "intact"),
    Renamed("viscosity", "with-loads", "intact-loads"),
    Renamed("viscosity", "without", "removed"),
    Renamed("viscosity", "without-loads", "removed-loads"),
    Renamed("viscosity", "first", "first-body"),
    Renamed("viscosity", "astray", "max-center-distance"),
    Renamed("viscosity", "find-touch", "find-contact"),
    Renamed("viscosity", "touch", "contact-threshold"),
    Renamed("viscosity", "least", "min-relative-speed"),
)
"""Options of commands, without their dashes."""

OPTION_VALUES = (
    Renamed("tension --emg-gains", "given", "normalized"),
    Renamed("tension --emg-mode", "equality", "driven"),
)
"""Values of options of commands (by their new names)."""

KEYS: Mapping[str, tuple[Renamed, ...]] = {
    "study file": (
        Renamed("options.id", "folded", "independent_coordinates"),
        Renamed("options.identify", "least_time", "min_duration"),
        Renamed("options.ik", "crossings_only", "passes_only"),
        Renamed("options.ik", "crossings_shown", "passes_min_visible"),
        Renamed("options.ik", "crossings_gap", "passes_max_gap"),
        Renamed("options.ik", "crossings_shortest", "passes_min_duration"),
        Renamed("options.morph", "reach", "match_kernel_width"),
        Renamed("options.tension", "emg_shown_only", "emg_display_only"),
        Renamed("subject", "emg_reference", "emg_mvc"),
    ),
    "viscosity study": (
        Renamed("options", "arms", "moment_arms"),
        Renamed("options.identification", "least", "min_relative_speed"),
        Renamed("options.tracking", "astray", "max_center_distance"),
        Renamed("options.tracking", "find_touch", "find_contact"),
        Renamed("options.tracking", "touch", "contact_threshold"),
        Renamed("specimen", "first", "first_body"),
        Renamed("specimen", "with", "intact"),
        Renamed("specimen", "without", "removed"),
    ),
    "contact file": (
        Renamed("", "touches", "intervals"),
        Renamed("site", "edges", "cone_generators"),
        Renamed("site", "most", "max_force"),
        Renamed("site", "touching", "intervals"),
    ),
    "stairs file": (Renamed("stairs", "reach", "search_range"),),
    "species file": (Renamed("bone", "carried", "transferred"),),
}
"""Keys of TOML files, by the kind of file."""

VALUES: Mapping[str, tuple[Renamed, ...]] = {
    "study file": (
        Renamed("options.tension.emg_gains", "given", "normalized"),
        Renamed("options.tension.emg_mode", "equality", "driven"),
    ),
    "contact file": (Renamed("site.intervals", "told", "file"),),
}
"""Values of keys (by their new names)."""

VARIABLES = {
    **{
        f"touch_{name}": f"contact_interval_{name}"
        for name in ("start", "stop", "confidence", "site", "surface", "source")
    },
    "carried_force": "generalized_force_with_contacts",
    "contact_strength": "contact_activation",
    "least_determined": "max_interval_direction",
    "loop_closure": "loop_closure_error",
    "tension_imbalance": "equilibrium_residual",
    "uncarried_relaxation": "infeasible_contact_relaxation",
    "uncarried_time": "infeasible_contact_time",
}
"""Variables of NetCDF results: those of files of the version before are found under the new names."""

DIMENSIONS = {"touch": "contact_interval", "uncarried": "infeasible_contact"}
"""Dimensions of NetCDF results, likewise."""

FACTS = {"contact_doubts": "contact_warnings", "contact_sites_looked_at": "contact_sites_checked"}
"""Texts about a whole NetCDF result, likewise."""

QUANTITIES = {
    "mass_without": "mass_muscles_removed",
    "mass_with": "mass_intact",
    "com_without": "com_muscles_removed",
    "com_with": "com_intact",
}
"""Quantities of a study of swinging limbs: those of stored results of the version before are read by the new names."""

COLUMNS = (
    *(Renamed("specimens.csv", old, new) for old, new in QUANTITIES.items()),
    *(Renamed("cohort.csv", old, new) for old, new in QUANTITIES.items()),
    Renamed("bones.csv", "folded", "inverted"),
    Renamed("bones.csv", "map folded", "map inverted"),
    Renamed("delays.csv", "taken_after_ms", "waiting_ms"),
    Renamed("delays.csv", "result_after_ms", "latency_ms"),
    Renamed("delays.csv", "jump_owed", "remaining_jump"),
    Renamed("base_parameters.csv", "shown by the motion", "identifiable"),
    Renamed("group_parameters.csv", "track width [m]", "step width [m]"),
    Renamed("run --dry-run", "kept", "reused"),
    Renamed("morph", "left_out.csv", "not_transferred.csv"),
)
"""Columns and files that have the new name only: nothing reads them back."""

ARGUMENTS = (Renamed("run_study", "said", "report"),)
"""Arguments of public functions."""

FIELDS = (Renamed("Contacts", "touches", "intervals"),)
"""Fields of public classes."""


def notice(where: str, old: str, new: str) -> str:
    """The line that tells of an old name."""
    return f"{where}: '{old}' is now called '{new}'; the old name goes in version {REMOVED_IN}"


def current_options(command: str, words: Sequence[str]) -> tuple[list[str], list[str]]:
    """What was written on a command line, old names of options replaced, and a notice of each.

    Raises
    ------
    BadData
        where an option stands there by its old and its new name
    """
    names = {one.old: one.new for one in OPTIONS if one.place == command}
    found, notices = [], dict[str, str]()
    given = {word.partition("=")[0] for word in words}
    for word in words:
        flag, equals, value = word.partition("=")
        name = flag.removeprefix("--no-" if flag.startswith("--no-") else "--")
        if not flag.startswith("--") or name not in names:
            found.append(word)
            continue
        new = flag.removesuffix(name) + names[name]
        for one in (f"--{names[name]}", f"--no-{names[name]}"):
            if one in given:
                raise BadData(f"{flag} is the old name of {new}: give one of them")
        notices[name] = notice(command, flag, new)
        found.append(new + equals + value)
    for renamed in OPTION_VALUES:
        place, option = renamed.place.split()
        for index, word in enumerate(found if place == command else ()):
            joined = f"{option}={renamed.old}"
            if word == joined or (word == renamed.old and index > 0 and found[index - 1] == option):
                found[index] = f"{option}={renamed.new}" if word == joined else renamed.new
                notices[renamed.place] = notice(command, f"{option} {renamed.old}", f"{option} {renamed.new}")
    return found, list(notices.values())


def current_keys(kind: str, raw: Mapping[str, Any], file: str) -> tuple[dict[str, Any], list[str], list[str]]:
    """The tables of a TOML file with old names of keys and values replaced.

    Parameters
    ----------
    kind : of file, a key of `KEYS`
    file : its name, for the notices

    Returns
    -------
    the tables, a notice for each old name however often it stands there, and what is wrong: a key that stands in
    the same table by both names
    """
    notices, problems = dict[tuple[str, ...], str](), []

    def table(given: Mapping[str, Any], path: str) -> dict[str, Any]:
        names = {one.old: one for one in KEYS[kind] if _within(path, one.place)}
        result: dict[str, Any] = {}
        for key, value in given.items():
            one = names.get(key)
            dotted = f"{path}.{key}".removeprefix(".")
            if one is not None and one.new in given:
                problems.append(f"'{dotted}' is the old name of '{one.new}', which is there, too: give one of them")
                continue
            if one is not None:
                where = (one.place, one.old)
                notices.setdefault(where, notice(file, dotted, f"{path}.{one.new}".removeprefix(".")))
            new = key if one is None else one.new
            result[new] = entry(value, f"{path}.{new}".removeprefix("."))
        return result

    def entry(value: Any, path: str) -> Any:
        if isinstance(value, Mapping):
            return table(value, path)
        if isinstance(value, list):
            return [table(one, path) if isinstance(one, Mapping) else one for one in value]
        for one in VALUES.get(kind, ()):
            if value == one.old and _within(path, one.place):
                notices.setdefault((path, value), notice(file, f'{path} = "{value}"', f'{path} = "{one.new}"'))
                return one.new
        return value

    return table(raw, ""), list(notices.values()), problems


def _within(path: str, place: str) -> bool:
    """Whether the table at a path is one of those at a place: `subject.options.id` is `options.id`, for a subject."""
    return path == place or (bool(place) and path.endswith(f".{place}"))


def current_settings(options: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of steps as provenance has them (`id.folded`), by their new names."""
    names = {
        f"{one.place.removeprefix('options.')}.{one.old}": f"{one.place.removeprefix('options.')}.{one.new}"
        for one in KEYS["study file"]
    }
    return {names.get(name, name): value for name, value in options.items()}


def renamed_arguments(made: Made) -> Made:
    """A public function that also takes its arguments by their old names, with a `FutureWarning`.

    Raises
    ------
    TypeError
        when called, where an argument is given by both names
    """
    names = {one.old: one.new for one in ARGUMENTS if one.place == made.__name__}

    @functools.wraps(made)
    def called(*args: Any, **given: Any) -> Any:
        for old in [name for name in given if name in names]:
            new = names[old]
            if new in inspect.signature(made).bind_partial(*args).arguments or new in given:
                raise TypeError(f"{made.__name__}: '{old}' is the old name of '{new}': give one of them")
            warnings.warn(notice(f"{made.__name__}()", old, new), FutureWarning, stacklevel=2)
            given[new] = given.pop(old)
        return made(*args, **given)

    return called  # type: ignore[return-value]


def renamed_fields(kind: Kind) -> Kind:
    """A public dataclass that also takes and shows its fields by their old names, with a `FutureWarning`.

    Raises
    ------
    TypeError
        when made, where a field is given by both names
    """
    names = {one.old: one.new for one in FIELDS if one.place == kind.__name__}
    own: Any = kind
    made = own.__init__

    @functools.wraps(made)
    def initialize(self: Any, *args: Any, **given: Any) -> None:
        for old in [name for name in given if name in names]:
            new = names[old]
            if new in inspect.signature(made).bind_partial(self, *args).arguments or new in given:
                raise TypeError(f"{kind.__name__}: '{old}' is the old name of '{new}': give one of them")
            warnings.warn(notice(kind.__name__, old, new), FutureWarning, stacklevel=2)
            given[new] = given.pop(old)
        made(self, *args, **given)

    def shown(old: str, new: str) -> property:
        def get(self: Any) -> Any:
            warnings.warn(notice(kind.__name__, old, new), FutureWarning, stacklevel=2)
            return getattr(self, new)

        return property(get, doc=f"The old name of `{new}`.")

    own.__init__ = initialize
    for old, new in names.items():
        setattr(own, old, shown(old, new))
    return kind

"""The help of a command: its options in panels.

`--help` shows those that most users need, `--help-all` all.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel

from myomorph.core.model.extension import CommandEntry
from myomorph.core.model.frozen_map import FrozenMap

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

ALL_FLAG = "--help-all"
MAX_SHOWN = 16  # A command with no more options than these shows them all by `--help`.
METHOD = "Method"
RARE_PAGE = "docs/commands.md"
"""Lists the options that no help does."""
PANELS = {
    "Inputs and outputs": (
        "recordings",
        "study",
        "file",
        "files",
        "folder",
        "folders",
        "model",
        "motion",
        "markers",
        "out",
        "landmarks",
        "skin",
        "to",
        "static",
        "tasks",
        "labels",
        "protocol",
        "mass",
        "height",
        "chest",
        "sex",
        "age",
        "time",
        "frames",
        "check-motion",
        "check-loads",
        "loads",
        "bodies",
        "plates",
        "torques",
        "actuators",
        "up",
        "forward",
        "axes",
        "units",
        "lsl-markers",
        "lsl-forces",
        "web",
        "speed",
        "marker-set",
        "preset",
        "times",
        "port",
        "browser",
        "geometry",
        "norms",
        "pdf",
        "generic",
        "keep-generic",
    ),
    "Forces and filter": (
        "cutoff",
        "force-checks",
        "force-shift",
        "force-columns",
        "force-rate",
        "force-origins",
        "net",
        "independent-coordinates",
        "filter-cutoff",
        "clock",
    ),
    "Muscles": (
        "recruitment",
        "exponent",
        "weights",
        "min-activation",
        "passive",
        "viscous",
        "curves",
        "reserve",
        "residual",
        "tendons",
        "activation-dynamics",
        "second-start",
        "joint-load",
        "joint-load-joints",
        "co-contraction",
        "co-contraction-coordinates",
        "window",
        "sweeps",
    ),
    "Contacts": (
        "contacts",
        "measured",
        "contact-points",
        "formulation",
        "compliance",
        "contact-passive",
        "smoothness",
        "reactions",
        "intervals",
    ),
    "EMG": ("emg",),
    "Inertial sensors": ("imu",),
    "Errors and intervals": (
        "draws",
        "uncertainty",
        "contributions",
        "all-frames",
        "draw-seed",
        "widened",
        "hold-out",
        "check",
    ),
    "Running": (
        "threads",
        "workers",
        "memory",
        "scheduler",
        "resume",
        "fresh",
        "dry-run",
        "prepare",
        "live",
    ),
}
"""Panels in their order and the options that stand in each; any other option is a setting of the
command's method, unless the command says where it stands.
"""
# Panels that have all options whose first word is this.
FAMILIES = {"EMG": "emg", "Inertial sensors": "imu"}


def option_panel(option: str, own: Mapping[str, Collection[str]] = FrozenMap({})) -> str:
    """Find the panel of an option.

    Parameters
    ----------
    option : name without hyphens in front, as `joint-load`
    own : options of the command itself, by panel
    """
    for title, options in (*own.items(), *PANELS.items()):
        if option in options or option.split("-")[0] == FAMILIES.get(title):
            return title
    return METHOD


@dataclass(frozen=True)
class PanelHelp:
    """Cyclopts' formatter of one command's help.

    Attributes
    ----------
    command : whose help it is
    entry : how it is shown
    everything : all options but rare ones with their whole text, else the first ones with their
        first sentence
    """

    command: str
    entry: CommandEntry
    everything: bool = False

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print one of Cyclopts' panels: parameters as several panels by what they are about."""
        if panel.format == "command":
            DefaultFormatter()(console, options, panel)
            return
        entries = self.shown(panel.entries)
        own = self.entry.option_panels
        titles = (*list(PANELS)[:1], METHOD, *list(PANELS)[1:])
        for title in dict.fromkeys((*titles, *own)):
            members = [each for each in entries if option_panel(_name(each), own) == title]
            if members:
                DefaultFormatter()(console, options, panel.copy(title=title, entries=members))
        hidden = len(panel.entries) - len(entries)
        if hidden and not self.everything:
            console.print(f"{hidden} more options: myomorph {self.command} {ALL_FLAG}")
        elif hidden:
            console.print(f"{hidden} more, mainly for study files: {RARE_PAGE}", soft_wrap=True)

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Print the line of usage."""
        DefaultFormatter().render_usage(console, options, usage)

    def shown(self, entries: list[HelpEntry]) -> list[HelpEntry]:
        """Return the entries that are printed, without empty defaults.

        They are printed by their first sentence, unless all are shown.
        """
        rare = self.entry.rare_options
        entries = [entry for entry in entries if _name(entry) not in rare]
        whole = self.everything or len(entries) <= MAX_SHOWN
        first = self.entry.first_options
        return [
            entry.copy(
                default=None if entry.default in ('""', "()", "[]", "{}") else entry.default,
                choices=None if entry.choices is None else tuple(filter(None, entry.choices)),
                description=entry.description if whole else first_sentence(_text(entry)),
            )
            for entry in entries
            if whole or entry.required or entry.positional_label or _name(entry) in first
        ]


def first_sentence(text: str) -> str:
    """Return the first sentence of a description, or what stands before its first semicolon."""
    return re.split(r"(?<=[a-z0-9)\]])(?:; |\. (?=[A-Z]))", text, maxsplit=1)[0].rstrip(".") + "."


def _name(entry: HelpEntry) -> str:
    names = entry.positive_names or (entry.positional_label or "",)
    return names[0].lstrip("-").lower()


def _text(entry: HelpEntry) -> str:
    """Return the description as written; Cyclopts keeps it as Markdown."""
    return str(
        getattr(
            getattr(entry.description, "primary_renderable", None),
            "markup",
            entry.description or "",
        )
    )

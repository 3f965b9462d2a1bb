"""The help of a command: its options in panels, the ones that most users need by `--help`, all by
`--help-all`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

ALL_FLAG = "--help-all"
MAX_SHOWN = 16  # A command with no more options than these shows them all by `--help`.
METHOD = "Method"
PANELS = {
    "Inputs and outputs": (
        "recordings",
        "study",
        "file",
        "files",
        "folder",
        "folders",
        "setup",
        "model",
        "motion",
        "markers",
        "out",
        "source",
        "bones",
        "landmarks",
        "geometry",
        "skin",
        "to",
        "static",
        "tasks",
        "labels",
        "protocol",
        "template",
        "intact",
        "removed",
        "intact-loads",
        "removed-loads",
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
        "unit",
        "lsl-markers",
        "lsl-forces",
        "lsl-out",
        "web",
        "speed",
        "marker-set",
        "link",
        "species",
        "target",
        "target-geometry",
        "together",
        "mirror",
        "across",
        "beside",
        "preset",
        "times",
        "port",
        "browser",
        "norms",
        "muscle-mass",
        "base",
        "first-body",
        "generic",
        "keep-generic",
        "mjcf",
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
        "tare",
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
        "fibers",
        "force",
        "pennation",
        "architecture",
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
        "find-contact",
        "contact-threshold",
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
        "level",
        "seed",
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
        "max-age",
    ),
}
"""Panels in their order and the options that stand in each; any other option is a setting of the
command's method.
"""
# Panels that have all options whose first word is this.
FAMILIES = {"EMG": "emg", "Inertial sensors": "imu"}

FIRST = {
    "tension": (
        "loads",
        "emg",
        "contacts",
        "time",
        "cutoff",
        "recruitment",
        "passive",
        "tendons",
        "reactions",
        "draws",
    ),
    "id": ("loads", "bodies", "plates", "time", "cutoff", "force-checks", "net", "draws"),
    "ik": (
        "markers",
        "imu",
        "imu-pose",
        "imu-bodies",
        "imu-heading",
        "imu-mounting",
        "tasks",
        "labels",
        "time",
        "draws",
        "mend",
        "root-bounds",
    ),
    "analyze": (
        "mass",
        "static",
        "model",
        "loads",
        "protocol",
        "time",
        "emg-muscles",
        "emg-side",
        "draws",
        "dry-run",
    ),
    "calibrate": (
        "markers",
        "static",
        "marker-set",
        "tasks",
        "labels",
        "mass",
        "time",
        "symmetric",
        "frames",
    ),
    "identify": (
        "loads",
        "plates",
        "skin",
        "height",
        "chest",
        "sex",
        "check-motion",
        "check-loads",
        "time",
        "cutoff",
    ),
    "morph": (
        "landmarks",
        "mass",
        "mirror",
        "across",
        "species",
        "joints",
        "map",
        "clear",
        "balance",
        "fibers",
    ),
    "live": (
        "loads",
        "labels",
        "lsl-markers",
        "lsl-forces",
        "web",
        "lsl-out",
        "out",
        "cutoff",
        "recruitment",
        "draws",
    ),
    "refine": (
        "loads",
        "plates",
        "mass",
        "tasks",
        "labels",
        "time",
        "cutoff",
        "body",
        "masses",
        "check",
    ),
    "personalize": (
        "loads",
        "torques",
        "emg",
        "passive",
        "time",
        "cutoff",
        "tendons",
        "sides",
        "hold-out",
        "generic",
    ),
    "viscosity": (
        "model",
        "intact",
        "removed",
        "intact-loads",
        "removed-loads",
        "template",
        "time",
        "cutoff",
        "muscle-mass",
        "instruments",
    ),
    "uncertainty": (
        "loads",
        "plates",
        "time",
        "draws",
        "contributions",
        "marker-noise",
        "placement",
        "plate-position",
        "body-mass",
        "joint-center",
    ),
}
"""The options that `--help` shows of the commands that have many, besides those that must be given.
"""


def option_panel(option: str) -> str:
    """The panel of an option, by its name without hyphens in front. `option`: as `joint-load`."""
    for title, options in PANELS.items():
        if option in options or option.split("-")[0] == FAMILIES.get(title):
            return title
    return METHOD


@dataclass(frozen=True)
class PanelHelp:
    """Cyclopts' formatter of one command's help. `command`: whose help it is; `everything`: all
    options with their whole text, else those of `FIRST` with their first sentence.
    """

    command: str
    everything: bool = False

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print one of Cyclopts' panels: parameters as several panels by what they are about."""
        if panel.format == "command":
            DefaultFormatter()(console, options, panel)
            return
        entries = self.shown(panel.entries)
        for title in (*list(PANELS)[:1], METHOD, *list(PANELS)[1:]):
            members = [entry for entry in entries if option_panel(_name(entry)) == title]
            if members:
                DefaultFormatter()(console, options, panel.copy(title=title, entries=members))
        if hidden := len(panel.entries) - len(entries):
            console.print(f"{hidden} more options: myomorph {self.command} {ALL_FLAG}")

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Print the line of usage."""
        DefaultFormatter().render_usage(console, options, usage)

    def shown(self, entries: list[HelpEntry]) -> list[HelpEntry]:
        """The entries that are printed, without empty defaults; by their first sentence, unless all
        are shown.
        """
        whole = self.everything or len(entries) <= MAX_SHOWN
        first = FIRST.get(self.command, ())
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
    """The first sentence of a description, or what stands before its first semicolon."""
    return re.split(r"(?<=[a-z0-9)\]])(?:; |\. (?=[A-Z]))", text, maxsplit=1)[0].rstrip(".") + "."


def _name(entry: HelpEntry) -> str:
    names = entry.positive_names or (entry.positional_label or "",)
    return names[0].lstrip("-").lower()


def _text(entry: HelpEntry) -> str:
    """The description as written; Cyclopts keeps it as Markdown."""
    return str(
        getattr(
            getattr(entry.description, "primary_renderable", None),
            "markup",
            entry.description or "",
        )
    )

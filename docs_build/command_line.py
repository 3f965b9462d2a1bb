"""The reference of the command line: what every command prints for `--help-all`, and rare options.

A line `<!-- commands -->` of a page stands for it when the site is built.
"""

from __future__ import annotations

import contextlib
import io
import os
import re

from myomorph.lab.cli import main
from myomorph.lab.cli.app import commands, new_app
from myomorph.lab.study.inputs.table import all_keys
from myomorph.lab.study.step.step import trial_steps

PLACE = re.compile(r"^<!-- commands -->$", re.MULTILINE)
WIDTH = 78
"""Of the help [characters], which a page shows without scrolling."""


def with_commands(markdown: str) -> str:
    """Return a page with the help of all commands in its place."""
    if not PLACE.search(markdown):
        return markdown
    text = help_of_all()
    return PLACE.sub(lambda place: text, markdown)


def help_of_all() -> str:
    """Return a section for every command, in the order of their names."""
    sections = []
    for name in sorted(commands()):
        sections.append(f"## {name}\n\n```text\n{help_of(name)}\n```\n")
        if commands()[name].rare_options:
            sections.append(f"Rare options, for study files above all:\n\n{rare_of(name)}\n")
    return "\n".join(sections)


def rare_of(command: str) -> str:
    """Return a table of the options that the help of a command does not list."""
    wanted = {f"--{name}" for name in commands()[command].rare_options}
    rows = ["| option | in study files | what it is |", "|---|---|---|"]
    for argument in new_app()[command].assemble_argument_collection():
        name = argument.names[0]
        if name in wanted:
            text = " ".join(str(argument.parameter.help or "").split()).replace("|", r"\|")
            rows.append(f"| `{name}` | {_place(name[2:].replace('-', '_'))} | {text} |")
    return "\n".join(rows)


def _place(setting: str) -> str:
    """Return where a setting stands in a study file."""
    for step in trial_steps():
        if setting in {one.name for one in step.settings}:
            return f"`[options.{step.name}]` `{setting}`"
    return f"`{setting}` of a trial" if setting in all_keys() else f"`{setting}`"


def help_of(command: str) -> str:
    """Return what a command prints for `--help-all`."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(WIDTH)
    try:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            main([command, "--help-all"])
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
    return "\n".join(line.rstrip() for line in printed.getvalue().strip().splitlines())

"""The reference of the command line: what every command prints for `--help-all`.

A line `<!-- commands -->` of a page stands for it when the site is built.
"""

from __future__ import annotations

import contextlib
import io
import os
import re

from myomorph.lab.cli import main
from myomorph.lab.cli.app import commands

PLACE = re.compile(r"^<!-- commands -->$", re.MULTILINE)
WIDTH = 96
"""Of the help [characters], which a page shows without scrolling."""


def with_commands(markdown: str) -> str:
    """Return a page with the help of all commands in its place."""
    if not PLACE.search(markdown):
        return markdown
    text = help_of_all()
    return PLACE.sub(lambda place: text, markdown)


def help_of_all() -> str:
    """Return a section for every command, in the order of their names."""
    return "\n".join(f"## {name}\n\n```text\n{help_of(name)}\n```\n" for name in sorted(commands()))


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

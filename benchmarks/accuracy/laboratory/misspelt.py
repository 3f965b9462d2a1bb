"""What misspelt options and keys, and keys in a wrong table, are answered."""

from __future__ import annotations

import contextlib
import io
import tempfile
from pathlib import Path

import myomorph as mm
from myomorph.core.model.errors import BadFile
from myomorph.lab.cli import main

Row = dict[str, object]
OPTIONS = {
    "analyze --contact-point": "--contact-points",
    "analyze --recruitmnt": "--recruitment",
    "tension --joint-loads": "--joint-load",
    "tension --emgweight": "--emg-weight",
    "tension --cutof": "--cutoff",
    "ik --marker": "--markers",
    "id --force-check": "--force-checks",
}
KEYS = {
    "[study] nam": "name",
    "[[subject]] statics": "static",
    "[[subject]] masss": "mass",
    "[[subject]] emgmuscles": "emg_muscles",
    "[[subject]] reactions": "[options.tension]",
    "[[subject]] cutoff": "[options.id]",
    "[options.tension] contactpoints": "contact_points",
    "[options.tension] recruitement": "recruitment",
}


def measure() -> list[Row]:
    """Rows: what was written, what is meant, and the answer."""
    with tempfile.TemporaryDirectory() as folder:
        answers = {text: answer_to_option(text) for text in OPTIONS} | {
            text: answer_to_key(text, Path(folder)) for text in KEYS
        }
    return [
        {
            "written": text,
            "meant": (OPTIONS | KEYS)[text],
            "answer": answer,
            "named": named(text, answer),
        }
        for text, answer in answers.items()
    ]


def named(text: str, answer: str) -> bool:
    """Whether what is meant stands in an answer."""
    return (OPTIONS | KEYS)[text] in answer


def answer_to_option(text: str) -> str:
    """Return the line that a command prints."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        main([*text.split(), "1"])
    return said.getvalue().strip()


def answer_to_key(text: str, folder: Path) -> str:
    """Return what is wrong with a study file that has the key."""
    heading, key = text.rsplit(" ", 1)
    line = f"{key} = 1\n"
    study = "[study]\nname = 'x'\n" + (line if heading == "[study]" else "")
    study += "[[subject]]\nname = 's'\nmodel = 'm.osim'\ntrials = []\n" + (
        line if heading == "[[subject]]" else ""
    )
    study += f"{heading}\n{line}" if heading not in ("[study]", "[[subject]]") else ""
    path = folder / "study.toml"
    path.write_text(study, encoding="utf-8")
    try:
        mm.read_plan(path)
    except BadFile as error:
        return next(part for part in str(error).split(" | ") if key in part).split("problems: ")[-1]
    return ""

"""Every model file of public repositories: it opens, or is refused by a named cause.

The repositories are checked out by whoever measures, into folders OWNER/NAME of the folder that the
environment variable `MYOMORPH_PUBLIC_MODELS` names. Without it nothing is measured. Nothing of them
is part of this one: the tables hold counts and names of files.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from myomorph.core.model.errors import BadFile, MyomorphError
from myomorph.lab.info.inspect import inspect

Row = dict[str, object]
FOLDER = "MYOMORPH_PUBLIC_MODELS"
ENDINGS = (".osim", ".xml", ".mjcf")
FAULT = "fault of Myomorph"
CAUSES = {
    "a part of another file and not a model by itself": r"outermost element is <mujocoinclude>",
    "another kind of XML": r"holds <|XML of another kind|holds an empty|expected a model",
    "a file that it names is missing": r"does not exist|no mass without the missing meshes"
    r"|no such file",
    "files outside of its folder": r"lies outside",
    "entities, which could expand without end": r"declares XML entities",
    "no well-formed XML": r"^line \d+: .*(error|mismatch|tag|Failed|Unescaped)",
    "older than OpenSim 4 reads": r"which OpenSim 4 refuses too",
    "a class that is not supported": r"not supported|expected one of",
    "no body": r"has no body",
    "MuJoCo refuses it": r"MuJoCo cannot compile",
    "takes too long": r"did not compile it within",
    "a name that the file does not have": r"^unknown ",
    "numbers that make no sense": r"expected|has mass|two bodies",
}
"""Kinds of causes, by what their sentences hold; the first that fits counts."""


class Opened(NamedTuple):
    """A file and what became of it.

    Attributes
    ----------
    repository : OWNER/NAME
    file : path inside it
    kind : what the file is, "" where it was refused
    cause : kind of the cause for which it was refused, "" where it opened
    sentence : of the refusal
    """

    repository: str
    file: str
    kind: str
    cause: str
    sentence: str


def measure() -> Iterator[Row]:
    """Files of each repository: how many open as what, how many are refused by a named cause."""
    found = opened()
    for repository in dict.fromkeys(each.repository for each in found):
        own = [each for each in found if each.repository == repository]
        kinds = Counter(each.kind for each in own if each.kind)
        yield {
            "repository": repository,
            "files": len(own),
            "models of OpenSim": kinds["OpenSim model"],
            "models of MuJoCo": kinds["MuJoCo model"],
            "settings of OpenSim": kinds["settings"],
            "refused by a named cause": sum(each.cause not in ("", FAULT) for each in own),
            "models refused": sum(
                each.cause not in ("", FAULT) and each.file.endswith(".osim") for each in own
            ),
            "faults": sum(each.cause == FAULT for each in own),
        }


def measure_refused() -> Iterator[Row]:
    """Causes of refusal in each repository, with the number of files and their first ones."""
    refused = [each for each in opened() if each.cause]
    counts = Counter((each.repository, each.cause) for each in refused)
    for (repository, cause), count in sorted(counts.items()):
        own = [each for each in refused if (each.repository, each.cause) == (repository, cause)]
        yield {
            "repository": repository,
            "cause": cause,
            "files": count,
            "first files": ", ".join(each.file for each in own[:3]),
            "the first one's sentence": own[0].sentence,
        }


@cache
def opened() -> tuple[Opened, ...]:
    """Open every file of the repositories; () without their folder."""
    home = os.environ.get(FOLDER, "")
    if not home:
        return ()
    results = []
    for folder in sorted(Path(home).glob("*/*")):
        if not folder.is_dir():
            continue
        repository = folder.relative_to(home).as_posix()
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in ENDINGS and path.is_file():
                results.append(_opened(path, folder, repository))
    return tuple(results)


def _opened(path: Path, folder: Path, repository: str) -> Opened:
    """Open one file as `info` does."""
    file = path.relative_to(folder).as_posix()
    try:
        kind = inspect(path).kind
    except MyomorphError as error:
        sentence = _sentence(error, folder)
        return Opened(
            repository=repository, file=file, kind="", cause=_cause(sentence), sentence=sentence
        )
    except Exception as error:
        said = f"{type(error).__name__}: {error}"[:200]
        return Opened(repository=repository, file=file, kind="", cause=FAULT, sentence=said)
    if kind.startswith("OpenSim settings") or kind.lower().startswith("external"):
        kind = "settings"
    elif kind.lower() == "model":
        kind = "OpenSim model" if path.suffix == ".osim" or not _is_mjcf(path) else "MuJoCo model"
    return Opened(repository=repository, file=file, kind=kind, cause="", sentence="")


def _is_mjcf(path: Path) -> bool:
    """Return whether a file's text is that of MuJoCo."""
    return b"<mujoco" in path.read_bytes()[:100_000]


def _sentence(error: MyomorphError, folder: Path) -> str:
    """Return the text of an error, without the folders of this machine."""
    text = str(error.problem) if isinstance(error, BadFile) else str(error)
    text = text.replace(f"{folder.resolve()}/", "").replace(f"{folder}/", "")
    return re.sub(r"^[^ ]*\.(osim|xml|mjcf): ", "", text)[:200]


def _cause(sentence: str) -> str:
    """Return the kind of cause that a sentence states."""
    for cause, pattern in CAUSES.items():
        if re.search(pattern, sentence):
            return cause
    return "another cause, which its sentence names"

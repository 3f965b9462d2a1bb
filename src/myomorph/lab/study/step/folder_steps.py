"""Steps whose result is a folder: on a subject, a specimen or a whole study."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, Protocol, Self, TypeVar

from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import (
    Message,
    as_message,
    located,
    messages_of,
    messages_text,
    unique,
)
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import file_source, whole_folder
from myomorph.lab.store.table_digests import altered_tables, read_digests, write_digests
from myomorph.lab.study.step.job_steps import JobSteps
from myomorph.lab.study.step.step import WHOLE_STUDY, Step, step_of
from myomorph.lab.study.step.step_table import Scope

PROVENANCE = "provenance.json"
NOTES = "notes.txt"
MESSAGES = "messages.json"
"""What may not be believed of a step's result, one line each and with causes, among its tables."""
RESULT = "result"
"""Role of a step's own files: one that was altered makes the step run again."""
DIGESTS = "digests.json"
"""File with the digests of what a step leaves beside its own tables."""
PAGE = ".html"  # Ending of pages.


@dataclass(frozen=True)
class FolderOutput:
    """Where a step of a subject, specimen or study writes, and what its result is derived from."""

    step: Step[Any]
    home: Path
    made: Provenance

    @property
    def tables(self) -> Path:
        """Folder of the step's own tables."""
        return self.home / self.step.tables

    def path(self, use: str) -> Path:
        """Return a file that later steps and jobs read (`Step.leaves`)."""
        return self.home / self.step.leaves[use]

    def whole(self, notes: Sequence[str] = ()) -> AbstractContextManager[Path]:
        """Yield a folder for the step's tables, complete in the end or absent, and write notes."""
        return result_folder(self.tables, self.made, notes, self.step)


@contextmanager
def result_folder(
    tables: Path, made: Provenance, notes: Sequence[str] = (), step: Step[Any] | None = None
) -> Iterator[Path]:
    """Yield such a folder where the result is not that of a job: a command made it."""
    with (
        whole_folder(tables) if step is None or step.tables else _shared_folder(tables, step.name)
    ) as folder:
        yield folder
        if notes:
            write_notes(folder, notes)
        if step is not None:
            # A page is made anew by `report`.
            files = (
                path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != PAGE
            )
            results = (file_source(RESULT, path) for path in files)
            named = (
                replace(result, name=Path(result.name).relative_to(folder).as_posix())
                for result in results
            )
            made = replace(made, sources=(*made.sources, *named))
        (folder / provenance_file(step)).write_text(made.to_json() + "\n", encoding="utf-8")


def write_notes(folder: Path, notes: Iterable[str]) -> None:
    """Write messages as lines for people, and with their causes."""
    messages = tuple(map(as_message, notes))
    lines = "".join(f"{' '.join(text.split())}\n" for text in messages)
    (folder / NOTES).write_text(lines, encoding="utf-8")
    (folder / MESSAGES).write_text(messages_text(messages), encoding="utf-8")


def read_notes(folder: Path) -> tuple[Message, ...]:
    """Read what `write_notes` wrote; of older versions only the lines."""
    if (folder / MESSAGES).is_file():
        return messages_of((folder / MESSAGES).read_text(encoding="utf-8"))
    if not (folder / NOTES).is_file():
        return ()
    return unique((folder / NOTES).read_text(encoding="utf-8").splitlines())


@contextmanager
def _shared_folder(home: Path, name: str) -> Iterator[Path]:
    """Yield a folder whose files are moved, all at the end, among those of others.

    What a killed process left is removed.
    """
    for path in home.glob(f".{name}.*"):
        shutil.rmtree(path, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=f".{name}.", dir=home) as temporary:
        yield Path(temporary)
        for path in sorted(Path(temporary).iterdir()):
            os.replace(path, home / path.name)


def provenance_file(step: Step[Any] | None = None) -> str:
    """Return the name of the file that holds what a result is derived from.

    Those of a study lie beside each other.
    """
    return (
        PROVENANCE if step is None or step.scope not in WHOLE_STUDY else f"{step.name}_{PROVENANCE}"
    )


def stored_provenance(tables: Path, step: Step[Any] | None = None) -> Provenance | None:
    """Return what an earlier run derived a step's result from.

    It is None where no file holds it, or a file of the result was altered.
    """
    try:
        made = Provenance.from_json((tables / provenance_file(step)).read_text(encoding="utf-8"))
        results = [source for source in made.sources if source.role == RESULT]
        if any(
            file_source(RESULT, tables / result.name).sha256 != result.sha256 for result in results
        ):
            return None
    except (OSError, ValueError, BadFile):
        return None
    return replace(made, sources=tuple(source for source in made.sources if source.role != RESULT))


def _leaf_digests(home: Path, step: Step[Any]) -> dict[str, str]:
    """Digests of the files that later steps read, as a step wrote them; none of older versions."""
    path = home / step.tables / DIGESTS
    return read_digests(path.read_text("utf-8")) if step.tables and is_named_file(path) else {}


class ScopeInputs(Protocol):
    """What the steps of a subject, a specimen or a study begin with."""

    def after(self, step: Step[Any], home: Path) -> Self:
        """Return the same once a step's result is in the folder.

        Nothing changes where the step is the only one.
        """
        return self


Inputs = TypeVar("Inputs", bound=ScopeInputs)


class FolderSteps(JobSteps, Generic[Inputs]):
    """The steps of one subject, specimen or study, with results in the outcome's folder."""

    linked = True

    def __init__(self, scope: Scope, inputs: Inputs, outcome: Outcome, fresh: bool = False):
        self.scope = scope
        self.inputs = inputs
        self.outcome = outcome
        self.fresh = fresh
        self._known: dict[str, Provenance] = {}

    def _step(self, name: str) -> Step[Any]:
        return step_of(name, self.scope)

    def provenance(self, step: str) -> Provenance:
        """Return what a step's result would be derived from now."""
        if step not in self._known:
            made_from = self._step(step).made_from
            assert made_from is not None
            self._known[step] = made_from(self.inputs)
        return self._known[step]

    def earlier(self, step: str) -> Provenance | None:
        """Return what an earlier run derived a step's result from, None without all its files."""
        value = self._step(step)
        home = self.outcome.folder
        if self.fresh or not all((home / name).exists() for name in value.leaves.values()):
            return None
        return stored_provenance(home / value.tables, value)

    def reasons(self, step: str) -> tuple[str, ...]:
        """Return why a step is computed.

        Of a result of which only a file is missing, as an older version left it, it names the file.
        """
        value = self._step(step)
        home = self.outcome.folder
        missing = [name for name in value.leaves.values() if not (home / name).exists()]
        if not missing and not self.fresh:
            altered = altered_tables(home, _leaf_digests(home, value))
            if altered:
                return altered
        if missing and not self.fresh and stored_provenance(home / value.tables, value) is not None:
            return (f"{missing[0]} is missing",)
        return super().reasons(step)

    def compute(self, step: str) -> None:
        """Run a step, which writes its files."""
        value = self._step(step)
        home = self.outcome.folder
        home.mkdir(parents=True, exist_ok=True)
        try:
            value.run(self.inputs, FolderOutput(value, home, self.provenance(step)))
            if value.tables and (home / value.tables).is_dir():
                names = tuple(name for name in value.leaves.values() if not name.endswith(PAGE))
                write_digests(home / value.tables / DIGESTS, home, names)
        finally:
            with suppress(OSError):
                # Only where it is empty, since the step has failed.
                home.rmdir()
        self.reuse(step)

    def reuse(self, step: str) -> None:
        """Go on with a result that is there."""
        self.inputs = self.inputs.after(self._step(step), self.outcome.folder)
        self._known.clear()

    def end(self, outcome: Outcome) -> Outcome:
        """Return the outcome with what the steps noted of their results.

        Results that an earlier run made are included.
        """
        findings: list[Message] = []
        for step in outcome.done:
            findings += located(step, read_notes(outcome.folder / self._step(step).tables))
        return replace(outcome, findings=(*outcome.findings, *findings))

"""Steps on a subject rather than a trial: the model that they make for its trials, written whole or not at all."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from myomorph.io.osim.write import write_osim
from myomorph.model.errors import BadFile
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance
from myomorph.store.results import whole_folder
from myomorph.study.subject.subject_files import SUBJECT_STEPS, Prepared, SubjectFiles, made_model, subject_step
from myomorph.study.trial.reuse import NEVER, changes
from myomorph.study.trial.trial_files import Settings

PROVENANCE = "provenance.json"
NOTES = "notes.txt"
"""What may not be believed of a step's result, one line each, in the folder of its tables."""


def check_out_model(out: Path, tables: Path | None = None, read: Iterable[Path | None] = ()) -> None:
    """Raise `BadFile` where a model cannot be written under this name.

    Parameters
    ----------
    tables : the folder beside it
    read : what the model is made from, which neither may replace
    """
    if out.suffix.lower() != ".osim":
        raise BadFile(out, f"is no name for a model: it ends in '{out.suffix}'", "give a name that ends in .osim")
    if out.is_dir():
        raise BadFile(out, "is a folder, but the result is a file", "give a name that ends in .osim")
    if not out.parent.is_dir():
        raise BadFile(out, f"cannot be written: folder '{out.parent}' does not exist", "make it first")
    for one in read:
        if one is not None and one.resolve() in (out.resolve(), (tables or out).resolve()):
            raise BadFile(out, f"would be written over '{one}', which it is made from", "give --out another name")


def write_made_model(
    model: Model,
    made: Provenance,
    out: Path,
    tables: Path,
    fill: Callable[[Path], None],
    notes: Sequence[str] = (),
) -> tuple[str, ...]:
    """Write a model, and a folder with what it was made from and what `fill` puts there.

    Parameters
    ----------
    fill : writes tables and a report into the folder it is given
    notes : what may not be believed of it, for `subject_notes`

    Returns
    -------
    what the model's file could not hold, one line each

    Raises
    ------
    BadFile : the model cannot be written under this name
    """
    check_out_model(out)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as temporary:
        path = Path(temporary) / out.name
        lost = write_osim(model, path)
        with whole_folder(tables) as folder:
            fill(folder)
            if notes:
                (folder / NOTES).write_text("".join(f"{text}\n" for text in notes), encoding="utf-8")
            (folder / PROVENANCE).write_text(made.to_json() + "\n", encoding="utf-8")
        os.replace(path, out)
    return lost


def prepare_subject(
    files: SubjectFiles,
    steps: Sequence[str],
    settings: Settings,
    folder: Path,
    fresh: bool = False,
) -> Prepared:
    """Run a subject's own steps into a folder: `calibrated.osim`, `identified.osim`, and their tables.

    Parameters
    ----------
    fresh : compute every step, whatever an earlier run left

    Raises
    ------
    MyomorphError
        where a step cannot be done
    """
    prepared = Prepared(files.model, made_model(files, (), folder).open())
    for step in SUBJECT_STEPS:
        if step not in steps:
            continue
        one = subject_step(step)
        folder.mkdir(parents=True, exist_ok=True)
        out, tables = made_model(files, (*prepared.done, step), folder).path, folder / one.tables
        made = one.provenance(files, prepared, settings)
        earlier = _stored(tables) if out.is_file() and not fresh else None
        known = earlier is not None and earlier.key == made.key
        started = time.monotonic()
        if not known:
            one.run(files, prepared, settings, made, out, tables)
        changed = changes(earlier, made) if earlier is not None else ()
        seconds = time.monotonic() - started
        prepared = Prepared(
            out,
            made_model(files, (*prepared.done, step), folder).open(),
            (*prepared.done, step),
            (*prepared.reused, step) if known else prepared.reused,
            tuple(dict.fromkeys((*prepared.changed, *changed))),
            prepared.timed if known else (*prepared.timed, (step, seconds)),
        )
    return prepared


def reused_subject_steps(
    files: SubjectFiles, steps: Sequence[str], settings: Settings, folder: Path
) -> dict[str, tuple[str, ...]]:
    """Which steps on a subject a run would take over from results in a folder, and why it would compute the others.

    Returns
    -------
    by step: () where it would be taken over, else why it is computed, one line each

    Raises
    ------
    MyomorphError
        where a file cannot be read that must be held against the results
    """
    result: dict[str, tuple[str, ...]] = {}
    prepared: Prepared | None = None
    for step in [name for name in SUBJECT_STEPS if name in steps]:
        one = subject_step(step)
        out, tables = made_model(files, (*result, step), folder).path, folder / one.tables
        earlier = _stored(tables) if out.is_file() else None
        if earlier is None or any(result.values()):
            result[step] = (NEVER if earlier is None else "the model that it begins with is made anew",)
            continue
        prepared = prepared or Prepared(files.model, made_model(files, (), folder).open())
        result[step] = changes(earlier, one.provenance(files, prepared, settings))
        if not result[step]:
            prepared = Prepared(out, made_model(files, (*result,), folder).open())
    return result


def subject_notes(steps: Sequence[str], folder: Path) -> tuple[str, ...]:
    """What the steps on a subject said of their results, also of those that an earlier run made."""
    found: list[str] = []
    for step in [name for name in SUBJECT_STEPS if name in steps]:
        path = folder / subject_step(step).tables / NOTES
        if path.is_file():
            found += [f"{step}: {line}" for line in path.read_text(encoding="utf-8").splitlines()]
    return tuple(found)


def _stored(tables: Path) -> Provenance | None:
    """What an earlier run made a step's result from."""
    try:
        return Provenance.from_json((tables / PROVENANCE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None

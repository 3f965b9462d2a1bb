"""Steps that are about a subject rather than a trial: they make the model that the trials then use."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from myomorph.model.provenance import Provenance
from myomorph.study.subject.made_model import PROVENANCE
from myomorph.study.subject.subject_files import SUBJECT_STEPS, Prepared, SubjectFiles, made_model, subject_step
from myomorph.study.trial.changes import NEVER, changes
from myomorph.study.trial.trial_files import Settings


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
        out, tables = folder / one.model, folder / one.tables
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
            (*prepared.kept, step) if known else prepared.kept,
            tuple(dict.fromkeys((*prepared.changed, *changed))),
            prepared.timed if known else (*prepared.timed, (step, seconds)),
        )
    return prepared


def kept_subject_steps(
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
    found: dict[str, tuple[str, ...]] = {}
    prepared: Prepared | None = None
    for step in [name for name in SUBJECT_STEPS if name in steps]:
        one = subject_step(step)
        out, tables = folder / one.model, folder / one.tables
        earlier = _stored(tables) if out.is_file() else None
        if earlier is None or any(found.values()):
            found[step] = (NEVER if earlier is None else "the model that it begins with is made anew",)
            continue
        prepared = prepared or Prepared(files.model, made_model(files, (), folder).open())
        found[step] = changes(earlier, one.provenance(files, prepared, settings))
        if not found[step]:
            prepared = Prepared(out, made_model(files, (*found,), folder).open())
    return found


def _stored(tables: Path) -> Provenance | None:
    """What an earlier run made a step's result from."""
    try:
        return Provenance.from_json((tables / PROVENANCE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None

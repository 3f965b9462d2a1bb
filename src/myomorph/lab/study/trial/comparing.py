"""Two folders of results as two sessions of walking on one page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from myomorph.core.io.parsing.text import written
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.analysis.gait_curves import joined_curves
from myomorph.lab.analysis.gait_parameters import gait_parameters
from myomorph.lab.report.trial.answer.answer import answer_of
from myomorph.lab.report.trial.comparison.comparison_page import comparison_page, stricter
from myomorph.lab.report.trial.comparison.walk_session import WalkSession
from myomorph.lab.report.trial.gait.gait_page import who_facts
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.store.results import read_result, result_files
from myomorph.lab.study.step.step import large_variables
from myomorph.lab.study.trial.reporting import ModelMaker, TrialResults, model_of


def compare_folders(
    first: Path, second: Path, out: Path, demo_model: ModelMaker | None = None
) -> Path:
    """Write the page that compares the walks of two folders.

    Parameters
    ----------
    first, second : folders of results, of a trial or of several of one session
    out : page to write (.html)
    demo_model : makes the model of a demo by its name

    Returns
    -------
    the page

    Raises
    ------
    BadFile : a folder has no walk, or the page has another ending
    """
    if out.suffix.lower() != ".html":
        raise BadFile(out, "is no name of a page", "give a name that ends in .html")
    before_name, after_name = _names(first, second)
    before_walks = _walks(first, demo_model)
    after_walks = _walks(second, demo_model)
    page = comparison_page(
        _session(before_name, before_walks),
        _session(after_name, after_walks),
        _notes(before_walks, after_walks),
    )
    with written(out) as stream:
        stream.write(page)
    return out


def _walks(folder: Path, demo_model: ModelMaker | None) -> list[Prepared]:
    """Read the walks of a folder."""
    if not folder.is_dir():
        raise BadFile(folder, "is not a folder of results", "give the --out of analyze or run")
    model = partial(model_of, demo_model=demo_model)
    walks = []
    for path in result_files(folder):
        stored = read_result(path, leave_out=large_variables())
        prepared = TrialResults(path, model(stored), stored, page=False).prepared
        if prepared.gait is not None and any(prepared.gait.strides.values()):
            walks.append(prepared)
    if not walks:
        raise BadFile(folder, "has no walk of two legs", "give folders of results of walks")
    return walks


def _names(first: Path, second: Path) -> tuple[str, str]:
    """Return the shortest ends of two paths that differ."""
    one = first.resolve().parts
    other = second.resolve().parts
    for count in range(1, max(len(one), len(other)) + 1):
        before = "/".join(one[-count:])
        after = "/".join(other[-count:])
        if before != after:
            return before, after
    raise BadFile(first, "is given twice", "give two folders")


def _session(name: str, walks: Sequence[Prepared]) -> WalkSession:
    """Return the walks of a folder as one session."""
    use = answer_of(walks[0]).judgement.use
    for walk in walks[1:]:
        use = stricter(use, answer_of(walk).judgement.use)
    facts = {key: text for key, text in who_facts(walks[0]).items() if key != "Not stated"}
    titles = ", ".join(walk.results.head.title for walk in walks)
    return WalkSession(
        name=name,
        facts=FrozenMap(facts | {"Trials": titles}),
        curves=joined_curves([walk.gait for walk in walks if walk.gait is not None]),
        parameters=gait_parameters(*(each.strides for each in walks if each.strides is not None)),
        use=use,
    )


def _notes(before: Sequence[Prepared], after: Sequence[Prepared]) -> list[str]:
    """Say what makes two sessions differ that is none of the walks'."""
    notes = []
    models = [_listed(map(_model_name, walks)) for walks in (before, after)]
    if models[0] != models[1]:
        notes.append(
            f"The models differ ({' and '.join(models)}): offsets of angles may be theirs."
        )
    people = [_listed(walk.results.recorded.subject for walk in walks) for walks in (before, after)]
    if people[0] != people[1]:
        notes.append(f"The subjects have different names: {' and '.join(people)}.")
    return notes


def _listed(names: Iterable[str]) -> str:
    """Return different names in the order of the alphabet."""
    return ", ".join(sorted(set(names)))


def _model_name(walk: Prepared) -> str:
    model = walk.results.model
    return "" if model is None else model.name

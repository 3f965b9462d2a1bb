"""Names of a study file that must be those of a model: bodies, markers and muscles, looked up before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from myomorph.model.errors import MyomorphError, listing
from myomorph.model.model import Model
from myomorph.study.trial.inputs import open_model
from myomorph.study.trial.trial_files import TrialFiles


def check_model_names(trials: Sequence[TrialFiles], problems: list[str]) -> None:
    """Add to the problems the names that no part of a trial's model has.

    A name that stands in the model's file is taken for right without reading the model, so that a study of many
    models is still checked at once. A model that cannot be read is told when its trials run.
    """
    texts: dict[Path, str] = {}
    models: dict[Path, Model | None] = {}
    seen: set[tuple[str, Path, str, str]] = set()
    for trial in trials:
        for kind, what, name in _told(trial):
            key = (trial.subject, trial.model, kind, name)
            if key in seen:
                continue
            seen.add(key)
            if trial.model not in texts:
                texts[trial.model] = _text(trial.model)
            if f'"{name}"' in texts[trial.model] or f"'{name}'" in texts[trial.model]:
                continue
            if trial.model not in models:
                models[trial.model] = _model(trial.model)
            model = models[trial.model]
            if model is None or name in (known := _names(kind, model)):
                continue
            where = f"subject '{trial.subject}': {what}"
            problems.append(f"{where}: unknown {kind} '{name}': {trial.model.name} has {listing(name, known)}")


def _told(trial: TrialFiles) -> Iterator[tuple[str, str, str]]:
    """Kind, key of the study file and name of all that must be the model's."""
    yield from (("body", "bodies", name) for name in trial.bodies.values() if name != "ground")
    yield from (("body", "plates", name) for name in trial.plates if name)
    yield from (("marker", "labels", name) for name in trial.labels.values())
    yield from (("muscle", "emg_muscles", name) for names in trial.emg_muscles.values() for name in names)


def _names(kind: str, model: Model) -> tuple[str, ...]:
    if kind == "body":
        return tuple(body.name for body in model.bodies)
    return tuple(one.name for one in (model.markers if kind == "marker" else model.muscles))


def _text(path: Path) -> str:
    """A model's file as text, names as they stand in XML."""
    try:
        return path.read_bytes().decode("utf-8", errors="replace")
    except OSError:
        return ""


def _model(path: Path) -> Model | None:
    try:
        return open_model(path)
    except MyomorphError:
        return None

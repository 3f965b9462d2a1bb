"""Steps that are about a subject rather than a trial: they make the model that the trials then use."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance
from myomorph.store.results import file_source, provenance_of
from myomorph.study.subject.made_model import PROVENANCE
from myomorph.study.subject.subject_files import MODELS, SUBJECT_STEPS, TABLES, SubjectFiles, made_model
from myomorph.study.trial.changes import NEVER, changes
from myomorph.study.trial.motion_steps import solve_kinematics
from myomorph.study.trial.take import Take
from myomorph.study.trial.takes import Settings, open_take


@dataclass(frozen=True)
class Prepared:
    """The model that a subject's trials use.

    Attributes
    ----------
    path : of its file
    model : itself; its source is the file beside which its meshes lie
    done, kept : steps that made it, and those taken over from an earlier run
    changed : what made steps be computed again that an earlier run had done
    timed : each step that was computed, and how long it took [s]
    """

    path: Path
    model: Model
    done: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    timed: tuple[tuple[str, float], ...] = ()


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
        folder.mkdir(parents=True, exist_ok=True)
        out, tables = folder / MODELS[step], folder / TABLES[step]
        made = _provenance(step, files, prepared, settings)
        earlier = _stored(tables) if out.is_file() and not fresh else None
        known = earlier is not None and earlier.key == made.key
        started = time.monotonic()
        if not known:
            _RUNNERS[step](files, prepared, settings, made, out, tables)
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
    for step in [one for one in SUBJECT_STEPS if one in steps]:
        out, tables = folder / MODELS[step], folder / TABLES[step]
        earlier = _stored(tables) if out.is_file() else None
        if earlier is None or any(found.values()):
            found[step] = (NEVER if earlier is None else "the model that it begins with is made anew",)
            continue
        prepared = prepared or Prepared(files.model, made_model(files, (), folder).open())
        found[step] = changes(earlier, _provenance(step, files, prepared, settings))
        if not found[step]:
            prepared = Prepared(out, made_model(files, (*found,), folder).open())
    return found


def _takes(files: SubjectFiles, prepared: Prepared, settings: Settings) -> list[Take]:
    return [open_take(replace(one, model=prepared.path), settings, prepared.model) for one in files.takes]


def _provenance(step: str, files: SubjectFiles, prepared: Prepared, settings: Settings) -> Provenance:
    """What the step's result is made from: the model so far, all recordings, and what the step is told."""
    if step == "morph" and files.bones is not None:
        return provenance_of(step, files.bones.sources(), files.bones.told() | dict(settings.get(step, {})))
    takes = _takes(files, prepared, settings)
    sources = list(dict.fromkeys(source for take in takes for source in take.sources))
    given = (("static", files.static), ("skin", files.shape.skin), ("landmarks", files.shape.landmarks))
    sources += [file_source(role, path) for role, path in given if path is not None]
    options: dict[str, object] = {f"{step}.{name}": value for name, value in settings.get(step, {}).items()}
    options |= {"mass": files.mass, "times": [None if one.time is None else list(one.time) for one in files.takes]}
    if step == "identify":
        options |= {f"shape.{name}": getattr(files.shape, name) for name in ("height", "chest", "sex", "age")}
        for earlier in ("ik", "id"):
            options |= {f"{earlier}.{name}": value for name, value in settings.get(earlier, {}).items()}
    return provenance_of(step, sources, options)


def _stored(tables: Path) -> Provenance | None:
    """What an earlier run made a step's result from."""
    try:
        return Provenance.from_json((tables / PROVENANCE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _identify(
    files: SubjectFiles, prepared: Prepared, settings: Settings, made: Provenance, out: Path, tables: Path
) -> None:
    from myomorph.study.subject.identifying import IdentifyOptions, SubjectMotion, identify_subject, write_identified

    motions = []
    for take in _takes(files, prepared, settings):
        if take.loads is None:
            continue
        motion = solve_kinematics(take).motion
        motions.append(SubjectMotion(take.name, motion, take.loads(motion)))
    if not motions:
        raise BadData(
            f"subject '{files.name}': no trial has external forces, so 'identify' has nothing to hold masses against"
        )
    shared = {name: value for step in ("id", "identify") for name, value in settings.get(step, {}).items()}
    options = IdentifyOptions.of(shared)
    identified = identify_subject(prepared.model, motions, files.shape, files.mass, options)
    write_identified(replace(identified, provenance=made), out, files.name, tables)


def _calibrate(
    files: SubjectFiles, prepared: Prepared, settings: Settings, made: Provenance, out: Path, tables: Path
) -> None:
    from myomorph.study.subject.calibrating import calibrate_subject

    calibrate_subject(prepared.model, _takes(files, prepared, settings), files, settings, made, out, tables)


def _morph(
    files: SubjectFiles, prepared: Prepared, settings: Settings, made: Provenance, out: Path, tables: Path
) -> None:
    from myomorph.study.subject.morphing import morph_subject

    morph_subject(prepared.model, files, settings, made, out, tables)


_RUNNERS: dict[str, Callable[[SubjectFiles, Prepared, Settings, Provenance, Path, Path], None]] = {
    "morph": _morph,
    "calibrate": _calibrate,
    "identify": _identify,
}

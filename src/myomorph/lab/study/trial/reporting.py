"""From results to `report.html`.

It shows what was found, what it was derived from, what is real and what is assumed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from myomorph import __version__
from myomorph.core.io.parsing.text import write_csv, written
from myomorph.core.model.causes import WEIGHT
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.join import join_models
from myomorph.core.model.messages import Message, messages_of
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance, Source
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.model.severity import FORCE_ERROR, severity_of
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import ACTIVATION
from myomorph.lab.analysis.length_analysis import RANGE_HEAD, curve_rows, range_row
from myomorph.lab.analysis.phases import Phase
from myomorph.lab.analysis.presets import preset_of
from myomorph.lab.report.page.parts import Note, PageHead, SourceFile, option_text
from myomorph.lab.report.page.parts import Step as PageStep
from myomorph.lab.report.scene.shapes import reduced
from myomorph.lab.report.trial.answer.answer import answer_of
from myomorph.lab.report.trial.answer.answer_table import write_answer
from myomorph.lab.report.trial.gait.gait_page import GAIT_PAGE, gait_page
from myomorph.lab.report.trial.prepared import Prepared, prepare
from myomorph.lab.report.trial.report_input import AnalysisChoice, Recorded, ReportInput, Truth
from myomorph.lab.report.trial.trial_page import prepared_page
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import STORED, Stored, file_source, read_result, result_files
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.inputs.session import recorded_movement
from myomorph.lab.study.step.step import large_variables, step_of
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.trial.control_group import control_people
from myomorph.lab.study.trial.gait_norms import (
    ADULTS,
    NO_NORM,
    GaitNorms,
    checked_norms,
    is_table,
    norm_of,
    walker_of,
)
from myomorph.lab.study.trial.norm_file import read_norms
from myomorph.lab.study.trial.together import object_model

REPORT = "report.html"
DEMO = "demo:"  # Begins the name of a model that a demo makes.

ModelMaker = Callable[[str], Model]  # Makes a model by a name.

NOT_IN_TABLES = ("coordinate_acceleration", "muscle_velocity")
"""Variables of results that no table of values comes from."""
LENGTH_CURVES = "length_strides.csv"
LENGTH_RANGES = "length_ranges.csv"


def report_folder(
    folder: str | Path,
    preset: str = "",
    times: Sequence[float] = (),
    demo_model: ModelMaker | None = None,
    norms: Sequence[str] = (),
) -> list[Path]:
    """Make `report.html` of every folder of results in a folder, or of the folder itself.

    What a report says is described in docs/report.md.

    Parameters
    ----------
    folder : of results, of a trial or of a whole study
    preset : how to look at the motion, see `presets`; "" as the results say
    times : instants to picture [s], () for those of events
    demo_model : makes the model of a demo by its name; without it results of demos are refused
    norms : what the gait page holds a walk against: folders of results of a control group, a file
        of 'myomorph norms', ("adults",) or ("none",); by default adults, where age and speed fit

    Returns
    -------
    the reports written

    Raises
    ------
    BadFile
        where there are no results, or the model they were made with is gone

    Examples
    --------
    >>> import myomorph as mm
    >>> [path.name for path in mm.report_folder("results")]
    ['report.html']
    """
    if preset:
        preset_of(preset)
    folder = Path(folder)
    if not folder.is_dir():
        raise BadFile(
            folder, "is not a folder of results", "give the --out of run, muscles or tension"
        )
    homes = [folder] if any(folder.glob(f"*{STORED}")) else []
    homes = homes or sorted({path.parent for path in result_files(folder)})
    model = partial(model_of, demo_model=demo_model)
    walks = gait_norms(norms, model)
    return [
        _write(home, sorted(home.glob(f"*{STORED}")), preset, times, model, walks) for home in homes
    ]


def _write(
    home: Path,
    paths: Sequence[Path],
    preset: str,
    times: Sequence[float],
    model: Callable[[Stored], Model],
    norms: GaitNorms,
) -> Path:
    """Write the report of the results in one folder, whole or not at all."""
    stored = joined([read_result(path, leave_out=large_variables()) for path in paths])
    shown = report_input(stored, model(stored))
    chosen = replace(shown.analysis, preset=preset or shown.analysis.preset, times=tuple(times))
    return write_report(home, prepare(replace(shown, analysis=chosen)), norms)


def write_report(home: Path, prepared: Prepared, norms: GaitNorms | None = None) -> Path:
    """Write `report.html`, whole or not at all.

    Where the motion is a walk the page on its gait and muscle lengths of every stride are written,
    too.
    """
    answer = answer_of(prepared)
    write_answer(home, prepared, answer)
    texts = {REPORT: prepared_page(prepared, answer)}
    if prepared.gait is not None and prepared.results.model is not None:
        norm, note = norm_of(norms or GaitNorms(), walker_of(prepared))
        texts[GAIT_PAGE] = gait_page(prepared, prepared.gait, norm, note)
    analysis = prepared.lengths
    if analysis is not None and analysis.ranges:
        rows = curve_rows(analysis)
        write_csv(home / LENGTH_CURVES, next(rows), rows)
        write_csv(home / LENGTH_RANGES, RANGE_HEAD, map(range_row, analysis.ranges))
    for name, text in texts.items():
        with written(home / name) as stream:
            stream.write(text)
    if GAIT_PAGE not in texts:
        # That of a movement which was corrected since.
        (home / GAIT_PAGE).unlink(missing_ok=True)
    return home / REPORT


def gait_norms(norms: Sequence[str], model: Callable[[Stored], Model]) -> GaitNorms:
    """Read what walks are held against.

    Parameters
    ----------
    norms : folders of results of a control group, a file of norms, ("adults",) or ("none",)
    model : of a result
    """
    names = checked_norms(norms)
    if is_table(names):
        return GaitNorms(names, groups=read_norms(Path(names[0])))
    folders = () if names in ((ADULTS,), (NO_NORM,)) else names

    def prepared(path: Path, stored: Stored) -> Prepared:
        return TrialResults(path, model(stored), stored, page=False).prepared

    return GaitNorms(names, controls=control_people(folders, prepared))


class TrialResults:
    """The results of a trial, read and prepared once, when first used.

    A page needs more than tables of values.
    """

    def __init__(self, path: Path, model: Model, stored: Stored | None = None, page: bool = True):
        self.path = path
        self.model = model
        self._stored = stored
        self._page = page
        self._leave_out = (*large_variables(), *(() if page else NOT_IN_TABLES))

    @cached_property
    def stored(self) -> Stored:
        """What the result file holds."""
        return self._stored or read_result(self.path, leave_out=self._leave_out)

    @cached_property
    def prepared(self) -> Prepared:
        """What follows from it."""
        return prepare(report_input(self.stored, self.model, self._page))


def joined(parts: Sequence[Stored]) -> Stored:
    """Several results of one recording as one."""
    first = parts[0]
    values = dict(first.values)
    names = dict(first.names)
    made = dict(first.provenance)
    facts = dict(first.facts)
    for part in parts[1:]:
        if (
            len(part.time) != len(first.time)
            or np.max(np.abs(part.time - first.time), initial=0.0) > 1e-6
        ):
            raise BadData(
                f"{part.path}: has {len(part.time)} frames from {part.time[:1]} s, but"
                f" {first.path.name} {len(first.time)} from {first.time[:1]} s; keep the results of"
                " one recording in a folder of their own"
            )
        values = values | dict(part.values)
        names = names | dict(part.names)
        made = made | dict(part.provenance)
        facts = facts | dict(part.facts)
    return Stored(path=first.path, values=values, names=names, provenance=made, facts=facts)


def model_of(stored: Stored, demo_model: ModelMaker | None = None) -> Model:
    """Read the model again that results were made with; a demo's by its name."""
    sources = list(
        dict.fromkeys(
            source
            for made in stored.provenance.values()
            for source in made.sources
            if source.role == "model"
        )
    )
    if not sources:
        raise BadFile(
            stored.path, "does not show which model it was made with", "run the steps again"
        )
    parts = json.loads(stored.facts.get("parts", "{}"))
    if not parts:
        return _source_model(sources[0], stored, demo_model)
    by_name = {source.name: source for source in sources}
    models = {
        name: (
            object_model(source)
            if isinstance(source, dict)
            else _source_model(by_name[source], stored, demo_model)
        )
        for name, source in parts.items()
    }
    return join_models(models, stored.facts["trial"])


def _source_model(source: Source, stored: Stored, demo_model: ModelMaker | None) -> Model:
    if source.name.startswith(DEMO) and demo_model is not None:
        return demo_model(source.name.removeprefix(DEMO))
    return open_model(source_file(source, stored))


def source_file(source: Source, stored: Stored) -> Path:
    """Return the file that results were derived from, as it was then; raise `BadFile`."""
    # A name that was given relative to a folder is looked for from the results upwards too.
    places = dict.fromkeys(
        [Path(source.name), *(parent / source.name for parent in stored.path.resolve().parents)]
    )
    there = [place for place in places if place.is_file()]
    if not there:
        raise BadFile(
            source.name,
            f"is gone, but the {source.role} is needed",
            f"{stored.path} was made with it",
        )
    same = next(
        (place for place in there if file_source(source.role, place).sha256 == source.sha256), None
    )
    if same is None:
        raise BadFile(there[0], "has changed since the results were made", "run the steps again")
    return same


def report_input(stored: Stored, model: Model, drawn: bool = True) -> ReportInput:
    """Return what a report is made of, from results and their model.

    `drawn`: with the meshes that lie beside the model's file, which tables of values do not need.
    """
    facts = stored.facts
    head = _page_head(stored, model)
    recorded = _recorded(stored)
    phases = tuple(
        Phase(name=name, start=start, stop=stop)
        for name, (start, stop) in json.loads(facts.get("phases", "{}")).items()
    )
    choice = AnalysisChoice(
        facts.get("preset", ""), phases, muscles=tuple(json.loads(facts.get("muscles", "[]")))
    )
    meshes: Mapping[str, Surface] = (
        reduced_for_pictures(surfaces_of(model)) if drawn else FrozenMap({})
    )
    shown = ReportInput(head=head, model=model, surfaces=meshes, recorded=recorded, analysis=choice)
    for step in STEPS["trial"]:
        shown = step_of(step).show(shown, stored)
    return shown


def _page_head(stored: Stored, model: Model) -> PageHead:
    """Return title, notes, sources and steps of a result for the top of its page."""
    facts = stored.facts
    notes = json.loads(facts.get("notes", "{}"))
    names = (facts.get("subject", ""), facts.get("trial", ""))
    steps = [step for step in STEPS["trial"] if step in stored.provenance]
    return PageHead(
        title=": ".join(name for name in names if name) or model.name,
        date=max((made.date for made in stored.provenance.values()), default=""),
        version=__version__,
        notes=tuple(
            Note(kind, text)
            for kind in ("real", "simulated", "assumed")
            for text in notes.get(kind, ())
        ),
        sources=_sources(stored.provenance),
        steps=tuple(_shown_step(step, stored) for step in steps),
        warnings=(
            *messages_of(facts.get("warnings", "[]")),
            *_mass_warning(facts.get("mass", ""), model),
        ),
    )


def _recorded(stored: Stored) -> Recorded:
    """Return what was recorded of the subject and the trial."""
    facts = stored.facts
    mass = facts.get("mass", "")
    muscles = json.loads(facts.get("emg_muscles", "{}"))
    return Recorded(
        subject=facts.get("subject", ""),
        mass=float(mass) if mass else None,
        age=_number(facts, "age"),
        sex=facts.get("sex", ""),
        height=_number(facts, "height"),
        facts=FrozenMap({"Body mass": f"{float(mass):.4g} kg"} if mass else {}),
        emg=store.get_emg(stored),
        emg_muscles={name: tuple(of) for name, of in muscles.items()},
        plates=store.get_plates(stored),
        events=store.get_events(stored) or None,
        truth=_truth(stored),
        movement=recorded_movement(facts),
        date=facts.get("date", ""),
    )


def _truth(stored: Stored) -> Truth | None:
    """Return what is known of a simulated recording, None of any other."""
    truth = store.get_truth(stored)
    if not truth:
        return None
    return Truth(
        motion=truth.get(COORDINATE_VALUE.name),
        torques=truth.get(GENERALIZED_FORCE.name),
        activations=truth.get(ACTIVATION.name),
    )


def _number(facts: Mapping[str, str], name: str) -> float | None:
    """Return a number among the facts of a result file, None where it is not known."""
    text = facts.get(name, "")
    return float(text) if text else None


MAX_TRIANGLES = 40000


def surfaces_of(model: Model) -> Mapping[str, Surface]:
    """Meshes of the model's bodies, as far as they lie beside its file."""
    from myomorph.core.io.mesh import mesh_folders, read_surfaces

    folders = mesh_folders(model)
    return read_surfaces(model, folders)[0] if folders else {}


def reduced_for_pictures(surfaces: Mapping[str, Surface]) -> Mapping[str, Surface]:
    """Return copies with no more triangles than pictures a few hundred pixels tall can show."""
    sizes = [float(np.ptp(surface.vertices, axis=0).max()) for surface in surfaces.values()]
    # A body is about four times as tall as its longest bone.
    return dict(
        zip(
            surfaces,
            reduced(list(surfaces.values()), 4.0 * max(sizes, default=0.0), MAX_TRIANGLES),
            strict=True,
        )
    )


def _sources(made: Mapping[str, Provenance]) -> tuple[SourceFile, ...]:
    unique = dict.fromkeys(
        (source.role, Path(source.name).name, source.sha256)
        for each in made.values()
        for source in each.sources
    )
    return tuple(SourceFile(role=role, name=name, sha256=sha256) for role, name, sha256 in unique)


def _shown_step(step: str, stored: Stored) -> PageStep:
    made = stored.provenance[step]
    prefix = f"{step}."
    told = {
        name.removeprefix(prefix): value
        for name, value in made.options.items()
        if name.startswith(prefix)
    }
    options = {name: option_text(value) for name, value in told.items()}
    time = made.options.get("time")
    if isinstance(time, list):
        options["time"] = f"{time[0]:g} to {time[1]:g} s"
    return PageStep(
        name=step_of(step).title, options=options, seconds=None, frames=len(stored.time)
    )


def _mass_warning(mass: str, model: Model) -> list[Message]:
    """Return a sentence if the subject's mass is not the model's: these steps scale no masses."""
    if not mass or abs(float(mass) - model.mass) <= 0.02 * model.mass:
        return []
    difference = 100.0 * (float(mass) / model.mass - 1.0)
    return [
        WEIGHT.message(
            f"the subject weighs {float(mass):g} kg, but the model {model.mass:.4g} kg: torques"
            " belong to the model's mass",
            size=difference,
            severity=severity_of(difference, 100.0 * FORCE_ERROR),
        )
    ]

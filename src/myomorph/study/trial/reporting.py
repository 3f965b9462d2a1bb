"""From results to `report.html`: what was found, what it was made from, what is real and what is assumed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from myomorph import __version__
from myomorph.analysis.length_analysis import curves_table, ranges_table
from myomorph.analysis.phase import Phase
from myomorph.analysis.presets import preset_of
from myomorph.io.parsing.text import written
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, BadFile
from myomorph.model.join import join_models
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance, Source
from myomorph.model.series import Series
from myomorph.model.surface import Surface
from myomorph.muscles.path import compile_paths
from myomorph.report.page.parts import Note, SourceFile, Step
from myomorph.report.trial.given import ReportInput, Truth
from myomorph.report.trial.muscle_sections import analysed_lengths
from myomorph.report.trial.prepared import prepare
from myomorph.report.trial.trial_page import report_page
from myomorph.store import contact_store
from myomorph.store import stored as store
from myomorph.store.results import STORED, Stored, file_name, file_source, read_result
from myomorph.study.trial.contact_doubts import get_intervals, get_uncarried
from myomorph.study.trial.inputs import open_model
from myomorph.study.trial.take import CHAIN, Take
from myomorph.study.trial.together import object_model
from myomorph.tension.solve import Tension, TensionOptions

REPORT = "report.html"
DEMO = "demo:"
"""Begins the name of a model that a demo makes."""

ModelMaker = Callable[[str], Model]
"""Makes a model by a name."""

LENGTH_CURVES, LENGTH_RANGES = "length_strides.csv", "length_ranges.csv"
STEP_NAMES = MappingProxyType(
    {
        "ik": "inverse kinematics",
        "id": "inverse dynamics",
        "muscles": "muscle paths",
        "tension": "muscle tensions",
    }
)


@dataclass(frozen=True, eq=False)
class ShownTension:
    """A tension as reports read it; see `TensionResult`."""

    time: Array
    muscles: tuple[str, ...]
    activations: Array
    forces: Array
    reserves: Array
    reserve_coordinates: tuple[str, ...]
    solved: np.ndarray


def report_folder(
    folder: str | Path,
    take: Take | None = None,
    preset: str = "",
    times: Sequence[float] = (),
    demo_model: ModelMaker | None = None,
) -> list[Path]:
    """Make `report.html` of every folder of results in a folder, or of the folder itself.

    Parameters
    ----------
    take : the recording, where it is at hand; else the model is read again from where it was
    preset : how to look at the motion, see `presets`; "" as the results say
    times : instants to picture [s], () for those of events
    demo_model : makes the model of a demo by its name; without it results of demos are refused

    Returns
    -------
    the reports written

    Raises
    ------
    BadFile
        where there are no results, or the model they were made with is gone
    """
    if preset:
        preset_of(preset)
    folder = Path(folder)
    if not folder.is_dir():
        raise BadFile(folder, "is not a folder of results", "give the --out of run, muscles or tension")
    if take is not None:
        return [_write(folder, [folder / f"{file_name(take.name)}{STORED}"], preset, times, lambda found: take.model)]
    homes = [folder] if any(folder.glob(f"*{STORED}")) else []
    homes = homes or sorted({path.parent for path in folder.rglob(f"*{STORED}") if ".steps" not in path.parts})
    if not homes:
        raise BadFile(folder, f"holds no results: no file in it ends in {STORED}", "give the --out of run or tension")
    model = partial(model_of, demo_model=demo_model)
    return [_write(home, sorted(home.glob(f"*{STORED}")), preset, times, model) for home in homes]


def _write(
    home: Path, paths: Sequence[Path], preset: str, times: Sequence[float], model: Callable[[Stored], Model]
) -> Path:
    """The report of the results in one folder, whole or not at all."""
    found = joined([read_result(path, leave_out=("moment_arm",)) for path in paths])
    given = report_input(found, model(found))
    text = report_page(replace(given, preset=preset or given.preset, times=tuple(times)))
    temporary = home / f".{REPORT}.part"
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, home / REPORT)
    _write_length_tables(home, given)
    return home / REPORT


def _write_length_tables(home: Path, given: ReportInput) -> None:
    """Muscle lengths of every stride, and what each muscle does in one, where the motion is a walk."""
    if given.lengths is None:
        return
    analysis = analysed_lengths(prepare(given))
    if analysis is not None and analysis.ranges:
        with written(home / LENGTH_CURVES) as stream:
            stream.write(curves_table(analysis))
        with written(home / LENGTH_RANGES) as stream:
            stream.write(ranges_table(analysis))


def joined(parts: Sequence[Stored]) -> Stored:
    """Several results of one recording as one.

    Raises
    ------
    BadData
        where their times differ
    """
    first = parts[0]
    values, names, made, facts = dict(first.values), dict(first.names), dict(first.provenance), dict(first.facts)
    for part in parts[1:]:
        if len(part.time) != len(first.time) or np.max(np.abs(part.time - first.time), initial=0.0) > 1e-6:
            raise BadData(
                f"{part.path}: has {len(part.time)} frames from {part.time[:1]} s, but {first.path.name} "
                f"{len(first.time)} from {first.time[:1]} s; keep the results of one recording in a folder of their own"
            )
        values, names = values | dict(part.values), names | dict(part.names)
        made, facts = made | dict(part.provenance), facts | dict(part.facts)
    return Stored(first.path, values, names, made, facts)


def model_of(found: Stored, demo_model: ModelMaker | None = None) -> Model:
    """The model that results were made with, read again.

    Parameters
    ----------
    demo_model : makes the model of a demo by its name

    Raises
    ------
    BadFile
        where the file is gone or has changed since
    """
    sources = list(
        dict.fromkeys(one for made in found.provenance.values() for one in made.sources if one.role == "model")
    )
    if not sources:
        raise BadFile(found.path, "does not tell which model it was made with", "run the steps again")
    parts = json.loads(found.facts.get("parts", "{}"))
    if not parts:
        return _source_model(sources[0], found, demo_model)
    by_name = {one.name: one for one in sources}
    models = {
        name: object_model(told) if isinstance(told, dict) else _source_model(by_name[told], found, demo_model)
        for name, told in parts.items()
    }
    return join_models(models, found.facts["trial"])


def _source_model(source: Source, found: Stored, demo_model: ModelMaker | None) -> Model:
    if source.name.startswith(DEMO) and demo_model is not None:
        return demo_model(source.name.removeprefix(DEMO))
    # A name that was given relative to a folder is looked for from the results upwards too.
    places = dict.fromkeys([Path(source.name), *(one / source.name for one in found.path.resolve().parents)])
    there = [one for one in places if one.is_file()]
    if not there:
        raise BadFile(source.name, "is gone, but the model is needed", f"{found.path} was made with it")
    same = next((one for one in there if file_source("model", one).sha256 == source.sha256), None)
    if same is None:
        raise BadFile(there[0], "has changed since the results were made", "run the steps again")
    return open_model(same)


def report_input(found: Stored, model: Model, surfaces: Mapping[str, Surface] | None = None) -> ReportInput:
    """What a report is made of, from results and their model.

    Parameters
    ----------
    surfaces : meshes of the bodies; by default those that lie beside the model's file
    """
    facts = found.facts
    notes = json.loads(facts.get("notes", "{}"))
    mass = facts.get("mass", "")
    tension = store.get_tension(found, TensionOptions())
    truth = store.get_truth(found)
    arms = found.names.get("crossing_coordinate", ())
    fit = store.get_fit(found)
    contacts = contact_store.get_contact_forces(found)
    warnings = [*json.loads(facts.get("warnings", "[]")), *_mass_doubt(mass, model)]
    return ReportInput(
        title=": ".join(one for one in (facts.get("subject", ""), facts.get("trial", "")) if one) or model.name,
        subject=facts.get("subject", ""),
        date=max((made.date for made in found.provenance.values()), default=""),
        version=__version__,
        notes=tuple(Note(kind, text) for kind in ("real", "simulated", "assumed") for text in notes.get(kind, ())),
        facts=MappingProxyType({"Body mass": f"{float(mass):.4g} kg"} if mass else {}),
        sources=_sources(found.provenance),
        steps=tuple(_step(step, found) for step in CHAIN if step in found.provenance),
        model=model,
        surfaces=surfaces_of(model) if surfaces is None else surfaces,
        markers=store.get_markers(found),
        fit=fit,
        motion=store.get_derivatives(found) if fit is None else None,
        wrenches=store.get_wrenches(found),
        plates=store.get_plates(found),
        torques=contact_store.get_carried(found) or store.get_torques(found),
        contacts=contact_store.get_contacts(found),
        contact_forces=contacts,
        residuals=_residuals(tension) if contacts is not None else None,
        intervals=get_intervals(found),
        uncarried=get_uncarried(found),
        situation=contact_store.get_situation(found),
        root_note=facts.get("root_note", ""),
        lengths=_by_muscle(found, "muscle_length"),
        length_rates=_by_muscle(found, "muscle_velocity"),
        driven=tuple(dict.fromkeys(arms)) or _driven(model),
        tension=None if tension is None else shown_tension(tension, found),
        overstretched=() if tension is None else tension.overstretched,
        emg=store.get_emg(found),
        emg_muscles={name: tuple(of) for name, of in json.loads(facts.get("emg_muscles", "{}")).items()},
        events=store.get_events(found) or None,
        preset=facts.get("preset", ""),
        phases=tuple(Phase(name, *span) for name, span in json.loads(facts.get("phases", "{}")).items()),
        truth=Truth(truth.get("motion"), truth.get("torques"), truth.get("activations")) if truth else None,
        warnings=tuple(warnings),
    )


def _driven(model: Model) -> tuple[str, ...]:
    """Coordinates that at least one muscle crosses, where no step wrote moment arms."""
    if not model.muscles:
        return ()
    return tuple(model.coordinate_names[j] for j in sorted(set(compile_paths(model).arm_coordinate.tolist())))


def _residuals(tension: Tension | None) -> Series | None:
    """Forces and torques that hold a floating root, as far as they are not the contacts' (frames, residuals)."""
    if tension is None or not tension.residual_names:
        return None
    columns = [tension.reserve_names.index(name) for name in tension.residual_names]
    return Series(tension.time, tension.residual_names, tension.reserves[:, columns])


def shown_tension(tension: Tension, found: Stored) -> ShownTension:
    """A tension with the coordinate of every reserve, "" for those on bodies."""
    return ShownTension(
        tension.time,
        tension.muscles,
        tension.activations,
        tension.forces,
        tension.reserves,
        found.names.get("actuator_coordinate", ()),
        tension.optimal,
    )


def surfaces_of(model: Model) -> Mapping[str, Surface]:
    """Meshes of the model's bodies, as far as they lie beside its file."""
    from myomorph.io.mesh import read_surfaces

    source = Path(model.source)
    if not model.source or not source.parent.is_dir():
        return {}
    folders = [source.parent, source.parent / "Geometry", source.parent / "geometry"]
    return read_surfaces(model, [one for one in folders if one.is_dir()])[0]


def _by_muscle(found: Stored, name: str) -> Series | None:
    values = found.values.get(name)
    return None if values is None else Series(found.time, found.names["muscle"], values)


def _sources(made: Mapping[str, Provenance]) -> tuple[SourceFile, ...]:
    unique = dict.fromkeys(
        (one.role, Path(one.name).name, one.sha256) for each in made.values() for one in each.sources
    )
    return tuple(SourceFile(*one) for one in unique)


def _step(step: str, found: Stored) -> Step:
    made = found.provenance[step]
    prefix = f"{step}."
    options = {
        name.removeprefix(prefix): _told(value) for name, value in made.options.items() if name.startswith(prefix)
    }
    time = made.options.get("time")
    if isinstance(time, list):
        options["time"] = f"{time[0]:g} to {time[1]:g} s"
    return Step(STEP_NAMES[step], options, None, len(found.time))


def _told(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _mass_doubt(mass: str, model: Model) -> list[str]:
    """A sentence where the subject's mass is not the model's: masses are not scaled by these steps."""
    if not mass or abs(float(mass) - model.mass) <= 0.02 * model.mass:
        return []
    return [
        f"the subject weighs {float(mass):g} kg, but the model {model.mass:.4g} kg: torques belong to the model's mass"
    ]

"""Recordings of several subjects, and of objects between them, as one.

They are joined for forces that they pass to each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import free_object
from myomorph.core.model.join import (
    clock_difference,
    join_models,
    join_motions,
    join_series,
    join_wrenches,
)
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.series import Emg, Motion, Series, Wrenches
from myomorph.core.model.shown import shown
from myomorph.core.motion.clocks import on_one_clock
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.core.tension.terms.contacts import ContactOptions
from myomorph.lab.store.named_files import existing
from myomorph.lab.store.results import file_source, value_source
from myomorph.lab.store.settings import Measured
from myomorph.lab.store.study_file import Strict
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.contact_file import contact_sources, read_contacts
from myomorph.lab.study.inputs.contacts import ContactsFile
from myomorph.lab.study.inputs.emg import RecordedEmg
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.inputs.keys import Notes, Place, WordOrFile
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.phases import Phases
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.inputs.truth import KnownTruth
from myomorph.lab.study.step.step import step_head
from myomorph.lab.study.step.step_table import REPORT, STEPS
from myomorph.lab.study.trial.steps.ik import Poses
from myomorph.lab.study.trial.trial_inputs import (
    JoinedParts,
    Settings,
    TrialFiles,
    TrialInputs,
    TrialNotes,
    options_of,
)


class ObjectTable(Strict):
    """An object of known inertia.

    It is a box of even density, or has an inertia of its own about its center of mass.
    """

    name: str
    mass: float = Field(gt=0.0)
    motion: str
    size: tuple[float, float, float] | None = None
    inertia: tuple[float, float, float] | None = None
    mass_center: tuple[float, float, float] = (0.0, 0.0, 0.0)


class TogetherTable(Strict):
    """The table `[[together]]` of a study file: trials of several subjects that belong together."""

    name: str
    trials: dict[str, str] = Field(min_length=1)
    contacts: str
    measured: Measured | None = None
    object: list[ObjectTable] = Field(default_factory=list)


@shown
@dataclass(frozen=True, eq=False)
class Together:
    """Trials that are solved as one.

    Attributes
    ----------
    name : of the trial
    measured : what plates and sensors measured, None for nothing
    trials : name of each part, which is its subject's, to the name of its trial
    objects : tables of objects, each with the file of its motion: coordinates tx, ty, tz, rx, ry,
        rz
    contacts : file of sites and touches; names in it have their part's name before them
        (`tori_hand_r`)
    """

    name: str
    trials: Mapping[str, str]
    contacts: str
    measured: Measured | None = None
    objects: tuple[tuple[ObjectTable, Path], ...] = ()


def together_of(
    table: TogetherTable, trials: Sequence[TrialFiles], folder: Path, notes: Notes
) -> Together:
    """Read a table of a study file, its trials looked up among the study's.

    What is wrong is added to the notes.
    """
    where = f"together '{table.name}'"
    problems = notes.problems
    contacts = WordOrFile().located("contacts", table.contacts, Place(folder, where, notes))
    if len(table.trials) + len(table.object) < 2:
        problems.append(f"{where}: has one trial and no object: expected two parts or more")
    for subject, trial in table.trials.items():
        names_of_trials = [trial.name for trial in trials if trial.subject == subject]
        if not names_of_trials:
            subjects = tuple(dict.fromkeys(trial.subject for trial in trials))
            problems.append(
                f"{where}: no subject '{subject}': there are {listing(subject, subjects)}"
            )
        elif trial not in names_of_trials:
            problems.append(
                f"{where}: subject '{subject}' has no trial '{trial}': there are"
                f" {listing(trial, names_of_trials)}"
            )
    if table.name in {trial.subject for trial in trials}:
        problems.append(f"{where}: a subject has that name: give it another")
    objects = []
    names = list(table.trials)
    for description in table.object:
        if description.name in names:
            problems.append(
                f"{where}: two parts are named '{description.name}': give one of them another name"
            )
        names.append(description.name)
        try:
            object_model(description.model_dump())
        except BadData as error:
            problems.append(f"{where}: {error}")
        path = existing(
            folder, description.motion, f"{where}: motion of '{description.name}'", problems
        )
        objects.append((description, path or folder))
    return Together(
        name=table.name,
        trials=FrozenMap(dict(table.trials)),
        contacts=contacts,
        measured=table.measured,
        objects=tuple(objects),
    )


@dataclass(frozen=True, eq=False)
class Part:
    """One subject or object of what is solved together.

    Attributes
    ----------
    trial : its inputs
    recorded : its coordinates
    source : the file of its model or the table of an object
    made : key of what the coordinates were derived from, "" for those of a file, which is a source
        itself
    """

    trial: TrialInputs
    recorded: Motion
    source: str | dict[str, object]
    made: str = ""


def object_model(description: dict[str, Any]) -> Model:
    """Return the model of an object from its table as text."""
    table = ObjectTable.model_validate(description)
    return free_object(
        table.name, table.mass, table.size, inertia=table.inertia, mass_center=table.mass_center
    )


def object_part(table: ObjectTable, path: Path) -> Part:
    """Return an object of known inertia, moving as a file says."""
    description = table.model_dump()
    model = object_model(description)
    sources = (
        file_source("motion", path),
        value_source("object", table.name, sorted(description.items())),
    )
    return Part(
        TrialInputs(table.name, table.name, model, sources=sources),
        reading.read_motion(path, model),
        description,
    )


def join_trials(
    together: Together, parts: Mapping[str, Part], settings: Settings
) -> tuple[TrialInputs, Poses]:
    """One recording made of those of its parts, with their coordinates at common times."""
    for name, part in parts.items():
        if part.trial.get(RecordedTorques) is not None:
            raise BadData(
                f"'{together.name}': trial of '{name}' has torques of its own: parts that are"
                " solved together need loads"
            )
    models = {name: part.trial.model for name, part in parts.items()}
    motions, notes = on_one_clock({name: part.recorded for name, part in parts.items()})
    recorded = join_motions(motions)
    model = join_models(models, together.name)
    trials = [part.trial for part in parts.values()]
    contacts = None
    if together.contacts:
        contacts = read_contacts(together.contacts, model, together.measured)
    inputs = (
        _joined_external(parts, motions),
        _emg(parts),
        contacts,
        trials[0].get(Phases),
        _truth(parts),
        JoinedParts(FrozenMap({name: part.source for name, part in parts.items()})),
    )
    joined = TrialInputs(
        name=together.name,
        subject=" and ".join(parts),
        model=model,
        options=_joined_options(trials, settings),
        inputs=ByType.of(inputs),
        notes=_joined_notes(trials),
        sources=_joined_sources(together, parts),
        warnings=tuple(text for trial in trials for text in trial.warnings),
    )
    return joined, Poses(recorded, notes=notes)


def _joined_options(trials: Sequence[TrialInputs], settings: Settings) -> OptionSet:
    """Return options of the steps: those of the first trial, but for contacts and EMG.

    `settings`: of the whole study, whose options of contacts count; those of EMG are of the first
    trial with EMG.
    """
    kinds = {kind for step in (*STEPS["pair"], REPORT) for kind in step_head(step).options}
    contact_options = options_of({"tension": settings.get("tension", {})})[ContactOptions]
    emg_options = (
        trial.options.get(EmgOptions) for trial in trials if trial.get(RecordedEmg) is not None
    )
    return trials[0].options.only(*kinds).having(contact_options, next(emg_options, None))


def _joined_notes(trials: Sequence[TrialInputs]) -> TrialNotes:
    """Return the sentences of all trials, each once."""
    notes = [trial.notes for trial in trials]
    return TrialNotes(
        real=tuple(dict.fromkeys(text for each in notes for text in each.real)),
        assumed=tuple(dict.fromkeys(text for each in notes for text in each.assumed)),
        simulated=tuple(dict.fromkeys(text for each in notes for text in each.simulated)),
    )


def _joined_sources(together: Together, parts: Mapping[str, Part]) -> tuple[Source, ...]:
    """Return the sources of all parts; contacts are those of the whole."""
    of_trials = (source for part in parts.values() for source in part.trial.sources)
    coordinates = (
        value_source("coordinates", name, part.made) for name, part in parts.items() if part.made
    )
    return (
        *(source for source in of_trials if source.role != "contacts"),
        *coordinates,
        *contact_sources(ContactsFile(together.contacts, together.measured)),
    )


def _emg(parts: Mapping[str, Part]) -> RecordedEmg | None:
    """EMG of all parts that have any, at the times of the first, and its channels' muscles."""
    recorded = {
        name: emg
        for name, part in parts.items()
        if (emg := part.trial.get(RecordedEmg)) is not None
    }
    if not recorded:
        return None
    joined = _on_first_clock({name: whole.emg for name, whole in recorded.items()})
    channels = {
        f"{name}_{channel}": tuple(f"{name}_{muscle}" for muscle in muscles)
        for name, whole in recorded.items()
        for channel, muscles in whole.muscles.items()
    }
    return RecordedEmg(Emg(joined.time, joined.names, joined.values), FrozenMap(channels))


def _truth(parts: Mapping[str, Part]) -> KnownTruth | None:
    """Return what is known of all parts, where they were simulated."""
    known = {
        name: truth.series
        for name, part in parts.items()
        if (truth := part.trial.get(KnownTruth)) is not None
    }
    kinds = (
        set.intersection(*(set(series) for series in known.values()))
        if len(known) == len(parts)
        else set()
    )
    joined = {
        kind: _on_first_clock({name: series[kind] for name, series in known.items()})
        for kind in sorted(kinds)
    }
    return KnownTruth(FrozenMap(joined)) if joined else None


def _on_first_clock(series: Mapping[str, Series]) -> Series:
    """All columns at the times of the first, named by their parts."""
    time = next(iter(series.values())).time
    return join_series(
        {
            name: Series(
                time,
                part.names,
                np.array([np.interp(time, part.time, column) for column in part.values.T]).T,
            )
            for name, part in series.items()
        }
    )


def _joined_external(parts: Mapping[str, Part], motions: Mapping[str, Motion]) -> ExternalLoads:
    """External forces of all parts; a plate that several of them stand on is measured once."""

    def measured(recorded: Motion) -> PlateForces:
        loads = {name: part.trial.get(ExternalLoads) for name, part in parts.items()}
        found = {
            name: load.as_measured(motions[name])
            for name, load in loads.items()
            if load is not None
        }
        return _joined_plates(found, recorded)

    def on_bodies(unused: Wrenches, recorded: Motion) -> Wrenches:
        loads = {name: part.trial.get(ExternalLoads) for name, part in parts.items()}
        found = {name: load.of(motions[name]) for name, load in loads.items() if load is not None}
        return join_wrenches(_on_one_time(found)) if found else _nothing(recorded)

    return ExternalLoads(measured=measured, on_bodies=on_bodies)


def _joined_plates(parts: Mapping[str, PlateForces], recorded: Motion) -> PlateForces:
    """Plates of all parts; one with an outline that several parts have stands for itself once."""
    if not parts:
        return PlateForces(_nothing(recorded))
    common = _on_one_time({name: part.wrenches for name, part in parts.items()})
    joined = join_wrenches(common)
    plates = [(part, plate) for part in parts.values() for plate in part.wrenches.names]
    outlines: dict[str, Array] = {}
    names = list(joined.names)
    kept = []
    for column, (part, plate) in enumerate(plates):
        corners = part.outlines.get(plate)
        if plate in outlines and corners is not None:
            continue
        kept.append(column)
        if corners is not None:
            outlines[plate] = corners
            names[column] = plate
    wrenches = replace(joined, names=tuple(names)).columns(kept)
    return PlateForces(wrenches, FrozenMap(outlines))


def _on_one_time(wrenches: Mapping[str, Wrenches]) -> Mapping[str, Wrenches]:
    """Bring forces of parts to the times of the first, as far as all have them."""
    if not clock_difference(wrenches):
        return wrenches
    time = next(iter(wrenches.values())).time
    start = max(wrench.time[0] for wrench in wrenches.values())
    stop = min(wrench.time[-1] for wrench in wrenches.values())
    if stop <= start:
        raise BadData("external forces of " + " and ".join(wrenches) + " have no time in common")
    common = time[(time >= start) & (time <= stop)]
    return {name: resample_wrenches(wrench, common) for name, wrench in wrenches.items()}


def _nothing(recorded: Motion) -> Wrenches:
    """No force, at the times of a motion."""
    nothing = np.zeros((len(recorded), 0, 3))
    return Wrenches(
        time=recorded.time, names=(), bodies=(), forces=nothing, points=nothing, torques=nothing
    )

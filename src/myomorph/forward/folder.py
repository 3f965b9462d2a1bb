"""Simulations as folders: tables that OpenSim opens, a result file, a page, and back."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import written
from myomorph.core.io.sto import write_sto
from myomorph.core.model.messages import messages_of
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Series
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.forward.changes import Changes
from myomorph.forward.page import simulation_page
from myomorph.forward.page_run import PageRun
from myomorph.forward.quantities import ELASTIC_FIBER_LENGTH, ENERGY, FEEDBACK_FORCE
from myomorph.forward.shown import ShownRun
from myomorph.forward.side_by_side import side_by_side
from myomorph.lab.report.page.parts import Note, PageHead
from myomorph.lab.report.trial.report_input import Dynamics, Kinematics, Recorded, ReportInput
from myomorph.lab.store import stored as store
from myomorph.lab.store.quantities import put_quantity, put_value
from myomorph.lab.store.quantity_files import quantity_table, write_series
from myomorph.lab.store.results import REMARKS, Stored, new_result, read_result
from myomorph.lab.study.trial.reporting import (
    REPORT,
    model_of,
    reduced_for_pictures,
    surfaces_of,
)

STEP = "simulate"
RESULT = "simulation.nc"
COORDINATES = "coordinates.mot"
CHANGES = "changes"
FACTS = "facts"
UNCHANGED = "unchanged"
CHANGED = "changed"


def write_run(run: PageRun, folder: Path, provenance: Provenance, changes: Changes) -> None:
    """Write a run: coordinates.mot, tables of muscles, energy and feedback, and the result file.

    Parameters
    ----------
    run : to write
    folder : that exists
    provenance : what it was made from
    changes : of the model in the file
    """
    model = run.shown.model
    write_sto(quantity_table(run.motion, model), folder / COORDINATES)
    for table in run.tables:
        write_series(folder, table)
    with new_result(folder / RESULT, STEP) as writer:
        store.put_motion(writer, run.motion, model)
        for table in run.tables:
            assert table.known is not None
            put_quantity(writer, table.known, table.values, table.labels())
        if run.shown.wrenches is not None:
            put_value(writer, run.shown.wrenches)
        writer.provenance(provenance)
        writer.remarks(STEP, run.notes)
        writer.fact(CHANGES, changes.to_json())
        writer.fact(FACTS, json.dumps(run.facts))


def read_run(path: Path) -> PageRun:
    """Read what `write_run` wrote; raises `BadFile` where the model is gone."""
    stored = read_result(path)
    changes = Changes.from_json(stored.facts[CHANGES])
    model = changes.applied(model_of(stored))
    name = path.parent.name
    return PageRun(
        shown=ShownRun(
            name=name if name in (UNCHANGED, CHANGED) else "simulation",
            model=model,
            motion=store.get_motion(stored),
            activations=_series(stored, ACTIVATION),
            wrenches=store.get_wrenches(stored),
        ),
        forces=_series(stored, MUSCLE_FORCE),
        energy=_series(stored, ENERGY),
        feedback=_series(stored, FEEDBACK_FORCE),
        fibers=_series(stored, ELASTIC_FIBER_LENGTH),
        notes=messages_of(stored.facts.get(REMARKS + STEP, "[]")),
        facts=tuple((name, text) for name, text in json.loads(stored.facts[FACTS])),
    )


def _series(stored: Stored, quantity: Quantity) -> Series:
    """Read a quantity; without columns where the result has none."""
    series = store.get_series(stored, quantity)
    if series is not None:
        return series
    nothing = np.zeros((len(stored.time), 0))
    return Series(time=stored.time, names=(), values=nothing, quantity=quantity)


def together(runs: Sequence[PageRun]) -> ShownRun:
    """Put the bodies of one or two runs side by side."""
    first = runs[0].shown
    return first if len(runs) == 1 else side_by_side(first, runs[1].shown)


def write_page(
    folder: Path, title: str, runs: Sequence[PageRun], made: Provenance, sentence: str
) -> Path:
    """Write report.html of one run, or of two.

    Parameters
    ----------
    folder : that exists
    title : of the page
    runs : that it shows
    made : what they were made from
    sentence : what is simulated, for the head
    """
    notes = dict.fromkeys(note for run in runs for note in run.notes)
    head = PageHead.of(title, made, (Note("simulated", sentence),), tuple(notes))
    surfaces = reduced_for_pictures(surfaces_of(runs[0].shown.model))
    text = simulation_page(head, runs, together(runs), surfaces)
    with written(folder / REPORT) as stream:
        stream.write(text)
    return folder / REPORT


def result_paths(folder: Path) -> list[Path]:
    """List the results of a folder: that of its run, or of the unchanged and the changed model."""
    places = (folder / RESULT, folder / UNCHANGED / RESULT, folder / CHANGED / RESULT)
    return [place for place in places if place.is_file()]


def sentence_of(changes: Changes) -> str:
    """Say what a page shows."""
    if not changes:
        return "The motion is simulated: forward dynamics of the model."
    return (
        "Both motions are simulated: forward dynamics of the model as it is, and with"
        f" {changes.sentence}."
    )


def remake_report(folder: Path) -> Path:
    """Make the page of a folder again."""
    paths = result_paths(folder)
    runs = [read_run(path) for path in paths]
    stored = read_result(paths[-1])
    changes = Changes.from_json(stored.facts[CHANGES])
    made = stored.provenance[STEP]
    return write_page(folder, runs[0].shown.model.name, runs, made, sentence_of(changes))


def simulations_of(folder: Path) -> Mapping[str, Callable[[], ReportInput]]:
    """Find the runs of a folder by name, both side by side first where there are two."""
    paths = result_paths(folder)
    if len(paths) == 1:
        return {folder.name: partial(_opened, paths)}
    names = [path.parent.name for path in paths]
    single = {name: partial(_opened, [path]) for name, path in zip(names, paths, strict=True)}
    return {" and ".join(names): partial(_opened, paths)} | single


def _opened(paths: Sequence[Path]) -> ReportInput:
    """Read runs as a page plays them."""
    runs = [read_run(path) for path in paths]
    shown = together(runs)
    notes = dict.fromkeys(note for run in runs for note in run.notes)
    return ReportInput(
        head=PageHead(shown.name, warnings=tuple(notes)),
        model=shown.model,
        surfaces=reduced_for_pictures(surfaces_of(runs[0].shown.model)),
        recorded=Recorded(subject=shown.model.name),
        kinematics=Kinematics(coordinates=shown.motion),
        dynamics=Dynamics(wrenches=shown.wrenches),
        tension=_as_tension(shown, runs),
    )


def _as_tension(shown: ShownRun, runs: Sequence[PageRun]) -> Tension | None:
    """Activations and forces as pages color muscles by them; None without muscles."""
    muscles = shown.activations.names
    if not muscles:
        return None
    time = shown.motion.time
    frames = len(time)
    return Tension(
        options=TensionOptions(),
        time=time,
        muscles=muscles,
        activation=shown.activations.values,
        muscle_force=np.hstack([run.forces.values for run in runs]),
        reserve_names=(),
        actuator_force=np.zeros((frames, 0)),
        coordinates=(),
        balanced_torque=np.zeros((frames, 0)),
        equilibrium_residual=np.zeros(frames),
        status=np.zeros(frames, np.int64),
        iterations=np.zeros(frames, np.int64),
        activation_lower=np.zeros(len(muscles)),
        activation_upper=np.ones(len(muscles)),
        overstretched=(),
    )

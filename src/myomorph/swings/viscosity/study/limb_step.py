"""The step of a study that is done once for a relaxed limb.

It leads from its drops to damping, stiffness and rest angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.mjcf.couplings import write_dampers
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_source, provenance_of
from myomorph.lab.store.settings import plain_settings
from myomorph.lab.study.inputs.reading import has_mass, open_model
from myomorph.lab.study.step.folder_steps import FolderOutput, ScopeInputs
from myomorph.lab.study.step.step import Step
from myomorph.swings.viscosity.relaxed.drops import SILENT, SILENT_UNKNOWN, Drop
from myomorph.swings.viscosity.relaxed.identify import (
    LimbOptions,
    LimbResult,
    Missed,
    identify_limb,
)
from myomorph.swings.viscosity.report.limb_report import limb_report
from myomorph.swings.viscosity.report.specimen_report import LimbReport
from myomorph.swings.viscosity.study.limb_files import LimbFiles, limb_body, open_drops
from myomorph.swings.viscosity.study.results import read_value, write_value

LIMB = "limb.json"
IDENTIFIED = "identified"


@dataclass(frozen=True)
class LimbInputs(ScopeInputs):
    """One limb and the options of its identification."""

    files: LimbFiles
    options: LimbOptions


def limb_provenance(limb: LimbInputs) -> Provenance:
    """List what the result of a limb is derived from; its truth changes nothing."""
    files = limb.files
    sources = [file_source("model", files.model)]
    for drop in files.drops:
        sources += [
            file_source("drop", drop.recording),
            *([file_source("emg", drop.emg)] if drop.emg else []),
        ]
    known: dict[str, object] = {"coordinate": files.coordinate, "muscles": files.muscles}
    known["drops"] = tuple((drop.name, drop.time) for drop in files.drops)
    return provenance_of("relaxed", sources, known | plain_settings(limb.options))


def read_limb(home: Path) -> LimbReport:
    """Read what is shown of a limb, from the folder of its results."""
    return read_value(home / LIMB, LimbReport)


def study_limb(files: LimbFiles, options: LimbOptions) -> tuple[LimbResult, list[str]]:
    """Identify a limb from its files.

    Parameters
    ----------
    files : of the limb
    options : errors of the model

    Returns
    -------
    what its swings show, and notes, the first on the silence of its muscles

    Raises
    ------
    BadData, BadModel, UnknownName
        where the model cannot swing so, or no drop is left
    """
    model = open_model(files.model)
    _check_model(model, files)
    notes = [_silence(files)]
    drops: list[Drop] = []
    with progress(f"limb {files.name}", len(files.drops) + 1, "recordings") as advance:
        for recording in files.drops:
            opened = open_drops(recording, model, files, options.cutoff)
            drops = drops + opened.drops
            notes = notes + opened.notes
            advance(1)
        if not drops:
            raise BadData(
                "; ".join(("no drop is left: record others, the person relaxed", *notes[1:]))
            )
        body = limb_body(model, files.coordinate, drops[0].equation)
        result = identify_limb(drops, body, options)
        advance(1)
    missed = sorted(result.missed, key=lambda missed: (missed.drop, missed.half))
    return result, [*notes, *(_missed_note(each) for each in missed)]


def _check_model(model: Model, files: LimbFiles) -> None:
    """Refuse a model whose coordinate cannot swing."""
    has_mass(model, "a relaxed limb")
    swinging = [
        name
        for joint in model.joints
        for name in joint.coordinates
        if name not in model.dependent_coordinates
    ]
    check_name("coordinate", files.coordinate, swinging, f"the model '{files.model.name}'")
    if model.coordinate(files.coordinate).motion != "rotational":
        raise BadData(
            f"'{files.coordinate}' of '{files.model.name}' is no angle: name that of the joint that"
            " swings"
        )
    if model.loops:
        raise BadData(
            f"'{files.model.name}' has {len(model.loops)} closed loops, whose forces no swing"
            " shows: open them"
        )


def _silence(files: LimbFiles) -> str:
    """Say whether the silence of muscles is known, of which drops."""
    unknown = [drop.name for drop in files.drops if drop.emg is None]
    if len(unknown) == len(files.drops):
        return SILENT_UNKNOWN
    return SILENT + (f", but of {', '.join(unknown)} {SILENT_UNKNOWN}" if unknown else "")


def _missed_note(missed: Missed) -> str:
    """Say what constant coefficients do not explain of a half swing."""
    short, whole = np.rad2deg([missed.short, missed.excursion])
    way = "short of" if short > 0.0 else "beyond"
    cause = (
        " (a stretch reflex, short-range stiffness, or help by the person)" if short > 0.0 else ""
    )
    return (
        f"{missed.drop}: half swing {missed.half + 1} ({missed.time[0]:.2f} to"
        f" {missed.time[1]:.2f} s, {whole:.0f} degrees) ends {abs(short):.1f} degrees {way}"
        f" what constant coefficients predict{cause}; it is left out"
    )


def write_model(files: LimbFiles, result: LimbResult, folder: Path) -> list[str]:
    """Write the model with the coordinate's spring and damper; return what it cannot express."""
    d, k, s, c = result.fit.law.coefficients[:4]
    name = files.coordinate
    model = open_model(files.model)
    path = folder / f"{IDENTIFIED}{files.model.suffix.lower()}"
    lost = [f"{path.name}: the dry friction is not in it"] if c > 0.0 else []
    others = [torque.name for torque in model.passive_torques if torque.coordinate == name]
    others += ["passive forces of its muscles"] if model.muscles else []
    if others:
        lost.append(
            f"{path.name}: {', '.join(others)}, which the identified torque contains, act besides"
            " it: remove one"
        )
    if path.suffix == ".xml":
        write_dampers(
            files.model,
            path,
            {name: float(d)},
            springs={name: (float(k), float(s / k))} if k > 0.0 else {},
        )
        return lost
    stiffness, rest = ({name: float(k)}, {name: float(s / k)}) if k > 0.0 else ({}, {})
    made = with_passive_dynamics(model, {name: float(d)}, stiffness, rest)
    return [*lost, *(f"{path.name}: {line}" for line in write_osim(made, path))]


def _run(limb: LimbInputs, output: FolderOutput) -> LimbReport:
    result, notes = study_limb(limb.files, limb.options)
    with output.whole() as folder:
        notes += write_model(limb.files, result, folder)
        report = limb_report(limb.files.name, limb.files.coordinate, result, notes)
        write_value(report, folder / LIMB)
    return report


STEP = Step(
    name="relaxed",
    title="passive torque of a relaxed limb",
    scope="limb",
    options=(LimbOptions,),
    leaves=FrozenMap({"report": LIMB}),
    run=_run,
    made_from=limb_provenance,
)

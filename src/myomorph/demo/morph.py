"""`demo --study morph`: the muscles of a leg carried into bones whose deformation is known, and how far they miss.

The bones are the left ones of `myo-sim`, mirrored to the right and deformed by one smooth field; nobody was scanned.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.morph.checks.checks import PARTS, check_morph
from myomorph.morph.checks.moment_arms import COUNT
from myomorph.morph.transfer.model import morph_model
from myomorph.report.page.parts import Note
from myomorph.simulate.deformed_leg import (
    AMPLITUDE,
    LANDMARKS,
    PICKED,
    STRETCH,
    BodyTruth,
    demo_case,
    picked_landmarks,
)
from myomorph.simulate.morph_errors import MorphErrors, error_section, morph_errors
from myomorph.store.progress import progress
from myomorph.store.results import provenance_of, value_source
from myomorph.study.subject.morphing import Morphed, MorphSettings, map_bones, tables_folder, write_morphed

RESULT = "leg.osim"
ERRORS = "errors.csv"


@dataclass(frozen=True, eq=False)
class MorphDemo:
    """What the demo found.

    Attributes
    ----------
    morphed : the leg in the deformed bones
    truth : by body
    errors : against the truth
    report : path of the page
    """

    morphed: Morphed
    truth: Mapping[str, BodyTruth]
    errors: MorphErrors
    report: Path


def run_morph_demo(out: Path) -> MorphDemo:
    """Carry the leg's muscles into the deformed bones and write the model, its errors, bones, tables and a report.

    Parameters
    ----------
    out : folder, made where it does not exist

    Raises
    ------
    BadData : `myo-sim` is not installed
    """
    from myomorph.report.morph.morph_page import morph_page
    from myomorph.study.trial.reporting import REPORT

    out.mkdir(parents=True, exist_ok=True)
    model, ours, theirs, truth = demo_case()
    pairs = picked_landmarks(ours, truth)
    settings = MorphSettings()
    bones = map_bones(model, ours, theirs, pairs, settings)
    with progress("muscles", 2 * (COUNT + 1), "postures") as advance:
        morph = morph_model(model, bones, settings.morph, name="leg in deformed bones", progress=advance)
    with progress("checks", PARTS, "parts") as advance:
        checks = check_morph(morph, progress=advance)
    source = value_source("model", "demo:morph", *(point.source for point in morph.points))
    morphed = Morphed(morph, checks, provenance_of("morph", (source,), settings.plain()), ())
    errors = morph_errors(morph, truth, pairs)
    page = morph_page(
        morph,
        checks,
        morphed.provenance,
        title="A leg in deformed bones",
        notes=_notes(),
        further=(error_section(errors),),
    )
    write_morphed(morphed, out / RESULT, page=page)
    _write_errors(errors, out / ERRORS)
    return MorphDemo(morphed, truth, errors, tables_folder(out / RESULT) / REPORT)


def _notes() -> tuple[Note, ...]:
    return (
        Note(
            "simulated",
            "The target's bones are synthetic: the left bones of myo-sim mirrored to the right, stretched by "
            f"{', '.join(f'{factor:g}' for factor in STRETCH)} along the axes of the ground and bent by three waves of "
            f"{1e3 * AMPLITUDE:g} mm. Where every muscle point truly is follows from that field.",
        ),
        Note(
            "simulated",
            f"{LANDMARKS} landmarks a bone, picked in the target with a standard deviation of {1e3 * PICKED:g} mm an "
            "axis; the target's triangles are not the source's.",
        ),
    )


def _write_errors(errors: MorphErrors, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(("muscle", "point", "body", *(f"{name} [m]" for name in errors.distances)))
        for i, names in enumerate(errors.points):
            writer.writerow((*names, *(f"{one[i]:.6g}" for one in errors.distances.values())))


def summary(found: MorphDemo) -> list[str]:
    """What the command says: errors by method, and how many warnings."""
    lines = [f"error of {len(found.errors.points)} muscle points against the known deformation, median and worst [mm]:"]
    lines += [
        f"  {name:<24} {1e3 * float(np.median(one)):5.1f} {1e3 * float(one.max()):5.1f}"
        for name, one in found.errors.distances.items()
    ]
    return [*lines, f"{len(found.morphed.checks.warnings)} warnings of the checks stand first in the report"]

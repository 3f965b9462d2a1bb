"""All comparisons of accuracy, written as docs/validation.md: `python -m benchmarks validation`.

`python -m benchmarks.validation SECTION ...` measures some sections anew and keeps the tables of the others.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from types import CodeType
from typing import TypeAlias

from benchmarks import fuzz
from benchmarks.accuracy import (
    analyses as accuracy_analyses,
)
from benchmarks.accuracy import (
    calibration as accuracy_calibration,
)
from benchmarks.accuracy import (
    certificates as accuracy_certificates,
)
from benchmarks.accuracy import (
    conditions as accuracy_conditions,
)
from benchmarks.accuracy import (
    emg as accuracy_emg,
)
from benchmarks.accuracy import (
    groups as accuracy_groups,
)
from benchmarks.accuracy import (
    hands as accuracy_hands,
)
from benchmarks.accuracy import (
    hidden_plates as accuracy_hidden_plates,
)
from benchmarks.accuracy import (
    identification as accuracy_identification,
)
from benchmarks.accuracy import (
    interrupted as accuracy_interrupted,
)
from benchmarks.accuracy import (
    kernels as accuracy_kernels,
)
from benchmarks.accuracy import (
    kinematics as accuracy_kinematics,
)
from benchmarks.accuracy import (
    live as accuracy_live,
)
from benchmarks.accuracy import (
    loop_forces as accuracy_loop_forces,
)
from benchmarks.accuracy import (
    loops as accuracy_loops,
)
from benchmarks.accuracy import (
    masspoints as accuracy_masspoints,
)
from benchmarks.accuracy import (
    models as accuracy_models,
)
from benchmarks.accuracy import (
    mouse as accuracy_mouse,
)
from benchmarks.accuracy import (
    muscles as accuracy_muscles,
)
from benchmarks.accuracy import (
    pair as accuracy_pair,
)
from benchmarks.accuracy import (
    passive as accuracy_passive,
)
from benchmarks.accuracy import (
    reaction as accuracy_reaction,
)
from benchmarks.accuracy import (
    regressor as accuracy_regressor,
)
from benchmarks.accuracy import (
    scale as accuracy_scale,
)
from benchmarks.accuracy import (
    setups as accuracy_setups,
)
from benchmarks.accuracy import (
    shape as accuracy_shape,
)
from benchmarks.accuracy import (
    simulated as accuracy_simulated,
)
from benchmarks.accuracy import (
    sound as accuracy_sound,
)
from benchmarks.accuracy import (
    stairs as accuracy_stairs,
)
from benchmarks.accuracy import (
    strides as accuracy_strides,
)
from benchmarks.accuracy import (
    tension as accuracy_tension,
)
from benchmarks.accuracy import (
    transfer as accuracy_transfer,
)
from benchmarks.accuracy.morph import (
    articular as accuracy_articular,
)
from benchmarks.accuracy.morph import (
    demo as accuracy_morph_demo,
)
from benchmarks.accuracy.morph import (
    laws as accuracy_morph_laws,
)
from benchmarks.accuracy.morph import (
    masses as accuracy_morph_masses,
)
from benchmarks.accuracy.morph import (
    mirror as accuracy_mirror,
)
from benchmarks.accuracy.morph import (
    real_bones as accuracy_real_bones,
)
from benchmarks.accuracy.morph import (
    shapes as accuracy_morph_shapes,
)
from benchmarks.accuracy.morph import (
    species as accuracy_species,
)
from benchmarks.accuracy.morph import (
    species_arm as accuracy_species_arm,
)
from benchmarks.accuracy.viscosity import (
    calibrations as accuracy_calibrations,
)
from benchmarks.accuracy.viscosity import (
    cohort as accuracy_cohort,
)
from benchmarks.accuracy.viscosity import (
    pendulum as accuracy_pendulum,
)
from benchmarks.accuracy.viscosity import (
    steps as accuracy_steps,
)
from benchmarks.accuracy.viscosity import (
    tracking as accuracy_tracking,
)
from benchmarks.accuracy.viscosity import (
    trust as accuracy_trust,
)
from benchmarks.accuracy.viscosity import (
    virtual as accuracy_virtual,
)
from benchmarks.cases import FORCE_CASES, MARKER_CASES, data_folder

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "validation.md"
TEXT = Path(__file__).resolve().parent / "validation_text"

Row = dict[str, object]


def run(keep: Path | None = None) -> list[Row]:
    """Measure every section, write the document, and return all rows.

    Sections of one module share what they simulate, so they run in one process; modules run side by side.

    Parameters
    ----------
    keep : file for the rows found so far, as JSON by section
    """
    names = list(sections())
    found = _found(names, keep)
    DOCUMENT.write_text(_document({name: as_table(found[name]) for name in names}))
    return [{"section": name, **row} for name in names for row in found[name]]


def renew(names: list[str]) -> None:
    """Measure these sections and write the document with the tables that it has of the others."""
    found = _found(names, None)
    DOCUMENT.write_text(_document(tables_of(DOCUMENT.read_text()) | {name: as_table(found[name]) for name in names}))


def tables_of(document: str) -> dict[str, str]:
    """The table of every section that a document has."""
    lines = document.splitlines()
    headings = {(TEXT / f"{name}.md").read_text().splitlines()[0]: name for name in sections()}
    starts = [i for i, line in enumerate(lines) if line in headings]
    found = {}
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        table = [line for line in lines[start:end] if line.startswith(("|", "(nothing measured"))]
        found[headings[lines[start]]] = "\n".join(table) + "\n"
    return found


def _document(tables: dict[str, str]) -> str:
    text = (TEXT / "head.md").read_text()
    # A section that was never measured has no table yet.
    for name in (one for one in sections() if one in tables):
        text += "\n" + (TEXT / f"{name}.md").read_text() + "\n" + tables[name]
    return text


def _found(names: list[str], keep: Path | None) -> dict[str, list[Row]]:
    """Rows of some sections, by their names."""
    by_module: dict[str, list[str]] = {}
    for name in names:
        by_module.setdefault(_module(sections()[name]), []).append(name)
    found: dict[str, list[Row]] = {}
    failed: list[str] = []
    # Each in a fresh process: OpenSim's module and ezc3d's do not get on.
    with ProcessPoolExecutor(mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        waiting = {pool.submit(measured, part): part for part in by_module.values()}
        for done in as_completed(waiting):
            if error := done.exception():
                failed.append(f"{', '.join(waiting[done])}: {error!r}")
                continue
            part, seconds = done.result()
            found |= part
            print(f"{len(found)} of {len(names)} sections; {', '.join(part)}: {seconds:.0f} s", flush=True)
            if keep is not None:
                keep.write_text(json.dumps(found, default=float))
    if failed:
        raise RuntimeError("; ".join(failed))
    return found


def measured(names: list[str]) -> tuple[dict[str, list[Row]], float]:
    """Rows of some sections by their names, and how long they took [s]."""
    started = time.monotonic()
    known = sections()
    return {name: list(known[name]()) for name in names}, time.monotonic() - started


def _module(measure: Callable[[], Iterable[Row]]) -> str:
    """The module whose function a section calls."""
    inside = [one for one in measure.__code__.co_consts if isinstance(one, CodeType)]
    names = [name for code in (measure.__code__, *inside) for name in code.co_names]
    return next((name for name in names if name.startswith("accuracy_")), measure.__module__.split(".")[-1])


Sections: TypeAlias = dict[str, Callable[[], Iterable[Row]]]


def sections() -> Sections:
    """What is measured, by the name of its text, in the order of the document."""
    folder = data_folder()
    parts = (_of_models, _of_lengths, _of_masses, _of_limbs, _of_contacts, _of_morphing, _of_animals, _of_studies)
    return {name: measure for part in parts for name, measure in part(folder).items()}


def _of_models(folder: Path) -> Sections:
    """Models, kernels, and the steps from markers to muscle tensions; joint reactions, EMG, sound and hands."""
    return {
        "models": lambda: accuracy_models.measure(folder),
        "kernels": accuracy_kernels.measure,
        "curved_knees": lambda: accuracy_kernels.measure_curved_knee(folder),
        "inverse_kinematics": lambda: (
            accuracy_kinematics.measure_inverse_kinematics(folder, case) for case in MARKER_CASES
        ),
        "loops": lambda: accuracy_loops.measure_constraints(folder),
        "loops_trees": accuracy_loops.measure_trees,
        "loops_inverse_kinematics": lambda: accuracy_loops.measure_inverse_kinematics(folder),
        "inverse_dynamics": lambda: (
            accuracy_kinematics.measure_inverse_dynamics(folder, case) for case in FORCE_CASES
        ),
        "muscles": lambda: accuracy_muscles.measure(folder),
        "tendons": accuracy_kernels.measure_tendons,
        "tension": lambda: accuracy_tension.measure(folder),
        "live": lambda: accuracy_live.measure(folder),
        "live_markers": lambda: accuracy_live.measure_losses(folder),
        "loop_arms": lambda: accuracy_loop_forces.measure_arms(folder),
        "loop_torques": lambda: accuracy_loop_forces.measure_torques(folder),
        "loop_static": lambda: accuracy_loop_forces.measure_static(folder),
        "reaction": lambda: accuracy_reaction.measure_same(folder),
        "reaction_tensions": lambda: accuracy_reaction.measure_tensions(folder),
        "reaction_loads": lambda: accuracy_reaction.measure_loads(folder),
        "emg_held_out": lambda: accuracy_emg.measure_held_out(folder),
        "emg_channels": lambda: accuracy_emg.measure_channels(folder),
        "emg_calibration": lambda: accuracy_emg.measure_calibration(folder),
        "emg_study": lambda: accuracy_emg.measure_study(folder),
        "emg_envelopes": lambda: accuracy_emg.measure_envelopes(folder),
        "sound": accuracy_sound.measure,
        "sound_motion": accuracy_sound.measure_motion,
        "hands_lift": lambda: accuracy_hands.measure_lift(folder),
        "hands_lift_open": lambda: accuracy_hands.measure_lift_open(folder),
        "hands_spine": lambda: accuracy_hands.measure_spine(folder),
        "hands_spine_point": lambda: accuracy_hands.measure_spine_point(folder),
        "hands_rim": lambda: accuracy_hands.measure_rim(folder),
        "hands_rim_directions": lambda: accuracy_hands.measure_rim_directions(folder),
        "hands_seat": lambda: accuracy_hands.measure_seat(folder),
        "hands_seat_open": lambda: accuracy_hands.measure_seat_open(folder),
        "hands_seat_times": lambda: accuracy_hands.measure_seat_times(folder),
    }


def _of_lengths(folder: Path) -> Sections:
    """Passive forces, lengths and marker positions."""
    return {
        "passive": lambda: accuracy_passive.measure(folder),
        "passive_muscles": lambda: accuracy_passive.measure_muscles(folder),
        "passive_forms": lambda: accuracy_passive.measure_forms(folder),
        "calibration": lambda: accuracy_calibration.measure(folder),
        "calibration_lengths": lambda: accuracy_calibration.measure_lengths(folder),
        "scale": lambda: accuracy_scale.measure(folder),
        "tools": lambda: accuracy_scale.measure_tools(folder),
        "setups": lambda: accuracy_setups.measure_setups(folder),
        "analyses": lambda: accuracy_analyses.measure(folder),
        "transfer": lambda: accuracy_transfer.measure(folder),
    }


def _of_masses(folder: Path) -> Sections:
    """Masses and inertias."""
    return {
        "regressor": lambda: accuracy_regressor.measure_regressor(folder),
        "base_parameters": lambda: accuracy_regressor.measure_base_parameters(folder),
        "figaroh": accuracy_regressor.measure_figaroh,
        "sequential": lambda: accuracy_regressor.measure_sequential(folder),
        "deviations": lambda: accuracy_regressor.measure_deviations(folder),
        "masspoints": accuracy_masspoints.measure_solvers,
        "masspoints_grid": accuracy_masspoints.measure_grid,
        "weight_maps": lambda: accuracy_masspoints.measure_maps(folder),
        "shape_people": accuracy_shape.measure_people,
        "shape_segments": accuracy_shape.measure_segments,
        "shape_poses": lambda: accuracy_shape.measure_poses(folder),
        "simulated": lambda: accuracy_simulated.measure(folder),
        "identification": lambda: accuracy_identification.measure(folder),
        "identification_prototype": lambda: accuracy_identification.measure_prototype(folder),
        "identification_segments": lambda: accuracy_identification.measure_segments(folder),
    }


def _of_limbs(folder: Path) -> Sections:
    """Plates, clocks, scans and the viscosity of a limb."""
    return {
        "plates": accuracy_calibrations.measure_plates,
        "plates_standing": lambda: accuracy_calibrations.measure_standing(folder),
        "clocks": accuracy_calibrations.measure_clocks,
        "scans": lambda: accuracy_calibrations.measure_scans(folder),
        "scans_persons": lambda: accuracy_calibrations.measure_persons(folder),
        "handle": lambda: accuracy_calibrations.measure_handle(folder),
        "tracking_noise": accuracy_tracking.measure_noise,
        "tracking_faults": accuracy_tracking.measure_faults,
        "viscosity_methods": accuracy_steps.measure,
        "passive_laws": accuracy_trust.measure_laws,
        "trust_specimens": accuracy_trust.measure_specimens,
        "trust_attachments": accuracy_trust.measure_attachments,
        "pendulum_inertias": lambda: accuracy_pendulum.measure_inertias(folder / "pendulum-swing-inertia"),
        "pendulum_damping": lambda: accuracy_pendulum.measure_decay(folder / "pendulum-swing-inertia"),
        "pendulum_period": lambda: accuracy_pendulum.measure_periods(folder / "pendulum-swing-inertia"),
        "cohort": accuracy_cohort.measure,
        "virtual_joints": accuracy_virtual.measure_joints,
        "virtual_cohort": accuracy_virtual.measure_cohort,
        "virtual_muscles": accuracy_virtual.measure_muscles,
    }


def _of_morphing(folder: Path) -> Sections:
    """Muscles carried to other bones."""
    return {
        "articular_made": accuracy_articular.measure_made,
        "articular_centers": lambda: accuracy_articular.measure_centers(folder),
        "articular_persons": accuracy_articular.measure_persons,
        "landmarks_found": accuracy_articular.measure_landmarks,
        "morph_laws": lambda: accuracy_morph_laws.measure(folder),
        "morph_shapes": accuracy_morph_shapes.measure,
        "morph_shapes_bones": accuracy_morph_shapes.measure_bones,
        "morph_shapes_beside": accuracy_morph_shapes.measure_beside,
        "morph_demo": accuracy_morph_demo.measure,
        "morph_demo_joints": accuracy_morph_demo.measure_joints,
        "real_bones": lambda: accuracy_real_bones.measure(folder),
        "real_bones_arms": lambda: accuracy_real_bones.measure_arms(folder),
        "real_bones_depths": lambda: accuracy_real_bones.measure_depths(folder),
        "real_bones_pairs": lambda: accuracy_real_bones.measure_pairs(folder),
        "morph_masses": lambda: accuracy_morph_masses.measure(folder),
        "species": lambda: accuracy_species.measure(folder),
        "species_muscles": lambda: accuracy_species.measure_muscles(folder),
        "species_arms": lambda: accuracy_species.measure_arms(folder),
        "species_alignment": lambda: accuracy_species.measure_alignment(folder),
        "species_arm": lambda: accuracy_species_arm.measure(folder),
        "mirror": lambda: accuracy_mirror.measure(folder),
    }


def _of_animals(folder: Path) -> Sections:
    """Strides, mice through every step, steps that measure force, and groups of animals."""
    return {
        "strides": lambda: accuracy_strides.measure(folder),
        "strides_mouse": lambda: accuracy_strides.measure_mouse(folder),
        "mouse_markers": lambda: accuracy_mouse.measure_markers(folder),
        "mouse_keypoints": lambda: accuracy_mouse.measure_keypoints(folder),
        "mouse_strides": lambda: accuracy_mouse.measure_strides(folder),
        "mouse_lengths": lambda: accuracy_mouse.measure_lengths(folder),
        "mouse_plate": lambda: accuracy_mouse.measure_plate(folder),
        "mouse_masses": lambda: accuracy_mouse.measure_masses(folder),
        "stairs": lambda: accuracy_stairs.measure(folder),
        "groups_false": accuracy_groups.measure_false,
        "groups_power": accuracy_groups.measure_power,
        "conditions_within": accuracy_conditions.measure_within,
        "outliers": accuracy_conditions.measure_outliers,
    }


def _of_studies(folder: Path) -> Sections:
    """Whole studies: what is left when they are interrupted, and what readers make of wrong files."""
    return {"interrupted": accuracy_interrupted.measure, "wrong_files": fuzz.run}


def _of_contacts(folder: Path) -> Sections:
    """Contact forces, of one body and of two, and what the data leave open."""
    return {
        "hidden_plates": lambda: accuracy_hidden_plates.measure(folder),
        "hidden_plates_parts": lambda: accuracy_hidden_plates.measure_parts(folder),
        "hidden_plates_partial": lambda: accuracy_hidden_plates.measure_partial(folder),
        "pair_bouts": accuracy_pair.measure_bouts,
        "pair": accuracy_pair.measure,
        "pair_open": accuracy_pair.measure_open,
        "pair_truths": accuracy_pair.measure_truths,
        "pair_compliance": accuracy_pair.measure_compliance,
        "certificates_truth": accuracy_certificates.measure_truth,
        "certificates": lambda: accuracy_certificates.measure(folder),
        "certificates_programs": lambda: accuracy_certificates.measure_programs(folder),
        "certificates_faults": lambda: accuracy_certificates.measure_faults(folder),
    }


def as_table(rows: list[Row]) -> str:
    """Rows as a Markdown table; the columns are the keys of the first."""
    if not rows:
        return "(nothing measured: the data collection is absent)\n"
    keys = list(rows[0])
    lines = ["| " + " | ".join(keys) + " |", "| " + " | ".join("---" for _ in keys) + " |"]
    lines += ["| " + " | ".join(_cell(row.get(key, "")) for key in keys) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return json.dumps(value) if isinstance(value, dict) else str(value).replace("|", "/")


if __name__ == "__main__":
    renew(sys.argv[1:])

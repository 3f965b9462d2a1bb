"""A subject's lengths, markers, masses and motions for a model with more joints: `myomorph
transfer` and the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.body.identify.carry import CarriedMotion, carry_motion
from myomorph.body.identify.transfer import Transfer, transfer
from myomorph.body.identify.transfer_options import TransferOptions
from myomorph.core.io.sto import table_from_motion, write_sto
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.results import file_name, file_sources, provenance_of
from myomorph.lab.store.settings import plain_settings, with_settings
from myomorph.lab.study.inputs.reading import about, open_model, read_motion
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.subject_files import SubjectInputs, recordings_provenance
from myomorph.lab.study.subject.subjects import Made, write_made_model, write_rows
from myomorph.lab.study.trial.steps.ik import trial_motion

Rows = Sequence[Mapping[str, object]]
MOTIONS = "motions"  # Folder of carried motions.


@dataclass(frozen=True, eq=False, kw_only=True)
class Transferred(Made[Transfer]):
    """A transfer, and the motions that were carried with it, by the names of their trials."""

    motions: Mapping[str, CarriedMotion]


def transfer_files(
    lower: Path,
    higher: Path,
    pose: Path | None,
    options: TransferOptions,
    motions: Sequence[Path] = (),
) -> Transferred:
    """Give a model with more joints the lengths, markers and masses of a subject's calibrated and
    identified one, in a pose of this: the first frame of a file, its default without; and carry
    motions of the subject's to it.
    """
    subject = open_model(lower)
    motion = None if pose is None else read_motion(pose, subject)
    result = transfer(subject, open_model(higher), options, motion)
    moved = (("motion", path) for path in motions)
    sources = file_sources(("model", lower), ("model to", higher), ("pose", pose), *moved)
    made = provenance_of("transfer", sources, plain_settings(options))
    carried = {
        path.stem: carry_motion(subject, read_motion(path, subject), result, options)
        for path in motions
    }
    return Transferred(result, made, motions=carried)


def write_transferred(transferred: Transferred, out: Path, tables: Path) -> tuple[str, ...]:
    """Write the model, and a folder of tables, whole or not at all; returns what is lost in the
    model's file.
    """
    result = transferred.found

    def fill(folder: Path) -> None:
        write_rows(joint_rows(result), folder / "joints.csv")
        write_rows(length_rows(result), folder / "lengths.csv")
        write_rows(mass_rows(result), folder / "masses.csv")
        # In it the joint centers of both models coincide.
        write_sto(table_from_motion(result.higher_pose, result.model), folder / "pose.mot")
        (folder / MOTIONS).mkdir()
        for name, carried in transferred.motions.items():
            write_sto(
                table_from_motion(carried.motion, result.model),
                folder / MOTIONS / f"{file_name(name)}.mot",
            )
        # How far each motion's points determine a coordinate; near 0 it is held.
        known = {trial: carried.known for trial, carried in transferred.motions.items()}
        names = dict.fromkeys(name for shares in known.values() for name in shares)
        rows = [
            {"coordinate": name} | {trial: shares[name] for trial, shares in known.items()}
            for name in names
        ]
        write_rows(rows, folder / "coordinates.csv")

    return write_made_model(result.model, transferred.provenance, out, tables, fill, result.notes)


def joint_rows(transfer: Transfer) -> Rows:
    """A row for each joint center that both models have: how far apart it is left, and how far its
    joint was moved.
    """
    return [
        {"joint_center": name, "error_m": error, "shift_m": transfer.joint_shifts.get(name, 0.0)}
        for name, error in transfer.joint_errors.items()
    ]


def length_rows(transfer: Transfer) -> Rows:
    """A row for each distance of two joint centers of a region, in both models."""
    return [
        {
            "region": str(length.region),
            "from": length.centers[0],
            "to": length.centers[1],
            "given_m": length.lower,
            "transferred_m": length.higher,
        }
        for length in transfer.lengths
    ]


def mass_rows(transfer: Transfer) -> Rows:
    """A row for each region: its mass, and how well the bodies of the larger model reproduce it."""
    return [
        {
            "region": str(mass.region),
            "given_bodies": " ".join(mass.lower_bodies),
            "bodies": " ".join(mass.higher_bodies),
            "mass_kg": mass.mass,
            "mass_error_kg": mass.mass_error,
            "center_error_m": mass.center_error,
            "inertia_error_kg_m2": mass.inertia_error,
            "note": mass.note,
        }
        for mass in transfer.masses
    ]


def summary(transferred: Transferred) -> list[str]:
    """Text that the command prints: joint centers, masses, missing counterparts, motions."""
    transfer = transferred.found
    errors = np.array(list(transfer.joint_errors.values()))
    lines = [
        f"{len(errors)} joint centers in common, at most {1e3 * errors.max():.1f} mm apart; "
        f"{transfer.model.mass:.2f} kg in {len(transfer.masses)} regions"
    ]
    for what, names in (
        ("joint centers of one model only", transfer.without_center),
        ("bodies without a counterpart", transfer.without_counterpart),
    ):
        if names:
            lines.append(f"{what}: {', '.join(names)}")
    for name, carried in transferred.motions.items():
        held = sum(share < 0.5 for share in carried.known.values())
        lines.append(
            f"{name}: carried, its points {1e3 * np.sqrt(np.nanmean(carried.errors**2)):.1f} mm"
            f" apart (RMS); {len(carried.known) - held} coordinates follow the subject's, {held}"
            " are mostly held"
        )
    return lines


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    options = with_settings(TransferOptions(), subject.settings.get("transfer", {}))
    higher = subject.files.detailed
    assert higher is not None
    with about(higher):
        result = transfer(subject.model, open_model(higher), options)
    motions = {
        trial.name: carry_motion(subject.model, trial_motion(trial), result, options)
        for trial in subject.trials()
    }
    write_transferred(
        Transferred(result, output.made, motions=motions), output.path("model"), output.tables
    )


def _made_from(subject: SubjectInputs) -> Provenance:
    made = recordings_provenance("transfer", subject, earlier=("ik",))
    higher = subject.files.detailed
    return replace(made, sources=(*made.sources, *file_sources(("model to", higher))))


STEP = Step(
    name="transfer",
    scope="subject",
    title="transfer to a model with more joints",
    options=(TransferOptions,),
    tables="transfer",
    leaves=FrozenMap({"model": "transferred.osim", "carried": f"transfer/{MOTIONS}"}),
    run=_run,
    made_from=_made_from,
)

"""A subject's lengths, markers and masses for a model with more joints, from files: `myomorph transfer`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.identify.transfer import Transfer, transfer
from myomorph.identify.transfer_options import TransferOptions
from myomorph.io.sto import table_from_motion, write_sto
from myomorph.store.results import file_source, provenance_of
from myomorph.store.settings import plain_settings
from myomorph.study.inputs.reading import open_model, read_motion
from myomorph.study.subject.subjects import Made, tables_folder, write_made_model, write_rows

Rows = Sequence[Mapping[str, object]]
TABLES = "transfer"
"""With which the name of the folder of tables ends."""


def transfer_files(lower: Path, higher: Path, pose: Path | None, options: TransferOptions) -> Made[Transfer]:
    """Give a model with more joints the lengths, markers and masses of a subject's calibrated and identified one, in a
    pose of this: the first frame of a file, its default without.
    """
    subject = open_model(lower)
    motion = None if pose is None else read_motion(pose, subject)
    result = transfer(subject, open_model(higher), options, motion)
    named = (("model", lower), ("model to", higher), *((("pose", pose),) if pose is not None else ()))
    sources = [file_source(role, path) for role, path in named]
    return Made(result, provenance_of("transfer", sources, plain_settings(options)))


def write_transferred(transferred: Made[Transfer], out: Path) -> tuple[str, ...]:
    """Write the model, and a folder of tables, whole or not at all; returns what is lost in the model's file."""
    result = transferred.found

    def fill(folder: Path) -> None:
        write_rows(joint_rows(result), folder / "joints.csv")
        write_rows(length_rows(result), folder / "lengths.csv")
        write_rows(mass_rows(result), folder / "masses.csv")
        # In it the joint centers of both models coincide.
        write_sto(table_from_motion(result.higher_pose, result.model), folder / "pose.mot")

    return write_made_model(result.model, transferred.provenance, out, tables_folder(out, TABLES), fill)


def joint_rows(transfer: Transfer) -> Rows:
    """A row for each joint center that both models have: how far apart it is left, and how far its joint was moved."""
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


def summary(transfer: Transfer) -> list[str]:
    """What the command prints: joint centers, masses, and what has no counterpart."""
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
    return lines

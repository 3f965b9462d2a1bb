"""A subject's lengths, markers and masses for a model with more joints, from files: `myomorph transfer`."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.identify.transfer import Transfer, transfer
from myomorph.identify.transfer_options import TransferOptions
from myomorph.io.sto import table_from_motion, write_sto
from myomorph.model.provenance import Provenance
from myomorph.store.results import file_source, provenance_of
from myomorph.store.settings import plain_settings
from myomorph.study.inputs.reading import open_model, read_motion
from myomorph.study.subject.subjects import write_made_model

Rows = Sequence[Mapping[str, object]]


@dataclass(frozen=True, eq=False)
class Transferred:
    """A transfer and what it was made from."""

    found: Transfer
    provenance: Provenance


def transfer_files(lower: Path, higher: Path, pose: Path | None, options: TransferOptions) -> Transferred:
    """Give a model with more joints the lengths, markers and masses of a subject's calibrated and identified one, in a
    pose of this: the first frame of a file, its default without.
    """
    subject = open_model(lower)
    motion = None if pose is None else read_motion(pose, subject)
    result = transfer(subject, open_model(higher), options, motion)
    named = (("model", lower), ("model to", higher), *((("pose", pose),) if pose is not None else ()))
    sources = [file_source(role, path) for role, path in named]
    return Transferred(result, provenance_of("transfer", sources, plain_settings(options)))


def tables_folder(out: Path) -> Path:
    """Where tables of a transferred model go: beside it."""
    return out.with_name(f"{out.stem}_transfer")


def write_transferred(transferred: Transferred, out: Path) -> tuple[str, ...]:
    """Write the model, and beside it a folder of tables, whole or not at all. Returns what the model's file could not
    hold.
    """
    result = transferred.found

    def fill(folder: Path) -> None:
        _write_rows(joint_rows(result), folder / "joints.csv")
        _write_rows(length_rows(result), folder / "lengths.csv")
        _write_rows(mass_rows(result), folder / "masses.csv")
        # In it the joint centers of both models coincide.
        write_sto(table_from_motion(result.higher_pose, result.model), folder / "pose.mot")

    return write_made_model(result.model, transferred.provenance, out, tables_folder(out), fill)


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


def _write_rows(rows: Rows, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(
            {key: f"{value:.6g}" if isinstance(value, float) else str(value) for key, value in row.items()}
            for row in rows
        )


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

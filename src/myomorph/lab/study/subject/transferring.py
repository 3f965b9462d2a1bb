"""A subject's lengths, markers, masses and motions for a model with more joints.

It is `myomorph transfer` and the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.body.identify.carried_paths import CarriedPaths, carried_paths
from myomorph.body.identify.carry import CarriedMotion, carry_motion
from myomorph.body.identify.transfer import Transfer, transfer
from myomorph.body.identify.transfer_options import TransferOptions
from myomorph.core.io.sto import table_from_motion, write_sto
from myomorph.core.model.errors import few
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.results import file_name, file_sources, provenance_of
from myomorph.lab.store.settings import plain_settings, with_settings
from myomorph.lab.study.inputs.reading import about, open_model, read_motion
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.subject_files import SubjectInputs, recordings_provenance
from myomorph.lab.study.subject.subjects import Made, ModelOutput, write_made_model, write_rows
from myomorph.lab.study.trial.steps.ik import trial_motion

Rows = Sequence[Mapping[str, object]]
MOTIONS = "motions"  # Folder of carried motions.
MAX_NAMED = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Transferred(Made[Transfer]):
    """A transfer, the motions that were transferred with it, and what muscle paths do along them.

    Both are by the names of their trials.
    """

    motions: Mapping[str, CarriedMotion]
    paths: Mapping[str, CarriedPaths] = field(default_factory=lambda: FrozenMap({}))


def transfer_files(
    lower: Path,
    higher: Path,
    pose: Path | None,
    options: TransferOptions,
    motions: Sequence[Path] = (),
) -> Transferred:
    """Give a model with more joints a subject's lengths, markers and masses.

    They are those of the subject's calibrated and identified model, in a pose of this: the first
    frame of a file, its default without. Motions of the subject are transferred to it.
    """
    subject = open_model(lower)
    motion = None if pose is None else read_motion(pose, subject)
    given = open_model(higher)
    result = transfer(subject, given, options, motion)
    moved = (("motion", path) for path in motions)
    sources = file_sources(("model", lower), ("model to", higher), ("pose", pose), *moved)
    made = provenance_of("transfer", sources, plain_settings(options))
    carried = {
        path.stem: carry_motion(subject, read_motion(path, subject), result, options)
        for path in motions
    }
    return Transferred(result, made, motions=carried, paths=_paths(given, result, carried))


def _paths(
    given: Model, result: Transfer, carried: Mapping[str, CarriedMotion]
) -> Mapping[str, CarriedPaths]:
    """Return what muscle paths do along each motion, where they could be followed."""
    found = {
        name: carried_paths(given, result.model, motion.motion) for name, motion in carried.items()
    }
    return FrozenMap({name: paths for name, paths in found.items() if paths is not None})


def write_transferred(transferred: Transferred, out: Path, tables: Path) -> tuple[str, ...]:
    """Write the model, and a folder of tables, whole or not at all.

    What is lost in the model's file is returned.
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
        write_rows(path_rows(transferred), folder / "path_jumps.csv")

    return write_made_model(
        result.model, transferred.provenance, ModelOutput(out, tables), fill, result.notes
    )


def joint_rows(transfer: Transfer) -> Rows:
    """Return a row for each joint center that both models have.

    It holds how far apart it is left, and how far its joint was moved.
    """
    return [
        {"joint_center": name, "error_m": error, "shift_m": transfer.joint_shifts.get(name, 0.0)}
        for name, error in transfer.joint_errors.items()
    ]


def length_rows(transfer: Transfer) -> Rows:
    """Return a row for each distance of two joint centers of a region, in both models."""
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


def path_rows(transferred: Transferred) -> Rows:
    """Return a row for each muscle path that jumps along a motion.

    It holds the jump in the model as given, and now.
    """
    return [
        {"trial": trial, "muscle": name, "given_m": float(given), "transferred_m": float(now)}
        for trial, paths in transferred.paths.items()
        for name, given, now in zip(paths.muscles, paths.given, paths.transferred, strict=True)
        if given > 0.0 or now > 0.0
    ]


def mass_rows(transfer: Transfer) -> Rows:
    """Return a row for each region.

    It holds its mass, and how well the bodies of the larger model reproduce it.
    """
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
            f"{name}: transferred, its points {1e3 * np.sqrt(np.nanmean(carried.errors**2)):.1f} mm"
            f" apart (RMS); {len(carried.known) - held} coordinates follow the subject's, {held}"
            " are mostly fixed"
        )
    lines += [_paths_line(name, paths) for name, paths in transferred.paths.items()]
    return lines


def _paths_line(name: str, paths: CarriedPaths) -> str:
    """Say which muscle paths jump along a motion, and whose jumps they are."""
    count = len(paths.own) + len(paths.new)
    hops = ""
    if paths.hops:
        largest = max(paths.hops, key=lambda hop: hop.size)
        hops = (
            f"; the motion hops {len(paths.hops)} times, most at {largest.time:.2f} s"
            f" ({largest.coordinate} by {np.degrees(largest.size):.0f}°): use the parts between"
        )
        bounds = dict.fromkeys(name for hop in paths.hops for name in hop.bounds)
        if bounds:
            at_ends = sum(bool(hop.bounds) for hop in paths.hops)
            hops += (
                f"; at {at_ends} of them a range of the model"
                f" ends ({few(list(bounds), MAX_NAMED)}): the motion leaves it"
            )
    if not count:
        return f"{name}: none of {len(paths.muscles)} muscle paths jumps{hops}"
    whose = f"{len(paths.own)} of them in the model as given too"
    new = f"by the transfer {few(paths.new, MAX_NAMED)}" if paths.new else "none by the transfer"
    return (
        f"{name}: {count} of {len(paths.muscles)} muscle paths jump, {whose}, {new}: moment arms"
        f" there are unreliable{hops}"
    )


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    options = with_settings(TransferOptions(), subject.settings.get("transfer", {}))
    higher = subject.files.detailed
    assert higher is not None
    with about(higher):
        given = open_model(higher)
        result = transfer(subject.model, given, options)
    motions = {
        trial.name: carry_motion(subject.model, trial_motion(trial), result, options)
        for trial in subject.trials()
    }
    paths = _paths(given, result, motions)
    write_transferred(
        Transferred(result, output.made, motions=motions, paths=paths),
        output.path("model"),
        output.tables,
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

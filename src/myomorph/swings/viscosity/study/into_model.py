"""What a specimen's swings tell of joint and muscles, written into any model of the same joint."""

from __future__ import annotations

from pathlib import Path

from myomorph.core.io.formats import read_model
from myomorph.core.io.mjcf.couplings import write_dampers
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.swings.viscosity.identified_model import (
    LOSSY,
    ViscosityValues,
    dampers_of,
)
from myomorph.swings.viscosity.report.specimen_report import SpecimenReport
from myomorph.swings.viscosity.study.swing_files import body_named


def write_identified(
    model: Path,
    report: SpecimenReport,
    out: Path,
    base: str | None = None,
    first: str | None = None,
) -> tuple[str, ...]:
    """Write a model with the viscosities of a specimen's joint and muscles.

    Parameters
    ----------
    model : file (.osim or .xml)
    report : of the specimen
    out : file to write, of the same kind
    base, first : bodies that the joint ties, by default those called scapula and humerus

    Returns
    -------
    what was written and what is not expressed, a line each

    Raises
    ------
    BadData : the specimen has no joint viscosity
    """
    if out.suffix.lower() != model.suffix.lower():
        raise BadFile(
            out,
            f"ends otherwise than the model '{model.name}'",
            f"give a name with '{model.suffix}'",
        )
    if "joint_viscosity" not in report.row:
        raise BadData(
            f"specimen '{report.name}' has no joint viscosity: its swings without muscles do not"
            " show it"
        )
    joint = report.row["joint_viscosity"].value
    read = read_model(model)
    of_muscles = {}
    if report.muscles is not None and "muscle_viscosity" in report.row:
        of_muscles = dict.fromkeys(report.muscles.muscles, report.row["muscle_viscosity"].value)
    first = body_named(read, first, "first_body")
    base = body_named(read, base, "base", first)
    ball = next((part for part in read.joints if part.child == first and part.parent == base), None)
    mjcf = model.suffix.lower() == ".xml"
    whole = mjcf and ball is not None and ball.kind == "ball"
    viscosity = ViscosityValues(joint=joint, muscles=of_muscles)
    dampers = dampers_of(read, base, first, viscosity, by_coordinate=mjcf)
    lines = [f"{base} to {first}: {joint:.3g} N m s/rad"]
    if of_muscles:
        lines.append(
            f"{len(dampers.muscles)} muscles: {report.row['muscle_viscosity'].value:.3g} N s/m each"
        )
    if whole and ball is not None:
        write_dampers(model, out, {ball.name: joint}, dampers.muscles)
        return tuple(lines)
    if dampers.residual > LOSSY:
        what = "dampers of coordinates" if dampers.bushing is None else "the bushing"
        lines.append(
            f"{what} miss {100 * dampers.residual:.0f} % of the torque of the joint's damping"
        )
    if mjcf:
        write_dampers(model, out, dampers.coordinates, dampers.muscles)
        return tuple(lines)
    bushings = () if dampers.bushing is None else (dampers.bushing,)
    made = with_passive_dynamics(
        read, dampers.coordinates, viscosity=dampers.muscles, bushings=bushings
    )
    return (*lines, *write_osim(made, out))

"""What a specimen's swings tell of joint and muscles, written into any model of the same joint."""

from __future__ import annotations

from pathlib import Path

from myomorph.core.io.formats import read_model
from myomorph.core.io.mjcf.couplings import write_dampers
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.model import Model
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.swings.viscosity.identified_model import (
    LOSSY,
    Dampers,
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
    viscosity = _viscosity_of(report)
    read = read_model(model)
    first = body_named(read, first, "first_body")
    base = body_named(read, base, "base", first)
    mjcf = model.suffix.lower() == ".xml"
    dampers = dampers_of(read, base, first, viscosity, by_coordinate=mjcf)
    lines = _lines(report, dampers, f"{base} to {first}")
    ball = _ball(read, base, first)
    if mjcf and ball is not None:
        write_dampers(model, out, {ball: viscosity.joint}, dampers.muscles)
        return lines
    if dampers.residual > LOSSY:
        what = "bushings" if dampers.bushings else "dampers of coordinates"
        missed = f"{100 * dampers.residual:.0f} % of the torque of the joint's damping"
        lines = (*lines, f"{what} miss {missed}")
    if mjcf:
        write_dampers(model, out, dampers.coordinates, dampers.muscles)
        return lines
    made = with_passive_dynamics(
        read, dampers.coordinates, viscosity=dampers.muscles, bushings=dampers.bushings
    )
    return (*lines, *write_osim(made, out))


def _viscosity_of(report: SpecimenReport) -> ViscosityValues:
    """Take the viscosities out of a report.

    Raises
    ------
    BadData : the specimen has no joint viscosity
    """
    if "joint_viscosity" not in report.row:
        raise BadData(
            f"specimen '{report.name}' has no joint viscosity: its swings without muscles do not"
            " show it"
        )
    muscles = {}
    if report.muscles is not None and "muscle_viscosity" in report.row:
        muscles = dict.fromkeys(report.muscles.muscles, report.row["muscle_viscosity"].value)
    return ViscosityValues(joint=report.row["joint_viscosity"].value, muscles=muscles)


def _lines(report: SpecimenReport, dampers: Dampers, joint: str) -> tuple[str, ...]:
    """Say what is written of joint and muscles, a line each."""
    of_joint = f"{joint}: {report.row['joint_viscosity'].value:.3g} N m s/rad"
    if not dampers.muscles:
        return (of_joint,)
    value = report.row["muscle_viscosity"].value
    count = len(dampers.muscles) if report.muscles is None else len(report.muscles.muscles)
    of_muscles = f"{count} muscles: {value:.3g} N s/m each"
    lines = dampers.muscles.values()
    if len(lines) > count:
        least = f"{min(lines):.3g}"
        most = f"{max(lines):.3g}"
        span = least if least == most else f"{least} to {most}"
        of_muscles += f", which its lines share: {len(lines)} of {span} N s/m"
    return of_joint, of_muscles


def _ball(model: Model, base: str, first: str) -> str | None:
    """Name the joint between two bodies where it is a ball."""
    joints = (joint for joint in model.joints if (joint.parent, joint.child) == (base, first))
    joint = next(joints, None)
    return joint.name if joint is not None and joint.kind == "ball" else None

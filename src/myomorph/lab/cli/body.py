"""`body`."""

from __future__ import annotations

from pathlib import Path

from myomorph.body.shape.people import Sex
from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import said, warn


@documented
def body_command(  # page: one option each
    *,
    height: float,
    out: Path,
    chest: float | None = None,
    sex: Sex | None = None,
    mass: float | None = None,
    age: float | None = None,
) -> int:
    """Make a person's body from height, chest, sex and mass: skin, masses of segments, a picture.

    Parameters
    ----------
    height : of the person [m]
    out : folder for skin.obj, segments.csv, measurements.csv and report.html
    chest : circumference of the chest at the nipples [m]; that of people alike by default
    sex : of the person
    mass : of the person [kg]; that of people alike by default
    age : in years
    """
    from myomorph.lab.study.subject.body_files import Measured, body_lines, make_body

    person = Measured(height=height, chest=chest, mass=mass, sex=sex, age=age)
    shape, segments = make_body(out, person)
    warn(shape.notes)
    for line in body_lines(shape, segments):
        said(line)
    said(f"wrote {out}")
    return 0

"""`body`."""

from __future__ import annotations

from pathlib import Path

from myomorph.body.shape.people import Sex
from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import made


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
    """Make a person's body from height, chest, sex and mass: a model, its skin, a picture.

    Parameters
    ----------
    height : of the person [m]
    out : model to write (.osim), with skin, tables and a report in a folder beside it; or a folder
        for all of it
    chest : circumference of the chest at the nipples [m]; that of people alike by default
    sex : of the person
    mass : of the person [kg]; that of people alike by default
    age : in years
    """
    from myomorph.lab.study.subject.body_files import Measured, body_lines, make_body

    person = Measured(height=height, chest=chest, mass=mass, sex=sex, age=age)
    body = make_body(out, person)
    return made(body.model, body.tables, body_lines(body.shape, body.segments), body.shape.notes)

"""`body`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.body.shape.people import Sex
from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import made


@documented
@dataclass(frozen=True, kw_only=True)
class Person:
    """What is known of a person.

    Attributes
    ----------
    height : height of the person [m]
    chest : chest circumference at the nipples [m]; estimated from the other measurements by default
    sex : sex of the person
    mass : body mass [kg]; estimated from the other measurements by default
    age : age [years]; estimated from the other measurements by default
    """

    height: float
    chest: float | None = None
    sex: Sex | None = None
    mass: float | None = None
    age: float | None = None


@documented
def body_command(*, person: Annotated[Person, Parameter(name="*")], out: Path) -> int:
    """Make a person's body from height, chest, sex and mass: a model, its skin, a picture.

    Parameters
    ----------
    person : what is known of the person
    out : model to write (.osim), with skin, tables and a report in a folder next to it; or a folder
        for all files
    """
    from myomorph.lab.study.subject.body_files import Measured, body_lines, make_body

    measured = Measured(
        height=person.height,
        chest=person.chest,
        mass=person.mass,
        sex=person.sex,
        age=person.age,
    )
    body = make_body(out, measured)
    return made(body.model, body.tables, body_lines(body.shape, body.segments), body.shape.notes)

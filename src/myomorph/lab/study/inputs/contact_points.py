"""Points that share a joint's force: `auto`, a folder of bone meshes, or a TOML file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadFile
from myomorph.core.model.model import Model
from myomorph.lab.store.results import value_source
from myomorph.lab.store.toml_file import read_toml, refuse
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import WordOrFile

if TYPE_CHECKING:
    from myomorph.core.tension.joint_contact import JointPoints


@dataclass(frozen=True)
class ContactPointsFile:
    """Contact points of joints.

    Attributes
    ----------
    contact_points : Distribution of a joint's force over contact points (joint_contact_forces.sto):
        auto (a medial and a lateral point of every knee, from the femur's mesh next to the model),
        a folder with the bone meshes, or a file of points (.toml).
    """

    contact_points: Annotated[str, WordOrFile(option_of="tension")] = ""


def _open(settings: ContactPointsFile, opening: Opening) -> Opened:
    points = contact_points(settings.contact_points, opening.model)
    if points is None:
        return Opened()
    return Opened(
        (points,), (value_source("contact points", settings.contact_points, points.points),)
    )


INPUT = Input(name="contact points", settings=ContactPointsFile, open=_open, main="contact_points")


def contact_points(source: str, model: Model) -> JointPoints | None:
    """Return contact points of a model's joints, and what is to be known of them.

    Parameters
    ----------
    source : "auto" for the knees with the bones beside the model's file, a folder of bones, a TOML
        file, or ""
    model : whose joints have the points

    Returns
    -------
    the points, None for ""

    Raises
    ------
    BadFile : the file has no contact points
    """
    if not source:
        return None
    from myomorph.core.io.mesh import read_surfaces
    from myomorph.core.tension.joint_contact import ContactPoint, JointPoints
    from myomorph.core.tension.knee_points import knee_points

    path = Path(source)
    if source == "auto" or path.is_dir():
        home = Path(model.source).parent
        beside = (home, home / "Geometry", home / "geometry") if model.source else ()
        folders = [folder for folder in beside if folder.is_dir()] if source == "auto" else [path]
        return knee_points(model, read_surfaces(model, folders)[0] if folders else {})
    if path.suffix.lower() != ".toml" or not is_named_file(path):
        raise BadFile(
            path,
            "gives no contact points",
            "expected 'auto', a folder of bone meshes, or a file .toml",
        )
    # What checks keys takes long to import, and few have such a file.
    from myomorph.lab.store.study_file import checked
    from myomorph.lab.study.inputs.contact_point_tables import ContactPointTables

    table, problems = checked(ContactPointTables, read_toml(path))
    refuse(path, problems)
    points = (
        ContactPoint(
            joint=point.joint,
            name=point.name,
            frame=point.frame,
            point=point.point,
            normal=point.normal,
        )
        for point in table.point
    )
    return JointPoints(tuple(points))

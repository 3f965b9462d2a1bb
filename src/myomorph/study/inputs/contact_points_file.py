"""What a user says of a joint's contact points: `auto`, a folder of bone meshes, or a file (.toml) of points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pydantic import Field

from myomorph.io.mesh import read_surfaces
from myomorph.model.errors import BadFile
from myomorph.model.model import Model
from myomorph.model.surface import Surface
from myomorph.store.results import value_source
from myomorph.store.study_file import Strict, checked, is_file, is_folder, read_toml, refuse
from myomorph.study.inputs.contact_file import AUTO, Vector
from myomorph.study.inputs.contact_points import ContactPointsFile
from myomorph.study.inputs.input import Opened, Opening
from myomorph.tension.joint_contact import ContactPoint, JointPoints
from myomorph.tension.knee_points import knee_points


class _Point(Strict):
    joint: str = Field(min_length=1)
    name: str = Field(min_length=1)
    frame: str = ""
    point: Vector
    normal: Vector | None = None


class _File(Strict):
    point: list[_Point] = Field(min_length=1)


def opened(settings: ContactPointsFile, opening: Opening) -> Opened:
    """Contact points of a trial's joints."""
    points = contact_points(settings.contact_points, opening.model)
    if points is None:
        return Opened()
    return Opened((points,), (value_source("contact points", settings.contact_points, points.points),))


def contact_points(given: str, model: Model) -> JointPoints | None:
    """Contact points of a model's joints, and what is to be known of them: "auto" for the knees with the bones beside
    the model's file, a folder of bones, a TOML file; None for "".
    """
    if not given:
        return None
    path = Path(given)
    if given == AUTO or is_folder(path):
        folders = None if given == AUTO else [path]
        return knee_points(model, _bones(model, folders))
    if path.suffix.lower() != ".toml" or not is_file(path):
        raise BadFile(path, "gives no contact points", f"expected '{AUTO}', a folder of bone meshes, or a file .toml")
    return JointPoints(read_contact_points(path))


def read_contact_points(path: Path) -> tuple[ContactPoint, ...]:
    """Contact points of a file. Raises `BadFile` where it is not of contact points."""
    found, problems = checked(_File, read_toml(path))
    refuse(path, problems)
    return tuple(ContactPoint(one.joint, one.name, one.frame, one.point, one.normal) for one in found.point)


def _bones(model: Model, folders: list[Path] | None) -> Mapping[str, Surface]:
    """Meshes in the folders, those beside the model's file by default."""
    if folders is None:
        home = Path(model.source).parent
        folders = [one for one in (home, home / "Geometry", home / "geometry") if model.source and one.is_dir()]
    return read_surfaces(model, folders)[0] if folders else {}

"""Bones travel with a model that is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.io.carried_meshes import carry_meshes
from myomorph.core.io.mesh import mesh_folders, read_surfaces
from myomorph.core.model.model import Body, Mesh, Model
from myomorph.core.model.spatial import Transform
from walker import model as walker

STL = b"\0" * 80 + (1).to_bytes(4, "little") + np.zeros(1, "S50").tobytes().ljust(50, b"\0")


def drawn_with(source: Path, *names: str) -> Model:
    """Make a body whose first segment is drawn with meshes beside a file."""
    model = walker()
    meshes = tuple(Mesh(name, Transform.identity(), np.ones(3)) for name in names)
    first: Body = replace(model.bodies[0], meshes=meshes)
    return replace(model, bodies=(first, *model.bodies[1:]), source=str(source))


def test_meshes_lie_beside_the_written_model_and_are_found_there(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / "meshes").mkdir(parents=True)
    (home / "meshes" / "sacrum.stl").write_bytes(STL)
    model = drawn_with(home / "body.osim", "meshes/sacrum.stl")
    (home / "body.osim").touch()
    out = tmp_path / "out"
    out.mkdir()
    carry_meshes(model, out)
    assert (out / "Geometry" / "meshes" / "sacrum.stl").read_bytes() == STL
    written = replace(model, source=str(out / "body.osim"))
    surfaces, warnings = read_surfaces(written, mesh_folders(written))
    assert set(surfaces) == {"meshes/sacrum.stl"}
    assert not warnings


def test_no_name_leads_out_of_the_folder(tmp_path: Path) -> None:
    home = tmp_path / "deep" / "home"
    home.mkdir(parents=True)
    (tmp_path / "deep" / "secret.stl").write_bytes(STL)
    model = drawn_with(home / "body.osim", "../secret.stl", str(tmp_path / "deep" / "secret.stl"))
    out = tmp_path / "out"
    out.mkdir()
    carry_meshes(model, out)
    assert not list(out.iterdir())


def test_what_is_there_stays(tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (home / "a.stl").write_bytes(STL)
    model = drawn_with(home / "body.osim", "a.stl")
    out = tmp_path / "out"
    (out / "Geometry").mkdir(parents=True)
    (out / "Geometry" / "a.stl").write_bytes(b"mine")
    carry_meshes(model, out)
    assert (out / "Geometry" / "a.stl").read_bytes() == b"mine"

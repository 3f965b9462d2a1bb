"""Compile an MJCF file in a process of its own: `python -m myomorph.io.mjcf.compile JOB BINARY ANSWER`."""

from __future__ import annotations

import json
import os
import posixpath
import sys
from pathlib import Path
from typing import Any

import mujoco

from myomorph.io.parsing.guard import limit_memory

MOST_MEMORY = 16.0


def main(job: str, binary: str, answer: str) -> None:
    """Compile what `job` names into `binary`, and say in `answer` what went wrong and what has no mass."""
    limit_memory(MOST_MEMORY)
    # MuJoCo writes a log into the current folder: let that be the one that goes away.
    os.chdir(Path(job).parent)
    task = json.loads(Path(job).read_text(encoding="utf-8"))
    weightless: list[str] = []
    error = ""
    try:
        spec = mujoco.MjSpec.from_file(task["path"])
        _drop_pictures(spec)
        weightless = _drop_meshes(spec, task["missing"])
        _place_meshes(spec)
        mujoco.mj_saveModel(spec.compile(), binary, None)
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as problem:
        error = str(problem) or type(problem).__name__
    Path(answer).write_text(json.dumps({"error": error, "weightless": weightless}), encoding="utf-8")


def _drop_pictures(spec: Any) -> None:
    """Textures and skins only draw: without them a missing picture cannot stop a model."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for one in [*spec.textures, *spec.skins]:
        spec.delete(one)


def _place_meshes(spec: Any) -> None:
    """Whole paths of meshes: before 4.0, compiled models do not say in which folder they lie."""
    for mesh in spec.meshes:
        place = Path(spec.modelfiledir) / spec.meshdir / _plain(mesh.file)
        if mesh.file and place.is_file():
            mesh.file = str(place.resolve())


def _drop_meshes(spec: Any, missing: list[str]) -> list[str]:
    """Take out the meshes whose files are missing, with their geoms; bodies that lose mass by it."""
    absent = {_plain(name) for name in missing}
    gone = {_name(mesh) for mesh in spec.meshes if _plain(mesh.file) in absent}
    fields = {_name(field) for field in spec.hfields if _plain(field.file) in absent}
    weightless = []
    for body in spec.bodies:
        for geom in list(body.geoms):
            if (geom.meshname and geom.meshname in gone) or (geom.hfieldname and geom.hfieldname in fields):
                if not body.explicitinertial and body.name not in weightless:
                    weightless.append(body.name)
                spec.delete(geom)
    for mesh in [one for one in spec.meshes if _name(one) in gone]:
        spec.delete(mesh)
    for field in [one for one in spec.hfields if _name(one) in fields]:
        spec.delete(field)
    return [name for name in weightless if name != "world"]


def _name(asset: Any) -> str:
    """Name of an asset: that of its file where the text gives none."""
    return asset.name or posixpath.splitext(posixpath.basename(_plain(asset.file)))[0]


def _plain(name: str) -> str:
    """A file's name in one spelling: MuJoCo tidies what the text says."""
    return posixpath.normpath(name.replace("\\", "/"))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Checks before MuJoCo reads a file, the process that compiles it, and MuJoCo silenced."""

from __future__ import annotations

import json
import logging
import math
import ntpath
import os
import posixpath
import tempfile
import warnings
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from myomorph.core.io.parsing.door import check_file, readable
from myomorph.core.io.parsing.guard import run_guarded
from myomorph.core.io.parsing.text import whole_number
from myomorph.core.io.parsing.xml import read_xml
from myomorph.core.model.errors import BadFile, quoted
from myomorph.core.model.model import Kept

DEFAULT_TIME_LIMIT = 60.0  # Of processor time, of all threads together [s].
WALL_SHARE = 4.0  # Of that limit, after which the process is stopped on a busy machine too.
MAX_FILES = 200
MAX_MEMORY = 4.0  # Of the process that compiles [GiB].
MAX_COMPILED = 1 << 30  # Bytes of a compiled model that are loaded.
MAX_CELLS = 1 << 24  # Of a height field.
PNG = b"\x89PNG\r\n\x1a\n"
PNG_SIZES = slice(16, 24)  # Bytes of width and height.
LICENSES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "LICENCE", "LICENCE.txt")
TEXTURE_FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass
class _Survey:
    """Files that the texts of a model name, collected while walking through its includes.

    Attributes
    ----------
    main : the model's file
    tree : top folder of its files
    folders : settings of the compiler, by attribute
    assets : (tag, name of the file as the text has it, folder of that text)
    seen : texts that were read
    """

    main: Path
    tree: Path
    folders: dict[str, str] = field(default_factory=dict)
    assets: list[tuple[str, str, Path]] = field(default_factory=list)
    seen: set[Path] = field(default_factory=set)


@contextmanager
def silent_mujoco() -> Iterator[None]:
    """Silence MuJoCo within the block.

    It prints its warnings and writes them into a file in the user's folder.

    Yields
    ------
    nothing
    """
    mujoco.set_mju_user_warning(lambda text: None)
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(level)
        mujoco.set_mju_user_warning(None)


def compile_guarded(path: Path, root: Path | None, time_limit: float) -> tuple[Any, list[Kept]]:
    """Check a file, then compile it in a process of its own.

    Parameters
    ----------
    path : of the MJCF file
    root : top folder of the model's files; None finds it
    time_limit : of processor time for compiling; of time by the clock four times as much [s]

    Returns
    -------
    compiled `mujoco.MjModel`, and the missing files that it does without

    Raises
    ------
    BadFile : the file is unsafe or no MJCF, MuJoCo refuses it, or the time is over; see `read_mjcf`
    """
    missing = check_files(path, root)
    with tempfile.TemporaryDirectory(prefix="myomorph-") as folder:
        job = Path(folder) / "job.json"
        binary = Path(folder) / "model.mjb"
        answer = Path(folder) / "answer.json"
        job.write_text(
            json.dumps({"path": str(path.resolve()), "missing": missing}), encoding="utf-8"
        )
        outcome = run_guarded(
            f"{__name__}:_compile",
            [job, binary, answer],
            WALL_SHARE * time_limit,
            MAX_MEMORY,
            time_limit,
        )
        if outcome.status == "hung":
            hint = "is a mesh very large, or a length range not given for its muscles?"
            problem = f"MuJoCo did not compile it within {time_limit:g} s of processor time"
            raise BadFile(path, problem, hint)
        if outcome.status == "failed":
            raise BadFile(path, f"MuJoCo stopped while compiling it ({outcome.message})")
        result = json.loads(answer.read_text(encoding="utf-8"))
        if result["error"]:
            reason = " ".join(result["error"].split())
            hint = "does it open in MuJoCo's own viewer?"
            if missing and "mass" in result["error"]:
                hint = (
                    f"bodies have no mass without the missing meshes ({quoted(missing, 3)}): get"
                    " these files"
                )
            raise BadFile(path, f"MuJoCo cannot compile it: {reason}", hint)
        if binary.stat().st_size > MAX_COMPILED:
            raise BadFile(path, f"takes more than {MAX_COMPILED >> 30} GiB once it is compiled")
        compiled = mujoco.MjModel.from_binary_path(str(binary))
    kept = [
        Kept(
            kind="missing file",
            name=name,
            effect="no such file: its geoms are left out",
            text="",
            room="asset",
        )
        for name in missing
    ]
    if result["weightless"]:
        effect = "the mass of the missing meshes of these bodies is left out"
        kept.append(
            Kept(
                kind="missing inertia",
                name=", ".join(result["weightless"]),
                effect=effect,
                text="",
                room="asset",
            )
        )
    return compiled, kept


def check_files(path: Path, root: Path | None = None) -> list[str]:
    """Check the files that a model names.

    Parameters
    ----------
    path : of the MJCF file
    root : top folder of the model's files; None finds it

    Returns
    -------
    mesh and height-field files that do not exist, as the text writes them

    Raises
    ------
    BadFile : the text, or one that it includes, is not safe XML, is not MJCF, or names a file that
        is too large or outside of the model's folder tree (the rule: `read_mjcf`)
    """
    survey = _Survey(path, (root or tree_of(path)).resolve())
    document = read_xml(path)
    if str(document.root.tag).lower() != "mujoco":
        problem = (
            f"is XML of another kind: its outermost element is <{document.root.tag}>, not <mujoco>"
        )
        raise BadFile(path, problem, "give an MJCF file")
    survey.seen.add(path.resolve())
    _walk(document.root, path.parent, survey)
    missing = []
    for kind, name, folder in survey.assets:
        file = _inside(name, folder, survey, kind)
        if file is None or not file.exists():
            if kind in ("mesh", "hfield"):
                missing.append(name)
            continue
        check_file(file, "a part of a model")
        if kind == "hfield":
            _check_cells(path, name, _cells_of(file))
    return missing


def tree_of(path: Path) -> Path:
    """Find the top folder of the tree that a model belongs to.

    Parameters
    ----------
    path : of the MJCF file

    Returns
    -------
    folder of the Python package, the checkout or the folder with a license; else the file's own
    """
    home = path.resolve().parent
    for folder in (home, *home.parents):
        if (folder / "__init__.py").exists():
            while (folder.parent / "__init__.py").exists():
                folder = folder.parent
            return folder
        if (folder / ".git").exists() or any((folder / name).exists() for name in LICENSES):
            return folder
    return home


def _walk(element: Any, folder: Path, survey: _Survey) -> None:
    """Collect the files that an element and its children name; follow includes.

    Parameters
    ----------
    element : of the file
    folder : of that file
    survey : gets the files
    """
    tag = str(element.tag).lower()
    if tag == "compiler":
        for key in ("assetdir", "meshdir", "texturedir", "strippath"):
            if key in element.attrib:
                survey.folders[key] = element.get(key)
    elif tag in ("include", "model") and "file" in element.attrib:
        _include(element.get("file"), folder, survey, tag)
    elif tag == "texture":
        survey.assets += [
            ("texture", element.get(key), folder) for key in TEXTURE_FILES if key in element.attrib
        ]
    elif tag in ("mesh", "hfield", "skin", "flexcomp") and "file" in element.attrib:
        survey.assets.append((tag, element.get("file"), folder))
    if tag == "hfield":
        sizes = [whole_number(element.get(key, "0").strip()) or 0 for key in ("nrow", "ncol")]
        _check_cells(survey.main, element.get("name", ""), sizes)
    for child in element:
        _walk(child, folder, survey)


def _cells_of(file: Path) -> list[int]:
    """Read the rows and columns of a height field, of a picture or of MuJoCo's own format."""
    with readable(file), file.open("rb") as stream:
        head = stream.read(PNG_SIZES.stop)
    order = ">" if head.startswith(PNG) else "<"
    sizes = head[PNG_SIZES] if head.startswith(PNG) else head[:8]
    return [int(size) for size in np.frombuffer(sizes.ljust(8, b"\0"), f"{order}i4")]


def _check_cells(path: Path, name: str, sizes: list[int]) -> None:
    """Check that a height field is not too large; `BadFile` where it is."""
    if math.prod(sizes) > MAX_CELLS or max(sizes) > MAX_CELLS:
        problem = f"its height field '{name}' has {' x '.join(map(str, sizes))} cells"
        raise BadFile(path, problem, f"at most {MAX_CELLS} are read")


def _include(name: str, folder: Path, survey: _Survey, tag: str) -> None:
    """Follow an include, as MuJoCo does: beside the main file first, then beside the including one.

    Parameters
    ----------
    name : of the file as the text has it
    folder : of the including file
    survey : gets the files that the included one names
    tag : that names the file

    Raises
    ------
    BadFile : the file does not exist, is outside of the tree, or is one too many
    """
    file = _included_file(name, folder, survey, tag)
    if file in survey.seen:
        return
    survey.seen.add(file)
    if len(survey.seen) > MAX_FILES:
        raise BadFile(survey.main, f"includes more than {MAX_FILES} files")
    _walk(read_xml(file).root, file.parent, survey)


def _included_file(name: str, folder: Path, survey: _Survey, tag: str) -> Path:
    """Find an included file; `BadFile` where there is none."""
    for start in (survey.main.parent, folder):
        file = _inside(name, start, survey, tag, look=False)
        if file is not None and file.exists():
            return file
    raise BadFile(
        survey.main,
        f"its <{tag}> file '{name}' does not exist",
        "is the model's folder complete?",
    )


def _inside(name: str, folder: Path, survey: _Survey, kind: str, look: bool = True) -> Path | None:
    """Find the path of a file that a model names.

    Parameters
    ----------
    name : as the text has it
    folder : from which an include is named
    survey : folders of the compiler's settings, and the tree
    kind : tag that names the file
    look : whether the compiler's folders count

    Returns
    -------
    the path, whether it exists or not; None for an absolute path of another machine

    Raises
    ------
    BadFile : the file is outside of the model's tree
    """
    plain = name.replace("\\", "/")
    has_drive = bool(ntpath.splitdrive(name)[0])
    absolute = has_drive or ntpath.isabs(name) or os.path.isabs(name)
    if absolute and not Path(name).exists():
        return None
    if look:
        if survey.folders.get("strippath", "").lower() == "true":
            plain = plain.rsplit("/", 1)[-1]
            absolute = False
        folder = _asset_folder(survey, kind)
    file = Path(name if absolute else os.path.normpath(folder / plain)).resolve()
    if not file.is_relative_to(survey.tree):
        problem = f"its {kind} file '{name}' lies outside of the model's folder '{survey.tree}'"
        raise BadFile(
            survey.main, problem, "put the file inside, or name the model's top folder (root=...)"
        )
    return file


def _asset_folder(survey: _Survey, kind: str) -> Path:
    """Return the folder that the compiler's settings name for a kind of asset."""
    setting = "texturedir" if kind == "texture" else "meshdir"
    below = survey.folders.get(setting, survey.folders.get("assetdir", ""))
    return survey.main.parent / below.replace("\\", "/")


def _compile(job: str, binary: str, answer: str) -> None:
    """Run the child's side of compiling.

    Parameters
    ----------
    job : path of a JSON file that names the model and its missing files
    binary : path of the compiled model to write
    answer : path of the JSON file of errors and of bodies that lose mass to write
    """
    # MuJoCo writes a log into the current folder: let that be the one that goes away.
    os.chdir(Path(job).parent)
    task = json.loads(Path(job).read_text(encoding="utf-8"))
    weightless: list[str] = []
    error = ""
    try:
        spec = mujoco.MjSpec.from_file(task["path"])
        # Textures and skins only draw: without them a missing picture cannot stop a model.
        for material in spec.materials:
            material.textures = [""] * len(material.textures)
        for picture in [*spec.textures, *spec.skins]:
            spec.delete(picture)
        weightless = _drop_meshes(spec, task["missing"])
        # Whole paths of meshes: before 4.0, compiled models do not say in which folder they lie.
        for mesh in spec.meshes:
            place = Path(spec.modelfiledir) / spec.meshdir / _plain(mesh.file)
            if mesh.file and place.is_file():
                mesh.file = str(place.resolve())
        mujoco.mj_saveModel(spec.compile(), binary, None)
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as problem:
        error = str(problem) or type(problem).__name__
    Path(answer).write_text(
        json.dumps({"error": error, "weightless": weightless}), encoding="utf-8"
    )


def _drop_meshes(spec: Any, missing: list[str]) -> list[str]:
    """Take out geoms whose mesh files are missing.

    Parameters
    ----------
    spec : the `mujoco.MjSpec`, changed in place
    missing : files as the text names them

    Returns
    -------
    names of the bodies that lose mass by it
    """
    absent = {_plain(name) for name in missing}
    meshes = _of_files(spec.meshes, absent)
    fields = _of_files(spec.hfields, absent)
    mesh_names = {_name(mesh) for mesh in meshes} - {""}
    field_names = {_name(field) for field in fields} - {""}
    weightless = []
    for body in spec.bodies:
        geoms = [
            geom
            for geom in body.geoms
            if geom.meshname in mesh_names or geom.hfieldname in field_names
        ]
        for geom in geoms:
            spec.delete(geom)
        if geoms and not body.explicitinertial and body.name != "world":
            weightless.append(body.name)
    for asset in (*meshes, *fields):
        spec.delete(asset)
    return weightless


def _of_files(assets: Iterable[Any], files: Collection[str]) -> list[Any]:
    """List the assets that are read from these files.

    MuJoCo makes some names absolute, and not always right: those are known by their last part.
    """
    last_parts = {posixpath.basename(file) for file in files}
    found = []
    for asset in assets:
        file = _plain(asset.file)
        lost = posixpath.isabs(file) and not Path(file).exists()
        if file in files or (lost and posixpath.basename(file) in last_parts):
            found.append(asset)
    return found


def _name(asset: Any) -> str:
    """Return the name of an asset: that of its file where the text gives none."""
    return asset.name or posixpath.splitext(posixpath.basename(_plain(asset.file)))[0]


def _plain(name: str) -> str:
    """Write a file's name in one spelling, as MuJoCo tidies it."""
    return posixpath.normpath(name.replace("\\", "/"))

"""What is checked before MuJoCo reads a file, and the process of its own in which it does."""

from __future__ import annotations

import json
import ntpath
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco

from myomorph.io.parsing.guard import run_guarded
from myomorph.io.parsing.xml import read_xml
from myomorph.model.errors import BadFile
from myomorph.model.model import Kept

DEFAULT_TIME_LIMIT = 15.0
MOST_FILES = 200
LARGEST_ASSET = 512 * 1024 * 1024
LICENSES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "LICENCE", "LICENCE.txt")
TEXTURE_FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass
class _Survey:
    """What the texts of a model name, collected while walking through its includes."""

    main: Path
    tree: Path
    folders: dict[str, str] = field(default_factory=dict)
    assets: list[tuple[str, str, Path]] = field(default_factory=list)
    seen: set[Path] = field(default_factory=set)


def compile_guarded(path: Path, root: Path | None, time_limit: float) -> tuple[Any, list[Kept]]:
    """Compiled `mujoco.MjModel` of a file that was checked first, and the missing files that it does without.

    Raises
    ------
    BadFile : see `read_mjcf`
    """
    missing = check_files(path, root)
    with tempfile.TemporaryDirectory(prefix="myomorph-") as folder:
        job, binary, answer = (Path(folder) / name for name in ("job.json", "model.mjb", "answer.json"))
        job.write_text(json.dumps({"path": str(path.resolve()), "missing": missing}), encoding="utf-8")
        outcome = run_guarded("myomorph.io.mjcf.compile", [str(job), str(binary), str(answer)], time_limit)
        if outcome.status == "hung":
            hint = "is a mesh very large, or a length range not given for its muscles?"
            raise BadFile(path, f"MuJoCo did not compile it within {time_limit:g} s", hint)
        if outcome.status == "failed":
            raise BadFile(path, f"MuJoCo stopped while compiling it ({outcome.message})")
        result = json.loads(answer.read_text(encoding="utf-8"))
        if result["error"]:
            raise BadFile(
                path, f"MuJoCo cannot compile it: {_one_line(result['error'])}", _hint(missing, result["error"])
            )
        compiled = mujoco.MjModel.from_binary_path(str(binary))
    kept = [
        Kept("missing file", name, "the file does not exist: its geoms are left out", "", "asset") for name in missing
    ]
    if result["weightless"]:
        effect = "the mass of the missing meshes of these bodies is left out"
        kept.append(Kept("missing inertia", ", ".join(result["weightless"]), effect, "", "asset"))
    return compiled, kept


def check_files(path: Path, root: Path | None = None) -> list[str]:
    """Mesh and height-field files that a model names and that do not exist, as the text writes them.

    Raises
    ------
    BadFile : the text, or one that it includes, is not safe XML, is not MJCF, or names a file outside
        of the model's folder tree (the rule is told at `read_mjcf`)
    """
    survey = _Survey(path, (root or tree_of(path)).resolve())
    document = read_xml(path)
    if str(document.root.tag).lower() != "mujoco":
        problem = f"is XML of another kind: its outermost element is <{document.root.tag}>, not <mujoco>"
        raise BadFile(path, problem, "give an MJCF file")
    survey.seen.add(path.resolve())
    _walk(document.root, path.parent, survey)
    missing = []
    for kind, name, folder in survey.assets:
        file = _inside(name, folder, survey, kind)
        if file is None or not file.exists():
            if kind in ("mesh", "hfield"):
                missing.append(name)
        elif file.stat().st_size > LARGEST_ASSET:
            raise BadFile(path, f"{kind} file '{name}' is larger than {LARGEST_ASSET / 2**20:.0f} MiB")
    return missing


def tree_of(path: Path) -> Path:
    """Top folder of the tree that a model belongs to: package, checkout, folder with a license, or its own."""
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
    """Collect the files that an element and its children name; follow includes."""
    tag = str(element.tag).lower()
    if tag == "compiler":
        for key in ("assetdir", "meshdir", "texturedir", "strippath"):
            if key in element.attrib:
                survey.folders[key] = element.get(key)
    elif tag in ("include", "model") and "file" in element.attrib:
        _include(element.get("file"), folder, survey, tag)
    elif tag == "texture":
        survey.assets += [("texture", element.get(key), folder) for key in TEXTURE_FILES if key in element.attrib]
    elif tag in ("mesh", "hfield", "skin", "flexcomp") and "file" in element.attrib:
        survey.assets.append((tag, element.get("file"), folder))
    for child in element:
        _walk(child, folder, survey)


def _include(name: str, folder: Path, survey: _Survey, tag: str) -> None:
    # MuJoCo looks beside the main file first, then beside the including one.
    for start in (survey.main.parent, folder):
        file = _inside(name, start, survey, tag, look=False)
        if file is not None and file.exists():
            break
    else:
        raise BadFile(survey.main, f"its <{tag}> file '{name}' does not exist", "is the model's folder complete?")
    if file in survey.seen:
        return
    survey.seen.add(file)
    if len(survey.seen) > MOST_FILES:
        raise BadFile(survey.main, f"includes more than {MOST_FILES} files")
    _walk(read_xml(file).root, file.parent, survey)


def _inside(name: str, folder: Path, survey: _Survey, kind: str, look: bool = True) -> Path | None:
    """Where a file that a model names lies; None for an absolute path of another machine.

    Raises `BadFile` where that is outside of the model's tree.
    """
    plain = name.replace("\\", "/")
    absolute = ntpath.isabs(name) or os.path.isabs(name) or bool(ntpath.splitdrive(name)[0])
    if absolute and not Path(name).exists():
        return None
    if look:
        if survey.folders.get("strippath", "").lower() == "true":
            plain, absolute = plain.rsplit("/", 1)[-1], False
        key = "texturedir" if kind == "texture" else "meshdir"
        below = survey.folders.get(key, survey.folders.get("assetdir", "")).replace("\\", "/")
        folder = survey.main.parent / below
    file = Path(name if absolute else os.path.normpath(folder / plain)).resolve()
    if not file.is_relative_to(survey.tree):
        problem = f"its {kind} file '{name}' lies outside of the model's folder '{survey.tree}'"
        raise BadFile(survey.main, problem, "put the file inside, or name the model's top folder (root=...)")
    return file


def _hint(missing: list[str], error: str) -> str:
    if missing and "mass" in error:
        return f"bodies have no mass without the missing meshes ({', '.join(missing[:3])}, ...): get these files"
    return "does it open in MuJoCo's own viewer?"


def _one_line(text: str) -> str:
    return " ".join(text.split())

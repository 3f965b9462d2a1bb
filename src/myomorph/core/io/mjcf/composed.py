"""Models of the package `myo-sim`: composed once, and kept in the folder of kernels.

MuJoCo composes a model of many files, which takes longer than a short recording. What comes out
does not depend on the run, so it is kept with a digest, by the files of the package, the versions
and our own sources. Whatever differs or is damaged is composed anew.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import pickle
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from myomorph.core.io.formats import COMPOSED
from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.model import Model

HOME = Path(__file__).parent
SOURCES = (HOME, HOME.parents[1] / "model")
"""Folders of what turns a composed model into ours."""
DIGEST_BYTES = 32
SUFFIX = ".model"


def composed_model(name: str | os.PathLike[str]) -> Model:
    """Compose a model of the package `myo-sim`, with its bones.

    Source: Caggiano et al. 2022.

    Parameters
    ----------
    name : as the package has it ("myoarm", "myolegs", ...), with `myo-sim:` before it or without

    Returns
    -------
    the model in meters, radians and kilograms

    Raises
    ------
    BadData : the package is not installed
    BadFile : it has no such model
    """
    name = os.fspath(name).removeprefix(COMPOSED)
    package = importlib.util.find_spec("myo_sim")
    if package is None or package.origin is None:
        raise BadData(f"the model '{name}' comes with the package 'myo-sim': pip install myo-sim")
    whose = f"composed-{_digest(name.encode())[:8]}"
    file = kernel_folder() / f"{whose}-{_stamp(Path(package.origin).parent)}{SUFFIX}"
    kept = _kept(file)
    if kept is not None:
        return kept
    model = _composed(name)
    _keep(model, file, whose)
    return model


def _composed(name: str) -> Model:
    """Let MuJoCo compose a model; `BadFile` where the package has none of this name."""
    # Loaded only where one of its models is composed.
    import myo_sim

    from myomorph.core.io.mjcf.compile import silent_mujoco
    from myomorph.core.io.mjcf.read import model_from_mujoco

    with silent_mujoco():
        try:
            spec = myo_sim.load_spec(name)
        except ValueError as error:
            raise BadFile(COMPOSED + name, "no such model of myo-sim", str(error)) from None
        compiled = spec.compile()
    # Meshes are looked for beside a model's source.
    return model_from_mujoco(compiled, name=name, source=str(myo_sim.MODELS_DIR / name))


def _kept(file: Path) -> Model | None:
    """Read a model that was kept; None where there is none, or it is damaged."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest = content[:DIGEST_BYTES]
    pickled = content[DIGEST_BYTES:]
    if hashlib.sha256(pickled).digest() != digest:
        return None
    model: Model = pickle.loads(pickled)
    return model


def _keep(model: Model, file: Path, whose: str) -> None:
    """Write a model where that can be done, in the place of older ones of its name."""
    pickled = pickle.dumps(model, pickle.HIGHEST_PROTOCOL)
    unfinished = file.with_suffix(f".{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(hashlib.sha256(pickled).digest() + pickled)
        unfinished.replace(file)
        for old in file.parent.glob(f"{whose}-*{SUFFIX}"):
            if old != file:
                old.unlink(missing_ok=True)
    except OSError:
        # A folder that cannot be written costs time alone.
        return


def _stamp(package: Path) -> str:
    """Hash of all that a composed model depends on but its name."""
    parts = [sys.version, version("mujoco"), version("numpy"), version("myo-sim"), str(package)]
    parts += [_digest(path.read_bytes()) for home in SOURCES for path in sorted(home.glob("*.py"))]
    return _digest("\n".join((*parts, *_state_of(package))).encode())[:16]


def _state_of(package: Path) -> Iterator[str]:
    """Yield names, sizes and times of the files of a package."""
    for path in sorted(package.rglob("*")):
        status = path.stat()
        if path.suffix != ".pyc" and path.is_file():
            yield f"{path.relative_to(package)} {status.st_size} {status.st_mtime_ns}"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()

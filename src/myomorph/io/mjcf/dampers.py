"""Dampers of joints and tendons put into an MJCF file, all else as it is."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from myomorph.io.mjcf.compile import silent_mujoco
from myomorph.io.parsing.text import written
from myomorph.model.errors import BadFile


def write_dampers(path: Path, out: Path, joints: Mapping[str, float], muscles: Mapping[str, float]) -> None:
    """Write the MJCF of `path` with damping of its joints [N m s/rad] and of its muscles' tendons [N s/m].

    Raises
    ------
    BadFile : MuJoCo cannot read the file, or a part is not in it
    """
    with silent_mujoco():
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            for name, value in joints.items():
                _damp(spec.joint(name), value)
            for name, value in muscles.items():
                _damp(spec.tendon(spec.actuator(name).target), value)
            spec.compile()
            spec.meshdir = os.path.relpath(path.resolve().parent / spec.meshdir, out.resolve().parent)
            spec.texturedir = os.path.relpath(path.resolve().parent / spec.texturedir, out.resolve().parent)
            text = spec.to_xml()
        except (ValueError, AttributeError, KeyError) as error:
            raise BadFile(path, f"takes no dampers ({error})", "a joint or muscle needs the model's name") from None
    with written(out) as stream:
        stream.write(text)


def _damp(part: Any, value: float) -> None:
    # MuJoCo since 3.5 has powers of the speed beside it.
    part.damping = np.array([value, *np.zeros(len(part.damping) - 1)]) if np.ndim(part.damping) else value

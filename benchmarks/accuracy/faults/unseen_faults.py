"""Faults of forces in held-out recordings: raw C3D files, each through the commands of a user.

No threshold was set with these recordings. `myomorph analyze --prepare` writes the study, whose
steps are cut short after inverse dynamics, and `myomorph run` runs it. The results are a model, a
motion and forces on feet, into which the faults of `faults.FORCE_FAULTS` are put.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import myomorph as mm
from benchmarks.accuracy.faults.faults import (
    FORCE_FAULTS,
    Fault,
    Recorded,
    Row,
    counted_faults,
    late,
    scaled_mass,
)
from myomorph.lab.cli import main
from myomorph.lab.study.inputs.external_forces import on_feet

SAMPLES = "c3d-vendor-samples/C3DSamples"
GAIT = "c3d-gait-plugingait"
CARRIED = re.compile(r"the plates carry ([\d.]+) kg")


@dataclass(frozen=True)
class Raw:
    """A recording as a laboratory has it.

    `mass`: of the subject where the set says it, else a guess that the plates correct [kg].
    """

    name: str
    file: str
    mass: float = 65.0


RAW = (
    Raw("OpenSim's walk 2", "c3d-opensim-walking/walking2.c3d"),
    Raw("OpenSim's walk 5", "c3d-opensim-walking/walking5.c3d"),
    Raw("Plug-in Gait, first person", f"{GAIT}/HC030A/Straight/HC030A05.c3d", 45.8),
    Raw("Plug-in Gait, first person, a turn", f"{GAIT}/HC030A/Turn/HC030A22.c3d", 45.8),
    Raw("Plug-in Gait, second person", f"{GAIT}/HC002D/Straight/HC002D06.c3d", 32.1),
    Raw("Plug-in Gait, second person, a turn", f"{GAIT}/HC002D/Turn/HC002D25.c3d", 32.1),
    Raw("vendor, functional walk", f"{SAMPLES}/others/FunctionalWalk.c3d"),
    Raw("vendor, gait", f"{SAMPLES}/others/Gait.c3d"),
    Raw("vendor, flat-foot walk", f"{SAMPLES}/PiG/PiG_Motion-FlatFoot-Full.c3d"),
    Raw("vendor, sample 1", f"{SAMPLES}/c3d.org/sample01/Eb015pi.c3d"),
    Raw("vendor, sample 9 with EMG", f"{SAMPLES}/c3d.org/sample09/PlugInC3D.c3d"),
)

FAULTS = (
    *FORCE_FAULTS,
    Fault("model 10 % too heavy", ("mass",), scaled_mass(1.1)),
    Fault("model 10 % too light", ("mass",), scaled_mass(0.9)),
    Fault("forces 25 ms late", ("clock",), late(0.025)),
    Fault("forces 25 ms early", ("clock",), late(-0.025)),
)
"""All faults, and those that have a size at about half of it: just above what the checks promise to
name.
"""


def injected_unseen(folder: Path) -> Iterator[Row]:
    """Put faults of forces into held-out recordings.

    The rows count how many were corrected, found and missed.
    """
    found = (of_the_plates(folder, raw)[0] for raw in RAW)
    return counted_faults(FAULTS, [one for one in found if one is not None])


def clean_unseen(folder: Path) -> Iterator[Row]:
    """List the findings on the same recordings without faults, and why one took no part."""
    for raw in RAW:
        one, said = of_the_plates(folder, raw)
        found = () if one is None else on_feet(one.wrenches, one.model, one.motion).findings
        yield {
            "recording": raw.name,
            "frames": 0 if one is None else len(one.motion),
            "mass [kg]": float("nan") if one is None else one.model.mass,
            "reported": "; ".join(each.text for each in found) or "nothing"
            if one is not None
            else f"left out: {said}",
        }


@cache
def of_the_plates(folder: Path, raw: Raw) -> tuple[Recorded | None, str]:
    """Return a recording whose model weighs what the plates carry.

    Its mass changes only where the plates show another mass than was specified.
    """
    one, said = analyzed(folder, raw)
    if one is None:
        return one, said
    matches = [
        CARRIED.search(each.text) for each in on_feet(one.wrenches, one.model, one.motion).findings
    ]
    masses = [float(each.group(1)) for each in matches if each is not None]
    return (scaled_mass(masses[0] / one.model.mass)(one) if masses else one), said


@cache
def analyzed(folder: Path, raw: Raw) -> tuple[Recorded | None, str]:
    """Return model, motion and forces of a recording by the commands.

    Where there are none, the result is None with the last line that was printed.
    """
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "out"
        steps = ("calibrate", "ik", "id")
        status, said = through_the_commands(
            out, steps, folder / raw.file, "--mass", f"{raw.mass:g}"
        )
        if status:
            return None, said.rpartition("\n")[2].replace(f"{folder / raw.file}: ", "")
        ((_, trial),) = mm.load(out).items()
        if trial.motion is None or trial.wrenches is None:
            return None, "no forces on feet"
        return Recorded(
            name=raw.name,
            model=mm.read_model(out / "calibrated.osim"),
            motion=trial.motion,
            wrenches=trial.wrenches,
        ), said


def through_the_commands(out: Path, steps: Sequence[str], *words: object) -> tuple[int, str]:
    """Return the exit status of the commands and all that they print.

    They are `analyze --prepare` and `run` of its study, cut short to some steps.
    """
    status, said = typed("analyze", *words, "--prepare", "--out", out)
    if status:
        return status, said
    study = out / "study.toml"
    short = re.sub(
        r"(?m)^steps = \[.*\]$", f"steps = {json.dumps(steps)}", study.read_text(encoding="utf-8")
    )
    study.write_text(short, encoding="utf-8")
    status, also = typed("run", study, "--out", out, "--workers", "1")
    return status, f"{said}\n{also}"


def typed(*words: object) -> tuple[int, str]:
    """Exit status of a command, and all that it printed."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = main([str(one) for one in words])
    return status, said.getvalue().strip()

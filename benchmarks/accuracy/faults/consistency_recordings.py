"""Recordings whose markers, plates and body agree, into which faults are put."""

from __future__ import annotations

import contextlib
import io
import tempfile
import tomllib
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

import myomorph as mm
from benchmarks.accuracy.faults.consistency_faults import Case, heavier
from benchmarks.accuracy.laboratory.analyze import GAIT
from benchmarks.recordings import RECORDINGS, read_markers
from myomorph.core.motion.sync import cut
from myomorph.lab.cli import main
from myomorph.lab.study.inputs.external_forces import ForceFile, on_feet, raw_loads

MARGIN = 0.15
"""Time by which forces are recorded longer than markers, at both ends [s]."""
VENDORS = "c3d-vendor-samples/C3DSamples"
OPENSIM = "c3d-opensim-walking"

Looked: TypeAlias = Literal["faults", "other sizes", "clean"]
"""What of a recording was looked at while the test was made: its faults, faults of other sizes, or
the recording as it is.
"""


@dataclass(frozen=True, kw_only=True)
class Recorded(ABC):
    """A recording with a model of its person.

    Attributes
    ----------
    name : laboratory and movement
    looked : at while the test was made
    put_in : whether faults are put into it; else it is looked at as it is only
    """

    name: str
    looked: Looked
    put_in: bool = True

    @abstractmethod
    def parts(self, folder: Path) -> Case:
        """Read model, markers and forces, as they are recorded, from the data collection."""

    def case(self, folder: Path) -> Case:
        """Bring model, markers and forces together, forces longer than markers.

        Parameters
        ----------
        folder : of the data collection

        Returns
        -------
        with what is wrong with the recording itself put right
        """
        case = self.parts(folder)
        motion = mm.inverse_kinematics(case.model, case.markers).motion
        seen = motion.time[np.isfinite(motion.values).all(axis=1)]
        wrenches = case.wrenches
        first = max(float(seen[0]), float(wrenches.time[0]) + MARGIN)
        last = min(float(seen[-1]), float(wrenches.time[-1]) - MARGIN)
        sound = on_feet(wrenches, case.model, motion)
        return replace(
            case,
            markers=cut(case.markers, first, last),
            wrenches=replace(sound, findings=(), notes=()),
        )


@dataclass(frozen=True, kw_only=True)
class Scaled(Recorded):
    """A recording that comes with a model.

    Attributes
    ----------
    files : its name among the recordings of the data collection
    mass : that the plates weigh, where the model is not of the person's mass [kg]
    fitted : whether lengths and markers of the model are fitted to the recording first
    """

    files: str
    mass: float | None = None
    fitted: bool = False

    def parts(self, folder: Path) -> Case:
        """Read model, markers and forces; see `Recorded`."""
        files = RECORDINGS[self.files]
        model = mm.read_model(folder / files.model)
        markers = read_markers(folder / files.markers)
        if self.fitted:
            model = mm.calibrate(model, [markers]).model
        if self.mass is not None:
            model = heavier(model, self.mass / model.mass)
        motion = mm.inverse_kinematics(model, markers).motion
        wrenches = raw_loads(ForceFile(path=folder / files.loads), model, motion).wrenches
        return Case(model=model, markers=markers, wrenches=wrenches)


@dataclass(frozen=True, kw_only=True)
class Raw(Recorded):
    """A recording without a model, as its laboratory's program writes it.

    `analyze` makes the model, and says how the laboratory's axes stand.

    Attributes
    ----------
    file : below the data collection
    mass : of the person, 0 where plates weigh it in a static trial [kg]
    """

    file: str
    mass: float = 0.0

    def parts(self, folder: Path) -> Case:
        """Let `analyze` make a model; see `Recorded`."""
        path = folder / self.file
        with tempfile.TemporaryDirectory() as name:
            out = Path(name) / "out"
            words = ["analyze", str(path), "--out", str(out), "--workers", "1"]
            if self.mass:
                words += ["--mass", f"{self.mass:g}"]
            said = io.StringIO()
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                status = main(words)
            if status:
                raise RuntimeError(f"{self.file}: {said.getvalue().splitlines()[-1]}")
            model = mm.read_model(out / "calibrated.osim")
            (subject,) = tomllib.loads((out / "study.toml").read_text("utf-8"))["subject"]
        laboratory = mm.Laboratory(subject.get("up", ""), subject.get("turn", 0.0))
        markers = laboratory.trial(mm.read_recording(path)).markers
        assert markers is not None
        motion = mm.inverse_kinematics(model, markers).motion
        loads = raw_loads(ForceFile(path=path, laboratory=laboratory), model, motion)
        return Case(model=model, markers=markers, wrenches=loads.wrenches)


RECORDED: tuple[Recorded, ...] = (
    Scaled(name="Rajagopal, walk", files="rajagopal", looked="faults"),
    Scaled(name="OpenCap, drop jump", files="opencap-jump", looked="faults"),
    Scaled(name="Hamner, run at 2 m/s", files="run-2", mass=82.0, fitted=True, looked="faults"),
    Scaled(name="gait2354, walk", files="gait2354", looked="other sizes"),
    Scaled(name="Lenhart, walk", files="lenhart", mass=73.2, looked="other sizes"),
    Scaled(name="instrumented knee, walk 1", files="implant-1", mass=83.0, looked="other sizes"),
    Scaled(name="instrumented knee, walk 3", files="implant-3", mass=83.0, looked="other sizes"),
    Scaled(name="OpenCap, walk", files="opencap-walk", looked="other sizes"),
    Scaled(name="OpenCap, rising", files="opencap-rise", looked="other sizes"),
    Scaled(
        name="Hamner, run at 5 m/s", files="run-5", mass=82.0, fitted=True, looked="other sizes"
    ),
    Raw(
        name="McGill, a child's walk",
        file=f"{GAIT}/HC002D/Straight/HC002D06.c3d",
        looked="other sizes",
    ),
    Raw(name="McGill, a child turns", file=f"{GAIT}/HC002D/Turn/HC002D25.c3d", looked="clean"),
    Raw(name="McGill, a boy's walk", file=f"{GAIT}/HC030A/Straight/HC030A05.c3d", looked="clean"),
    Raw(name="McGill, a boy turns", file=f"{GAIT}/HC030A/Turn/HC030A22.c3d", looked="clean"),
    Raw(
        name="vendors' samples, walk over two plates",
        file=f"{VENDORS}/others/Gait.c3d",
        mass=62.8,
        looked="clean",
    ),
    Raw(
        name="vendors' samples, Plug-in Gait",
        file=f"{VENDORS}/PiG/PiG_Motion-FlatFoot-Full.c3d",
        mass=45.6,
        looked="clean",
    ),
    Raw(
        name="vendors' samples, walk over three plates",
        file=f"{VENDORS}/others/FunctionalWalk.c3d",
        mass=60.1,
        looked="clean",
    ),
    # Markers are hidden for long, so that faults cannot be put into all frames.
    *(
        Raw(
            name=f"OpenSim's C3D, {file}",
            file=f"{OPENSIM}/{file}.c3d",
            mass=61.0,
            looked="clean",
            put_in=False,
        )
        for file in ("walking5", "walking2", "test_walking")
    ),
)

"""Forward dynamics against OpenSim and MuJoCo: the same body and start, one process, in turns."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
import opensim

import myomorph as mm
from benchmarks.speed.timing import alternate
from data_collection import data_folder
from myomorph.core.model.series import Motion
from myomorph.core.rigid.frames import one_thread
from myomorph.forward.simulate import SimulationOptions, simulate
from myomorph.forward.variants import Variant, simulate_variants

opensim.Logger.setLevelString("Off")
VARIANTS = 200  # Where one takes hundreds of milliseconds
MANY = 5_000
TOLERANCE = 1e-6
STEPS = (0.01, 0.005, 0.002, 0.001, 0.0005)  # Of MuJoCo, that are tried [s]
Start = dict[str, tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A body that begins in a state."""

    file: str
    start: Start
    seconds: float
    tendons: Literal["rigid", "elastic"] = "rigid"
    variants: int = VARIANTS

    @property
    def path(self) -> str:
        """The model's file."""
        return str(data_folder() / "opensim-reference-small" / self.file)

    @cached_property
    def model(self) -> mm.Model:
        """The model."""
        return mm.read_model(self.path)


def _motion(start: Start) -> Motion:
    """Make a motion of one frame of a start."""
    return Motion(
        time=np.zeros(1),
        names=tuple(start),
        values=np.array([[value for value, _ in start.values()]]),
        velocities=np.array([[speed for _, speed in start.values()]]),
    )


class OpenSimRun:
    """A model of OpenSim that runs again and again from its start."""

    def __init__(self, path: str, start: Start, seconds: float):
        self._model = opensim.Model(path)
        self._state = self._model.initSystem()
        coordinates = self._model.getCoordinateSet()
        for name, (value, speed) in start.items():
            coordinates.get(name).setValue(self._state, value, False)
            coordinates.get(name).setSpeedValue(self._state, speed)
        self._model.equilibrateMuscles(self._state)
        self._seconds = seconds

    def __call__(self) -> None:
        """Run once."""
        manager = opensim.Manager(self._model)
        manager.setIntegratorAccuracy(TOLERANCE)
        manager.initialize(opensim.State(self._state))
        manager.integrate(self._seconds)


class MujocoRun:
    """A model of MuJoCo that runs again and again from its start, by RK4."""

    def __init__(self, path: str, start: Start, seconds: float):
        self._model = mujoco.MjModel.from_xml_path(path)
        self._model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        self._data = mujoco.MjData(self._model)
        self._start = start
        self._seconds = seconds
        exact = self.end(STEPS[-1] / 10.0)
        # The longest step whose end is as near to the truth as ours.
        self.step = next(
            (step for step in STEPS if np.abs(self.end(step) - exact).max() < TOLERANCE), STEPS[-1]
        )

    def end(self, step: float) -> np.ndarray:
        """Integrate by steps of one length.

        Parameters
        ----------
        step : [s]

        Returns
        -------
        (coordinates,) at the end
        """
        self._model.opt.timestep = step
        mujoco.mj_resetData(self._model, self._data)
        for name, (value, speed) in self._start.items():
            self._data.joint(name).qpos[0] = value
            self._data.joint(name).qvel[0] = speed
        for _ in range(round(self._seconds / step)):
            mujoco.mj_step(self._model, self._data)
        return self._data.qpos.copy()

    def __call__(self) -> None:
        """Run once."""
        self.end(self.step)


def _row(name: str, case: Case, theirs: str, program: Callable[[], object]) -> dict[str, object]:
    """Compare a body with another program."""
    motion = _motion(case.start)
    options = SimulationOptions(
        seconds=case.seconds,
        rate=1.0 / case.seconds,
        tolerance=TOLERANCE,
        tendons=case.tendons,
    )
    variants = [Variant(start=motion)] * case.variants
    programs: dict[str, Callable[[], object]] = {
        "ours": partial(simulate, case.model, motion, options=options),
        "theirs": program,
    }
    many = partial(simulate_variants, case.model, variants, options=options)
    with one_thread():
        medians = alternate(programs)
        each = alternate({"many": many}, rounds=1)["many"] / case.variants
    return {
        "body": name,
        "simulated [s]": case.seconds,
        "ours [ms]": 1e3 * medians["ours"],
        "variants": case.variants,
        "ours, one of them [ms]": 1e3 * each,
        "program": theirs,
        "theirs [ms]": 1e3 * medians["theirs"],
        "ratio": medians["theirs"] / medians["ours"],
        "ratio, one of many": medians["theirs"] / each,
    }


def run() -> list[dict[str, object]]:
    """Measure a row for each body and program."""
    pendulum = Case(
        file="DoublePendulum3D.osim",
        start={"r1_z": (1.0, 0.5), "r2_x": (-0.7, 1.0)},
        seconds=1.0,
        variants=MANY,
    )
    arm = Case(
        file="arm26_bounds.osim",
        start={"r_shoulder_elev": (0.2, 0.0), "r_elbow_flex": (0.8, 0.0)},
        seconds=0.2,
        tendons="elastic",
    )
    with tempfile.TemporaryDirectory() as folder:
        exported = Path(folder) / "pendulum.xml"
        mm.write_mjcf(pendulum.model, exported)
        in_mujoco = MujocoRun(str(exported), pendulum.start, pendulum.seconds)
        return [
            _row(
                "double pendulum",
                pendulum,
                "OpenSim's Manager",
                OpenSimRun(pendulum.path, pendulum.start, pendulum.seconds),
            ),
            _row(
                "double pendulum",
                pendulum,
                f"MuJoCo's RK4, {1e3 * in_mujoco.step:g} ms a step",
                in_mujoco,
            ),
            _row(
                "arm, 6 muscles on elastic tendons",
                arm,
                "OpenSim's Manager",
                OpenSimRun(arm.path, arm.start, arm.seconds),
            ),
        ]

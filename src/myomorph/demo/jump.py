"""The main job on an embedded default: from markers to a report, on data that come with the installation."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from myomorph.model.errors import UnknownName
from myomorph.model.model import Model
from myomorph.motion.ik import InverseKinematicsOptions
from myomorph.store.outcome import Outcome
from myomorph.store.results import file_source, value_source
from myomorph.store.settings import Differentiation
from myomorph.study.trial.ahead import TENDONS, compile_ahead, compile_curves, compile_motion, compiling
from myomorph.study.trial.run_take import run_take
from myomorph.study.trial.take import CHAIN, Take

DemoName = Literal["jump", "simulated", "judo"]
STEPS = (*CHAIN, "report")


def run_demo(name: str, out: Path) -> Outcome:
    """Run the whole chain on a demo and write tables, NetCDF and `report.html` into a folder.

    Raises
    ------
    UnknownName
        where there is no such demo
    """
    # Making the recording needs all kernels already: on a new machine both processes compile at once.
    ahead = compile_ahead(STEPS, frozenset() if name == "judo" else frozenset({TENDONS}))
    try:
        if ahead.works:
            with compiling():
                compile_curves()
                compile_motion()
                ahead.join()
    finally:
        ahead.stop()
    if name == "judo":
        from myomorph.demo.judo import run_judo_demo

        return run_judo_demo(out)
    return run_take(demo_take(name), STEPS, out, fresh=True)


def demo_take(name: str) -> Take:
    """A demo's recording, ready for the steps.

    "jump": a recorded countermovement jump (package `biomdp`) with a leg model (package `myo-sim`);
    "simulated": a full-body squat that the project simulates, with known truth; "judo": two simulated fighters who pull
    on each other, every force known.

    Raises
    ------
    UnknownName
        where there is no such demo
    """
    if name == "jump":
        return _jump_take()
    if name == "simulated":
        from myomorph.simulate.squat import simulated_take

        return simulated_take()
    if name == "judo":
        from myomorph.demo.judo import BOUT, CUTOFF, judo_take
        from myomorph.simulate.pair import virtual_pair

        return judo_take(virtual_pair(BOUT, CUTOFF))
    raise UnknownName("study", name, get_args(DemoName), "the demo")


def demo_model(name: str) -> Model:
    """The model of a demo's recording; raises `UnknownName`."""
    if name == "judo":
        from myomorph.demo.judo import judo_model

        return judo_model()
    return demo_take(name).model


def _jump_take() -> Take:
    from myomorph.motion.envelope import envelopes
    from myomorph.simulate.jump import jump_study

    jump = jump_study()
    weights = {name: weight for name, weight in jump.marker_weights.items() if name in jump.markers.names}
    return Take(
        name="countermovement jump",
        subject="jumper",
        model=jump.model,
        markers=jump.markers,
        loads=lambda motion: jump.wrenches,
        emg=envelopes(jump.analog),
        events=jump.events,
        mass=jump.mass,
        time=jump.window,
        kinematics=InverseKinematicsOptions(marker_weights=MappingProxyType(weights)),
        derivatives=Differentiation(jump.cutoff),
        plates=jump.trial.plates,
        real=jump.real,
        assumed=jump.assumed,
        sources=(
            value_source("model", "demo:jump", *(np.append(body.mass_center, body.mass) for body in jump.model.bodies)),
            file_source("recording", jump.source),
        ),
    )

"""The main job on an embedded default: from markers to a report.

The data come with the installation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from myomorph.core.model.errors import UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.known import Known
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Series, Trial, Wrenches
from myomorph.core.model.shown import shown
from myomorph.core.motion.envelope import envelopes
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import file_source, value_source
from myomorph.lab.store.settings import Differentiation
from myomorph.lab.study.inputs.emg import RecordedEmg
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.markers import Recording
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.inputs.session import RecordedSession
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.inputs.truth import KnownTruth
from myomorph.lab.study.step.step_table import usual_steps
from myomorph.lab.study.trial.run_trial import run_trial
from myomorph.lab.study.trial.trial_inputs import TrialInputs, TrialNotes
from myomorph.lab.study.workers.ahead import (
    TENDONS,
    compile_ahead,
    compile_curves,
    compile_motion,
    compiling,
)

DemoName = Literal["jump", "simulated"]
DEMO_STEPS = usual_steps()


def run_demo(name: str, out: Path) -> Outcome:
    """Run the whole chain on a demo and write tables, NetCDF and `report.html` into a folder."""
    # Making the recording needs all kernels already: on a new machine both processes compile at
    # once.
    ahead = compile_ahead(DEMO_STEPS, frozenset({TENDONS}))
    try:
        if ahead.works:
            with compiling():
                compile_curves()
                compile_motion()
                ahead.join()
    finally:
        ahead.stop()
    return run_trial(demo_trial(name), DEMO_STEPS, out, fresh=True)


def demo_trial(name: str) -> TrialInputs:
    """Return a demo's recording, ready for the steps.

    "jump" is a recorded countermovement jump (package `biomdp`) with a leg model (package
    `myo-sim`). "simulated" is a full-body squat that the project simulates, with known truth.
    """
    if name == "jump":
        return _jump_trial()
    if name == "simulated":
        from myomorph.show.simulate.squat import simulated_trial

        return simulated_trial()
    raise UnknownName("study", name, existing=get_args(DemoName), where="the demo")


@shown
@dataclass(frozen=True, eq=False)
class DemoRecording:
    """The recording of a demo, as values.

    Attributes
    ----------
    model : of the body
    markers : recorded, or simulated
    kinematics : options of its inverse kinematics
    wrenches : forces on the feet
    window : (start, end) of what is worth using [s]
    cutoff : low-pass of motion and forces [Hz]
    truth : motion, torques and activations where they are known, by these names
    notes : what is real, assumed and simulated, a sentence each
    """

    model: Model
    markers: Markers
    kinematics: InverseKinematicsOptions
    wrenches: Wrenches
    window: tuple[float, float]
    cutoff: float
    truth: Mapping[str, Series]
    notes: tuple[str, ...]


def demo_recording(name: Literal["jump", "simulated"] = "simulated") -> DemoRecording:
    """Return the recording of `myomorph demo`, which comes with the installation.

    Parameters
    ----------
    name : "jump", a countermovement jump that was recorded; "simulated", a squat that the project
        simulates

    Returns
    -------
    model, markers, forces on the feet [N], and the truth where it is known

    Raises
    ------
    BadData, MissingPackage
        where the packages that bring model or recording are not installed
    UnknownName
        where there is no such recording

    Examples
    --------
    >>> import myomorph as mm
    >>> jump = mm.demo_recording("jump")
    >>> jump.wrenches.bodies, round(jump.model.mass, 1), jump.window
    (('calcn_r', 'calcn_l'), 76.7, (3.0, 5.6))
    """
    if name not in ("jump", "simulated"):
        raise UnknownName("recording", name, existing=("jump", "simulated"), where="the demos")
    trial = demo_trial(name)
    markers = trial.recording.markers
    assert markers is not None
    span = trial.inputs.get(TimeSpan)
    truth = trial.get(KnownTruth)
    return DemoRecording(
        model=trial.model,
        markers=markers,
        kinematics=trial.options[InverseKinematicsOptions],
        wrenches=trial.inputs[ExternalLoads].of(
            Motion(markers.time, (), np.zeros((len(markers), 0)))
        ),
        window=(float(markers.time[0]), float(markers.time[-1]))
        if span is None or span.time is None
        else span.time,
        cutoff=trial.options[Differentiation].cutoff or 0.0,
        truth=FrozenMap({}) if truth is None else truth.series,
        notes=(*trial.notes.real, *trial.notes.assumed, *trial.notes.simulated),
    )


def demo_model(name: str) -> Model:
    """Return the model of a demo's recording; raises `UnknownName`."""
    if name == "jump":
        # Without the rest of its trial, as EMG.
        from myomorph.show.simulate.jump import jump_study

        return jump_study().model
    return demo_trial(name).model


def _jump_trial() -> TrialInputs:
    from myomorph.show.simulate.jump import jump_study

    jump = jump_study()
    weights = {
        name: weight for name, weight in jump.marker_weights.items() if name in jump.markers.names
    }
    return TrialInputs(
        name="countermovement jump",
        subject="jumper",
        model=jump.model,
        options=OptionSet(
            InverseKinematicsOptions(marker_weights=FrozenMap(weights)),
            Differentiation(jump.cutoff),
        ),
        inputs=ByType().having(
            Recording(Trial(jump.markers, jump.trial.plates, events=jump.events)),
            ExternalLoads.on_known_bodies(lambda motion: jump.wrenches),
            RecordedEmg(envelopes(jump.analog)),
            BodyMass(jump.mass),
            RecordedSession(movement=Known(value="jumping", origin="user")),
            TimeSpan(jump.window),
        ),
        notes=TrialNotes(jump.real, jump.assumed),
        sources=(
            value_source(
                "model",
                "demo:jump",
                *(np.append(body.mass_center, body.mass) for body in jump.model.bodies),
            ),
            file_source("recording", jump.source),
        ),
    )

"""Samples of the main job: simulated walk, run, squat and mouse, and a recorded jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.io.samples import Sample, SampleSource
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Series, Trial
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.rigid.tree import compile_tree
from myomorph.show.simulate.gait.mouse import simulated_mouse
from myomorph.show.simulate.gait.plan import RUN, WALK, GaitPlan
from myomorph.show.simulate.gait.walker import MASS, simulated_gait
from myomorph.show.simulate.jump import jump_study
from myomorph.show.simulate.squat import (
    SimulationOptions,
    balancing_wrenches,
    marked_body,
    measured_markers,
    squat_splines,
)

OWN = "Apache-2.0"
BODY = "the model is myo-sim's (Apache-2.0)"
MYO_SIM = "Caggiano et al. 2022, MyoSuite, for the bodies of myo-sim"
CUTOFF = 6.0
CUTOFF_OF_RUN = 12.0  # Low-pass of motion and forces [Hz].


def walk(number: int) -> Sample:
    """Simulate five strides of each side."""
    text = (
        "a person of 70 kg walks with bent knees as planned, in balance over feet with their own"
        f" plates; nobody was recorded, and {BODY}"
    )
    return _gait("walk", WALK, "walking", CUTOFF, text, number)


def run(number: int) -> Sample:
    """Simulate six strides of each side."""
    text = (
        "a person of 70 kg runs as planned; nobody was recorded, and"
        f" {BODY}. In flight planned legs turn the body, which leaves a moment at the pelvis"
    )
    return _gait("run", RUN, "running", CUTOFF_OF_RUN, text, number)


def _gait(
    name: str, plan: GaitPlan, movement: Movement, cutoff: float, text: str, seed: int
) -> Sample:
    gait = simulated_gait(plan, seed)
    return Sample(
        name=name,
        model=gait.model,
        recording=Trial(markers=gait.markers, events=gait.events),
        loads=gait.wrenches,
        mass=MASS,
        movement=movement,
        window=_whole(gait.markers),
        cutoff=cutoff,
        truth=FrozenMap({COORDINATE_VALUE.name: gait.motion}),
        source=SampleSource(kind="simulated", text=text, licence=OWN, citation=MYO_SIM),
    )


def squat() -> Sample:
    """Simulate one squat of a whole body, as `myomorph demo` does, without activations."""
    options = SimulationOptions()
    model = marked_body()
    tree = compile_tree(model)
    splines = squat_splines(model, options)
    motion = splines.at(options.rate, options.duration)
    random = np.random.default_rng(options.seed)
    markers = measured_markers(model, motion, options, random)
    wrenches = balancing_wrenches(tree, splines.at(options.force_rate, options.duration))
    noise = options.force_noise * random.standard_normal(wrenches.forces.shape)
    torques = inverse_dynamics(model, motion, balancing_wrenches(tree, motion))
    truth = {COORDINATE_VALUE.name: motion, GENERALIZED_FORCE.name: torques}
    text = (
        f"a body of {model.mass:.1f} kg (MyoFullBody) squats once with raised arms; nobody was"
        f" recorded, and {BODY}"
    )
    return Sample(
        name="squat",
        model=model,
        recording=Trial(markers=markers),
        loads=replace(wrenches, forces=wrenches.forces + noise),
        mass=model.mass,
        movement="squatting",
        window=_whole(markers),
        cutoff=options.cutoff,
        truth=FrozenMap(truth),
        source=SampleSource(kind="simulated", text=text, licence=OWN, citation=MYO_SIM),
    )


def jump() -> Sample:
    """Take the recorded countermovement jump that the package biomdp brings."""
    study = jump_study()
    weights = {
        name: weight for name, weight in study.marker_weights.items() if name in study.markers.names
    }
    text = (
        "a countermovement jump by Vicon, force plates and EMG; the left leg's markers and its half"
        f" of the force are mirrored from the right, and {BODY}"
    )
    return Sample(
        name="jump",
        model=study.model,
        recording=Trial(markers=study.markers, analog=study.analog, events=study.events),
        loads=study.wrenches,
        mass=study.mass,
        movement="jumping",
        marker_weights=FrozenMap(weights),
        window=study.window,
        cutoff=study.cutoff,
        source=SampleSource(
            kind="recorded",
            text=text,
            licence="MIT (recording, package biomdp)",
            citation="biomdp, Biomechanical Data Processing, on PyPI",
        ),
    )


def mouse(number: int) -> Sample:
    """Simulate a mouse that trots, seen by cameras alone."""
    animal = simulated_mouse(number)
    text = (
        "a mouse of 25 g trots on stick legs with straight muscles, which is no anatomy; no animal"
        " was recorded, and no forces are simulated"
    )
    return Sample(
        name="mouse",
        model=animal.model,
        recording=Trial(markers=animal.markers),
        mass=animal.model.mass,
        movement="walking",
        window=_whole(animal.markers),
        cutoff=25.0,
        truth=FrozenMap({COORDINATE_VALUE.name: animal.motion}),
        source=SampleSource(
            kind="simulated", text=text, licence=OWN, citation="The Myomorph developers"
        ),
    )


def _whole(series: Series) -> tuple[float, float]:
    return float(series.time[0]), float(series.time[-1])

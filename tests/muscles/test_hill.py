"""Rigid-tendon forces against OpenSim and MuJoCo, class by class, over lengths and velocities."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.hill import MODELS, hill_forces

OPENSIM_KINDS = [kind for kind in MODELS if kind != "mujoco"]
SIZES = {"max_isometric_force": 950.0, "optimal_fiber_length": 0.09, "tendon_slack_length": 0.21}

rng = np.random.default_rng(5)
LENGTHS = 0.21 + 0.09 * np.concatenate([np.linspace(-0.21, 1.9, 43), rng.uniform(0.3, 1.6, 20)])
SPEEDS = np.concatenate([np.linspace(-1.1, 1.1, 43), rng.uniform(-0.5, 0.5, 20)])


def sliding_model(*muscles: Muscle) -> Model:
    """Make a body on a slider and muscles from the ground to it."""
    axis = Axis(
        kind="translation", vector=np.array([1.0, 0, 0]), function=linear(1.0), coordinates=("x",)
    )
    joint = Joint(
        name="slider",
        kind="SliderJoint",
        parent="ground",
        child="block",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=(axis,),
        coordinates=("x",),
    )
    body = Body(name="block", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3))
    return Model(
        name="sliding",
        bodies=(body,),
        joints=(joint,),
        coordinates=(Coordinate("x", "translational"),),
        gravity=np.zeros(3),
        muscles=muscles,
    )


CLASS_DEFAULTS = {
    "Thelen2003Muscle": {
        "max_contraction_velocity": 10.0,
        "FmaxTendonStrain": 0.04,
        "FmaxMuscleStrain": 0.6,
        "KshapeActive": 0.45,
        "KshapePassive": 5.0,
        "Af": 0.25,
        "Flen": 1.4,
    },
}
"""What OpenSim's classes begin with, where files of the collection have defaults of their own."""


def muscle(kind: str, pennation: float = 0.0, **parameters: float) -> Muscle:
    """Make a muscle of the class at its default parameters but for those given."""
    path = Path((PathPoint("a", "ground", np.zeros(3)), PathPoint("b", "block", np.zeros(3))))
    return Muscle(
        name=f"{kind}{pennation}",
        kind=kind,
        path=path,
        max_isometric_force=SIZES["max_isometric_force"],
        optimal_fiber_length=SIZES["optimal_fiber_length"],
        tendon_slack_length=SIZES["tendon_slack_length"],
        pennation_at_optimal=pennation,
        parameters=parameters,
    )


def opensim_muscle(kind: str, pennation: float):
    """OpenSim's muscle on a slider, with the system it needs."""
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model = opensim.Model()
    block = opensim.Body("block", 1.0, opensim.Vec3(0), opensim.Inertia(1))
    model.addBody(block)
    joint = opensim.SliderJoint("slider", model.getGround(), block)
    joint.updCoordinate().setName("x")
    model.addJoint(joint)
    made = opensim.Muscle.safeDownCast(opensim.OpenSimObject.newInstanceOfType(kind))
    made.thisown = False
    made.setName("m")
    made.set_max_isometric_force(SIZES["max_isometric_force"])
    made.set_optimal_fiber_length(SIZES["optimal_fiber_length"])
    made.set_tendon_slack_length(SIZES["tendon_slack_length"])
    made.set_pennation_angle_at_optimal(pennation)
    # OpenSim keeps the defaults of a file for all that is made in the same process later.
    for name, value in CLASS_DEFAULTS.get(kind, {}).items():
        opensim.PropertyHelper.setValueDouble(value, made.updPropertyByName(name))
    if kind.startswith(("Millard2012E", "DeGroote")):
        made.set_ignore_tendon_compliance(True)
        exact = getattr(opensim, kind).safeDownCast(made)
        exact.set_fiber_damping(0.0)
        exact.set_default_activation(1.0)
    made.addNewPathPoint("a", model.getGround(), opensim.Vec3(0))
    made.addNewPathPoint("b", block, opensim.Vec3(0))
    model.addForce(made)
    state = model.initSystem()
    return model, model.getMuscles().get(0), state


def evaluate(model, state, length: float, speed: float) -> None:
    coordinate = model.getCoordinateSet().get(0)
    coordinate.setValue(state, length, False)
    coordinate.setSpeedValue(state, speed)
    model.realizeVelocity(state)


@pytest.mark.parametrize("pennation", [0.0, 0.35])
@pytest.mark.parametrize("kind", OPENSIM_KINDS)
def test_active_force_is_that_of_opensims_static_optimization(kind, pennation):
    model, other, state = opensim_muscle(kind, pennation)
    ours = hill_forces(
        sliding_model(muscle(kind, pennation)), LENGTHS[:, None], SPEEDS[:, None], "opensim"
    )
    theirs = np.empty(len(LENGTHS))
    for i, (length, speed) in enumerate(zip(LENGTHS, SPEEDS, strict=True)):
        evaluate(model, state, length, speed)
        theirs[i] = other.calcInextensibleTendonActiveFiberForce(state, 1.0)
    if kind == "DeGrooteFregly2016Muscle":
        # Beyond the maximum velocity OpenSim's curve goes below zero; a muscle does not push.
        theirs = np.maximum(theirs, 0.0)
    # OpenSim stops its own iterations at 0.01 N (deprecated classes) and 1e-6 (Thelen's velocity).
    if kind.endswith("Deprecated"):
        tolerance = 0.05
    elif kind == "Thelen2003Muscle":
        tolerance = 1e-2
    else:
        tolerance = 1e-7
    np.testing.assert_allclose(ours.active[:, 0], theirs, rtol=0, atol=tolerance)
    assert np.ptp(theirs) > 500.0


@pytest.mark.parametrize("kind", ["Millard2012EquilibriumMuscle", "DeGrooteFregly2016Muscle"])
def test_rigid_tendon_forces_are_those_of_opensims_muscle_dynamics(kind):
    model, other, state = opensim_muscle(kind, 0.35)
    lengths = 0.21 + 0.09 * np.linspace(0.35, 1.5, 40)
    speeds = np.linspace(-0.7, 0.7, 40)
    ours = hill_forces(sliding_model(muscle(kind, 0.35)), lengths[:, None], speeds[:, None])
    active = np.empty(40)
    passive = np.empty(40)
    for i, (length, speed) in enumerate(zip(lengths, speeds, strict=True)):
        evaluate(model, state, length, speed)
        model.realizeDynamics(state)
        active[i] = other.getActiveFiberForceAlongTendon(state)
        passive[i] = other.getPassiveFiberForceAlongTendon(state)
    np.testing.assert_allclose(ours.active[:, 0], active, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(ours.passive[:, 0], passive, rtol=1e-9, atol=1e-7)
    assert passive.max() > 100.0


def test_passive_force_of_thelens_muscle_follows_its_formula():
    lengths = 0.21 + 0.09 * np.array([0.5, 1.0, 1.3, 1.6])
    ours = hill_forces(
        sliding_model(muscle("Thelen2003Muscle")), lengths[:, None], np.zeros((4, 1))
    )
    expected = [0.0, 0.0, (np.exp(5 * 0.3 / 0.6) - 1) / (np.exp(5) - 1), 1.0]
    np.testing.assert_allclose(ours.passive[:, 0] / 950.0, expected, atol=1e-12)


@pytest.mark.parametrize("kind", MODELS)
def test_every_class_pulls_with_its_maximum_isometric_force_at_optimal_length(kind):
    pennation = 0.0 if kind == "mujoco" else 0.3
    length = 0.21 + 0.09 * np.cos(pennation)
    ours = hill_forces(
        sliding_model(muscle(kind, pennation)), np.array([[length]]), np.zeros((1, 1))
    )
    # SIMM's generic spline peaks at 0.993 beside the optimal length, and its velocity curve passes
    # 0.9996.
    assert ours.active[0, 0] == pytest.approx(950.0 * np.cos(pennation), rel=1e-2)
    assert ours.active[0, 0] * 0.0 == ours.passive[0, 0] * 0.0


@pytest.mark.parametrize("kind", MODELS)
def test_no_muscle_ever_pushes(kind):
    lengths, speeds = np.meshgrid(0.21 + 0.09 * np.linspace(-2, 3, 60), np.linspace(-3, 3, 60))
    for pennation in (0.0, 0.7):
        model = sliding_model(muscle(kind, pennation))
        for convention in ("rigid-tendon", "opensim"):
            ours = hill_forces(model, lengths.reshape(-1, 1), speeds.reshape(-1, 1), convention)
            assert np.all(np.isfinite(ours.active + ours.passive))
            assert ours.active.min() >= 0.0
            assert ours.passive.min() >= 0.0


def test_mujoco_muscles_have_mujocos_gain_and_bias():
    mujoco = pytest.importorskip("mujoco")
    low = 0.75
    high = 1.05
    force = 730.0
    vmax = 1.5
    curve = {"lmin": 0.5, "lmax": 1.6, "fpmax": 1.3, "fvmax": 1.2}
    length_range = np.array([[0.24], [0.31]])
    optimal = float(np.ptp(length_range)) / (high - low)
    parameters = np.array(
        [[low], [high], [force], [200.0], [0.5], [1.6], [vmax], [curve["fpmax"]], [curve["fvmax"]]]
    )
    ours = Muscle(
        name="m",
        kind="mujoco",
        path=muscle("mujoco").path,
        max_isometric_force=force,
        optimal_fiber_length=optimal,
        tendon_slack_length=0.24 - low * optimal,
        max_contraction_velocity=vmax,
        parameters=curve,
    )
    lengths = rng.uniform(0.05, 0.55, 400)
    speeds = rng.uniform(-0.6, 0.6, 400)
    found = hill_forces(sliding_model(ours), lengths[:, None], speeds[:, None])
    gain = [
        -mujoco.mju_muscleGain(length, speed, length_range, 1.0, parameters)
        for length, speed in zip(lengths, speeds, strict=True)
    ]
    bias = [-mujoco.mju_muscleBias(length, length_range, 1.0, parameters) for length in lengths]
    np.testing.assert_allclose(found.active[:, 0], gain, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.passive[:, 0], bias, rtol=0, atol=1e-10)
    assert max(gain) > 500.0
    assert max(bias) > 500.0


def test_unknown_lengths_give_unknown_forces():
    model = sliding_model(muscle("Millard2012EquilibriumMuscle"), muscle("Thelen2003Muscle", 0.2))
    lengths = np.array([[np.nan, 0.3], [0.3, 0.3], [0.3, 0.3]])
    speeds = np.array([[0.0, 0.0], [0.0, np.nan], [0.0, 0.0]])
    for convention in ("rigid-tendon", "opensim"):
        ours = hill_forces(model, lengths, speeds, convention)
        np.testing.assert_array_equal(np.isnan(ours.active), np.isnan(lengths + speeds))
        np.testing.assert_array_equal(np.isnan(ours.passive), np.isnan(lengths + speeds))


def test_what_cannot_be_a_muscle_is_refused_by_name():
    with pytest.raises(BadModel, match=r"Delp1990Muscle.*Thelen2003Muscle"):
        hill_forces(sliding_model(muscle("Delp1990Muscle")), np.ones((1, 1)), np.ones((1, 1)))
    bad = muscle("Millard2012EquilibriumMuscle", isometric_slope=0.9)
    with pytest.raises(BadModel, match="C-shaped"):
        hill_forces(sliding_model(bad), np.ones((1, 1)), np.ones((1, 1)))
    with pytest.raises(BadData, match=r"\(frames, 1\)"):
        hill_forces(sliding_model(muscle("Thelen2003Muscle")), np.ones((1, 2)), np.ones((1, 2)))

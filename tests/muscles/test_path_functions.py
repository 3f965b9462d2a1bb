"""Paths whose length is a function of coordinates: formulas, slopes, OpenSim, and refusals."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from function_arm import COUPLER, LENGTHS, ONE, PATHS, function_arm, function_path

from myomorph.bones.morph.mirror.model import mirrored
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadFile, BadModel
from myomorph.core.model.functions import SineProduct
from myomorph.core.model.join import join_models
from myomorph.core.model.paths import PathFunction
from myomorph.core.model.polynomial import Polynomial
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.muscles.muscle_paths import muscle_paths
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.solve import solve_tension
from myomorph.exchange.mujoco.export import write_mjcf

SAME = 1e-12


@pytest.fixture
def read(tmp_path):
    """Read a document of `function_arm`."""

    def model(paths, coupler=""):
        path = tmp_path / "arm.osim"
        path.write_text(function_arm(paths, coupler), encoding="utf-8")
        return read_osim(path)

    return model


def _swing(model, frames: int = 41) -> Motion:
    """Smooth motion with its rates."""
    t = np.linspace(0.0, 1.0, frames)
    phases = np.arange(len(model.coordinates))
    values = 0.3 + 0.4 * np.sin(2.0 * t[:, None] + phases)
    velocities = 0.8 * np.cos(2.0 * t[:, None] + phases)
    accelerations = -1.6 * np.sin(2.0 * t[:, None] + phases)
    return Motion(
        t, model.coordinate_names, values, velocities=velocities, accelerations=accelerations
    )


def test_terms_of_a_polynomial_are_in_the_order_of_opensim():
    polynomial = Polynomial(dimension=3, order=3, coefficients=np.eye(20)[6])
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3))
    np.testing.assert_allclose(polynomial(x), x[:, 1] * x[:, 2] ** 2, rtol=SAME)
    assert tuple(polynomial.exponents[-1]) == (3, 0, 0)


def test_slopes_are_those_of_the_values():
    random = np.random.default_rng(1)
    polynomial = Polynomial(dimension=4, order=5, coefficients=random.normal(size=126))
    step = 1e-6
    x = random.uniform(-1.0, 1.0, (7, 4))
    for index in range(4):
        moved = step * np.eye(4)[index]
        rise = polynomial(x + moved) - polynomial(x - moved)
        np.testing.assert_allclose(polynomial.slope(x, index), rise / (2 * step), atol=1e-8)


def test_a_product_of_sines_of_two_coordinates_gives_a_path(read):
    sine = SineProduct(factor=0.3, frequencies=np.array([1.3, 0.6]), phases=np.array([0.1, 0.2]))
    function = PathFunction(coordinates=("elbow_angle", "shoulder_angle"), length=sine)
    model = read({"two": PATHS["two_muscle"]})
    path = replace(model.muscles[0].path, function=function)
    model = replace(model, muscles=(replace(model.muscles[0], path=path),))
    motion = _swing(model)
    result = muscle_kinematics(model, motion)
    angles = (motion["elbow_angle"], motion["shoulder_angle"])
    np.testing.assert_allclose(result.muscle_length[:, 0], sine(*angles), rtol=SAME)
    for index, name in enumerate(function.coordinates):
        arm = result.moment_arm_of("two", name)
        np.testing.assert_allclose(arm, -sine.slope(*angles, index=index), rtol=SAME)


def test_lengths_are_the_functions_and_moment_arms_their_slopes(read):
    model = read(PATHS)
    motion = _swing(model)
    result = muscle_kinematics(model, motion)
    elbow = motion["elbow_angle"]
    shoulder = motion["shoulder_angle"]
    length = 0.4 - 0.03 * shoulder + 0.01 * shoulder**2 + 0.02 * elbow
    length += -0.05 * elbow * shoulder + 0.013 * elbow**2
    np.testing.assert_allclose(result.muscle_length[:, 0], length, rtol=SAME)
    arm = -(0.02 - 0.05 * shoulder + 0.026 * elbow)
    np.testing.assert_allclose(result.moment_arm_of("two_muscle", "elbow_angle"), arm, rtol=SAME)
    assert not result.moment_arm_of("two_muscle", "wrist_angle").any()
    cubic = 0.003 * elbow**3 - 0.01 * elbow**2 - 0.02 * elbow + 0.3
    column = model.muscle_names.index("polynomial_muscle")
    np.testing.assert_allclose(result.muscle_length[:, column], cubic, rtol=SAME)


@pytest.mark.parametrize("coupler", ["", COUPLER])
def test_moment_arms_and_velocities_are_rates_of_length(read, coupler):
    paths = {**PATHS, "over_wrist": function_path(LENGTHS["two"], "wrist", "elbow")}
    model = read(paths, coupler)
    motion = _swing(model, 5)
    result = muscle_kinematics(model, motion)
    step = 1e-6
    free = [name for name in model.coordinate_names if name not in model.dependent_coordinates]
    for name in free:
        moved = step * np.eye(len(motion.names))[motion.names.index(name)]
        ends = [
            muscle_kinematics(
                model,
                Motion(motion.time, motion.names, motion.values + sign * moved),
                velocities=False,
            ).muscle_length
            for sign in (1.0, -1.0)
        ]
        slopes = (ends[0] - ends[1]) / (2.0 * step)
        for column, muscle in enumerate(model.muscle_names):
            np.testing.assert_allclose(
                -result.moment_arm_of(muscle, name), slopes[:, column], atol=1e-8
            )
    rates = [motion.names.index(name) for name in free]
    change = step * np.eye(len(motion.names))[:, rates].sum(axis=1)
    ends = [
        muscle_kinematics(
            model,
            Motion(motion.time, motion.names, motion.values + sign * change * motion.velocities),
            velocities=False,
        ).muscle_length
        for sign in (1.0, -1.0)
    ]
    np.testing.assert_allclose(
        result.muscle_velocity, (ends[0] - ends[1]) / (2.0 * step), atol=1e-8
    )


def test_functions_of_moment_arms_and_velocity_take_the_place_of_slopes(read):
    arm = "<Constant><value>0.04</value></Constant>"
    speed = "<LinearFunction><coefficients>0 0.7 0.1</coefficients></LinearFunction>"
    more = (
        f"<moment_arm_functions>{arm}</moment_arm_functions>"
        f"<lengthening_speed_function>{speed}</lengthening_speed_function>"
    )
    model = read({"own": function_path(ONE["polynomial"], "elbow", more=more)})
    motion = _swing(model)
    result = muscle_kinematics(model, motion)
    np.testing.assert_array_equal(result.moment_arm_of("own", "elbow_angle"), 0.04)
    speeds = motion.velocities[:, motion.names.index("elbow_angle")]
    np.testing.assert_allclose(result.muscle_velocity[:, 0], 0.7 * speeds + 0.1, rtol=SAME)


def test_a_written_model_has_the_same_paths(read, tmp_path):
    more = "<moment_arm_functions><Constant><value>0.04</value></Constant></moment_arm_functions>"
    model = read({**PATHS, "own": function_path(ONE["polynomial"], "elbow", more=more)})
    assert write_osim(model, tmp_path / "copy.osim") == ()
    copy = read_osim(tmp_path / "copy.osim")
    motion = _swing(model)
    first = muscle_kinematics(model, motion)
    second = muscle_kinematics(copy, motion)
    np.testing.assert_allclose(second.muscle_length, first.muscle_length, rtol=SAME)
    np.testing.assert_allclose(second.arms, first.arms, atol=SAME)


def test_opensim_has_the_same_lengths_and_moment_arms(read, tmp_path):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model = read(PATHS)
    motion = _swing(model, 7)
    result = muscle_kinematics(model, motion)
    theirs = opensim.Model(str(tmp_path / "arm.osim"))
    state = theirs.initSystem()
    coordinates = theirs.getCoordinateSet()
    for frame in range(len(motion)):
        for j, name in enumerate(motion.names):
            coordinates.get(name).setValue(state, float(motion.values[frame, j]), False)
            coordinates.get(name).setSpeedValue(state, float(motion.velocities[frame, j]))
        theirs.realizeVelocity(state)
        for m, name in enumerate(model.muscle_names):
            muscle = theirs.getMuscles().get(name)
            assert muscle.getLength(state) == pytest.approx(
                result.muscle_length[frame, m], abs=SAME
            )
            assert muscle.getLengtheningSpeed(state) == pytest.approx(
                result.muscle_velocity[frame, m], abs=SAME
            )
            for coordinate in ("elbow_angle", "shoulder_angle"):
                arm = muscle.computeMomentArm(state, coordinates.get(coordinate))
                ours = result.moment_arm_of(name, coordinate)[frame]
                assert arm == pytest.approx(ours, abs=SAME)


def test_tensions_balance_the_torques(read):
    paths = {"flexor": function_path(ONE["polynomial"], "elbow")}
    paths["extensor"] = function_path(
        "<LinearFunction><coefficients>0.03 0.3</coefficients></LinearFunction>", "elbow"
    )
    model = read(paths)
    motion = _swing(model)
    torques = inverse_dynamics(model, motion)
    tension = solve_tension(model, motion, torques)
    arms = muscle_kinematics(model, motion).moment_arm[:, :, 1]
    reserve = tension.reserve_names.index("reserve_elbow_angle")
    whole = (arms * tension.muscle_force).sum(axis=1) + tension.actuator_force[:, reserve]
    np.testing.assert_allclose(whole, torques.values[:, 1], atol=1e-6)


def test_a_body_twice_as_large_has_paths_twice_as_long(read):
    model = read(PATHS)
    larger = scale(model, {body: np.full(3, 2.0) for body in model.body_names})
    motion = _swing(model)
    np.testing.assert_allclose(
        muscle_kinematics(larger, motion).muscle_length,
        2.0 * muscle_kinematics(model, motion).muscle_length,
        rtol=SAME,
    )


def test_joined_models_keep_their_functions_apart(read):
    model = read(PATHS)
    both = join_models({"a": model, "b": model})
    names = {name for muscle in both.muscles for name in muscle.path.function.coordinates}
    assert names <= set(both.coordinate_names)
    motion = _swing(both)
    result = muscle_kinematics(both, motion)
    alone = muscle_kinematics(
        model, Motion(motion.time, model.coordinate_names, motion.values[:, 3:]), velocities=False
    )
    np.testing.assert_allclose(result.muscle_length[:, 6:], alone.muscle_length, rtol=SAME)


def test_what_needs_points_says_so(read, tmp_path):
    model = read(PATHS)
    with pytest.raises(BadModel, match=r"two_muscle.*needs points of paths"):
        mirrored(model)
    assert muscle_paths(model, _swing(model)).line("two_muscle").shape[1] == 0
    certificate = write_mjcf(model, tmp_path / "arm.xml")
    assert any("6 muscles are left out" in note for note in certificate.notes)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("<order>2</order>", "<order>3</order>", "6 coefficients"),
        ("<order>2</order>", "<order>2000000000</order>", "6 coefficients"),
        ("<dimension>2</dimension>", "<dimension>2000000000</dimension>", "2000000000"),
        ("<dimension>2</dimension>", "<dimension>3</dimension>", "of 3 coordinates, not 2"),
        ("/jointset/shoulder/shoulder_angle", "/jointset/elbow/elbow_angle", "twice"),
    ],
)
def test_a_broken_function_is_named_at_once(tmp_path, old, new, problem):
    text = function_arm({"two": function_path(LENGTHS["two"], "elbow", "shoulder")})
    assert old in text
    path = tmp_path / "arm.osim"
    path.write_text(text.replace(old, new), encoding="utf-8")
    started = time.monotonic()
    with pytest.raises(BadFile, match=problem):
        read_osim(path)
    assert time.monotonic() - started < 1.0

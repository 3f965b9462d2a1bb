"""Scaling a model: OpenSim's `Model::scale` is the oracle, and laws that no rule may break."""

from dataclasses import replace

import numpy as np
import pytest

from mujoco_models import compiled
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Body
from myomorph.core.model.paths import PathPoint
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree

MODELS = (
    "opensim-gait-subject01/experiment/gait2354_simbody.osim",
    "rajagopal-walk-emg/subject_walk_scaled.osim",
)


def scaled_by_opensim(path, factors, keep, mass, folder):
    osim = pytest.importorskip("opensim")
    osim.Logger.setLevelString("Off")
    model = osim.Model(str(path))
    state = model.initSystem()
    scales = osim.ScaleSet()
    for name, factor in factors.items():
        one = osim.Scale()
        one.setSegmentName(name)
        one.setScaleFactors(osim.Vec3(*factor))
        one.setApply(True)
        scales.cloneAndAppend(one)
    model.scale(state, scales, keep, mass)
    model.printToXML(str(folder / "scaled.osim"))
    return read_osim(folder / "scaled.osim")


def opensim_lengths(path):
    """Return path lengths in the default pose, from OpenSim.

    Wrapping does not matter to the rule of scaling.
    """
    osim = pytest.importorskip("opensim")
    model = osim.Model(str(path))
    state = model.initSystem()
    muscles = model.getMuscles()
    return np.array([muscles.get(i).getLength(state) for i in range(muscles.getSize())])


def random_factors(model, seed=0):
    """Uneven for two bodies of three, even for the third: OpenSim has a rule for each."""
    rng = np.random.default_rng(seed)
    names = model.body_names
    return {
        name: np.full(3, rng.uniform(0.8, 1.3)) if i % 3 == 0 else rng.uniform(0.8, 1.3, 3)
        for i, name in enumerate(names)
    }


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("keep", [False, True])
def test_scaling_equals_opensim(data, tmp_path, name, keep):
    before = read_osim(data(name))
    factors = random_factors(before)
    theirs = scaled_by_opensim(data(name), factors, keep, 80.0, tmp_path)
    lengths = iter([opensim_lengths(data(name)), opensim_lengths(tmp_path / "scaled.osim")])
    ours = scale(
        before,
        factors,
        80.0,
        preserve_mass_distribution=keep,
        path_lengths=lambda model: next(lengths),
    )

    def equal(part):
        np.testing.assert_allclose(
            np.array([part(one) for one in zip(ours.bodies, ours.joints, strict=True)]),
            np.array([part(one) for one in zip(theirs.bodies, theirs.joints, strict=True)]),
            rtol=1e-9,
            atol=1e-12,
        )

    equal(lambda pair: pair[0].mass)
    equal(lambda pair: pair[0].mass_center)
    equal(lambda pair: pair[0].inertia)
    equal(lambda pair: pair[1].parent_frame.translation)
    equal(lambda pair: pair[1].child_frame.translation)
    for one, other in zip(ours.joints, theirs.joints, strict=True):
        for axis, same in zip(one.axes, other.axes, strict=True):
            _check_same_function(axis.function, same.function)
    for one, other in zip(ours.markers, theirs.markers, strict=True):
        np.testing.assert_allclose(one.location, other.location, atol=1e-12)
    for one, other in zip(ours.wrap_objects, theirs.wrap_objects, strict=True):
        np.testing.assert_allclose(one.pose.translation, other.pose.translation, atol=1e-12)
        np.testing.assert_allclose(one.size, other.size, atol=1e-12)
    for one, other in zip(ours.muscles, theirs.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=1e-9)
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=1e-9)
        for point, same in zip(one.path.points, other.path.points, strict=True):
            _check_same_point(point, same)


def _check_same_function(one, other):
    for x in (-1.0, 0.2, 1.1):
        arguments = [x] * max(1, other.arity)
        assert float(one(*arguments)) == pytest.approx(float(other(*arguments)), abs=1e-12)


def _check_same_point(one, other):
    if isinstance(one, PathPoint):
        np.testing.assert_allclose(one.location, other.location, atol=1e-12)
    else:
        for f, g in zip(one.functions, other.functions, strict=True):
            assert float(f(0.3)) == pytest.approx(float(g(0.3)), abs=1e-12)


def test_one_factor_for_all_makes_a_larger_twin():
    """Every body's position and the center of mass grow by the factor.

    Couplers of translations are included.
    """
    model = model_from_mujoco(compiled("myolegs"))
    twin = scale(model, dict.fromkeys(model.body_names, (1.2, 1.2, 1.2)))
    assert twin.mass == pytest.approx(model.mass * 1.2**3)
    rng = np.random.default_rng(0)
    angles = [c.motion == "rotational" for c in model.coordinates]
    values = np.where(angles, rng.uniform(0.0, 0.6, (5, len(angles))), 0.0)
    places = []
    for one in (model, twin):
        tree = compile_tree(one)
        c = tree.coordinates_of(Motion(np.arange(5.0), one.coordinate_names, values))
        poses = forward_kinematics(tree, c)
        root = poses.origins[:, 1:2]
        places.append((poses.origins - root, center_of_mass(tree, poses) - root[:, 0]))
    np.testing.assert_allclose(places[1][0], 1.2 * places[0][0], atol=1e-12)
    np.testing.assert_allclose(places[1][1], 1.2 * places[0][1], atol=1e-12)


def test_affine_inertia_is_that_of_the_stretched_points():
    rng = np.random.default_rng(2)
    points = rng.standard_normal((40, 3))
    masses = rng.uniform(0.1, 1.0, 40)
    size = np.array([1.3, 0.7, 1.1])

    def trunk(points):
        center = masses @ points / masses.sum()
        x = points - center
        second = (masses[:, None, None] * x[:, :, None] * x[:, None, :]).sum(axis=0)
        return Body(
            name="trunk",
            mass=masses.sum(),
            mass_center=center,
            inertia=np.trace(second) * np.eye(3) - second,
        )

    model = model_from_mujoco(compiled("mixed"))
    model = replace(model, bodies=(trunk(points), *model.bodies[1:]))
    ours = scale(model, {"trunk": size}, preserve_mass_distribution=True, inertia="affine").body(
        "trunk"
    )
    expected = trunk(points * size)
    np.testing.assert_allclose(ours.mass_center, expected.mass_center, atol=1e-12)
    np.testing.assert_allclose(ours.inertia, expected.inertia, atol=1e-12)


def test_larger_twins_have_longer_paths():
    model = model_from_mujoco(compiled("myolegs"))
    factors = dict.fromkeys(model.body_names, (1.2, 1.2, 1.2))
    twin = scale(model, factors, path_lengths=default_path_lengths)
    np.testing.assert_allclose(
        default_path_lengths(twin), 1.2 * default_path_lengths(model), rtol=1e-9
    )
    for one, other in zip(model.muscles, twin.muscles, strict=True):
        assert other.tendon_slack_length == pytest.approx(1.2 * one.tendon_slack_length)


def test_fiber_and_tendon_keep_their_ratio_to_the_path():
    model = model_from_mujoco(compiled("myolegs"))
    lengths = {id(model): np.full(80, 0.5)}
    twin = scale(
        model,
        {"tibia_r": (1, 1.1, 1)},
        path_lengths=lambda one: lengths.get(id(one), np.full(80, 0.6)),
    )
    for one, other in zip(model.muscles, twin.muscles, strict=True):
        assert other.optimal_fiber_length == pytest.approx(1.2 * one.optimal_fiber_length)
        assert other.tendon_slack_length == pytest.approx(1.2 * one.tendon_slack_length)
        assert other.parameters["L0"] == pytest.approx(other.optimal_fiber_length)


def test_nothing_changes_by_factors_of_one():
    model = model_from_mujoco(compiled("myolegs"))
    same = scale(model, dict.fromkeys(model.body_names, (1.0, 1.0, 1.0)))
    for one, other in zip(model.bodies, same.bodies, strict=True):
        assert one.mass == other.mass
        np.testing.assert_array_equal(one.inertia, other.inertia)
    for one, other in zip(model.muscles, same.muscles, strict=True):
        for point, twin in zip(one.path.points, other.path.points, strict=True):
            np.testing.assert_array_equal(point.location, twin.location)


@pytest.mark.parametrize("factor", [(1, 1), (0, 1, 1), (1, -1, 1), (1, np.nan, 1)])
def test_bad_factors_are_refused(factor):
    model = model_from_mujoco(compiled("mixed"))
    with pytest.raises(BadData, match="trunk"):
        scale(model, {"trunk": factor})


def test_unknown_bodies_and_masses_are_refused():
    model = model_from_mujoco(compiled("mixed"))
    with pytest.raises(UnknownName, match="'trunk'"):
        scale(model, {"trunc": (1, 1, 1)})
    with pytest.raises(BadData, match="mass"):
        scale(model, {}, mass=-3.0)

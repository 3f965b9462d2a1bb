"""Cones and their columns: geometry of the generators, and cost of a force.

Also virtual work against inverse dynamics.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import friction_cone
from scipy.optimize import nnls
from walking import full

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.contacts import Cone, Site, tangents
from myomorph.core.model.errors import BadModel, UnknownName
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.cones import compile_cones
from myomorph.core.tension.terms.contacts import ContactTask, ContactTerm

FOOT = [[0.0, 0.0, -0.02], [0.0, 0.0, 0.02], [0.17, 0.0, 0.0]]


def any_motion(model, frames=3, seed=0) -> Motion:
    """Poses anywhere near the default, with rates and accelerations."""
    rng = np.random.default_rng(seed)
    shape = (frames, len(model.coordinates))
    values = np.array([one.default for one in model.coordinates]) + rng.uniform(-0.3, 0.3, shape)
    tree = compile_tree(model)
    time = 0.1 * np.arange(frames)
    values = tree.coordinates_of(Motion(time, model.coordinate_names, values))
    return Motion(
        time,
        model.coordinate_names,
        values,
        velocities=rng.normal(size=shape),
        accelerations=rng.normal(size=shape),
    )


CONES = {
    "pyramid": Cone(),
    "pyramid of eight in a body": Cone(direction=[0.2, 1.0, 0.1], frame="torso", edges=8),
    "rope": Cone(direction=[1.0, 0.0, 1.0], friction=0.0),
    "half-space": Cone(direction=[0.0, 0.0, -1.0], friction=np.inf),
    "torsion": Cone(torsion=0.02),
    "grip": Cone(direction=None, grip=0.05),
    "grip in a body": Cone(direction=[1.0, 0.0, 0.0], frame="torso", grip=0.05, friction=0.5),
}


def _with_reaction(loads, body):
    """Add the opposite of the first wrench, on a body."""
    on = [0, 1, 0]
    sign = np.array([1.0, 1.0, -1.0])[:, None]
    return Wrenches(
        time=loads.time,
        names=("0", "1", "2"),
        bodies=(*loads.bodies, body),
        forces=loads.forces[:, on] * sign,
        points=loads.points[:, on],
        torques=loads.torques[:, on] * sign,
    )


@pytest.mark.parametrize("name", CONES)
@pytest.mark.parametrize("against", ["ground", "tibia_l"])
def test_columns_do_the_work_that_inverse_dynamics_finds(data, name, against):
    """J^T of any amplitudes is what torques lose if the forces are given as external ones."""
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    motion = any_motion(model)
    sites = (
        Site(name="sole", body="calcn_r", points=FOOT, cone=CONES[name], against=against),
        Site("hand", "hand_l", [[0.0, -0.1, 0.0]]),
    )
    terms = ContactTerm(
        compile_tree(model), motion.time, ContactTask(sites, full(motion, sites, 0.7))
    )
    rng = np.random.default_rng(1)
    amplitudes = rng.uniform(-1.0, 1.0, (len(motion), len(terms.generators)))
    amplitudes = np.maximum(amplitudes, terms.generators.lower)
    coordinates = compile_tree(model).coordinates_of(motion)
    forces, points, torques = terms.forces_of(slice(None), coordinates, amplitudes)
    loads = Wrenches(
        time=motion.time,
        names=("0", "1"),
        bodies=("calcn_r", "hand_l"),
        forces=forces,
        points=points,
        torques=torques,
    )
    if against != "ground":
        loads = _with_reaction(loads, against)
    lost = inverse_dynamics(model, motion).values - inverse_dynamics(model, motion, loads).values
    np.testing.assert_allclose(terms.torques_of(coordinates, amplitudes), lost, atol=1e-8)


def test_what_two_bodies_hang_on_does_not_feel_them_touch(data):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    motion = any_motion(model)
    tree = compile_tree(model)
    columns = compile_cones(
        tree, [Site("knees", "tibia_r", [[0.0, -0.1, 0.05]], against="tibia_l")]
    )
    touched = {model.coordinate_names[j] for j in columns.arrays.coordinate}
    assert not any(name.startswith("pelvis") for name in touched)
    assert {"hip_flexion_r", "hip_flexion_l", "knee_angle_r"} <= touched
    assert np.isfinite(columns.evaluate(tree.coordinates_of(motion))[0]).all()


@settings(max_examples=40)
@given(
    edges=st.sampled_from([4, 6, 8, 12]),
    friction=st.floats(0.05, 2.0),
    direction=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1),
    seed=st.integers(0, 10**6),
)
def test_edges_and_faces_are_one_cone_inside_the_round_one(edges, friction, direction, seed):
    cone = Cone(direction=direction, friction=friction, edges=edges)
    push, turn, lower, _ = cone.generators()
    assert np.all(lower == 0.0)
    assert np.all(turn == 0.0)
    d = cone.direction
    across = push - np.outer(push @ d, d)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), friction * (push @ d))
    faces, limit = friction_cone(cone, np.eye(3))
    reached = faces @ push.T
    assert reached.max() < 1e-9
    np.testing.assert_array_equal(np.sum(np.abs(reached) < 1e-9, axis=0), 2)
    # Any force is inside of all faces just where edges add up to it.
    force = np.random.default_rng(seed).normal(size=3) * 0.5 + d
    inside = np.all(faces @ force <= limit)
    missed = nnls(push.T, force)[1]
    assert inside == (missed < 1e-9)


def test_the_first_tangent_lies_along_the_axis_that_the_direction_leaves_free():
    one, other = tangents(np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose([one, other], [[1, 0, 0], [0, 0, -1]], atol=1e-15)


@pytest.mark.parametrize("cone", [one for one in CONES.values() if one.direction is not None])
@pytest.mark.parametrize("points", [1, 3])
def test_a_force_along_the_direction_costs_its_square_however_it_is_divided(data, cone, points):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    columns = compile_cones(
        compile_tree(model), [Site(name="sole", body="calcn_r", points=FOOT[:points], cone=cone)]
    )
    pressing = columns.normal > 0.0
    # min sum c z^2 with sum n z = 1 is 1 / sum(n^2 / c), and its force has no part across the
    # direction.
    z = columns.normal[pressing] / columns.cost[pressing]
    z /= columns.normal[pressing] @ z
    assert columns.cost[pressing] @ z**2 == pytest.approx(1.0)
    np.testing.assert_allclose(z @ columns.arrays.push[pressing], cone.direction, atol=1e-12)
    np.testing.assert_allclose(z @ columns.arrays.turn[pressing], 0.0, atol=1e-12)


@pytest.mark.parametrize("torsion", [0.0, 0.02])
@pytest.mark.parametrize("points", [1, 3])
def test_a_force_along_the_preferred_direction_costs_least_and_no_more(data, torsion, points):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    motion = any_motion(model, 1)
    site = Site(name="sole", body="calcn_r", points=FOOT[:points], cone=Cone(torsion=torsion))
    lean = np.array([0.15, 0.0, -0.1])
    task = ContactTask((site,), full(motion, [site]), preferred=lean[None, None])
    terms = ContactTerm(compile_tree(model), motion.time, task)
    columns = terms.generators
    size = terms.amounts[0] / terms.generators.weight[0]
    # min sum c z^2 with a force of 1 along the direction: z = size / c, scaled.
    z = size / columns.cost
    z /= size @ z
    np.testing.assert_allclose((size * z) @ columns.arrays.push, [0.15, 1.0, -0.1], atol=1e-12)
    assert columns.cost @ z**2 == pytest.approx(1.0)


def test_a_site_weighs_what_the_heavier_of_both_bodies_trees_does(data):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    columns = compile_cones(compile_tree(model), [Site("sole", "calcn_r", FOOT)])
    weight = sum(body.mass for body in model.bodies) * np.linalg.norm(model.gravity)
    assert columns.weight[0] == pytest.approx(weight)


def test_sites_that_do_not_fit_are_refused_by_name(data):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    tree = compile_tree(model)
    with pytest.raises(UnknownName, match="foot"):
        compile_cones(tree, [Site("sole", "foot", FOOT)])
    with pytest.raises(UnknownName, match="thigh"):
        compile_cones(
            tree, [Site(name="sole", body="calcn_r", points=FOOT, cone=Cone(frame="thigh"))]
        )
    with pytest.raises(BadModel, match="two contact sites are named 'sole'"):
        compile_cones(tree, [Site("sole", "calcn_r", FOOT), Site("sole", "calcn_l", FOOT)])

"""Closed loops: derivatives against differences, and projections against their laws.

Also against three other programs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from looped import (
    SHOULDERS,
    four_bar,
    four_bar_angles,
    looped_tree,
    mujoco_constraints,
    pinocchio_rates,
)
from myomorph.core.io.formats import read_model
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.rigid import loops
from myomorph.core.rigid.coordinates import couple_frames, couple_rates_frames
from myomorph.core.rigid.loop_kernels import half_rotation
from myomorph.core.rigid.loops import (
    close_loops,
    closure,
    closure_jacobian,
    closure_rates,
    free_coordinates,
    loop_basis,
    project_rates,
)
from myomorph.core.rigid.tree import compile_tree

SEEDS = range(3)


def near(tree, closed, frames=4, spread=0.1, seed=0):
    """Frames near closed coordinates, couplers obeyed."""
    values = np.tile(closed, (frames, 1))
    values += np.random.default_rng(seed).normal(scale=spread, size=values.shape)
    couple_frames(tree.arrays, values)
    return values


def holding(tree, held):
    """Return the tree of the same model with some coordinates locked where they are."""
    coordinates = [replace(each, locked=j in held) for j, each in enumerate(tree.model.coordinates)]
    return compile_tree(replace(tree.model, coordinates=tuple(coordinates)))


@pytest.mark.parametrize("functional", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_jacobian_is_the_derivative_of_the_closure(seed, functional):
    model, closed = looped_tree(seed, functional=functional)
    tree = compile_tree(model)
    c = near(tree, closed)
    h = 1e-6
    J = closure_jacobian(tree, c)
    for j in tree.independent:
        ends = []
        for sign in (1, -1):
            moved = c.copy()
            moved[:, j] += sign * h
            couple_frames(tree.arrays, moved)
            ends.append(closure(tree, moved))
        np.testing.assert_allclose(J[:, :, j], (ends[0] - ends[1]) / (2 * h), atol=1e-8)


@pytest.mark.parametrize("functional", [False, True])
def test_rates_are_the_derivatives_in_time(functional):
    model, closed = looped_tree(1, functional=functional)
    tree = compile_tree(model)
    c = near(tree, closed)
    v, a = np.random.default_rng(3).normal(size=(2, *c.shape))
    couple_rates_frames(tree.arrays, c, v, a)
    first, second = closure_rates(tree, c, v, a)
    h = 1e-4

    def at(t):
        moved = c + t * v + 0.5 * t**2 * a
        couple_frames(tree.arrays, moved)
        return closure(tree, moved)

    before = at(-h)
    now = at(0.0)
    after = at(h)
    np.testing.assert_allclose(first, (after - before) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(second, (after - 2 * now + before) / h**2, atol=1e-4)
    J = closure_jacobian(tree, c)
    free = tree.independent
    np.testing.assert_allclose(
        first, np.einsum("frj,fj->fr", J[:, :, free], v[:, free]), atol=1e-12
    )


def test_a_weld_tells_any_turning():
    model, closed = looped_tree(0, kinds=("WeldConstraint",))
    loop = model.loops[0]
    axis = np.array([0.6, 0.0, -0.8])
    for angle in (0.0, 1e-9, 1.0, 3.0, np.pi, -np.pi + 1e-9):
        turned = replace(
            loop, pose_2=loop.pose_2 @ Transform(axis_rotation(axis, angle), np.zeros(3))
        )
        error = closure(compile_tree(replace(model, loops=(turned,))), closed[None])[0]
        along = error[:3] @ axis * np.sign(angle + 1e-300)
        assert abs(along) == pytest.approx(2 * np.sin(abs(angle) / 2), abs=1e-9)
        np.testing.assert_allclose(error[:3], (error[:3] @ axis) * axis, atol=1e-7)
        np.testing.assert_allclose(error[3:], 0.0, atol=1e-12)


AXES = (
    *np.eye(3),
    (0.6, 0.0, -0.8),
    (0.48, 0.8, 0.36),
    (0.8, -0.48, 0.36),
    (0.36, 0.48, 0.8),
    (0.0, 0.8, 0.6),
)


@pytest.mark.parametrize("axis", AXES, ids=str)
def test_half_a_turn_has_its_axis_and_no_cosine(axis):
    """2 n n^T - 1 turns by half a turn about the unit vector n."""
    n = np.array(axis)
    a, u = half_rotation.py_func(tuple((2.0 * np.outer(n, n) - np.eye(3)).ravel()))
    assert a == 0.0
    np.testing.assert_allclose(np.outer(u, u), np.outer(n, n), atol=1e-12)


@pytest.mark.parametrize("functional", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_projection_is_closed_and_nearest(seed, functional):
    """What it changes is orthogonal to every motion that the loops allow."""
    model, closed = looped_tree(seed, functional=functional)
    tree = holding(compile_tree(model), (0,))
    free = free_coordinates(tree)
    given = near(tree, closed, spread=0.03)
    found = close_loops(tree, given)
    assert np.abs(closure(tree, found)).max() < 1e-12
    np.testing.assert_array_equal(found[:, 0], given[:, 0])
    J = closure_jacobian(tree, found)[:, :, free]
    for frame in range(len(given)):
        rank = np.linalg.matrix_rank(J[frame], tol=1e-9)
        allowed = np.linalg.svd(J[frame])[2][rank:]
        change = (found - given)[frame, free]
        np.testing.assert_allclose(allowed @ change, 0.0, atol=2e-7)
    np.testing.assert_allclose(close_loops(tree, found), found, atol=1e-12)


def test_projected_rates_keep_loops_closed():
    model, closed = looped_tree(2, functional=True)
    tree = compile_tree(model)
    c = close_loops(tree, near(tree, closed, spread=0.03))
    given_v, given_a = np.random.default_rng(4).normal(size=(2, *c.shape))
    v, a = project_rates(tree, c, given_v, given_a)
    first, second = closure_rates(tree, c, v, a)
    np.testing.assert_allclose(first, 0.0, atol=1e-11)
    np.testing.assert_allclose(second, 0.0, atol=1e-9)
    again = project_rates(tree, c, v, a)
    np.testing.assert_allclose(again[0], v, atol=1e-11)
    np.testing.assert_allclose(again[1], a, atol=1e-9)
    # A finite motion of these rates stays closed to third order.
    opened = []
    for h in (1e-2, 5e-3):
        moved = c + h * v + 0.5 * h**2 * a
        couple_frames(tree.arrays, moved)
        opened.append(np.abs(closure(tree, moved)).max())
    assert 1e-9 < opened[1] < opened[0] / 7.0


@pytest.mark.parametrize("seed", SEEDS)
def test_fast_rates_are_projected_as_slow_ones_are(seed):
    """Time that runs k times as fast multiplies velocities by k and accelerations by its square."""
    model, closed = looped_tree(seed)
    tree = compile_tree(model)
    c = close_loops(tree, near(tree, closed, spread=0.03))
    rates = np.random.default_rng(5).normal(size=(2, *c.shape))
    v, a = project_rates(tree, c, *rates)
    fast_v, fast_a = project_rates(tree, c, 1e4 * rates[0], 1e8 * rates[1])
    np.testing.assert_allclose(fast_v, 1e4 * v, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(fast_a, 1e8 * a, rtol=1e-9, atol=1e-2)


@pytest.mark.parametrize("seed", SEEDS)
def test_slopes_are_those_of_projected_motion(seed):
    model, closed = looped_tree(seed, functional=True)
    tree = compile_tree(model)
    c = close_loops(tree, near(tree, closed, spread=0.03))
    basis = loop_basis(tree, c)
    assert basis.rank == len(basis.dependent) == 9
    assert sorted([*basis.independent, *basis.dependent]) == sorted(free_coordinates(tree))
    h = 1e-5
    for column, j in enumerate(basis.independent):
        ends = []
        for sign in (1, -1):
            moved = c.copy()
            moved[:, j] += sign * h
            ends.append(close_loops(holding(tree, basis.independent), moved)[:, basis.dependent])
        slopes = basis.slopes[:, :, column]
        scale = 1.0 + np.abs(slopes).max()
        np.testing.assert_allclose(slopes, (ends[0] - ends[1]) / (2 * h), atol=1e-5 * scale**2)


@pytest.mark.parametrize("kind", ["PointConstraint", "connect"])
def test_four_bars_follow_the_law_of_cosines(kind):
    """Three rows, two of them independent: in the plane the third says nothing."""
    model = four_bar(kind=kind)
    tree = compile_tree(model)
    true = four_bar_angles(np.linspace(0.2, 5.9, 40))
    assert np.abs(closure(tree, true)).max() < 1e-15
    disturbed = true + np.array([0.0, 0.05, -0.05])
    np.testing.assert_allclose(close_loops(holding(tree, (0,)), disturbed), true, atol=1e-9)
    basis = loop_basis(tree, true)
    assert basis.rank == 2
    assert basis.independent.tolist() == [0]
    h = 1e-6
    slopes = (four_bar_angles(true[:, 0] + h) - four_bar_angles(true[:, 0] - h))[:, 1:] / (2 * h)
    np.testing.assert_allclose(basis.slopes[:, :, 0], slopes, atol=1e-8)


@pytest.mark.parametrize("held", [(), (0,)])
def test_four_bars_close_from_anywhere(held):
    tree = holding(compile_tree(four_bar()), held)
    given = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(100, 3))
    assert np.abs(closure(tree, close_loops(tree, given))).max() < 1e-12


def test_random_poses_tried_fill_what_a_hinge_may_take(monkeypatch):
    """Its range, and at most half a rotation from its default.

    Limits are (-1, 2), (-9, 9), and (1, 9) with the default 2.
    """
    model = four_bar()
    tried = []
    ranges = ((-1.0, 2.0), (-9.0, 9.0), (1.0, 9.0))
    defaults = (0.0, 0.5, 2.0)
    coordinates = (
        replace(one, range=limits, default=default)
        for one, limits, default in zip(model.coordinates, ranges, defaults, strict=True)
    )
    tree = compile_tree(replace(model, coordinates=tuple(coordinates)))
    monkeypatch.setattr(
        loops, "_closed_from", lambda tree, starts, free: tried.append(starts.copy()) or starts
    )
    given = np.array([0.1, 0.2, 0.3])
    loops._closed_from_elsewhere(tree, given, np.arange(3))
    np.testing.assert_array_equal(tried[0][0], defaults)
    lows = (-1.0, 0.5 - np.pi, 1.0)
    highs = (2.0, 0.5 + np.pi, 2.0 + np.pi)
    for values, low, high in zip(tried[0][1:].T, lows, highs, strict=True):
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high


def test_what_cannot_be_closed_is_named():
    model = four_bar()
    tree = compile_tree(model)
    far = replace(model.loops[0], pose_2=Transform(np.eye(3), np.array([9.0, 0.0, 0.0])))
    open_ = compile_tree(replace(model, loops=(far,)))
    with pytest.raises(
        BadData, match=r"frame 1: PointConstraint 'pin' cannot be closed.*crank, coupler, rocker"
    ):
        close_loops(open_, np.array([[np.nan] * 3, [1.0, -0.5, 1.5]]))
    held = four_bar_angles(np.array([1.0])) + np.array([[0.0, 0.1, 0.0]])
    with pytest.raises(BadData, match="cannot be closed"):
        close_loops(holding(tree, (1, 2, 0)), held)
    still = four_bar_angles(np.array([1.0]))
    with pytest.raises(BadData, match="rates cannot keep"):
        project_rates(holding(tree, (0, 1)), still, np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))


def test_what_is_locked_is_not_free():
    tree = compile_tree(four_bar())
    assert free_coordinates(tree).tolist() == [0, 1, 2]
    assert free_coordinates(holding(tree, (1,))).tolist() == [0, 2]


def test_models_without_loops_pass_unchanged():
    model = replace(four_bar(), loops=())
    tree = compile_tree(model)
    c = np.random.default_rng(0).normal(size=(3, 3))
    np.testing.assert_array_equal(close_loops(tree, c), c)
    assert closure(tree, c).shape == (3, 0)
    basis = loop_basis(tree, c)
    assert (basis.rank, basis.independent.tolist(), basis.slopes.shape) == (0, [0, 1, 2], (3, 0, 3))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_jacobian_spans_what_mujocos_does(seed):
    pytest.importorskip("mujoco")
    model, closed = looped_tree(seed, kinds=("connect", "weld"))
    errors, expected = mujoco_constraints(model, closed)
    assert np.abs(errors).max() < 1e-9
    ours = closure_jacobian(compile_tree(model), closed[None])[0]
    both = np.linalg.matrix_rank(np.vstack([ours, expected]), tol=1e-9)
    assert (
        both
        == np.linalg.matrix_rank(ours, tol=1e-9)
        == np.linalg.matrix_rank(expected, tol=1e-9)
        == 9
    )
    # The point's rows differ by a rotation alone.
    np.testing.assert_allclose(ours[:3].T @ ours[:3], expected[:3].T @ expected[:3], atol=1e-9)


def test_gaps_of_a_read_model_are_mujocos():
    mujoco = pytest.importorskip("mujoco")
    text = """
    <mujoco><worldbody>
      <body name="one"><joint name="a" axis="0 0 1"/><geom size="0.1"/>
        <body name="two" pos="0.3 0 0"><joint name="b" axis="0 0 1"/><joint name="c" axis="0 1 0"/>
          <geom size="0.1"/></body>
      </body>
      <body name="three" pos="0.8 0.1 0"><joint name="d" axis="0 0 1"/>\
<joint name="e" axis="1 0 0"/>
        <geom size="0.1"/></body>
    </worldbody><equality>
      <connect body1="two" body2="three" anchor="0.5 0 0.2"/><weld body1="three" body2="one"/>
    </equality></mujoco>"""
    m = mujoco.MjModel.from_xml_string(text)
    model = model_from_mujoco(m)
    tree = compile_tree(model)
    data = mujoco.MjData(m)
    assert np.abs(closure(tree, tree.defaults[None])).max() < 1e-12
    data.qpos[:] = np.random.default_rng(0).normal(scale=0.3, size=5)
    mujoco.mj_forward(m, data)
    order = [model.coordinate_names.index(name) for name in "abcde"]
    c = np.zeros((1, 5))
    c[0, order] = data.qpos
    connect = closure(tree, c)[0, :3]
    weld = closure(tree, c)[0, 3:]
    assert np.linalg.norm(connect) == pytest.approx(np.linalg.norm(data.efc_pos[:3]), abs=1e-12)
    assert np.linalg.norm(weld[3:]) == pytest.approx(np.linalg.norm(data.efc_pos[3:6]), abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_projected_rates_move_what_is_tied_alike_in_pinocchio(seed):
    pytest.importorskip("pinocchio")
    model, closed = looped_tree(seed)
    tree = compile_tree(model)
    v, a = project_rates(
        tree, closed[None], *np.random.default_rng(seed).normal(size=(2, 1, len(closed)))
    )
    for one, two in pinocchio_rates(model, closed, v[0], a[0]):
        np.testing.assert_allclose(one, two, atol=1e-8)


@pytest.mark.parametrize("name", SHOULDERS)
def test_shoulders_close_as_opensim_closes_them(data, name):
    pytest.importorskip("opensim")
    from truths.opensim_loops import point_constraint

    path = data(name)
    model = read_model(path)
    tree = compile_tree(model)
    free = free_coordinates(tree)
    c = np.tile(tree.defaults, (3, 1))
    c[:, free] += np.random.default_rng(0).normal(scale=0.05, size=(3, len(free)))
    gaps, derivatives, assembled = point_constraint(path, model, c)
    # OpenSim reads the old file of the bone pins through a text of fewer digits.
    same = 2e-7 if "bonepin" in name else 1e-12
    np.testing.assert_allclose(
        np.linalg.norm(closure(tree, c), axis=1), np.linalg.norm(gaps, axis=1), atol=same
    )
    ours = closure_jacobian(tree, c)
    for one, other in zip(ours, derivatives, strict=True):
        np.testing.assert_allclose(
            np.linalg.svd(one, compute_uv=False),
            np.linalg.svd(other, compute_uv=False),
            atol=max(same, 1e-9),
        )
        np.testing.assert_allclose(one.T @ one, other.T @ other, atol=max(same, 1e-9))
    assert np.abs(closure(tree, assembled)).max() < max(same, 1e-9)
    found = close_loops(tree, c)
    assert np.abs(closure(tree, found)).max() < 1e-12
    assert (((found - c) ** 2).sum(axis=1) <= ((assembled - c) ** 2).sum(axis=1) * (1 + 1e-6)).all()

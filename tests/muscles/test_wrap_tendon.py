"""MuJoCo's tendon wrapping.

The path of one surface against MuJoCo and against the laws of a taut string.
"""

import numpy as np
import pytest

from myomorph.core.model.spatial import axis_rotation
from myomorph.core.muscles.wrap.surface import CYLINDER, NO_WRAP, SPHERE, Half, Surface
from myomorph.core.muscles.wrap.tendon import BEFORE_FOUR, FOUR, NO_SIDE, Side, wrap_tendon
from myomorph.core.rigid.kernels import kernel

mujoco = pytest.importorskip("mujoco")
INSTALLED = FOUR if int(mujoco.__version__.split(".")[0]) >= 4 else BEFORE_FOUR
"""The rule of side points that is held against MuJoCo; checks run with a version before and one
since 4.0.
"""
SCENE = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" density="1000"/></default>
  <worldbody>
    <geom name="wrap" type="{kind}" size="{radius} 1" pos="0.1 -0.2 0.3" euler="0.4 -0.7 0.9"/>
    <body name="a"><joint name="ax" type="slide" axis="1 0 0"/>\
<joint name="ay" type="slide" axis="0 1 0"/>
      <joint name="az" type="slide" axis="0 0 1"/><geom size="0.01"/><site name="a"/></body>
    <body name="b"><joint name="bx" type="slide" axis="1 0 0"/>\
<joint name="by" type="slide" axis="0 1 0"/>
      <joint name="bz" type="slide" axis="0 0 1"/><geom size="0.01"/><site name="b"/></body>
    <body name="s"><joint name="sx" type="slide" axis="1 0 0"/>\
<joint name="sy" type="slide" axis="0 1 0"/>
      <joint name="sz" type="slide" axis="0 0 1"/><geom size="0.01"/><site name="s"/></body>
  </worldbody>
  <tendon><spatial name="t"><site site="a"/><geom geom="wrap" {side}/><site site="b"/></spatial>\
</tendon>
</mujoco>
"""


ANY_SIDE = Side(rule=NO_SIDE, point=(0.0, 0.0, 0.0))


@kernel
def _wrapped(a, b, surface, side):
    """`wrap_tendon`, which only kernels may call."""
    return wrap_tendon(a, b, surface, side)


def _wrap(p0, p1, kind, radius, R, x, side, out):
    """Length of the arc, -1 for none; `out` (2, 3) is filled with its ends where there is one."""
    surface = Surface(
        kind=kind,
        size=(radius, 0.0, 0.0),
        half=Half(axis=0, side=0),
        rotation=tuple(R.ravel()),
        center=tuple(x),
    )
    wrap = _wrapped(tuple(p0), tuple(p1), surface, side)
    if wrap.code == NO_WRAP:
        return -1.0
    out[:] = wrap.r, wrap.s
    return wrap.arc


@pytest.fixture(scope="module", params=["sphere", "cylinder"])
def kind(request):
    return request.param


def scene(kind, radius, has_side):
    side = 'sidesite="s"' if has_side else ""
    m = mujoco.MjModel.from_xml_string(SCENE.format(kind=kind, radius=radius, side=side))
    return m, mujoco.MjData(m)


def ours(m, d, kind, radius, has_side):
    out = np.zeros((2, 3))
    a, b, side = d.site_xpos
    R = d.geom_xmat[0].reshape(3, 3).copy()
    x = d.geom_xpos[0].copy()
    code = SPHERE if kind == "sphere" else CYLINDER
    chosen = Side(rule=INSTALLED if has_side else NO_SIDE, point=tuple(side))
    arc = _wrap(a.copy(), b.copy(), code, radius, R, x, chosen, out)
    if arc < 0:
        return arc, np.linalg.norm(b - a), out
    return arc, np.linalg.norm(out[0] - a) + arc + np.linalg.norm(b - out[1]), out


@pytest.mark.parametrize("side", ["none", "outside", "inside"])
def test_lengths_and_points_equal_mujoco(kind, side):
    radius = 0.3
    m, d = scene(kind, radius, side != "none")
    rng = np.random.default_rng(1)
    center = np.array([0.1, -0.2, 0.3])
    wrapped = 0
    for _ in range(400):
        d.qpos[:6] = np.tile(center, 2) + rng.uniform(-0.7, 0.7, 6)
        away = rng.standard_normal(3)
        d.qpos[6:] = center + away / np.linalg.norm(away) * (
            rng.uniform(0.31, 0.9) if side == "outside" else 0.1
        )
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_tendon(m, d)
        arc, length, out = ours(m, d, kind, radius, side != "none")
        assert length == pytest.approx(d.ten_length[0], abs=1e-9)
        assert (arc >= 0) == (d.ten_wrapnum[0] == 4)
        if arc >= 0:
            wrapped += 1
            np.testing.assert_allclose(out, d.wrap_xpos.reshape(-1, 3)[1:3], atol=3e-6)
    assert 30 < wrapped < 400


def test_points_in_line_with_the_center_equal_mujoco():
    """Any plane will do there: MuJoCo's choice is followed."""
    m, d = scene("sphere", 0.3, False)
    for direction in np.vstack([np.eye(3), [[1, 2, 3], [-3, 1, 2], [1, -3, 2]]]):
        unit = direction / np.linalg.norm(direction)
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, m.geom_quat[0])
        step = R.reshape(3, 3) @ unit
        center = np.array([0.1, -0.2, 0.3])
        d.qpos[:3] = center + 0.5 * step
        d.qpos[3:6] = center - 0.75 * step
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_tendon(m, d)
        arc, length, _ = ours(m, d, "sphere", 0.3, False)
        assert arc > 0
        assert length == pytest.approx(d.ten_length[0], abs=1e-9)


def random_cases(kind, count, seed=5):
    rng = np.random.default_rng(seed)
    found = 0
    while found < count:
        p0, p1, x = rng.uniform(-1, 1, (3, 3))
        R = axis_rotation((0.6, 0.0, 0.8), rng.uniform(-3, 3))
        radius = rng.uniform(0.1, 0.5)
        out = np.zeros((2, 3))
        arc = _wrap(p0, p1, kind, radius, R, x, ANY_SIDE, out)
        if arc > 0.01:
            found += 1
            yield p0, p1, radius, R, x, out, arc


@pytest.mark.parametrize("code", [SPHERE, CYLINDER])
def test_a_taut_string_is_tangent_and_shortest(code):
    """The straight parts touch the surface; moving an end changes the length by its unit vector."""
    for p0, p1, radius, R, x, out, _ in random_cases(code, 50):

        def length(p0, radius=radius, R=R, x=x, p1=p1):
            points = np.zeros((2, 3))
            arc = _wrap(p0, p1, code, radius, R, x, ANY_SIDE, points)
            return np.linalg.norm(points[0] - p0) + arc + np.linalg.norm(points[1] - p1)

        for end, point in zip((p0, p1), out, strict=True):
            normal = (
                (point - x)
                if code == SPHERE
                else (np.eye(3) - np.outer(R[:, 2], R[:, 2])) @ (point - x)
            )
            assert np.linalg.norm(normal) == pytest.approx(radius, abs=1e-12)
            assert normal @ (end - point) == pytest.approx(0.0, abs=1e-12)
        unit = (p0 - out[0]) / np.linalg.norm(p0 - out[0])
        h = 1e-6
        slope = [(length(p0 + h * step) - length(p0 - h * step)) / (2 * h) for step in np.eye(3)]
        np.testing.assert_allclose(slope, unit, atol=1e-6)


@pytest.mark.parametrize("code", [SPHERE, CYLINDER])
def test_a_rigid_motion_moves_the_path_along(code):
    turn = axis_rotation((0.0, 0.6, 0.8), 0.9)
    shift = np.array([0.3, -2.0, 1.0])
    for p0, p1, radius, R, x, out, arc in random_cases(code, 20, seed=6):
        moved = np.zeros((2, 3))
        again = _wrap(
            turn @ p0 + shift,
            turn @ p1 + shift,
            code,
            radius,
            turn @ R,
            turn @ x + shift,
            ANY_SIDE,
            moved,
        )
        assert again == pytest.approx(arc, abs=1e-9)
        np.testing.assert_allclose(moved, out @ turn.T + shift, atol=1e-9)


@pytest.mark.parametrize("code", [SPHERE, CYLINDER])
def test_a_side_point_sends_the_path_the_other_way_where_the_center_is_in_their_triangle(code):
    """Angles between a and b, and from each to where its line touches.

    The arc is the remainder in either direction.
    """
    rng = np.random.default_rng(7)
    radius = 0.3
    ways = {True: 0, False: 0}
    for _ in range(200):
        a, b, side = rng.uniform(-4, 4, 3)
        a = rng.uniform(0.35, 1.0) * np.array([np.cos(a), np.sin(a), 0.0])
        b = rng.uniform(0.35, 1.0) * np.array([np.cos(b), np.sin(b), 0.0])
        side = rng.uniform(0.35, 1.0) * np.array([np.cos(side), np.sin(side), 0.0])
        # The center in coordinates of the triangle's area.
        weights = np.linalg.solve(
            np.column_stack([a, b, side]) + [[0.0], [0.0], [1.0]], [0.0, 0.0, 1.0]
        )
        far = bool((weights > 0.0).all())
        near = np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1.0, 1.0))
        lines = sum(np.arccos(radius / np.linalg.norm(end)) for end in (a, b))
        expected = radius * ((2.0 * np.pi - near if far else near) - lines)
        chosen = Side(rule=FOUR, point=tuple(side))
        arc = _wrap(a, b, code, radius, np.eye(3), np.zeros(3), chosen, np.zeros((2, 3)))
        assert arc == pytest.approx(expected if expected > 0.0 else -1.0, abs=1e-9)
        ways[far] += 1
    assert min(ways.values()) > 20


def test_no_wrap_inside_or_away():
    out = np.zeros((2, 3))
    R = np.eye(3)
    x = np.zeros(3)
    assert (
        _wrap(np.array([0.1, 0, 0]), np.array([2.0, 0, 0]), SPHERE, 1.0, R, x, ANY_SIDE, out) == -1
    )
    assert (
        _wrap(np.array([2.0, 2, 0]), np.array([-2.0, 2, 0]), SPHERE, 1.0, R, x, ANY_SIDE, out) == -1
    )
    assert (
        _wrap(np.array([2.0, 0, 0]), np.array([-2.0, 0.1, 0]), SPHERE, 0.0, R, x, ANY_SIDE, out)
        == -1
    )
    assert np.all(out == 0.0)

"""Branching points: balance against MuJoCo and scipy, and virtual work.

Also how they follow a model into other bones.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize

from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints
from myomorph.bones.morph.morphed import MorphOptions
from myomorph.bones.morph.transfer.model import Graft, MorphTarget, graft_muscles, morph_model
from myomorph.bones.morph.transfer.virtual_links import BranchLoad, branch_load, branch_places
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity

ENDS = {
    "upper": ("upper", (0.02, 0.05, 0.01), (0.003, 0.004, 0.0), 40.0),
    "left": ("lower", (-0.06, 0.01, 0.03), (-0.004, 0.0, 0.002), 25.0),
    "right": ("lower", (0.07, -0.02, 0.02), (0.005, -0.001, 0.0), 30.0),
    "back": ("lower", (0.01, 0.0, -0.08), (0.0, 0.0, -0.004), 20.0),
}
"""By strand: the body it comes from, its ends there and on the link [m], its maximum isometric
force [N].
"""
AROUND = {"link": ("lower", "upper")}
TRUNK = MorphTarget(surrounding=AROUND)
AT = np.array([0.0, 0.06, 0.0])
"""Where the link is on the lower body [m]."""


def branched(places: dict[str, tuple[float, float, float]] | None = None) -> Model:
    """Make a lower body and an upper one that rotates on it.

    Between them is a point at which four lines of action meet.
    """
    still = Transform.identity()
    turn = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=("bend",),
    )
    joints = (
        Joint(
            name="base",
            kind="WeldJoint",
            parent="ground",
            child="lower",
            parent_frame=still,
            child_frame=still,
        ),
        Joint(
            name="branch",
            kind="WeldJoint",
            parent="lower",
            child="link",
            parent_frame=Transform(np.eye(3), AT),
            child_frame=still,
        ),
        Joint(
            name="bend",
            kind="PinJoint",
            parent="lower",
            child="upper",
            parent_frame=Transform(np.eye(3), np.array([0.0, 0.1, -0.02])),
            child_frame=still,
            axes=(turn,),
            coordinates=("bend",),
        ),
    )
    muscles = tuple(
        Muscle(
            name=name,
            kind="RigidTendonMuscle",
            path=Path(
                (
                    PathPoint("a", body, np.array((places or {}).get(name, start))),
                    PathPoint("b", "link", np.array(end)),
                )
            ),
            max_isometric_force=force,
            optimal_fiber_length=0.05,
            tendon_slack_length=0.02,
        )
        for name, (body, start, end, force) in ENDS.items()
    )
    bodies = tuple(
        Body(name=name, mass=mass, mass_center=np.zeros(3), inertia=0.01 * np.eye(3))
        for name, mass in (("lower", 1.0), ("link", 0.0), ("upper", 1.0))
    )
    return Model(
        name="branched",
        bodies=bodies,
        joints=joints,
        coordinates=(Coordinate("bend", range=(-0.6, 0.6)),),
        gravity=np.array([0.0, -9.81, 0.0]),
        muscles=muscles,
    )


def _in_mujoco(load: BranchLoad) -> np.ndarray:
    """Return where MuJoCo's massless slider comes to rest between tendons of constant tension.

    The upper body is straight.
    """
    worlds = []
    sites = []
    tendons = []
    pulls = []
    for name, (body, start, end, _) in ENDS.items():
        offset = np.array([0.0, 0.1, -0.02]) if body == "upper" else np.zeros(3)
        worlds.append(
            f'<site name="{name}0" pos="{" ".join(map(str, np.array(start) + offset))}"/>'
        )
        sites.append(f'<site name="{name}1" pos="{" ".join(map(str, end))}"/>')
        tendons.append(
            f'<spatial name="{name}"><site site="{name}0"/><site site="{name}1"/></spatial>'
        )
        pulls.append(f'<motor name="{name}" tendon="{name}"/>')
    sliders = "".join(
        f'<joint type="slide" axis="{axis}" damping="200"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" timestep="0.002" integrator="implicitfast"/>\
<worldbody>{"".join(worlds)}
        <body pos="{" ".join(map(str, AT))}">{sliders}
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        {"".join(sites)}</body></worldbody><tendon>{"".join(tendons)}</tendon><actuator>{"".join(pulls)}</actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.ctrl[:] = -load.tensions
    data.qfrc_applied[:] = load.rest
    for _ in range(5_000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-9
    return data.qpos.copy()


def test_it_rests_where_mujoco_and_scipy_let_it_rest():
    model = branched()
    load = BranchLoad(
        link="link",
        muscles=tuple(ENDS),
        tensions=np.array([31.0, 24.0, 36.0, 18.0]),
        rest=np.array([1.0, -2.0, 0.5]),
    )
    (place,), (balanced,) = branch_places(model, load)
    assert balanced
    assert np.linalg.norm(place) > 0.005
    np.testing.assert_allclose(place, _in_mujoco(load), atol=2e-8)
    offsets = {"upper": np.array([0.0, 0.1, -0.02])}
    starts = np.array(
        [np.array(start) + offsets.get(body, 0.0) - AT for body, start, _, _ in ENDS.values()]
    )
    ends = np.array([end for _, _, end, _ in ENDS.values()])

    def energy(x: np.ndarray) -> float:
        return float(load.tensions @ np.linalg.norm(ends + x - starts, axis=1) - load.rest @ x)

    found = minimize(energy, np.zeros(3), method="BFGS", options={"gtol": 1e-7})
    np.testing.assert_allclose(place, found.x, atol=1e-6)


def test_the_sources_own_tensions_hold_it_where_it_is():
    """In every frame the balance is that of virtual work, and the pose of the file is its rest."""
    model = branched()
    load = branch_load(model, "link")
    assert load.muscles == tuple(ENDS)
    place, balanced = branch_places(model, load)
    assert balanced.all()
    np.testing.assert_allclose(place, 0.0, atol=1e-12)
    motion = Motion(np.arange(5.0), ("bend",), np.linspace(-0.5, 0.5, 5)[:, None])
    places, balanced = branch_places(model, load, motion)
    assert balanced.all()
    np.testing.assert_allclose(places[2], 0.0, atol=1e-9)
    for angle, shift in zip(motion.values[:, 0], places, strict=True):
        upper = Transform(rotation_from_euler_xyz((0.0, 0.0, angle)), np.array([0.0, 0.1, -0.02]))
        pull = np.zeros(3)
        for tension, (body, start, end, _) in zip(load.tensions, ENDS.values(), strict=True):
            away = (
                (upper.apply(np.array(start)) if body == "upper" else np.array(start))
                - AT
                - end
                - shift
            )
            pull += tension * away / np.linalg.norm(away)
        np.testing.assert_allclose(pull, -load.rest, atol=1e-6)


def test_strands_in_one_line_hold_nothing_across():
    """No place is given, and a link without strands or forces is refused by name."""
    line = {name: (0.0, 0.2 * k, 0.0) for k, name in enumerate(ENDS)}
    model = branched(line)
    ends = {one.name: replace(one.path.points[1], location=np.zeros(3)) for one in model.muscles}
    lower = tuple(
        replace(one, path=Path((replace(one.path.points[0], body="lower"), ends[one.name])))
        for one in model.muscles
    )
    load = BranchLoad(link="link", muscles=tuple(ENDS), tensions=np.ones(4), rest=np.zeros(3))
    place, balanced = branch_places(replace(model, muscles=lower), load)
    assert not balanced.any()
    assert np.isnan(place).all()
    with pytest.raises(BadData, match="'upper'"):
        branch_load(replace(model, muscles=()), "upper")
    with pytest.raises(UnknownName, match="nowhere"):
        branch_load(model, "nowhere")
    with pytest.raises(UnknownName, match="tendon"):
        branch_places(model, replace(load, muscles=(*tuple(ENDS)[:3], "tendon")))


def _bone(body: str, matrix: np.ndarray) -> BoneMap:
    corners = 0.04 * np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    turn = np.linalg.qr(matrix)[0] * np.sign(np.diag(np.linalg.qr(matrix)[1]))
    scale = np.cbrt(np.linalg.det(matrix))
    features = FeaturePoints(tuple(map(str, range(8))), corners, corners @ matrix.T)
    return BoneMap(
        body=body,
        target_body=body,
        map=AffineMap(matrix, np.zeros(3)),
        whole=Similarity(turn, np.zeros(3), scale),
        basis="bone",
        features=features,
    )


def test_a_twin_has_it_where_the_bones_put_it():
    """Larger bones, turned frames: the balance is there already."""
    turn = rotation_from_euler_xyz((0.3, -0.8, 0.5))
    model = branched()
    bones = {name: _bone(name, 1.3 * turn) for name in ("lower", "upper")}
    morph = morph_model(model, bones, target=TRUNK)
    measures = morph.bones["link"].measures
    assert measures["moved to balance [m]"] < 1e-9
    assert measures["held by no line of action"] == pytest.approx(branch_load(model, "link").share)
    left = morph_model(model, bones, MorphOptions(balance=False), TRUNK)
    for ours, theirs in zip(morph.points, left.points, strict=True):
        np.testing.assert_allclose(ours.target, theirs.target, atol=1e-9)


@pytest.mark.parametrize("grafted", [False, True])
def test_in_stretched_bones_the_same_tensions_balance(grafted):
    """The map alone leaves an unbalanced force.

    After the points are moved none remains but the source's, and they report the distance.
    """
    model = branched()
    wide = np.diag([1.5, 1.0, 0.8])
    bones = {"lower": _bone("lower", wide), "upper": _bone("upper", np.diag([1.2, 1.1, 1.0]))}
    morphs = []
    for options in (MorphOptions(clear=False), MorphOptions(balance=False, clear=False)):
        if grafted:
            skeleton = replace(model, muscles=())
            morphs.append(graft_muscles(model, skeleton, bones, options, Graft(surrounding=AROUND)))
        else:
            morphs.append(morph_model(model, bones, options, TRUNK))
    load = branch_load(model, "link")
    measures = morphs[0].bones["link"].measures
    away = measures["moved to balance [m]"]
    assert away > 1e-3
    for ours, theirs in zip(morphs[0].points, morphs[1].points, strict=True):
        apart = np.linalg.norm(ours.target - theirs.target)
        assert apart == pytest.approx(away if ours.body == "link" else 0.0, abs=1e-9)
    assert any(f"moved by {1e3 * away:.2g} mm" in note for note in morphs[0].notes)
    if not grafted:
        turned = replace(load, rest=morphs[0].bones["link"].whole.rotation @ load.rest)
        for morph, rests in zip(morphs, (True, False), strict=True):
            (shift,), _ = branch_places(morph.model, turned)
            assert (np.linalg.norm(shift) < 1e-9) == rests

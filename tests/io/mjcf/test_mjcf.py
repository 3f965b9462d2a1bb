"""MJCF in: MuJoCo is the oracle for poses, masses, velocities and inverse dynamics."""

import numpy as np
import pytest

from mujoco_models import MODELS, State, compiled, load, qpos_from_coordinates, random_motion
from myomorph.core.io.mjcf.read import coordinates_from_qpos, model_from_mujoco, read_mjcf
from myomorph.core.model.errors import BadFile, BadModel
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree

mujoco = pytest.importorskip("mujoco")
FRAMES = 3


@pytest.fixture(scope="module", params=["mixed", *MODELS])
def pair(request, data):
    m, model = load(request.param, data)
    motion = random_motion(model, FRAMES)
    return m, model, motion, [State(model, motion, frame) for frame in range(FRAMES)]


def test_poses_and_center_of_mass_equal_mujoco(pair):
    m, model, motion, states = pair
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    ours = center_of_mass(tree, poses)
    d = mujoco.MjData(m)
    for frame, state in enumerate(states):
        d.qpos[:] = state.qpos
        mujoco.mj_kinematics(m, d)
        np.testing.assert_allclose(poses.origins[frame], d.xpos, atol=1e-9)
        np.testing.assert_allclose(poses.rotations[frame].reshape(-1, 9), d.xmat, atol=1e-9)
        center = (m.body_mass[:, None] * d.xipos).sum(axis=0) / m.body_mass.sum()
        np.testing.assert_allclose(ours[frame], center, atol=1e-9)


def test_masses_equal_mujoco(pair):
    m, model, *_ = pair
    np.testing.assert_array_equal([body.mass for body in model.bodies], m.body_mass[1:])
    np.testing.assert_array_equal([body.mass_center for body in model.bodies], m.body_ipos[1:])
    ours = [np.sort(np.linalg.eigvalsh(body.inertia)) for body in model.bodies]
    np.testing.assert_allclose(ours, np.sort(m.body_inertia[1:], axis=1), rtol=1e-9, atol=1e-15)


def test_inverse_dynamics_equals_mujoco(pair):
    """tau = basis^T mj_rne; armature, damping and stiffness of joints are not inertia of bodies."""
    m, model, motion, states = pair
    ours = inverse_dynamics(model, motion).values
    d = mujoco.MjData(m)
    for frame, state in enumerate(states):
        d.qpos[:] = state.qpos
        d.qvel[:] = state.qvel
        d.qacc[:] = state.qacc
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_comVel(m, d)
        theirs = np.zeros(m.nv)
        mujoco.mj_rne(m, d, 1, theirs)
        expected = state.basis.T @ theirs
        np.testing.assert_allclose(
            ours[frame], expected, atol=1e-9 * max(1.0, np.abs(expected).max())
        )


def test_body_velocities_equal_mujoco(pair):
    """Our Jacobian times the rates is MuJoCo's velocity of every body's origin and its rotation."""
    m, model, motion, states = pair
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    d = mujoco.MjData(m)
    state = states[0]
    d.qpos[:] = state.qpos
    d.qvel[:] = state.qvel
    mujoco.mj_forward(m, d)
    rates = np.linalg.lstsq(state.basis, state.qvel, rcond=None)[0]
    velocity = np.zeros(6)
    for body in range(1, m.nbody, 1 + m.nbody // 25):
        mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        ours = poses.jacobian(body, poses.origins[0, body])[0] @ rates
        np.testing.assert_allclose(ours, velocity, atol=1e-9 * max(1.0, np.abs(velocity).max()))


def test_sites_are_frames(pair):
    m, model, motion, states = pair
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    d = mujoco.MjData(m)
    d.qpos[:] = states[1].qpos
    mujoco.mj_kinematics(m, d)
    bodies = np.array([tree.body_index[frame.body] for frame in model.frames], dtype=np.int64)
    places = np.array([frame.pose.translation for frame in model.frames]).reshape(-1, 3)
    np.testing.assert_allclose(poses.points(bodies, places)[1], d.site_xpos, atol=1e-9)


def test_qpos_round_trip(pair):
    _, model, motion, _ = pair
    c = compile_tree(model).coordinates_of(motion)
    np.testing.assert_allclose(
        coordinates_from_qpos(model, qpos_from_coordinates(model, c)), c, atol=1e-12
    )


def test_default_pose_is_qpos0():
    m = compiled("mixed")
    model = model_from_mujoco(m)
    np.testing.assert_allclose(
        qpos_from_coordinates(model, [c.default for c in model.coordinates]),
        m.qpos0
        / np.concatenate([np.ones(3), np.full(4, np.linalg.norm(m.qpos0[3:7])), np.ones(m.nq - 7)]),
        atol=1e-12,
    )


def test_couplers_hold_mujocos_equalities():
    """At coordinates that follow the couplers, MuJoCo sees no violated joint equality."""
    m = compiled("myolegs")
    model = model_from_mujoco(m)
    assert len(model.couplers) == np.count_nonzero(m.eq_type == mujoco.mjtEq.mjEQ_JOINT)
    motion = random_motion(model, 4, seed=3)
    d = mujoco.MjData(m)
    for frame in range(4):
        d.qpos[:] = State(model, motion, frame).qpos
        mujoco.mj_forward(m, d)
        rows = d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        assert rows.sum() == len(model.couplers)
        np.testing.assert_allclose(d.efc_pos[rows], 0.0, atol=1e-9)


def test_ranges_and_locks():
    text = """
    <mujoco><compiler angle="radian"/><worldbody>
      <body><joint name="a" range="-1 2"/><geom size="1"/>
        <body><joint name="b"/><geom size="1"/>
          <body><joint name="c" ref="0.5"/><geom size="1"/></body></body></body>
    </worldbody><equality>
      <joint joint1="c" polycoef="0.2 0 0 0 0"/>\
<joint joint1="b" joint2="a" polycoef="0.1 2 3 0 0"/>
      <joint joint1="a" joint2="b" active="false"/>
    </equality></mujoco>"""
    model = model_from_mujoco(mujoco.MjModel.from_xml_string(text))
    a, b, c = model.coordinates
    assert a.range == (-1.0, 2.0)
    assert a.clamped
    assert not b.clamped
    assert c.locked
    assert c.default == pytest.approx(0.7)
    (coupler,) = model.couplers
    assert (coupler.dependent, coupler.independents) == ("b", ("a",))
    assert coupler.function(0.5) == pytest.approx(0.1 + 2 * 0.5 + 3 * 0.25)
    assert [kept.effect for kept in model.kept] == ["the file switches it off"]


def test_loops_are_kept_as_loops():
    text = """
    <mujoco><worldbody>
      <body name="one"><joint/><geom size="1"/></body>
      <body name="two" pos="1 0 0"><joint/><geom size="1"/></body>
    </worldbody><equality>
      <connect body1="one" body2="two" anchor="0.5 0 0.2"/><weld body1="one" body2="two"/>
    </equality></mujoco>"""
    m = mujoco.MjModel.from_xml_string(text)
    model = model_from_mujoco(m)
    assert [loop.kind for loop in model.loops] == ["connect", "weld"]
    where = {"one": np.zeros(3), "two": np.array([1.0, 0.0, 0.0])}
    for loop in model.loops:
        one = where[loop.body_1] + loop.pose_1.translation
        np.testing.assert_allclose(one, where[loop.body_2] + loop.pose_2.translation, atol=1e-12)


def test_muscle_parameters_are_mujocos():
    """MuJoCo's active force at length L0 + LT and full activation is -F0, plus passive force."""
    m = compiled("myolegs")
    model = model_from_mujoco(m)
    assert len(model.muscles) == m.nu == 80
    for i, muscle in enumerate(model.muscles):
        length = muscle.tendon_slack_length + muscle.optimal_fiber_length
        gain = mujoco.mju_muscleGain(
            length, 0.0, m.actuator_lengthrange[i], m.actuator_acc0[i], m.actuator_gainprm[i, :9]
        )
        assert gain == pytest.approx(-muscle.max_isometric_force, rel=1e-9)
        assert muscle.parameters["F0"] == muscle.max_isometric_force


def test_meshes_lie_where_mujoco_puts_them():
    """The vertices of a bone's own file, placed by our pose, are MuJoCo's vertices of that geom."""
    trimesh = pytest.importorskip("trimesh")
    package = pytest.importorskip("musclemimic_models")
    path = package.get_xml_path("myofullbody")
    m = compiled("MyoFullBody")
    model = read_mjcf(path)
    body = m.body("femur_r").id
    geoms = [
        i
        for i in range(m.ngeom)
        if m.geom_bodyid[i] == body
        and m.geom_type[i] == mujoco.mjtGeom.mjGEOM_MESH
        and m.geom_group[i] <= 2
    ]
    meshes = [mesh for mesh in model.body("femur_r").meshes if mesh.shape == "mesh"]
    assert len(meshes) == len(geoms) > 0
    for mesh, geom in zip(meshes, geoms, strict=True):
        k = m.geom_dataid[geom]
        vertices = m.mesh_vert[m.mesh_vertadr[k] : m.mesh_vertadr[k] + m.mesh_vertnum[k]]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, m.geom_quat[geom])
        theirs = vertices @ turn.reshape(3, 3).T + m.geom_pos[geom]
        ours = mesh.pose.apply(trimesh.load(path.parent / mesh.file).vertices * mesh.scale)
        np.testing.assert_allclose(ours.min(axis=0), theirs.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(ours.max(axis=0), theirs.max(axis=0), atol=1e-6)


def test_marker_sites_are_an_option(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><worldbody><body name="b"><joint/><geom size="1"/><site name="RKNE_mimic" pos="1 2'
        ' 3"/><site name="other"/></body></worldbody></mujoco>'
    )
    model = read_mjcf(path, marker_sites=".*_mimic")
    assert model.marker_names == ("RKNE_mimic",)
    np.testing.assert_array_equal(model.marker("RKNE_mimic").location, [1, 2, 3])
    assert read_mjcf(path).markers == ()


def test_a_mouse_arm_without_its_meshes(data):
    model = read_mjcf(data("mouse-arm-muscles/akira_muscle.xml"))
    assert len(model.muscles) == 9
    assert sum(kept.kind == "missing file" for kept in model.kept) == 6
    assert model.coordinate_names == ("sh_elv", "sh_extension", "sh_rotation", "elbow")
    assert "ground" not in model.body_names


GEOM = '<worldbody><body><joint/><geom size="1"/></body></worldbody>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("<mujoco>" + GEOM, "line"),
        ('<!DOCTYPE a [<!ENTITY x "y">]><mujoco>&x;</mujoco>', "entit"),
        ("<OpenSimDocument/>", "<OpenSimDocument>"),
        (
            '<mujoco><asset><mesh file="../../../outside.stl"/></asset>' + GEOM + "</mujoco>",
            "'../../../outside.stl'",
        ),
        ('<mujoco><asset><mesh file="/etc/passwd"/></asset>' + GEOM + "</mujoco>", "'/etc/passwd'"),
        (
            '<mujoco><compiler meshdir="../.."/><asset><mesh file="x.stl"/></asset>'
            + GEOM
            + "</mujoco>",
            "'x.stl'",
        ),
        ('<mujoco><include file="../x.xml"/></mujoco>', "'../x.xml'"),
        ('<mujoco><include file="absent.xml"/></mujoco>', "'absent.xml' does not exist"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "mass"),
        ("<mujoco><worldbody><body><nonsense/></body></worldbody></mujoco>", "nonsense"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(BadFile) as refused:
        read_mjcf(path)
    message = str(refused.value)
    assert said in message
    assert "\n" not in message
    assert message.startswith(str(path))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco/>", "no body"),
        (
            (
                '<mujoco><worldbody><body pos="inf 0 0"><joint/><geom'
                ' size="1"/></body></worldbody></mujoco>'
            ),
            "body_pos|Inf",
        ),
    ],
)
def test_models_of_nothing_are_refused(tmp_path, text, said):
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises((BadModel, BadFile), match=said):
        read_mjcf(path)


@pytest.mark.parametrize("name", ["C:\\bones\\x.stl", "/home/nobody/x.stl", "./bones/../x.stl"])
def test_missing_meshes_are_left_out_by_name(tmp_path, name):
    path = tmp_path / "model.xml"
    path.write_text(f'<mujoco><asset><mesh name="m" file="{name}"/></asset>{GEOM}</mujoco>')
    assert [(kept.kind, kept.name) for kept in read_mjcf(path).kept] == [("missing file", name)]


def test_a_model_that_would_fill_the_memory_is_stopped(tmp_path):
    path = tmp_path / "model.xml"
    copies = '<replicate count="100000000"><body><joint/><geom size="1"/></body></replicate>'
    path.write_text(f"<mujoco><worldbody>{copies}</worldbody></mujoco>")
    with pytest.raises(BadFile):
        read_mjcf(path, time_limit=2.0)


def test_a_package_or_checkout_is_one_tree(tmp_path):
    """`../meshes` is fine inside of a folder that says it is a whole, and not otherwise."""
    (tmp_path / "models" / "leg").mkdir(parents=True)
    (tmp_path / "models" / "shared.xml").write_text(f"<mujocoinclude>{GEOM}</mujocoinclude>")
    path = tmp_path / "models" / "leg" / "leg.xml"
    path.write_text('<mujoco><include file="../shared.xml"/></mujoco>')
    with pytest.raises(BadFile, match="outside"):
        read_mjcf(path)
    assert len(read_mjcf(path, root=tmp_path / "models").bodies) == 1
    (tmp_path / "models" / "LICENSE").write_text("free")
    assert len(read_mjcf(path).bodies) == 1


def test_a_missing_mesh_that_carries_the_mass_is_named(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><asset><mesh name="bone" file="bone.stl"/></asset><worldbody>'
        '<body name="b"><joint/><geom type="mesh" mesh="bone"/></body></worldbody></mujoco>'
    )
    with pytest.raises(BadFile, match=r"bone\.stl"):
        read_mjcf(path)


def test_compiling_has_a_time_limit(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(f"<mujoco>{GEOM}</mujoco>")
    with pytest.raises(BadFile, match="within"):
        read_mjcf(path, time_limit=0.01)

"""What a page that plays results again shows, without a page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.walker import having, shown

from myomorph.core.model.contacts import ContactForces, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.model.model import Marker
from myomorph.core.model.series import Emg, ForcePlate, Markers, Motion
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.lab.report.scene.shapes import normals, outward, reduced, sphere
from myomorph.lab.uncertainty.spread import Spread, Uncertainty
from myomorph.lab.viewer import replay_charts as charts
from myomorph.lab.viewer.replay import MuscleIndex
from myomorph.lab.viewer.replay_body import SLACK, TIGHT, WEIGHT, PlayedBody, arrows, tubes
from myomorph.lab.viewer.replay_scene import outline
from myomorph.lab.viewer.web_page import quaternions
from walker import GRAVITY, everything, model, motion, steps

WAYS = ("up", "ahead", "right")


def _turned(wxyz: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors turned by quaternions."""
    w = wxyz[:, :1]
    axis = wxyz[:, 1:]
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)


def test_poses_are_those_of_the_kinematics() -> None:
    given = everything()
    body = PlayedBody(given)
    assert given.model is not None
    tree = compile_tree(given.model)
    poses = forward_kinematics(tree, tree.coordinates_of(body.motion))
    for frame in (0, 57, 199):
        instant = body.at(frame)
        assert instant.rotations == pytest.approx(poses.rotations[frame], abs=1e-12)
        assert instant.origins == pytest.approx(poses.origins[frame], abs=1e-12)
        assert body.frame_at(float(body.time[frame]) + 0.004) == frame
    quaternion = quaternions(poses.rotations[57])
    vector = np.array([0.3, -0.2, 0.7])
    assert _turned(quaternion, np.tile(vector, (len(quaternion), 1))) == pytest.approx(
        poses.rotations[57] @ vector
    )


def test_tubes_reach_from_point_to_point() -> None:
    """Every tube's ends, rotated and placed, are the path's points.

    The ones beyond the path have no size.
    """
    random = np.random.default_rng(1)
    points = random.normal(size=(7, 3))
    points[1] = points[0] - [0.0, 0.0, 0.4]
    points[6] = np.nan
    muscle = np.array([0, 0, 0, 1, 1, 1, 1])
    made = tubes(
        points, muscle, np.array([0.01, 0.02]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    )
    starts = [0, 1, 3, 4, 5]
    ends = [1, 2, 4, 5, 6]
    assert len(made.positions) == 5
    half = made.scales[:4, 2] - 0.35 * made.scales[:4, 0]
    along = _turned(made.wxyzs[:4].astype(float), np.array([0.0, 0.0, 1.0]) * half[:, None])
    assert made.positions[:4] - along == pytest.approx(points[starts[:4]], abs=1e-6)
    assert made.positions[:4] + along == pytest.approx(points[ends[:4]], abs=1e-6)
    assert not made.scales[4].any()
    assert made.scales[:, 0] == pytest.approx([0.01, 0.01, 0.02, 0.02, 0.0])
    assert made.colors.tolist() == [[255, 0, 0]] * 2 + [[0, 0, 255]] * 3


def test_a_tighter_muscle_is_thicker_by_its_cross_section() -> None:
    """What the tension adds to the radius of a slack muscle grows as its root."""
    body = PlayedBody(everything())
    own = body.tube_muscles == 0
    radii = np.array([body.at(frame).tubes.scales[own, 0].max() for frame in range(0, 200, 10)])
    most = max(one.max_isometric_force for one in body.model.muscles)
    share = np.sqrt(body.tensions[::10, 0] / most)
    assert radii == pytest.approx(body.size * (SLACK + TIGHT * share), rel=1e-5)


def test_muscles_that_were_found_stand_out() -> None:
    body = PlayedBody(everything())
    plain = body.at(20).tubes
    found = body.at(20, (3,)).tubes
    own = body.tube_muscles == 3
    assert (found.scales[own, 0] > 1.3 * plain.scales[own, 0]).all()
    assert (found.scales[~own, 0] <= plain.scales[~own, 0] + 1e-9).all()
    spread = np.ptp(found.colors[~own].astype(int), axis=1)
    assert (spread < np.ptp(plain.colors[~own].astype(int), axis=1)).all()


def test_arrows_stand_where_forces_act_and_are_as_long_as_they_are_strong() -> None:
    given = everything()
    body = PlayedBody(given)
    assert given.dynamics.wrenches is not None
    frame = 60
    ends = body.at(frame).measured
    assert np.isfinite(ends[:, 0, 0]).tolist() == [True, False]
    assert ends[0, 0] == pytest.approx(given.dynamics.wrenches.points[frame, 0])
    length = (
        WEIGHT
        * body.size
        * given.dynamics.wrenches.forces[frame, 0, 1]
        / (given.model.mass * GRAVITY)
    )  # type: ignore[union-attr]
    assert np.linalg.norm(ends[0, 1] - ends[0, 0]) == pytest.approx(length, rel=1e-6)
    assert np.isnan(body.at(0).measured).all()
    shafts, heads = arrows(ends, body.size, np.zeros(3))
    tip = (
        heads.positions[0]
        + _turned(heads.wxyzs[:1].astype(float), np.array([[0.0, 0.0, heads.scales[0, 2]]]))[0]
    )
    assert tip == pytest.approx(ends[0, 1], abs=1e-6)
    assert 2 * (shafts.scales[0, 2] + heads.scales[0, 2]) == pytest.approx(length, rel=1e-5)
    assert not shafts.scales[1].any()
    assert not heads.scales[1].any()


def test_contact_forces_have_arrows_of_their_own() -> None:
    given = everything()
    assert given.model is not None
    time = np.linspace(0.5, 1.0, 51)
    site = Site("heel_r", "tibia_r", np.zeros((1, 3)), group="foot_r")
    toe = Site("toe_r", "tibia_r", np.zeros((1, 3)), group="foot_r")
    forces = np.zeros((51, 2, 3))
    forces[:, :, 1] = [200.0, 100.0]
    points = np.tile([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]], (51, 1, 1))
    contacts = ContactForces(
        time=time,
        sites=(site, toe),
        contact_activation=np.ones((51, 2)),
        contact_force=forces,
        contact_point=points,
        contact_torque=np.zeros_like(forces),
    )
    body = PlayedBody(having(given, forces=contacts))
    assert body.at(75).estimated[:, 0] == pytest.approx(np.array([[0.1, 0.0, 0.0]]))
    assert np.isnan(body.at(10).estimated).all(), "nothing is known before the contacts' clock"
    chart = charts.force_chart(body)
    assert chart is not None
    mine = next(one for one in chart.curves if one.label == "foot_r, estimated")
    assert mine.dashed
    assert mine.values[75] == pytest.approx(300.0)
    assert np.isnan(mine.values[10])


def test_markers_of_the_model_are_those_recorded() -> None:
    given = everything()
    assert given.model is not None
    markers = tuple(
        Marker(name, "femur_r", np.array([0.1, 0.0, 0.0])) for name in ("RASI", "RKNE", "UNSEEN")
    )
    recorded = Markers(given.kinematics.markers.time, ("RKNE",), np.full((200, 1, 3), np.nan))  # type: ignore[union-attr]
    body = PlayedBody(having(given, model=replace(given.model, markers=markers), markers=recorded))
    instant = body.at(30)
    assert instant.modelled.shape == (1, 3)
    thigh = given.model.body_names.index("femur_r") + 1
    assert instant.modelled[0] == pytest.approx(
        instant.rotations[thigh] @ [0.1, 0.0, 0.0] + instant.origins[thigh], abs=1e-12
    )
    assert np.isnan(instant.recorded).all()


def test_a_frame_without_a_pose_is_told_and_shows_the_last_one() -> None:
    given = everything()
    assert given.kinematics.fit is not None
    values = np.array(given.kinematics.fit.motion.values)
    values[50:60, 2] = np.nan
    values[:3] = np.nan
    moved = Motion(given.kinematics.fit.motion.time, given.kinematics.fit.motion.names, values)
    body = PlayedBody(having(given, fit=replace(given.kinematics.fit, motion=moved)))
    assert not body.at(55).known
    assert body.at(55).origins == pytest.approx(body.at(49).origins)
    assert body.at(0).origins == pytest.approx(body.at(3).origins)
    assert np.isfinite(body.at(55).tubes.positions).all()
    chart = charts.coordinate_chart(body, "Hip flexion", ("hip_flexion_r", "hip_flexion_l"))
    assert np.isnan(chart.curves[0].values[:3]).all()


def test_what_cannot_be_shown_is_told() -> None:
    body = model()
    with pytest.raises(BadData, match="has no motion to show"):
        PlayedBody(shown("empty", model=body))
    still = motion(body, 5)
    nothing = Motion(still.time, still.names, np.full_like(still.values, np.nan))
    with pytest.raises(BadData, match="no frame of the motion"):
        PlayedBody(shown("gone", model=body, coordinates=nothing))


def test_a_body_without_muscles_forces_or_masses_is_shown() -> None:
    bare = replace(model(), muscles=())
    light = replace(bare, bodies=tuple(replace(one, mass=0.0) for one in bare.bodies))
    for one in (bare, light):
        body = PlayedBody(shown("bare", model=one, coordinates=motion(one, 20)))
        instant = body.at(5)
        assert not len(instant.tubes.positions)
        assert not len(instant.measured)
        assert charts.force_chart(body) is None
        assert charts.muscle_chart(body, charts.strongest(body), ACTIVATION) is None
        assert (charts.center_chart(body) is None) == (one is light)


def test_curves_hold_the_values_in_their_units() -> None:
    given = everything()
    emg = Emg(given.dynamics.wrenches.time, ("CH1",), np.full((200, 1), 0.3))  # type: ignore[union-attr]
    body = PlayedBody(having(given, emg=emg, emg_muscles={"CH1": ("recfem_r",)}))
    choices = charts.coordinate_choices(body)
    label = next(one for one, names in choices.items() if "hip_flexion_r" in names)
    assert set(choices[label]) == {"hip_flexion_r", "hip_flexion_l"}
    chart = charts.coordinate_chart(body, label, choices[label])
    assert "[°]" in chart.title
    assert chart.curves[0].values == pytest.approx(np.rad2deg(body.motion["hip_flexion_r"]))
    ways = charts.coordinate_chart(body, "tx", ("pelvis_tx",))
    assert "[m]" in ways.title
    assert ways.curves[0].values == pytest.approx(body.motion["pelvis_tx"])
    active = charts.muscle_chart(body, (body.muscles.index("recfem_r"),), ACTIVATION)
    assert active is not None
    assert [one.label for one in active.curves] == ["recfem_r", "EMG CH1"]
    center = charts.center_chart(body)
    assert center is not None
    assert np.ptp(center.curves[1].values) == pytest.approx(100.0 * 1.2 * body.time[-1], rel=0.1)
    assert {body.muscles[m][:-2] for m in charts.strongest(body)} == {"glmax2"}


def test_bands_are_the_limits_of_their_own_column_in_the_units_of_the_curve() -> None:
    given = everything()
    tension = given.tension
    motion = given.kinematics.motion
    assert tension is not None
    assert motion is not None
    muscles = Spread(
        time=tension.time,
        names=tension.muscles,
        low=tension.muscle_force - 3.0,
        high=tension.muscle_force + 5.0,
        deviation=tension.muscle_force,
    )
    angles = Spread(
        time=motion.time,
        names=motion.names,
        low=motion.values - 0.1,
        high=motion.values + 0.2,
        deviation=motion.values,
    )
    found = Uncertainty(FrozenMap({"muscle_force": muscles, "coordinate_value": angles}), draws=20)
    body = PlayedBody(replace(given, uncertainty=found))
    chart = charts.coordinate_chart(body, "hip", ("hip_flexion_r", "hip_flexion_l"))
    for one in chart.curves:
        assert one.values - one.low == pytest.approx(np.rad2deg(0.1))
        assert one.high - one.values == pytest.approx(np.rad2deg(0.2))
    pull = charts.muscle_chart(
        body, (body.muscles.index("recfem_l"), body.muscles.index("recfem_r")), MUSCLE_FORCE
    )
    assert pull is not None
    inside = np.isfinite(pull.curves[0].values) & np.isfinite(pull.curves[0].low)
    assert inside.sum() > 0.9 * len(body.time)
    assert (pull.curves[0].high - pull.curves[0].values)[inside] == pytest.approx(5.0, abs=1e-6)
    active = charts.muscle_chart(body, (0, 1), ACTIVATION)
    assert active is not None
    assert pull.banded == (0, 1)
    assert active.banded == (), "of a table without limits there is no band"
    many = charts.muscle_chart(body, tuple(range(charts.MAX_BANDS + 1)), MUSCLE_FORCE)
    assert many is None or many.banded == ()


def test_muscles_are_found_by_parts_of_their_names() -> None:
    index = MuscleIndex(("glmax1_r", "glmax1_l", "bflh_r", "bfsh_r", "soleus_r"))
    assert index.matches("glmax") == ("glmax1_r", "glmax1_l")
    assert index.matches("Gluteus maximus right") == ("glmax1_r",)
    assert index.matches("SOLEUS_R") == ("soleus_r",)
    assert index.matches("biceps femoris long") == ("bflh_r",)
    assert index.matches("") == index.matches("nothing like it") == ()


def test_plates_keep_their_outline_in_any_order() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 2], [0, 0, 2]], dtype=float)
    none = np.zeros((0, 3))
    for order in ([0, 1, 2, 3], [2, 0, 3, 1], [3, 1, 0, 2]):
        corners = ForcePlate(
            name="one", kind=2, corners=square[order], forces=none, points=none, torques=none
        ).corners
        around = corners[outline(corners)]
        sides = np.linalg.norm(around - np.roll(around, -1, axis=0), axis=1)
        assert sorted(sides) == pytest.approx([1, 1, 2, 2])


def test_faces_look_outwards() -> None:
    ball = sphere(0.3)
    inside_out = Surface(ball.vertices + 5.0, ball.faces[:, ::-1])
    for one in (outward(ball), outward(inside_out)):
        middle = one.vertices.mean(axis=0)
        facing = np.einsum("ij,ij->i", normals(one), one.vertices - middle)
        assert facing[np.linalg.norm(normals(one), axis=1) > 0].min() > 0.2


def test_surfaces_are_reduced_to_what_a_screen_needs() -> None:
    balls = [Surface(sphere(0.5, 40, 40).vertices, sphere(0.5, 40, 40).faces), sphere(0.1)]
    fewer = reduced(balls, 1.0, 1000)
    assert sum(len(one.faces) for one in fewer) <= 1000
    assert len(fewer[0].faces) > 300
    assert len(fewer[1].faces) > 30
    assert reduced(balls, 1.0, 10**6)[0] is balls[0]


def test_two_people_in_one_model_have_a_center_and_a_color_each() -> None:
    one = model()
    pair = join_models({"anna": one, "bo": one})
    moved = join_motions({"anna": motion(one), "bo": motion(one)})
    apart = np.array(moved.values)
    apart[:, moved.names.index("bo_pelvis_tz")] += 1.4
    body = PlayedBody(shown("pair", model=pair, coordinates=replace(moved, values=apart)))
    assert [who.name for who in body.subjects] == ["anna", "bo"]
    centers = body.at(30).centers
    assert centers[1] - centers[0] == pytest.approx([0.0, 0.0, 1.4], abs=1e-9)
    assert body.at(30).middle == pytest.approx(centers.mean(axis=0))
    alone = PlayedBody(shown("anna", model=one, coordinates=motion(one)))
    assert body.size == pytest.approx(alone.size, rel=0.1), "thickness is that of one person"
    pushed = having(body.results, wrenches=steps(moved.time, one.mass * GRAVITY))
    ends = PlayedBody(pushed).at(60).measured
    own = PlayedBody(having(alone.results, wrenches=pushed.dynamics.wrenches))
    assert np.linalg.norm(np.diff(ends[0], axis=0)) == pytest.approx(
        np.linalg.norm(np.diff(own.at(60).measured[0], axis=0)), rel=0.1
    ), "a body weight is that of one person"
    chart = charts.center_chart(body)
    assert chart is not None
    assert [one.label for one in chart.curves] == [
        f"{who} {way}" for who in ("anna", "bo") for way in WAYS
    ]
    found = MuscleIndex(body.muscles, [who.prefix for who in body.subjects]).matches(
        "bo rectus femoris"
    )
    assert found == ("bo_recfem_r", "bo_recfem_l")


def test_the_way_over_the_floor() -> None:
    assert PlayedBody(everything()).travelled == pytest.approx(1.2 * 1.99, rel=1e-6)
    still = motion(model(), 50)
    assert (
        PlayedBody(
            shown("x", model=model(), coordinates=still, wrenches=steps(still.time, 600.0))
        ).travelled
        < 0.7
    )

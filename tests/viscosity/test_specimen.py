"""A specimen is the larger model, less what is not fixed to the plate or does not hang from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swung_specimen import CENTER, NAMES, arm_model, limb_parameters

from mujoco_models import compiled
from myomorph.core.io.formats import read_model
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.errors import BadModel, UnknownName
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.passive_dynamics import line_viscosity
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.simulate.limb import TRIANGLE, with_clusters
from myomorph.swings.viscosity.specimen.bodies import moved_parameters
from myomorph.swings.viscosity.specimen.model import Specimen, SpecimenNames, build_specimen
from myomorph.swings.viscosity.specimen.muscles import FIGURE_1, fig1_muscles
from myomorph.swings.viscosity.swings.motion import lengthening, limb_motion

AT_REST = Motion(np.zeros(1), (), np.zeros((1, 0)))
THORACOSCAPULAR = "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"


def thoracoscapular(data: Callable[[str], Path]) -> tuple[Model, SpecimenNames]:
    model = read_model(data(THORACOSCAPULAR))
    return model, SpecimenNames(
        base="scapula",
        first="humerus",
        bones=("ulna", "radius", "hand"),
        muscles=fig1_muscles(model),
    )


def myosuite() -> tuple[Model, SpecimenNames]:
    model = model_from_mujoco(compiled("myoarm"))
    return model, SpecimenNames(
        base="scapula_r",
        first="humerus_r",
        bones=("ulna_r", "radius_r", "thirdmc_r"),
        muscles=fig1_muscles(model),
    )


def bodies_of(model: Model) -> dict[str, Transform]:
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(AT_REST))
    return {
        name: Transform(poses.rotations[0, b], poses.origins[0, b])
        for name, b in tree.body_index.items()
    }


def same_as_source(model: Model, specimen: Specimen, length: float = 1e-9) -> None:
    """Bones and muscles stand as in the source's default pose."""
    source = bodies_of(model)
    own = bodies_of(specimen.model)
    for name in specimen.model.body_names:
        np.testing.assert_allclose(own[name].rotation, source[name].rotation, atol=1e-12)
        np.testing.assert_allclose(own[name].translation, source[name].translation, atol=1e-12)
    lengths = muscle_kinematics(specimen.model, AT_REST, velocities=False).muscle_length[0]
    wanted = muscle_kinematics(model, AT_REST, velocities=False)
    chosen = [wanted.muscles.index(name) for name in specimen.model.muscle_names]
    np.testing.assert_allclose(lengths, wanted.muscle_length[0, chosen], atol=length)


def test_the_made_arm_stands_as_in_its_model():
    model = arm_model()
    specimen = build_specimen(model, NAMES)
    same_as_source(model, specimen)
    assert specimen.model.body_names == ("scapula", "humerus", "ulna", "radius", "hand")
    assert specimen.held_coordinates == ("elbow", "forearm", "wrist_a", "wrist_b")
    np.testing.assert_allclose(specimen.center, CENTER, atol=1e-12)
    np.testing.assert_allclose(specimen.center_in_limb, 0.0, atol=1e-12)
    assert specimen.muscles == NAMES.muscles


def test_figure_1_of_the_myosuite_arm():
    model, names = myosuite()
    specimen = build_specimen(model, names)
    same_as_source(model, specimen)
    assert tuple(specimen.muscles) == tuple(FIGURE_1)
    assert not specimen.notes
    assert specimen.held_coordinates == ("elbow_flexion_r", "pro_sup_r", "deviation_r", "flexion_r")


def test_figure_1_of_the_thoracoscapular_model(data):
    model, names = thoracoscapular(data)
    specimen = build_specimen(model, names)
    # Teres major loses the surface on the thorax, which it touches by 1.2 micrometers.
    same_as_source(model, specimen, 2e-6)
    assert tuple(specimen.muscles) == tuple(FIGURE_1)
    assert sum(len(strands) for strands in specimen.muscles.values()) == 15
    assert [note.split("'")[1] for note in specimen.notes] == ["Supraspinatus_A", "TeresMajor"]
    # The model welds the hand; wires may hold it at another angle.
    assert specimen.held_coordinates == (
        "elbow_flexion",
        "pro_sup",
        "hand_rx",
        "hand_ry",
        "hand_rz",
    )


@pytest.mark.parametrize("coordinate", ["elbow", "forearm", "wrist_a", "wrist_b"])
def test_held_joints_move_the_bones_as_the_source_does(coordinate):
    model = arm_model()
    specimen = build_specimen(model, NAMES)

    def hand(one: Model) -> Transform:
        posed = replace(
            one,
            coordinates=tuple(
                replace(c, default=0.4) if c.name == coordinate else c for c in one.coordinates
            ),
        )
        return bodies_of(posed)["hand"]

    source = hand(model)
    own = hand(specimen.model)
    np.testing.assert_allclose(own.rotation, source.rotation, atol=1e-12)
    np.testing.assert_allclose(own.translation, source.translation, atol=1e-12)


def test_no_mass_of_the_limb_is_lost():
    model = arm_model()
    specimen = build_specimen(model, NAMES)
    table = dict(zip(model.body_names, inertial_parameters(model), strict=True))
    poses = bodies_of(model)
    frame = poses["humerus"] @ Transform(np.eye(3), specimen.center_in_limb)
    beyond = ("humerus", "ulna", "radius", "carpus", "hand", "finger")
    wanted = sum(moved_parameters(table[name], frame.inverse() @ poses[name]) for name in beyond)
    np.testing.assert_allclose(limb_parameters(specimen, {}), wanted, rtol=1e-12, atol=1e-14)


def test_inertia_moves_as_points_of_mass_do():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3))
    masses = rng.uniform(0.1, 1.0, 20)
    pose = Transform.from_euler_xyz(rng.normal(size=3), rng.normal(size=3))

    def parameters(places):
        second = np.einsum("p,pi,pj->ij", masses, places, places)
        inertia = np.trace(second) * np.eye(3) - second
        return np.array(
            [
                masses.sum(),
                *(masses @ places),
                *np.diag(inertia),
                inertia[1, 2],
                inertia[2, 0],
                inertia[0, 1],
            ]
        )

    np.testing.assert_allclose(
        moved_parameters(parameters(points), pose), parameters(pose.apply(points)), rtol=1e-12
    )


def swinging(specimen: Specimen, frames: int = 200) -> Motion:
    """Make a smooth motion of the joint, large in all angles."""
    time = 0.005 * np.arange(frames)
    phases = np.arange(len(specimen.joint_coordinates))
    angles = 0.7 * np.sin(6.0 * time[:, None] + phases) + 0.3 * np.cos(9.0 * time[:, None] - phases)
    return differentiate(Motion(time, specimen.joint_coordinates, angles))


def test_rates_are_the_derivative_of_the_rotation():
    specimen = build_specimen(arm_model(), NAMES)
    motion = swinging(specimen)
    limb = limb_motion(specimen, motion)
    step = np.einsum("fji,fjk->fik", limb.rotations[:-2], limb.rotations[2:])
    spin = 0.5 * np.stack(
        [
            step[:, 2, 1] - step[:, 1, 2],
            step[:, 0, 2] - step[:, 2, 0],
            step[:, 1, 0] - step[:, 0, 1],
        ],
        1,
    )
    np.testing.assert_allclose(spin / 0.01, limb.rates[1:-1], atol=3e-3 * np.abs(limb.rates).max())


def test_rows_are_the_inverse_dynamics_of_the_welded_limb():
    """Virtual work: torque along the axes, mapped by the slopes, is the coordinates' torque."""
    specimen = build_specimen(arm_model(), NAMES)
    motion = swinging(specimen)
    limb = limb_motion(specimen, motion)
    phi = limb_parameters(specimen, {})
    torques = limb.torque_rows @ phi
    found = np.einsum("fac,fa->fc", limb.slopes, torques)
    whole = inverse_dynamics(specimen.model, motion)
    np.testing.assert_allclose(
        found,
        np.stack([whole[name] for name in specimen.joint_coordinates], axis=1),
        rtol=1e-9,
        atol=1e-10,
    )
    # The base carries the same wrench: its own weight, which a plate set to zero does not show,
    # taken off.
    base = np.stack([whole[name] for name in specimen.base_coordinates[:3]], axis=1)
    still = (
        -specimen.model.body("scapula").mass * specimen.stand.rotation.T @ specimen.model.gravity
    )
    force = (limb.wrench_rows @ phi)[:, 3:] @ specimen.stand.rotation
    np.testing.assert_allclose(force + still, base, rtol=1e-9, atol=1e-9)


def test_lengthening_is_the_velocity_of_the_muscles():
    specimen = build_specimen(arm_model(), NAMES)
    motion = swinging(specimen)
    limb = limb_motion(specimen, motion)
    J = lengthening(specimen, motion, limb.slopes)
    speeds = np.einsum("fma,fa->fm", J, limb.rates)
    wanted = muscle_kinematics(specimen.model, motion)
    velocity = dict(zip(wanted.muscles, wanted.muscle_velocity.T, strict=True))
    np.testing.assert_allclose(speeds[:, 0], velocity["front"], atol=1e-12)
    for column, strand in ((1, "back_1"), (2, "back_2")):
        np.testing.assert_allclose(speeds[:, column], np.sqrt(0.5) * velocity[strand], atol=1e-12)


def test_strands_share_the_viscosity_of_their_muscle():
    """What a muscle's viscosity takes from the swing is what its lines of action take.

    Each has its share.
    """
    specimen = build_specimen(arm_model(), NAMES)
    motion = swinging(specimen)
    limb = limb_motion(specimen, motion)
    viscosity = {"front": 30.0, "back": 80.0, "long": 50.0}
    strands = line_viscosity(viscosity, specimen.muscles)
    speeds = np.einsum("fsa,fa->fs", lengthening(specimen, motion, limb.slopes), limb.rates)
    of = [viscosity[name] for name, own in specimen.muscles.items() for _ in own]
    wanted = muscle_kinematics(specimen.model, motion)
    power = sum(
        strands[name] * v**2
        for name, v in zip(wanted.muscles, wanted.muscle_velocity.T, strict=True)
    )
    np.testing.assert_allclose(np.square(speeds) @ of, power, rtol=1e-10)


def test_where_coordinates_are_zero_is_free():
    """Stand and rest only set from where coordinates count.

    Moment arms about the limb's own axes are the same.
    """
    specimen = build_specimen(arm_model(), NAMES)
    turn = axis_rotation(np.array([0.6, 0.0, 0.8]), 0.9)
    rest = specimen.stand.rotation.T @ bodies_of(specimen.model)["humerus"].rotation
    other = specimen.resting(rest @ turn)
    still = Motion(
        time=np.zeros(1),
        names=specimen.joint_coordinates,
        values=np.zeros((1, 3)),
        velocities=np.zeros((1, 3)),
        accelerations=np.zeros((1, 3)),
    )
    # Where the other one is zero, in the angles of the first.
    angles = Rotation.from_matrix(turn).as_euler("XYZ")[None]
    same = replace(still, values=angles)
    one = limb_motion(specimen, same)
    two = limb_motion(other, still)
    np.testing.assert_allclose(one.rotations, two.rotations, atol=1e-12)
    np.testing.assert_allclose(one.torque_rows, two.torque_rows, atol=1e-12)
    np.testing.assert_allclose(
        lengthening(specimen, same, one.slopes), lengthening(other, still, two.slopes), atol=1e-9
    )


def test_a_hinge_has_the_axis_of_the_models_joint():
    model = arm_model()
    specimen = build_specimen(
        model, SpecimenNames("humerus", "ulna", ("radius", "hand"), joint="hinge")
    )
    assert specimen.joint_coordinates == specimen.axes == ("ulna_angle",)
    np.testing.assert_allclose(specimen.axis_vectors, [[0.0, 0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(specimen.center_in_limb, 0.0, atol=1e-12)
    motion = swinging(specimen)
    limb = limb_motion(specimen, motion)
    np.testing.assert_allclose(limb.rates, motion.velocities, atol=1e-12)
    torque = limb.torque_rows @ limb_parameters(specimen, {})
    np.testing.assert_allclose(
        torque[:, 0], inverse_dynamics(specimen.model, motion)["ulna_angle"], atol=1e-9
    )


def test_clusters_can_be_told_by_their_sides():
    specimen = with_clusters(build_specimen(arm_model(), NAMES), arm=0.04)
    assert len(specimen.model.markers) == 15
    for bone in specimen.model.body_names:
        places = [one.location for one in specimen.model.markers if one.body == bone]
        sides = sorted(np.linalg.norm(places[i] - places[j]) for i, j in ((0, 1), (1, 2), (0, 2)))
        assert np.diff(sides).min() > 0.012
    assert np.linalg.norm(TRIANGLE, axis=1).max() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("names", "error", "says"),
    [
        (SpecimenNames("scapla", "humerus"), UnknownName, "unknown body 'scapla'"),
        (SpecimenNames("ulna", "humerus"), BadModel, "'humerus' is not attached to 'ulna'"),
        (
            SpecimenNames("scapula", "humerus", ("trunk",)),
            BadModel,
            "bone 'trunk' is not attached to 'humerus'",
        ),
        (
            SpecimenNames(base="scapula", first="humerus", bones=(), muscles={"a": ("chest",)}),
            BadModel,
            "'chest' runs over 'trunk'",
        ),
        (
            SpecimenNames(base="scapula", first="humerus", bones=(), muscles={"a": ("bakc",)}),
            UnknownName,
            "unknown muscle 'bakc'",
        ),
        (SpecimenNames("scapula", "humerus", joint="hinge"), BadModel, "is no hinge"),
    ],
)
def test_what_cannot_be_a_specimen_is_named(names, error, says):
    with pytest.raises(error) as told:
        build_specimen(arm_model(), names)
    assert says in str(told.value)


def test_muscles_that_are_not_asked_for_by_name_are_those_between_base_and_limb():
    specimen = build_specimen(arm_model(), replace(NAMES, muscles={}))
    assert set(specimen.muscles) == {"front", "back_1", "back_2", "long"}


def test_other_names_of_muscles_are_refused_by_name():
    with pytest.raises(BadModel, match="does not name the 11 muscles"):
        fig1_muscles(arm_model())

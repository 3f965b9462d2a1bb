"""Two models as one: each part keeps its dynamics; only what passes between couples them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import opensim_oracle
from mujoco_models import compiled
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.inertia import free_object, hinged_object
from myomorph.core.model.join import (
    check_clocks,
    join_models,
    join_motions,
    join_series,
    join_wrenches,
    own_name,
    part_of,
)
from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.core.model.sides import mirror_names
from myomorph.core.motion.clocks import on_one_clock
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from opensim_inverse import opensim_torques
from stick_figure import stick_figure

WALKER = "rajagopal-walk-emg/subject_walk_scaled.osim"
RUNNER = "hamner-run-subject04/unscaled_generic.osim"


def moving(model, frames=9, seed=0):
    """Any smooth motion of a model: coordinates about their defaults, with rates."""
    random = np.random.default_rng(seed)
    n = len(model.coordinates)
    time = np.arange(frames) / 100.0
    size = random.uniform(0.05, 0.3, n)
    pace = random.uniform(2.0, 9.0, n)
    phase = random.uniform(0.0, 6.0, n)
    angle = np.outer(time, pace) + phase
    rest = np.array([one.default for one in model.coordinates])
    return Motion(
        time,
        model.coordinate_names,
        rest + size * np.sin(angle),
        velocities=size * pace * np.cos(angle),
        accelerations=-size * pace**2 * np.sin(angle),
    )


def pulls(motion, model, bodies, seed=3):
    """Make forces on bodies anywhere near their origins, with free torques."""
    random = np.random.default_rng(seed)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    places = poses.origins[:, [tree.body_index[one] for one in bodies]]
    shape = places.shape
    names = tuple(f"pull_{k}" for k in range(len(bodies)))
    return Wrenches(
        time=motion.time,
        names=names,
        bodies=tuple(bodies),
        forces=random.normal(size=shape) * 50,
        points=places + 0.1 * random.normal(size=shape),
        torques=random.normal(size=shape),
    )


def pair(data):
    return {"tori": read_osim(data(WALKER)), "uke": read_osim(data(RUNNER))}


def test_torques_of_the_whole_are_those_of_the_parts(data):
    parts = pair(data)
    whole = join_models(parts)
    motions = {part: moving(model, seed=k) for k, (part, model) in enumerate(parts.items())}
    loads = {
        part: pulls(motions[part], model, ("pelvis", "calcn_r")) for part, model in parts.items()
    }
    torques = inverse_dynamics(whole, join_motions(motions), join_wrenches(loads))
    for part, model in parts.items():
        own = inverse_dynamics(model, motions[part], loads[part])
        found = part_of(torques, part)
        assert found.names == own.names
        np.testing.assert_allclose(found.values, own.values, rtol=1e-10, atol=1e-9)
    assert join_series({part: part_of(torques, part) for part in parts}).names == torques.names


def test_a_pull_between_the_parts_leaves_their_common_momentum_alone(data):
    parts = pair(data)
    whole = join_models(parts)
    motion = join_motions(
        {part: moving(model, seed=k) for k, (part, model) in enumerate(parts.items())}
    )
    one = pulls(motion, whole, ("tori_hand_r",))
    both = Wrenches(
        time=motion.time,
        names=("pull", "reaction"),
        bodies=("tori_hand_r", "uke_torso"),
        forces=np.concatenate([one.forces, -one.forces], axis=1),
        points=np.concatenate([one.points] * 2, axis=1),
        torques=np.concatenate([one.torques, -one.torques], axis=1),
    )
    free = inverse_dynamics(whole, motion)
    pulled = inverse_dynamics(whole, motion, both)
    slides = [
        [n for n in whole.coordinate_names if n.startswith(part) and n.endswith(f"pelvis_t{x}")]
        for part in parts
        for x in "xyz"
    ]
    changes = np.array([pulled[name] - free[name] for (name,) in slides]).reshape(2, 3, -1)
    np.testing.assert_allclose(changes.sum(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(changes[0], -one.forces[:, 0].T, atol=1e-9)


def test_paths_and_moment_arms_are_those_of_the_parts(data):
    parts = {"mouse": read_osim(data(RUNNER)), "arm": model_from_mujoco(compiled("myoarm_r"))}
    gravity = parts["mouse"].gravity
    parts["arm"] = replace(parts["arm"], gravity=gravity)
    whole = join_models(parts)
    motions = {
        part: moving(model, frames=3, seed=k) for k, (part, model) in enumerate(parts.items())
    }
    joined = muscle_kinematics(whole, join_motions(motions))
    for part, model in parts.items():
        own = muscle_kinematics(model, motions[part])
        muscles = [whole.muscle_names.index(f"{part}_{name}") for name in model.muscle_names]
        columns = [
            whole.coordinate_names.index(f"{part}_{name}") for name in model.coordinate_names
        ]
        np.testing.assert_allclose(joined.muscle_length[:, muscles], own.muscle_length, atol=1e-12)
        arms = joined.dense()[:, muscles]
        np.testing.assert_allclose(arms[:, :, columns], own.dense(), atol=1e-10)
        assert not np.delete(arms, columns, axis=2).any()


def test_opensim_opens_the_whole_and_agrees(data, tmp_path):
    pytest.importorskip("opensim")
    parts = pair(data)
    whole = join_models(parts)
    path = tmp_path / "pair.osim"
    write_osim(whole, path)
    facts = opensim_oracle.ask({"pair": path}, tmp_path)["pair"]
    assert isinstance(facts, dict), facts
    assert set(facts["bodies"]) == set(whole.body_names)
    assert facts["mass"] == pytest.approx(sum(one.mass for one in parts.values()), abs=1e-9)
    tree = compile_tree(whole)
    for pose in facts["poses"]:
        values = np.array([[pose["coordinates"][name] for name in whole.coordinate_names]])
        poses = forward_kinematics(tree, values)
        for name, (rotation, origin) in pose["bodies"].items():
            k = tree.body_index[name]
            np.testing.assert_allclose(poses.origins[0, k], origin, atol=1e-9)
            np.testing.assert_allclose(poses.rotations[0, k], rotation, atol=1e-9)
    again = read_osim(path)
    motion = join_motions({part: moving(model, frames=2) for part, model in parts.items()})
    np.testing.assert_allclose(
        inverse_dynamics(again, motion).values,
        inverse_dynamics(whole, motion).values,
        rtol=1e-9,
        atol=1e-9,
    )


def test_torques_of_a_pair_are_those_of_opensim(data, tmp_path):
    model = read_osim(data("opensim-gait-subject01/ref_rra/subject01_simbody_adjusted.osim"))
    whole = join_models(
        {"tori": model, "uke": model, "box": free_object("box", 15.0, (0.6, 0.3, 0.4))}
    )
    write_osim(whole, tmp_path / "pair.osim")
    motion = moving(whole, frames=3)
    theirs = opensim_torques(
        tmp_path / "pair.osim", whole, motion.values, motion.velocities, motion.accelerations
    )
    np.testing.assert_allclose(inverse_dynamics(whole, motion).values, theirs, rtol=1e-8, atol=1e-7)


def test_parts_that_are_kept_name_what_they_meant(data):
    model = read_osim(data("shoulder-bonepin/subject1_abdbonepin.osim"))
    whole = join_models({"a": model, "b": model})
    limits = [one for one in model.kept if one.kind == "CoordinateLimitForce"]
    assert len(limits) == 5
    for part in ("a", "b"):
        for one in limits:
            (found,) = [other for other in whole.kept if other.name == f"{part}_{one.name}"]
            assert f'name="{part}_{one.name}"' in found.text
            coordinate = next(name for name in model.coordinate_names if f">{name}<" in one.text)
            assert f">{part}_{coordinate}<" in found.text
    assert len([one for one in whole.kept if one.kind == "credits"]) <= 1


def test_kept_parts_refer_to_each_other_by_their_new_names(data):
    model = read_osim(data("lenhart-knee-contact-walk/lenhart2015.osim"))
    whole = join_models({"tori": model})
    meshes = [one.name for one in model.kept if one.kind == "Smith2018ContactMesh"]
    force, *_ = [one for one in whole.kept if one.kind == "Smith2018ArticularContactForce"]
    assert sum(f"/contactgeometryset/tori_{name}<" in force.text for name in meshes) == 2
    ligament = next(one for one in whole.kept if one.kind == "Blankevoort1991Ligament")
    bodies = re.findall(r"/bodyset/([^<]+)<", ligament.text)
    assert bodies
    assert all(name in whole.body_names for name in bodies)


def test_sides_are_still_told_apart():
    figure = stick_figure()
    whole = join_models({"tori": figure, "uke": figure})
    mirrored = mirror_names(whole.body_names)
    assert mirrored["tori_femur_r"] == "tori_femur_l"
    assert mirrored["uke_tibia_l"] == "uke_tibia_r"


def test_a_box_falls_and_turns_as_a_rigid_body_does():
    center = np.array([0.1, -0.05, 0.02])
    box = free_object("box", 15.0, (0.6, 0.3, 0.4), mass_center=center)
    motion = moving(box)
    tree = compile_tree(box)
    c = tree.coordinates_of(motion)
    step = 1e-5
    path = [
        center_of_mass(
            tree,
            forward_kinematics(
                tree,
                c + k * step * motion.velocities + 0.5 * (k * step) ** 2 * motion.accelerations,
            ),
        )
        for k in (-1, 0, 1)
    ]
    acceleration = (path[0] - 2.0 * path[1] + path[2]) / step**2
    torques = inverse_dynamics(box, motion)
    np.testing.assert_allclose(
        torques.values[:, :3], 15.0 * (acceleration - box.gravity), rtol=1e-4, atol=1e-2
    )
    assert box.body("box").inertia[0, 0] == pytest.approx(15.0 / 12.0 * (0.3**2 + 0.4**2))


def test_a_wheel_turns_about_its_axle(tmp_path):
    pytest.importorskip("opensim")
    wheel = hinged_object(
        "wheel", 2.0, (1.0, 2.0, -0.5), inertia=(0.05, 0.05, 0.09), center=(0.0, 0.3, 0.1)
    )
    motion = moving(wheel)
    torques = inverse_dynamics(wheel, motion)
    np.testing.assert_allclose(torques.values, 0.09 * motion.accelerations, atol=1e-12)
    tree = compile_tree(wheel)
    axle = forward_kinematics(tree, np.array([[0.7]])).axis_directions[0, 0]
    np.testing.assert_allclose(axle, np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25), atol=1e-12)
    whole = join_models(
        {"chair": wheel, "box": free_object("box", 15.0, (0.6, 0.3, 0.4), mass_center=(0.1, 0, 0))}
    )
    write_osim(whole, tmp_path / "objects.osim")
    some = moving(whole)
    theirs = opensim_torques(
        tmp_path / "objects.osim", whole, some.values, some.velocities, some.accelerations
    )
    np.testing.assert_allclose(inverse_dynamics(whole, some).values, theirs, rtol=1e-9, atol=1e-9)


def test_reserves_and_residuals_belong_to_their_part():
    assert own_name("residual_FX_tori_pelvis", "tori") == "residual_FX_pelvis"
    assert own_name("reserve_uke_knee_angle_r", "uke") == "reserve_knee_angle_r"
    assert own_name("reserve_uke_knee_angle_r", "tori") is None
    series = Series(np.zeros(1), ("tori_a", "uke_a"), np.array([[1.0, 2.0]]))
    assert part_of(series, "uke").values.tolist() == [[2.0]]
    with pytest.raises(UnknownName, match="unknown part 'judge'"):
        part_of(series, "judge")


@pytest.mark.parametrize("name", ["r", "Left", "ground", "two words", "a/b", "", "_a", "a_"])
def test_a_part_needs_a_name_that_survives_files(name):
    with pytest.raises(BadData, match="cannot name a part"):
        join_models({name: stick_figure()})


def test_parts_whose_names_would_be_mixed_up_are_refused():
    with pytest.raises(BadData, match="'judo_uke' begins as the names of 'judo'"):
        join_models({"judo": stick_figure(), "judo_uke": stick_figure()})
    with pytest.raises(BadData, match="no parts"):
        join_models({})


def test_gravity_has_to_agree():
    figure = stick_figure()
    with pytest.raises(BadModel, match=r"gravity of 'uke' .* that of 'tori'"):
        join_models({"tori": figure, "uke": replace(figure, gravity=np.array([0.0, 0.0, -9.81]))})


def test_motions_of_different_clocks_are_refused_by_name():
    time = np.arange(100) / 100.0
    one = Motion(time, ("x",), np.sin(time)[:, None])
    for other, what in (
        (Motion(time + 5.0, ("x",), one.values), "no time in common"),
        (Motion(time + 0.004, ("x",), one.values), "clocks differ"),
        (Motion(time[:50] * 2.0, ("x",), one.values[:50]), "rate or length"),
    ):
        with pytest.raises(BadData, match=f"'tori' has 100 frames .*'uke'.*{what}"):
            join_motions({"tori": one, "uke": other})
    with pytest.raises(BadData, match="'uke' has no frames"):
        check_clocks({"tori": one, "uke": Motion(np.zeros(0), ("x",), np.zeros((0, 1)))})


def test_recordings_of_two_rates_meet_at_common_times():
    def recording(rate, start, stop):
        time = np.arange(round(start * rate), round(stop * rate) + 1) / rate
        places = np.stack([np.sin(3.0 * time), np.cos(2.0 * time), time], axis=1)[:, None]
        return Markers(time, ("m",), places)

    gap = recording(100.0, 0.5, 3.0)
    values = gap.values.copy()
    values[40:60] = np.nan
    parts, notes = on_one_clock(
        {"tori": recording(250.0, 0.0, 2.0), "uke": replace(gap, values=values)}
    )
    whole = join_series(parts)
    assert whole.time[0] == pytest.approx(0.5)
    assert whole.time[-1] == pytest.approx(2.0)
    assert whole.rate == pytest.approx(250.0)
    seen = np.isfinite(whole["uke_m"][:, 0])
    assert not seen[(whole.time > 0.9) & (whole.time < 1.09)].any()
    np.testing.assert_allclose(whole["uke_m"][seen], whole["tori_m"][seen], atol=2e-4)
    assert any(
        "'uke' (100 Hz) is resampled to the times of 'tori' (250 Hz)" in note for note in notes
    )
    assert any("'tori' loses 125 of 501 frames" in note for note in notes)
    with pytest.raises(BadData, match="no time in common; do their clocks"):
        on_one_clock({"tori": recording(100.0, 0.0, 1.0), "uke": recording(100.0, 7.0, 8.0)})
    same, nothing = on_one_clock({"tori": gap, "uke": gap})
    assert same["uke"] is gap
    assert nothing == ()

"""A model with something changed: a weaker muscle, another mass, parts away, coordinates locked."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return mm.example_files(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def model(files):
    return mm.read_model(files.model)


def test_a_weaker_muscle_is_otherwise_the_same(model) -> None:
    name = model.muscle_names[0]
    weak = model.with_muscle(name, strength=0.5)
    assert weak.muscle(name).max_isometric_force == 0.5 * model.muscle(name).max_isometric_force
    assert weak.muscle(name).path is model.muscle(name).path
    assert weak.muscles[1:] == model.muscles[1:]
    assert weak.bodies is model.bodies


def test_a_property_of_a_muscle_is_set_by_its_name(model) -> None:
    name = model.muscle_names[0]
    changed = model.with_muscle(name, optimal_fiber_length=0.07, enabled=False).muscle(name)
    assert (changed.optimal_fiber_length, changed.enabled) == (0.07, False)


def test_half_the_strength_takes_more_activation(model, files) -> None:
    fit = mm.inverse_kinematics(model, mm.read_recording(files.markers).markers)
    motion = mm.cut(mm.differentiate(fit.motion, cutoff=6.0), 0.2, 0.4)
    torques = mm.inverse_dynamics(model, motion)
    whole = mm.solve_tension(model, motion, torques)
    name = max(model.muscle_names, key=lambda one: whole.curve("activation", one).max())
    weak = mm.solve_tension(model.with_muscle(name, strength=0.5), motion, torques)
    before = whole.curve("activation", name)
    used = before > 0.02
    assert used.any()
    assert np.all(weak.curve("activation", name)[used] > before[used])


def test_masses_and_inertias_scale_together(model) -> None:
    heavy = model.with_mass(3.0 * model.mass)
    assert heavy.mass == pytest.approx(3.0 * model.mass)
    for old, new in zip(model.bodies, heavy.bodies, strict=True):
        np.testing.assert_allclose(new.inertia, 3.0 * old.inertia)
        np.testing.assert_array_equal(new.mass_center, old.mass_center)


def test_one_body_gets_another_mass(model) -> None:
    name = model.body_names[0]
    old = model.body(name)
    heavy = model.with_body(name, mass=2.0 * old.mass)
    assert heavy.mass == pytest.approx(model.mass + old.mass)
    np.testing.assert_allclose(heavy.body(name).inertia, 2.0 * old.inertia)
    with pytest.raises(mm.UnknownName):
        model.with_body("tail", mass=1.0)
    with pytest.raises(mm.BadData, match="kilograms above 0"):
        model.with_body(name, mass=0.0)


def test_parts_are_taken_away_and_the_rest_can_be_written(model, tmp_path) -> None:
    muscle = model.muscle_names[0]
    marker = model.marker_names[0]
    fewer = model.without(muscle, marker)
    assert muscle not in fewer.muscle_names
    assert marker not in fewer.marker_names
    mm.write_osim(fewer, tmp_path / "fewer.osim")
    again = mm.read_model(tmp_path / "fewer.osim")
    assert again.muscle_names == fewer.muscle_names
    assert again.marker_names == fewer.marker_names


def test_a_locked_coordinate_stays_where_it_is_put(model, files) -> None:
    markers = mm.read_recording(files.markers).markers
    locked = model.lock("elbow_flexion", at=0.3)
    fit = mm.inverse_kinematics(locked, markers)
    np.testing.assert_allclose(fit.motion["elbow_flexion"], 0.3)
    assert model.lock("elbow_flexion").coordinate("elbow_flexion").locked


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda model: model.with_muscle("soleos_r"), "soleos_r"),
        (lambda model: model.with_muscle(model.muscle_names[0], strength=0.0), "above 0"),
        (lambda model: model.with_muscle(model.muscle_names[0], force=1.0), "max_isometric_force"),
        (lambda model: model.with_mass(-1.0), "kilograms above 0"),
        (lambda model: model.without("nothing"), "nothing"),
        (lambda model: model.lock("nothing"), "nothing"),
    ],
)
def test_what_cannot_be_changed_is_named(model, change, message: str) -> None:
    with pytest.raises(mm.MyomorphError, match=message):
        change(model)


def test_a_coordinate_that_follows_others_is_not_locked() -> None:
    model = mm.demo_recording().model
    follower = next(iter(model.dependent_coordinates))
    with pytest.raises(mm.BadData, match="follows"):
        model.lock(follower)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda model, trial, fit: mm.inverse_kinematics(model, trial), "give its .markers"),
        (lambda model, trial, fit: mm.inverse_kinematics("x.osim", trial.markers), "read_model"),
        (lambda model, trial, fit: mm.inverse_kinematics(model, None), "None"),
        (lambda model, trial, fit: mm.inverse_kinematics(model, fit.motion), "got a Motion"),
        (lambda model, trial, fit: mm.differentiate(fit), "give its .motion"),
        (lambda model, trial, fit: mm.inverse_dynamics(model, fit), "give its .motion"),
        (lambda model, trial, fit: mm.inverse_dynamics(model, fit.motion, "a.mot"), "read_loads"),
        (lambda model, trial, fit: mm.muscle_kinematics(fit.motion, model), "expected a Model"),
        (lambda model, trial, fit: mm.solve_tension(model, fit.motion, fit), "torques: expected"),
        (lambda model, trial, fit: mm.calibrate(model, [trial]), "give its .markers"),
        (lambda model, trial, fit: mm.write_trc(trial, "x.trc"), "give its .markers"),
        (lambda model, trial, fit: mm.write_osim("a.osim", "b.osim"), "read_model"),
    ],
)
def test_a_wrong_argument_is_answered_in_a_sentence(model, files, call, message: str) -> None:
    trial = mm.read_recording(files.markers)
    fit = mm.inverse_kinematics(model, trial.markers)
    with pytest.raises(mm.BadData, match=message):
        call(model, trial, fit)

"""Fibers and tendons of a step: files, store, notes, numbers, the section of the report."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.dual import STALLED
from myomorph.core.tension.fiber_quantities import FIBER_WORK, WORK_TABLE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.lab.analysis.muscle_names import muscle_words
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.muscle_sections import _fiber_lines, fiber_section
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.report_input import Kinematics, ReportInput
from myomorph.lab.store.results import new_result, read_result
from myomorph.lab.store.stored_tension import get_tension, put_tension
from myomorph.lab.study.step.step import StepOutput
from myomorph.lab.study.trial.fiber_step import (
    LARGE_STRAIN,
    fiber_notes,
    fiber_numbers,
    fiber_signals,
    fiber_work,
    write_fibers,
)

ARM = "opensim-reference-small/"
ELASTIC = TensionOptions(tendons="elastic")


def arm(data) -> tuple[Model, Motion, Series]:
    """OpenSim's arm of two coordinates, 6 muscles, every second frame of 80, and its torques."""
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    whole = differentiate(
        motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model), 6.0
    )
    keep = slice(0, 80, 2)
    motion = whole.frames(keep)
    return model, motion, inverse_dynamics(model, motion)


def changed(model: Model, **muscle: float) -> Model:
    """Return the model with another first muscle."""
    return replace(model, muscles=(replace(model.muscles[0], **muscle), *model.muscles[1:]))


@pytest.fixture(scope="module")
def solved(data) -> tuple[Model, Motion, Tension]:
    """Solve the arm with two missing frames.

    The path of its first muscle is shorter than its slack tendon.
    """
    model, motion, torques = arm(data)
    model = changed(model, tendon_slack_length=model.muscles[0].tendon_slack_length + 0.2)
    values = np.array(torques.values)
    values[20:22] = np.nan
    return (
        model,
        motion,
        solve_tension(model, motion, Series(torques.time, torques.names, values), ELASTIC),
    )


@pytest.fixture(scope="module")
def stored(solved, tmp_path_factory):
    """Return what the step writes: the folder, its notes, and the result as it is read again."""
    model, _, tension = solved
    folder = tmp_path_factory.mktemp("fibers")
    with new_result(folder / "tension.nc") as writer:
        put_tension(writer, tension, ("",) * len(tension.reserve_names))
        notes = write_fibers(tension, model, None, StepOutput(writer, folder))
    return folder, notes, read_result(folder / "tension.nc")


def test_files_hold_fibers_and_tendons(solved, stored):
    tension = solved[2]
    folder = stored[0]
    held = {
        "fiber_lengths": tension.fibers.fiber_length,
        "fiber_velocities": tension.fibers.fiber_velocity,
        "tendon_strains": tension.fibers.tendon_strain,
        "tendon_forces": tension.muscle_force,
        "fiber_powers": tension.fibers.fiber_power,
        "tendon_powers": tension.fibers.tendon_power,
    }
    for name, values in held.items():
        table = read_sto(folder / f"{name}.sto")
        assert tuple(table.names) == tension.muscles
        assert np.allclose(table.values, values, rtol=1e-8, atol=1e-9, equal_nan=True)


def test_a_result_gives_back_its_fibers(solved, stored):
    tension = solved[2]
    found = get_tension(stored[2], ELASTIC)
    for name in (
        "fiber_length",
        "fiber_velocity",
        "tendon_strain",
        "fiber_power",
        "tendon_power",
        "transient",
        "bridged",
    ):
        assert np.array_equal(
            getattr(found.fibers, name), getattr(tension.fibers, name), equal_nan=True
        )
    assert found.fibers.rigid == tension.fibers.rigid
    assert found.fibers.unreachable == tension.fibers.unreachable
    for name in ("residual", "equilibrium", "steps", "second_activations"):
        own = getattr(tension.fibers.certificate, name)
        read = getattr(found.fibers.certificate, name)
        assert own == read or (np.isnan(own) and np.isnan(read))


def test_rigid_tendons_write_nothing(data, tmp_path):
    model, motion, torques = arm(data)
    tension = solve_tension(model, motion, torques)
    with new_result(tmp_path / "tension.nc") as writer:
        put_tension(writer, tension, ("",) * len(tension.reserve_names))
        assert write_fibers(tension, model, None, StepOutput(writer, tmp_path)) == ()
    assert [one.name for one in tmp_path.iterdir()] == ["tension.nc"]
    assert get_tension(read_result(tmp_path / "tension.nc"), TensionOptions()).fibers is None


def test_what_cannot_reach_and_what_is_bridged_is_reported_with_its_place(solved, stored):
    model, motion, tension = solved
    first, second = stored[1][:2]
    assert first.startswith(
        f"{model.muscles[0].name}: the path is shorter than the slack tendon, first at "
    )
    assert f"{motion.time[tension.fibers.unreachable[0].frame]:.3f} s" in first
    assert "in 2 frames" in second
    assert f"{motion.time[20]:.3f}" in second


def test_fibers_that_are_too_long_are_reported_and_still_solved(data):
    model, motion, torques = arm(data)
    model = changed(model, optimal_fiber_length=0.45 * model.muscles[0].optimal_fiber_length)
    found = solve_tension(model, motion, torques, ELASTIC)
    (told,) = found.fibers.unreachable
    assert told.worst > 1.8
    assert found.fibers.rigid == (model.muscles[0].name,)
    assert found.optimal.all()
    assert f"fibers would be {told.worst:.2f} optimal lengths long" in fiber_notes(found)[0]


def test_frames_that_did_not_converge_are_the_first_note(solved):
    _, motion, tension = solved
    status = np.array(tension.status)
    status[5:9] = STALLED
    first = fiber_notes(replace(tension, status=status))[0]
    assert "did not converge in 4 of 40 frames" in first
    assert f"between {motion.time[5]:.3f} and {motion.time[8]:.3f} s" in first


def test_clean_data_is_reported_without_a_note(data):
    model, motion, torques = arm(data)
    found = solve_tension(model, motion, torques, ELASTIC)
    assert found.fibers.tendon_strain.max() < LARGE_STRAIN
    assert fiber_notes(found) == ()


def test_work_of_fibers_and_tendons_is_that_of_the_path(data):
    model, motion, torques = arm(data)
    found = solve_tension(model, motion, torques, ELASTIC)
    optimal = {one.name: one.optimal_fiber_length for one in model.muscles}
    rows = fiber_work(motion.time, found.muscles, found.fibers, optimal, None)
    paths = muscle_kinematics(model, motion)
    inside = ~found.fibers.transient
    power = -(found.muscle_force * paths.muscle_velocity)[inside]
    for m, row in enumerate(rows):
        whole = np.trapezoid(power[:, m], motion.time[inside])
        assert np.isclose(
            row.fiber_positive_work
            - row.fiber_negative_work
            + row.tendon_returned_energy
            - row.tendon_stored_energy,
            whole,
        )
        assert row.min_normalized_length < row.max_normalized_length


def test_table_of_work_names_units(stored):
    with open(stored[0] / WORK_TABLE, encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    assert head[:5] == ["muscle", "stride", "start_s", "stop_s", "fiber_positive_work_J"]
    assert "fiber_peak_power_W" in head
    assert head == [quantity.column for quantity in FIBER_WORK]
    assert len(rows) == 6


def test_signals_and_numbers_leave_the_ends_out(solved, stored):
    model, _, tension = solved
    length, strain, *_ = fiber_signals(stored[2], model)
    assert np.isnan(strain.series.values[tension.fibers.transient]).all()
    assert np.isfinite(length.series.values[~tension.fibers.transient & tension.optimal]).all()
    numbers = {one.quantity: one.value for one in fiber_numbers(stored[2])}
    assert numbers["muscles on rigid tendons"] == 1.0
    assert numbers["frames bridged"] == 2.0
    inside = tension.fibers.tendon_strain[~tension.fibers.transient]
    assert np.isclose(numbers["tendon strain, largest"], np.nanmax(inside))


def test_the_report_shows_fibers_and_lists_rigid_tendons(solved):
    model, motion, tension = solved
    given = ReportInput(
        PageHead("arm"), model, kinematics=Kinematics(coordinates=motion), tension=tension
    )
    section = fiber_section(prepare(given))
    assert len(section.figures) == 15
    assert "near an end" in section.figures[0].svg
    (grid,) = section.grids
    assert grid.rows[0][0] == muscle_words(model.muscles[0].name)
    assert "shorter than the slack tendon" in grid.rows[0][3]
    assert "In 2 frames" in section.lead
    assert fiber_section(prepare(replace(given, tension=replace(tension, fibers=None)))) is None


def test_thin_lines_of_one_end_do_not_reach_the_other():
    time = np.arange(8.0)
    ends = np.zeros(8, bool)
    ends[:2] = True
    thick, thin = _fiber_lines(time, [time + 1.0], ["one"], ends)
    assert np.isnan(thick.values[:2]).all()
    assert np.array_equal(
        np.isfinite(thin.values), [True, True, True, False, False, False, False, False]
    )

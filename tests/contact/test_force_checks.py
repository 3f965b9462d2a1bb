"""Faults put into clean forces are found and named.

Corrected forces equal the clean ones again, and clean forces pass.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.accuracy.faults import faults

from myomorph.core.contact.force_checks import check_signs, checked_forces
from myomorph.core.contact.force_inspection import LOAD, ForceSamples
from myomorph.core.contact.undetermined import UNDETERMINED
from myomorph.core.model.series import Motion, Wrenches
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.external_forces import ForceFile, on_feet, raw_loads
from myomorph.lab.study.inputs.reading import open_model, read_motion

WALKS = ("gait2354 walk", "OpenCap walk", "treadmill walk")
BY_NAME = {one.name: one for one in faults.CLEAN}


@pytest.fixture(scope="module", params=WALKS)
def clean(request, data):
    for path in (
        BY_NAME[request.param].model,
        BY_NAME[request.param].motion,
        BY_NAME[request.param].loads,
    ):
        data(path)
    folder = data(BY_NAME[request.param].model.split("/")[0]).parent
    return faults.of_its_mass(folder, BY_NAME[request.param])


def test_nothing_is_called_on_clean_forces(clean):
    found = checked_forces(clean.wrenches, clean.model, clean.motion)
    assert found.findings == ()
    assert found.wrenches is clean.wrenches


@pytest.mark.parametrize("fault", faults.FORCE_FAULTS, ids=lambda one: one.name)
def test_a_fault_is_found_and_named(clean, fault):
    faulty = fault.change(clean)
    assert faulty is not None
    found = on_feet(faulty.wrenches, faulty.model, faulty.motion).findings
    # What looks alike in a short recording is named together.
    kinds = {kind for one in found for kind in one.kind.split(" or ")}
    assert kinds & set(fault.kinds)
    assert all(one.text and one.place for one in found)


def test_a_mirrored_plate_is_not_taken_for_a_wrong_foot(clean):
    """Nothing is repaired, and the wrenches stay those of the file."""
    faulty = faults.mirrored_plate(clean)
    found = checked_forces(faulty.wrenches, faulty.model, faulty.motion)
    assert "mirrored plate" in {one.kind for one in found.findings}
    assert not any(one.repaired for one in found.findings)
    assert found.wrenches is faulty.wrenches


def test_a_load_in_the_hands_goes_to_no_foot(clean):
    """A plate under a box that is carried shows its weight downwards, away from the feet."""
    wrenches = clean.wrenches
    body = "pelvis_tx" if "pelvis_tx" in clean.motion.names else clean.motion.names[0]
    ahead = np.interp(wrenches.time, clean.motion.time, clean.motion[body]) + 0.7
    point = np.stack([ahead, 0.0 * ahead, 0.0 * ahead], axis=1)[:, None]
    load = np.tile([0.0, -147.0, 0.0], (len(wrenches), 1, 1))
    with_box = replace(
        wrenches,
        names=(*wrenches.names, "box"),
        bodies=(*wrenches.bodies, ""),
        forces=np.concatenate([wrenches.forces, load], axis=1),
        points=np.concatenate([wrenches.points, point], axis=1),
        torques=np.concatenate([wrenches.torques, 0.0 * load], axis=1),
    )
    found = on_feet(with_box, clean.model, clean.motion)
    (load_in_hands,) = [one for one in found.findings if one.place == "box"]
    assert load_in_hands.kind == LOAD
    assert not load_in_hands.repaired
    assert "--bodies" in load_in_hands.text
    for body in set(wrenches.bodies):
        np.testing.assert_allclose(
            on_body(found, body, clean.motion), on_body(wrenches, body, clean.motion), atol=1e-9
        )


SAFE = (
    faults.wrong_foot,
    faults.one_foot,
    faults.mirrored,
    faults.turned,
    faults.millimetres,
    faults.about_the_origin,
    faults.about_a_plate,
    faults.swapped_sign,
    faults.idle_plate,
)


OF_ALL_PLATES = (faults.mirrored, faults.turned, faults.millimetres)


@pytest.mark.parametrize("fault", SAFE, ids=lambda one: one.__name__)
def test_what_is_repaired_is_the_clean_wrench_again(clean, fault):
    """Force and moment about the origin on each foot, against those of the clean forces."""
    faulty = fault(clean)
    found = on_feet(faulty.wrenches, faulty.model, faulty.motion)
    assert any(one.repaired for one in found.findings)
    for body in set(clean.wrenches.bodies):
        expected = on_body(clean.wrenches, body, clean.motion)
        repaired = on_body(found, body, clean.motion)
        np.testing.assert_allclose(repaired[:, :3], expected[:, :3], atol=1e-6)
        # The point that moments of a plate are about is fitted.
        assert np.abs(repaired - expected).max() < (15.0 if fault is faults.about_a_plate else 1e-6)


@pytest.mark.parametrize("fault", OF_ALL_PLATES, ids=lambda one: one.__name__)
def test_what_asks_for_no_foot_is_repaired_where_contacts_share_the_forces(clean, fault):
    """Plates in the motion's axes and units, whoever stands on them; clean ones are left alone."""
    faulty = fault(clean)
    found = on_feet(faulty.wrenches, faulty.model, faulty.motion, shared=True)
    assert any(one.repaired for one in found.findings)
    np.testing.assert_allclose(
        found.forces.sum(axis=1), clean.wrenches.forces.sum(axis=1), atol=1e-6
    )
    kept = on_feet(clean.wrenches, clean.model, clean.motion, shared=True)
    np.testing.assert_array_equal(kept.forces, clean.wrenches.forces)


def check_forces(*given):
    return checked_forces(*given, repair=False).findings


def test_reporting_only_changes_nothing(clean):
    faulty = faults.mirrored(clean)
    found = on_feet(
        faulty.wrenches, faulty.model, faulty.motion, ForceOptions(force_checks="report")
    )
    assert found.findings
    assert not any(one.repaired for one in found.findings)
    np.testing.assert_array_equal(found.forces, faulty.wrenches.forces)
    named = tuple(one for one in found.findings if one.kind != UNDETERMINED)
    assert check_forces(faulty.wrenches, faulty.model, faulty.motion) == named
    quiet = on_feet(faulty.wrenches, faulty.model, faulty.motion, ForceOptions(force_checks="none"))
    assert quiet.findings == ()


def test_the_lag_of_a_clock_is_measured(clean):
    """A lag that the finding names, taken off by `force_shift`, is found no more."""
    faulty = faults.late(0.06)(clean)
    (found,) = [
        one
        for one in check_forces(faulty.wrenches, faulty.model, faulty.motion)
        if one.kind == "clock"
    ]
    lag = found.text.size
    assert lag == pytest.approx(60.0, abs=15.0)
    again = on_feet(
        faulty.wrenches, faulty.model, faulty.motion, ForceOptions(force_shift=-1e-3 * lag)
    )
    assert not [one for one in again.findings if one.kind == "clock"]


def on_body(wrenches: Wrenches, body: str, motion: Motion):
    """Force and moment about the origin (samples, 6) on a body while a motion lasts."""
    own = [k for k, name in enumerate(wrenches.bodies) if name == body]
    during = (wrenches.time >= motion.time[0]) & (wrenches.time <= motion.time[-1])
    points = np.nan_to_num(wrenches.points[during][:, own])
    forces = np.nan_to_num(wrenches.forces[during][:, own])
    torques = np.nan_to_num(wrenches.torques[during][:, own])
    return np.hstack([forces.sum(axis=1), (torques + np.cross(points, forces)).sum(axis=1)])


def test_opencaps_plates_that_are_all_on_one_foot(data):
    """The data set's own file puts both plates on the right talus.

    The left one is found without any injected fault.
    """
    folder = "opencap-subject4-multitask"
    model = open_model(data(f"{folder}/models/manually_scaled.osim"))
    motion = read_motion(data(f"{folder}/ik_manual_scaling/walking1_ik.mot"), model)
    file = ForceFile(path=data(f"{folder}/grf/walking1_external_forces.xml"))
    found = on_feet(raw_loads(file, model, motion).wrenches, model, motion)
    assert found.bodies == ("talus_r", "calcn_l")
    assert [(one.kind, one.place, one.repaired) for one in found.findings] == [
        ("wrong foot", "ForcePlate2", True)
    ]


def test_a_model_that_is_too_heavy_for_its_plates(data):
    """A generic model of 75.2 kg and a walker with 58 kg on the plates, as in the data set."""
    walk = BY_NAME["CEINMS walk (generic model)"]
    data(walk.motion)
    one = faults.recorded(data(walk.model.split("/")[0]).parent, walk)
    (found,) = check_forces(one.wrenches, one.model, one.motion)
    assert found.kind == "mass or gain of all plates"
    carried, _, weighs, *_ = found.text.split(" kg")
    assert float(carried.split()[-1]) == pytest.approx(58.0, abs=0.5)
    assert float(weighs.split()[-1]) == pytest.approx(75.2, abs=0.05)


def test_empty_forces_other_times_and_gaps_pass(clean):
    nothing = replace(
        clean.wrenches,
        forces=0.0 * clean.wrenches.forces,
        torques=0.0 * np.nan_to_num(clean.wrenches.torques),
    )
    assert check_forces(nothing, clean.model, clean.motion) == ()
    late = replace(clean.wrenches, time=clean.wrenches.time + 1000.0)
    assert check_forces(late, clean.model, clean.motion) == ()
    gaps = Motion(clean.motion.time, clean.motion.names, np.array(clean.motion.values))
    values = np.array(gaps.values)
    values[5:9] = np.nan
    assert check_forces(clean.wrenches, clean.model, replace(gaps, values=values)) == ()


def test_a_body_out_of_view_before_and_after_does_not_hide_a_fault(data):
    """The same fault in the frames with a pose.

    Such frames occur where a walker enters the cameras' view and leaves it.
    """
    walk = BY_NAME["treadmill walk"]
    for path in (walk.model, walk.motion, walk.loads):
        data(path)
    one = faults.scaled_mass(1.2)(faults.of_its_mass(data(walk.model.split("/")[0]).parent, walk))
    values = np.array(one.motion.values)
    values[:40] = values[-40:] = np.nan
    found = check_forces(one.wrenches, one.model, replace(one.motion, values=values))
    assert [finding.kind for finding in found] == ["mass or gain of all plates"]


def test_center_of_a_wrench_is_that_of_its_moment():
    """Moving the point of a force and adding the moment of the move leaves its center alone."""
    random = np.random.default_rng(0)
    force = np.array([20.0, 700.0, -30.0]) + random.normal(size=(5, 1, 3))
    point = random.normal(size=(5, 1, 3)) * [1.0, 0.0, 1.0]
    move = random.normal(size=(5, 1, 3)) * [1.0, 0.0, 1.0]
    loaded = np.ones((5, 1), bool)
    up = np.array([0.0, 1.0, 0.0])
    plain = ForceSamples(forces=force, points=point, torques=0.0 * force, loaded=loaded).centers(up)
    moment = np.cross(-move, force)
    moved = ForceSamples(
        forces=force, points=point + move, torques=moment * [1.0, 0.0, 1.0], loaded=loaded
    ).centers(up)
    np.testing.assert_allclose(moved, plain, atol=1e-12)


@pytest.mark.parametrize(("upwards", "kinds"), [(0.3, []), (-0.3, []), (-0.9, ["swapped sign"])])
def test_only_a_force_that_points_down_more_than_sideways_pulls(upwards, kinds):
    force = 300.0 * np.array([np.sqrt(1.0 - upwards**2), upwards, 0.0])
    inspection = SimpleNamespace(
        feet=SimpleNamespace(
            up=np.array([0.0, 1.0, 0.0]), unit=0.25, model=SimpleNamespace(weight=700.0)
        ),
        samples=SimpleNamespace(forces=np.tile(force, (20, 1, 1)), loaded=np.ones((20, 1), bool)),
        numbers=[0],
        weights=lambda number: np.full(20, 300.0),
        name=lambda number: "plate",
        misfit=lambda number: 0.02,
    )
    assert [finding.kind for finding in check_signs(inspection)] == kinds

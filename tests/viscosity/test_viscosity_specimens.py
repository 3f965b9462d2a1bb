"""From files to tables.

Limbs swung by an integrator of the tests, some with what goes wrong in a laboratory.
"""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from swung_specimen import Release, arm_specimen, swing

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Markers, Table
from myomorph.lab.cli.program import main
from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.swings.viscosity.study.plan import read_viscosity_plan
from myomorph.swings.viscosity.study.results import read_store
from myomorph.swings.viscosity.study.run import run_viscosity
from myomorph.swings.viscosity.study.viewing import swings_of

JOINT = 0.05
TOTAL = 0.09
RELEASES = ((0.6, 0.2, -0.5), (-0.3, -0.6, 0.5))
OPTIONS = """
[options.identification]
draws = 40
[options.laws]
draws = 4
[options.moment_arms]
draws = 10
"""


def write_swing(swung, stem, offset=None, rename=lambda name: name):
    """Write a trial as TRC and MOT.

    `offset` (6,) is taken off force and torque about the point.
    """
    markers = swung.trial.markers
    wrenches = swung.trial.wrenches
    named = Markers(markers.time, tuple(rename(name) for name in markers.names), markers.values)
    write_trc(named, stem.with_suffix(".trc"))
    parts = [wrenches.forces[:, 0], wrenches.points[:, 0], wrenches.torques[:, 0]]
    if offset is not None:
        parts[0] = parts[0] - offset
    names = [
        f"{what}{axis}"
        for what in ("ground_force_v", "ground_force_p", "ground_torque_")
        for axis in "xyz"
    ]
    write_sto(Table(wrenches.time, tuple(names), np.hstack(parts)), stem.with_suffix(".mot"))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("swings")
    specimen = arm_specimen()
    write_osim(specimen.model, folder / "arm.osim")
    swings = {}
    for condition, damping in (("bare", JOINT), ("full", TOTAL)):
        for i, release in enumerate(RELEASES, 1):
            swung = swings[condition] = swing(
                specimen, Release(turned=release, seconds=6.0, damping=damping)
            )
            write_swing(swung, folder / f"{condition}{i}")
            weight = swung.trial.wrenches.forces[:, 0].mean(axis=0)
            write_swing(swung, folder / f"tared_{condition}{i}", offset=weight)
            write_swing(swung, folder / f"other_{condition}{i}", rename=lambda name: f"x{name}")
    tables = [
        (
            'name = "whole"\nremoved = ["bare*.trc"]\nintact = ["full*.trc"]\nmeasured_muscle_mass'
            " = 0.3"
        ),
        'name = "half"\nremoved = ["bare*.trc"]',
        'name = "tared"\nremoved = ["tared_bare*.trc"]\nintact = ["full*.trc"]',
        'name = "unnamed"\nremoved = ["other_bare*.trc"]\nintact = ["other_full*.trc"]',
    ]
    text = '[study]\nname = "made"\n' + "".join(
        f'[[specimen]]\nmodel = "arm.osim"\nbase_mass = 0\n{one}\n' for one in tables
    )
    (folder / "study.toml").write_text(text + OPTIONS)
    run_viscosity(read_viscosity_plan(folder / "study.toml"), folder / "out")
    reports = {report.name: report for report in read_store(folder / "out").specimens}
    return reports, folder / "out", swings["bare"]


@pytest.mark.long
def test_truth_comes_back(ran):
    reports, out, swung = ran
    row = reports["whole"].row
    assert row["joint_viscosity"].value == pytest.approx(JOINT, rel=0.01)
    assert row["total_viscosity"].value == pytest.approx(TOTAL, rel=0.01)
    assert row["mass_muscles_removed"].value == pytest.approx(swung.parameters[0], rel=0.002)
    com = np.linalg.norm(swung.parameters[1:4]) / swung.parameters[0]
    assert row["com_intact"].value == pytest.approx(com, abs=0.002)
    assert row["estimated_muscle_mass"].value == pytest.approx(0.0, abs=0.01)
    assert row["muscle_viscosity"].value > 0.0
    with (out / "specimens.csv").open() as stream:
        first, *_ = csv.DictReader(stream)
    assert float(first["joint_viscosity"]) == pytest.approx(row["joint_viscosity"].value, rel=1e-7)


@pytest.mark.long
def test_swings_are_shown_with_the_muscles_that_were_there(ran):
    _, out, _ = ran
    shown = swings_of(out)
    assert {"whole bare1", "whole full1", "half bare1"} <= set(shown)
    bare = PlayedBody(shown["whole bare1"]())
    full = PlayedBody(shown["whole full1"]())
    assert not bare.muscles
    assert full.muscles == arm_specimen().model.muscle_names
    # The joint stays where it was while the limb swings.
    joint = next(joint for joint in full.model.joints if joint.child == arm_specimen().first)
    at = [full.at(frame) for frame in range(0, len(full.time), 20)]
    body = full.model.body_names.index(joint.child) + 1
    centers = [
        each.origins[body] + each.rotations[body] @ joint.child_frame.translation for each in at
    ]
    assert np.ptp(centers, axis=0).max() < 1e-9
    assert centers[0] == pytest.approx(arm_specimen().center_in_ground, abs=0.002)


@pytest.mark.long
def test_swings_of_another_model_are_refused(ran, tmp_path):
    stored = json.loads((ran[1] / "half" / "swings.json").read_text())
    (tmp_path / "swings.json").write_text(json.dumps(stored | {"sha256": "0"}))
    with pytest.raises(BadFile, match="has changed"):
        next(iter(swings_of(tmp_path).values()))()


@pytest.mark.long
def test_one_condition_alone_has_its_own_columns(ran):
    reports, out, _ = ran
    one = reports["half"]
    limb = {"mass_muscles_removed", "com_muscles_removed", "first_moment_muscles_removed"}
    assert set(one.row) == {*limb, "joint_viscosity"}
    assert any("muscles intact: no recording" in note for note in one.notes)
    assert (out / "half" / "without_bare1.sto").is_file()


@pytest.mark.long
def test_a_plate_that_hides_the_mass_is_named_and_the_other_condition_keeps_its_own(ran):
    reports, _, swung = ran
    one = reports["tared"]
    assert any("the plate was set to zero with the limb on it" in note for note in one.notes)
    assert not {"mass_muscles_removed", "com_muscles_removed", "estimated_muscle_mass"} & set(
        one.row
    )
    assert one.row["mass_intact"].value == pytest.approx(swung.parameters[0], rel=0.002)
    assert one.row["joint_viscosity"].value == pytest.approx(JOINT, rel=0.03)


@pytest.mark.long
def test_a_specimen_whose_markers_are_not_the_models_is_left_out(ran):
    reports, out, _ = ran
    failure = reports["unnamed"].failure
    assert "other_bare1.trc" in failure
    assert "share no marker" in failure
    assert not (out / "unnamed").exists()
    assert "Specimen unnamed could not be done" in (out / "report.html").read_text()


@pytest.mark.long
def test_the_model_is_damped_as_found(ran):
    _, out, _ = ran
    model = read_osim(out / "whole" / "identified.osim")
    (bushing,) = model.bushings
    assert bushing.rotational_damping == pytest.approx(np.full(3, JOINT), rel=0.05)
    assert all(muscle.viscosity > 0.0 for muscle in model.muscles)


@pytest.mark.long
def test_one_specimen_needs_no_study_file(ran, capsys):
    reports, out, _ = ran
    folder = out.parent
    recordings = {
        name: [str(folder / f"{kind}{i}.trc") for i in (1, 2)]
        for name, kind in (("--removed", "bare"), ("--intact", "full"))
    }
    given = [
        "--model",
        str(folder / "arm.osim"),
        *(word for name, files in recordings.items() for word in (name, *files)),
    ]
    assert (
        main(
            [
                "viscosity",
                *given,
                "--muscle-mass",
                "0.3",
                "--draws",
                "40",
                "--out",
                str(folder / "one"),
            ]
        )
        == 0
    )
    with (folder / "one" / "specimens.csv").open() as stream:
        (row,) = csv.DictReader(stream)
    found = reports["whole"].row
    assert (row["name"], row["measured_muscle_mass"]) == ("arm", "0.3")
    for name in ("joint_viscosity", "muscle_viscosity", "first_moment_intact"):
        assert float(row[name]) == pytest.approx(found[name].value, rel=1e-6)
    assert "1 of 1 specimens done" in capsys.readouterr().out

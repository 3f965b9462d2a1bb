"""The study file that analyze writes is one that `run` reads."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from made_standing import standing
from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Table
from myomorph.core.motion.measurements import default_markers
from myomorph.lab.analyze.analyze import prepare_request, prepare_study
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest
from myomorph.lab.study.inputs.contact_points import ContactPointsFile
from myomorph.lab.study.inputs.contacts import ContactsFile
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.laboratory import Laboratory
from myomorph.lab.study.inputs.loads import LoadsFile
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.plan.plan import read_plan


def test_a_prepared_study_is_read_as_a_plan(tmp_path: Path) -> None:
    for folder, shift in (("one", 0.3), ("two", 0.4)):
        (tmp_path / folder).mkdir()
        write_trc(
            standing(shift).rotated(Laboratory("z", 90.0).rotation.T),
            tmp_path / folder / "markers.trc",
        )
    write_trc(standing().rotated(Laboratory("z", 90.0).rotation.T), tmp_path / "static.trc")
    files = (
        tmp_path / "one" / "markers.trc",
        tmp_path / "two" / "markers.trc",
        tmp_path / "static.trc",
    )
    prepared = prepare_request(AnalyzeRequest(files, 70.0, height=1.7), tmp_path / "out")
    plan = read_plan(prepared.study)
    assert [one.name for one in plan.trials] == ["one", "two"]
    assert plan.subjects["subject"].static == tmp_path / "out" / ".." / "static.trc"
    assert all(
        one.get(Laboratory) == Laboratory("z", 90.0) and one.get(ContactsFile).contacts == "auto"
        for one in plan.trials
    )
    assert plan.home(tmp_path / "out", "subject", "one") == tmp_path / "out" / "one"
    assert any("static.trc is the static trial" in text for text in prepared.assumed)
    assert any("No force was measured" in text for text in prepared.assumed)


def test_height_is_held_against_the_markers_and_scales_the_generic_model(tmp_path: Path) -> None:
    body = standing(0.3)
    sizes = []
    for height in (1.53, 1.7):
        walk = tmp_path / f"{height}" / "walk.trc"
        walk.parent.mkdir()
        write_trc(replace(body, values=height / 1.7 * body.values), walk)
        prepared = prepare_request(
            AnalyzeRequest((walk,), 70.0, height=height), walk.parent / "out"
        )
        assert prepared.assumed[0].startswith(
            f"Height {height:g} m (--height): the markers of walk.trc show"
        )
        model = read_model(walk.parent / "out" / "generic.osim")
        sizes.append(default_markers(model, ("LASI", "LANK"))[:, 1])
    np.testing.assert_allclose(np.ptp(sizes[0]), 0.9 * np.ptp(sizes[1]), rtol=1e-6)


@pytest.mark.parametrize("height", [1.2, 170.0])
def test_a_wrong_height_is_said_first_and_not_used(tmp_path: Path, height: float) -> None:
    # Static trials are looked for in folders beside that of the recording: not in those of other
    # tests.
    walk = tmp_path / "own" / "walk.trc"
    walk.parent.mkdir()
    write_trc(standing(0.3), walk)
    prepared = prepare_request(AnalyzeRequest((walk,), 70.0, height=height), tmp_path / "out")
    assert re.match(
        rf"WARNING: the markers of walk.trc show .*[+-]\d+ % of --height {height:g} m",
        prepared.assumed[0],
    )
    assert not any("from those of a body" in text for text in prepared.assumed)


def test_a_study_file_that_was_changed_is_not_lost(tmp_path: Path) -> None:
    write_trc(standing(0.3), tmp_path / "walk.trc")
    request = AnalyzeRequest((tmp_path / "walk.trc",), 70.0)
    study = prepare_request(request, tmp_path / "out").study
    # As it was written it is only a step on the way.
    assert prepare_request(replace(request, mass=71.0), tmp_path / "out").study == study
    changed = study.read_text(encoding="utf-8").replace("mass = 71.0", "mass = 72.0")
    study.write_text(changed, encoding="utf-8")
    with pytest.raises(BadData, match=r"was changed since it was written.*myomorph run"):
        prepare_request(request, tmp_path / "out")
    assert study.read_text(encoding="utf-8") == changed


def _forces_of(force: np.ndarray, path: Path, under: float = 0.5) -> Path:
    """Write a table of one plate's forces under the standing body.

    `under` is the share of the way from the left heel to the right one.
    """
    names = [f"ground_force_{part}" for part in ("vx", "vy", "vz", "px", "py", "pz")]
    values = np.zeros((len(force), 6))
    values[:, 1] = force
    heels = [standing()[name][0] for name in ("LHEE", "RHEE")]
    values[:, 3:] = (1.0 - under) * heels[0] + under * heels[1]
    write_sto(Table(0.01 * np.arange(len(force)), tuple(names), values), path)
    return path


def test_the_plan_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Values of all trials and of one, and settings of steps.

    Also files with characters that TOML knows.
    """
    for name in ('a "b" #1', "c"):
        write_trc(standing(0.3), tmp_path / f"{name}.trc")
    (tmp_path / "touches.csv").write_text("site,start,stop\n")
    inputs = ByType().having(
        ContactsFile(str(tmp_path / "touches.csv"), "shared"),
        ContactPointsFile("auto"),
        EmgFiles(emg_side="left", emg_muscles=FrozenMap({"EMG \\ 1": ("soleus_l",), "EMG 2": ()})),
        TimeSpan((0.05, 0.15)),
        Laboratory("z", 12.5),
    )
    options = {
        "id": {"cutoff": 6.5},
        "tension": {"reactions": "ground"},
        "uncertainty": {"draws": 20},
    }
    files = tuple(sorted(tmp_path.glob("*.trc")))
    plan = read_plan(
        prepare_request(
            AnalyzeRequest(files, 70.25, inputs=inputs, options=options), tmp_path / "out"
        ).study
    )
    assert [trial.name for trial in plan.trials] == ['a "b" #1', "c"]
    for trial, path in zip(plan.trials, files, strict=True):
        assert trial.markers.resolve() == path
        assert Path(trial.get(ContactsFile).contacts).resolve() == tmp_path / "touches.csv"
        assert trial.get(ContactsFile).measured == "shared"
        assert trial.inputs.only(
            ContactPointsFile, EmgFiles, TimeSpan, Laboratory
        ) == inputs.without(ContactsFile)
        assert trial.get(BodyMass).mass == 70.25
    assert plan.settings == options
    assert plan.steps[0] == ("calibrate", "ik", "id", "muscles", "tension", "uncertainty", "report")


def test_what_belongs_to_one_recording_is_refused_for_two(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_trc(standing(0.3), tmp_path / f"{name}.trc")
    loads = ByType(LoadsFile(_forces_of(np.full(20, 700.0), tmp_path / "x.mot")))
    request = AnalyzeRequest((tmp_path / "a.trc", tmp_path / "b.trc"), 70.0, inputs=loads)
    with pytest.raises(
        BadData, match=r"--loads .*x\.mot: it belongs to one recording, and there are 2"
    ):
        prepare_request(request, tmp_path / "out")
    with pytest.raises(BadFile, match=r"does not exist.*--loads"):
        prepare_request(
            replace(request, inputs=ByType(LoadsFile(tmp_path / "none.mot"))), tmp_path / "out"
        )


def test_plates_weigh_somebody_who_stands_still(tmp_path: Path) -> None:
    write_trc(standing(0.3), tmp_path / "walk.trc")
    write_trc(standing(), tmp_path / "static.trc")
    request = AnalyzeRequest((tmp_path / "walk.trc",), static=tmp_path / "static.trc")
    with pytest.raises(BadData, match=r"no plate weighs the subject.*--mass"):
        prepare_request(request, tmp_path / "none")
    random = np.random.default_rng(3)
    steady = 61.3 * 9.80665 + 2.0 * random.standard_normal(20)
    for name, force in (
        ("drift", steady * np.linspace(1.0, 1.06, 20)),
        ("swaying", steady * (1.0 + 0.1 * random.random(20))),
    ):
        _forces_of(force, tmp_path / "static_grf.mot")
        with pytest.raises(BadData, match="no plate weighs"):
            prepare_request(request, tmp_path / name)
    _forces_of(0.5 * steady, tmp_path / "static_grf.mot", under=0.0)
    with pytest.raises(BadData, match="no plate weighs"):
        prepare_request(request, tmp_path / "one_foot")
    _forces_of(steady, tmp_path / "static_grf.mot")
    prepared = prepare_request(request, tmp_path / "out")
    assert (
        prepared.assumed[0]
        == "Mass 61.3 kg, as the plates of static.trc weigh it standing still (--mass)."
    )
    assert read_plan(prepared.study).subjects["subject"].mass == 61.3


def test_a_plate_under_two_feet_is_shared(tmp_path: Path) -> None:
    body = standing(0.1)
    body = replace(body, time=5.0 * body.time)
    write_trc(body, tmp_path / "walk.trc")
    for under, contacts in ((0.5, ContactsFile("auto", "shared")), (0.02, ContactsFile())):
        force = np.full(1 + int(body.time[-1] / 0.01), 690.0)
        _forces_of(force, tmp_path / "walk_grf.mot", under=under)
        prepared = prepare_request(
            AnalyzeRequest((tmp_path / "walk.trc",), 70.0), tmp_path / f"{under}"
        )
        assert read_plan(prepared.study).trials[0].get(ContactsFile) == contacts
        assert any("Two feet share a plate" in text for text in prepared.assumed) == (under == 0.5)


def test_keys_from_python_are_those_of_study_files(tmp_path: Path) -> None:
    write_trc(standing(0.3), tmp_path / "walk.trc")
    loads = _forces_of(np.full(20, 690.0), tmp_path / "plates.mot")
    keys = {"loads": str(loads), "emg_side": "left", "contact_points": "auto", "time": (0.05, 0.15)}
    prepared = prepare_study([tmp_path / "walk.trc"], tmp_path / "out", 70.0, keys=keys)
    trial = read_plan(prepared.study).trials[0]
    assert trial.get(LoadsFile).loads.resolve() == loads
    assert (trial.get(EmgFiles).emg_side, trial.get(ContactPointsFile).contact_points) == (
        "left",
        "auto",
    )
    assert trial.get(TimeSpan).time == (0.05, 0.15)
    with pytest.raises(UnknownName, match="emg_side"):
        prepare_study([tmp_path / "walk.trc"], tmp_path / "out", 70.0, keys={"emgside": "left"})
    with pytest.raises(BadData, match=r"none\.mot"):
        prepare_study([tmp_path / "walk.trc"], tmp_path / "out", 70.0, keys={"loads": "none.mot"})

"""The study file that analyze writes is one that `run` reads."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from made_standing import standing
from myomorph.io.formats import read_model
from myomorph.io.trc import write_trc
from myomorph.model.errors import BadData
from myomorph.motion.measurements import default_markers
from myomorph.study.analyze.analyze import AnalyzeRequest, prepare_study
from myomorph.study.analyze.study_text import StudyEntries, TrialEntry, study_text
from myomorph.study.inputs.contacts import ContactsFile
from myomorph.study.inputs.laboratory import Laboratory
from myomorph.study.plan.plan import read_plan


def test_the_file_says_what_was_given(tmp_path: Path) -> None:
    trial = TrialEntry("walk", tmp_path / 'a "b".trc', Laboratory("z", 90.0), assumed=("It is 90° off, \\ said.",))
    study = StudyEntries("x", "myomorph analyze", tmp_path / "m.osim", 70.5, (trial,), labels={"S:LASI": "LASI"})
    raw = tomllib.loads(study_text(study, tmp_path))
    subject = raw["subject"][0]
    assert raw["study"]["flat"]
    assert (subject["mass"], subject["up"], subject["labels"]) == (70.5, "z", {"S:LASI": "LASI"})
    assert subject["trials"][0]["markers"] == 'a "b".trc'
    assert subject["trials"][0]["turn"] == 90.0
    assert subject["trials"][0]["assumed"] == ["It is 90° off, \\ said."]


def test_a_prepared_study_is_read_as_a_plan(tmp_path: Path) -> None:
    for folder, shift in (("one", 0.3), ("two", 0.4)):
        (tmp_path / folder).mkdir()
        write_trc(standing(shift).rotated(Laboratory("z", 90.0).rotation.T), tmp_path / folder / "markers.trc")
    write_trc(standing().rotated(Laboratory("z", 90.0).rotation.T), tmp_path / "static.trc")
    files = (tmp_path / "one" / "markers.trc", tmp_path / "two" / "markers.trc", tmp_path / "static.trc")
    prepared = prepare_study(AnalyzeRequest(files, 70.0, height=1.7), tmp_path / "out")
    plan = read_plan(prepared.study)
    assert [one.name for one in plan.trials] == ["one", "two"]
    assert plan.subjects["subject"].static == tmp_path / "out" / ".." / "static.trc"
    assert all(
        one.get(Laboratory) == Laboratory("z", 90.0) and one.get(ContactsFile).contacts == "auto" for one in plan.trials
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
        prepared = prepare_study(AnalyzeRequest((walk,), 70.0, height=height), walk.parent / "out")
        assert prepared.assumed[0].startswith(f"Height {height:g} m (--height): the markers of walk.trc show")
        model = read_model(walk.parent / "out" / "generic.osim")
        sizes.append(default_markers(model, ("LASI", "LANK"))[:, 1])
    np.testing.assert_allclose(np.ptp(sizes[0]), 0.9 * np.ptp(sizes[1]), rtol=1e-6)


@pytest.mark.parametrize("height", [1.2, 170.0])
def test_a_wrong_height_is_said_first_and_not_used(tmp_path: Path, height: float) -> None:
    # Static trials are looked for in folders beside that of the recording: not in those of other tests.
    walk = tmp_path / "own" / "walk.trc"
    walk.parent.mkdir()
    write_trc(standing(0.3), walk)
    prepared = prepare_study(AnalyzeRequest((walk,), 70.0, height=height), tmp_path / "out")
    assert re.match(rf"WARNING: the markers of walk.trc show .*[+-]\d+ % of --height {height:g} m", prepared.assumed[0])
    assert not any("from those of a body" in text for text in prepared.assumed)


def test_a_study_file_that_was_changed_is_not_lost(tmp_path: Path) -> None:
    write_trc(standing(0.3), tmp_path / "walk.trc")
    request = AnalyzeRequest((tmp_path / "walk.trc",), 70.0)
    study = prepare_study(request, tmp_path / "out").study
    # As it was written it is only a step on the way.
    assert prepare_study(replace(request, mass=71.0), tmp_path / "out").study == study
    changed = study.read_text(encoding="utf-8").replace("mass = 71", "mass = 72")
    study.write_text(changed, encoding="utf-8")
    with pytest.raises(BadData, match=r"was changed since it was written.*myomorph run"):
        prepare_study(request, tmp_path / "out")
    assert study.read_text(encoding="utf-8") == changed

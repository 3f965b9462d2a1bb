"""Chapter 5 as demos.

Files and a study file are written, its run compares forces with the truth, and the page states that
everything is simulated.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from myomorph.core.io.contact_events import read_events
from myomorph.core.io.loads import read_external_loads
from myomorph.lab.cli.program import main
from myomorph.lab.store.toml_file import read_toml
from myomorph.lab.study.plan.plan import read_plan
from myomorph.show.demo import performances
from myomorph.show.demo.performances import ERRORS, PERFORMANCES, STROKES, write_performance
from myomorph.show.simulate.bout import FEET, GRIPS
from myomorph.show.simulate.performer import performed


@pytest.fixture(scope="module")
def judo(tmp_path_factory):
    out = tmp_path_factory.mktemp("judo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(performances, "PairOptions", partial(performances.PairOptions, until=1.5))
        assert main(["demo", "--study", "judo", "--out", str(out)]) == 0
    return out


@pytest.mark.long
def test_forces_of_two_fighters_are_laid_beside_the_truth(judo):
    with (judo / ERRORS).open(encoding="utf-8") as stream:
        rows = {row["contact"]: row for row in csv.DictReader(stream)}
    assert tuple(rows) == (*FEET, *GRIPS)
    for row in rows.values():
        along = [float(row[f"error, {axis} [N]"]) for axis in ("vertical", "fore-aft", "lateral")]
        assert float(row["error, RMS [N]"]) == pytest.approx(np.linalg.norm(along), abs=0.2)
    assert all(
        float(rows[name]["error, RMS [N]"]) < 0.4 * float(rows[name]["true, RMS [N]"])
        for name in FEET
    )


@pytest.mark.long
def test_forces_between_fighters_are_opposite(judo):
    loads = read_external_loads(judo / "results" / "judo" / "contact_forces.xml")
    on = {body: loads.forces[:, k] for k, body in enumerate(loads.bodies)}
    assert {*FEET, "tori_forearm_r", "tori_forearm_l", "uke_torso", "uke_forearm_r"} <= set(on)
    np.testing.assert_allclose(on["tori_forearm_r"], -on["uke_torso"], atol=1e-6)
    np.testing.assert_allclose(on["tori_forearm_l"], -on["uke_forearm_r"], atol=1e-6)


@pytest.mark.long
def test_touches_of_a_grip_name_the_body_that_it_holds(judo):
    touches = read_events(judo / "results" / "judo" / "contacts.csv").intervals
    surfaces = {touch.site: touch.surface for touch in touches}
    assert (surfaces["lapel"], surfaces["sleeve"]) == ("uke_torso", "uke_forearm_r")


@pytest.mark.long
def test_the_page_says_that_it_is_simulated_and_shows_the_truth(judo):
    text = (judo / "results" / "judo" / "report.html").read_text(encoding="utf-8")
    assert "nobody was measured" in text
    assert "another criterion than the estimate" in text
    assert "Estimate and truth" in text


@pytest.mark.parametrize("name", ["taichi", "tap", "drum"])
def test_the_files_of_a_performance_are_a_study(name, tmp_path, monkeypatch):
    monkeypatch.setattr(
        performances, "performed", lambda part: performed(replace(part, duration=0.3, blows=()))
    )
    written = write_performance(name, tmp_path)
    (trial,) = read_plan(written.study).trials
    assert (trial.subject, trial.name) == ("performer", name)
    assert {"true_torques", "true_activations", "emg"} <= set(
        read_toml(written.study)["subject"][0]["trials"][0]
    )
    assert (tmp_path / STROKES).is_file() == (name == "drum")
    assert len(written.forces) == len(written.torques) == len(written.activations)


def test_every_performance_is_a_demo(capsys):
    assert main(["demo", "--study", "none"]) == 2
    told = capsys.readouterr()
    assert all(name in told.out + told.err for name in PERFORMANCES)

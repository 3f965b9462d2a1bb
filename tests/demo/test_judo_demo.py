"""The demo of two simulated fighters: forces come out beside the truth, and the page says what is simulated."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from myomorph.demo import judo as judo_demo
from myomorph.demo.demos import demo_model
from myomorph.demo.judo import ERRORS, run_judo_demo, touches_of
from myomorph.io.contact_events import read_events
from myomorph.io.loads import read_external_loads
from myomorph.simulate.bout import FEET, GRIPS
from myomorph.simulate.pair import virtual_pair


@pytest.fixture(scope="module")
def bout():
    return replace(judo_demo.BOUT, until=0.75)


@pytest.fixture(scope="module")
def shown(bout, tmp_path_factory):
    out = tmp_path_factory.mktemp("judo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judo_demo, "BOUT", bout)
        outcome = run_judo_demo(out)
    return out, outcome


def test_the_demo_lays_forces_beside_the_truth(shown):
    out, outcome = shown
    assert outcome.error == ""
    assert outcome.done == ("ik", "id", "muscles", "tension", "report")
    with (out / ERRORS).open(encoding="utf-8") as stream:
        rows = {row["contact"]: row for row in csv.DictReader(stream)}
    assert tuple(rows) == (*FEET, *GRIPS)
    for row in rows.values():
        along = [float(row[f"error {axis}"]) for axis in "xyz"]
        assert float(row["error [N]"]) == pytest.approx(np.linalg.norm(along), abs=0.2)
    feet = [rows[name] for name in FEET]
    assert all(float(row["error [N]"]) < 0.4 * float(row["true force [N]"]) for row in feet)


def test_forces_are_written_for_both_and_are_opposite(shown):
    out, _ = shown
    loads = read_external_loads(out / "contact_forces.xml")
    on = {body: loads.forces[:, k] for k, body in enumerate(loads.bodies)}
    assert set(on) == {*FEET, "tori_forearm_r", "tori_forearm_l", "uke_torso", "uke_forearm_r"}
    np.testing.assert_allclose(on["tori_forearm_r"], -on["uke_torso"], atol=1e-6)
    np.testing.assert_allclose(on["tori_forearm_l"], -on["uke_forearm_r"], atol=1e-6)


def test_touches_of_a_grip_name_the_body_that_it_holds(shown):
    out, _ = shown
    surfaces = {one.site: one.surface for one in read_events(out / "contacts.csv").intervals}
    assert (surfaces["lapel"], surfaces["sleeve"]) == ("uke_torso", "uke_forearm_r")


def test_the_page_says_that_it_is_simulated(shown):
    out, _ = shown
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "nobody was measured" in text
    assert "another criterion than the estimate" in text


def test_the_model_of_the_demo_needs_no_bout(bout):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judo_demo, "BOUT", bout)
        model = demo_model("judo")
    made = virtual_pair(replace(bout, until=0.32)).model
    assert model.coordinate_names == made.coordinate_names
    assert [one.max_isometric_force for one in model.muscles] == [one.max_isometric_force for one in made.muscles]
    assert model.mass == made.mass


def test_touches_are_the_spans_in_which_a_site_bears_load(bout):
    states = virtual_pair(replace(bout, until=0.4)).touching
    again = touches_of(states).states(states.time)
    np.testing.assert_array_equal(again.values, states.values)

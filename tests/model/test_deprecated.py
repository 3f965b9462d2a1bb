"""Names that changed: every old one works with one line of notice, and both names at once are refused."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from docs_build.renamed import tables
from pydantic import BaseModel

from myomorph.model.contacts import Contacts, Touch
from myomorph.model.deprecated import (
    ARGUMENTS,
    KEYS,
    OPTIONS,
    REMOVED_IN,
    VARIABLES,
    current_keys,
    current_options,
    current_settings,
    renamed_arguments,
)
from myomorph.model.errors import BadData, BadFile
from myomorph.store.results import new_result, read_result
from myomorph.store.study_file import _keys
from myomorph.study.plan.plan import read_plan
from myomorph.study.plan.subject_tables import study_tables
from myomorph.study.subject.species_morphing import BONE_KEYS
from myomorph.study.trial import contact_file
from myomorph.viscosity.study.plan import viscosity_tables

FILES: dict[str, type[BaseModel]] = {
    "study file": study_tables(),
    "viscosity study": viscosity_tables(),
    "contact file": contact_file._ContactFile,
    "stairs file": contact_file._StairsFile,
}
SITE = '[[site]]\nname = "hand"\nbody = "fore"\npoints = [[0.0, -0.28, 0.0]]\n'


@pytest.mark.parametrize("one", OPTIONS, ids=lambda one: f"{one.place} --{one.old}")
def test_an_old_option_becomes_the_new_one(command, one):
    shown = command(one.place, "--help").out
    words = [word.strip(",") for word in shown.split()]
    assert f"--{one.new}" in words
    assert f"--{one.old}" not in words
    for given, wanted in (([f"--{one.old}", "x"], [f"--{one.new}", "x"]), ([f"--{one.old}=x"], [f"--{one.new}=x"])):
        found, notices = current_options(one.place, [one.place, *given, *given])
        assert found == [one.place, *wanted, *wanted]
        (text,) = notices
        assert f"'--{one.old}'" in text
        assert f"'--{one.new}'" in text
        assert REMOVED_IN in text
    with pytest.raises(BadData, match=f"--{one.old} is the old name of --{one.new}"):
        current_options(one.place, [one.place, f"--{one.old}", "x", f"--{one.new}=y"])


def test_a_switch_that_is_off(command):
    assert current_options("id", ["id", "--no-folded"])[0] == ["id", "--no-independent-coordinates"]
    with pytest.raises(BadData, match="--no-folded is the old name"):
        current_options("id", ["id", "--no-folded", "--independent-coordinates"])


def nested(place, table):
    for part in reversed(place.split(".") if place else ()):
        table = {part: [table] if part in ("site", "specimen", "bone") else table}
    return table


@pytest.mark.parametrize(
    ("kind", "one"), [(kind, one) for kind, own in KEYS.items() for one in own], ids=lambda one: str(one)
)
def test_an_old_key_becomes_the_new_one(kind, one):
    found, (text,), problems = current_keys(kind, nested(one.place, {one.old: 1}), "a.toml")
    assert (found, problems) == (nested(one.place, {one.new: 1}), [])
    assert text.startswith("a.toml: ")
    assert one.old in text
    assert one.new in text
    known = BONE_KEYS if kind == "species file" else _keys(FILES[kind], one.place.split(".") if one.place else ())
    assert one.new in known
    assert one.old not in known
    problems = current_keys(kind, nested(one.place, {one.old: 1, one.new: 2}), "a.toml")[2]
    assert len(problems) == 1
    assert f"is the old name of '{one.new}'" in problems[0]


def test_a_command_tells_of_an_old_option_once(arm, command):
    given = ("id", "--model", arm.model, "--motion", arm.motion, "--out", arm.out.with_suffix(".sto"))
    done = command(*given, "--folded")
    assert done.status == 0
    assert [line for line in done.err.splitlines() if "folded" in line] == [
        "warning: id: '--folded' is now called '--independent-coordinates'; the old name goes in version 0.2"
    ]
    done = command(*given, "--folded", "--independent-coordinates")
    assert done.status == 2
    assert "give one of them" in done.err


STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc", {markers = "reach.trc", name = "again", options.id.folded = true}]
steps = ["ik", "id", "tension"]
contacts = "hand.toml"
[options.id]
folded = true
"""


def test_a_study_tells_of_old_keys_of_its_files_once(arm):
    (arm.folder / "hand.toml").write_text(
        f'feet = false\n{SITE}touching = "motion"\n{SITE.replace("hand", "arm")}most = 1.0\n'
    )
    path = arm.folder / "study.toml"
    path.write_text(STUDY)
    plan = read_plan(path)
    assert plan.settings["id"] == {"independent_coordinates": True}
    assert [one for one in plan.remarks if "is now called" in one] == [
        "study.toml: 'subject.trials.options.id.folded' is now called "
        "'subject.trials.options.id.independent_coordinates'; the old name goes in version 0.2",
        "hand.toml: 'site.touching' is now called 'site.intervals'; the old name goes in version 0.2",
        "hand.toml: 'site.most' is now called 'site.max_force'; the old name goes in version 0.2",
    ]
    path.write_text(STUDY + "independent_coordinates = false\n")
    with pytest.raises(BadFile, match=r"'options\.id\.folded' is the old name of 'independent_coordinates'"):
        read_plan(path)


def test_a_command_tells_of_an_old_key_of_a_contact_file_once(arm, command):
    path = arm.folder / "hand.toml"
    given = ("tension", "--model", arm.model, "--motion", arm.motion, "--contacts", path, "--out", arm.out)
    taps = arm.folder / "taps.csv"
    taps.write_text("site,start,stop\nhand,0.1,0.2\n")
    path.write_text(f'feet = false\ntouches = "taps.csv"\n{SITE}touching = "told"\n')
    done = command(*given)
    assert done.status == 0
    lines = [line.partition(";")[0] for line in done.err.splitlines() if "is now called" in line]
    assert sorted(lines) == [
        "warning: hand.toml: 'site.intervals = \"told\"' is now called 'site.intervals = \"file\"'",
        "warning: hand.toml: 'site.touching' is now called 'site.intervals'",
        "warning: hand.toml: 'touches' is now called 'intervals'",
    ]
    path.write_text(f"feet = false\n{SITE}most = 1.0\nmax_force = 2.0\n")
    done = command(*given)
    assert done.status == 2
    assert "'site.most' is the old name of 'max_force'" in done.err


def test_settings_of_earlier_results_have_their_new_names():
    assert current_settings({"id.folded": True, "id.cutoff": 6.0}) == {
        "id.independent_coordinates": True,
        "id.cutoff": 6.0,
    }


@pytest.mark.parametrize("old", VARIABLES)
def test_old_variables_are_read_and_copied_by_their_new_names(tmp_path, old):
    path, new = tmp_path / "old.nc", VARIABLES[old]
    with new_result(path, "tension") as writer:
        writer.sizes("uncarried", 2)
        writer.put(old, ("uncarried",), np.array([1.0, 2.0]), "s", "values")
        writer.fact("contact_doubts", "[]")
    with new_result(tmp_path / "new.nc") as writer:
        writer.copy(path, ("tension",))
    for file in (path, tmp_path / "new.nc"):
        stored = read_result(file)
        np.testing.assert_array_equal(stored.values[new], [1.0, 2.0])
        assert old not in stored.values
        assert stored.facts["contact_warnings"] == "[]"
        assert new not in read_result(file, leave_out=[new]).values


def test_an_old_argument_warns():
    (one,) = ARGUMENTS

    def run_study(*, report: int) -> int:
        return report

    renamed = renamed_arguments(run_study)
    with pytest.warns(FutureWarning, match=f"'{one.old}' is now called '{one.new}'"):
        assert renamed(**{one.old: 3}) == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert renamed(report=3) == 3
    with pytest.raises(TypeError, match="give one of them"):
        renamed(**{one.old: 3, one.new: 4})


def test_an_old_field_warns():
    touch = Touch("heel_r", 0.1, 0.2)
    with pytest.warns(FutureWarning, match="Contacts: 'touches' is now called 'intervals'"):
        contacts = Contacts(("heel_r",), touches=(touch,))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert contacts == Contacts(("heel_r",), (touch,))
        assert contacts.intervals == replace(contacts, warnings=("late",)).intervals == (touch,)
    with pytest.warns(FutureWarning, match="'touches' is now called"):
        assert contacts.touches == (touch,)  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="give one of them"):
        Contacts(("heel_r",), (touch,), touches=(touch,))


def test_the_page_lists_the_same_names():
    page = Path(__file__).parents[2] / "docs" / "deprecated.md"
    text = page.read_text(encoding="utf-8")
    assert text[text.index("## ") :] == tables(), "write what 'python -m docs_build.renamed' prints into the page"

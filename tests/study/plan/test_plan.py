"""A study file is checked as a whole; forces and EMG are found by the trial's stem."""

from __future__ import annotations

import pytest

from myomorph.core.model.errors import BadFile
from myomorph.lab.study.inputs.beside import plain_stem
from myomorph.lab.study.inputs.contact_points import ContactPointsFile
from myomorph.lab.study.inputs.contacts import ContactsFile
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.loads import LoadsFile, loads_by_name
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.plan.subject_tables import step_settings

SMALLEST = """
[study]
name = "walking"
[[subject]]
name = "s01"
model = "generic.osim"
mass = 72.6
trials = ["walk*.trc"]
steps = ["ik", "id", "muscles", "tension", "report"]
"""

FORCES = ("force_checks", "force_shift", "force_columns", "force_rate", "force_origins")


@pytest.fixture
def folder(tmp_path):
    for name in (
        "generic.osim",
        "walk1.trc",
        "walk2.trc",
        "walk1_grf.xml",
        "walk1_emg.sto",
        "run.trc",
    ):
        (tmp_path / name).write_text("")
    return tmp_path


def plan_of(folder, text):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_plan(path)


def problems_of(folder, text):
    with pytest.raises(BadFile) as caught:
        plan_of(folder, text)
    return str(caught.value)


def test_smallest_form(folder):
    plan = plan_of(folder, SMALLEST)
    assert plan.name == "walking"
    assert [trial.name for trial in plan.trials] == ["walk1", "walk2"]
    first, second = plan.trials
    assert first.get(LoadsFile).loads == folder / "walk1_grf.xml"
    assert first.get(EmgFiles).emg == folder / "walk1_emg.sto"
    assert (second.get(LoadsFile).loads, second.get(EmgFiles).emg) == (None, None)
    assert first.get(BodyMass).mass == 72.6
    assert plan.steps == (("ik", "id", "muscles", "tension", "report"),) * 2
    assert any("walk1_grf.xml" in remark for remark in plan.remarks)


def test_table_form_and_options(folder):
    plan = plan_of(
        folder,
        SMALLEST.replace(
            '["walk*.trc"]',
            '[{markers = "run.trc", name = "fast", loads = "walk1_grf.xml", emg = "walk1_emg.sto",'
            " time = [0.5, 1.5]}]",
        )
        + "[options.id]\ncutoff = 6\n[options.tension]\npassive = false\nweights = 'volume'\n",
    )
    (trial,) = plan.trials
    assert (trial.name, trial.time) == ("fast", (0.5, 1.5))
    assert trial.get(LoadsFile).loads == folder / "walk1_grf.xml"
    assert plan.settings == {
        "id": {"cutoff": 6.0},
        "tension": {"passive": False, "weights": "volume"},
    }


def test_everything_wrong_is_told_at_once(folder):
    told = problems_of(
        folder,
        SMALLEST.replace("generic.osim", "generik.osim")
        .replace('"walk*.trc"', '"jump*.trc", "walk3.trc"')
        .replace('"muscles"', '"muscels"'),
    )
    assert told.startswith(f"{folder / 'study.toml'}: 4 problems: ")
    for words in (
        "'generik.osim'",
        "'generic.osim'",
        "'jump*.trc'",
        "'walk3.trc'",
        "'walk1.trc'",
        "'muscels'",
        "'muscles'",
    ):
        assert words in told
    assert "\n" not in told


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (SMALLEST + "[options.id]\ncutof = 6\n", ("unknown key 'options.id.cutof'", "'cutoff'")),
        (SMALLEST + "[options.ids]\ncutoff = 6\n", ("unknown key 'options.ids'", "'id'")),
        (
            SMALLEST.replace("model", "modle"),
            ("'subject.1.model' is missing", "unknown key 'subject.1.modle'"),
        ),
        (SMALLEST.replace("72.6", "-1"), ("'subject.1.mass' = -1", "greater than 0")),
        (SMALLEST.replace("72.6", '"heavy"'), ("'subject.1.mass' = 'heavy'",)),
        (
            SMALLEST + "[options.tension]\nweights = 'heavy'\n",
            ("options.tension.weights", "'volume'"),
        ),
        (SMALLEST.replace('"ik", ', ""), ("'ik' is missing",)),
        (SMALLEST.replace('["walk*.trc"]', "[]"), ("has no trials",)),
        (
            SMALLEST.replace('["walk*.trc"]', '[{marker = "run.trc"}]'),
            ("trials.1.marker'", "'markers'"),
        ),
        (SMALLEST.replace('["walk*.trc"]', '[{name = "a"}]'), ("one of 'markers' and 'motion'",)),
        (
            SMALLEST.replace("mass = 72.6", "chest = 0.9"),
            ("'height' and 'chest'", "'height' is missing"),
        ),
        (SMALLEST.replace("mass = 72.6", "time = [2, 1]"), ("start before an end",)),
        ("[study]\nname = 'x'\n", ("'subject' is missing",)),
        ("[[study\n", ("is not TOML",)),
    ],
)
def test_what_is_wrong_is_named(folder, spoilt, words):
    told = problems_of(folder, spoilt)
    for word in words:
        assert word in told


def test_two_trials_of_one_name_are_refused(folder):
    assert "two trials named 'walk1'" in problems_of(
        folder, SMALLEST.replace('"walk*.trc"', '"walk*.trc", "walk1.trc"')
    )


def test_forces_without_bodies_are_not_guessed(folder):
    (folder / "walk2_forces.mot").write_text("")
    plan = plan_of(folder, SMALLEST)
    assert plan.trials[1].get(LoadsFile).loads is None
    assert any("walk2_forces.mot is not used" in remark for remark in plan.remarks)
    given = (
        '[{markers = "walk2.trc", loads = "walk2_forces.mot", bodies = {ground_force_ ='
        ' "calcn_r"}}]'
    )
    (trial,) = plan_of(folder, SMALLEST.replace('["walk*.trc"]', given)).trials
    assert dict(trial.get(LoadsFile).bodies) == {"ground_force_": "calcn_r"}


@pytest.mark.parametrize(
    ("markers", "loads"),
    [
        ("walk1.trc", "walk1_grf.xml"),
        ("walk1.trc", "walk1_external_loads.xml"),
        ("walk1.trc", "grf_walk1.xml"),
        ("walk1.trc", "walk1.mot"),
        ("markers_walk.trc", "grf_walk.xml"),
        ("walk_markers.trc", "walk.xml"),
    ],
)
def test_rule_of_names(tmp_path, markers, loads):
    for name in (markers, loads, "other_grf.xml"):
        (tmp_path / name).write_text("")
    assert loads_by_name(tmp_path / markers) == tmp_path / loads


def test_plain_stem():
    from pathlib import Path

    names = {
        "markers_walk.trc": "walk",
        "walk_Markers.trc": "walk",
        "markers.trc": "markers",
        "a.b.trc": "a.b",
    }
    assert {name: plain_stem(Path(name)) for name in names} == names


INPUT_KEYS = {"contact_points", "measured"}
"""Keys of inputs that stand among the options of a step."""


def test_options_are_those_of_the_steps():
    """Written once: every setting of a step's dataclass is a key.

    It has its default and a line of help.
    """
    from dataclasses import fields

    from myomorph.core.tension.recruitment import RecruitmentOptions
    from myomorph.core.tension.tension import TensionOptions
    from myomorph.core.tension.terms.contacts import ContactOptions

    settings = {one.name: one for one in step_settings()["tension"]}
    own = {
        one.name
        for options in (TensionOptions, ContactOptions, RecruitmentOptions)
        for one in fields(options)
    }
    emg = {name for name in settings if name.startswith("emg_")}
    assert emg >= {"emg_mode", "emg_weight", "emg_slack", "emg_display_only"}
    assert set(settings) - emg == own | {"cutoff", *FORCES, "reactions", "intervals", *INPUT_KEYS}
    assert settings["passive"].default is TensionOptions().passive
    assert all(one.help for each in step_settings().values() for one in each)


def test_steps_on_a_subject_come_before_those_that_use_its_model(folder):
    steps = '["calibrate", "ik", "identify", "id"]'
    text = SMALLEST.replace('["ik", "id", "muscles", "tension", "report"]', steps)
    text = text.replace(
        "mass = 72.6", 'mass = 72.6\nstatic = "run.trc"\nheight = 1.8\nchest = 0.9\nsex = "male"'
    )
    plan = plan_of(folder, text + "[options.identify]\ncutoff = 6\nspacing = 0.01\n")
    subject = plan.subjects["s01"]
    assert plan.steps[0] == ("calibrate", "ik", "identify", "id")
    assert (subject.static, subject.shape.height, subject.shape.sex) == (
        folder / "run.trc",
        1.8,
        "male",
    )
    assert [trial.name for trial in subject.trials] == ["walk1", "walk2"]
    assert plan.settings["identify"] == {"cutoff": 6.0, "spacing": 0.01}
    told = problems_of(folder, text.replace(steps, '["ik", "id", "identify", "calibrate"]'))
    assert "'identify' comes after 'id'" in told
    assert "'calibrate' comes after 'ik'" in told
    with_skin = text.replace("height", 'skin = "skin.obj"\nheight')
    assert "skin file 'skin.obj' does not exist" in problems_of(folder, with_skin)


def test_keys_where_they_stood_are_read_and_it_is_said_where_they_belong(folder):
    plan = plan_of(
        folder, SMALLEST + '[options.tension]\nmeasured = "shared"\ncontact_points = "auto"\n'
    )
    assert plan.trials[0].get(ContactsFile).measured == "shared"
    assert plan.trials[0].get(ContactPointsFile).contact_points == "auto"
    assert plan.settings == {}
    assert not any("belongs to" in remark for remark in plan.remarks)
    old = plan_of(
        folder,
        SMALLEST.replace(
            "mass = 72.6", 'mass = 72.6\nmeasured = "shared"\ncontact_points = "auto"'
        ),
    )
    assert old.trials[0].inputs == plan.trials[0].inputs
    for key in ("measured", "contact_points"):
        assert (
            f"subject 's01': '{key}' belongs to [options.tension]; it is still read here"
            in old.remarks
        )

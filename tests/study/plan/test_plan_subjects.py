"""Subjects by pattern and list: measures, conditions, what is left out, name clashes."""

from __future__ import annotations

import pytest

from myomorph.core.model.errors import BadFile
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.plan.plan import read_plan

FOLDERS = """
[study]
name = "walking"
[study.conditions]
slow = "slow*"
fast = ["fast*", "f*1"]
[[subject]]
folders = "P*"
model = "../generic.osim"
static = "{subject} standing.trc"
trials = ["slow*.trc", "fast*.trc"]
steps = ["ik", "id"]
"""
MEASURES = (
    "subject;mass [kg];height"
    " [cm];sex;age;group;BMI\nP1;61,5;170;f;30;old;21\nP2;80;182;M;;young;\n"
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "generic.osim").write_text("")
    for subject in ("P1", "P2"):
        home = tmp_path / subject
        home.mkdir()
        for name in (f"{subject} standing", "slow1", "fast1"):
            (home / f"{name}.trc").write_text("")
    return tmp_path


def plan_of(folder, text, measures=None):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    if measures is not None:
        (folder / "measures.csv").write_text(measures, encoding="utf-8")
    return read_plan(path)


def problems_of(folder, text, measures=None):
    with pytest.raises(BadFile) as caught:
        plan_of(folder, text, measures)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def with_measures(text=FOLDERS):
    return text.replace('name = "walking"', 'name = "walking"\nmeasures = "measures.csv"', 1)


def test_every_folder_that_matches_is_a_subject(folder):
    (folder / "P3").write_text("a file is no subject")
    (folder / "Pout").mkdir()
    (folder / "Pout" / "results.csv").write_text("")
    plan = plan_of(folder, FOLDERS)
    assert list(plan.subjects) == ["P1", "P2"]
    assert [(one.subject, one.name) for one in plan.trials] == [
        ("P1", "slow1"),
        ("P1", "fast1"),
        ("P2", "slow1"),
        ("P2", "fast1"),
    ]
    assert plan.trials[0].markers == folder / "P1" / "slow1.trc"
    assert plan.trials[0].model.resolve() == folder / "generic.osim"
    assert plan.subjects["P2"].static == folder / "P2" / "P2 standing.trc"


def test_a_table_of_its_own_goes_before_a_pattern(folder):
    own = (
        '[[subject]]\nfolders = "P2"\nmodel = "../generic.osim"\ntrials = ["slow1.trc"]\nsteps ='
        ' ["ik"]\n'
    )
    plan = plan_of(folder, FOLDERS + own)
    assert [(one.subject, one.name) for one in plan.trials] == [
        ("P1", "slow1"),
        ("P1", "fast1"),
        ("P2", "slow1"),
    ]
    assert any("'P2' has a table of its own" in remark for remark in plan.remarks)


def test_names_in_a_list(folder):
    for name in ("a_slow", "b_slow"):
        (folder / f"{name}.trc").write_text("")
    text = """
        [study]
        name = "flat"
        [[subject]]
        names = ["a", "b"]
        model = "generic.osim"
        trials = [{markers = "{subject}_slow.trc", name = "slow", condition = "slow"}]
        steps = ["ik"]
        """
    plan = plan_of(folder, text)
    assert [(one.subject, one.name, one.condition) for one in plan.trials] == [
        ("a", "slow", "slow"),
        ("b", "slow", "slow"),
    ]
    assert plan.conditions.names == ("slow",)


def test_conditions(folder):
    plan = plan_of(folder, FOLDERS)
    assert plan.conditions.names == ("slow", "fast")
    assert plan.conditions.trials["P1", "fast1"] == "fast"
    assert [one.condition for one in plan.trials] == ["slow", "fast", "slow", "fast"]
    own = FOLDERS + "[subject.conditions]\nfast = 'slow*'\nslow = 'fast*'\n"
    told = problems_of(folder, own)
    assert "study: conditions: 'slow': no trial matches 'slow*'" in told


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"f*1"', '"run*"', ("conditions: 'fast': no trial matches 'run*'", "'fast1'")),
        ('"f*1"', '"*1"', ("is in more than one condition: slow, fast",)),
        (
            '"fast*.trc"]',
            '{markers = "fast1.trc", condition = "sloow"}]',
            ("unknown condition 'sloow'", "'slow'"),
        ),
        ('folders = "P*"', 'folders = "Q*"', ("no folder matches 'Q*'",)),
        ('folders = "P*"', 'folders = "Q1"', ("there is no folder 'Q1'",)),
        (
            'folders = "P*"',
            'folders = "P*"\nname = "s"',
            ("has 'name' and 'folders': expected one of them",),
        ),
        ('folders = "P*"', "folders = []", ("'names' or 'folders' is empty",)),
        ('folders = "P*"', 'names = ["P1", "P1"]', ("names: 'P1' is given twice",)),
        ("slow*.trc", f"{'s' * 3000}.trc", ("does not exist",)),
        ('folders = "P*"\n', "", ("'subject.1.name' is missing",)),
        (
            "{subject} standing",
            "{subject}standing",
            ("'P1standing.trc' does not exist", "'P1 standing.trc'"),
        ),
        ('["ik", "id"]', '["ik", "id", "ik"]', ("'ik' is given twice",)),
        (
            '["ik", "id"]',
            '["ik", "identify"]',
            ("subject 'P1': the step 'identify' needs the subject's 'mass'",),
        ),
        ('model = "../generic.osim"', 'model_of = "P9"', ("no subject 'P9'", "'P1', 'P2'")),
        ('model = "../generic.osim"', 'model_of = "P1"', ("'P1' waits for 'P1'",)),
        (
            '["ik", "id"]',
            '["ik", "id"]\noptions = {id = {cutof = 1}}',
            ("options.id.cutof'", "'cutoff'"),
        ),
        (
            '["ik", "id"]',
            '["ik", "tension"]\noptions = {tension = {intervals = -1}}',
            ("intervals at -1",),
        ),
        (
            '["ik", "id"]',
            '["ik", "id"]\noptions = {id = {cutoff = -6}}',
            ("cutoff -6.0 Hz: expected a positive",),
        ),
    ],
)
def test_what_is_wrong_is_named(folder, old, new, words):
    told = problems_of(folder, FOLDERS.replace(old, new, 1))
    for word in words:
        assert word in told


def test_exclusions_have_reasons(folder):
    told = '[[exclude]]\nsubject = "P1"\ntrial = "fast*"\nreason = "a marker fell off"\n'
    plan = plan_of(folder, FOLDERS + told)
    assert [(one.subject, one.trial, one.reason) for one in plan.excluded] == [
        ("P1", "fast1", "a marker fell off")
    ]
    assert [one.name for one in plan.trials] == ["slow1", "slow1", "fast1"]
    assert plan.conditions.trials["P1", "fast1"] == "fast"
    # Of a subject that is left out no file is looked for.
    (folder / "P1" / "P1 standing.trc").unlink()
    whole = plan_of(folder, FOLDERS + '[[exclude]]\nsubject = "P1"\nreason = "ill"\n')
    assert (list(whole.subjects), [one.trial for one in whole.excluded]) == (["P2"], [""])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            'subject = "P1"\ntrial = "jump"\nreason = "x"',
            ("excludes nothing", "no trial 'jump'", "'slow1'"),
        ),
        ('subject = "P7"\nreason = "x"', ("excludes nothing", "no subject 'P7'", "'P1'")),
        ('subject = "P1"', ("'exclude.1.reason' is missing",)),
        ('subject = "*"\nreason = "x"', ("nothing is left: 2 subjects or trials are excluded",)),
        ('subject = "P1"\nreason = " "', ("its reason is empty",)),
        ('reason = "x"', ("names no subject and no trial",)),
    ],
)
def test_an_exclusion_that_is_wrong_is_named(folder, table, words):
    told = problems_of(folder, FOLDERS + "[[exclude]]\n" + table + "\n")
    for word in words:
        assert word in told


def test_a_table_of_measures(folder):
    plan = plan_of(folder, with_measures(), MEASURES)
    assert [one.get(BodyMass).mass for one in plan.trials] == [61.5, 61.5, 80.0, 80.0]
    assert plan.subjects["P1"].shape.sex == "female"
    assert plan.subjects["P1"].shape.age == 30.0
    # A height without a chest is no body shape, and no fault in a table that has a column of
    # heights.
    assert plan.subjects["P1"].shape.height is None
    assert plan.groups is None
    assert any("not used: BMI" in remark for remark in plan.remarks)


def test_models_of_a_table_of_measures(folder):
    table = "subject,model\nP1,generic.osim\nP2,generik.osim\n"
    told = problems_of(folder, with_measures().replace('model = "../generic.osim"\n', ""), table)
    assert (
        "line 3 ('P2'): model file 'generik.osim' does not exist: there are 'generic.osim'" in told
    )
    table = table.replace("generik", "generic")
    plan = plan_of(folder, with_measures().replace('model = "../generic.osim"\n', ""), table)
    assert {one.model for one in plan.trials} == {folder / "generic.osim"}
    assert "model is '../generic.osim' here" in problems_of(folder, with_measures(), table)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("subject,mass\nP1,60\n", ("no line for subject 'P2': there are 'P1'",)),
        ("subject,mass\nP1,60\nP2,\n", ("subject 'P2': has no 'mass' [kg], but 1 of 2 have one",)),
        ("subject,mass\nP1,60\nP2,sixty\n", ("line 3 ('P2'): mass 'sixty': expected a number",)),
        ("subject,mass\nP1,60\nP2,-3\n", ("mass '-3': expected a number above 0",)),
        ("subject,mass\nP1,60\nP2,60000\n", ("mass of 60000 kg", "'mass [g]'")),
        (
            "subject,mass [stone]\nP1,60\nP2,60\n",
            ("'stone' is not a unit of mass: there are 'kg'",),
        ),
        ("subject,maas\nP1,60\nP2,60\n", ("unknown column 'maas': there are 'mass'",)),
        ("subject,weight\nP1,60\nP2,60\n", ("unknown column 'weight'", "'mass'")),
        ("name,mass\nP1,60\nP2,60\n", ("has no column 'subject'",)),
        ("subject,mass\nP1,60\nP1,60\nP2,60\n", ("line 3: subject 'P1' is given twice",)),
        ("subject,mass\nP1,60,70\nP2,60\n", ("line 2: has 3 cells, but there are 2 columns",)),
        ("subject,sex\nP1,x\nP2,f\n", ("sex 'x': expected female or male",)),
        ("subject,mass,mass\nP1,6,6\nP2,6,6\n", ("has two columns 'mass'",)),
        ("", ("is empty",)),
    ],
)
def test_a_wrong_table_of_measures_is_told_by_line(folder, table, words):
    told = problems_of(folder, with_measures(), table)
    for word in words:
        assert word in told


def test_a_measure_is_told_once(folder):
    text = with_measures(FOLDERS.replace('"P*"', '"P*"\nmass = 61.5'))
    assert "mass is 61.5 here and 80.0 in measures.csv" in problems_of(folder, text, MEASURES)


def test_groups_of_a_table_of_measures_are_compared_where_asked_for(folder):
    table = "subject,group\nP1,old\nP2,young\nP3,child\n"
    (folder / "P3").mkdir()
    for name in ("P3 standing", "slow1", "fast1"):
        (folder / "P3" / f"{name}.trc").write_text("")
    text = with_measures()
    plan = plan_of(folder, text, table)
    assert plan.groups is None
    assert any("not compared" in remark for remark in plan.remarks)
    named = text.replace('name = "walking"', 'name = "walking"\ncompare = ["child", "old"]')
    assert plan_of(folder, named, table).groups.second == ("old", ("P1",))
    wrong = named.replace("child", "chid")
    assert "no group 'chid': there are 'child'" in problems_of(folder, wrong, table)


def test_groups_by_pattern_without_those_that_are_left_out(folder):
    text = FOLDERS + "[groups]\none = ['P1']\nother = ['P[2-9]']\n"
    assert plan_of(folder, text).groups.second == ("other", ("P2",))
    assert "no subject matches 'X*'" in problems_of(folder, text.replace("P[2-9]", "X*"))


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("walk 1", "walk_1"), ("would write the same folder 'walk_1'",)),
        (("Walk", "walk"), ("would write the same folder 'walk'",)),
        (("walk", "walk."), ("would write the same folder 'walk.'",)),
        (("con",), ("'con' is a device name on Windows",)),
        (("COM1.a",), ("'com1' is a device name on Windows",)),
        (("..",), ("cannot be the name of a folder",)),
        (("w" * 101,), ("its name has 101 characters",)),
    ],
)
def test_names_that_cannot_be_folders(folder, names, words):
    trials = ", ".join(f'{{markers = "P1/slow1.trc", name = "{name}"}}' for name in names)
    text = (
        '[study]\nname = "x"\n[[subject]]\nname = "s"\nmodel = "generic.osim"\ntrials ='
        f' [{trials}]\nsteps = ["ik"]\n'
    )
    told = problems_of(folder, text)
    for word in words:
        assert word in told


def test_subjects_whose_folders_would_be_one(folder):
    one = (
        '[[subject]]\nname = "{}"\nmodel = "generic.osim"\ntrials = ["P1/slow1.trc"]\nsteps ='
        ' ["ik"]\n'
    )
    text = "[study]\nname = 'x'\n" + one.format("s1") + one.format("S1") + one.format("results.csv")
    told = problems_of(folder, text)
    assert "subject 's1' and subject 'S1' would write the same folder" in told
    assert "results.csv" in told


def test_options_of_subjects_and_trials_over_those_of_the_study(folder):
    text = FOLDERS.replace(
        '"fast*.trc"]',
        '{markers = "fast*.trc", options = {id = {cutoff = 15}}}]\noptions = {ik = {tolerance ='
        " 1e-6}}",
    )
    plan = plan_of(folder, text + "[options.tension]\ncutoff = 6\n")
    assert plan.settings == {"tension": {"cutoff": 6.0}}
    assert plan.settings_of("P1") == {"tension": {"cutoff": 6.0}, "ik": {"tolerance": 1e-6}}
    # The filter is one for all steps that differentiate, so what a trial says of it replaces what
    # the study says.
    assert plan.settings_of("P1", "fast1") == {"id": {"cutoff": 15.0}, "ik": {"tolerance": 1e-6}}


def test_the_model_of_a_subject_that_makes_none(folder):
    one = '[[subject]]\nname = "{}"\n{}\ntrials = ["P1/slow1.trc"]\nsteps = ["ik"]\n'
    text = (
        "[study]\nname = 'x'\n"
        + one.format("a", 'model = "generic.osim"')
        + one.format("b", 'model_of = "a"')
    )
    assert "subject 'b': model_of: subject 'a' makes no model" in problems_of(folder, text)
    plan = plan_of(folder, text.replace('steps = ["ik"]', 'steps = ["calibrate", "ik"]', 1))
    assert (plan.maker("a"), plan.maker("b"), plan.begins_with("b")) == ("a", "a", "a")
    chain = text.replace('steps = ["ik"]', 'steps = ["calibrate", "ik"]', 1) + one.format(
        "c", 'model_of = "b"'
    )
    assert plan_of(folder, chain).maker("c") == "a"


def test_absolute_patterns(folder):
    text = FOLDERS.replace('"P*"', f'"{(folder / "P*").as_posix()}"')
    assert list(plan_of(folder, text).subjects) == ["P1", "P2"]


def test_a_folder_that_is_a_link_is_called_as_the_link(folder):
    target = folder / "elsewhere"
    (folder / "P2").rename(target)
    (target / "P2 standing.trc").write_text("")
    try:
        (folder / "P2").symlink_to(target, target_is_directory=True)
    except OSError:
        pytest.skip("links cannot be made here")
    assert list(plan_of(folder, FOLDERS).subjects) == ["P1", "P2"]


def test_the_folder_of_the_study_itself(folder):
    text = (
        FOLDERS.replace('"P*"', '"."')
        .replace('model = "../', 'model = "')
        .replace('static = "{subject}', 'static = "P1/P1')
    )
    text = text.replace('["slow*.trc", "fast*.trc"]', '["P1/slow*.trc", "P1/fast*.trc"]')
    assert list(plan_of(folder, text).subjects) == [folder.name]

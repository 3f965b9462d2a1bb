"""Laws of study files.

Names that pass are folders everywhere, tables of measures never fail but by a problem.
"""

from __future__ import annotations

import tempfile
from pathlib import Path, PureWindowsPath

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from myomorph.lab.store.results import file_name
from myomorph.lab.study.plan.measures import LARGEST, UNITS, read_measures
from myomorph.lab.study.plan.plan_checks import check_names, folder_key
from myomorph.lab.study.plan.subject_tables import filtered_steps, merged
from myomorph.lab.study.trial.trial_inputs import TrialFiles

DEVICES = [
    "CON",
    "PRN",
    "AUX",
    "NUL",
    "COM1",
    "COM2",
    "COM3",
    "COM9",
    "COM¹",
    "LPT1",
    "LPT2",
    "LPT9",
    "LPT³",
]
NAME = st.text(min_size=1, max_size=12) | st.sampled_from(
    [*DEVICES, "con.txt", "nul. ", "com1.a.b", "a.", "A", "a"]
)
NAMES = st.lists(NAME, min_size=1, max_size=5)
TABLE = st.text(alphabet='subjectmas,;\t\n"[kg]0123.- \0ä', max_size=120)


# Drawing names is slow where other processes keep the cores busy; that is no failure.
@settings(suppress_health_check=[HealthCheck.too_slow])
@given(trials=NAMES)
def test_names_that_pass_are_different_folders_on_every_system(trials):
    problems: list[str] = []
    files = [TrialFiles(Path("m.osim"), name, "s") for name in trials]
    check_names(files, {"s": ("ik",)}, (), problems)
    if problems:
        return
    folders = [file_name(name) for name in trials]
    assert len({one.casefold().rstrip(". ") for one in folders}) == len(trials)
    for one in folders:
        assert PureWindowsPath(one).name == one
        assert one.split(".")[0].upper() not in DEVICES
        assert one.strip(". ")


@given(name=st.text(min_size=1, max_size=20))
def test_the_key_of_a_folder_stays(name):
    assert folder_key(folder_key(name)) == folder_key(name)
    assert folder_key(name.upper()) == folder_key(name.upper().lower()) or not name.isascii()


@settings(max_examples=300)
@given(text=TABLE, head=st.sampled_from(["", "subject,mass [kg]\n", "subject;height [cm];age\n"]))
def test_any_text_is_a_table_or_a_problem_or_said_to_hold_no_subject(text, head):
    problems: list[str] = []
    remarks: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m.csv"
        path.write_text(head + text, encoding="utf-8", newline="")
        found = read_measures(path, problems, remarks)
    for one in found.values():
        for name, largest in LARGEST.items():
            value = getattr(one, name)
            assert value is None or 0.0 < value <= largest
    assert found or problems or "m.csv: has a line of names, but no line of a subject" in remarks


@pytest.mark.parametrize("content", [b"\xff\xfe\x00s", b"PK\x03\x04\xff\xff", b"", b"\0" * 100])
def test_what_is_no_table_is_a_problem(tmp_path, content):
    path = tmp_path / "m.xlsx"
    path.write_bytes(content)
    problems: list[str] = []
    assert read_measures(path, problems, []) == {}
    assert problems


@pytest.mark.parametrize(
    ("name", "unit", "factor"), [(n, u, f) for n, own in UNITS.items() for u, f in own.items()]
)
@pytest.mark.parametrize("form", ["{} [{}]", "{}({})", " {} [ {} ] "])
def test_units_of_headings(tmp_path, name, unit, factor, form):
    path = tmp_path / "m.csv"
    path.write_text(f"subject,{form.format(name, unit.upper())}\na,2\n", encoding="utf-8")
    problems: list[str] = []
    found = read_measures(path, problems, [])
    assert problems == []
    assert getattr(found["a"], name) == pytest.approx(2.0 * factor)


FILTERED = st.sampled_from(filtered_steps())


@given(
    study=st.dictionaries(FILTERED, st.fixed_dictionaries({}, optional={"cutoff": st.just(6.0)})),
    own=st.dictionaries(FILTERED, st.fixed_dictionaries({}, optional={"cutoff": st.just(12.0)})),
)
def test_a_cutoff_of_a_trial_is_the_only_one(study, own):
    cutoffs = {given["cutoff"] for given in merged(study, own).values() if "cutoff" in given}
    told = any("cutoff" in given for given in own.values())
    assert cutoffs <= ({12.0} if told else {6.0})
    assert not told or cutoffs == {12.0}

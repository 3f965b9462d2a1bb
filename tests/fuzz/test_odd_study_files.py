"""Study files that no user writes and a damaged disk may: each is named in one message."""

from __future__ import annotations

import pytest
from fuzz_readers import SEEDS

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.toml_file import MAX_PROBLEMS
from myomorph.lab.study.plan.plan import read_plan

STUDY = (SEEDS / "study.toml").read_text(encoding="utf-8")


def said(folder, text: str) -> str:
    (folder / "study.toml").write_text(text, encoding="utf-8")
    with pytest.raises(BadFile) as caught:
        read_plan(folder / "study.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    "name", ["a" * 300 + ".trc", "a" * 5000 + "*.trc", "walk\\u0000.trc", "\\u0000*"]
)
def test_names_that_no_file_can_have(tmp_path, name):
    assert "study.toml: " in said(tmp_path, STUDY.replace("walk*.trc", name))


def test_a_whole_number_of_thousands_of_digits(tmp_path):
    assert "is not TOML" in said(tmp_path, STUDY.replace("72.6", "7" * 5000))


def test_a_hexadecimal_number_of_thousands_of_digits(tmp_path):
    assert "a number with thousands of digits" in said(
        tmp_path, STUDY.replace('"walking"', "0x" + "7" * 5000)
    )


def test_a_long_value_is_cut_short(tmp_path):
    assert len(said(tmp_path, STUDY.replace("72.6", f'"{9000 * "x"}"'))) < 3000


def test_of_many_problems_the_first_are_told(tmp_path):
    told = said(
        tmp_path, STUDY + "".join(f"[[subject]]\nname = 's{k}'\n" for k in range(2 * MAX_PROBLEMS))
    )
    assert "more" in told
    assert told.count(" | ") == MAX_PROBLEMS

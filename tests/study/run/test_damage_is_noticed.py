"""A result that was altered behind our back is named and made anew, byte for byte."""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

import pytest

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.digests import LENGTH, Seal, seal_of
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.show.demo.arm import example_files

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc"]
steps = ["ik", "id", "muscles", "report"]
[options.id]
cutoff = 6
"""
TRIAL = "s01/reach"


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """Make a folder with the example's files, a study of one trial and its results."""
    arm = example_files(tmp_path_factory.mktemp("finished"))
    (arm.folder / "study.toml").write_text(STUDY, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "1700000000")
        run_study(read_plan(arm.folder / "study.toml"), arm.folder / "out")
    return arm.folder


def contents(out: Path) -> dict[str, str]:
    """Hash of each file of the trial; of its result what it holds, in whatever order."""
    home = out / TRIAL
    hashes = {
        path.relative_to(home).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(home.rglob("*"))
        if path.is_file()
    }
    stored = read_result(home / "reach.nc")
    values = sorted((name, array.tobytes()) for name, array in stored.values.items())
    texts = [sorted(stored.names.items()), sorted(stored.facts.items())]
    hashes["reach.nc"] = hashlib.sha256(repr((values, texts)).encode()).hexdigest()
    return hashes


def again(finished: Path, tmp_path: Path, alter) -> tuple:
    """Outcome of a second run on results that were altered, and files that then differ."""
    out = finished / "out"
    before = contents(out)
    shutil.copytree(out, tmp_path / "kept")
    try:
        alter(out)
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SOURCE_DATE_EPOCH", "1700000000")
            outcomes = run_study(read_plan(finished / "study.toml"), out)
        after = contents(out)
    finally:
        shutil.rmtree(out)
        shutil.move(tmp_path / "kept", out)
    outcome = next(each for each in outcomes if each.trial == "reach")
    return outcome, [name for name in before if before[name] != after.get(name)]


def flip(path: Path, place: float, bit: int = 1) -> None:
    content = bytearray(path.read_bytes())
    content[int(place * (len(content) - LENGTH))] ^= bit
    path.write_bytes(content)


def test_nothing_is_computed_where_nothing_was_altered(finished, tmp_path):
    outcome, differing = again(finished, tmp_path, lambda out: None)
    assert outcome.reused == ("ik", "id", "muscles", "report")
    assert differing == []


@pytest.mark.parametrize("place", [0.0, 0.13, 0.37, 0.5, 0.71, 0.97])
def test_one_flipped_bit_of_a_result(finished, tmp_path, place):
    outcome, differing = again(
        finished, tmp_path, lambda out: flip(out / TRIAL / "reach.nc", place)
    )
    assert outcome.error == ""
    assert outcome.reused == ()
    assert outcome.changed == ("reach.nc is damaged",)
    assert differing == []


def test_a_result_that_ends_early(finished, tmp_path):
    path = Path(TRIAL) / "reach.nc"
    outcome, differing = again(
        finished, tmp_path, lambda out: os.truncate(out / path, (out / path).stat().st_size // 2)
    )
    assert outcome.changed == ("reach.nc is damaged",)
    assert differing == []


def edit_digit(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    at = max(text.rfind(digit) for digit in "12345678")
    path.write_text(text[:at] + "9" + text[at + 1 :], encoding="utf-8")


@pytest.mark.parametrize(("name", "step"), [("torques.sto", "id"), ("coordinates.mot", "ik")])
def test_one_digit_of_a_table(finished, tmp_path, name, step):
    outcome, differing = again(finished, tmp_path, lambda out: edit_digit(out / TRIAL / name))
    assert outcome.changed == (f"{name} is damaged or was edited",)
    assert step not in outcome.reused
    assert "muscles" in outcome.reused
    assert differing == []


def test_a_table_that_is_missing(finished, tmp_path):
    outcome, differing = again(
        finished, tmp_path, lambda out: (out / TRIAL / "torques.sto").unlink()
    )
    assert outcome.changed == ("torques.sto is missing",)
    assert differing == []


@pytest.mark.parametrize("name", ["values.csv", "report.html"])
def test_files_made_of_all_results(finished, tmp_path, name):
    outcome, differing = again(finished, tmp_path, lambda out: edit_digit(out / TRIAL / name))
    assert {"ik", "id", "muscles"} <= set(outcome.reused)
    assert differing == []


def test_readers_say_that_a_result_is_damaged(finished, tmp_path):
    path = tmp_path / "reach.nc"
    shutil.copy(finished / "out" / TRIAL / "reach.nc", path)
    assert seal_of(path) is Seal.WHOLE
    flip(path, 0.4)
    assert seal_of(path) is Seal.DAMAGED
    with pytest.raises(BadFile, match="does not match its digest"):
        read_result(path)


def test_a_result_of_others_is_read_without_a_digest(finished, tmp_path):
    source = finished / "out" / TRIAL / "reach.nc"
    path = tmp_path / "reach.nc"
    path.write_bytes(source.read_bytes()[:-LENGTH])
    assert seal_of(path) is Seal.NONE
    assert read_result(path).names == read_result(source).names

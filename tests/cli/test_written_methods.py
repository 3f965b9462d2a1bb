"""Methods that `dataclasses` writes: compiled once, and the same as Python's own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from myomorph.lab.cli.written_methods import MOST_TEXTS, WrittenMethods

SOURCES = Path(__file__).parents[2] / "src"
METHOD = "def double(value: int):\n    return 2 * value"
PROGRAM = """
import builtins, sys
compiled = []
ours = builtins.compile
def watched(source, *arguments, **options):
    if isinstance(source, str) and "__create_fn__" in source:
        compiled.append(source)
    return ours(source, *arguments, **options)
builtins.compile = watched
from myomorph.lab.cli import main
status = main(sys.argv[1:])
from myomorph.core.model.interval import Interval
shown = Interval(value=1.0, low=0.5, high=2.0)
print(len(compiled), shown, Interval.__init__.__annotations__)
try:
    shown.value = 2.0
except AttributeError as error:
    print(type(error).__name__)
sys.exit(status)
"""


@pytest.fixture
def file(tmp_path):
    return tmp_path / "kernels" / "methods.code"


def doubled(methods, text=METHOD):
    names = {}
    methods.execute(text, {}, names)
    return names["double"]


def kept(file, text=METHOD):
    methods = WrittenMethods(file)
    doubled(methods, text)
    methods.keep()
    return file.read_bytes()


def test_a_text_does_the_same_from_the_file(file):
    kept(file)
    double = doubled(WrittenMethods(file))
    assert double(3) == 6
    # Not the text of an annotation: settings of the room that compiles must not count.
    assert double.__annotations__ == {"value": int}


def test_nothing_new_writes_nothing(file):
    before = kept(file)
    file.chmod(0o444)
    assert kept(file) == before


@pytest.mark.parametrize("place", [0, 40, -1])
def test_a_damaged_file_is_made_anew(file, place):
    content = bytearray(kept(file))
    content[place] ^= 1
    file.write_bytes(content)
    double = doubled(WrittenMethods(file))
    assert double(3) == 6
    assert kept(file) != bytes(content)


def test_a_file_that_only_grew_begins_anew(file):
    methods = WrittenMethods(file)
    for number in range(MOST_TEXTS + 1):
        methods.execute(f"value = {number}", {}, {})
    methods.keep()
    assert file.stat().st_size < 100


def test_a_folder_that_cannot_be_written_is_no_fault(tmp_path):
    (tmp_path / "kernels").write_text("a file in the folder's place")
    methods = WrittenMethods(tmp_path / "kernels" / "methods.code")
    assert doubled(methods)(3) == 6
    methods.keep()
    assert [path.name for path in tmp_path.iterdir()] == ["kernels"]


def test_a_second_start_compiles_no_methods_and_makes_the_same_classes(tmp_path):
    places = {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(SOURCES)}

    def started():
        words = [sys.executable, "-c", PROGRAM, "ik", "--help"]
        done = subprocess.run(
            words, env=os.environ | places, capture_output=True, text=True, check=True
        )
        *_, made, refused = done.stdout.splitlines()
        count, _, classes = made.partition(" ")
        return int(count), classes, refused

    first, classes, refused = started()
    again, same_classes, same_refused = started()
    assert first > 100
    assert again == 0
    assert (classes, refused) == (same_classes, same_refused)
    assert refused == "FrozenInstanceError"

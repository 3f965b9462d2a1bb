"""The mutation run: what it changes in a source text, what it leaves, and which tests it runs first."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="tests of mutants run in forked processes with a limit: not on Windows")

from benchmarks import mutant_tests, mutants

TEXT = '''"""A docstring with 1 + 1."""

LIMIT = 0.5 * 2


def area(width: float, height: float = 2.0 * 1) -> float:
    """Of a box: width * height."""
    if width < 0 or height < 0:
        raise ValueError(f"{width + height} is not {1 + 1}")
    names = "a" + "b"
    return -width * height + len(names[1:])
'''


def changes(text):
    return {(one.kind, one.described(text).split("  ->  ")[1]) for one in mutants.mutations(text)}


def test_every_kind_of_change_and_nothing_else():
    assert changes(TEXT) == {
        ("comparison", "if width >= 0 or height < 0:"),
        ("comparison", "if width < 0 or height >= 0:"),
        ("and/or", "if width < 0 and height < 0:"),
        ("off by one", "if width < 1 or height < 0:"),
        ("off by one", "if width < 0 or height < 1:"),
        ("sign", "return +width * height + len(names[1:])"),
        ("sign", "return -width * height - len(names[1:])"),
        ("factor", "return (1.02 * (-width * height)) + len(names[1:])"),
        ("off by one", "return -width * height + len(names[2:])"),
    }


def test_offsets_are_those_of_bytes():
    (one,) = mutants.mutations('def f(ä: int) -> bool:\n    return "ö" != str(ä)  # ü\n')
    assert one.described('def f(ä: int) -> bool:\n    return "ö" != str(ä)  # ü\n').endswith(
        'return "ö" == str(ä)  # ü'
    )


def test_the_same_seed_draws_the_same_mutants():
    first, again, other = (mutants.drawn("tension", 10, seed) for seed in (3, 3, 4))
    assert first == again != other
    assert len({(path, one.line) for path, one in first}) == 10
    assert {one.kind for _, one in mutants.drawn("tension", 40, 0)} == set(mutants.KINDS)


def test_the_nearest_tests_come_first():
    steps = mutant_tests.tests_of(mutants.ROOT, "morph", Path("src/myomorph/morph/checks/clearance.py"))
    assert steps[Path("tests/morph/test_clearance.py")] == min(steps.values()) == 1
    assert steps[Path("tests/morph/test_graft.py")] > 1
    assert Path("tests/morph/test_clusters.py") not in steps


def test_a_sample_is_by_lines_and_mixes_the_rooms():
    found = mutants.sample(["muscles", "morph"], 12, 0)
    by_room = [sum(room == one for room, _, _ in found) for one in ("muscles", "morph")]
    assert sum(by_room) == 12
    assert by_room[1] > by_room[0] > 0
    many = mutants.sample(["muscles", "morph"], 40, 0)
    assert {room for room, _, _ in many[:20]} == {"muscles", "morph"}


KERNEL = """@inner
def turned(a, b):
    return a[0] * b[
        1
    ]


def largest(values):
    if (
        values[0] > 0
    ):
        return 1
    return np.argmax(values * 2)
"""


def test_the_statement_of_a_line_and_whether_it_is_compiled():
    assert [mutants.statement(KERNEL, line) for line in (4, 10, 12)] == [range(3, 6), range(9, 12), range(12, 13)]
    assert [mutants.in_kernel(KERNEL, line) for line in (3, 12)] == [True, False]


def test_a_factor_on_all_that_is_ranked_changes_nothing():
    assert {one.line for one in mutants.mutations(KERNEL) if one.kind == "factor"} == {3}


def test_the_table_names_survivors_and_says_what_was_not_run(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text(f"before\n\n{mutants.MARKS[0]}\nold\n{mutants.MARKS[1]}\nafter\n", "utf-8")
    wanted = [("rigid", Path("a.py"), one) for one in mutants.mutations("def f(a):\n    return a + 1\n")[:1]] * 4
    told = [
        mutants.Outcome("rigid", "src/myomorph/rigid/a.py", 2, "sign", "a | b  ->  a & b", by, 1.0)
        for by in ("test_a.py::test_f", "")
    ]
    monkeypatch.setattr(mutants, "EQUAL", {("src/myomorph/rigid/a.py", "a + 0"): "0 is nothing"})
    told.append(mutants.Outcome("rigid", "src/myomorph/rigid/a.py", 3, "sign", "a - 0  ->  a + 0", "", 1.0))
    mutants.write_table(page, told, wanted, "seed 0", 15.0)
    text = page.read_text("utf-8")
    assert text.startswith("before\n\n<!-- mutants -->\n")
    assert text.endswith("\n<!-- end of mutants -->\nafter\n")
    assert "1 of 2 mutants killed (seed 0, 3 of 4 run, 15 s of tests each)." in text
    assert "| `rigid` | 4 | 2 | 1 |" in text
    assert "| `rigid/a.py:2` | sign | `a \\| b  ->  a & b` |  |" in text
    assert "| `rigid/a.py:3` | sign | `a - 0  ->  a + 0` | computes the same: 0 is nothing |" in text
    assert "old" not in text


def test_of_earlier_results_those_stand_whose_line_does(tmp_path, monkeypatch):
    source = tmp_path / "src" / "a.py"
    source.parent.mkdir()
    source.write_text("def f(a):\n    b = a + 1\n    return b * 2\n", "utf-8")
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    told = [
        mutants.Outcome("rigid", file, 7, "sign", change, "", 1.0)
        for file, change in (
            ("src/a.py", "b = a + 1  ->  b = a - 1"),
            ("src/a.py", "b = a + 2  ->  b = a - 2"),
            ("src/gone.py", "b = a + 1  ->  b = a - 1"),
            ("src/a.py", "b = a + 1  ->  b = a - 1"),
        )
    ]
    (tmp_path / "outcomes.jsonl").write_text("".join(json.dumps(asdict(one)) + "\n" for one in told), "utf-8")
    ((room, path, one),) = mutants.standing(tmp_path)
    assert (room, path, one.line, one.new) == ("rigid", Path("src/a.py"), 2, "-")


@pytest.fixture
def copy(tmp_path):
    """A tree of one module and two tests."""
    made = {
        "src/myomorph/__init__.py": "",
        "src/myomorph/morph/area.py": (
            "def area(a, b):\n    return a * b + max(0, a - 10)\n\n\ndef half(a):\n    return a / 2\n"
        ),
        "tests/morph/test_area.py": (
            "from myomorph.morph.area import area, half\n\n\ndef test_area():\n    assert area(2, 3) == 6\n\n\n"
            "def test_half():\n    assert half(4) == 2\n"
        ),
    }
    for name, text in made.items():
        path = tmp_path / "original" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    return mutant_tests.Copy(tmp_path / "work", tmp_path / "original")


def tried(copy, change):
    """Of the made module, with the text put back each time."""
    path = Path("src/myomorph/morph/area.py")
    before, when = (copy.root / path).read_text("utf-8"), (copy.root / path).stat().st_mtime_ns
    one = next(one for one in mutants.mutations(before) if change in one.applied(before))
    by, _ = copy.tried("morph", path, one.applied(before), mutants.statement(before, one.line), 60.0, False)
    assert (copy.root / path).read_text("utf-8") == before
    assert (copy.root / path).stat().st_mtime_ns == when
    return by


def test_a_mutant_is_noticed_or_survives_and_later_ones_run_what_reaches_them(copy):
    assert tried(copy, "(1.02 * (a * b))") == "tests/morph/test_area.py::test_area"
    assert copy.reached == {}
    assert tried(copy, "return a * b - max") == ""
    (tests,) = copy.reached.values()
    lines = {name.rpartition("::")[2]: one["lines"]["src/myomorph/morph/area.py"] for name, one in tests.items()}
    assert lines == {"test_area": [2], "test_half": [6]}
    # What test_area runs is not run again.
    assert tried(copy, "return a / 3") == "tests/morph/test_area.py::test_half"
    again = mutant_tests.Copy(copy.folder, copy.folder.parent / "original")
    assert again.reached == copy.reached
    assert copy.failing(["tests/morph/test_area.py::test_area", "tests/morph/test_area.py::test_gone"]) == [
        "tests/morph/test_area.py::test_gone"
    ]

"""The mutation run: what it changes in a source text, what it leaves, and which tests it runs first."""

from pathlib import Path

import pytest
from benchmarks import mutants

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
    found = mutants.tests_of(mutants.ROOT, "morph", Path("src/myomorph/morph/checks/clearance.py"))
    assert found[0] == Path("tests/morph/test_clearance.py")
    assert Path("tests/morph/test_graft.py") in found
    assert Path("tests/morph/test_clusters.py") not in found


@pytest.fixture
def copy(tmp_path):
    """A tree of one function and one test."""
    made = {
        "src/myomorph/__init__.py": "",
        "src/myomorph/morph/area.py": "def area(a, b):\n    return a * b + max(0, a - 10)\n",
        "tests/morph/test_area.py": (
            "from myomorph.morph.area import area\n\n\ndef test_area():\n    assert area(2, 3) == 6\n"
        ),
    }
    for name, text in made.items():
        path = tmp_path / "original" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    return mutants.Copy(tmp_path / "work", tmp_path / "original")


@pytest.mark.parametrize(
    ("change", "by"), [("return a * b - max", ""), ("1.02", "tests/morph/test_area.py::test_area")]
)
def test_a_mutant_is_noticed_or_survives_and_the_file_is_put_back(copy, change, by):
    path = Path("src/myomorph/morph/area.py")
    before, when = (copy.root / path).read_text("utf-8"), (copy.root / path).stat().st_mtime_ns
    mutant = next(one for one in mutants.mutations(before) if change in one.applied(before))
    assert copy.tried("morph", path, mutant).by == by
    assert (copy.root / path).read_text("utf-8") == before
    assert (copy.root / path).stat().st_mtime_ns == when

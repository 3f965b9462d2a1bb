"""The mutation run: what it draws, and which tests it takes for a module."""

from pathlib import Path

import pytest

pytest.importorskip("cosmic_ray", reason="needs the extra 'mutants'")
pytest.importorskip("resource", reason="not on Windows")

import grimp
from benchmarks import mutants
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

TEXT = '''"""1 + 1."""

LIMIT = 0.5 * 2


def area(width: float, height: float = 2.0 * 1) -> float:
    """Of a box: width * height."""
    if width < 0:
        raise ValueError(f"{width + height} is not {1 + 1}")
    return -width * height
'''


@pytest.fixture
def tree(tmp_path, monkeypatch):
    path = tmp_path / "src/myomorph/bones/morph/area.py"
    path.parent.mkdir(parents=True)
    path.write_text(TEXT, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_places_inside_functions_are_drawn_one_a_line(tree):
    first = list(mutants.sample(["bones/morph"], 2, 3))
    again = list(mutants.sample(["bones/morph"], 2, 3))
    assert first == again
    specs = [item.mutations[0] for item in first]
    assert {spec.start_pos[0] for spec in specs} == {8, 10}
    changed = {
        mutate_code(TEXT, get_operator(spec.operator_name)(), spec.occurrence).splitlines()[
            spec.start_pos[0] - 1
        ]
        for spec in specs
    }
    assert changed <= {
        "    if width >= 0:",
        "    if width < 1:",
        "    if width < -1:",
        "    return +width * height",
        "    return -width / height",
    }


def test_the_nearest_tests_come_first(monkeypatch):
    monkeypatch.chdir(mutants.ROOT)
    graph = grimp.build_graph("myomorph", cache_dir=None)
    files = mutants.nearest_tests(graph, Path("src/myomorph/bones/morph/checks/clearance.py"))
    assert files[0] == "tests/morph/test_clearance.py"
    assert "tests/morph/test_clusters.py" not in files

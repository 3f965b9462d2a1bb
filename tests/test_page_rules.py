"""Rules of a page hold wherever no list excuses a file, and the lists only get shorter."""

from __future__ import annotations

import pytest
from tests.page.exceptions import by_file, listed, still, write
from tests.page.linter import RULES as RUFF_RULES
from tests.page.linter import ruff_findings
from tests.page.rules import JUDGED, MECHANICAL, findings
from tests.page.sources import Source, sources

MAX_WAIVERS = 49
MAX_SHOWN = 40


@pytest.fixture(scope="module")
def files():
    return {source.path: source for source in sources()}


@pytest.fixture(scope="module", params=["syntax", "ruff"])
def checked(request, files):
    """Rules and the places that do not follow them."""
    if request.param == "ruff":
        pytest.importorskip("ruff", reason="needs the extra 'lint'")
        return set(RUFF_RULES), ruff_findings(files)
    places = [finding for source in files.values() for finding in findings(source)]
    return {*MECHANICAL, *JUDGED}, places


def test_files_follow_the_rules(checked):
    _, places = checked
    exceptions = listed()
    new = [place for place in places if place.rule not in exceptions.get(place.path, ())]
    shown = "\n".join(map(str, new[:MAX_SHOWN]))
    assert not new, f"{len(new)} places do not follow the rules of CONTRIBUTING.md:\n{shown}"


def test_files_that_follow_a_rule_are_off_its_list(checked):
    rules, places = checked
    found = by_file(places)
    done = {
        path: sorted((listed_rules & rules) - found.get(path, set()))
        for path, listed_rules in listed().items()
    }
    done = {path: off for path, off in done.items() if off}
    assert not done, f"take these off the lists (python -m tests.page): {done}"


def test_lists_name_rules_that_exist():
    known = {*RUFF_RULES, *MECHANICAL, *JUDGED}
    assert {rule for rules in listed().values() for rule in rules} <= known


def test_waivers_are_few_and_give_their_reason(files):
    waivers = {
        f"{source.path}:{line}": reason
        for source in files.values()
        for line, reason in source.waivers.items()
    }
    assert len(waivers) <= MAX_WAIVERS
    assert [place for place, reason in waivers.items() if len(reason.split()) < 2] == []


@pytest.mark.parametrize(
    ("rule", "wrong", "right"),
    [
        ("tuple", "a, b = x, y", "a, b = b, a"),
        ("tuple", "self.a, self.b = 1, 2", "a, b = f()"),
        ("rebound", "A = 1\nB = A\nA = 2", "A = 1\nB = A\nC = 2"),
        ("generator", "a, b = (f(x) for x in y)", "a, b = map(f, y)"),
        ("positional", "Point(1, 2, 3, 4)", "Point(1, 2, 3)"),
        ("positional", "Point(1, 2, 3, 4, name='P')", "point(1, 2, 3, 4)"),
        ("splat", "Point(*values)", "point(*values)"),
        ("splat", "Point(**values)", "Point(x=1)"),
        ("conditional", "a if x else b if y else c", "a if (b if y else c) else x"),
        ("f-string", "f'{f\"{a}\"}'", "f'{a}' f'{b}'"),
        ("f-string", "f'{a if b else c}'", "f'{f(a)}'"),
        ("f-string", "f'{sum(a for a in b)}'", "f'{a:.{digits}f}'"),
        ("f-string", "f'{a:{1 if b else 2}}'", "f'{a:{b}}'"),
        ("unformatted", "a = 1  # fmt: skip", "a = 1  # format"),
        ("arguments", "def f(a, b, c, d, e, g): ...", "def f(self, a, b, c, d, e): ..."),
        ("arguments", "def _f(a, b, c, d, e, g, h, i, j): ...", "def _f(a, b, c, d, e, g): ..."),
        ("dense", f"def f(): return {' or '.join('abcdefghijklmnop')}", "def f(): return a or b"),
        ("sections", "def f(a: Array) -> None: 'Sum.'", "def _f(a: Array) -> None: 'Sum.'"),
        ("sections", "def f() -> Array: 'Sum.'", "def f() -> float: 'Sum.'"),
        (
            "sections",
            "def f() -> Array:\n '''Sum.\n\n Returns: 1\n '''",
            "def f() -> Array:\n '''Sum.\n\n Returns\n -------\n 1\n '''",
        ),
        (
            "parameters",
            "def f(a, b):\n '''Sum.\n\n Parameters\n ----------\n a : left\n '''",
            "def f(a, b):\n '''Sum.\n\n Parameters\n ----------\n a, b : sides\n '''",
        ),
    ],
)
def test_rules_know_right_from_wrong(rule, wrong, right):
    assert rule in {place.rule for place in findings(Source(path="a.py", text=wrong))}
    assert rule not in {place.rule for place in findings(Source(path="a.py", text=right))}


def test_a_waiver_holds_for_its_line():
    text = "a, b = x, y  # page: as the standard prints them\nc, d = x, y\n"
    assert [place.line for place in findings(Source(path="a.py", text=text))] == [2]


def test_lists_only_get_shorter(tmp_path):
    write({"src/myomorph/core/a.py": {"dense", "D205"}, "tests/b.py": {"D401"}}, tmp_path)
    (tmp_path / "tests.txt").write_text(
        "<<<<<<< ours\ntests/b.py: D401\n=======\ntests/b.py: D205 D401\n>>>>>>> theirs\n"
    )
    found = {"src/myomorph/core/a.py": {"D205", "C901"}, "tests/c.py": {"D401"}}
    write(still(listed(tmp_path), found), tmp_path)
    assert listed(tmp_path) == {"src/myomorph/core/a.py": {"D205"}}
    assert [path.name for path in tmp_path.iterdir()] == ["core.txt"]

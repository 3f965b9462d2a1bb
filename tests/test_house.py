"""The house does not grow: each count is at most its limit, and a limit only falls."""

from __future__ import annotations

import pytest
from benchmarks.house import CHECKOUT, checkout_texts, count

LIMITS = {
    ("lines", "src"): 122_488,
    ("lines", "benchmarks"): 26_694,
    ("words", "documentation"): 99_686,
    ("vague", "src"): 6.5,
}


@pytest.fixture(scope="module")
def counts() -> dict[tuple[str, str], float]:
    return {(row["what"], row["where"]): row["number"] for row in count(checkout_texts(CHECKOUT))}


@pytest.mark.parametrize("key", LIMITS, ids=" of ".join)
def test_a_count_is_within_its_limit(counts, key):
    assert counts[key] <= LIMITS[key]


def test_what_is_counted():
    texts = {
        "src/myomorph/rigid/a.py": "def f(one, b):\n    b = 1\n    for k in b:\n        pass\n",
        "src/myomorph/cli.py": "a = 1\n",
        "tests/test_a.py": "one = 1\n",
        "docs_build/a.py": "one = 1\n",
        "docs/a.md": "Two words.\n",
        "docs/references.md": "One, two, three\n",
        "README.md": "One\n",
    }
    assert {(row["what"], row["where"]): row["number"] for row in count(texts.items())} == {
        ("lines", "src"): 5,
        ("lines", "src/rigid"): 4,
        ("lines", "src/package"): 1,
        ("lines", "tests"): 1,
        ("words", "documentation"): 3,
        ("words", "docs"): 2,
        ("words", "pages at the top"): 1,
        ("words", "references"): 3,
        ("vague", "src"): 400,
        ("vague", "src/rigid"): 500,
        ("vague", "src/package"): 0,
    }

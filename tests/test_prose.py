"""Pages of results hold no number that no command measures.

The documentation stays readable in an afternoon.
"""

from __future__ import annotations

import pytest
from docs_build.examples import DOCS
from docs_build.prose import numbers_beside_results, numbers_of

PAGES = [
    *sorted((DOCS / "validation").glob("*.md")),
    DOCS / "performance.md",
    DOCS / "shortfalls.md",
]
GUIDES = [
    page
    for page in sorted(DOCS.rglob("*.md"))
    if page.parent.name != "decisions" and page.name != "references.md"
]
"""Decisions are records of their date, and references hold numbers of pages."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_prose_of_results_holds_no_number(page):
    assert numbers_of(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", GUIDES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_sentences_that_point_to_results_leave_the_numbers_there(page):
    assert numbers_beside_results(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "text",
    [
        "The error was 3 mm.",
        "Ours is 1.2 times OpenSim's.",
        "In 97 of 100 runs it held.",
        "| row | 0.5 |",
        "- the least is 4e-5",
        "# 90 % of draws",
        "It takes half the time.",
        "This is twice as fast.",
        "Three times as many frames were found.",
        "They miss it by a third.",
        "[Table](a.csv) shows 5.",
    ],
)
def test_numbers_are_found(text):
    assert numbers_of(text)


def test_numbers_beside_results_are_found():
    text = (
        "Skin moves by 5 mm. The error is\n3 mm ([validation](validation/models.md)). Here is none."
    )
    assert numbers_beside_results(text) == [
        "The error is 3 mm ([validation](validation/models.md))."
    ]


@pytest.mark.parametrize(
    "text",
    [
        (
            "Against OpenSim 4.6 and MuJoCo 4.0, Rajagopal et al. 2016, by [D] eq. 3.12 and"
            " decision 7."
        ),
        "**Setup:** 60 draws,\n200 Hz.",
        "A femur. **Target:** 60 s.",
        "- **Published:** 0.89 body weights.",
        (
            "The error is {{ knee | default | total, mean }} body weights (`--draws 200`, gait2354,"
            " arm26.osim)."
        ),
        "```\n1.5\n```",
        "[Table](table_2.csv) of the third motion; x^2; the first half-space.",
    ],
)
def test_what_is_no_measured_number_may_stand(text):
    assert numbers_of(text) == []

"""The page on a morph prints its numbers, warnings first.

Its tables have a column for every cell.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from boxed_leg import FRONT, HALF, grown, leg, morph_of, muscle, with_muscle
from myomorph.bones.morph.checks.checks import check_morph
from myomorph.bones.report.morph_page import PageParts, morph_page
from myomorph.bones.report.tables import morphing_tables
from myomorph.core.model.provenance import Provenance, Source
from myomorph.lab.report.page.parts import Note, Section

MADE = Provenance(
    "morph",
    (Source("bone", "/home/me/bones/thigh.obj", "ab" * 32),),
    {"map": "ssd", "exponent": 4.0},
)


@pytest.fixture(scope="module")
def morph():
    source = leg()
    through = muscle("extensor", [("thigh", (HALF - 0.005, -0.1, 0.0)), *FRONT[1:]])
    morph = morph_of(source, grown(with_muscle(source, through), 1.1), 1.1)
    bones = {**morph.bones, "shank": replace(morph.bones["shank"], notes=("the <bone> is rough",))}
    return replace(
        morph, bones=bones, left_out={"popliteus": "the target has no counterpart of 'fibula'"}
    )


@pytest.fixture(scope="module")
def checks(morph):
    return check_morph(morph)


def text_of(page: str) -> str:
    plain = re.sub(r"<(style|script)[^>]*>.*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", plain))


def test_the_page_tells_numbers_and_warnings_first(morph, checks):
    page = morph_page(morph, checks, MADE, ("a file had no unit",))
    text = text_of(page)
    assert len(checks.warnings) >= 1
    for one in checks.warnings:
        assert one.text in text
    titles = re.findall(r"<h2>([^<]+)</h2>", page)
    assert titles[0] == "Warnings"
    assert titles[1:4] == ["Source and target", "Bones and their maps", "Moment arms"]
    worst = checks.penetrations[0]
    assert f"{1e3 * worst.increase:.2f} mm" in text
    assert "1.20" in text
    assert "the &lt;bone&gt; is rough" in page
    assert "<bone>" not in page
    assert "a file had no unit" in text
    assert "thigh.obj" in text
    assert "/home/me" not in page
    assert "exponent = 4" in text
    assert "the target has no counterpart of" in text
    assert page.count("<image") >= 6
    assert "http" not in re.sub(r'href="https://doi.org[^"]*"', "", page).replace(
        "http://www.w3.org", ""
    )


def test_a_title_notes_and_sections_of_ones_own_find_their_place(morph, checks):
    further = Section("errors", "Error against the truth", "None is known & more.")
    page = morph_page(
        morph,
        checks,
        MADE,
        parts=PageParts(
            title="Boxes",
            notes=(Note("simulated", "Made of boxes."),),
            further=(further,),
        ),
    )
    assert "<h1>Boxes</h1>" in page
    assert re.findall(r"<h2>([^<]+)</h2>", page)[1] == "Error against the truth"
    assert "Made of boxes." in page


def test_tables_have_a_name_for_every_column(morph, checks):
    tables = morphing_tables(morph, checks)
    assert {
        "bones.csv",
        "points.csv",
        "muscles.csv",
        "joints.csv",
        "masses.csv",
        "moment_arms.csv",
        "warnings.csv",
        "penetration.csv",
        "moment_arm_summary.csv",
        "not_transferred.csv",
    } == set(tables)
    for name, sheet in tables.items():
        assert {len(row) for row in sheet.rows} == {len(sheet.head)}, name
    rows = tables["moment_arms.csv"].rows
    values = np.array([row[3:] for row in rows if row[2] == "flexor"], dtype=np.float64)
    np.testing.assert_allclose(values[:, 3], 1.1 * values[:, 2], rtol=1e-9)
    assert len(tables["points.csv"].rows) == len(morph.points)


def test_names_of_muscles_with_a_warning_are_marked(morph, checks):
    source = leg()
    wrong = muscle("extensor", [(body, (-x, y, z)) for body, (x, y, z) in FRONT])
    flipped = morph_of(source, with_muscle(source, wrong))
    page = morph_page(flipped, check_morph(flipped), MADE)
    assert re.search(r'class="limit start"[^>]*>extensor<', page)
    assert not re.search(r'class="limit start"[^>]*>flexor<', page)


def test_nothing_wrong_is_said_so():
    source = leg()
    fine = morph_of(source, source)
    text = text_of(morph_page(fine, check_morph(fine), MADE))
    assert "No warning compared with the source" in text


def test_a_skeleton_without_muscles_has_a_page():
    source = replace(leg(), muscles=())
    bare = morph_of(source, source)
    checks = check_morph(bare)
    assert checks.arms == ()
    assert checks.penetrations == ()
    page = morph_page(bare, checks, MADE)
    assert "Moment arms</h2>" not in page
    assert "thigh" in page

"""Sizes of errors that steps of a study found: which counts, and what draws make of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadFile
from myomorph.lab.study.inputs.error_size_tables import (
    HEAD,
    TABLE,
    read_error_sizes,
    tables_beside,
    write_error_sizes,
)
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import NOTHING, ItemSize, Sources, source_sizes

DRAWS = 400


def test_what_is_found_of_an_item_is_drawn_of_it_alone():
    found = NOTHING.with_step("personalize", [ItemSize("fiber_length", "soleus_r", 0.02)])
    draws = [
        Draw(number=k, sources=Sources(), normals=Normals(DRAWS), found=found) for k in range(DRAWS)
    ]
    sd = [
        np.std([one.of("fiber_length", name)[0] for one in draws])
        for name in ("soleus_r", "gasmed_r")
    ]
    np.testing.assert_allclose(sd, (0.02, Sources().fiber_length), rtol=0.02)
    left_out = Draw(
        number=0, sources=replace(Sources(), fiber_length=0.0), normals=Normals(DRAWS), found=found
    )
    assert left_out.of("fiber_length", "soleus_r")[0] == 0.0


def test_items_that_share_a_size_err_together():
    sizes = [
        ItemSize(source="strength", item=name, size=0.1, shared="knee_angle +")
        for name in ("vasmed_r", "vaslat_r")
    ]
    draw = Draw(
        number=3,
        sources=Sources(),
        normals=Normals(DRAWS),
        found=NOTHING.with_step("personalize", sizes),
    )
    assert draw.factor("strength", "vasmed_r") == draw.factor("strength", "vaslat_r")


def test_the_later_step_counts_and_a_stated_size_before_all():
    refined = NOTHING.with_step(
        "refine", [ItemSize("segment_mass", name, 0.07) for name in ("femur_r", "pelvis")]
    )
    both = refined.with_step("identify", [ItemSize("segment_mass", "femur_r", 0.03)])
    assert both.of("segment_mass", "femur_r").size == 0.03
    assert both.of("segment_mass", "pelvis") is None
    rows = {one.source: one for one in source_sizes(Sources(), both)}
    assert (rows["segment_mass"].origin, rows["segment_mass"].items, rows["inertia"].origin) == (
        "identify",
        1,
        "usual",
    )
    stated = Sources(segment_mass=0.05)
    assert both.beside(stated).items == {}
    rows = {one.source: one for one in source_sizes(stated, both.beside(stated))}
    assert (rows["segment_mass"].origin, rows["segment_mass"].size) == ("stated", 0.05)


def test_tables_beside_a_model_are_read_as_they_were_written(tmp_path):
    sizes = [
        ItemSize(source="strength", item="soleus_r", size=0.125, shared="ankle -"),
        ItemSize("fiber_length", "soleus_r", 0.05),
    ]
    (tmp_path / "person_personalization").mkdir()
    write_error_sizes(tmp_path / "person_personalization", "personalize", sizes)
    paths = tables_beside(tmp_path / "person.osim")
    found = read_error_sizes([*paths, tmp_path / "other" / TABLE])
    assert [found.of(one.source, one.item) for one in sizes] == sizes
    assert found.origins["strength"] == "personalize"


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ("personalize,strenght,soleus_r,0.1,", "'strenght'.*no source"),
        ("personalize,strength,soleus_r,-0.1,", "-0.1"),
        ("personalize,strength,soleus_r,wide,", "line 2 holds no size"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path, row, text):
    (tmp_path / TABLE).write_text(f"{','.join(HEAD)}\n{row}\n")
    with pytest.raises(BadFile, match=text):
        read_error_sizes([tmp_path / TABLE])

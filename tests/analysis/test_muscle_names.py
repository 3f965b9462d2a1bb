"""Plain names of muscles."""

from __future__ import annotations

import pytest

from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.muscle_names import muscle_words, plain_name
from myomorph.lab.analyze.generic_model import generic_model


@pytest.mark.parametrize(
    ("muscle", "words"),
    [
        ("soleus_r", "soleus, right"),
        ("glmax2_l", "gluteus maximus 2, left"),
        ("glut_med1_r", "gluteus medius 1, right"),
        ("add_mag3_r", "adductor magnus 3, right"),
        ("bifemlh_l", "biceps femoris, long head, left"),
        ("DELT2_r", "deltoid 2, right"),
        ("nobody_knows_it_r", "nobody_knows_it_r"),
    ],
)
def test_a_muscle_has_its_name_in_words(muscle: str, words: str) -> None:
    assert muscle_words(muscle) == words


def test_a_group_is_that_of_the_longest_beginning() -> None:
    assert plain_name("bifemlh_r") == "hamstrings"
    assert plain_name("pect_r") == "adductors"
    assert plain_name("PectoralisMinor_r") == "pectoralis"
    assert plain_name("peri_l") == "piriformis"
    assert plain_name("semi_cap_sklthx") == "semispinalis"


def test_every_muscle_of_the_generic_model_is_known() -> None:
    model, _ = generic_model({})
    for name in model.muscle_names:
        assert muscle_words(name) != name
        assert muscle_words(name).endswith(split_side(name)[1])

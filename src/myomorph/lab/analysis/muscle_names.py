"""Plain names of muscles, by how models of the OpenSim and MyoSim families spell them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.sides import split_side

PART = re.compile(r"(?P<base>.*?[a-z])_?(?P<part>\d+)")
"""A name of a muscle that has parts, as "glmax2"."""


@dataclass(frozen=True, kw_only=True)
class MuscleNames:
    """The table of plain names.

    Attributes
    ----------
    names : of muscles, by their spelling without side and number, in small letters
    groups : what people call them together, by the beginnings of their names
    """

    names: Mapping[str, str]
    groups: Mapping[str, str]


@cache
def _table() -> MuscleNames:
    text = (files("myomorph.lab.analysis") / "muscle_names.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    return MuscleNames(names=FrozenMap(table["names"]), groups=FrozenMap(table["groups"]))


def plain_name(muscle: str) -> str:
    """Say what people call a muscle, or the group that it is of; "" where that is not known."""
    base = split_side(muscle.rsplit("__", 1)[-1])[0].lower()
    groups = _table().groups
    fitting = (start for start in groups if base.startswith(start))
    longest = max(fitting, key=len, default="")
    return groups.get(longest, "")


def muscle_words(muscle: str) -> str:
    """Return a muscle with its side in words: "soleus, right" of `soleus_r`.

    Numbers of parts stay ("gluteus maximus 2, right"); a name that is not in the table stays as it
    is.
    """
    base, side = split_side(muscle)
    spelled = base.lower()
    names = _table().names
    words = names.get(spelled, "")
    found = PART.fullmatch(spelled)
    if not words and found is not None and found["base"] in names:
        words = f"{names[found['base']]} {found['part']}"
    if not words:
        return muscle
    return f"{words}, {side}" if side else words

"""Muscles that analyses of motion name, and how models spell them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from myomorph.analysis.selection import MAJOR_MUSCLES, Pair
from myomorph.model.sides import split_side

_UPPER = (
    ("Deltoid, anterior", r"(delt(oid)?_?(ant(erior)?|clav\w*|1)|delt1)"),
    ("Deltoid, posterior", r"(delt(oid)?_?(post(erior)?|3)|delt3|delt(oideus)?_?scap(ula)?_?(post)?\w*)"),
    ("Biceps brachii, long head", r"(bic_?(brachii_?)?l(ong|h)|biclong|bic_l|biceps_?(lh|long))"),
    ("Triceps brachii, lateral head", r"(tri_?lat|triceps_?lat(eral)?|tri_?lt)"),
    ("Brachioradialis", r"(brd|brachiorad(ialis)?|brachrad)"),
    ("Trapezius", r"(trap(ezius)?(_\w+)?|trp\d*)"),
    ("Latissimus dorsi", r"(lat(issimus)?_?dorsi\w*|ld_\w+|lat\d)"),
    ("External oblique", r"(ext_?obl\w*|eo_?\d+|e[o0]_r\d+|extobl)"),
    ("Erector spinae", r"(erc?_?spn\w*|erector_?spinae\w*|il_[lr]\d+|ltp[tl]_[rtl]\d+)"),
)

MUSCLES: Mapping[str, str] = MappingProxyType({**dict(_UPPER), **dict(MAJOR_MUSCLES)})
"""Name in print to the spellings of models of the leg, the arm, the trunk and the whole body."""


def named_muscles(
    names: Sequence[str], wanted: Sequence[str], prefix: str = ""
) -> tuple[tuple[Pair, ...], tuple[str, ...]]:
    """The wanted muscles that a model has, right and left together, and those that it lacks.

    Parts of one muscle are members of one pair.

    Parameters
    ----------
    names : of the model's muscles
    wanted : of `MUSCLES`
    prefix : what the names of one subject begin with
    """
    bare = {name: split_side(name.removeprefix(prefix).rsplit("__", 1)[-1]) for name in names}
    found, lacking = [], []
    for label in wanted:
        members: dict[str, tuple[str, ...]] = {}
        for name, (base, side) in bare.items():
            if re.fullmatch(MUSCLES[label], base, re.IGNORECASE):
                members[side] = (*members.get(side, ()), name)
        if "left" in members and "" in members and "right" not in members:
            members["right"] = members.pop("")
        if members:
            found.append(Pair(label, {side: members[side] for side in ("right", "left", "") if side in members}))
        else:
            lacking.append(label)
    return tuple(found), tuple(lacking)

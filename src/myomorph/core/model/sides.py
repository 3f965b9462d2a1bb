"""Right and left, by names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from myomorph.core.model.frozen_map import FrozenMap

_SUFFIX = re.compile(r"^(.*?)[_. -](r|l|right|left)$", re.IGNORECASE)
_PREFIX = re.compile(r"^(r|l|right|left)[_. -](.+)$", re.IGNORECASE)
# As RFemur, and RBPhalange3 of the hind foot; a prefix may be the name of an animal or of a subject
_LETTER = re.compile(r"^(.*(?:__|:))?([RL])([A-Z]{1,2}[a-z].*)$")
_WORD = re.compile(
    r"(?:^|(?<=[_. -]))(right|left|Right|Left|RIGHT|LEFT)(?=$|[_. -]|[A-Z0-9])|(Right|Left)$"
)
_CAPITALS = re.compile(r"^[RL][A-Z0-9]{2,}$")
_OTHER = {"right": "left", "left": "right"}
_WORDS = {
    "right": "left",
    "Right": "Left",
    "RIGHT": "LEFT",
    "left": "right",
    "Left": "Right",
    "LEFT": "RIGHT",
}
_OTHER_LETTER = {"R": "L", "L": "R", "r": "l", "l": "r"}


def split_side(name: str) -> tuple[str, str]:
    """Split a name into base and side: `("hip_flexion", "right")` for `hip_flexion_r`."""
    for pattern, base, side in ((_SUFFIX, 1, 2), (_PREFIX, 2, 1)):
        match = pattern.match(name)
        if match:
            return match[base], "right" if match[side][0] in "rR" else "left"
    match = _LETTER.match(name)
    if match:
        return (match[1] or "") + match[3], "right" if match[2] == "R" else "left"
    return name, ""


def mirror_names(names: Iterable[str]) -> Mapping[str, str]:
    """Find the counterparts of names on the other side, as far as they are among the names.

    Names are those of bodies, joints, coordinates or markers: `femur_r` and `femur_l`, `RASI` and
    `LASI`, `Abd_R_L1` and `Abd_L_L1`.
    """
    all_names = tuple(names)
    sided = {split_side(name): name for name in all_names}
    counterparts: dict[str, str] = {}
    for name in all_names:
        base, side = split_side(name)
        candidates = []
        if side and (base, _OTHER[side]) in sided:
            candidates.append(sided[base, _OTHER[side]])
        for i, letter in enumerate(name):
            if letter in _OTHER_LETTER and _stands_apart(name, i):
                candidates.append(name[:i] + _OTHER_LETTER[letter] + name[i + 1 :])
        match = next((candidate for candidate in candidates if candidate in sided.values()), "")
        if match:
            counterparts[name] = match
    return FrozenMap(counterparts)


def other_side(name: str, *, capitals: bool = False) -> str:
    """Write a name's counterpart on the other side: `Thigh_l` for `Thigh_r`.

    Parameters
    ----------
    name : with or without a side
    capitals : whether `RASI` has a side too, as markers do; `RIBS` is then taken for one as well

    Returns
    -------
    "" where the name has no side
    """
    apart = [
        i
        for i, letter in enumerate(name)
        if letter in _OTHER_LETTER and _stands_apart(name, i, whole=True)
    ]
    if apart:
        return "".join(
            _OTHER_LETTER[letter] if i in apart else letter for i, letter in enumerate(name)
        )
    word = _WORD.search(name)
    if word:
        return name[: word.start()] + _WORDS[word[0]] + name[word.end() :]
    letter_first = _LETTER.match(name)
    if letter_first:
        i = letter_first.start(2)
        return name[:i] + _OTHER_LETTER[name[i]] + name[i + 1 :]
    return _OTHER_LETTER[name[0]] + name[1:] if capitals and _CAPITALS.match(name) else ""


def _stands_apart(name: str, i: int, *, whole: bool = False) -> bool:
    """Whether a letter may be the side: it begins the name, or is between underscores or dots.

    With `whole` the letter that begins the name must be followed by one of these too.
    """
    after = i + 1 == len(name) or name[i + 1] in "_. -"
    return (i == 0 and (after or not whole)) or (i > 0 and name[i - 1] in "_. -" and after)

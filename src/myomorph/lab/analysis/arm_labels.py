"""Labels of markers on arms, whatever protocols know of them."""

from __future__ import annotations

import re

from myomorph.core.motion.protocols import Recognized

ARM_WORDS = re.compile(
    r"fore_?arm|(^|[^a-z])l?arm|epic|styl|wrist|elbow|humer|clav|scap|acro|glove|olecr|(^|[_."
    r" ])(hand|finger)"
)
"""Parts of labels on arms, in small letters."""
ARM_SHORT = frozenset(
    (
        "ij",
        "px",
        "sc",
        "ac",
        "aa",
        "ts",
        "ai",
        "pc",
        "gu",
        "gh",
        "el",
        "em",
        "epl",
        "epm",
        "rs",
        "us",
    )
)
"""Labels of the recommendation of the International Society of Biomechanics for arms (Wu et al.
2005).
"""
ARM_SEGMENTS = frozenset(("upper_arm", "forearm", "hand"))
LEG_SEGMENTS = frozenset(("thigh", "shank", "foot"))
MIN_ARM = 4  # So many labels on arms, none on a leg, make a recording of an arm, ...
MIN_SHARE = 0.2  # ... and so large a share of all labels.


def is_arm(recognized: Recognized) -> bool:
    """Whether markers are those of an arm: several labels on one, none on a leg."""
    segments = [site.segment for site in recognized.sites.values()]
    if any(segment in LEG_SEGMENTS for segment in segments):
        return False
    known = sum(segment in ARM_SEGMENTS for segment in segments)
    plain = [
        name.split(":")[-1].strip().lower() for name in (*recognized.unknown, *recognized.sites)
    ]
    named = sum(ARM_WORDS.search(name) is not None for name in plain)
    short = sum(name in ARM_SHORT for name in plain)
    return max(known, named, short) >= max(MIN_ARM, MIN_SHARE * len(plain))

"""What markers are that do not show legs, in one line: numbered, of an arm, clusters; and which
option helps.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from myomorph.core.motion.protocols import Recognized

TABLE = (
    "say what they lie on in a table (--protocol TABLE.toml), or give a model with such markers"
    " (--model)"
)
# A label that only counts: `Point 12`, `unnamed_3`, `M7`.
NUMBERED = re.compile(r"^(?P<stem>\D*?)[\s_.-]*\d+$")
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
MOSTLY = 0.8  # Share of labels that makes all of them of a kind.


def unfit_markers(recognized: Recognized, lacking: Sequence[str]) -> str:
    """What keeps a recording's markers from moving the generic model, and the option that helps.
    `lacking`: segments that the generic model needs and no label lies on.
    """
    unknown = recognized.unknown
    labels = (*recognized.sites, *unknown)
    some = ", ".join(f"'{name}'" for name in unknown[:5]) + (", ..." if len(unknown) > 5 else "")
    if is_arm(recognized):
        return (
            f"the markers are those of an arm, none known on {' and '.join(lacking)}: {TABLE}"
            + (f"; not known: {some}" if unknown else "")
        )
    stems = {match["stem"].lower() for match in map(NUMBERED.match, unknown) if match is not None}
    counted = sum(NUMBERED.match(name) is not None for name in unknown)
    if not recognized.sites and counted >= MOSTLY * len(labels) and len(stems) <= 2:
        return f"its {len(labels)} markers are numbered, not named ({some}): {TABLE}"
    count = f"{len(recognized.sites)} of {len(labels)} labels are those of a marker protocol"
    where = f"none on {' and '.join(lacking) or 'enough landmarks'}"
    bony = any(site.kind != "skin" for site in recognized.sites.values())
    kind = (
        ""
        if bony or not recognized.sites
        else ", all of them in clusters, which lie on no landmark"
    )
    return f"{count}{kind}, {where}" + (f" (not known: {some})" if unknown else "") + f"; {TABLE}"


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

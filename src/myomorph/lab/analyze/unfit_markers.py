"""Markers that do not show legs, in one line: numbered, of an arm, clusters; and what helps."""

from __future__ import annotations

import re
from collections.abc import Sequence

from myomorph.core.motion.protocols import Recognized
from myomorph.lab.analysis.arm_labels import is_arm

TABLE = (
    "state their landmarks in a table (--protocol TABLE.toml), or give a model with such markers"
    " (--model)"
)
MIN_MARKERS = 6  # Fewer markers on a body's bones say too little of a motion.
NEEDED = ("pelvis", "thigh", "shank")  # Segments that must have a marker, ...
OF_ARMS = ("trunk", "upper_arm", "forearm")  # ... and where there are markers of arms alone.
# A label that only counts: `Point 12`, `unnamed_3`, `M7`.
NUMBERED = re.compile(r"^(?P<stem>\D*?)[\s_.-]*\d+$")
MOSTLY = 0.8  # Share of labels that makes all of them of a kind.


def missing_segments(recognized: Recognized) -> tuple[str, ...]:
    """Name the segments that the generic model needs and no label lies on.

    Parameters
    ----------
    recognized : labels of the recording
    """
    segments = {site.segment for site in recognized.sites.values()}
    needed = OF_ARMS if is_arm(recognized) else NEEDED
    return tuple(name for name in needed if name not in segments)


def shows_body(recognized: Recognized) -> bool:
    """Whether a recording's markers move the generic model."""
    return len(recognized.sites) >= MIN_MARKERS and not missing_segments(recognized)


def unfit_markers(recognized: Recognized, lacking: Sequence[str]) -> str:
    """Say what keeps a recording's markers from moving the generic model, and what helps.

    Parameters
    ----------
    recognized : labels of the recording
    lacking : segments that the generic model needs and no label lies on
    """
    unknown = recognized.unknown
    labels = (*recognized.sites, *unknown)
    some = ", ".join(f"'{name}'" for name in unknown[:5]) + (", ..." if len(unknown) > 5 else "")
    if is_arm(recognized):
        return (
            f"the markers are those of an arm, no known label on {' and '.join(lacking)}: {TABLE}"
            + (f"; not known: {some}" if unknown else "")
        )
    if not recognized.sites and _are_numbered(unknown):
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


def _are_numbered(labels: Sequence[str]) -> bool:
    """Whether most labels only count, from one or two stems."""
    matches = [match for match in map(NUMBERED.match, labels) if match is not None]
    stems = {match["stem"].lower() for match in matches}
    return len(matches) >= MOSTLY * len(labels) and len(stems) <= 2

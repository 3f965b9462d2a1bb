"""Bony markers placed asymmetrically, found before a calibration moves a model after them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MARKERS
from myomorph.core.model.findings import Finding
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Markers
from myomorph.core.model.sides import mirror_names
from myomorph.core.motion.protocols import Site, recognize

APART = 0.03
"""Difference of a distance on both sides from which a marker is misplaced, on a human body [m]; set
with recordings of other laboratories than those of
`benchmarks/accuracy/faults/unseen_marker_faults.py`.
"""

USUAL = 3.0  # That difference is at least so many times the median of the recording
STEADY = 0.015
"""Largest standard deviation over frames of a distance between two points of bone that skin and
joints leave [m].
"""

ONE_BODY = ("pelvis", "trunk")  # Segments whose right and left markers lie on one body
BESIDE = (frozenset(("thigh", "shank")), frozenset(("shank", "foot")))
"""Segments whose markers near the joint between them keep their distances, where `STEADY` says so.
"""

MAX_COUNT = 4
SAMPLES = 200


class _Link(NamedTuple):
    """Two markers of one side, and the two of the other.

    Attributes
    ----------
    markers, others : names on one side and on the other
    length : distance of the first two [m]
    difference : by how much they are farther apart than the others [m]
    """

    markers: tuple[str, str]
    others: tuple[str, str]
    length: float
    difference: float


def side_findings(markers: Markers, names: Sequence[str], unit: float = 1.0) -> Iterator[Finding]:
    """Find pairs of bony markers of which one is placed asymmetrically.

    Distances between points of the same bone, or of neighboring ones where they keep them, are
    compared on both sides; this needs no model. Points of the skin are not looked at: where they
    lie is free, and a calibration finds it.

    Parameters
    ----------
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    names : of the markers to look at
    unit : what stands for one metre, see `length_unit` [m]

    Yields
    ------
    a finding for each pair, the worst first
    """
    links = _links(markers, names)
    if not links:
        return
    usual = float(np.median([abs(link.difference) for link in links]))
    limit = max(APART * unit, USUAL * usual)
    for _ in range(MAX_COUNT):
        worst = max(links, key=lambda link: abs(link.difference), default=None)
        if worst is None or abs(worst.difference) < limit:
            return
        suspects = _suspects(worst, links)
        yield Finding("displaced marker", suspects[0][0], _text(worst, suspects, usual))
        # What lies elsewhere says nothing of the others.
        wrong = {name for pair in suspects for name in pair}
        links = [link for link in links if not wrong & {*link.markers, *link.others}]


def _links(markers: Markers, names: Sequence[str]) -> list[_Link]:
    """Compare distances of bony markers on both sides that stay the same in all frames.

    Parameters
    ----------
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    names : of the markers to look at

    Returns
    -------
    links whose standard deviations over frames are below `STEADY` on both sides, each pair once
    """
    sites = {name: site for name, site in recognize(markers.names).sites.items() if name in names}
    bony = {name: site for name, site in sites.items() if site.kind == "bony"}
    partner = {
        name: other
        for name, other in mirror_names(bony).items()
        if bony[other].key == bony[name].key
    }
    rows = np.unique(
        np.linspace(0, max(len(markers) - 1, 0), min(SAMPLES, len(markers))).astype(int)
    )
    places = dict(zip(markers.names, np.moveaxis(markers.values[rows], 1, 0), strict=True))
    links: dict[frozenset[frozenset[str]], _Link] = {}
    for pair in _comparable(bony, partner):
        mirrored = (partner[pair[0]], partner.get(pair[1], pair[1]))
        length, spread = _distance(places[pair[0]], places[pair[1]])
        other_length, other_spread = _distance(places[mirrored[0]], places[mirrored[1]])
        if spread < STEADY and other_spread < STEADY:
            link = _Link(
                markers=pair, others=mirrored, length=length, difference=length - other_length
            )
            links.setdefault(frozenset((frozenset(pair), frozenset(mirrored))), link)
    return list(links.values())


def _comparable(bony: Mapping[str, Site], partner: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield pairs of a marker on the right and another one that have two on the other side.

    Parameters
    ----------
    bony : what markers on bone lie on, by name
    partner : the marker on the other side, by name
    """
    for marker in (name for name in partner if bony[name].side == "right"):
        for other, site in bony.items():
            alone = bool(site.side) and other not in partner
            same = other in (marker, partner[marker])
            if not same and not alone and _rigid(bony[marker], site):
                yield marker, other


def _rigid(site: Site, other: Site) -> bool:
    """Return whether a distance may be the same in all frames."""
    if site.segment == other.segment:
        return site.side == other.side or not other.side or site.segment in ONE_BODY
    return site.side == other.side and frozenset((site.segment, other.segment)) in BESIDE


def _distance(first: Array, other: Array) -> tuple[float, float]:
    """Measure the distance of two points over time.

    Parameters
    ----------
    first, other : (frames, 3) [m], NaN where unseen

    Returns
    -------
    median and standard deviation [m]; nan and infinite where seen in less than a tenth of the
    frames
    """
    apart = np.linalg.norm(first - other, axis=1)
    known = apart[np.isfinite(apart)]
    return (
        (float(np.median(known)), float(np.std(known)))
        if len(known) > 0.1 * len(apart)
        else (np.nan, np.inf)
    )


def _suspects(worst: _Link, links: Sequence[_Link]) -> list[tuple[str, ...]]:
    """Find the markers of which one is placed asymmetrically.

    Of a link that differs: the pair, or the one in the middle, whose other distances differ more.
    """
    pairs = [tuple(dict.fromkeys(ends)) for ends in zip(worst.markers, worst.others, strict=True)]
    differing = []
    for pair, away in zip(pairs, reversed(pairs), strict=True):
        differences = [
            abs(link.difference) for link in links if _has(link, pair) and not _has(link, away)
        ]
        differing.append(float(np.median(differences)) if differences else np.nan)
    if np.isnan(differing).all():
        return pairs
    # One without other distances is where it belongs if those of the other differ more than half as
    # much.
    likely = np.where(np.isnan(differing), 0.5 * abs(worst.difference), differing)
    return [pairs[int(np.argmax(likely))]]


def _has(link: _Link, names: tuple[str, ...]) -> bool:
    """Return whether a link has one of these markers."""
    return bool({*link.markers, *link.others} & {*names})


def _text(worst: _Link, suspects: Sequence[tuple[str, ...]], usual: float) -> Message:
    """Describe an asymmetry for the user.

    Parameters
    ----------
    worst : the link that differs most
    suspects : markers of which one is placed asymmetrically
    usual : median of the differences [m]
    """
    named = " or ".join(f"'{name}'" for pair in suspects for name in pair)
    first, other = worst.markers
    a, b = worst.others
    lies = f"marker {named} lies elsewhere than on the other side"
    if len(suspects) == 1 and len(suspects[0]) == 1:
        lies = f"marker {named} lies off the middle"
    return MARKERS.message(
        f"{lies}: '{first}' and '{other}' are {100 * worst.length:.1f} cm apart, '{a}' and '{b}'"
        f" {100 * (worst.length - worst.difference):.1f} cm (the median of such differences is"
        f" {100 * usual:.1f} cm): was it misplaced? A calibration moves the model's marker after"
        " it, and angles with it; leave it out (an empty name in --labels) where it was",
        size=100.0 * abs(worst.difference),
    )

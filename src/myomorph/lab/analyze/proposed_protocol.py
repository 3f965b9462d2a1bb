"""Proposals of what unknown markers of somebody who stands lie on, for the user to check."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.measurements import default_markers
from myomorph.core.motion.protocols import SIDES, Site, protocols
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.lab.analyze.generic_model import generic_model

LANDMARKS = (
    "pelvis.asis",
    "pelvis.psis",
    "pelvis.sacrum",
    "pelvis.crest",
    "thigh.trochanter",
    "thigh.lateral_epicondyle",
    "thigh.medial_epicondyle",
    "shank.fibula_head",
    "shank.tuberosity",
    "shank.lateral_malleolus",
    "shank.medial_malleolus",
    "foot.heel",
    "foot.mt1_head",
    "foot.mt2_head",
    "foot.mt5_head",
    "trunk.c7",
    "trunk.t10",
    "trunk.jugular_notch",
    "trunk.xiphoid",
    "trunk.acromion",
)
"""Where laboratories put markers; the others lie so near to these that geometry does not tell them
apart.
"""
SKIN = tuple(
    f"{part}.{place}"
    for part in ("thigh", "shank")
    for place in ("upper", "lateral", "front", "lower")
)
MIDLINE = ("sacrum", "c7", "t10", "jugular_notch", "xiphoid")
# Heights of bodies over that of the generic model that are tried.
SIZES = np.arange(0.6, 1.3, 0.08)
HEADINGS = np.radians(np.arange(0.0, 360.0, 15.0))
CAP = 0.10
"""Farther from every landmark, a marker is on an arm, on the head or on no body [m]; of a body as
tall as the model.
"""
# So far from where the model has it a landmark is offered [m]; of a body as tall as the model.
NEAR = 0.06
FOOT = 0.12  # Markers below this height are on feet [m]; of a body as tall as the model.
TRIED = 10
ROUNDS = 8
MIN_FIT = 6
PELVIS = 3
LEG = ("thigh", "shank", "foot")
"""Landmarks on the pelvis, and segments of either leg, without which nothing is offered."""


class Proposal(NamedTuple):
    """What a marker may lie on, and how far from there it is on the generic model [m]."""

    label: str
    site: Site
    distance: float


class _Fit(NamedTuple):
    """Markers on the model in its pose.

    Attributes
    ----------
    placed : (markers, 3) on the model [m]
    pose : (landmarks, 3) in the model's pose [m]
    size : height of the body over the model's
    markers, landmarks : (pairs,) numbers of markers, and of the landmarks that they have
    """

    placed: Array
    pose: Array
    size: float
    markers: Array
    landmarks: Array


def proposed_sites(markers: Markers) -> tuple[Proposal, ...]:
    """Propose what markers of somebody who stands lie on, by geometry.

    None where the places do not look like a pelvis and two legs.

    The generic model, as tall as the markers, is turned and bent to them, and each landmark goes to
    one marker at most. Whether somebody stands is not looked at.

    Parameters
    ----------
    markers : of a static trial [m], their names unknown
    """
    labels, places = _median_places(markers)
    sites = list(_candidates())
    names = [f"{site.side} {site.key}".strip() for site in sites]
    model, _ = generic_model(dict(zip(names, sites, strict=True)))
    standing = default_markers(model, names)
    bony = np.array([site.kind == "bony" for site in sites])
    ways = sorted(_ways(places, standing, bony), key=lambda way: way[0])[:TRIED]
    fits = [_fitted(model, names, bony, placed, size, standing) for _, placed, size in ways]
    fit = min(
        (fit for fit in fits if _is_body([sites[column] for column in fit.landmarks])),
        key=_misfit,
        default=None,
    )
    if fit is None:
        return ()
    apart = np.linalg.norm(fit.placed[:, None] - fit.pose[None], axis=2)
    bones = dict(zip(fit.markers.tolist(), fit.landmarks.tolist(), strict=True))
    skin = np.where(bony, np.inf, apart).argmin(axis=1)
    of_rows = ((row, bones.get(row, int(skin[row]))) for row in range(len(labels)))
    return tuple(
        Proposal(labels[row], sites[column], fit.size * float(apart[row, column]))
        for row, column in of_rows
        if row in bones or apart[row, column] < CAP
    )


def proposed_table(proposals: Sequence[Proposal], source: str) -> str:
    """Write a table of `--protocol` with every proposal on a line.

    The line says what it means and how far off it is.
    """
    lines = [
        (
            f"# What markers of {source} may lie on, by geometry. Check each line; correct or"
            " delete what is wrong."
        ),
        "[protocols.proposed]",
        'title = "Proposed by geometry, then checked"',
        f'source = "{source}"',
        "[protocols.proposed.labels]",
    ]
    sides = {(proposal.site.key, proposal.site.side) for proposal in proposals}
    for label, site, distance in proposals:
        key = f"{site.side} {site.key}".strip()
        alone = bool(site.side) and not {(site.key, side) for side in SIDES.values()} <= sides
        note = "; NONE ON THE OTHER SIDE" if alone else ""
        lines.append(
            f'"{label}" = "{key}"  # {site}, {100.0 * distance:.0f} cm from there on the generic'
            " model"
            f"{note}"
        )
    return "\n".join(lines) + "\n"


def _median_places(markers: Markers) -> tuple[list[str], Array]:
    """Labels that are seen, and their median places (markers, 3) [m]."""
    seen = [name for name in markers.names if np.isfinite(markers[name]).all(axis=1).any()]
    return seen, np.array([np.nanmedian(markers[name], axis=0) for name in seen]).reshape(-1, 3)


def _candidates() -> Iterator[Site]:
    known = protocols().landmarks
    for key in (*LANDMARKS, *SKIN):
        words, kind = known[key]
        segment, place = key.split(".")
        for side in ("",) if place in MIDLINE else SIDES.values():
            yield Site(segment=segment, landmark=words, side=side, key=key, kind=kind)


def _ways(places: Array, pose: Array, bony: Array) -> Iterator[tuple[float, Array, float]]:
    """Yield ways in which markers may stand on the model's ground.

    Yields
    ------
    how far off they are, places on the model (markers, 3) [m], and the body's size
    """
    extent = np.ptp(places, axis=0)
    tree = scipy.spatial.cKDTree(pose)
    low = pose[:, 1] < FOOT
    for axis in np.flatnonzero(extent > 0.6 * extent.max()):
        for sign in (1.0, -1.0):
            up = sign * np.eye(3)[axis]
            level = np.eye(3)[(axis + 1) % 3]
            upright = places @ np.array([level, up, np.cross(level, up)]).T
            for size in SIZES:
                placed = upright / size
                placed = placed - [0.0, placed[:, 1].min() - pose[:, 1].min(), 0.0]
                center = placed[placed[:, 1] < FOOT].mean(axis=0)
                for heading in HEADINGS:
                    turned = (placed - center) @ axis_rotation([0.0, 1.0, 0.0], heading).T + pose[
                        low
                    ].mean(axis=0)
                    off, moved = _settled(turned, pose, bony, tree)
                    yield off, moved, float(size)


def _settled(
    placed: Array, pose: Array, bony: Array, tree: scipy.spatial.cKDTree
) -> tuple[float, Array]:
    """Shift markers to where most lie near landmarks.

    Returns
    -------
    how far those and the landmarks are from each other, and the places (markers, 3) [m]
    """
    for _ in range(4):
        far, nearest = tree.query(placed)
        near = far < CAP
        if near.any():
            placed = placed + np.mean(pose[nearest[near]] - placed[near], axis=0)
    back, _ = scipy.spatial.cKDTree(placed).query(pose[bony])
    return (
        float(np.minimum(tree.query(placed)[0], CAP).mean() + np.minimum(back, CAP).mean()),
        placed,
    )


def _fitted(
    model: Model, names: Sequence[str], bony: Array, placed: Array, size: float, pose: Array
) -> _Fit:
    """Bend the model to a way, again and again as landmarks change hands."""
    rows, columns = _assigned(placed, pose, bony, CAP)
    for limit in np.linspace(CAP, NEAR, ROUNDS):
        if len(rows) < MIN_FIT:
            break
        pose, growth = _posed(model, names, placed[rows], columns)
        placed = placed / growth
        size = size * growth
        rows, columns = _assigned(placed, pose, bony, float(limit))
    return _Fit(placed, pose, size, rows, columns)


def _misfit(fit: _Fit) -> float:
    """Mean distance of landmarks that have a marker, and `NEAR` for each marker that has none."""
    apart = np.linalg.norm(fit.placed[fit.markers] - fit.pose[fit.landmarks], axis=1)
    return float(apart.sum() + NEAR * (len(fit.placed) - len(fit.markers)))


def _assigned(placed: Array, pose: Array, bony: Array, limit: float) -> tuple[Array, Array]:
    """Markers, and the landmarks that they are nearest to together."""
    apart = np.linalg.norm(placed[:, None] - pose[None], axis=2)
    cost = np.minimum(apart, limit) + np.where(bony, 0.0, 10.0)
    rows, columns = scipy.optimize.linear_sum_assignment(cost)
    kept = bony[columns] & (apart[rows, columns] < limit)
    return rows[kept], columns[kept]


def _posed(
    model: Model, names: Sequence[str], placed: Array, columns: Array
) -> tuple[Array, float]:
    """Pose the model so that it fits some landmarks.

    Returns
    -------
    places of all landmarks (landmarks, 3) [m], and by how much the markers are larger
    """
    seen = Markers(np.zeros(1), tuple(names[column] for column in columns), placed[None])
    fit = inverse_kinematics(model, seen)
    seen_pose = marker_positions(model, fit.motion)
    pose = np.array([seen_pose[name][0] for name in names])
    theirs = pose[columns] - pose[columns].mean(axis=0)
    ours = placed - placed.mean(axis=0)
    return pose, float(np.sum(ours * theirs) / np.sum(theirs**2))


def _is_body(sites: Sequence[Site]) -> bool:
    segments = {(site.segment, site.side) for site in sites}
    pelvis = sum(site.segment == "pelvis" for site in sites)
    return pelvis >= PELVIS and all(
        (part, side) in segments for part in LEG for side in SIDES.values()
    )

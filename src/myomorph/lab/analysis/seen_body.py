"""A body as markers show it, the vertical up: feet, pelvis, legs and arms over time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Markers
from myomorph.core.motion.crossings import crossings
from myomorph.core.motion.protocols import Site
from myomorph.core.motion.smoothing import smooth_both_ways
from myomorph.core.motion.sync import cut
from myomorph.lab.analysis.worded_sites import worded_sites

GRAVITY = 9.80665
MAX_ANIMAL = 0.15  # Legs of an animal are shorter; of a child of one year they are 0.3 m long.
MIN_FRAMES = 12  # Frames that a filter and two derivatives need.
CUTOFF = 2.5
"""Of the low-pass filter of positions, in cycles per sqrt(leg length / g): 8 Hz for an adult."""
SIDES = ("right", "left")
SELDOM = 0.4  # Share of hidden positions from which one passage through the volume is looked at.
HIGH = ("pelvis", "trunk", "head", "thigh")
LOW = ("shank", "foot")
ARM = ("upper_arm", "forearm", "hand")
LEG = ("thigh", "shank", "foot")
ANKLE = ("shank.lateral_malleolus", "shank.medial_malleolus", "foot.ankle", "foot.heel")
KNEE = ("thigh.lateral_epicondyle", "thigh.medial_epicondyle", "shank.knee", "shank.fibula_head")


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class SeenBody:
    """A body as markers show it.

    Attributes
    ----------
    time : (frames,) [s]
    places : position of each marker (frames, 3), y up [m], NaN where unseen
    sites : what each of these markers lies on
    """

    time: Array
    places: Mapping[str, Array]
    sites: Mapping[str, Site]

    @staticmethod
    def of(markers: Markers, sites: Mapping[str, Site], rotation: Array) -> SeenBody:
        """Body from markers.

        Parameters
        ----------
        markers : (frames, markers, 3) in the laboratory [m]
        sites : what labels lie on
        rotation : (3, 3) from the laboratory to axes whose y is up

        Returns
        -------
        the body; where no protocol knows its legs, with what words in labels say
        """
        markers = most_seen(markers)
        if not shows_legs(sites):
            sites = worded_sites(markers.names) | dict(sites)
            rotation = _upright(markers, sites, rotation)
        turned = np.asarray(rotation).T
        seen = [label for label in sites if label in markers.names]
        return SeenBody(
            time=markers.time,
            places={label: markers[label] @ turned for label in seen},
            sites={label: sites[label] for label in seen},
        )

    def labels(self, *parts: str, side: str | None = None) -> list[str]:
        """Markers on segments or landmarks, as `foot` or `foot.heel`, of a side (None for all)."""
        return [
            label
            for label, site in self.sites.items()
            if (site.segment in parts or site.key in parts) and side in (None, site.side)
        ]

    def place(self, landmark: str, side: str) -> Array | None:
        """Path of the first marker on a landmark.

        Parameters
        ----------
        landmark, side : as `foot.heel` and `right`

        Returns
        -------
        (frames, 3) [m], NaN where unseen; None where no marker is on it
        """
        labels = self.labels(landmark, side=side)
        return self.places[labels[0]] if labels else None

    def mean(self, *parts: str, side: str | None = None) -> Array | None:
        """Mean of markers, gaps of single markers filled.

        Parameters
        ----------
        parts : segments or landmarks, as `foot` or `foot.heel`
        side : of the body, None for all

        Returns
        -------
        (frames, 3) [m]; None where none is seen
        """
        chosen = [_filled(self.places[label]) for label in self.labels(*parts, side=side)]
        chosen = [place for place in chosen if np.isfinite(place).any()]
        if not chosen:
            return None
        mean: Array = np.mean(chosen, axis=0)
        return mean

    @cached_property
    def feet(self) -> Mapping[str, Array]:
        """(frames, 3) middle of each foot that is seen, or of its ankle, by side [m]."""
        feet = {}
        for side in SIDES:
            foot = self.mean("foot", side=side)
            foot = self.mean(*ANKLE, side=side) if foot is None else foot
            foot = self.mean("shank", side=side) if foot is None else foot
            if foot is not None:
                feet[side] = foot
        return feet

    @cached_property
    def root(self) -> Array | None:
        """(frames, 3) middle of the pelvis, else of hips, else of the trunk [m]."""
        for parts in (("pelvis",), ("thigh.hip",), ("trunk",), ("thigh",)):
            place = self.mean(*parts)
            if place is not None:
                return place
        return None

    @cached_property
    def leg(self) -> float:
        """Height of the root over the feet while the body is most upright [m], nan if unknown."""
        if self.root is None or not self.feet:
            return float("nan")
        low = np.mean(list(self.feet.values()), axis=0)
        return float(np.nanpercentile(self.root[:, 1] - low[:, 1], 95.0))

    @property
    def is_animal(self) -> bool:
        """Whether the legs are shorter than those of any child."""
        return bool(0.0 < self.leg < MAX_ANIMAL)

    @cached_property
    def pendulum(self) -> float:
        """Time scale of the legs, sqrt(leg length / g) [s]: 0.3 s of an adult."""
        return float(np.sqrt(self.leg / GRAVITY))

    @cached_property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return float(1.0 / np.median(np.diff(self.time))) if len(self.time) > 1 else float("nan")

    def smooth(self, values: Array) -> Array:
        """Low-pass filter values both ways.

        Parameters
        ----------
        values : (frames, ...)

        Returns
        -------
        (frames, ...); as they are where they are few
        """
        cutoff = CUTOFF / self.pendulum
        if len(values) <= MIN_FRAMES or not cutoff < 0.45 * self.rate:
            return values
        return smooth_both_ways(values, self.rate, cutoff, padding=MIN_FRAMES - 1)

    @cached_property
    def forward(self) -> Array:
        """(frames, 3) level unit vector in which the body faces; along its way where it is unknown.

        From the middle of the left side to that of the right one, turned by a quarter about the
        vertical: forward = up x (right - left).
        """
        for part in ("pelvis", "thigh", "trunk", "shank"):
            right = self.mean(part, side="right")
            left = self.mean(part, side="left")
            if right is None or left is None:
                continue
            across = self.smooth(right - left)
            level = np.zeros(len(across))
            forward = np.stack([across[:, 2], level, -across[:, 0]], axis=1)
            return np.asarray(forward / np.linalg.norm(forward, axis=1, keepdims=True))
        return np.tile([1.0, 0.0, 0.0], (len(self.time), 1))


def most_seen(markers: Markers) -> Markers:
    """Longest passage through the capture volume, where most positions are hidden."""
    if np.isnan(markers.values).any(axis=2).mean() <= SELDOM:
        return markers
    spans = crossings(markers)
    return cut(markers, *max(spans, key=lambda span: span[1] - span[0])) if spans else markers


def _upright(markers: Markers, sites: Mapping[str, Site], rotation: Array) -> Array:
    """(3, 3) rotation that puts the trunk above the feet; the given one where neither is known."""
    high = [markers[label] for label, site in sites.items() if site.segment in HIGH]
    low = [markers[label] for label, site in sites.items() if site.segment in LOW]
    if not high or not low:
        return rotation
    with warnings.catch_warnings():
        # Of frames in which nothing is seen.
        warnings.simplefilter("ignore", RuntimeWarning)
        rise = np.nanmean(high, axis=(0, 1)) - np.nanmean(low, axis=(0, 1))
    if not np.isfinite(rise).all():
        return rotation
    k = int(np.argmax(np.abs(rise)))
    up = np.sign(rise[k]) * np.eye(3)[k]
    forward = np.eye(3)[(k + 1) % 3]
    return np.stack([forward, up, np.cross(forward, up)])


def shows_legs(sites: Mapping[str, Site]) -> bool:
    """Whether some markers are on both legs below the knee."""
    return {site.side for site in sites.values() if site.segment in ("shank", "foot")} >= {*SIDES}


def extent(place: Array) -> float:
    """Extent of a path without its farthest tenth.

    Parameters
    ----------
    place : (frames, 1 to 3) [m], NaN where unseen

    Returns
    -------
    [m], 0 where it is never seen
    """
    seen = place[np.isfinite(place).all(axis=1)]
    if not len(seen):
        return 0.0
    low, high = np.percentile(seen, (5.0, 95.0), axis=0)
    return float(np.linalg.norm(high - low))


def _filled(place: Array) -> Array:
    """Marker's path (frames, 3) with gaps closed by lines; its first and last place beyond."""
    seen = np.isfinite(place).all(axis=1)
    if seen.all() or not seen.any():
        return place
    frames = np.arange(len(place))
    return np.stack([np.interp(frames, frames[seen], column[seen]) for column in place.T], axis=1)

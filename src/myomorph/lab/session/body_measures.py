"""Lengths of segments and weight of who was recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.analysis.seen_body import SIDES, SeenBody
from myomorph.lab.session.recordings import bare

# Leg of the body that deviations are those of [m]; on smaller bodies they are smaller.
ADULT_LEG = 0.9
WEIGHED = 0.03  # Standard deviation of a weight by plates, clothes and shoes included, as a share.
SKIN = 0.004
"""Standard deviation of a length between recordings of one placement of markers [m]: skin that
slides, and a pose that is another."""
SLIDING = 0.5  # Share of a length's spread within a recording that its median keeps.
STRAIGHT = 0.985  # Share of its way along the bones of a leg that is straight, ...
UPRIGHT = 0.96  # ... and of the vertical, so that the hip is neither flexed nor extended by much.
RIGID_SEGMENTS = ("pelvis", "thigh", "shank", "upper_arm", "forearm", "head")
"""Segments whose markers keep their distances but for skin that slides."""
MASS = "weight on plates"  # Name of the weight among measures.


@dataclass(frozen=True, kw_only=True)
class Length:
    """A length between two landmarks, by which bodies are compared.

    Attributes
    ----------
    bone : what is measured, as "shank"
    first, second : landmark at either end
    across : from one side of the body to the other, else both ends on one side
    variation : standard deviation between adults of one stature, as a share
    skin : standard deviation between recordings of one placement of markers [m]
    straight_at : landmark between both; frames count in which all three are nearly on a vertical
        line
    """

    bone: str
    first: str
    second: str
    variation: float
    across: bool = False
    skin: float = SKIN
    straight_at: str = ""

    def named_ends(self) -> dict[str, tuple[tuple[str, str], tuple[str, str]]]:
        """Landmark and side at either end, by the name of the length."""
        if self.across:
            return {f"{self.bone} ({self.first})": ((self.first, "right"), (self.second, "left"))}
        return {
            f"{self.bone} ({self.first} to {self.second}), {side}": (
                (self.first, side),
                (self.second, side),
            )
            for side in SIDES
        }


LENGTHS = (
    Length(
        bone="shank",
        first="thigh.lateral_epicondyle",
        second="shank.lateral_malleolus",
        variation=0.035,
    ),
    Length(bone="shank", first="shank.knee", second="foot.ankle", variation=0.035),
    Length(bone="foot", first="foot.heel", second="foot.mt5_head", variation=0.03),
    Length(bone="foot", first="foot.heel", second="foot.mt2_head", variation=0.03),
    Length(bone="foot", first="foot.heel", second="foot.toe_tip", variation=0.03),
    Length(
        bone="leg",
        first="pelvis.asis",
        second="shank.lateral_malleolus",
        variation=0.02,
        skin=0.015,
        straight_at="thigh.lateral_epicondyle",
    ),
    Length(
        bone="knee",
        first="thigh.lateral_epicondyle",
        second="thigh.medial_epicondyle",
        variation=0.05,
    ),
    Length(
        bone="ankle",
        first="shank.lateral_malleolus",
        second="shank.medial_malleolus",
        variation=0.05,
    ),
    # A shoulder's marker moves as the arm is raised.
    Length(
        bone="upper arm",
        first="trunk.acromion",
        second="upper_arm.lateral_epicondyle",
        variation=0.035,
        skin=0.02,
    ),
    Length(
        bone="forearm",
        first="upper_arm.lateral_epicondyle",
        second="forearm.radial_styloid",
        variation=0.04,
        skin=0.008,
    ),
    Length(bone="forearm", first="forearm.elbow", second="hand.wrist", variation=0.04, skin=0.008),
    Length(
        bone="pelvis width",
        first="pelvis.asis",
        second="pelvis.asis",
        variation=0.07,
        across=True,
    ),
    Length(
        bone="pelvis width behind",
        first="pelvis.psis",
        second="pelvis.psis",
        variation=0.1,
        across=True,
    ),
)
"""Lengths between bony landmarks, with variations of adults' bones about those of their stature.

Source: Gordon et al. 2014 (ANSUR II), standard deviations over means less that of the stature,
rounded.
"""
LENGTH_OF_NAME = {name: length for length in LENGTHS for name in length.named_ends()}
"""Length by its name in `BodyMeasures.lengths`."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measure of a body and its standard deviation between recordings of one session [m or kg].

    Where markers were placed anew, lengths differ by more.
    """

    mean: float
    sd: float


@dataclass(frozen=True, kw_only=True)
class BodyMeasures:
    """Measures of the body in one recording, or in several.

    Attributes
    ----------
    lengths : between landmarks, by what they are between [m]
    mass : by plates [kg], None where they do not weigh the body
    size : of the body against an adult, at most 1, which markers are placed in proportion to
    clusters : distances of markers on one segment, by both labels [m]; where markers were placed
        anew they are others, so they say nothing of the body
    """

    lengths: Mapping[str, Measured]
    mass: Measured | None = None
    size: float = 1.0
    clusters: Mapping[str, Measured] = field(default_factory=lambda: FrozenMap({}))


def measures_of(body: SeenBody, mass: float | None = None) -> BodyMeasures:
    """Measures of the body that markers show.

    Parameters
    ----------
    body : as markers show it
    mass : by plates [kg], None where they do not weigh it
    """
    size = min(1.0, body.leg / ADULT_LEG) if np.isfinite(body.leg) else 1.0
    lengths = {}
    for name, length in LENGTH_OF_NAME.items():
        distance = _distances(body, name, length)
        if len(distance):
            lengths[name] = _measured(distance, size * length.skin)
    weighed = None if mass is None else Measured(mean=mass, sd=WEIGHED * mass)
    clusters = _clusters(body, size * SKIN)
    return BodyMeasures(lengths=lengths, mass=weighed, size=size, clusters=clusters)


def _clusters(body: SeenBody, skin: float) -> dict[str, Measured]:
    """Distances of markers on each rigid segment, by both labels without names of subjects."""
    segments: dict[tuple[str, str], list[str]] = {}
    for label, site in body.sites.items():
        if site.segment in RIGID_SEGMENTS:
            segments.setdefault((site.segment, site.side), []).append(label)
    clusters = {}
    for labels in segments.values():
        for first, second in combinations(sorted(labels), 2):
            if all(body.sites[label].kind == "skin" for label in (first, second)):
                continue  # They may be on one shell, which other people wear as well.
            difference = body.places[first] - body.places[second]
            distance = np.linalg.norm(difference, axis=1)
            seen = distance[np.isfinite(distance)]
            if len(seen):
                clusters[f"{bare(first)} - {bare(second)}"] = _measured(seen, skin)
    return clusters


def _distances(body: SeenBody, name: str, length: Length) -> Array:
    """(frames seen,) distance of the landmarks at the ends of a length [m]."""
    (first, side), (second, other) = length.named_ends()[name]
    start = body.place(first, side)
    stop = body.place(second, other)
    if start is None or stop is None:
        return np.zeros(0)
    distance = np.linalg.norm(start - stop, axis=1)
    seen = np.isfinite(distance)
    if length.straight_at:
        middle = body.place(length.straight_at, side)
        if middle is None:
            return np.zeros(0)
        along_bones = np.linalg.norm(start - middle, axis=1) + np.linalg.norm(middle - stop, axis=1)
        drop = np.abs(start[:, 1] - stop[:, 1])
        with np.errstate(invalid="ignore"):
            seen &= (distance > STRAIGHT * along_bones) & (drop > UPRIGHT * distance)
    return np.asarray(distance[seen])


def _measured(distance: Array, skin: float) -> Measured:
    """Median distance, and how sure it is.

    Skin and joints let the distance vary by s within the recording:
    sd^2 = skin^2 + (SLIDING s)^2.

    Parameters
    ----------
    distance : (frames,) [m]
    skin : standard deviation between recordings [m]
    """
    low, middle, high = np.percentile(distance, (16.0, 50.0, 84.0))
    spread = SLIDING * (high - low) / 2.0
    return Measured(mean=float(middle), sd=float(np.hypot(skin, spread)))


def pooled(measures: Sequence[BodyMeasures]) -> BodyMeasures:
    """Measures of one body from recordings of one placement of markers.

    Each is the mean of the recordings that have it, weighted by their variances. What the
    recordings have in common, as a skin that slides in all of them alike, does not average out: the
    deviation is that of the best.
    """
    weighed = [one.mass for one in measures if one.mass is not None]
    return BodyMeasures(
        lengths=_means([one.lengths for one in measures]),
        mass=_mean(weighed) if weighed else None,
        size=float(np.median([one.size for one in measures])),
        clusters=_means([one.clusters for one in measures]),
    )


def _means(measured: Sequence[Mapping[str, Measured]]) -> dict[str, Measured]:
    """Mean of each measure over those that have it."""
    names = dict.fromkeys(name for one in measured for name in one)
    return {name: _mean([one[name] for one in measured if name in one]) for name in names}


def _mean(values: Sequence[Measured]) -> Measured:
    weights = np.array([1.0 / value.sd**2 for value in values])
    means = np.array([value.mean for value in values])
    return Measured(
        mean=float(weights @ means / weights.sum()), sd=min(value.sd for value in values)
    )

"""Lengths of segments and weight of who was recorded; whether two recordings are of one body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from myomorph.lab.analysis.seen_body import SIDES, SeenBody

PLACED = 0.007
PLACED_WIDELY = {"pelvis.asis": 0.010, "pelvis.psis": 0.010, "trunk.acromion": 0.020}
"""Standard deviation of where a marker is put on a landmark on two days, along a segment [m]; of
some it is larger, for a pelvis' edge is blunt and a shoulder moves under its marker. Set so that no
two recordings of one person differ by chance (docs/validation/raw-recordings.md).
"""
ADULT_LEG = (
    0.9  # Leg of the body whose markers are placed so [m]; they are smaller on smaller bodies.
)
FLESH = 0.5
"""Share of a length's spread within a recording, from skin and bending, that a mean keeps."""
WEIGHED = 0.03  # Standard deviation of a weight by plates, clothes and shoes included, as a share.
MIN_LENGTHS = 3  # So many lengths at least tell two bodies apart, or a weight.
MIN_CHANCE = 0.01  # Two recordings of one body differ so much with this chance only.

# Name, the landmark at either end; both on the same side, or on the two sides of the body.
SIDED = (
    ("shank", "thigh.lateral_epicondyle", "shank.lateral_malleolus"),
    ("shank", "shank.knee", "foot.ankle"),
    ("foot", "foot.heel", "foot.mt5_head"),
    ("foot", "foot.heel", "foot.mt2_head"),
    ("foot", "foot.heel", "foot.toe_tip"),
    ("knee", "thigh.lateral_epicondyle", "thigh.medial_epicondyle"),
    ("ankle", "shank.lateral_malleolus", "shank.medial_malleolus"),
    ("upper arm", "trunk.acromion", "upper_arm.lateral_epicondyle"),
    ("forearm", "upper_arm.lateral_epicondyle", "forearm.radial_styloid"),
    ("forearm", "forearm.elbow", "hand.wrist"),
)
ACROSS = (
    ("pelvis width", "pelvis.asis"),
    ("pelvis width behind", "pelvis.psis"),
)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measure of a body and its standard deviation [m or kg]."""

    mean: float
    sd: float


@dataclass(frozen=True, kw_only=True)
class BodyMeasures:
    """Measures of the body in one recording.

    Attributes
    ----------
    lengths : between landmarks, by what they are between [m]
    mass : by plates [kg], None where they do not weigh the body
    """

    lengths: Mapping[str, Measured]
    mass: Measured | None = None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """How far two recordings are from being of one body.

    Attributes
    ----------
    squares : sum of squared differences over their variances
    count : of the measures that both have
    farthest : the measure that differs most, in words
    """

    squares: float = 0.0
    count: int = 0
    farthest: str = ""

    @property
    def chance(self) -> float:
        """Chance that one body differs so much or more, 1 where too little is known of both.

        The sum of squares of n independent normal deviations is distributed as chi-square with n
        degrees of freedom.
        """
        if self.count < MIN_LENGTHS:
            return 1.0
        return float(scipy.stats.chi2.sf(self.squares, self.count))


def measures_of(body: SeenBody, mass: float | None = None) -> BodyMeasures:
    """Measures of the body that markers show.

    Parameters
    ----------
    body : as markers show it
    mass : by plates [kg], None where they do not weigh it
    """
    size = min(1.0, body.leg / ADULT_LEG) if np.isfinite(body.leg) else 1.0
    ends = {
        f"{name} ({first} to {second}), {side}": ((first, side), (second, side))
        for name, first, second in SIDED
        for side in SIDES
    }
    ends |= {f"{name} ({key})": ((key, "right"), (key, "left")) for name, key in ACROSS}
    lengths = {}
    for name, (first, second) in ends.items():
        length = _length(body, first, second, size)
        if length is not None:
            lengths[name] = length
    weighed = None if mass is None else Measured(mean=mass, sd=WEIGHED * mass)
    return BodyMeasures(lengths=lengths, mass=weighed)


def _length(
    body: SeenBody, first: tuple[str, str], second: tuple[str, str], size: float
) -> Measured | None:
    """Distance of two landmarks, each by key and side, and how sure it is; None where unseen.

    Markers are placed with standard deviations p and q, and skin and joints let the distance vary
    by s within the recording: sd^2 = p^2 + q^2 + (FLESH s)^2.

    Parameters
    ----------
    size : of the body against an adult, which markers are placed in proportion to
    """
    ends = [body.labels(key, side=side) for key, side in (first, second)]
    if not ends[0] or not ends[1]:
        return None
    apart = body.places[ends[0][0]] - body.places[ends[1][0]]
    distance = np.linalg.norm(apart[np.isfinite(apart).all(axis=1)], axis=1)
    if not len(distance):
        return None
    low, middle, high = np.percentile(distance, (16.0, 50.0, 84.0))
    spread = FLESH * (high - low) / 2.0
    placed = [size * PLACED_WIDELY.get(key, PLACED) for key, _ in (first, second)]
    return Measured(mean=float(middle), sd=float(np.linalg.norm([*placed, spread])))


def compared(first: BodyMeasures, second: BodyMeasures) -> Comparison:
    """Two recordings held against each other by all that both show."""
    pairs = [
        (name, length, second.lengths[name])
        for name, length in first.lengths.items()
        if name in second.lengths
    ]
    if first.mass is not None and second.mass is not None:
        pairs.append(("weight on plates", first.mass, second.mass))
    if not pairs:
        return Comparison()
    deviations = {
        name: abs(one.mean - other.mean) / float(np.hypot(one.sd, other.sd))
        for name, one, other in pairs
    }
    farthest = max(deviations, key=lambda name: deviations[name])
    one, other = next((one, other) for name, one, other in pairs if name == farthest)
    text = (
        f"weight {one.mean:.1f} and {other.mean:.1f} kg"
        if farthest == "weight on plates"
        else f"{farthest.split(' (')[0]} {100.0 * one.mean:.1f} and {100.0 * other.mean:.1f} cm"
    )
    return Comparison(
        squares=sum(deviation**2 for deviation in deviations.values()),
        count=len(deviations),
        farthest=text,
    )

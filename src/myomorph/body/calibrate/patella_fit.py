"""How far a person's patellae lie from the knees' axes, by markers on them.

A marker on a patella is farther out than the tendons by bone, skin and half of itself. What it is
farther than that is the person's distance d, alike in both knees, with what nobody sees:

    h = d + b + s_k + p_m + noise

the height h of marker m over the middle of the muscle paths on the patella of knee k, along the way
out from the knee's axis; the depth b of bone, skin and marker; how far that knee's axis and track
lie elsewhere than the model's, s_k; how far the marker is put off the middle of the patella, p_m.
All are unknowns with priors, so that their spread is part of the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.body.calibrate.patella_markers import markers_on_patellae
from myomorph.core.fit.estimation import Estimate, estimate
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Measured
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import MARKERS
from myomorph.core.model.interval import Interval
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.shown import shown
from myomorph.core.muscles.patella import patella_of
from myomorph.core.muscles.patella_distance import (
    middle_of_paths,
    patella_directions,
    with_patellae_farther,
)
from myomorph.core.muscles.patella_spread import DISTANCE_SD, TRACK_SD
from myomorph.core.muscles.published_arms import size_of_person
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.knees import knee_joints
from myomorph.core.rigid.tree import compile_tree

BONE = 0.0085
"""From the middle of the muscle paths to the front of the patella, in the bone that models in
common use share (Rajagopal et al. 2016), of a person with `THIGH_LENGTH` [m].
"""
BONE_SD = 0.002
"""Of that [m]: patellae are 25.1 mm thick with a standard deviation of 2.3 (927 MRIs, Kerdari et
al. 2020) or 22.4 with 2.3 (Iranpour et al. 2008), of which this is a third; the rest is where the
author of a model puts the tendons.
"""
SKIN = 0.005
SKIN_SD = 0.0025
"""Skin, fat and fasciae before the patella of an adult [m]; an assumption. They are thicker in
women and with body mass (Kizilgöz et al. 2023; Elkins et al. 2018).
"""
MARKER = 0.0075
MARKER_SD = 0.0015
"""Radius of a marker with its base [m]: markers of 9.5 to 19 mm are in use."""
AXIS_SD = 0.0045  # Of a knee's axis among the markers along one axis [m] (Kainz et al. 2015)
PLACE_SD = 0.002
"""Of a marker's height that is put 1 cm off the middle of the patella, whose front is round [m]."""
MAX_SD = 3.0  # Of all that is not known, within which a marker may lie on the patella
UNKNOWN = "distance of patellae"
WHERE = "distance"


@read_only
class PatellaReadings:
    """Heights of one marker over the muscle paths on its patella.

    Attributes
    ----------
    marker, patella : names
    expected : height of a marker on the given model's patella [m]
    heights : for each recording (frames,) [m], without frames that do not show the marker
    """

    marker: str
    patella: str
    expected: float
    heights: tuple[Array, ...]

    @property
    def mean(self) -> float:
        """Over all recordings alike [m]."""
        return float(np.mean([part.mean() for part in self.heights if len(part)]))

    @property
    def likely(self) -> bool:
        """Whether the marker is as high as one on a patella can be."""
        parts = (DISTANCE_SD, TRACK_SD, AXIS_SD, BONE_SD, SKIN_SD, MARKER_SD, PLACE_SD)
        limit = MAX_SD * float(np.sqrt(np.sum(np.square(parts))))
        return abs(self.mean - self.expected) < limit


@shown
@dataclass(frozen=True, kw_only=True, eq=False)
class PatellaDistance:
    """How much farther a person's patellae lie from the knees' axes than those of a model.

    Attributes
    ----------
    patellae : bodies, both alike
    markers : that inform it
    estimate : the distance with what else was not known
    """

    patellae: tuple[str, ...]
    markers: tuple[str, ...]
    estimate: Estimate

    @property
    def interval(self) -> Interval:
        """Distance beyond that of the model with a 90 % interval [m]."""
        return self.estimate.posterior.interval(UNKNOWN)

    @property
    def value(self) -> float:
        """Distance beyond that of the model [m]."""
        return self.interval.value

    @property
    def sd(self) -> float:
        """Standard deviation [m]."""
        return float(self.estimate.posterior.sd[0])

    @property
    def share(self) -> float:
        """How much of what is known the markers gave, 0 to 1."""
        return float(self.estimate.posterior.share[0])

    @property
    def shown(self) -> bool:
        """Whether the markers halve the standard deviation known before."""
        return bool(self.estimate.posterior.shown[0])

    @property
    def sentence(self) -> str:
        """The distance in words."""
        interval = self.interval
        side = "farther from" if interval.value > 0.0 else "nearer to"
        verdict = "" if self.shown else ", which alone do not show it"
        return (
            f"patellae {1e3 * abs(interval.value):.1f} mm {side} the knees' axes than the model's"
            f" (90 % interval {1e3 * interval.low:+.1f} to {1e3 * interval.high:+.1f} mm):"
            f" {100.0 * self.share:.0f} % by {', '.join(self.markers)}{verdict}, the rest by"
            " published moment arms"
        )


def patella_distance(
    model: Model,
    readings: Sequence[PatellaReadings],
    noise: float,
    independent_frames: Sequence[int],
) -> PatellaDistance | None:
    """Estimate how far patellae lie from the knees' axes.

    Parameters
    ----------
    model : of the person, calibrated
    readings : of markers on its patellae; see `patella_readings`
    noise : of a marker and the pose of its thigh along one axis [m]
    independent_frames : for each recording, so many frames say as much as all

    Returns
    -------
    None where no marker shows it

    Notes
    -----
    Prior: docs/decisions/0074-the-patella-of-a-person.md. Equation: above.
    """
    used = [reading for reading in readings if reading.likely]
    if not used:
        return None
    unknowns = Unknowns(tuple(_blocks(used)))
    residuals = tuple(
        _residuals(reading, part, number, noise, count)
        for reading in used
        for number, (part, count) in enumerate(
            zip(reading.heights, independent_frames, strict=True), start=1
        )
        if len(part)
    )
    return PatellaDistance(
        patellae=tuple(patella_directions(model)),
        markers=tuple(reading.marker for reading in used),
        estimate=estimate(Problem(unknowns, residuals)),
    )


def unlikely_marker_notes(readings: Sequence[PatellaReadings]) -> Iterator[Message]:
    """Report markers that lie where no patella is.

    Parameters
    ----------
    readings : of all markers on patellae

    Yields
    ------
    one sentence, or none
    """
    off = [
        f"{reading.marker} {1e3 * (reading.mean - reading.expected):+.0f} mm"
        for reading in readings
        if not reading.likely
    ]
    if off:
        yield MARKERS.message(
            f"markers on patellae that lie off these: {', '.join(off)} from the middle of the skin"
            " before the bone; they say nothing of the distance of patellae: check their names"
        )


def _blocks(readings: Sequence[PatellaReadings]) -> Iterator[Block]:
    """Declare what is not known, each a block of one number [m]."""
    yield _block(WHERE, UNKNOWN, DISTANCE_SD)
    yield _block("depth", "depth of patella, skin and marker", _depth_sd())
    for patella in dict.fromkeys(reading.patella for reading in readings):
        yield _block(patella, f"axis and track of {patella}", float(np.hypot(AXIS_SD, TRACK_SD)))
    for reading in readings:
        yield _block(f"marker {reading.marker}", f"place of {reading.marker}", PLACE_SD)


def _block(name: str, unknown: str, sd: float) -> Block:
    """Declare one number around 0 [m]."""
    return Block(name=name, unknowns=(Unknown(name=unknown, unit="m", sd=sd, scale=0.001),))


def _depth_sd() -> float:
    """Compute the standard deviation of what lies between marker and muscle paths [m]."""
    return float(np.sqrt(BONE_SD**2 + SKIN_SD**2 + MARKER_SD**2))


def _residuals(
    reading: PatellaReadings, heights: Array, number: int, noise: float, independent: int
) -> Measured:
    """Compare a marker's heights in a recording with the unknowns.

    Parameters
    ----------
    reading : of the marker
    heights : (frames,) in the recording [m]
    number : of the recording
    noise : along one axis [m]
    independent : so many frames say as much as all
    """
    blocks = (WHERE, "depth", reading.patella, f"marker {reading.marker}")
    ones = np.ones((len(heights), 1))

    def beyond(values: Values) -> Array:
        """(frames,) predicted less measured [m]."""
        total = sum(float(values[name][0]) for name in blocks)
        return np.asarray(reading.expected + total - heights)

    return Measured(
        name=f"{reading.marker} in recording {number}",
        blocks=blocks,
        function=beyond,
        slopes=lambda values: dict.fromkeys(blocks, ones),
        sd=noise,
        correlation_time=max(1.0, len(heights) / independent),
    )


def patella_readings(
    model: Model,
    names: Sequence[str],
    positions: Sequence[Array],
    angles: Sequence[Array],
) -> Iterator[PatellaReadings]:
    """Read how high markers lie over the muscle paths on their patellae.

    Parameters
    ----------
    model : of the person, calibrated
    names : of the markers
    positions : for each recording (frames, names, 3) [m], NaN where not seen
    angles : for each recording (frames, coordinates) in the model's order, dependent ones
        consistent [rad or m]

    Yields
    ------
    readings of every marker on a patella that any frame shows; none of a body unlike a person's
    """
    ways = patella_directions(model)
    sizes = _sizes(model)
    for marker, patella in markers_on_patellae(model).items():
        middle = middle_of_paths(model, patella)
        if marker not in names or patella not in ways or patella not in sizes or middle is None:
            continue
        column = list(names).index(marker)
        seen = [
            _in_body(model, patella, here[:, column], frames)
            for here, frames in zip(positions, angles, strict=True)
        ]
        heights = tuple((part - middle) @ ways[patella] for part in seen)
        if any(map(len, heights)):
            yield PatellaReadings(
                marker=marker,
                patella=patella,
                expected=BONE * sizes[patella] + SKIN + MARKER,
                heights=heights,
            )


def _sizes(model: Model) -> Mapping[str, float]:
    """Size of the person over that of those who were measured, by patella."""
    found = {}
    for knee in knee_joints(model):
        patella = patella_of(model, knee)
        size = size_of_person(model, knee)
        if patella is not None and size is not None:
            found[patella] = size
    return found


def _in_body(model: Model, body: str, positions: Array, angles: Array) -> Array:
    """Express a marker's places in a body.

    Parameters
    ----------
    model : of the body
    body : name
    positions : (frames, 3) [m], NaN where not seen
    angles : (frames, coordinates) [rad or m]

    Returns
    -------
    (seen frames, 3) in its axes [m]
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, angles)
    number = tree.body_index[body]
    local = np.einsum(
        "fji,fj->fi", poses.rotations[:, number], positions - poses.origins[:, number]
    )
    return np.asarray(local[np.isfinite(local).all(axis=1)])


def with_distance(model: Model, found: PatellaDistance | None) -> Model:
    """Move the patellae of a model to where they were found; fibers keep their lengths.

    Parameters
    ----------
    model : of the person
    found : None leaves it as it is
    """
    if found is None:
        return model
    return with_patellae_farther(
        model, dict.fromkeys(found.patellae, found.value), fitted_tendons=True
    )

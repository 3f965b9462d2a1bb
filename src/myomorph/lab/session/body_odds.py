"""Odds that two sets of measures are of two bodies, rather than of one that was marked twice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.session.body_measures import LENGTH_OF_NAME, MASS, BodyMeasures, Measured

PLACED = 0.007
PLACED_WIDELY = {"pelvis.asis": 0.010, "pelvis.psis": 0.010, "trunk.acromion": 0.020}
"""Standard deviation of where a marker is put on a landmark on two days, along a segment [m]; of
some it is larger, for a pelvis' edge is blunt and a shoulder moves under its marker.
"""
OTHER_PROTOCOL = 1.4
"""Deviations are so many times as large between two marker sets, which mean other places."""
STATURE = 0.05  # Standard deviation of the size of adults' bodies, as a share (ANSUR II).
MASS_OF_SIZE = 2.0  # Power of the stature that weights go with.
BUILD = 0.15  # Standard deviation of the weight of bodies of one stature, as a share.
MIN_BONES = 3  # So many bones, or weights, at least tell two bodies apart.
KEPT = 0.8  # Share of the differences that count, the smallest; ...
KEPT_MEAN = 0.44  # ... their mean square over its variance where errors are normal.
MAX_ALIKE = 1.25  # Mean square over its variance, below which markers are where they were.
MAX_SAME = 0.3  # The same where names say two people, or markers are of two sets.
MIN_ALIKE = 5  # Lengths and distances of markers that must agree so, ...
MIN_SAME = 8  # ... and where there is reason to doubt.


@dataclass(frozen=True, kw_only=True)
class BodyOdds:
    """How much measures speak for two bodies.

    Attributes
    ----------
    evidence : decadic logarithm of the likelihood of two bodies over that of one; 0 where too
        little is known of both
    robust : the same without the bone that says most for two, so that one marker that was put or
        taken for another does not decide
    count : of lengths and distances of markers that both have
    mean_square : of their differences over the variances between recordings of one placement of
        markers, without the largest fifth, so that labels that were exchanged do not count
    farthest : the measure that speaks most for two bodies, in words
    """

    evidence: float = 0.0
    robust: float = 0.0
    count: int = 0
    mean_square: float = float("inf")
    farthest: str = ""

    def one_placement(self, doubtful: bool = False) -> bool:
        """Whether markers are where they were: one body in one session.

        Parameters
        ----------
        doubtful : names say that two people were recorded, or markers are of two sets
        """
        if doubtful:
            return self.count >= MIN_SAME and self.mean_square < MAX_SAME
        return self.count >= MIN_ALIKE and self.mean_square < MAX_ALIKE


@read_only
class Differences:
    """Measures that two bodies have in common, as differences of logarithms.

    Attributes
    ----------
    names : (measures,)
    values : (measures,) logarithm of one over the other
    skin : (measures,) variances between recordings of one placement
    placing : (measures, measures) further covariance where markers were placed anew
    people : (measures, measures) further covariance where bodies differ
    """

    names: tuple[str, ...]
    values: Array
    skin: Array
    placing: Array
    people: Array

    @property
    def bones(self) -> tuple[str, ...]:
        """(measures,) what each measures."""
        return tuple(_bone(name) for name in self.names)

    def evidence(self, left_out: str = "") -> float:
        """Logarithm of the likelihood ratio without a bone.

        With the differences d, normal with the covariance C_1 of one body marked twice, or C_2 of
        two bodies,

            ln L = (d^T C_1^-1 d - d^T C_2^-1 d + ln det C_1 - ln det C_2) / 2.
        """
        kept = np.array([bone != left_out for bone in self.bones])
        if not kept.any():
            return 0.0
        values = self.values[kept]
        one = (np.diag(self.skin) + self.placing)[np.ix_(kept, kept)]
        two = one + self.people[np.ix_(kept, kept)]
        squares = values @ (np.linalg.solve(one, values) - np.linalg.solve(two, values))
        return float(squares + np.linalg.slogdet(one)[1] - np.linalg.slogdet(two)[1]) / 2.0


def body_odds(first: BodyMeasures, second: BodyMeasures, same_protocol: bool = True) -> BodyOdds:
    """Compare two bodies by all that both show.

    Parameters
    ----------
    first, second : each of one body
    same_protocol : markers are on the same landmarks by the same labels
    """
    differences = _differences(first, second, 1.0 if same_protocol else OTHER_PROTOCOL)
    bones = dict.fromkeys(differences.bones)
    lengths = np.array([name != MASS for name in differences.names], bool)
    squares = [
        *(differences.values[lengths] ** 2 / differences.skin[lengths]),
        *_squares(first.clusters, second.clusters),
    ]
    if not bones:
        return BodyOdds(count=len(squares), mean_square=_typical(squares))
    without = {bone: differences.evidence(bone) for bone in bones}
    farthest = min(bones, key=lambda bone: without[bone])
    enough = len(bones) >= MIN_BONES
    return BodyOdds(
        evidence=differences.evidence() / np.log(10.0) if enough else 0.0,
        robust=without[farthest] / np.log(10.0) if enough else 0.0,
        count=len(squares),
        mean_square=_typical(squares),
        farthest=_in_words(differences, farthest, first, second),
    )


def _squares(first: Mapping[str, Measured], second: Mapping[str, Measured]) -> list[float]:
    """Squared differences of what both have over their variances."""
    pairs = [(first[name], second[name]) for name in first if name in second]
    return [(one.mean - other.mean) ** 2 / (one.sd**2 + other.sd**2) for one, other in pairs]


def _typical(squares: Sequence[float]) -> float:
    """Mean without the largest fifth over that of normal errors, inf of none."""
    kept = sorted(squares)[: int(KEPT * len(squares) + 0.5)]
    return float(np.mean(kept)) / KEPT_MEAN if kept else float("inf")


def _differences(first: BodyMeasures, second: BodyMeasures, protocols: float) -> Differences:
    """Differences of what both have.

    Parameters
    ----------
    protocols : factor of the deviations with which markers are placed
    """
    lengths = {name: 1.0 for name in first.lengths if name in second.lengths}
    weighed = first.mass is not None and second.mass is not None
    names = (*lengths, *((MASS,) if weighed else ()))
    pairs = [(_measure(first, name), _measure(second, name)) for name in names]
    means = np.array([np.sqrt(one.mean * other.mean) for one, other in pairs])
    skin = np.array([one.sd**2 + other.sd**2 for one, other in pairs])
    logarithms = np.array([np.log(one.mean / other.mean) for one, other in pairs])
    scale = np.outer(means, means)
    # Both bodies were marked, or are drawn from all people: twice the variance.
    placing = 2.0 * (protocols * min(first.size, second.size)) ** 2 * _placing(names)
    return Differences(
        names=names,
        values=logarithms,
        skin=skin / means**2,
        placing=placing / scale if len(names) else placing,
        people=2.0 * _people(names),
    )


def _measure(measures: BodyMeasures, name: str) -> Measured:
    if name != MASS:
        return measures.lengths[name]
    assert measures.mass is not None
    return measures.mass


def _placing(names: Sequence[str]) -> Array:
    """Covariance of lengths by markers that are placed anew [m^2].

    A marker moves along a bone by s, which lengths of that bone that end at it have in common.

    Returns
    -------
    (measures, measures); 0 of a weight
    """
    ends = [_ends(name) for name in names]
    markers = list(dict.fromkeys(end for pair in ends for end in pair))
    deviations = np.array([PLACED_WIDELY.get(key, PLACED) for _, key, _ in markers])
    touched = np.array([[marker in pair for marker in markers] for pair in ends], float)
    touched = touched.reshape(len(names), len(markers)) * deviations
    covariance: Array = touched @ touched.T
    return covariance


def _ends(name: str) -> tuple[tuple[str, str, str], ...]:
    """Bone, landmark and side at either end of a length; none of a weight."""
    if name == MASS:
        return ()
    length = LENGTH_OF_NAME[name]
    return tuple((length.bone, key, side) for key, side in length.named_ends()[name])


def _people(names: Sequence[str]) -> Array:
    """Covariance of measures between people, of logarithms.

    All grow with the stature, and each bone has a variation of its own, alike on both sides.

    Returns
    -------
    (measures, measures)
    """
    growth = np.array([MASS_OF_SIZE if name == MASS else 1.0 for name in names])
    bones = [_bone(name) for name in names]
    own = np.array([BUILD if name == MASS else LENGTH_OF_NAME[name].variation for name in names])
    same_bone = np.array([[one == other for other in bones] for one in bones], bool)
    same_bone = same_bone.reshape(len(names), len(names))
    return np.asarray(STATURE**2 * np.outer(growth, growth) + same_bone * np.outer(own, own))


def _bone(name: str) -> str:
    return name if name == MASS else LENGTH_OF_NAME[name].bone


def _in_words(
    differences: Differences, bone: str, first: BodyMeasures, second: BodyMeasures
) -> str:
    """Both values of the measure of a bone that differs most."""
    own = [index for index, one in enumerate(differences.bones) if one == bone]
    name = differences.names[max(own, key=lambda index: abs(differences.values[index]))]
    one = _measure(first, name).mean
    other = _measure(second, name).mean
    if name == MASS:
        return f"weight {one:.1f} and {other:.1f} kg"
    return f"{bone} {100.0 * one:.1f} and {100.0 * other:.1f} cm"

"""Labels exchanged throughout are exchanged back.

By the poses of a model that fits, and before its lengths are known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.causes import MARKERS
from myomorph.core.model.findings import Finding, Repair, pairs_text, repaired, spans_of, times_text
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.model.sides import mirror_names
from myomorph.core.motion.body_size import overall_size
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    KinematicsFit,
    inverse_kinematics,
    marker_rms,
    tracked_markers,
)
from myomorph.core.motion.lengths import length_unit
from myomorph.core.motion.stretch import skeleton
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

SUSPECT = 0.02
"""Root mean square of marker errors above which whole groups of labels are tried exchanged, on a
human body [m].
"""

FAR = 0.025  # Errors of both markers above which a pair may be exchanged, on a human body [m]
# Share of a pair's squared errors that may be left when each is held against the other's place
CROSSED = 0.4
BETTER = 0.7  # Share of the root mean square that an exchange must leave at most to be believed
MIRROR = np.array([1.0, 1.0, -1.0])  # Every mirrored recording is this one, turned
SWAP_SAMPLES = 6  # Frames on which an exchange is tried
LEAST_GAIN = 0.005  # What an exchange must take off the root mean square, on a human body [m]
# Of swapped sides and a mirrored axis the one that leaves so much less is reported as it
CLEARLY = 0.75


class Margin(NamedTuple):
    """Limits of how much better an exchange must fit.

    Attributes
    ----------
    share : of the root mean square, left at most [-]
    gain : taken off the root mean square at least, on a human body [m]
    """

    share: float = BETTER
    gain: float = LEAST_GAIN


USUAL = Margin()  # Of a model of this body
OF_ANY_LENGTHS = Margin(0.9, 0.01)
"""Of a model whose lengths and marker places are not this body's: it never fits well, but a wrong
exchange costs cm.
"""

SIDES = "left and right"
FRONT = "front and back"
MIRRORED = "mirrored"


@dataclass(frozen=True)
class Swap:
    """Exchanged labels.

    Attributes
    ----------
    name : of the exchange, for messages
    pairs : of markers, none for a mirrored recording
    certain : nothing else fits as well
    """

    name: str
    pairs: tuple[tuple[str, str], ...]
    certain: bool = True

    def applied(self, observed: Array, columns: Sequence[int]) -> Array:
        """Exchange the labels of positions, or mirror them.

        Parameters
        ----------
        observed : (frames, markers, 3) [m]
        columns : of `columns`

        Returns
        -------
        (frames, markers, 3) [m]
        """
        return observed * MIRROR if self.name == MIRRORED else observed[:, columns]

    def columns(self, names: Sequence[str]) -> list[int]:
        """Find the column to take each marker from.

        Parameters
        ----------
        names : of the markers

        Returns
        -------
        (markers,) numbers
        """
        order = list(range(len(names)))
        for first, other in self.pairs:
            i = names.index(first)
            j = names.index(other)
            order[i], order[j] = order[j], order[i]
        return order


Solve = Callable[[Array], Array]
"""From positions (frames, markers, 3) [m] to errors (frames, markers) [m], each frame by itself."""


@read_only
class FittedMarkers:
    """Markers as recorded, and as a model fits them.

    Attributes
    ----------
    names : (markers,)
    observed : (frames, markers, 3) as recorded [m]
    errors : (frames, markers) of inverse kinematics [m], NaN where unseen
    placed : (frames, markers, 3) on the model at its poses [m]
    unit : what stands for one metre, see `length_unit` [m]
    """

    names: Sequence[str]
    observed: Array
    errors: Array
    placed: Array
    unit: float

    @staticmethod
    def of(model: Model, markers: Markers, fit: KinematicsFit) -> FittedMarkers:
        """Collect the markers of a fit.

        Parameters
        ----------
        model : that was fitted
        markers : as recorded (frames, markers, 3) [m], NaN where hidden
        fit : of inverse kinematics
        """
        columns = [markers.names.index(name) for name in fit.marker_names]
        return FittedMarkers(
            names=fit.marker_names,
            observed=markers.values[:, columns],
            errors=fit.marker_error,
            placed=_placed(model, fit),
            unit=length_unit(compile_tree(model)),
        )


class _Tried(NamedTuple):
    """An exchange that fits better.

    Attributes
    ----------
    ratio : root mean square after over before, of the median sample
    swap : the exchange
    """

    ratio: float
    swap: Swap


def find_swap(
    model: Model, fitted: FittedMarkers, solve: Solve, margin: Margin = USUAL
) -> Swap | None:
    """Find the exchange of labels under which the body fits best in most sampled frames.

    Parameters
    ----------
    model : that was fitted
    fitted : its markers
    solve : positions (frames, markers, 3) to errors (frames, markers) [m]
    margin : how much better an exchange must fit

    Returns
    -------
    the exchange, of several that explain about as much that of fewest labels; None where none is
    far better
    """
    rms = marker_rms(fitted.errors)
    seen = np.flatnonzero(np.isfinite(rms)).astype(np.int64)
    if not len(seen):
        return None
    suspect = bool(np.median(rms[seen]) > SUSPECT * fitted.unit)
    hypotheses = _hypotheses(model, fitted.names, crossed_pairs(fitted), suspect, seen)
    trial = _SwapTrial(fitted, solve, margin)
    tried = [(swap, trial.ratio(swap, frames)) for swap, frames in hypotheses]
    # Of exchanges that explain about as much, the one of fewest labels.
    better = sorted(
        (_Tried(ratio, swap) for swap, ratio in tried if ratio is not None),
        key=lambda each: (round(4.0 * each.ratio), len(each.swap.pairs), each.ratio),
    )
    whole = {each.swap.name: each.ratio for each in better if each.swap.name in (SIDES, MIRRORED)}
    if not better or len(whole) < 2 or better[0].swap.name not in whole:
        return better[0].swap if better else None
    best = min(whole, key=lambda name: whole[name])
    certain = whole[best] < CLEARLY * max(whole.values())
    return next(replace(each.swap, certain=certain) for each in better if each.swap.name == best)


class _SwapTrial:
    """Tries exchanges on samples of the frames, each solved once as it was recorded."""

    def __init__(self, fitted: FittedMarkers, solve: Solve, margin: Margin):
        self._fitted = fitted
        self._solve = solve
        self._margin = margin
        self._before: dict[int, float] = {}

    def ratio(self, swap: Swap, frames: NDArray[np.int64]) -> float | None:
        """Compare the fit under an exchange with that of the labels as recorded.

        Parameters
        ----------
        swap : the exchange
        frames : (n,) numbers of those to try it on

        Returns
        -------
        root mean square after over before, of the median sample; None where it is not far better
        in most samples
        """
        columns = swap.columns(self._fitted.names)
        ratios = list[float]()
        gains = list[float]()
        for sample in _spread(frames):
            observed = self._fitted.observed[sample : sample + 1]
            if sample not in self._before:
                self._before[sample] = float(marker_rms(self._solve(observed))[0])
            before = self._before[sample]
            after = float(marker_rms(self._solve(swap.applied(observed, columns)))[0])
            ratios.append(after / before)
            gains.append(before - after)
            # Most exchanges are wrong, which two frames show.
            if len(ratios) == 2 and min(ratios) > self._margin.share:
                break
        fits_most = np.mean(np.array(ratios) < self._margin.share) > 0.6
        gains_enough = np.median(gains) > self._margin.gain * self._fitted.unit
        return float(np.median(ratios)) if fits_most and gains_enough else None


def _spread(frames: NDArray[np.int64]) -> list[int]:
    """Choose a few of the frames, the first two far from each other.

    Parameters
    ----------
    frames : (n,) numbers

    Returns
    -------
    `SWAP_SAMPLES` numbers at most
    """
    order = np.unique(np.linspace(0, len(frames) - 1, SWAP_SAMPLES).astype(int))
    order = np.concatenate([order[1::3], order[2::3], order[::3]])
    return [int(frames[place]) for place in order]


def crossed_pairs(fitted: FittedMarkers) -> Mapping[tuple[str, str], NDArray[np.int64]]:
    """Find pairs of markers, each nearer to the other's position on the model than to its own.

    With y recorded and x on the model, both errors large, a frame counts where

        |y_i - x_j|^2 + |y_j - x_i|^2 < 0.4 (|y_i - x_i|^2 + |y_j - x_j|^2)

    Parameters
    ----------
    fitted : markers as recorded, and as a model fits them

    Returns
    -------
    frames (two or more) of each pair of names
    """
    errors = fitted.errors
    observed = fitted.observed
    placed = fitted.placed
    far = errors > FAR * fitted.unit
    result: dict[tuple[str, str], NDArray[np.int64]] = {}
    for i, j in combinations(np.flatnonzero(far.sum(axis=0) > 0).tolist(), 2):
        both = np.flatnonzero(far[:, i] & far[:, j])
        if len(both):
            straight = errors[both, i] ** 2 + errors[both, j] ** 2
            other = ((observed[both, i] - placed[both, j]) ** 2).sum(axis=1)
            other += ((observed[both, j] - placed[both, i]) ** 2).sum(axis=1)
            frames = both[other < CROSSED * straight]
            if len(frames) > 1:
                result[fitted.names[i], fitted.names[j]] = frames.astype(np.int64)
    return result


def _hypotheses(
    model: Model,
    names: Sequence[str],
    pairs: Mapping[tuple[str, str], NDArray[np.int64]],
    groups: bool,
    seen: NDArray[np.int64],
) -> Iterable[tuple[Swap, NDArray[np.int64]]]:
    """Yield exchanges to try, and the frames to try each on.

    Parameters
    ----------
    model : that was fitted
    names : of the markers
    pairs : of `crossed_pairs`
    groups : try whole sides, limbs and a mirrored recording too
    seen : (n,) numbers of the frames with markers
    """
    for pair, frames in pairs.items():
        yield Swap(f"'{pair[0]}' and '{pair[1]}'", (pair,)), frames
    if not groups:
        return
    sided = side_pairs(names)
    if len(sided) > 1:
        yield Swap(SIDES, sided), seen
        for limb, of_limb in limb_pairs(model, sided).items():
            if 1 < len(of_limb) < len(sided):
                yield Swap(f"{SIDES} of {limb}", of_limb), seen
    if len(names) > 3:
        yield Swap(MIRRORED, ()), seen
    for pair in sided:
        # The trunk turns with a pair that is exchanged, so that the pair itself does not look
        # crossed.
        if model.marker(pair[0]).body == model.marker(pair[1]).body and pair not in pairs:
            yield Swap(f"'{pair[0]}' and '{pair[1]}'", (pair,)), seen
    front = front_pairs(model, sided)
    if front:
        yield Swap(f"{FRONT} of {model.marker(front[0][0]).body}", front), seen


def side_pairs(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Pair markers of the two sides, each pair once."""
    partner = mirror_names(names)
    place = {name: i for i, name in enumerate(names)}
    return tuple(
        (name, partner[name])
        for name in names
        if name in partner and place[name] < place[partner[name]]
    )


def limb_pairs(
    model: Model, sided: Sequence[tuple[str, str]]
) -> dict[str, tuple[tuple[str, str], ...]]:
    """Group pairs of markers by the pair of limbs that they are on.

    Parameters
    ----------
    model : with these markers
    sided : pairs of markers of the two sides

    Returns
    -------
    pairs by the limb's first body; else by their body
    """
    parent = {joint.child: joint.parent for joint in model.joints}
    bodies = mirror_names(model.body_names)
    limbs: dict[str, list[tuple[str, str]]] = {}
    for pair in sided:
        body = model.marker(pair[0]).body
        while body in bodies and parent.get(body, GROUND) in bodies:
            body = parent[body]
        limbs.setdefault(body, []).append(pair)
    return {body: tuple(pairs) for body, pairs in limbs.items()}


def front_pairs(model: Model, sided: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """Pair the front and the back markers of the first body that has both on each side.

    Parameters
    ----------
    model : with these markers
    sided : pairs of markers of the two sides

    Returns
    -------
    two pairs, front and back of each side; none where no body has four such markers
    """
    first = ""
    pairs = list[tuple[str, str]]()
    for first in model.body_names:
        pairs = [
            pair
            for pair in sided
            if model.marker(pair[0]).body == model.marker(pair[1]).body == first
        ]
        if len(pairs) > 1:
            break
    if len(pairs) < 2:
        return ()
    middle = [0.5 * (model.marker(a).location + model.marker(b).location) for a, b in pairs]
    i, j = max(
        combinations(range(len(pairs)), 2),
        key=lambda ij: float(np.linalg.norm(middle[ij[0]] - middle[ij[1]])),
    )
    first_side = [model.marker(name).location for name in pairs[i]]
    across = np.linalg.norm(
        [model.marker(pairs[j][0]).location - place for place in first_side], axis=1
    )
    other = pairs[j] if across[0] < across[1] else pairs[j][::-1]
    return ((pairs[i][0], other[0]), (pairs[i][1], other[1]))


MAX_SWAPS = 4  # Exchanges of labels that are looked for one after the other
SAMPLES = 16  # Frames that are looked at before a body's lengths are known
THROUGHOUT = 0.9  # Share of the frames from which on an exchange is one of all frames


def repaired_labels(model: Model, markers: Markers) -> tuple[Markers, tuple[Finding, ...]]:
    """Exchange labels back that are exchanged throughout, before the lengths of the body are known.

    A calibration would else move the markers on the model to where the exchanged ones lie.

    Parameters
    ----------
    model : of any size
    markers : as recorded (frames, markers, 3) [m], NaN where hidden

    Returns
    -------
    the repaired recording, and findings on what was exchanged

    Raises
    ------
    BadData : model and recording share no marker, or their sizes differ by more than five times
    """
    options = InverseKinematicsOptions()
    names, _ = tracked_markers(model, markers, options)
    columns = [markers.names.index(name) for name in names]
    seen = np.isfinite(markers.values[:, columns]).all(axis=2).sum(axis=1)
    frames = (
        np.flatnonzero(seen >= np.percentile(seen, 75.0)) if len(seen) else np.zeros(0, np.int64)
    )
    if len(frames) < 2 or seen.max() < 3:
        return markers, ()
    chosen = frames[np.unique(np.linspace(0, len(frames) - 1, SAMPLES).astype(int))]
    size = overall_size(model, names, [markers.values[:, columns]])
    bare = skeleton(model)
    sized = scale(bare, dict.fromkeys(bare.body_names, np.full(3, size)))
    sample = markers.frames(chosen)
    fit = inverse_kinematics(sized, sample, options)
    _, findings = swap_findings(sized, sample, fit, options, SwapSearch(margin=OF_ANY_LENGTHS))
    return repaired(markers, (finding for finding in findings if not finding.times))


@dataclass(frozen=True, kw_only=True)
class SwapSearch:
    """Options of the search for exchanged labels.

    Attributes
    ----------
    margin : how much better an exchange must fit
    repair : whether to repair; else the first exchange is only reported
    """

    margin: Margin = USUAL
    repair: bool = True


def swap_findings(
    model: Model,
    markers: Markers,
    fit: KinematicsFit,
    options: InverseKinematicsOptions,
    search: SwapSearch | None = None,
) -> tuple[KinematicsFit, tuple[Finding, ...]]:
    """Find exchanged labels by a fit, and fit again with those exchanged back.

    Parameters
    ----------
    model : that was fitted
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    fit : of inverse kinematics
    options : of inverse kinematics
    search : how exchanges are looked for

    Returns
    -------
    the fit after repairs, and the findings; a mirrored recording is reported and never repaired
    """
    search = search or SwapSearch()
    findings: list[Finding] = []
    for _ in range(MAX_SWAPS):
        names = fit.marker_names
        solve = _solver(model, markers, names, options)
        fitted = FittedMarkers.of(model, markers, fit)
        swap = find_swap(model, fitted, solve, search.margin)
        if swap is None:
            break
        other = inverse_kinematics(model, _put_back(markers, swap, names), options)
        with np.errstate(invalid="ignore"):
            wrong = _smooth(other.rms < max(0.8, search.margin.share) * fit.rms)
        if not wrong.any():
            break
        # A mirrored recording is not repaired: its forces would have to be mirrored too, along an
        # axis that markers hide.
        sure = swap.name != MIRRORED and (swap.certain or wrong.mean() < 0.5)
        finding = _swap_finding(swap, markers, wrong, fit, other, sure)
        findings.append(finding)
        if finding.repair is None or not search.repair:
            break
        markers, _ = repaired(markers, (finding,))
        fit = inverse_kinematics(model, markers, options) if finding.times else other
    return fit, tuple(findings)


def _put_back(
    markers: Markers, swap: Swap, names: Sequence[str], wrong: np.ndarray | None = None
) -> Markers:
    """Undo an exchange of labels, in some frames (frames,) or in all."""
    values = np.array(markers.values)
    columns = [markers.names.index(name) for name in names]
    values[:, columns] = swap.applied(values[:, columns], swap.columns(names))
    kept = values if wrong is None else np.where(wrong[:, None, None], values, markers.values)
    return replace(markers, values=kept)


def _smooth(flags: np.ndarray) -> np.ndarray:
    """Remove runs of one or two frames from flags (frames,)."""
    result = np.array(flags)
    for value in (True, False):
        for start, stop in runs(result == value):
            if stop - start < 3 and start > 0 and stop < len(result):
                result[start:stop] = not value
    return result


def _swap_finding(
    swap: Swap,
    markers: Markers,
    wrong: np.ndarray,
    fit: KinematicsFit,
    other: KinematicsFit,
    sure: bool,
) -> Finding:
    """Describe an exchange with its repair.

    Parameters
    ----------
    swap : the exchange
    markers : before it is undone
    wrong : (frames,) whether the labels are exchanged there
    fit, other : with the labels as recorded and exchanged
    sure : offer a repair
    """
    spans = () if wrong.mean() > THROUGHOUT else spans_of(markers.time, wrong)
    before = 100 * float(np.nanmedian(fit.rms[wrong]))
    after = 100 * float(np.nanmedian(other.rms[wrong]))
    when = times_text(spans) if spans else "throughout"
    fits = f"root mean square error {before:.1f} cm, {after:.1f} cm exchanged"
    if swap.name in (SIDES, MIRRORED) and not (swap.certain and swap.name == SIDES):
        fits = fits.replace("exchanged", "otherwise")
        sides = "the labels of the two sides are swapped (give a map with --labels)"
        mirrored = "one axis of the recording is mirrored (change its sign, in the forces too)"
        why = mirrored if swap.certain else f"either {sides}, or {mirrored}"
        text = MARKERS.message(
            f"left and right are exchanged {when}: {fits}; {why}", severity="changes results"
        )
        return Finding(
            kind="mirrored axis" if swap.certain else "left and right",
            place="all markers",
            text=text,
            times=spans,
        )
    labels = pairs_text(swap.pairs)
    what = f"labels {labels}" if len(swap.pairs) == 1 else f"labels of {swap.name} ({labels})"
    put_back = partial(_put_back, swap=swap, names=fit.marker_names, wrong=wrong if spans else None)
    repair = Repair(put_back, "exchanged back there") if sure else None
    text = MARKERS.message(f"{what} are exchanged {when}, with a {fits}")
    return Finding(
        kind="swapped labels", place=labels.replace("'", ""), text=text, times=spans, repair=repair
    )


def _placed(model: Model, fit: KinematicsFit) -> Array:
    """Locate the model's markers at the poses of a fit: (frames, markers, 3) [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, np.nan_to_num(fit.motion.values))
    return poses.markers([model.marker(name) for name in fit.marker_names])


def _solver(
    model: Model, markers: Markers, names: Sequence[str], options: InverseKinematicsOptions
) -> Solve:
    """Return inverse kinematics of single frames, each searched for anew."""

    def solve(observed: Array) -> Array:
        """Solve single frames from positions (frames, markers, 3) for errors (frames, markers)."""
        errors = np.full(observed.shape[:2], np.nan)
        for index, positions in enumerate(observed):
            if np.isfinite(positions).all(axis=1).any():
                single = Markers(markers.time[:1], tuple(names), positions[None])
                errors[index] = inverse_kinematics(model, single, options).marker_error[0]
        return errors

    return solve

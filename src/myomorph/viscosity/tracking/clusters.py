"""Markers in rigid clusters: which are lost, which bear another's name, which do not belong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.series import Markers
from myomorph.viscosity.specimen.model import Specimen
from myomorph.viscosity.tracking.held import cluster_poses

REPAIRED = 0.9  # Share of the doubtful frames that a change of labels must put right to be believed.
MAX_JOINT_GAP = 0.02  # Distance of two bones' joints from which the labels of one of them are questioned [m].
MAX_UNSEEN = 0.05  # Share of a trial from which a marker that is unseen is named.
MAX_PERMUTED = 5  # Markers of a cluster of which all orders are tried.

Relabel = dict[int, int]


class Clusters:
    """The markers that specimen and recording share, by bone (`columns` of it), with the model's distances."""

    def __init__(self, specimen: Specimen, markers: Markers, tolerance: float):
        self.names, self.tolerance = markers.names, tolerance
        recorded = {name: i for i, name in enumerate(markers.names)}
        self.columns: dict[str, list[int]] = {name: [] for name in specimen.model.body_names}
        places = np.full((len(markers.names), 3), np.nan)
        for marker in specimen.model.markers:
            if marker.name in recorded:
                self.columns[marker.body].append(recorded[marker.name])
                places[recorded[marker.name]] = marker.location
        self.pairs = {bone: list(combinations(range(len(column)), 2)) for bone, column in self.columns.items()}
        self.lengths = {
            bone: np.array([np.linalg.norm(places[column[i]] - places[column[j]]) for i, j in self.pairs[bone]])
            for bone, column in self.columns.items()
        }

    def misfit(self, values: Array, bone: str, relabel: Relabel | None = None) -> Array:
        """(frames, pairs) recorded less modelled distance of a bone's markers, NaN where one is unseen [m]."""
        columns = [(relabel or {}).get(column, column) for column in self.columns[bone]]
        pairs = self.pairs[bone]
        apart = values[:, [columns[i] for i, _ in pairs]] - values[:, [columns[j] for _, j in pairs]]
        return np.linalg.norm(apart, axis=2) - self.lengths[bone]

    def wrong(self, values: Array, bone: str, relabel: Relabel | None = None) -> np.ndarray:
        """(frames,) whether any distance is further off than the tolerance."""
        with np.errstate(invalid="ignore"):
            far = np.abs(self.misfit(values, bone, relabel)) > self.tolerance
        return np.asarray(far.any(axis=1))

    def within(self, bone: str) -> Iterator[Relabel]:
        """Other orders of a cluster's labels; of big clusters, exchanges of two only."""
        columns = self.columns[bone]
        if len(columns) > MAX_PERMUTED:
            yield from ({a: b, b: a} for a, b in combinations(columns, 2))
            return
        for order in permutations(columns):
            if list(order) != columns:
                yield dict(zip(columns, order, strict=True))

    def between(self, first: str, other: str) -> Iterator[Relabel]:
        """Exchanges of one label between two clusters."""
        for a in self.columns[first]:
            for b in self.columns[other]:
                yield {a: b, b: a}


def checked_clusters(specimen: Specimen, markers: Markers, name: str, tolerance: float) -> tuple[Markers, list[str]]:
    """The markers with their own names, what does not belong unseen, and what was found, one line each. Distances
    between the markers of a bone tell, within a tolerance [m] of the model's: exchanged labels are put back where that
    brings all distances right; a single marker that is off its cluster, and whole clusters that no change of labels
    explains, are left out in those frames.
    """
    clusters = Clusters(specimen, markers, tolerance)
    notes = _unmarked(specimen, clusters, name)
    values = np.array(markers.values)
    doubt = {bone: clusters.wrong(values, bone) for bone in clusters.columns}
    patterns = np.array(list(doubt.values()), bool)
    for pattern in np.unique(patterns, axis=1).T if patterns.any() else ():
        bones = [bone for bone, flagged in zip(doubt, pattern, strict=True) if flagged]
        if bones:
            frames = np.flatnonzero((patterns == pattern[:, None]).all(axis=0))
            notes += _put_right(clusters, values, bones, frames, markers.time, name)
    notes += _turned_over(specimen, clusters, values, markers.time, name)
    notes += _lost(clusters, markers.values, markers.time, name)
    return replace(markers, values=values), notes


def _unmarked(specimen: Specimen, clusters: Clusters, name: str) -> list[str]:
    base = clusters.columns[specimen.base]
    model = specimen.model
    if len(base) < 3:
        wanted = [marker.name for marker in model.markers if marker.body == specimen.base]
        recorded = f"{len(base)} markers of the base '{specimen.base}' are recorded, of which three are needed"
        raise BadData(f"trial '{name}': {recorded}; the model names {wanted}")
    marked = [bone for bone in specimen.limb if len(clusters.columns[bone]) >= 2]
    if not marked:
        wanted = [marker.name for marker in model.markers if marker.body != specimen.base]
        seen = f"no bone of the limb shows two of its markers {wanted} in the recording"
        raise BadData(f"trial '{name}': {seen}: name the model's markers as the recording does")
    few = ((bone, len(clusters.columns[bone])) for bone in specimen.limb if bone not in marked)
    text = "markers, so what holds it is not measured"
    return [f"trial '{name}': bone '{bone}' has {count} {text}" for bone, count in few]


def _put_right(
    clusters: Clusters, values: Array, bones: list[str], frames: np.ndarray, time: Array, name: str
) -> list[str]:
    """Relabel some frames in place, or leave out what does not fit in them."""
    when, notes, left = _when(time, frames), [], list(bones)
    tries = [(bone,) for bone in bones] + list(combinations(bones, 2))
    for group in tries:
        if not set(group) <= set(left):
            continue
        relabels = clusters.within(group[0]) if len(group) == 1 else clusters.between(*group)
        best = _best(clusters, values[frames], group, relabels)
        if best:
            columns = list(best)
            values[frames[:, None], columns] = values[frames[:, None], [best[column] for column in columns]]
            left = [bone for bone in left if bone not in group]
            notes.append(_exchanged(clusters, best, when, name))
    for bone in left:
        notes += _leave_out(clusters, values, bone, frames, name, when)
    return notes


def _best(clusters: Clusters, part: Array, bones: Sequence[str], relabels: Iterator[Relabel]) -> Relabel:
    """The change of labels that puts most frames of these bones right, {} if none puts `REPAIRED` of them."""
    best, share = Relabel(), 0.0
    for relabel in relabels:
        fits = ~np.any([clusters.wrong(part, bone, relabel) for bone in bones], axis=0)
        if fits.mean() > share + 1e-9:
            best, share = relabel, float(fits.mean())
    return best if share >= REPAIRED else Relabel()


def _exchanged(clusters: Clusters, relabel: Relabel, when: str, name: str) -> str:
    swapped = [clusters.names[column] for column, new in relabel.items() if column != new]
    return f"trial '{name}': markers {_listed(swapped)} bear each other's names {when}: put right"


def _turned_over(specimen: Specimen, clusters: Clusters, values: Array, time: Array, name: str) -> list[str]:
    """Put right exchanges that distances cannot show, because two sides of a cluster are alike. The bone then seems
    turned over, and its joints do not meet those of the bones beside it: labels are exchanged where that brings the
    joints together.
    """
    notes = []
    places = {marker.name: marker.location for marker in specimen.model.markers}
    for bone, columns in clusters.columns.items():
        orders = [tuple(relabel.get(column, column) for column in columns) for relabel in clusters.within(bone)]
        alike = [order for order in orders if not clusters.wrong(_still(clusters, places, columns, order), bone).any()]
        if not alike or len(columns) < 3:
            continue
        plain = _joint_gap(specimen, clusters, places, values, bone, tuple(columns))
        for order in alike:
            other = _joint_gap(specimen, clusters, places, values, bone, order)
            with np.errstate(invalid="ignore"):
                frames = np.flatnonzero((plain > MAX_JOINT_GAP) & (other < 0.5 * plain))
            if len(frames):
                values[frames[:, None], columns] = values[frames[:, None], list(order)]
                plain[frames] = other[frames]
                notes.append(_exchanged(clusters, dict(zip(columns, order, strict=True)), _when(time, frames), name))
    return notes


def _still(clusters: Clusters, places: Mapping[str, Array], columns: list[int], order: tuple[int, ...]) -> Array:
    """(1, markers, 3) the model's cluster with its labels in another order."""
    values = np.full((1, len(clusters.names), 3), np.nan)
    values[0, columns] = [places[clusters.names[column]] for column in order]
    return values


def _joint_gap(
    specimen: Specimen,
    clusters: Clusters,
    places: Mapping[str, Array],
    values: Array,
    bone: str,
    order: tuple[int, ...],
) -> Array:
    """(frames,) largest distance between where a bone and its neighbors put their joints, in an order of labels [m]."""

    def poses(side: str) -> tuple[Array, Array]:
        columns = clusters.columns[side]
        seen = values[:, list(order) if side == bone else columns]
        return cluster_poses(np.array([places[clusters.names[column]] for column in columns]), seen)

    rotations, origins = poses(bone)
    gaps = [np.full(len(values), np.nan)]
    for joint in specimen.model.joints:
        other = joint.child if joint.parent == bone else joint.parent if joint.child == bone else ""
        if len(clusters.columns.get(other, ())) < 3:
            continue
        turns, places_of_other = poses(other)
        mine, its = joint.parent_frame.translation, joint.child_frame.translation
        if joint.child == bone:
            mine, its = its, mine
        gaps.append(np.linalg.norm(rotations @ mine + origins - turns @ its - places_of_other, axis=1))
    return np.fmax.reduce(gaps)


def _leave_out(clusters: Clusters, values: Array, bone: str, frames: np.ndarray, name: str, when: str) -> list[str]:
    columns, pairs = clusters.columns[bone], clusters.pairs[bone]
    misfit = clusters.misfit(values[frames], bone)
    for i, column in enumerate(columns):
        others = [index for index, pair in enumerate(pairs) if i not in pair]
        if others and (np.abs(misfit[:, others]) < clusters.tolerance).all(axis=1).mean() >= REPAIRED:
            values[frames, column] = np.nan
            return [f"trial '{name}': marker '{clusters.names[column]}' is off its cluster {when}: left out there"]
    if len(frames) > 0.5 * len(values):
        worst = int(np.nanargmax(np.abs(np.nanmedian(misfit, axis=0))))
        first, other = (clusters.names[columns[i]] for i in pairs[worst])
        length = clusters.lengths[bone][worst]
        raise BadData(
            f"trial '{name}': the markers of '{bone}' are not the model's cluster: '{first}' and '{other}' are "
            f"{1000 * (length + np.nanmedian(misfit[:, worst])):.1f} mm apart, in the model {1000 * length:.1f}; "
            "check labels, unit, and the fit of the cluster to the CT"
        )
    values[frames[:, None], columns] = np.nan
    return [f"trial '{name}': the markers of '{bone}' do not fit their cluster {when}: left out there"]


def _lost(clusters: Clusters, values: Array, time: Array, name: str) -> list[str]:
    """Markers unseen for long, a line a bone; all that blink, in one."""
    notes, blinking = [], 0
    for bone, columns in clusters.columns.items():
        seen = np.asarray(np.isfinite(values[:, columns]).all(axis=2))
        share = 1.0 - seen.mean(axis=0)
        blinking += int(((share > 0.0) & (share < MAX_UNSEEN)).sum())
        gone = [clusters.names[column] for column, lost in zip(columns, share, strict=True) if lost >= MAX_UNSEEN]
        if gone:
            frames = np.flatnonzero(~seen[:, share >= MAX_UNSEEN].all(axis=1))
            left = int(seen[frames].sum(axis=1).min())
            how = "it is still solved with its joints" if left == 2 else "it follows the bones beside it"
            which = f"markers {_listed(gone)} are" if len(gone) > 1 else f"marker '{gone[0]}' is"
            notes.append(f"trial '{name}': {which} unseen {_when(time, frames)}; '{bone}' has {left} left there, {how}")
    if blinking:
        under = f"each under {100 * MAX_UNSEEN:.0f} % of it"
        notes.append(f"trial '{name}': {blinking} markers are unseen now and then, {under}")
    return notes


def _when(time: Array, frames: np.ndarray) -> str:
    if len(frames) == len(time):
        return "throughout"
    return f"in {len(frames)} frames between {time[frames[0]]:.2f} and {time[frames[-1]]:.2f} s"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(f"'{name}'" for name in names[:-1]), f"'{names[-1]}'"])

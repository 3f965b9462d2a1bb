"""Markers in rigid clusters: which are lost, which bear another's name, which do not belong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.tracking.held import cluster_poses

# Share of the doubtful frames that a change of labels must put right to be believed.
REPAIRED = 0.9
# Distance of two bones' joints from which the labels of one of them are questioned [m].
MAX_JOINT_GAP = 0.02
MAX_UNSEEN = 0.05  # Share of a trial from which a marker that is unseen is named.
MAX_PERMUTED = 5  # Markers of a cluster of which all orders are tried.

Relabel = dict[int, int]


class Clusters:
    """Markers that specimen and recording share, by bone, with the model's places and distances.

    `columns` are those of each bone; `values` those of the recording, corrected as faults are
    found; `notes` what was found, one line each.
    """

    def __init__(self, specimen: Specimen, markers: Markers, name: str, tolerance: float):
        self.specimen = specimen
        self.markers = markers
        self.name = name
        self.tolerance = tolerance
        self.values = np.array(markers.values)
        self.notes = list[str]()
        recorded = {name: i for i, name in enumerate(markers.names)}
        self.columns: dict[str, list[int]] = {name: [] for name in specimen.model.body_names}
        self.places = np.full((len(markers.names), 3), np.nan)
        for marker in specimen.model.markers:
            if marker.name in recorded:
                self.columns[marker.body].append(recorded[marker.name])
                self.places[recorded[marker.name]] = marker.location
        self.pairs = {
            bone: list(combinations(range(len(column)), 2)) for bone, column in self.columns.items()
        }
        self.lengths = {
            bone: np.array(
                [np.linalg.norm(self.places[column[i]] - self.places[column[j]]) for i, j in pairs]
            )
            for (bone, column), pairs in zip(self.columns.items(), self.pairs.values(), strict=True)
        }

    def misfit(self, values: Array, bone: str, relabel: Relabel | None = None) -> Array:
        """Find recorded less modelled distances of a bone's markers.

        Parameters
        ----------
        values : (frames, markers, 3) [m]
        bone : with the markers
        relabel : columns that take the place of others

        Returns
        -------
        (frames, pairs) NaN where one is unseen [m]
        """
        columns = [(relabel or {}).get(column, column) for column in self.columns[bone]]
        pairs = self.pairs[bone]
        apart = (
            values[:, [columns[i] for i, _ in pairs]] - values[:, [columns[j] for _, j in pairs]]
        )
        return np.linalg.norm(apart, axis=2) - self.lengths[bone]

    def wrong(self, values: Array, bone: str, relabel: Relabel | None = None) -> np.ndarray:
        """Find frames in which any distance is further off than the tolerance.

        Parameters
        ----------
        values : (frames, markers, 3) [m]
        bone : with the markers
        relabel : columns that take the place of others

        Returns
        -------
        (frames,)
        """
        with np.errstate(invalid="ignore"):
            far = np.abs(self.misfit(values, bone, relabel)) > self.tolerance
        return np.asarray(far.any(axis=1))

    def within(self, bone: str) -> Iterator[Relabel]:
        """Yield other orders of a cluster's labels; of big clusters, exchanges of two only."""
        columns = self.columns[bone]
        if len(columns) > MAX_PERMUTED:
            yield from ({a: b, b: a} for a, b in combinations(columns, 2))
            return
        for order in permutations(columns):
            if list(order) != columns:
                yield dict(zip(columns, order, strict=True))

    def between(self, first: str, other: str) -> Iterator[Relabel]:
        """Yield exchanges of one label between two clusters."""
        for a in self.columns[first]:
            for b in self.columns[other]:
                yield {a: b, b: a}

    def note_unmarked(self) -> None:
        """Note bones with fewer markers than show how they move.

        Raises
        ------
        BadData : markers are missing that are needed
        """
        specimen = self.specimen
        markers = self.specimen.model.markers
        base = self.columns[specimen.base]
        if len(base) < 3:
            wanted = [marker.name for marker in markers if marker.body == specimen.base]
            recorded = (
                f"{len(base)} markers of the base '{specimen.base}' are recorded, of which three"
                " are needed"
            )
            raise BadData(f"trial '{self.name}': {recorded}; the model names {wanted}")
        marked = [bone for bone in specimen.limb if len(self.columns[bone]) >= 2]
        if not marked:
            wanted = [marker.name for marker in markers if marker.body != specimen.base]
            seen = f"no bone of the limb shows two of its markers {wanted} in the recording"
            raise BadData(
                f"trial '{self.name}': {seen}: name the model's markers as the recording does"
            )
        few = ((bone, len(self.columns[bone])) for bone in specimen.limb if bone not in marked)
        text = "markers, so what holds it is not measured"
        self.notes += [f"bone '{bone}' has {count} {text}" for bone, count in few]

    def put_right(self) -> None:
        """Relabel frames whose distances are wrong, or leave out what does not fit in them."""
        flags = {bone: self.wrong(self.values, bone) for bone in self.columns}
        patterns = np.array(list(flags.values()), bool)
        for pattern in np.unique(patterns, axis=1).T if patterns.any() else ():
            left = [bone for bone, flagged in zip(flags, pattern, strict=True) if flagged]
            frames = np.flatnonzero((patterns == pattern[:, None]).all(axis=0))
            for group in [(bone,) for bone in left] + list(combinations(left, 2)):
                if not set(group) <= set(left):
                    continue
                relabels = self.within(group[0]) if len(group) == 1 else self.between(*group)
                best = self._best(self.values[frames], group, relabels)
                if best:
                    self._relabel(best, frames)
                    left = [bone for bone in left if bone not in group]
            for bone in left:
                self._leave_out(bone, frames)

    def _best(self, part: Array, bones: Sequence[str], relabels: Iterator[Relabel]) -> Relabel:
        """Choose the change of labels that puts most frames of some bones right.

        It is {} if none puts `REPAIRED` of them.
        """
        best = Relabel()
        share = 0.0
        for relabel in relabels:
            fits = ~np.any([self.wrong(part, bone, relabel) for bone in bones], axis=0)
            if fits.mean() > share + 1e-9:
                best = relabel
                share = float(fits.mean())
        return best if share >= REPAIRED else Relabel()

    def _relabel(self, relabel: Relabel, frames: np.ndarray) -> None:
        self.values[frames[:, None], list(relabel)] = self.values[
            frames[:, None], list(relabel.values())
        ]
        swapped = [self.markers.names[column] for column, new in relabel.items() if column != new]
        self.notes.append(
            f"markers {_listed(swapped)} are exchanged {self._when(frames)}: corrected"
        )

    def turn_over(self) -> None:
        """Put right exchanges that distances cannot show, because two sides of a cluster are alike.

        The bone then seems turned over, and its joints do not meet those of the bones beside it:
        labels are exchanged where that brings the joints together.
        """
        for bone, columns in self.columns.items():
            orders = [
                [relabel.get(column, column) for column in columns] for relabel in self.within(bone)
            ]
            alike = [
                order for order in orders if not self.wrong(self._still(columns, order), bone).any()
            ]
            if not alike or len(columns) < 3:
                continue
            plain = self._joint_gap(bone, columns)
            for order in alike:
                other = self._joint_gap(bone, order)
                with np.errstate(invalid="ignore"):
                    frames = np.flatnonzero((plain > MAX_JOINT_GAP) & (other < 0.5 * plain))
                if len(frames):
                    self._relabel(dict(zip(columns, order, strict=True)), frames)
                    plain[frames] = other[frames]

    def _still(self, columns: list[int], order: list[int]) -> Array:
        """Return the model's cluster (1, markers, 3) with its labels in another order."""
        values = np.full((1, *self.places.shape), np.nan)
        values[0, columns] = self.places[order]
        return values

    def _joint_gap(self, bone: str, order: list[int]) -> Array:
        """Find how far a bone, its labels in an order, and its neighbors put joints apart.

        Returns
        -------
        (frames,) the largest distance [m]
        """

        def poses(side: str) -> tuple[Array, Array]:
            columns = self.columns[side]
            return cluster_poses(
                self.places[columns], self.values[:, order if side == bone else columns]
            )

        rotations, origins = poses(bone)
        gaps = [np.full(len(self.values), np.nan)]
        for joint in self.specimen.model.joints:
            if joint.parent == bone:
                other = joint.child
            elif joint.child == bone:
                other = joint.parent
            else:
                other = ""
            if len(self.columns.get(other, ())) < 3:
                continue
            turns, places_of_other = poses(other)
            mine = joint.parent_frame.translation
            its = joint.child_frame.translation
            if joint.child == bone:
                mine, its = its, mine
            gaps.append(
                np.linalg.norm(rotations @ mine + origins - turns @ its - places_of_other, axis=1)
            )
        return np.fmax.reduce(gaps)

    def _leave_out(self, bone: str, frames: np.ndarray) -> None:
        columns = self.columns[bone]
        pairs = self.pairs[bone]
        when = self._when(frames)
        misfit = self.misfit(self.values[frames], bone)
        for i, column in enumerate(columns):
            others = [index for index, pair in enumerate(pairs) if i not in pair]
            if (
                others
                and (np.abs(misfit[:, others]) < self.tolerance).all(axis=1).mean() >= REPAIRED
            ):
                self.values[frames, column] = np.nan
                self.notes.append(
                    f"marker '{self.markers.names[column]}' is off its cluster {when}: left out"
                    " there"
                )
                return
        if len(frames) > 0.5 * len(self.values):
            worst = int(np.nanargmax(np.abs(np.nanmedian(misfit, axis=0))))
            first_index, other_index = pairs[worst]
            first = self.markers.names[columns[first_index]]
            other = self.markers.names[columns[other_index]]
            length = self.lengths[bone][worst]
            raise BadData(
                f"trial '{self.name}': the markers of '{bone}' are not the model's cluster:"
                f" '{first}' and '{other}' are"
                f" {1000 * (length + np.nanmedian(misfit[:, worst])):.1f} mm apart, in the model"
                f" {1000 * length:.1f}; check labels, unit, and the fit of the cluster to the CT"
            )
        self.values[frames[:, None], columns] = np.nan
        self.notes.append(
            f"the markers of '{bone}' do not fit their cluster {when}: left out there"
        )

    def note_lost(self) -> None:
        """Note markers unseen for long, a line a bone, and all that blink, in one."""
        blinking = 0
        for bone, columns in self.columns.items():
            seen = np.asarray(np.isfinite(self.markers.values[:, columns]).all(axis=2))
            share = 1.0 - seen.mean(axis=0)
            blinking += int(((share > 0.0) & (share < MAX_UNSEEN)).sum())
            lost = share >= MAX_UNSEEN
            gone = [
                self.markers.names[column]
                for column, for_long in zip(columns, lost, strict=True)
                if for_long
            ]
            if gone:
                frames = np.flatnonzero(~seen[:, lost].all(axis=1))
                left = int(seen[frames].sum(axis=1).min())
                how = (
                    "it is still solved with its joints"
                    if left == 2
                    else "it follows the adjacent bones"
                )
                which = (
                    f"markers {_listed(gone)} are" if len(gone) > 1 else f"marker '{gone[0]}' is"
                )
                self.notes.append(
                    f"{which} hidden {self._when(frames)}; '{bone}' has {left} left there, {how}"
                )
        if blinking:
            under = f"each under {100 * MAX_UNSEEN:.0f} % of it"
            self.notes.append(f"{blinking} markers are hidden now and then, {under}")

    def _when(self, frames: np.ndarray) -> str:
        time = self.markers.time
        if len(frames) == len(time):
            return "throughout"
        return f"in {len(frames)} frames between {time[frames[0]]:.2f} and {time[frames[-1]]:.2f} s"


def checked_clusters(
    specimen: Specimen, markers: Markers, name: str, tolerance: float
) -> tuple[Markers, list[str]]:
    """Give markers their own names, and leave out what does not belong.

    Distances between the markers of a bone tell: exchanged labels are put back where that brings
    all distances right; a single marker that is off its cluster, and whole clusters that no change
    of labels explains, are left out in those frames.

    Parameters
    ----------
    specimen : with the model's distances
    markers : of the recording
    name : of the trial
    tolerance : of a distance [m]

    Returns
    -------
    the markers, and what was found, one line each
    """
    clusters = Clusters(specimen=specimen, markers=markers, name=name, tolerance=tolerance)
    clusters.note_unmarked()
    clusters.put_right()
    clusters.turn_over()
    clusters.note_lost()
    return replace(markers, values=clusters.values), [
        f"trial '{name}': {note}" for note in clusters.notes
    ]


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(f"'{name}'" for name in names[:-1]), f"'{names[-1]}'"])

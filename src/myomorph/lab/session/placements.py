"""Recordings in which markers are where they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from myomorph.core.model.errors import few
from myomorph.lab.session.body_measures import BodyMeasures, pooled
from myomorph.lab.session.body_odds import BodyOdds, body_odds
from myomorph.lab.session.evidence import Evidence

SAME_LABELS = 0.8  # Share of labels that recordings of one marker set have in common.


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """Recordings in which markers are where they were: of one body in one session.

    Attributes
    ----------
    recordings : evidence by the number of the recording, the one first that says most
    measures : of all of them
    """

    recordings: dict[int, Evidence]
    measures: BodyMeasures

    @staticmethod
    def of(recordings: dict[int, Evidence]) -> Placement:
        """Pool the measures of recordings."""
        measures = pooled([one.measures for one in recordings.values()])
        return Placement(recordings=recordings, measures=measures)

    @property
    def names(self) -> str:
        """Names of files, the first of many."""
        return few([one.path.stem for _, one in sorted(self.recordings.items())])

    def odds(self, other: Placement) -> BodyOdds:
        """Compare bodies with another placement."""
        return body_odds(self.measures, other.measures, self.same_markers(other))

    def same_markers(self, other: Placement) -> bool:
        """Whether both have the markers of one set."""
        return self.shared_labels(other) >= SAME_LABELS

    def shared_labels(self, other: Placement) -> float:
        """Most of the labels that recordings of both share."""
        return max(
            one.shared_labels(another)
            for one in self.recordings.values()
            for another in other.recordings.values()
        )

    def named_apart(self, other: Placement) -> bool:
        """Whether names say that two people were recorded."""
        return any(
            one.named_apart(another)
            for one in self.recordings.values()
            for another in other.recordings.values()
        )

    def is_beside(self, other: Placement) -> bool:
        """Whether files of both lie in one folder."""
        folders = {one.path.parent for one in self.recordings.values()}
        return any(one.path.parent in folders for one in other.recordings.values())

    def shares_name(self, other: Placement) -> bool:
        """Whether a name ties recordings of both."""
        return any(
            one.shares_name(another)
            for one in self.recordings.values()
            for another in other.recordings.values()
        )


def placements_of(recordings: Sequence[Evidence]) -> list[Placement]:
    """Group recordings by placement of markers; those first that say most of who they are of."""

    def says_little(index: int) -> tuple[bool, int, int]:
        one = recordings[index]
        return not one.named, -len(one.measures.lengths), index

    found: list[Placement] = []
    for index in sorted(range(len(recordings)), key=says_little):
        alone = Placement.of({index: recordings[index]})
        odds = [placement.odds(alone) for placement in found]
        same = [
            number
            for number, (placement, one) in enumerate(zip(found, odds, strict=True))
            if one.one_placement(placement.named_apart(alone) or not placement.same_markers(alone))
        ]
        if same:
            best = min(same, key=lambda number: odds[number].mean_square)
            found[best] = Placement.of(found[best].recordings | alone.recordings)
        else:
            found.append(alone)
    return found

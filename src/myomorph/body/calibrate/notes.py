"""What of a calibration is uncertain, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.calibration import LengthEstimate, MarkerEstimate, SideEstimate
from myomorph.body.calibrate.recorded import RecordedMarkers
from myomorph.body.calibrate.shared_fit import Search
from myomorph.body.causes import CALIBRATION, SEARCH, SIDES
from myomorph.core.model.causes import MARKERS
from myomorph.core.model.errors import listing
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.motion.lengths import segments_that_stretch

MIN_FRAMES = 10  # With fewer, lengths come mostly from the given model
# A marker farther than this from its place on the model may be another one [length units]
MAX_SHIFT = 0.1
MIN_MARKERS = 3  # A segment with fewer can turn without showing it [markers]


def search_notes(search: Search) -> Iterator[Message]:
    """Report what the search could not find.

    Parameters
    ----------
    search : where it ended

    Yields
    ------
    sentences
    """
    found = search.found
    frames = sum(len(angles) for angles in found.point.angles)
    if frames < MIN_FRAMES:
        yield CALIBRATION.message(
            f"only {frames} frames: lengths and marker positions come mostly from the given model"
        )
    if not search.noise_found:
        yield CALIBRATION.message(
            f"too few frames to determine the noise: assumed to be {1e3 * search.stage.noise:g} mm",
            severity="good to know",
        )
    if not found.converged:
        yield (
            SEARCH.message(
                f"not converged after {search.steps} steps, last change {found.change:.1g}:"
                " allow more iterations"
            )
        )
    if found.point.settled < 1.0:
        lost = 100.0 * (1.0 - found.point.settled)
        yield SEARCH.message(f"the angles of {lost:.0f} % of the frames did not converge")


def length_notes(lengths: Sequence[LengthEstimate]) -> Iterator[Message]:
    """Report lengths from joint to joint that are not identifiable.

    Parameters
    ----------
    lengths : as estimated

    Yields
    ------
    one sentence, or none
    """
    hidden = [
        estimate.length.name for estimate in lengths if estimate.length.along and not estimate.shown
    ]
    if hidden:
        yield (
            CALIBRATION.message(
                f"the recordings do not determine {', '.join(hidden)}: they follow the overall size"
                " and"
                " their neighbors"
            )
        )


def marker_notes(markers: Sequence[MarkerEstimate], unit: float) -> Iterator[Message]:
    """Report markers that lie farther from their places than markers are put.

    Parameters
    ----------
    markers : as estimated
    unit : `length_unit` of the body

    Yields
    ------
    one sentence, or none
    """
    limit = MAX_SHIFT * unit
    far = [marker.name for marker in markers if float(np.linalg.norm(marker.shift)) > limit]
    if far:
        yield (
            MARKERS.message(
                f"more than {100 * limit:.3g} cm from their positions on the given model:"
                f" {', '.join(far)}; check whether their names are those of the model"
            )
        )


def side_notes(sides: Sequence[SideEstimate]) -> Iterator[Message]:
    """Report sides that differ: a longer leg or arm, or a fault of markers that looks like it.

    Parameters
    ----------
    sides : as estimated

    Yields
    ------
    one sentence, or none
    """
    differing = [
        f"{side.first} less {side.second} {100.0 * side.difference:+.1f} % (SD"
        f" {100.0 * side.sd:.1f} %)"
        for side in sides
        if side.differs
    ]
    if differing:
        yield (
            SIDES.message(
                f"sides differ more than side_sd allows: {', '.join(differing)}; they were set"
                " free: check whether the person is asymmetric, or markers of one side are placed"
                " asymmetrically"
            )
        )


class _FewMarkers(NamedTuple):
    """A segment that few markers show.

    Attributes
    ----------
    title : body and the markers that are seen
    missing : markers of the model that no recording shows there
    """

    title: str
    missing: tuple[str, ...]


def few_marker_notes(model: Model, recorded: RecordedMarkers) -> Iterator[Message]:
    """Report segments that only one or two markers show.

    Also the model's markers that are missing there, and recorded ones that the model does not know.

    Parameters
    ----------
    model : with its markers
    recorded : which of them are fitted

    Yields
    ------
    one sentence, or none
    """
    segments = _segments_of_few(model, _seen(recorded))
    if not segments:
        return
    titles = ", ".join(segment.title for segment in segments)
    text = f"segments that fewer than {MIN_MARKERS} markers show: {titles}"
    missing = [name for segment in segments for name in segment.missing]
    if missing:
        text += f"; the model also has {', '.join(missing)} there, which are in no recording"
        names = {name for recording in recorded.recordings for name in recording.names}
        unknown = sorted(names - set(model.marker_names))
        if unknown:
            text += f" (recorded and unknown to the model: {listing(missing[0], unknown)})"
    yield CALIBRATION.message(text)


def _seen(recorded: RecordedMarkers) -> set[str]:
    """Names of fitted markers that any frame shows."""
    seen: set[str] = set()
    for recording in recorded.recordings:
        shown = np.asarray(np.isfinite(recording.values).any(axis=(0, 2)))
        seen.update(recording.names[column] for column in np.flatnonzero(shown))
    return seen & set(recorded.names)


def _segments_of_few(model: Model, seen: set[str]) -> list[_FewMarkers]:
    """Find segments that few markers show.

    Two that the model was made with show a segment together with its joint; two that are left over
    may not.
    """
    segments = []
    for bodies in segments_that_stretch(model):
        here = [marker.name for marker in model.markers if marker.body in bodies]
        shown = [name for name in here if name in seen]
        if len(shown) == 1 or 0 < len(shown) < min(MIN_MARKERS, len(here)):
            segment = _FewMarkers(
                title=f"{bodies[0]} ({', '.join(shown)})",
                missing=tuple(name for name in here if name not in seen),
            )
            segments.append(segment)
    return segments

"""Vertical force under the feet as measured: offsets, contacts with their exact ends, shares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.analysis.phases import SHORTEST_CONTACT, THRESHOLD, contacts

UNLOADED = 0.1
"""Nobody stands on a plate that carries less than this share of body weight."""
MIN_UNLOADED = 0.05
"""Its offset is known where that lasts so long in all [s]."""
BOTH = 0.95
"""Shares of the legs are known where both carry at least this share of the whole force."""
GRAVITY = 9.80665


@dataclass(frozen=True, kw_only=True)
class Contact:
    """When something is on the ground [s].

    Attributes
    ----------
    start, stop : between samples, where the force passes the threshold
    begins, ends : whether that is within the recording
    """

    start: float
    stop: float
    begins: bool
    ends: bool

    @property
    def duration(self) -> float:
        """Of the contact [s]."""
        return self.stop - self.start


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class SupportForce:
    """Vertical force under the feet, without a low-pass filter.

    Attributes
    ----------
    time : (samples,) of the plates [s]
    total : (samples,) of both feet [N]
    right, left : (samples,) of one foot [N], None where plates do not tell the feet apart
    weight : of the body [N]
    """

    time: Array
    total: Array
    right: Array | None
    left: Array | None
    weight: float

    @classmethod
    def of(
        cls,
        time: Array,
        weight: float,
        right: Array | None,
        left: Array | None,
        both: Array | None = None,
    ) -> SupportForce:
        """Make it of the forces of plates.

        Parameters
        ----------
        time : (samples,) [s]
        weight : of the body [N]
        right, left : (samples,) under one foot [N], None where no plate is under it alone
        both : (samples,) under both feet together, None where no plate is [N]

        Returns
        -------
        forces by foot, and their sum
        """
        known = [force for force in (right, left, both) if force is not None]
        total = np.sum(known, axis=0) if known else np.zeros(len(time))
        return cls(time=time, total=total, right=right, left=left, weight=weight)

    def zeroed(self) -> SupportForce:
        """Take the offsets of plates off, as somebody who runs or jumps leaves them.

        Feet that only rest on a plate, as on a seat, carry little too: there it is no offset.
        """

        def less(force: Array | None) -> Array | None:
            return None if force is None else zeroed(self.time, force, self.weight)

        both = self.total - sum(force for force in (self.right, self.left) if force is not None)
        shared = both if np.abs(both).max(initial=0.0) > 0.0 else None
        return SupportForce.of(
            self.time, self.weight, less(self.right), less(self.left), less(shared)
        )

    def of_side(self, side: str) -> Array | None:
        """Force under one foot.

        Parameters
        ----------
        side : "right" or "left"

        Returns
        -------
        (samples,) [N], None where it is not known
        """
        return self.right if side == "right" else self.left

    def contacts(self, force: Array) -> tuple[Contact, ...]:
        """Find when a force is over 3 % of body weight.

        Parameters
        ----------
        force : (samples,) [N]

        Returns
        -------
        in order of time
        """
        return find_contacts(self.time, force, self.weight)

    def inside(self, start: float, stop: float) -> slice:
        """Find the samples within a span of time [s]."""
        first, last = np.searchsorted(self.time, (start - 1e-9, stop + 1e-9))
        return slice(int(first), int(last))

    def right_share(self, start: float, stop: float) -> float:
        """Return the share of the right foot in the impulse of both feet.

        Parameters
        ----------
        start, stop : from when to when [s]

        Returns
        -------
        [%], NaN where the feet are not told apart
        """
        if self.right is None or self.left is None:
            return float("nan")
        part = self.inside(start, stop)
        right = impulse(self.time[part], self.right[part])
        both = right + impulse(self.time[part], self.left[part])
        whole = impulse(self.time[part], self.total[part])
        return 100.0 * right / both if both > BOTH * whole > 0.0 else float("nan")


def impulse(time: Array, force: Array) -> float:
    """Add up a force over time, by the trapezoidal rule.

    Parameters
    ----------
    time, force : (samples,) [s], [N]

    Returns
    -------
    [N s], 0 for fewer than two samples
    """
    return float(0.5 * (force[1:] + force[:-1]) @ np.diff(time))


def accumulated(time: Array, values: Array, start: float = 0.0) -> Array:
    """Integrate over time, by the trapezoidal rule.

    Parameters
    ----------
    time, values : (samples,) [s], and a rate
    start : value at the first sample

    Returns
    -------
    (samples,)
    """
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
    return start + np.concatenate([[0.0], np.cumsum(steps)])


def zeroed(time: Array, force: Array, weight: float) -> Array:
    """Take the offset off a plate: the median of what it reads with nobody on it.

    Parameters
    ----------
    time, force : (samples,) [s], [N]
    weight : of the body [N]

    Returns
    -------
    (samples,) [N], as it is where somebody stands on the plate all the time
    """
    force = np.nan_to_num(force)
    unloaded = np.abs(force) < UNLOADED * weight
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if unloaded.sum() * step < MIN_UNLOADED:
        return force
    return np.asarray(force - np.median(force[unloaded]))


def find_contacts(time: Array, force: Array, weight: float) -> tuple[Contact, ...]:
    """Find contacts, and between which samples they begin and end.

    Parameters
    ----------
    time, force : (samples,) [s], [N], without an offset
    weight : of the body [N]

    Returns
    -------
    in order of time
    """
    threshold = THRESHOLD * weight
    found = []
    for first, last in contacts(time, force, threshold, SHORTEST_CONTACT):
        loaded = np.flatnonzero(force[first : last + 1] >= 3.0 * threshold) + first
        if not len(loaded):
            continue
        before = np.flatnonzero(force[: loaded[0]] < threshold)
        after = np.flatnonzero(force[loaded[-1] :] < threshold) + loaded[-1]
        found.append(
            Contact(
                start=_crossing(time, force, int(before[-1]), threshold)
                if len(before)
                else float(time[0]),
                stop=_crossing(time, force, int(after[0]) - 1, threshold)
                if len(after)
                else float(time[-1]),
                begins=bool(len(before)),
                ends=bool(len(after)),
            )
        )
    return tuple(found)


def _crossing(time: Array, force: Array, sample: int, level: float) -> float:
    """Return when the line through a sample and the next one passes a level [s]."""
    change = force[sample + 1] - force[sample]
    share = (level - force[sample]) / change if change else 0.0
    return float(time[sample] + np.clip(share, 0.0, 1.0) * (time[sample + 1] - time[sample]))

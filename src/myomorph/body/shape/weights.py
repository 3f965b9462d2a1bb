"""Weight maps: the share of each mass point in each link.

w_ij of [D] eq. 3.7 to 3.8 and 3.14 to 3.15.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.body.shape.points import Links
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.kernels import in_place, kernel

WeightMap = Callable[[Array, Links], "scipy.sparse.csr_array"]
"""Points (points, 3) in ground [m] and links in the same pose -> shares (points, links), rows sum
to 1.
"""

# Shares below this are dropped, and what remains of the point is scaled to sum to 1 again
SMALLEST = 1e-4
MIN_MASS_SHARE = 1e-6  # Of the model's mass, below which a body is a phantom
MAX_SUM_ERROR = 1e-6  # Of the shares of a point
MIN_SQUARE = 1e-24  # Distances below its root count as this [m^2]
CHUNK = 4096
NEAREST = np.inf


def cog_weights(
    points: Array,
    links: Links,
    *,
    exponent: float = 4.0,
    taking: ArrayLike | None = None,
    smallest: float = SMALLEST,
) -> scipy.sparse.csr_array:
    """Compute shares by the distance to the links' mass centers, w_d of [D] eq. 3.14.

    They are as |p_ij|^-exponent.

    Parameters
    ----------
    points : (points, 3) in ground [m]
    links : in the same pose
    exponent : 4 in the paper
    taking : (links,) whether a link may have a share; `links_with_mass` leaves out massless ones
    smallest : shares below it are dropped and the others scaled to sum to 1; 0 keeps all

    Returns
    -------
    (points, links) whose rows sum to 1

    Raises
    ------
    BadData : a point is not finite, the exponent is not above 0, or no link may have a share
    """
    law = _Law(exponent=_positive(exponent), smallest=smallest)
    return _inverse_distance(points, links, _centers(links, taking), law)


def nearest_weights(
    points: Array, links: Links, *, taking: ArrayLike | None = None
) -> scipy.sparse.csr_array:
    """Give each point to the link of the nearest mass center, w_n of [D] eq. 3.15.

    With min for argmin.

    Parameters
    ----------
    points : (points, 3) in ground [m]
    links : in the same pose
    taking : (links,) whether a link may have a share

    Returns
    -------
    (points, links) of 0 and 1

    Raises
    ------
    BadData : a point is not finite, or no link may have a share
    """
    law = _Law(exponent=NEAREST, smallest=0.0)
    return _inverse_distance(points, links, _centers(links, taking), law)


def bone_weights(
    points: Array,
    links: Links,
    *,
    exponent: float = 4.0,
    taking: ArrayLike | None = None,
    smallest: float = SMALLEST,
) -> scipy.sparse.csr_array:
    """Compute shares by the distance to the links' bones, w_b.

    They are as d_ij^-exponent of the distance to the straight pieces `links.bones`. A long segment
    keeps the points along it, which the distance to its mass center gives to the ends' neighbors.

    Parameters
    ----------
    points : (points, 3) in ground [m]
    links : in the same pose, with bones
    exponent : infinity gives each point to the nearest bone
    taking : (links,) whether a link may have a share
    smallest : shares below it are dropped and the others scaled to sum to 1; 0 keeps all

    Returns
    -------
    (points, links) whose rows sum to 1

    Raises
    ------
    BadData : a link that may have a share has no bone, or as in `cog_weights`
    """
    wanted = _taking(links, taking)
    missing = sorted(set(np.flatnonzero(wanted)) - set(links.bone_links.tolist()))
    if missing:
        raise BadData(
            f"link '{links.names[missing[0]]}' has no bone to measure to: give bones, or leave"
            " it out"
        )
    counted = wanted[links.bone_links]
    bones = _Segments(ends=links.bones[counted], owners=links.bone_links[counted])
    law = _Law(exponent=_positive(exponent), smallest=smallest)
    return _inverse_distance(points, links, bones, law)


def checked_weights(
    weights: scipy.sparse.spmatrix | ArrayLike, points: Array, links: Links
) -> scipy.sparse.csr_array:
    """Check that weights of any map are shares.

    Parameters
    ----------
    weights : (points, links)
    points : (points, 3)
    links : of the columns

    Returns
    -------
    (points, links)

    Raises
    ------
    BadData : the shape is another, a weight is negative or not finite, or a row does not sum to 1
    """
    checked = scipy.sparse.csr_array(weights, dtype=np.float64)
    expected = (len(points), len(links.names))
    if checked.shape != expected:
        raise BadData(
            f"expected weights (points, links) of shape {expected}, but got {checked.shape}"
        )
    if not np.isfinite(checked.data).all() or (checked.data < 0.0).any():
        raise BadData(
            "a weight map gave a weight that is negative or not finite: expected shares from 0 to 1"
        )
    error = np.abs(checked.sum(axis=1) - 1.0)
    if len(points) and error.max() > MAX_SUM_ERROR:
        j = int(error.argmax())
        raise BadData(f"the weights of point {j} sum to {checked.sum(axis=1)[j]:.6g}: expected 1")
    return checked


def links_with_mass(model: Model, density: float = 10.0) -> np.ndarray:
    """Find bodies that are no phantoms, frames that models give a little mass of no meaning.

    A body is one where its mass is at least `density` times the cube of its radius of gyration
    (tissue has about 1000), and a millionth of the model's: a meter for ten grams, as phantoms
    have, is not a body.

    Parameters
    ----------
    model : with masses
    density : least mass over the cube of the radius of gyration [kg/m^3]

    Returns
    -------
    (links,) whether it is a body
    """
    masses = np.array([body.mass for body in model.bodies])
    inertia = np.array([np.trace(body.inertia) for body in model.bodies])
    mean_squares = np.divide(0.5 * inertia, masses, out=np.zeros_like(masses), where=masses > 0.0)
    gyration = np.sqrt(mean_squares)
    has_mass = masses > MIN_MASS_SHARE * masses.sum()
    return has_mass & (masses >= density * gyration**3)


def _taking(links: Links, taking: ArrayLike | None) -> np.ndarray:
    """Check which links may have a share; all where nothing is stated.

    Raises
    ------
    BadData : there is not one value for each link, or no link is left
    """
    wanted = np.ones(len(links.names), bool) if taking is None else np.asarray(taking, bool)
    if wanted.shape != (len(links.names),):
        raise BadData(
            f"expected one yes or no for each of {len(links.names)} links, but got shape"
            f" {wanted.shape}"
        )
    if not wanted.any():
        raise BadData("no link may have a share of the mass points: leave at least one in")
    return wanted


class _Segments(NamedTuple):
    """Straight segments that distances are measured to.

    Attributes
    ----------
    ends : (segments, 2, 3) [m]
    owners : (segments,) link of each
    """

    ends: Array
    owners: np.ndarray


class _Law(NamedTuple):
    """How shares follow distances.

    Attributes
    ----------
    exponent : shares are as distance^-exponent; infinity gives all to the nearest
    smallest : shares below it are dropped
    """

    exponent: float
    smallest: float


class _Lines(NamedTuple):
    """Segments as kernels read them.

    Attributes
    ----------
    start : (segments, 3) [m]
    along : (segments, 3) direction with its length [m]
    inverse : (segments,) of the squared length, 0 for a point [1/m^2]
    owner : (segments,) link of each
    """

    start: Array
    along: Array
    inverse: Array
    owner: np.ndarray

    @classmethod
    def of(cls, segments: _Segments) -> _Lines:
        """Split segments into starts and directions."""
        along = segments.ends[:, 1] - segments.ends[:, 0]
        square = np.einsum("pi,pi->p", along, along)
        return cls(
            start=np.array(segments.ends[:, 0]),
            along=along,
            inverse=np.divide(1.0, square, out=np.zeros_like(square), where=square > 0.0),
            owner=segments.owners.astype(np.int64),
        )


class _Entries(NamedTuple):
    """Entries of a sparse matrix, row by row.

    Attributes
    ----------
    columns : (entries,) links
    shares : (entries,)
    """

    columns: np.ndarray
    shares: Array


def _centers(links: Links, taking: ArrayLike | None) -> _Segments:
    """Take mass centers as segments without length."""
    owners = np.flatnonzero(_taking(links, taking))
    return _Segments(ends=np.repeat(links.centers[owners, None], 2, axis=1), owners=owners)


def _positive(exponent: float) -> float:
    """Return the exponent; raise `BadData` where it is not above 0."""
    if not exponent > 0.0:
        raise BadData(f"the exponent of a weight map is {exponent:g}: expected above 0")
    return exponent


def _inverse_distance(
    points: Array, links: Links, segments: _Segments, law: _Law
) -> scipy.sparse.csr_array:
    """Compute shares by the distance to segments of links.

    Parameters
    ----------
    points : (points, 3) in ground [m]
    segments : of the links
    law : of the shares

    Returns
    -------
    (points, links)
    """
    x = np.array(points, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(x).all():
        raise BadData("a mass point is not finite")
    lines = _Lines.of(segments)
    link_count = len(links.names)
    counts = np.zeros(len(x), np.int64)
    empty = _Entries(columns=np.zeros(0, np.int32), shares=np.zeros(0))
    parts = [empty] * max(-(-len(x) // CHUNK), 1)

    def fill(start: int, stop: int) -> None:
        room = _Entries(
            columns=np.empty((stop - start) * link_count, np.int32),
            shares=np.empty((stop - start) * link_count),
        )
        used = _shares(x[start:stop], lines, link_count, law, room, counts[start:stop])
        parts[start // CHUNK] = _Entries(
            columns=room.columns[:used].copy(), shares=room.shares[:used].copy()
        )

    over_frames(fill, len(x), chunk=CHUNK)
    columns = np.concatenate([part.columns for part in parts])
    shares = np.concatenate([part.shares for part in parts])
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return scipy.sparse.csr_array((shares, columns, first), shape=(len(x), link_count))


@kernel
def _shares(x, lines, link_count, law, entries, counts):
    """Compute shares of points one after the other; return how many entries were written.

    Parameters
    ----------
    x : (points, 3) [m]
    lines : `_Lines`
    link_count : number of links
    law : `_Law`
    entries : `_Entries`, filled
    counts : (points,) filled with the number of entries of each point
    """
    squared = np.empty(link_count)
    used = 0
    for j in range(x.shape[0]):
        squared[:] = np.inf
        nearest = 0
        least = np.inf
        for p in range(lines.start.shape[0]):
            square = _squared_distance(x, j, lines, p)
            owner = lines.owner[p]
            squared[owner] = min(squared[owner], square)
            if square < least:
                nearest = owner
                least = square
        first = used
        if law.exponent == np.inf:
            entries.columns[used] = nearest
            entries.shares[used] = 1.0
            used += 1
        else:
            used = _add_shares(squared, least, law, entries, used)
        counts[j] = used - first
    return used


@in_place
def _squared_distance(x, j, lines, p):
    """Square of the distance of a point from a segment [m^2]."""
    a = x[j, 0] - lines.start[p, 0]
    b = x[j, 1] - lines.start[p, 1]
    c = x[j, 2] - lines.start[p, 2]
    t = (a * lines.along[p, 0] + b * lines.along[p, 1] + c * lines.along[p, 2]) * lines.inverse[p]
    t = min(max(t, 0.0), 1.0)
    a = a - t * lines.along[p, 0]
    b = b - t * lines.along[p, 1]
    c = c - t * lines.along[p, 2]
    return max(a * a + b * b + c * c, MIN_SQUARE)


@in_place
def _add_shares(squared, least, law, entries, used):
    """Add the shares of a point, scaled to sum to 1; return how many entries there are then.

    Shares relative to the nearest link's neither overflow nor lose digits.

    Parameters
    ----------
    squared : (links,) squared distances [m^2], overwritten
    least : the least of them
    law : `_Law`
    entries : `_Entries`, filled
    used : number of entries so far
    """
    total = 0.0
    for i in range(squared.shape[0]):
        ratio = least / squared[i]
        squared[i] = ratio * ratio if law.exponent == 4.0 else ratio ** (0.5 * law.exponent)
        total += squared[i]
    kept = 0.0
    first = used
    for i in range(squared.shape[0]):
        if squared[i] > 0.0 and squared[i] >= law.smallest * total:
            entries.columns[used] = i
            entries.shares[used] = squared[i]
            kept += squared[i]
            used += 1
    for entry in range(first, used):
        entries.shares[entry] /= kept
    return used

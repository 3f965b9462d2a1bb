"""Weight maps: the share of each mass point in each link.

w_ij of [D] eq. 3.7 to 3.8 and 3.14 to 3.15.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.body.shape.points import Links
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.kernels import kernel

WeightMap = Callable[[Array, Links], "scipy.sparse.csr_array"]
"""Points (points, 3) in ground [m] and links in the same pose -> shares (points, links), rows sum
to 1.
"""

# Shares below this are dropped, and what remains of the point is scaled to sum to 1 again
SMALLEST = 1e-4
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
    pieces, owners = _centers(links, taking)
    return _inverse_distance(points, links, pieces, owners, _positive(exponent), smallest)


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
    pieces, owners = _centers(links, taking)
    return _inverse_distance(points, links, pieces, owners, NEAREST, 0.0)


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
    lacking = sorted(set(np.flatnonzero(wanted)) - set(links.bone_links.tolist()))
    if lacking:
        raise BadData(
            f"link '{links.names[lacking[0]]}' has no bone to measure to: give bones, or leave"
            " it out"
        )
    kept = wanted[links.bone_links]
    return _inverse_distance(
        points, links, links.bones[kept], links.bone_links[kept], _positive(exponent), smallest
    )


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
    if len(points) and error.max() > 1e-6:
        j = int(error.argmax())
        raise BadData(f"the weights of point {j} sum to {checked.sum(axis=1)[j]:.6g}: expected 1")
    return checked


def links_with_mass(model: Model, density: float = 10.0) -> np.ndarray:
    """Tell bodies from phantoms, frames that models give a little mass of no meaning.

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
    gyration = np.sqrt(
        np.divide(0.5 * inertia, masses, out=np.zeros_like(masses), where=masses > 0.0)
    )
    return (masses > 1e-6 * masses.sum()) & (masses >= density * gyration**3)


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


def _centers(links: Links, taking: ArrayLike | None) -> tuple[Array, np.ndarray]:
    owners = np.flatnonzero(_taking(links, taking))
    return np.repeat(links.centers[owners, None], 2, axis=1), owners


def _positive(exponent: float) -> float:
    if not exponent > 0.0:
        raise BadData(f"the exponent of a weight map is {exponent:g}: expected above 0")
    return exponent


def _inverse_distance(
    points: Array, links: Links, pieces: Array, owners: np.ndarray, exponent: float, smallest: float
) -> scipy.sparse.csr_array:
    """Compute shares by the distance to segments of links.

    Parameters
    ----------
    points : (points, 3) in ground [m]
    pieces : (pieces, 2, 3) ends of the segments [m]
    owners : (pieces,) link of each
    exponent : of the distance
    smallest : shares below it are dropped

    Returns
    -------
    (points, links)
    """
    x = np.array(points, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(x).all():
        raise BadData("a mass point is not finite")
    starts = np.array(pieces[:, 0])
    along = pieces[:, 1] - pieces[:, 0]
    length = np.einsum("pi,pi->p", along, along)
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    n = len(links.names)
    owner = owners.astype(np.int64)
    counts = np.zeros(len(x), np.int64)
    filled: list[tuple[np.ndarray, Array]] = [(np.zeros(0, np.int32), np.zeros(0))] * -(
        -len(x) // CHUNK
    )

    def part(start: int, stop: int) -> None:
        columns = np.empty((stop - start) * n, np.int32)
        shares = np.empty((stop - start) * n)
        used = _shares(
            x[start:stop],
            starts,
            along,
            inverse,
            owner,
            n,
            exponent,
            smallest,
            columns,
            shares,
            counts[start:stop],
        )
        filled[start // CHUNK] = columns[:used].copy(), shares[:used].copy()

    over_frames(part, len(x), chunk=CHUNK)
    first = np.concatenate([[0], np.cumsum(counts)])
    columns = np.concatenate([part for part, _ in filled]) if filled else np.zeros(0, np.int32)
    shares = np.concatenate([part for _, part in filled]) if filled else np.zeros(0)
    return scipy.sparse.csr_array((shares, columns, first.astype(np.int32)), shape=(len(x), n))


@kernel
def _shares(x, starts, along, inverse, owner, n, exponent, smallest, columns, shares, counts):
    """Compute shares of points one after the other; return how many entries were written.

    Parameters
    ----------
    x : (points, 3) [m]
    starts, along, inverse : (pieces, 3), (pieces, 3), (pieces,) of the segments: start, direction
        with its length, and the inverse of its square
    owner : (pieces,) link of each
    n : number of links
    exponent : of the distance; infinity gives all to the nearest
    smallest : shares below it are dropped
    columns, shares : (entries,) filled
    counts : (points,) filled with the number of entries of each point
    """
    squared = np.empty(n)
    used = 0
    for j in range(x.shape[0]):
        squared[:] = np.inf
        nearest = 0
        least = np.inf
        for p in range(starts.shape[0]):
            a = x[j, 0] - starts[p, 0]
            b = x[j, 1] - starts[p, 1]
            c = x[j, 2] - starts[p, 2]
            t = (a * along[p, 0] + b * along[p, 1] + c * along[p, 2]) * inverse[p]
            t = min(max(t, 0.0), 1.0)
            a = a - t * along[p, 0]
            b = b - t * along[p, 1]
            c = c - t * along[p, 2]
            d = max(a * a + b * b + c * c, 1e-24)
            squared[owner[p]] = min(squared[owner[p]], d)
            if d < least:
                nearest = owner[p]
                least = d
        first = used
        if exponent == np.inf:
            columns[used] = nearest
            shares[used] = 1.0
            used += 1
        else:
            # Shares relative to the nearest link's neither overflow nor lose digits.
            total = 0.0
            for i in range(n):
                ratio = least / squared[i]
                squared[i] = ratio * ratio if exponent == 4.0 else ratio ** (0.5 * exponent)
                total += squared[i]
            kept = 0.0
            for i in range(n):
                if squared[i] > 0.0 and squared[i] >= smallest * total:
                    columns[used] = i
                    shares[used] = squared[i]
                    kept += squared[i]
                    used += 1
            for place in range(first, used):
                shares[place] /= kept
        counts[j] = used - first
    return used

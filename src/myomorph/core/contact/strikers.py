"""Which site made each impact that was heard: whole assignments of all impacts compared.

An assignment names a site for each impact. Its likelihood is that of where the sites were and of
how much their velocity changed:

    sum over impacts  log N(x; mu, sigma^2 I) / q(x)  +  log N(y; m, s^2) / N(y; m_0, s_0^2)

with x the place of the site then, mu the place of the instrument and sigma its extent, q where that
site is at any time, y = log(|dv| + `SLOW`), m of sites that strike and m_0 of those that do not.
Places, extents and m are those of the assignment itself, for each impact by the others, so that it
is found by turns, from several beginnings. A site cannot strike two instruments within `APART`: the
impacts of a moment are assigned together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.contact.sound import HeardImpacts
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

AROUND = 0.03
TOUCH = 0.006
"""Time before and after an impact from which a tip's velocity is taken, and how long it touches
[s].
"""
APART = 0.05
"""Time in which a site does not get from one instrument to another [s]."""
MOST = 8
"""Number of impacts that are assigned together at most."""
EXTENT = 0.06
EXTENT_COUNT = 3.0
"""Extent of what is struck [m], and the number of impacts that this counts for."""
SLOW = 0.1
"""Change of velocity below which sizes do not matter [m/s]."""
JUMP_SD = 0.4
JUMP_COUNT = 4.0
"""Standard deviation of the logarithm of changes of velocity, and the number of impacts that this
counts for.
"""
ROUGH = 0.02
"""Least standard deviation of where a site is at any time [m]."""
MAX_TURNS = 30


@dataclass(frozen=True)
class Striker:
    """The site that made an impact.

    Attributes
    ----------
    site : its name
    confidence : probability of this site among those that may strike the instrument, 0 to 1
    """

    site: str
    confidence: float


@read_only
class _Moments:
    """The impacts that are assigned.

    Attributes
    ----------
    impacts : numbers in `HeardImpacts.impacts`
    times : (impacts,) [s]
    instruments : (impacts,) number of the instrument
    possible : of each impact, the numbers of the sites that may have made it
    places : (impacts, sites, 3) of the sites then, in ground [m]
    jumps : (impacts, sites) logarithm of the change of velocity
    elsewhere : (impacts, sites) log density of a site's place at any time [log 1/m^3]
    idle : (sites, 2) mean and standard deviation of the logarithm at times without impact
    """

    impacts: Array
    times: Array
    instruments: Array
    possible: tuple[tuple[int, ...], ...]
    places: Array
    jumps: Array
    elsewhere: Array
    idle: Array


class _Solution(NamedTuple):
    """An assignment (impacts,) of sites, its log likelihood and each site's probability."""

    sites: Array
    likelihood: float
    shares: Array


def find_strikers(
    heard: HeardImpacts, model: Model, motion: Motion, sites: Sequence[Site]
) -> dict[int, Striker]:
    """Find the site that made each impact, and how certain that is.

    Impacts outside the motion, or on an instrument without a site, are left out. Two assignments
    that the data do not separate, as of two drums that are always struck at once, share their
    probability.

    Source: ours, the equations above.

    Parameters
    ----------
    heard : impacts on the motion's clock
    model : of the body that strikes
    motion : coordinates over time
    sites : that may strike

    Returns
    -------
    by place in `heard.impacts`

    Raises
    ------
    UnknownName : an instrument names a site that does not exist
    """
    by_name = {site.name: site for site in sites}
    for instrument in heard.instruments:
        for name in instrument.sites:
            check_name("contact site", name, by_name, "the model's sites")
    named = [name for instrument in heard.instruments for name in instrument.sites]
    wanted = tuple(dict.fromkeys(named))
    moments = _moments(heard, model, motion, [by_name[name] for name in wanted])
    if not len(moments.impacts):
        return {}
    solutions = _solutions(moments)
    weights = np.exp(_normal([solution.likelihood for solution in solutions]))
    shares = np.einsum("k,kis->is", weights, [solution.shares for solution in solutions])
    best = max(solutions, key=lambda solution: solution.likelihood).sites
    return {
        int(number): Striker(wanted[site], float(min(shares[i, site], 1.0)))
        for i, (number, site) in enumerate(zip(moments.impacts, best, strict=True))
    }


def site_places(model: Model, motion: Motion, site: Site) -> Array:
    """Middle of a site over a motion.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    site : on the body

    Returns
    -------
    (frames, 3) in ground [m]
    """
    tree = compile_tree(model)
    number = tree.body_number(site.body)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return poses.points(np.array([number]), site.points.mean(axis=0)[None])[:, 0]


def change_of_velocity(time: Array, places: Array, at: float) -> Array:
    """Change of velocity about a time, between straight lines through the places around it.

    Parameters
    ----------
    time, places : (frames,) [s] and (frames, 3) [m]
    at : [s]

    Returns
    -------
    (3,) [m/s]
    """
    before = _velocity(time, places, at - AROUND, at)
    after = _velocity(time, places, at + TOUCH, at + TOUCH + AROUND)
    return after - before


def _velocity(time: Array, places: Array, start: float, stop: float) -> Array:
    """Slope (3,) of the straight line through places between two times [m/s].

    It is over a frame more where there are too few.

    Parameters
    ----------
    time, places : (frames,) [s] and (frames, 3) [m]
    start, stop : [s]
    """
    step = float(np.median(np.diff(time)))
    chosen = (time >= start - 1e-9) & (time <= stop + 1e-9)
    if chosen.sum() < 3:
        middle = 0.5 * (start + stop)
        chosen = np.abs(time - middle) <= 1.5 * step
    if chosen.sum() < 2:
        return np.zeros(3)
    since = time[chosen] - time[chosen].mean()
    return since @ places[chosen] / (since @ since)


def _moments(heard: HeardImpacts, model: Model, motion: Motion, sites: Sequence[Site]) -> _Moments:
    """Places and changes of velocity of all sites at all impacts within the motion."""
    order = {site.name: index for index, site in enumerate(sites)}
    instruments = [instrument.name for instrument in heard.instruments]
    candidates = [tuple(order[name] for name in each.sites) for each in heard.instruments]
    time = np.asarray(motion.time)
    kept = [
        (index, impact.time, instruments.index(impact.instrument))
        for index, impact in enumerate(heard.impacts)
        if time[0] <= impact.time <= time[-1] and candidates[instruments.index(impact.instrument)]
    ]
    times = np.array([at for _, at, _ in kept])
    tips = np.stack([site_places(model, motion, site) for site in sites], axis=1)
    places = np.empty((len(kept), len(sites), 3))
    jumps = np.empty((len(kept), len(sites)))
    elsewhere = np.empty((len(kept), len(sites)))
    idle = np.empty((len(sites), 2))
    for column in range(len(sites)):
        path = tips[:, column]
        places[:, column] = np.stack([np.interp(times, time, axis) for axis in path.T], axis=1)
        jumps[:, column] = _log_jumps(time, path, times)
        elsewhere[:, column] = _path_density(path, places[:, column])
        idle[column] = _when_idle(time, path, times)
    return _Moments(
        impacts=np.array([index for index, _, _ in kept], dtype=int),
        times=times,
        instruments=np.array([number for _, _, number in kept], dtype=int),
        possible=tuple(candidates[number] for _, _, number in kept),
        places=places,
        jumps=jumps,
        elsewhere=elsewhere,
        idle=idle,
    )


def _log_jumps(time: Array, path: Array, times: Array) -> Array:
    """Logarithms of the changes of velocity of a path at some times.

    Parameters
    ----------
    time, path : (frames,) [s] and (frames, 3) [m]
    times : (times,) [s]

    Returns
    -------
    (times,)
    """
    sizes = [float(np.linalg.norm(change_of_velocity(time, path, float(at)))) for at in times]
    return np.log(np.array(sizes) + SLOW)


def _path_density(path: Array, places: Array) -> Array:
    """Log density at some places of a normal distribution of where a path runs.

    Parameters
    ----------
    path : (frames, 3) [m]
    places : (places, 3) [m]

    Returns
    -------
    (places,) [log 1/m^3]
    """
    spread = np.cov(path.T) + ROUGH**2 * np.eye(3)
    off = places - path.mean(axis=0)
    squares = np.einsum("pi,ij,pj->p", off, np.linalg.inv(spread), off)
    return -0.5 * (squares + np.linalg.slogdet(2.0 * np.pi * spread)[1])


def _when_idle(time: Array, path: Array, times: Array) -> Array:
    """Mean and standard deviation (2,) of logarithms of changes of velocity away from impacts.

    Parameters
    ----------
    time, path : (frames,) [s] and (frames, 3) [m]
    times : (impacts,) [s]
    """
    grid = np.arange(time[0] + AROUND, time[-1] - AROUND - TOUCH, 0.5 * AROUND)
    far = np.array([not np.any(np.abs(times - at) < 2.0 * AROUND) for at in grid], dtype=bool)
    jumps = _log_jumps(time, path, grid[far][:: max(1, int(far.sum()) // 400)])
    if len(jumps) < 2:
        return np.array([np.log(SLOW), 1.0])
    return np.array([jumps.mean(), max(float(jumps.std()), 0.5 * JUMP_SD)])


def _solutions(moments: _Moments) -> list[_Solution]:
    """Find assignments at which turns end, each once, from several beginnings."""
    found: dict[tuple[int, ...], _Solution] = {}
    for begin in _beginnings(moments):
        solution = _by_turns(moments, begin)
        found.setdefault(tuple(solution.sites.tolist()), solution)
    best = max(found.values(), key=lambda solution: solution.likelihood)
    for begin in _exchanged(moments, best.sites):
        solution = _by_turns(moments, begin)
        found.setdefault(tuple(solution.sites.tolist()), solution)
    return list(found.values())


def _beginnings(moments: _Moments) -> Iterator[Array]:
    """Assign by changes of velocity: all impacts, and with places from single ones."""
    by_jump = _assigned(moments, moments.jumps).sites
    yield by_jump
    alone = np.array([np.sum(np.abs(moments.times - at) <= APART) == 1 for at in moments.times])
    if alone.any() and not alone.all():
        yield _assigned(moments, _scores(moments, by_jump, alone)).sites


def _exchanged(moments: _Moments, sites: Array) -> Iterator[Array]:
    """Exchange sites of an assignment, everywhere and where others strike at the same time."""
    count = moments.jumps.shape[1]
    together = np.array([np.sum(np.abs(moments.times - at) <= APART) > 1 for at in moments.times])
    orders = [order for order in permutations(range(count)) if order != tuple(range(count))]
    for order in orders[:10]:
        for where in (np.ones(len(sites), dtype=bool), together):
            changed = np.where(where, np.array(order)[sites], sites)
            if all(site in able for site, able in zip(changed, moments.possible, strict=True)):
                yield changed


def _by_turns(moments: _Moments, begin: Array) -> _Solution:
    """Assign by the places of the assignment before, until it stays."""
    every = np.ones(len(begin), dtype=bool)
    solution = _assigned(moments, _scores(moments, begin, every))
    for _ in range(MAX_TURNS):
        again = _assigned(moments, _scores(moments, solution.sites, every))
        if np.array_equal(again.sites, solution.sites):
            return again
        solution = again
    return solution


def _scores(moments: _Moments, sites: Array, used: Array) -> Array:
    """Log likelihood ratio (impacts, sites) of having struck, by an assignment's own places.

    No impact tells where its own instrument is: of one alone, places show nothing.

    Parameters
    ----------
    sites : (impacts,) the assignment
    used : (impacts,) whether it counts
    """
    rows = np.arange(len(sites))
    scores = np.zeros_like(moments.jumps)
    for number in range(len(sites)):
        same = moments.instruments == moments.instruments[number]
        others = same & (rows != number)
        chosen = others & used if (others & used).any() else others
        if chosen.any():
            struck = moments.places[rows, sites][chosen]
            scores[number] = _place_score(struck, moments.places[number])
            scores[number] -= moments.elsewhere[number]
    jumps = moments.jumps[rows, sites][used] if used.any() else moments.jumps[rows, sites]
    mean = float(jumps.mean())
    square = float(np.sum((jumps - mean) ** 2)) + JUMP_COUNT * JUMP_SD**2
    scores += _log_normal(moments.jumps, mean, np.sqrt(square / (len(jumps) + JUMP_COUNT)))
    return scores - _log_normal(moments.jumps, moments.idle[:, 0], moments.idle[:, 1])


def _place_score(struck: Array, places: Array) -> Array:
    """Log density of places to be on an instrument that was struck elsewhere.

    Parameters
    ----------
    struck : (impacts, 3) places of other impacts on it [m]
    places : (sites, 3) [m]

    Returns
    -------
    (sites,) [log 1/m^3]
    """
    middle = np.median(struck, axis=0)
    squares = float(np.sum((struck - middle) ** 2))
    count = float(len(struck))
    extent = (squares + 3.0 * EXTENT_COUNT * EXTENT**2) / (3.0 * (count + EXTENT_COUNT))
    extent *= 1.0 + 1.0 / count
    off = np.sum((places - middle) ** 2, axis=1)
    return np.asarray(-0.5 * (off / extent + 3.0 * np.log(2.0 * np.pi * extent)))


def _log_normal(values: Array, mean: Array | float, sd: Array | float) -> Array:
    """Log density of normal distributions, of any shape."""
    return -0.5 * ((values - mean) / sd) ** 2 - np.log(sd) - 0.5 * np.log(2.0 * np.pi)


def _assigned(moments: _Moments, scores: Array) -> _Solution:
    """Assign best by scores (impacts, sites), the impacts of a moment together."""
    sites = np.zeros(len(scores), dtype=int)
    shares = np.zeros_like(scores)
    likelihood = 0.0
    for members in _together(moments.times):
        ways = _ways(moments, members)
        sums = np.array([scores[members, list(way)].sum() for way in ways])
        sites[members] = ways[int(np.argmax(sums))]
        likelihood += float(sums.max())
        for way, share in zip(ways, np.exp(_normal(sums)), strict=True):
            shares[members, list(way)] += share
    return _Solution(sites=sites, likelihood=likelihood, shares=shares)


def _ways(moments: _Moments, members: Sequence[int]) -> list[tuple[int, ...]]:
    """List assignments of the impacts of a moment in which no site is at two instruments.

    Where there is none, as of two drums that one stick alone may strike, all are.
    """
    every = list(product(*(moments.possible[member] for member in members)))
    pairs = [
        (i, j)
        for i in range(len(members))
        for j in range(i)
        if moments.instruments[members[i]] != moments.instruments[members[j]]
        and abs(moments.times[members[i]] - moments.times[members[j]]) <= APART
    ]
    able = [way for way in every if all(way[i] != way[j] for i, j in pairs)]
    return able or every


def _together(times: Array) -> Iterator[list[int]]:
    """Numbers of impacts that follow one another within `APART`, at most `MOST` at once."""
    order = np.argsort(times, kind="stable")
    members: list[int] = []
    for number in order:
        close = bool(members) and times[number] - times[members[-1]] <= APART
        if members and (not close or len(members) == MOST):
            yield members
            members = []
        members.append(int(number))
    if members:
        yield members


def _normal(likelihoods: Sequence[float] | Array) -> Array:
    """Logarithms of probabilities (ways,) in proportion to likelihoods."""
    values = np.asarray(likelihoods, dtype=np.float64)
    return np.asarray(values - scipy.special.logsumexp(values))

"""A term of the tension problem, and what it may add. The problem is the sum of its terms.

    minimise    sum_i w_i |x_i|^p_i + k_i dist(x_i, [l_i, h_i])^2
    subject to  A x = b,  lower <= x <= upper

A term may bring unknowns in (with weights w, exponents p and bounds), generalized forces of these
unknowns (columns of the equations of motion), rows (linear costs and constraints on any unknowns)
and interval penalties (k, l, h). Nothing else is needed for any convex quadratic term: a cost
without a diagonal and an inequality are rows with an unknown of their own, so that the problem
stays separable and the solver of `myomorph.core.tension.dual` takes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array, checked_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import index_of
from myomorph.core.tension.separable import FrameLinks

T = TypeVar("T")
LIMIT_COST = 1e-6
"""Cost of the unknown of a constraint, squared: small enough to change nothing, above 0 for a
unique solution.
"""


@read_only
class Variables:
    """Unknowns that a term brings in.

    Attributes
    ----------
    names : one per unknown
    weight, exponent : (unknowns,) w > 0 and p > 1 of the cost w |x|^p
    lower, upper : (unknowns,) bounds, may be infinite
    """

    names: tuple[str, ...] = ()
    weight: Array = field(default_factory=lambda: np.zeros(0))
    exponent: Array = field(default_factory=lambda: np.zeros(0))
    lower: Array = field(default_factory=lambda: np.zeros(0))
    upper: Array = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.names)


def joined(parts: Sequence[Variables]) -> Variables:
    """Join the unknowns of several terms, one term after the other."""
    return Variables(
        names=tuple(name for part in parts for name in part.names),
        weight=np.concatenate([part.weight for part in parts]),
        exponent=np.concatenate([part.exponent for part in parts]),
        lower=np.concatenate([part.lower for part in parts]),
        upper=np.concatenate([part.upper for part in parts]),
    )


@read_only
class Unknowns:
    """All unknowns of a problem, as a term sees them when the problem is set up.

    Attributes
    ----------
    names : activations by the muscles' names, controls by the actuators', amplitudes as "<site>
        point 0 generator 3"
    muscles : the first of them, whose unknowns are activations
    time : (frames,) of the motion [s]
    terms, places : the terms, that of the muscles first, and the places of the unknowns that each
        brings in
    """

    names: tuple[str, ...]
    muscles: tuple[str, ...]
    time: Array
    terms: tuple[Term, ...]
    places: tuple[slice, ...]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def muscle_term(self) -> Term:
        """The term of the muscles.

        Its `columns` have their forces of full activation, and those that act anyway.
        """
        return self.terms[0]

    def of(self, term: Term) -> slice:
        """Places of the unknowns that a term brings in.

        Raises
        ------
        BadData : the term is not a part of the problem
        """
        for other, place in zip(self.terms, self.places, strict=True):
            if other is term:
                return place
        raise BadData(
            f"a term refers to the unknowns of {type(term).__name__}, which is not a part of the"
            " problem"
        )

    def row(self, factors: Mapping[str, float]) -> Array:
        """Linear function of the unknowns, from the factors of those that are in it.

        Parameters
        ----------
        factors : by name of the unknown

        Returns
        -------
        (unknowns,)

        Raises
        ------
        UnknownName : no unknown has that name
        """
        result = np.zeros(len(self.names))
        for name, factor in factors.items():
            result[index_of("unknown", name, self.names, "the tension problem")] += factor
        return result


class Frames:
    """Some frames of the motion, as terms read them.

    Attributes
    ----------
    part : their numbers
    coordinates, rates : (frames, coordinates) of all coordinates, consistent [rad or m], [rad/s or
        m/s]
    """

    def __init__(self, part: slice, coordinates: Array, rates: Array):
        self.part = part
        self.coordinates = coordinates
        self.rates = rates
        self._values: dict[int, object] = {}

    def __len__(self) -> int:
        return len(self.coordinates)

    def once(self, owner: Term, make: Callable[[Frames], T]) -> T:
        """Compute a value of these frames once, for all who ask.

        Parameters
        ----------
        owner : the term whose value it is, one value per term
        make : called with these frames, the first time
        """
        if id(owner) not in self._values:
            self._values[id(owner)] = make(self)
        return self._values[id(owner)]  # type: ignore[return-value]


class Columns(NamedTuple):
    """Generalized forces of a term's unknowns in some frames.

    Attributes
    ----------
    entries : (frames, entries) generalized forces of unit forces, in the order of `Term.entries` [m
        or 1]
    forces : (frames, unknowns) force of one unit of each unknown [N or N m]
    given : (frames, unknowns) forces along the same columns that act whatever the unknowns are,
        None for none [N, N m]
    """

    entries: Array
    forces: Array
    given: Array | None = None


@read_only
class Rows:
    """Linear functions of the unknowns, each with an unknown e of its own.

        S x - unit e = target,   cost weight e^2

    Attributes
    ----------
    names : one per row
    row, column : (entries,) where S may differ from 0: which row, which unknown
    values : (entries,) or (frames, entries) of S there
    target : (rows,) or (frames, rows)
    unit : (rows,) what one unit of e stands for, in the unit of the target
    weight : (rows,) cost of e^2, above 0, in units of the effort a^2 of one muscle
    lower, upper : (rows,) bounds of e: infinite for a cost, 0 for an equation
    measured : whether targets are measurements, whose standard deviations are the units
    on_forces : whether S has, of each activation, a factor times the muscle's force of full
        activation, so that elastic tendons can put their forces in its place
    """

    names: tuple[str, ...]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    values: Array
    target: Array
    unit: Array
    weight: Array
    lower: Array
    upper: Array
    measured: bool = False
    on_forces: bool = False

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def cost(cls, name: str, L: ArrayLike, m: ArrayLike, weight: float) -> Rows:
        """Rows of the cost weight |L x - m|^2.

        It is 1/2 x^T H x + c^T x and a constant, with H = 2 weight L^T L and c = -2 weight L^T m.

        Parameters
        ----------
        name : of the rows
        L : (rows, unknowns)
        m : (rows,) or (frames, rows)
        weight : above 0, in units of the effort a^2 of one muscle
        """
        return cls._dense(name, S=L, target=m, weight=weight, lower=-np.inf, upper=np.inf)

    @classmethod
    def equal(cls, name: str, A: ArrayLike, b: ArrayLike) -> Rows:
        """Rows of the equations A x = b; A (rows, unknowns), b (rows,) or (frames, rows)."""
        return cls._dense(name, S=A, target=b, weight=1.0, lower=0.0, upper=0.0)

    @classmethod
    def at_most(cls, name: str, G: ArrayLike, h: ArrayLike) -> Rows:
        """Rows of G x <= h; G (rows, unknowns), h (rows,) or (frames, rows)."""
        # G x + slack = h: the slack, -e, is at least 0 and costs next to nothing.
        return cls._dense(name, S=G, target=h, weight=LIMIT_COST, lower=-np.inf, upper=0.0)

    @classmethod
    def of_frames(  # page: the fields of rows that are alike in all frames
        cls,
        names: tuple[str, ...],
        columns: Sequence[NDArray[np.int64]],
        unit: ArrayLike,
        weight: float,
        bound: float = np.inf,
        measured: bool = False,
        on_forces: bool = False,
    ) -> Rows:
        """Rows whose values and targets `Term.row_values` fills, chunk by chunk of frames.

        Parameters
        ----------
        names : one per row
        columns : of each row, the unknowns that it has factors of
        unit : what one unit of e stands for, in the unit of the target; one for all or one per row
        weight : cost of e^2, in units of the effort a^2 of one muscle
        bound : e lies between -bound and bound
        measured, on_forces : see `Rows`

        Returns
        -------
        rows whose values and targets are 0
        """
        count = len(names)
        row = np.repeat(np.arange(count), [len(column) for column in columns])
        bounds = np.full(count, bound, np.float64)
        return cls(
            names=names,
            row=row,
            column=np.concatenate([np.zeros(0, np.int64), *columns]),
            values=np.zeros(len(row)),
            target=np.zeros(count),
            unit=np.full(count, unit, np.float64),
            weight=np.full(count, weight, np.float64),
            lower=-bounds,
            upper=bounds,
            measured=measured,
            on_forces=on_forces,
        )

    @classmethod
    def _dense(
        cls, name: str, S: ArrayLike, target: ArrayLike, weight: float, lower: float, upper: float
    ) -> Rows:
        """Rows S x - e = target, the rest alike in all rows.

        Parameters
        ----------
        S : (rows, unknowns)
        target : (rows,) or (frames, rows)

        Raises
        ------
        BadData : another number of targets than rows, or a weight that is not above 0
        """
        S = np.atleast_2d(np.asarray(S, dtype=np.float64))
        target = np.atleast_1d(np.asarray(target, dtype=np.float64))
        count = len(S)
        if target.shape[-1] != count:
            raise BadData(
                f"term '{name}' has {count} rows and {target.shape[-1]} targets: expected as many"
            )
        if not weight > 0.0:
            raise BadData(f"the weight of term '{name}' is {weight:g}: expected above 0")
        row, column = np.nonzero(S)
        return cls(
            names=(name,) if count == 1 else tuple(f"{name} {number}" for number in range(count)),
            row=row,
            column=column,
            values=S[row, column],
            target=target,
            unit=np.full(count, 1.0),
            weight=np.full(count, weight),
            lower=np.full(count, lower),
            upper=np.full(count, upper),
        )


@read_only
class Penalties:
    """Interval penalties: weight dist(x, [low, high])^2 of some unknowns.

    Attributes
    ----------
    columns : (penalised,) which unknowns
    low, high, weight : (frames, penalised), or (1, penalised) for all frames; a weight of 0 leaves
        low and high unread
    """

    columns: Sequence[int]
    low: Array
    high: Array
    weight: Array


@read_only
class Smoothing:
    """Links between unknowns of neighbouring frames.

    The cost gains stiffness_j w_i (scale_j x_j - scale_(j-1) x_(j-1))^2 of each linked unknown i.

    Attributes
    ----------
    window : frames kept of each joint solution
    margin : frames before and after them that are solved too
    first : the unknowns first ... first + linked - 1 are linked
    scale : (frames, linked) amount of one unit, 0 where an unknown takes no part
    stiffness : (frames - 1,) between a frame and the next, in units of the unknowns' weights
    over : factor of over-relaxation, 1 to 2
    sweeps : maximum number of passes over a window
    tolerance : change of an amount at which passes end
    """

    window: int
    margin: int
    first: int
    scale: Array
    stiffness: Array
    over: float
    sweeps: int
    tolerance: float

    def links(self, begin: int, end: int) -> FrameLinks:
        """Links of the frames begin ... end - 1."""
        # Copies: read-only arrays would compile the solver once more.
        scale = self.scale[begin:end].copy()
        stiffness = self.stiffness[begin : end - 1].copy()
        return FrameLinks(
            first=self.first,
            scale=scale,
            amount=np.zeros_like(scale),
            stiffness=stiffness,
            over=self.over,
            sweeps=self.sweeps,
            tolerance=self.tolerance,
        )


class Term:
    """A part of the tension problem. A term overrides what it adds; the rest adds nothing.

    The problem calls `variables`, `entries`, `rows`, `penalties` and `smoothing` once, when it is
    set up; `columns` and `row_values` chunk by chunk of frames, from several threads.
    """

    def variables(self) -> Variables:
        """Unknowns that it brings in."""
        return Variables()

    def entries(self) -> Sequence[tuple[int, int]]:
        """Unknown and coordinate of every generalized force of its unknowns.

        Unknowns are counted from its own first; a coordinate of -1 takes none.
        """
        return ()

    def columns(self, frames: Frames) -> Columns:
        """Generalized forces of its unknowns in some frames."""
        nothing = np.zeros((len(frames), 0))
        return Columns(entries=nothing, forces=nothing)

    def rows(self, unknowns: Unknowns) -> Rows | None:
        """Costs and constraints that are linear functions of unknowns, its own or others'."""
        return None

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Values and targets of its rows in some frames.

        Parameters
        ----------
        rows : as `rows` returned them
        frames : a chunk of the motion

        Returns
        -------
        (frames, entries) values of S and (frames, rows) targets
        """
        values = rows.values[frames.part] if rows.values.ndim == 2 else rows.values
        target = rows.target[frames.part] if rows.target.ndim == 2 else rows.target
        return (
            np.broadcast_to(values, (len(frames), len(rows.row))),
            np.broadcast_to(target, (len(frames), len(rows))),
        )

    def penalties(self, unknowns: Unknowns) -> Penalties | None:
        """Intervals that unknowns, its own or others', are drawn into."""
        return None

    def smoothing(self, unknowns: Unknowns) -> Smoothing | None:
        """Links of its own unknowns between frames; at most one term of a problem has any."""
        return None


@read_only
class IntervalPenalties:
    """Interval penalties of all terms, kept by frame for those unknowns alone that need it.

    Attributes
    ----------
    base : (3, unknowns) l, h and k of all frames
    columns : (changing,) unknowns that have others in each frame
    values : (frames, 3, changing) l, h and k of these
    """

    base: Array
    columns: NDArray[np.int64]
    values: Array

    def __getitem__(self, frames: slice | NDArray[np.int64]) -> Array:
        """Penalties of some frames for `solve_separable`.

        Parameters
        ----------
        frames : a slice, or (chosen,) their numbers

        Returns
        -------
        (chosen, 3, unknowns), or (1, 3, unknowns) if all frames are alike
        """
        if not len(self.columns):
            return self.base[None].copy()  # read-only arrays would compile the solver once more
        changing = self.values[frames]
        result = np.repeat(self.base[None], len(changing), axis=0)
        result[:, :, self.columns] = changing
        return result


def added_up(parts: Sequence[Penalties], unknowns: Unknowns, count: int) -> IntervalPenalties:
    """Sum the interval penalties of all terms.

    Parameters
    ----------
    parts : penalties of one term each
    unknowns : of all terms
    count : number of unknowns, those of rows included

    Returns
    -------
    penalties of all unknowns

    Raises
    ------
    BadData : penalties of another number of frames, or two intervals of one unknown
    """
    frames = len(unknowns.time)
    by_column: dict[int, Array] = {}
    for part in parts:
        for place, column in enumerate(part.columns):
            penalty = np.stack(
                [part.low[:, place], part.high[:, place], part.weight[:, place]], axis=1
            )
            if len(penalty) not in (1, frames):
                raise BadData(
                    f"a term has penalties of {len(penalty)} frames, the motion {frames}: "
                    "expected as many"
                )
            if column in by_column:
                penalty = _sum(by_column[column], penalty, unknowns.names[column])
            by_column[column] = penalty

    base = np.zeros((3, count))
    changing = []
    for column, penalty in by_column.items():
        if len(penalty) == 1:
            base[:, column] = penalty[0]
        else:
            changing.append(column)
    values = np.zeros((0, 3, 0))
    if changing:
        values = np.stack([by_column[column] for column in changing], axis=2)
    return IntervalPenalties(
        base=base,
        columns=np.array(changing, np.int64),
        values=checked_array(values, ("frames", 3, "n"), "penalties"),
    )


def _sum(first: Array, second: Array, name: str) -> Array:
    """Add two interval penalties of one unknown, exactly but for a constant.

    Where both act, each must draw to one value, l = h = m. Then

        k1 (x - m1)^2 + k2 (x - m2)^2 = (k1 + k2) (x - m)^2 + constant,
        m = (k1 m1 + k2 m2) / (k1 + k2)

    The sum of two proper intervals is no interval penalty.

    Parameters
    ----------
    first, second : (frames, 3) or (1, 3) l, h and k of each; a k of 0 leaves l and h unread
    name : of the unknown, for the error

    Returns
    -------
    (frames, 3) or (1, 3) l, h and k

    Raises
    ------
    BadData : both act in a frame, and one of them has an interval
    """
    first, second = np.broadcast_arrays(first, second)
    low_1, high_1, stiffness_1 = first.T
    low_2, high_2, stiffness_2 = second.T
    first_acts = stiffness_1 > 0.0
    both_act = first_acts & (stiffness_2 > 0.0)
    if np.any(both_act & ((low_1 != high_1) | (low_2 != high_2))):
        raise BadData(
            f"two terms draw '{name}' into intervals: write one of them as rows (`Rows.cost`)"
        )
    stiffness = stiffness_1 + stiffness_2
    # One that does not act may have NaN for its interval.
    weighted_sum = stiffness_1 * np.nan_to_num(low_1) + stiffness_2 * np.nan_to_num(low_2)
    mean = np.divide(weighted_sum, stiffness, out=np.zeros_like(stiffness), where=both_act)
    low = np.where(both_act, mean, np.where(first_acts, low_1, low_2))
    high = np.where(both_act, mean, np.where(first_acts, high_1, high_2))
    return np.stack([low, high, stiffness], axis=1)

"""Paths whose length is a function of coordinates, as arrays and a kernel.

    length      l = f(c)
    moment arm  r_i = -df/dc_i, or a function of its own
    velocity    ldot = -sum r_j cdot_j, or a function of its own

What reaches a coordinate through those that follow it is added by the kernel of all paths.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import Function
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.paths import PathFunction
from myomorph.core.model.polynomial import Polynomial
from myomorph.core.rigid.coordinates import FunctionArrays, Ints, compile_functions, evaluate
from myomorph.core.rigid.kernels import bare

# Columns of `PathFunctionArrays.path` and `formula`
FIRST_ARGUMENT, STOP_ARGUMENT, LENGTH, ARMS, VELOCITY = range(5)
FUNCTION, FIRST_TERM, STOP_TERM = range(3)


class PathFunctionArrays(NamedTuple):
    """Paths by functions of coordinates, as the kernel reads them.

    Attributes
    ----------
    number : (muscles,) number of the muscle's path among those by functions, -1 of all others
    path : (paths, 5) columns FIRST_ARGUMENT, STOP_ARGUMENT: range in `argument`; LENGTH, ARMS (the
        first of as many as arguments) and VELOCITY: rows of `formula`, -1 for none
    argument : (arguments,) numbers of coordinates
    slot : (arguments,) their positions among the muscle's moment arms
    formula : (formulas, 3) columns FUNCTION: row of `functions`, -1 of a polynomial, which is the
        sum of the terms FIRST_TERM ... STOP_TERM - 1
    exponent : (terms, most arguments with their rates) of each argument
    coefficient : (terms,)
    functions : of one or two coordinates
    """

    number: Ints
    path: Ints
    argument: Ints
    slot: Ints
    formula: Ints
    exponent: Ints
    coefficient: Array
    functions: FunctionArrays


class _Formulas:
    """Collects formulas one after another."""

    def __init__(self) -> None:
        self.rows: list[list[int]] = []
        self.exponents: list[np.ndarray] = []
        self.coefficients: list[Array] = []
        self.functions: list[Function] = []
        self.terms = 0

    def add(self, formulas: Sequence[Polynomial | Function]) -> int:
        """Add formulas; the row of the first, -1 where there is none."""
        first = len(self.rows) if formulas else -1
        for formula in formulas:
            if not isinstance(formula, Polynomial):
                self.rows.append([len(self.functions), 0, 0])
                self.functions.append(formula)
                continue
            used = formula.coefficients != 0.0
            self.exponents.append(formula.exponents[used])
            self.coefficients.append(formula.coefficients[used])
            stop = self.terms + int(used.sum())
            self.rows.append([-1, self.terms, stop])
            self.terms = stop
        return first

    def exponent_table(self) -> Ints:
        """Exponents of all terms, (terms, most arguments)."""
        widest = max((table.shape[1] for table in self.exponents), default=1)
        wide = [np.pad(table, ((0, 0), (0, widest - table.shape[1]))) for table in self.exponents]
        return np.concatenate([np.zeros((0, widest), np.int64), *wide]).astype(np.int64)


def has_functions(model: Model) -> bool:
    """Return whether a function gives the length of a muscle's path."""
    return any(muscle.path.function is not None for muscle in model.muscles)


def compile_path_functions(model: Model, arms: Sequence[Ints]) -> PathFunctionArrays:
    """Compile the paths that functions give.

    Parameters
    ----------
    model : of the muscles
    arms : of each muscle the numbers of the coordinates that move it, in the order of its arms

    Returns
    -------
    the arrays
    """
    formulas = _Formulas()
    number = np.full(len(model.muscles), -1, np.int64)
    rows: list[list[int]] = []
    arguments: list[int] = []
    slots: list[int] = []
    for m, muscle in enumerate(model.muscles):
        function = muscle.path.function
        if function is None:
            continue
        number[m] = len(rows)
        taken = [
            index_of("coordinate", name, model.coordinate_names) for name in function.coordinates
        ]
        first = len(arguments)
        arguments += taken
        slots += [int(np.flatnonzero(arms[m] == j)[0]) for j in taken]
        rows.append([first, len(arguments), *_add_path(formulas, function)])
    return PathFunctionArrays(
        number=number,
        path=np.array(rows, np.int64).reshape(-1, 5),
        argument=np.array(arguments, np.int64),
        slot=np.array(slots, np.int64),
        formula=np.array(formulas.rows, np.int64).reshape(-1, 3),
        exponent=formulas.exponent_table(),
        coefficient=np.concatenate([np.zeros(0), *formulas.coefficients]),
        functions=compile_functions(formulas.functions),
    )


def _add_path(formulas: _Formulas, function: PathFunction) -> tuple[int, int, int]:
    """Add length, moment arms and velocity of a path; their first rows."""
    length = formulas.add([function.length])
    arms = formulas.add(function.moment_arms)
    velocity = formulas.add([] if function.velocity is None else [function.velocity])
    return length, arms, velocity


@bare
def put_path_function(F, muscle, motion, frame, row):
    """Put the moment arms of a muscle in place, and give its length.

    Parameters
    ----------
    F : `PathFunctionArrays`
    muscle : its number
    motion : `PathMotion`
    frame : its number
    row : `ArmRow` of the muscle, whose entries are 0

    Returns
    -------
    [m]
    """
    c = motion.coordinates[frame]
    v = motion.speeds[frame]
    path = F.number[muscle]
    length = F.path[path, LENGTH]
    arms = F.path[path, ARMS]
    for k in range(F.path[path, STOP_ARGUMENT] - F.path[path, FIRST_ARGUMENT]):
        slot = F.slot[F.path[path, FIRST_ARGUMENT] + k]
        if arms < 0:
            row.values[row.first + slot] = -_slope(F, path, length, c, v, k)
        else:
            row.values[row.first + slot] = _value(F, path, arms + k, c, v)
    return _value(F, path, length, c, v)


@bare
def path_function_velocity(F, muscle, motion, frame, velocity):
    """Lengthening velocity by a function of its own, else the one that moment arms give [m/s].

    Parameters
    ----------
    F : `PathFunctionArrays`
    muscle : its number
    motion : `PathMotion`
    frame : its number
    velocity : by moment arms [m/s]
    """
    path = F.number[muscle]
    formula = F.path[path, VELOCITY]
    if formula < 0:
        return velocity
    return _value(F, path, formula, motion.coordinates[frame], motion.speeds[frame])


@bare
def _argument(F, path, c, v, k):
    """Argument k of a path's formulas: its coordinates, then their rates."""
    first = F.path[path, FIRST_ARGUMENT]
    count = F.path[path, STOP_ARGUMENT] - first
    return c[F.argument[first + k]] if k < count else v[F.argument[first + k - count]]


@bare
def _value(F, path, formula, c, v):
    """Value of a formula."""
    function = F.formula[formula, FUNCTION]
    if function >= 0:
        return _function(F, path, function, c, v)[0]
    total = 0.0
    for term in range(F.formula[formula, FIRST_TERM], F.formula[formula, STOP_TERM]):
        value = F.coefficient[term]
        for k in range(F.exponent.shape[1]):
            if F.exponent[term, k] > 0:
                x = _argument(F, path, c, v, k)
                for _ in range(F.exponent[term, k]):
                    value *= x
        total += value
    return total


@bare
def _slope(F, path, formula, c, v, index):
    """Differentiate a formula in one of its arguments."""
    function = F.formula[formula, FUNCTION]
    if function >= 0:
        _, first, second = _function(F, path, function, c, v)
        return first if index == 0 else second
    total = 0.0
    for term in range(F.formula[formula, FIRST_TERM], F.formula[formula, STOP_TERM]):
        power = F.exponent[term, index]
        if power == 0:
            continue
        value = F.coefficient[term] * power
        for k in range(F.exponent.shape[1]):
            times = F.exponent[term, k] - (1 if k == index else 0)
            if times > 0:
                x = _argument(F, path, c, v, k)
                for _ in range(times):
                    value *= x
        total += value
    return total


@bare
def _function(F, path, function, c, v):
    """Value and slopes of a function of one or two coordinates."""
    count = F.path[path, STOP_ARGUMENT] - F.path[path, FIRST_ARGUMENT]
    x1 = _argument(F, path, c, v, 0)
    x2 = _argument(F, path, c, v, 1) if count > 1 else 0.0
    f, f1, f2, _, _, _ = evaluate(F.functions, function, x1, x2)
    return f, f1, f2

"""One frame of the tension problem in its readable form: terms that add up to a quadratic program.

Where the fast form adds variables to stay separable (`contact_rows`, `emg_wells`), this one has full cost matrices and
inequalities; both have one solution. Smoothness between frames has no place in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.tension.contact_rows import MEASURED_COST
from myomorph.tension.emg_wells import STIFFNESS
from myomorph.tension.problem import TensionProblem
from myomorph.tension.terms import (
    Constraint,
    Cost,
    Program,
    balance,
    contact_regularisation,
    effort,
    emg_equality,
    emg_target,
    program,
    shared_wrench,
)


def frame_program(problem: TensionProblem, frame: int) -> Program:
    """The quadratic program of one frame.

    Returns
    -------
    Program whose variables are the activations, the controls of reserves and residuals, the amplitudes of contacts'
    edges [weights of the body], and the excess of each activation that an EMG equality tells of; its rows are the
    equations of motion [N m or N].

    Raises
    ------
    BadData
        where the effort's exponent is not 2
    """
    if problem.options.exponent != 2.0:
        raise BadData(f"effort with the exponent {problem.options.exponent:g} is no quadratic program: use 2")
    muscles, contacts, fast = problem.assembly.tree.model.muscle_names, problem.contacts, problem.separable
    matrix, right, sums, measured = _matrices(problem, frame)
    names = list(muscles) + [one.name for one in problem.actuators]
    controls = len(names)
    names += [] if contacts is None else contacts.columns.names
    emg = _emg(problem, frame)
    equality = problem.emg is not None and problem.emg.mode == "equality"
    base = len(names)
    if equality:
        names += [f"{muscles[m]} excess" for m in np.flatnonzero(np.isfinite(emg))]
    n = len(names)

    def widened(values: Array, fill: float = 0.0) -> Array:
        return np.concatenate([values, np.full(n - len(values), fill)])

    def spread(rows: Array) -> Array:
        return np.hstack([rows, np.zeros((len(rows), n - rows.shape[1]))])

    costs: list[Cost] = [effort(widened(fast.weight[:controls]))]
    limits: list[Constraint] = []
    if contacts is not None:
        cost = np.concatenate([np.zeros(controls), contacts.columns.cost])
        costs.append(contact_regularisation(contacts.task.options.compliance, widened(cost)))
        told = contacts.extra.wrench >= 0
        if told.any():
            costs.append(shared_wrench(spread(sums[told]), measured[told], contacts.extra.unit[told], MEASURED_COST))
        bound = contacts.extra.unit[~told]
        limits += [(spread(sums[~told]), bound), (-spread(sums[~told]), bound)]
    if problem.emg is not None and equality:
        limits.append(emg_equality(emg, problem.emg.slack, base, n))
        costs.append(effort(np.where(np.arange(n) >= base, STIFFNESS, 0.0)))
    elif problem.emg is not None:
        costs.append(emg_target(emg, problem.emg.weight, n))
    whole = program(
        costs,
        [balance(spread(matrix), right)],
        limits,
        widened(fast.lower[:base], -np.inf),
        widened(fast.upper[:base], np.inf),
    )
    return replace(whole, variables=tuple(names), rows=problem.assembly.rows)


def _matrices(problem: TensionProblem, frame: int) -> tuple[Array, Array, Array, Array]:
    """A and b of the equations of motion, and S and what it should add up to of the rows that contacts add."""
    given = problem.balance(frame, frame + 1)
    pattern, extra = problem.assembly.pattern, problem.assembly.extra_row
    variables = len(problem.separable.weight)
    matrix = np.zeros((len(pattern.order), variables))
    matrix[pattern.row, np.repeat(np.arange(variables), np.diff(pattern.start))] = given.values[0]
    shared = variables - len(extra)
    mine = problem.assembly.coordinate_row
    return matrix[mine, :shared], given.right[0, mine], matrix[extra, :shared], given.right[0, extra]


def _emg(problem: TensionProblem, frame: int) -> Array:
    """(muscles,) what EMG tells of a frame, NaN where it tells nothing."""
    names = problem.assembly.tree.model.muscle_names
    told = np.full(len(names), np.nan)
    if problem.emg is not None:
        told[[names.index(one) for one in problem.emg.muscles]] = problem.emg.activations[frame]
    return told

"""Terms that ask muscles for at least a value: what is missing costs, more does not."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.tension.terms.muscles import MuscleTerm
from myomorph.core.tension.terms.term import LIMIT_COST, Frames, Rows, Term, Unknowns, Variables

WEIGHT = 100.0
"""Cost of what is missing, squared, in units of the effort a^2 of one muscle: an aim and no
constraint, so that a joint whose muscles cannot do it still has a solution.
"""


class LeastValueTerm(Term):
    """Rows sum_m c_m a_m - u >= least, whose u passes the least value at no cost.

    Parameters
    ----------
    names : of the rows
    muscles : numbers of the muscles of each row
    """

    def __init__(self, names: Sequence[str], muscles: Sequence[Ints]):
        self._names = tuple(names)
        self._of_rows = tuple(muscles)

    def variables(self) -> Variables:
        """How far each row passes its least value."""
        count = len(self._names)
        return Variables(
            names=tuple(f"{name} beyond" for name in self._names),
            weight=np.full(count, LIMIT_COST),
            exponent=np.full(count, 2.0),
            lower=np.zeros(count),
            upper=np.full(count, np.inf),
        )

    def rows(self, unknowns: Unknowns) -> Rows:
        """One row per name, of its muscles and of what passes the least."""
        self._muscles = next(term for term in unknowns.terms if isinstance(term, MuscleTerm))
        first = unknowns.of(self._muscles).start
        beyond = unknowns.of(self).start
        columns = [
            np.append(first + muscles, beyond + number)
            for number, muscles in enumerate(self._of_rows)
        ]
        return Rows.of_frames(self._names, columns, 1.0, WEIGHT, on_forces=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Value per unit activation of each muscle, and the least value.

        Parameters
        ----------
        rows : as `rows` returned them
        frames : a chunk of the motion

        Returns
        -------
        (frames, entries) and (frames, rows)
        """
        values, least = self.least_values(frames)
        beyond = -np.ones((len(frames), 1))
        return np.hstack([part for value in values for part in (value, beyond)]), least

    @abstractmethod
    def least_values(self, frames: Frames) -> tuple[list[Array], Array]:
        """Values per unit activation of each row's muscles, and the least values.

        Parameters
        ----------
        frames : a chunk of the motion

        Returns
        -------
        (frames, muscles of the row) each, and (frames, rows)
        """

"""Whether an estimate predicts what it was not made from better than the generic value does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from myomorph.core.fit.problem import Problem
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData

WORSE = 1.02  # Ratio of misfits from which one part counts as predicted worse
MIN_RATIO = 1e-150  # Of misfits whose logarithm is taken
Name = TypeVar("Name")


@read_only
class Verdict:
    """Misfits on parts that took no part in the fit, of the estimate and of the generic values.

    Attributes
    ----------
    kinds : what was compared, with its unit: (("force", "N"), ("moment", "N m"))
    parts : names of what was held out in turn
    estimate, generic : (parts, kinds) root mean square misfit
    weights : (parts,) what a part counts, as its frames
    what : what the parts are, in words
    limit : ratio of misfits below which the estimate is better; 1 by default
    """

    kinds: tuple[tuple[str, str], ...]
    parts: tuple[str, ...]
    estimate: Array
    generic: Array
    weights: NDArray
    what: str = "parts held out in turn"
    limit: float = field(default=1.0)

    def __post_init__(self) -> None:
        shape = (len(self.parts), len(self.kinds))
        if np.shape(self.estimate) != shape or np.shape(self.generic) != shape:
            raise BadData(
                f"misfits of {shape[0]} parts and {shape[1]} kinds: expected {shape}, but got"
                f" {np.shape(self.estimate)} and {np.shape(self.generic)}"
            )

    @property
    def known(self) -> bool:
        """Whether anything was held out."""
        return bool(len(self.parts)) and float(np.sum(self.weights)) > 0.0

    def rms(self, misfits: Array) -> Array:
        """Join the misfits of all parts.

        Parameters
        ----------
        misfits : (parts, kinds) `estimate` or `generic`

        Returns
        -------
        (kinds,) root mean square, parts by their weights
        """
        return np.sqrt(self.weights @ np.square(misfits) / np.sum(self.weights))

    @property
    def ratios(self) -> Array:
        """(kinds,) misfit of the estimate over that of the generic values."""
        return self.rms(self.estimate) / np.maximum(self.rms(self.generic), 1e-300)

    @property
    def ratio(self) -> float:
        """Of all kinds together: root of the mean of their squares."""
        return float(np.sqrt(np.mean(np.square(self.ratios))))

    @property
    def log_squares(self) -> float:
        """Logarithm of the squares left over those of the generic values, added over all kinds."""
        return float(2.0 * np.log(np.maximum(self.ratios, MIN_RATIO)).sum())

    @property
    def better(self) -> bool:
        """Whether the estimate predicts better; where nothing was held out, it is not judged."""
        return self.known and self.ratio < self.limit

    @property
    def worse(self) -> bool:
        """Whether the generic values predict at least as well."""
        return self.known and not self.better

    @property
    def losses(self) -> tuple[str, ...]:
        """Parts and kinds that the estimate predicts worse by `WORSE`."""
        lost = []
        for part, row, usual in zip(self.parts, self.estimate, self.generic, strict=True):
            for (kind, unit), found, other in zip(self.kinds, row, usual, strict=True):
                if found > WORSE * other:
                    lost.append(f"{kind} of {part} {found:.3g} {unit} (generic {other:.3g})")
        return tuple(lost)

    @property
    def numbers(self) -> str:
        """Misfits of the estimate and of the generic values, for a line of output."""
        pairs = zip(self.kinds, self.rms(self.estimate), self.rms(self.generic), strict=True)
        return ", ".join(
            f"{kind} {found:.3g} {unit} (generic {other:.3g})"
            for (kind, unit), found, other in pairs
        )

    @property
    def sentence(self) -> str:
        """The verdict with its numbers."""
        if not self.known:
            return "nothing was held out: whether the estimate is better is not known"
        verb = "better" if self.better else "not better"
        return f"predicts {self.what} {verb} than the generic values: {self.numbers}"


def simplest(verdicts: Mapping[Name, Verdict], factor: float) -> Name:
    """Choose the simplest estimate that predicts about as well as the best one.

    Parameters
    ----------
    verdicts : by name, the simplest first, all against the same generic values
    factor : by which its misfit may be above the least

    Returns
    -------
    its name

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.verdict import Verdict, simplest
    >>> verdicts = {
    ...     name: Verdict(
    ...         kinds=(("angle", "rad"),),
    ...         parts=("swing",),
    ...         estimate=np.array([[misfit]]),
    ...         generic=np.array([[1.0]]),
    ...         weights=np.ones(1),
    ...     )
    ...     for name, misfit in {"line": 1.0, "parabola": 0.42, "cubic": 0.4}.items()
    ... }
    >>> simplest(verdicts, 1.1)
    'parabola'
    """
    least = min(verdict.ratio for verdict in verdicts.values())
    return next(name for name, verdict in verdicts.items() if verdict.ratio <= factor * least)


def held_out(
    problem: Problem,
    parts: Sequence[str],
    fit: Sequence[str] | None = None,
    method: Method | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Verdict:
    """Each part predicted by an estimate from all others, and by the generic values.

    Parameters
    ----------
    problem : unknowns, whose starts are the generic values, and residuals
    parts : names of residuals to hold out in turn
    fit, method, progress : see `minimize`

    Returns
    -------
    misfits in units of the noise

    Raises
    ------
    BadData : a part is no residual of the problem

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.core.fit.verdict import held_out
    >>> gain = mm.fit.Block(name="gain", unknowns=(mm.fit.Unknown(name="gain", start=1.0, sd=1.0),))
    >>> trials = tuple(
    ...     mm.fit.Measured(
    ...         name=name, blocks=("gain",), function=lambda values: values["gain"] - 1.5, sd=0.1
    ...     )
    ...     for name in ("walk", "run")
    ... )
    >>> problem = mm.fit.Problem(mm.fit.Unknowns((gain,)), trials)
    >>> held_out(problem, ["walk", "run"]).better
    True
    """
    named = {one.name: one for one in problem.residuals}
    missing = [name for name in parts if name not in named]
    if missing:
        raise BadData(f"no residuals are called '{missing[0]}': expected of {', '.join(named)}")
    found = []
    usual = []
    counts = []
    for name in parts:
        rest = tuple(one for one in problem.residuals if one.name != name)
        alone = Problem(problem.unknowns, (named[name],))
        at = minimize(Problem(problem.unknowns, rest), None, fit, method, progress)
        predicted = alone.at(at.x).parts[0]
        generic = alone.at().parts[0]
        found.append([np.sqrt(predicted.cost / max(predicted.count, 1))])
        usual.append([np.sqrt(generic.cost / max(generic.count, 1))])
        counts.append(generic.count)
    return Verdict(
        kinds=(("misfit", "SD"),),
        parts=tuple(parts),
        estimate=np.reshape(found, (-1, 1)),
        generic=np.reshape(usual, (-1, 1)),
        weights=np.array(counts, np.float64),
    )

"""How sure the results of a trial are: the same chain on many inputs that are drawn with their errors."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from myomorph.io.sto import write_sto
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.frozen_map import FrozenMap
from myomorph.store.progress import progress
from myomorph.store.results import ResultWriter, Stored
from myomorph.study.trial.drawn_trials import FAILURES, Chain, Quantity, alone, chain_of, frozen
from myomorph.study.trial.step import Step, StepOutput
from myomorph.study.trial.steps.id import Torques
from myomorph.study.trial.steps.ik import Poses
from myomorph.study.trial.steps.tension import Tensions
from myomorph.study.trial.trial_inputs import OptionSet, TrialInputs
from myomorph.uncertainty.bodies import Draw
from myomorph.uncertainty.normals import Normals
from myomorph.uncertainty.sources import GROUPS, Sources
from myomorph.uncertainty.spread import LEVEL, Draws, Spread

TABLE = "uncertainty.csv"
MAY_FAIL = 0.02
"""Share of draws without a solution above which the result is doubted."""
DIMENSIONS = {"coordinates": "coordinate", "torques": "coordinate", "activations": "muscle", "forces": "muscle"}


@dataclass(frozen=True)
class DrawOptions:
    """How results are drawn.

    Attributes
    ----------
    draws : inputs drawn with all their errors; the limits hold 90 % of what comes of them
    contributions : further draws for each group of sources, once with it alone and once with all but it, for the table
        of what each contributes; 0 for no such table
    draw_seed : other random numbers for another one
    """

    draws: int = 200
    contributions: int = 12
    draw_seed: int = 0

    def __post_init__(self) -> None:
        if self.draws < 2:
            raise BadData(f"{self.draws} draws: expected 2 or more")
        if not 0 <= self.contributions <= self.draws:
            raise BadData(f"contributions from {self.contributions} draws: expected 0 to {self.draws}, the draws of all")


@dataclass(frozen=True, eq=False)
class Shares:
    """What groups of sources contribute to the columns of one table, as shares of the variance (groups, names).

    Attributes
    ----------
    alone : of each group, the others left out
    total : what is missing where a group is left out, with all that it does together with others
    """

    groups: tuple[str, ...]
    alone: Array
    total: Array


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The spread of every table of a trial.

    Attributes
    ----------
    spreads : by the tables' names
    failed : draws without a solution
    shares : by the tables' names, what each group of sources contributes
    """

    spreads: Mapping[str, Spread]
    failed: int = 0
    shares: Mapping[str, Shares] = field(default_factory=lambda: FrozenMap({}))
    notes: tuple[str, ...] = ()


def _run(
    trial: TrialInputs, output: StepOutput, poses: Poses, torques: Torques | None, tensions: Tensions | None
) -> Uncertainty:
    chosen, sources = trial.options[DrawOptions], trial.options[Sources]
    chain = chain_of(trial, poses, torques, tensions)
    quantities = chain.quantities()
    normals = Normals(chosen.draws, chosen.draw_seed)
    groups = tuple(one for one in GROUPS if any(sources.of(one).values())) if chosen.contributions else ()
    runs, failed = chosen.draws + 2 * len(groups) * chosen.contributions, 0
    shapes = {one.name: one.values.shape for one in quantities}
    with progress(f"{trial.name}: uncertainty", runs) as advance, Draws(chosen.draws, shapes) as draws:
        for number in range(chosen.draws):
            try:
                draws.put(number, chain.drawn(Draw(number, sources, normals)))
            except FAILURES:
                failed += 1
            advance(1)
        if len(draws.done) < 2:
            raise BadData(f"{trial.name}: of {chosen.draws} draws {failed} have no solution: state smaller errors")
        spreads = {one.name: draws.spread(one.name, one.time, one.names) for one in quantities}
        shares = _shares(chain, quantities, draws, normals, groups, chosen.contributions, advance)
    found = Uncertainty(spreads, failed, shares, _notes(failed, chosen.draws))
    for one in quantities:
        _write(one, spreads[one.name], output)
    _write_shares(quantities, found, output)
    return found


def _shares(
    chain: Chain,
    quantities: tuple[Quantity, ...],
    draws: Draws,
    normals: Normals,
    groups: tuple[str, ...],
    count: int,
    advance: Callable[[int], None],
) -> dict[str, Shares]:
    """Shares of the variance, by Jansen's estimator on common random numbers.

    Source: Jansen 1999; Saltelli et al. 2010.
    """
    sources = chain.trial.options[Sources]
    usable = [number for number in draws.done if number < count]
    found = {one.name: (np.zeros((len(groups), len(one.names))), np.zeros((len(groups), len(one.names)))) for one in quantities}
    for g, group in enumerate(groups):
        sums = {one.name: np.zeros((2, len(one.names))) for one in quantities}
        done = 0
        for number in usable:
            try:
                own = chain.drawn(Draw(number, alone(sources, group), normals))
                rest = chain.drawn(Draw(number, frozen(sources, group), normals))
            except FAILURES:
                continue
            finally:
                advance(2)
            done += 1
            for one in quantities:
                whole = draws.at(one.name, number)
                sums[one.name][0] += np.nanmean((own[one.name] - one.values) ** 2, axis=0)
                sums[one.name][1] += np.nanmean((whole - rest[one.name]) ** 2, axis=0)
        for one in quantities:
            for k in range(2):
                found[one.name][k][g] = sums[one.name][k] / max(done, 1)
    made = {}
    for one in quantities if groups else ():
        variance = np.nanmean([np.nanmean((draws.at(one.name, n) - one.values) ** 2, axis=0) for n in usable], axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            made[one.name] = Shares(groups, found[one.name][0] / variance, found[one.name][1] / variance)
    return made


def _notes(failed: int, draws: int) -> tuple[str, ...]:
    if failed <= MAY_FAIL * draws:
        return ()
    return (f"uncertainty: {failed} of {draws} draws have no solution and are left out: the limits are too narrow",)


def _write(quantity: Quantity, spread: Spread, output: StepOutput) -> None:
    """Tables of the limits beside the table itself, and all of it in the result file."""
    ending = ".mot" if quantity.name == "coordinates" else ".sto"
    for name, values in (("low", spread.low), ("high", spread.high)):
        write_sto(quantity.table(values), output.folder / f"{quantity.name}_{name}{ending}")
    dimension = DIMENSIONS.get(quantity.name, f"{quantity.name}_column")
    output.writer.time(spread.time)
    output.writer.names(dimension, spread.names)
    unit = " or ".join(dict.fromkeys(quantity.units))
    parts = (("low", spread.low), ("high", spread.high), ("sd", spread.deviation))
    meanings = {"low": "lower limit of 90 % of the draws", "high": "upper limit", "sd": "standard deviation of the draws"}
    for name, values in parts:
        output.writer.put(f"{quantity.name}_{name}", ("time", dimension), values, unit or "1", meanings[name])


def _write_shares(quantities: tuple[Quantity, ...], found: Uncertainty, output: StepOutput) -> None:
    """One row a column: how wide its limits are, and what contributes to that."""
    groups = next((one.groups for one in found.shares.values()), ())
    head = ("table", "column", "unit", "sd", "width", *(f"{one}_{kind}" for kind in ("alone", "total") for one in groups))
    with (output.folder / TABLE).open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(head)
        for one in quantities:
            spread, shares = found.spreads[one.name], found.shares.get(one.name)
            deviations = np.sqrt(np.nanmean(spread.deviation**2, axis=0))
            widths = np.nanmean(spread.high - spread.low, axis=0)
            for k, name in enumerate(one.names):
                parts = () if shares is None else (*shares.alone[:, k], *shares.total[:, k])
                numbers = (deviations[k], widths[k], *parts)
                rows.writerow((one.name, name, one.units[k], *(f"{value:.4g}" for value in numbers)))


def _read(stored: Stored, options: OptionSet) -> Uncertainty | None:
    spreads = {}
    for key in stored.values:
        if not key.endswith("_sd"):
            continue
        name = key.removesuffix("_sd")
        names = stored.names[DIMENSIONS.get(name, f"{name}_column")]
        parts = (stored.values[f"{name}_{one}"] for one in ("low", "high", "sd"))
        spreads[name] = Spread(stored.time, names, *parts)
    return Uncertainty(spreads) if spreads else None


STEP = Step(
    name="uncertainty",
    title="uncertainty",
    gives=Uncertainty,
    needs=(Poses,),
    uses=(Torques, Tensions),
    options=(DrawOptions, Sources),
    grows_with="muscles",
    run=_run,
    read=_read,
)

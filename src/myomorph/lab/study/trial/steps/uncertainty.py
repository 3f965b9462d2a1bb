"""How sure the results of a trial are.

The same chain is computed on many inputs that are drawn with their errors.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.core.io.sto import write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.rigid.frames import thread_count
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.causes import DRAWS
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import Stored
from myomorph.lab.store.uncertainty_store import (
    ERRORS,
    get_uncertainty,
    put_uncertainty,
    put_value_errors,
)
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.step.step import Step, StepOutput
from myomorph.lab.study.trial.steps.drawn_quantities import (
    DrawnGait,
    DrawnTable,
    DrawnValues,
    drawn_values,
    widened_gait,
)
from myomorph.lab.study.trial.steps.drawn_trials import (
    COARSE,
    Chain,
    ShareDraw,
    alone,
    chain_of,
    without,
)
from myomorph.lab.study.trial.steps.id import Torques
from myomorph.lab.study.trial.steps.ik import Poses
from myomorph.lab.study.trial.steps.tension import Tensions, strides_of_trial
from myomorph.lab.study.trial.trial_inputs import TrialInputs
from myomorph.lab.study.trial.trial_strides import TrialStrides
from myomorph.lab.study.workers.jobs import Job
from myomorph.lab.study.workers.local_workers import LocalWorkers
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.quantities import QUANTITIES
from myomorph.lab.uncertainty.sources import NOTHING, ErrorSizes, Sources, SourceSize, source_sizes
from myomorph.lab.uncertainty.spread import (
    FACTORS,
    Draws,
    Shares,
    Spread,
    Uncertainty,
    ValueErrors,
    bounds_of,
    widened,
    widened_errors,
)

TABLE = "uncertainty.csv"
SOURCE_TABLE = "uncertainty_sources.csv"
MAX_UNSOLVED = 0.02  # Share of draws without a solution above which the result is questioned
AGAIN = 4
"""So many times the errors of another draw are added to each, which shows how much errors make
extremes and ranges larger.
"""
MAX_WEAK = 0.2  # Share of draws of bodies too weak for the motion above which it is

Tables = Mapping[str, Array]
WORTH = 8.0
"""Processes are begun where what is left would take longer in this one [s]; to begin one takes two
or three.
"""
# Results a process may be ahead of the one that is waited for, so that memory does not grow with
# draws.
AHEAD = 4
PATIENCE = 1.0  # Between two looks at processes of which none has answered [s].


@dataclass(frozen=True)
class DrawOptions:
    """How results are drawn.

    Attributes
    ----------
    draws : number of draws of all inputs with their errors; 90 % of the results lie within the
        bounds
    contributions : number of further draws for each group of error sources (at most `draws`), with
        this group alone and with all others, for the table of contributions; 0 for no such table
    all_frames : recompute every frame; by default poses are recomputed at 50 frames per second and
        tensions at 25, and interpolated between
    draw_seed : seed of the random numbers
    widened : widen intervals by factors found on simulated recordings whose errors differ from the
        assumed ones
    """

    draws: int = 200
    contributions: int = 12
    all_frames: bool = False
    draw_seed: int = 0
    widened: bool = True

    def __post_init__(self) -> None:
        if self.draws < 2:
            raise BadData(f"{self.draws} draws: expected 2 or more")
        if self.contributions < 0:
            raise BadData(f"contributions from {self.contributions} draws: expected 0 or more")


@dataclass(frozen=True)
class DrawWorkers:
    """Processes that share the draws.

    Attributes
    ----------
    workers : Number of processes that share the draws; 0 for as many as threads, if that saves
        time.
    """

    workers: int = 0

    def __post_init__(self) -> None:
        if self.workers < 0:
            raise BadData(f"{self.workers} workers: expected 1 or more, or 0 to leave it open")


@dataclass(frozen=True)
class _FoundHash:
    """What interval bounds depend on beside options and sources.

    Attributes
    ----------
    error_sizes : hash of the sizes that steps on the subject found
    """

    error_sizes: str


@dataclass(frozen=True)
class Failures:
    """Draws without results.

    Attributes
    ----------
    unsolved : for which the chain has no solution
    weak : whose body is too weak for the motion
    """

    unsolved: int
    weak: int


class DrawnErrors:
    """Errors of a trial's numbers and gait curves, draw by draw; NaN where a draw has no results.

    Attributes
    ----------
    numbers : (draws, numbers) drawn less nominal
    room : (2, numbers) bounds less nominal
    again : (`AGAIN`, draws, numbers) drawn, with the errors of another draw added, less nominal
    gait : side -> (draws, samples, variables) drawn less nominal mean curve; {} for no walk
    """

    def __init__(
        self, draws: int, nominal: Tables, values: DrawnValues, walk: DrawnGait | None
    ) -> None:
        self._values = values
        self._walk = walk
        self._nominal_numbers = values.of(nominal)
        lowest, highest = values.bounds - self._nominal_numbers
        self.room = np.array([np.minimum(lowest, 0.0), np.maximum(highest, 0.0)])
        self._nominal_curves = {} if walk is None else walk.means(nominal)
        self.numbers = np.full((draws, len(values.names)), np.nan)
        self.again = np.full((AGAIN, draws, len(values.names)), np.nan)
        self.gait = {
            side: np.full((draws, *curves.shape), np.nan)
            for side, curves in self._nominal_curves.items()
        }

    def put(self, number: int, tables: Tables) -> None:
        """Keep the errors of one draw."""
        self.numbers[number] = self._values.of(tables) - self._nominal_numbers
        if self._walk is None:
            return
        for side, curves in self._walk.means(tables).items():
            self.gait[side][number] = curves - self._nominal_curves[side]

    def put_again(self, draws: Draws) -> None:
        """Add the errors of other draws to the tables of each, in turn."""
        tables = [quantity for quantity, _ in self._values.columns]
        bounds = {table.name: bounds_of(table.quantity, table.names) for table in tables}
        for shift in range(AGAIN):
            others = np.roll(draws.done, shift + 1).tolist()
            for number, other in zip(draws.done, others, strict=True):
                twice = {
                    table.name: np.clip(
                        draws.at(table.name, number) + draws.at(table.name, other) - table.values,
                        *bounds[table.name],
                    )
                    for table in tables
                }
                self.again[shift, number] = self._values.of(twice) - self._nominal_numbers


def _run(
    trial: TrialInputs,
    output: StepOutput,
    poses: Poses,
    torques: Torques | None,
    tensions: Tensions | None,
) -> Uncertainty:
    """Run the chain on inputs that are drawn with their errors.

    Intervals of its results are written.
    """
    options = trial.options[DrawOptions]
    sources = trial.options[Sources]
    sizes = (trial.get(ErrorSizes) or NOTHING).beside(sources)
    nominal = _nominal(trial, poses, torques, tensions is not None)
    jobs = _jobs(nominal.chain, options, sources, sizes)
    drawn = _drawn(trial, nominal, jobs)

    factors = dict.fromkeys(nominal.tables, 1.0)
    if options.widened:
        factors = {name: FACTORS.get(name, 1.0) for name in nominal.tables}
    uncertainty = Uncertainty(
        spreads={name: widened(spread, factors[name]) for name, spread in drawn.spreads.items()},
        shares=drawn.shares,
        draws=options.draws,
        failed=drawn.failures.unsolved + drawn.failures.weak,
        notes=_notes(drawn.failures, options.draws),
        factors=factors,
        sizes=source_sizes(sources, sizes),
        gait=widened_gait(drawn.errors.gait, factors),
    )
    _write_intervals(nominal.whole, uncertainty, output.folder)
    _write_table(nominal.whole, uncertainty, output.folder / TABLE)
    _write_sources(uncertainty.sizes, output.folder / SOURCE_TABLE)
    put_uncertainty(output.writer, uncertainty)
    put_value_errors(output.writer, _value_errors(nominal.values, drawn.errors, factors))
    return uncertainty


@dataclass(frozen=True, eq=False)
class _Nominal:
    """What errors are drawn around: the results without errors.

    Attributes
    ----------
    chain : that draws are computed by
    whole : tables with all frames
    drawn : the same tables with the frames that are drawn
    values : numbers that are stored of each draw
    walk : for gait curves, None for no walk
    """

    chain: Chain
    whole: tuple[DrawnTable, ...]
    drawn: tuple[DrawnTable, ...]
    values: DrawnValues
    walk: DrawnGait | None

    @cached_property
    def tables(self) -> Tables:
        """(frames, names) of the tables with the frames that are drawn, by name."""
        return {quantity.name: quantity.values for quantity in self.drawn}


def _nominal(trial: TrialInputs, poses: Poses, torques: Torques | None, tense: bool) -> _Nominal:
    """Compute the results without errors; `tense`: muscle tensions are among them."""
    thin = not trial.options[DrawOptions].all_frames
    chain = chain_of(trial, poses, torques, tense, thin)
    whole, drawn = zip(*chain.quantities(), strict=True)
    strides = strides_of_trial(trial, poses, torques)
    whole_strides = TrialStrides.whole(trial.name, strides)
    if whole_strides is not None and torques is not None:
        whole_strides = whole_strides.on_plates(trial.model, torques.wrenches)
    return _Nominal(
        chain=chain,
        whole=whole,
        drawn=drawn,
        values=drawn_values(drawn, whole_strides),
        walk=None if strides is None else _walk(trial, drawn, strides, torques),
    )


@dataclass(frozen=True)
class _Jobs:
    """Draws in the order in which they are computed.

    Attributes
    ----------
    of_all : with the errors of all sources
    of_groups : with those of one group of sources alone, and of all but it
    groups : in that order, () where contributions are not requested
    """

    of_all: list[Draw]
    of_groups: list[Draw]
    groups: tuple[str, ...]


def _jobs(chain: Chain, options: DrawOptions, sources: Sources, sizes: ErrorSizes) -> _Jobs:
    normals = Normals(options.draws, options.draw_seed)
    draws_of_all = [
        Draw(number=number, sources=sources, normals=normals, found=sizes)
        for number in range(options.draws)
    ]
    groups = _groups_with_errors(chain, sources) if options.contributions else ()
    draws_of_groups = _draws_of_groups(groups, options, sources, normals, sizes)
    return _Jobs(of_all=draws_of_all, of_groups=draws_of_groups, groups=groups)


@dataclass(frozen=True, eq=False)
class _Drawn:
    """What the draws of a trial come to.

    Attributes
    ----------
    errors : of numbers and gait curves, draw by draw
    spreads : of each table at all its frames
    shares : of groups of sources in the variance of each table, {} where not requested
    failures : draws without results
    """

    errors: DrawnErrors
    spreads: dict[str, Spread]
    shares: dict[str, Shares]
    failures: Failures


def _drawn(trial: TrialInputs, nominal: _Nominal, jobs: _Jobs) -> _Drawn:
    """Compute the draws; raise `BadData` where fewer than two have results."""
    count = len(jobs.of_all)
    shapes = {name: values.shape for name, values in nominal.tables.items()}
    errors = DrawnErrors(
        draws=count, nominal=nominal.tables, values=nominal.values, walk=nominal.walk
    )
    every = [*jobs.of_all, *jobs.of_groups]
    workers = trial.options[DrawWorkers].workers or None
    title = f"{trial.name}: uncertainty"
    with progress(title, len(every), "draws") as advance, Draws(count, shapes) as draws:
        results = attempts(nominal.chain, every, workers)
        failures = _collected(islice(results, count), draws, errors, advance)
        if len(draws.done) < 2:
            raise BadData(
                f"{trial.name}: of {count} draws {failures.unsolved} have no solution, "
                f"and of {failures.weak} the body is too weak for the motion: state smaller errors"
            )
        errors.put_again(draws)
        spreads = {
            of_all.name: _spread(draws, of_all, of_drawn)
            for of_all, of_drawn in zip(nominal.whole, nominal.drawn, strict=True)
        }
        shares = {}
        if jobs.groups:
            shares = _shares(nominal.drawn, draws, jobs.groups, jobs.of_groups, results, advance)
    return _Drawn(errors=errors, spreads=spreads, shares=shares, failures=failures)


def _value_errors(
    values: DrawnValues, errors: DrawnErrors, factors: Mapping[str, float]
) -> ValueErrors:
    """Widen errors of numbers by the factor of each one's table."""
    factor_of_number = np.array([factors[name] for name in values.tables])
    return ValueErrors(
        names=values.names,
        errors=widened_errors(errors.numbers, factor_of_number),
        room=errors.room,
        again=np.stack([widened_errors(each, factor_of_number) for each in errors.again]),
    )


def _spread(draws: Draws, of_all: DrawnTable, of_drawn: DrawnTable) -> Spread:
    """Spread of a quantity at all its frames, from the frames that were drawn."""
    spread = draws.spread(of_all.name, of_drawn.time, of_all.names)
    spread = replace(spread, quantity=of_all.quantity)
    return spread.over(of_all.time, of_drawn.values, of_all.values)


def _walk(
    trial: TrialInputs, drawn: Sequence[DrawnTable], strides: Strides, torques: Torques | None
) -> DrawnGait:
    by_name = {quantity.name: quantity for quantity in drawn}
    coordinates = by_name[COORDINATE_VALUE.name]
    return DrawnGait(
        model=trial.model,
        time=coordinates.time,
        names=coordinates.names,
        torques=by_name.get(GENERALIZED_FORCE.name),
        strides=strides,
        wrenches=None if torques is None else torques.wrenches,
    )


def _groups_with_errors(chain: Chain, sources: Sources) -> tuple[str, ...]:
    return tuple(group for group in chain.groups if any(sources.of(group).values()))


def _draws_of_groups(
    groups: Sequence[str],
    options: DrawOptions,
    sources: Sources,
    normals: Normals,
    sizes: ErrorSizes,
) -> list[Draw]:
    """For each group and number, a draw with that group alone, then one with all but it."""
    draws: list[Draw] = []
    for group in groups:
        for number in range(min(options.contributions, options.draws)):
            draws.append(
                ShareDraw(
                    number=number, sources=alone(sources, group), normals=normals, found=sizes
                )
            )
            draws.append(
                ShareDraw(
                    number=number, sources=without(sources, group), normals=normals, found=sizes
                )
            )
    return draws


def _collected(
    results: Iterable[Tables | None],
    draws: Draws,
    errors: DrawnErrors,
    advance: Callable[[int], None],
) -> Failures:
    """Keep the results of draws in order: None has no solution, an empty one a body too weak."""
    unsolved = 0
    weak = 0
    for number, tables in enumerate(results):
        if tables is None:
            unsolved += 1
        elif not tables:
            weak += 1
        else:
            draws.put(number, tables)
            errors.put(number, tables)
        advance(1)
    return Failures(unsolved=unsolved, weak=weak)


def _write_intervals(
    quantities: Sequence[DrawnTable], uncertainty: Uncertainty, folder: Path
) -> None:
    """Lower and upper bounds of each table, as tables of their own."""
    for drawn in quantities:
        quantity = drawn.quantity
        spread = uncertainty.spreads[quantity.name]
        for bound, values in (("low", spread.low), ("high", spread.high)):
            file = f"{quantity.stem}_{bound}{quantity.suffix}"
            write_sto(drawn.table(values), folder / file)


def _shares(
    quantities: tuple[DrawnTable, ...],
    draws: Draws,
    groups: tuple[str, ...],
    jobs: Sequence[Draw],
    results: Iterator[Tables | None],
    advance: Callable[[int], None],
) -> dict[str, Shares]:
    """Estimate what groups of sources contribute to the variance.

    It is Jansen's estimator (Jansen 1999; Saltelli et al. 2010), on numbers that all draws share.
    Jobs are, of each group and number, with the group alone and, where errors do not just add up,
    with all but it.
    """
    done = set(draws.done)
    numbers = sorted({job.number for job in jobs} & done)
    each = len({job.number for job in jobs})
    kinds = len(jobs) // (each * len(groups))
    whole = {quantity.name: _variance(quantity, draws, numbers) for quantity in quantities}
    # By table: squares alone and in total of each group, and how many they are of.
    squares = {
        quantity.name: np.zeros((kinds, len(groups), len(quantity.names)))
        for quantity in quantities
    }
    counts = np.zeros((kinds, len(groups), 1))
    for index, (job, tables) in enumerate(zip(jobs, results, strict=True)):
        group = index // (each * kinds)
        kind = index % kinds
        advance(1)
        if not tables or job.number not in done:
            continue
        counts[kind, group] += 1
        for quantity in quantities:
            other = quantity.values if kind == 0 else draws.at(quantity.name, job.number)
            table = tables[quantity.name]
            # Tensions of some frames alone: a mean over time needs no more.
            squares[quantity.name][kind, group] += _mean_square(
                table - other[:: 1 if len(table) == len(other) else COARSE]
            )
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = {
            name: square / np.maximum(counts, 1) / whole[name] for name, square in squares.items()
        }
    return {name: Shares(groups, part[0], part[-1]) for name, part in parts.items()}


def _variance(quantity: DrawnTable, draws: Draws, numbers: Sequence[int]) -> Array:
    """(columns,) mean square of a table's errors in some draws, over its frames."""
    variance = np.zeros(len(quantity.names))
    for number in numbers:
        errors = draws.at(quantity.name, number) - quantity.values
        variance += _mean_square(errors) / len(numbers)
    return variance


def _mean_square(values: Array) -> Array:
    """(columns,) over the frames that have a value."""
    return np.asarray((np.nan_to_num(values) ** 2).mean(axis=0))


def _notes(failures: Failures, draws: int) -> tuple[Message, ...]:
    notes = []
    if failures.unsolved > MAX_UNSOLVED * draws:
        notes.append(
            DRAWS.message(
                f"uncertainty: {failures.unsolved} of {draws} draws have no solution and are left"
                " out: limits are too narrow"
            )
        )
    if failures.weak > MAX_WEAK * draws:
        notes.append(
            DRAWS.message(
                f"uncertainty: in {failures.weak} of {draws} draws the muscles are too weak for the"
                " motion, and they are left out: the model itself is barely strong enough"
            )
        )
    return tuple(notes)


def _write_table(quantities: tuple[DrawnTable, ...], uncertainty: Uncertainty, path: Path) -> None:
    """One row a column: how wide its limits are, and what contributes to that."""
    groups = next((share.groups for share in uncertainty.shares.values()), ())
    shares_head = (f"{group}_{kind}" for kind in ("alone", "total") for group in groups)
    head = ("quantity", "column", "unit", "sd", "width", "widened", *shares_head)
    rows = []
    for quantity in quantities:
        spread = uncertainty.spreads[quantity.name]
        shares = uncertainty.shares.get(quantity.name)
        deviations = quantity.factors * np.sqrt(np.nanmean(spread.deviation**2, axis=0))
        widths = quantity.factors * np.nanmean(spread.high - spread.low, axis=0)
        for index, name in enumerate(quantity.names):
            parts = () if shares is None else (*shares.alone[:, index], *shares.total[:, index])
            numbers = (deviations[index], widths[index], uncertainty.factors[quantity.name], *parts)
            rows.append((quantity.name, name, quantity.units[index], *numbers))
    write_csv(path, head, rows, digits=4)


def _write_sources(sizes: Sequence[SourceSize], path: Path) -> None:
    """One row a source of error: how large it was taken to be, and where that comes from."""
    rows = (
        (
            size.group,
            size.source,
            size.size,
            size.origin,
            size.items or "",
            size.least,
            size.greatest,
        )
        for size in sizes
    )
    head = ("group", "source", "sd", "origin", "items", "min_sd", "max_sd")
    write_csv(path, head, rows, digits=4)


def _hashed(trial: TrialInputs) -> Sequence[object]:
    """Options, sizes, and what steps on the subject found, where they found anything."""
    chosen = (trial.options[DrawOptions], trial.options[Sources])
    sizes = trial.get(ErrorSizes) or NOTHING
    rows = sorted(size for item in sizes.items.values() for size in item.values())
    return (
        chosen
        if sizes == NOTHING
        else (*chosen, _FoundHash(sha256(repr(rows).encode()).hexdigest()[:16]))
    )


def _show(report_input: ReportInput, stored: Stored) -> ReportInput:
    uncertainty = get_uncertainty(stored)
    return report_input if uncertainty is None else replace(report_input, uncertainty=uncertainty)


def attempts(
    chain: Chain, draws: Sequence[Draw], workers: int | None = None
) -> Iterator[Tables | None]:
    """Yield the values of draws, in order, None for no solution.

    By default all threads are used where that is worth their start.
    """
    count = thread_count() if workers is None else workers
    if count <= 1 or len(draws) <= 2:
        yield from (chain.attempt(draw) for draw in draws)
        return
    # The first draw may compile kernels; the second tells how long one takes.
    yield chain.attempt(draws[0])
    begun = time.monotonic()
    yield chain.attempt(draws[1])
    left = draws[2:]
    if workers is None and len(left) * (time.monotonic() - begun) < WORTH:
        yield from (chain.attempt(draw) for draw in left)
        return
    with closing(LocalWorkers(min(count, len(left)))) as hands:
        yield from _shared(chain, left, hands)


def _shared(chain: Chain, draws: Sequence[Draw], hands: LocalWorkers) -> Iterator[Tables | None]:
    """Yield the same by processes; what one of them loses, or cannot do, is done in this one."""
    # What reads the recording's forces is a function of this process; the forces themselves are in
    # the chain.
    sent: Any = replace(
        chain, trial=replace(chain.trial, inputs=chain.trial.inputs.without(ExternalLoads))
    )
    works = [cast(Any, partial(_attempt, draw)) for draw in draws]
    jobs = [Job(("draw", str(number)), work) for number, work in enumerate(works)]
    results: dict[int, Tables | None] = {}
    begun = 0
    running = 0
    for number in range(len(draws)):
        while number not in results:
            while running < hands.count and begun < min(len(draws), number + AHEAD * hands.count):
                hands.start(jobs[begun], sent)
                begun = begun + 1
                running = running + 1
            for ended in hands.ended(PATIENCE):
                running -= 1
                place = int(ended.job.key[1])
                outcome = cast(Any, ended.outcome)
                results[place] = chain.attempt(draws[place]) if ended.lost else outcome[0]
        yield results.pop(number)


def _attempt(draw: Draw, chain: Any) -> tuple[Tables | None]:
    """Return the values of a draw, in a process that was sent the chain."""
    return (chain.attempt(draw),)


STEP = Step(
    name="uncertainty",
    title="uncertainty",
    gives=Uncertainty,
    quantities=QUANTITIES,
    needs=(Poses,),
    uses=(Torques, Tensions),
    options=(DrawOptions, Sources, DrawWorkers),
    hashed=_hashed,
    run=_run,
    large=(ERRORS,),
    read=lambda stored, options: get_uncertainty(stored),
    show=_show,
)

"""What a run would do, as the lines that `myomorph run --dry-run` prints."""

from __future__ import annotations

from collections.abc import Iterator

from myomorph.study.run.dry_run import DryRun, Row
from myomorph.study.run.expected_time import in_words
from myomorph.study.trial.reuse import NEVER

HEADING = ("subject", "trial", "condition", "frames", "reused", "computed", "time", "files")
MAX_NAMES = 4


def dry_run_lines(dry_run: DryRun) -> Iterator[str]:
    """The lines that `myomorph run --dry-run` prints."""
    trials = [row for row in dry_run.rows if row.trial]
    subjects = dict.fromkeys(row.subject for row in dry_run.rows)
    conditions = dry_run.plan.conditions.names
    counts = [_many(len(subjects), "subject"), _many(len(trials), "trial")]
    counts += [f"conditions {', '.join(conditions)}"] if conditions else []
    yield f"{dry_run.plan.name}: {', '.join(counts)}; results go to {dry_run.out}"
    yield ""
    yield from _table(dry_run.rows, bool(conditions))
    yield from _reasons(dry_run.rows)
    if dry_run.excluded:
        yield ""
        yield "left out:"
        yield from (f"  {_name(one.subject, one.trial)}: {one.reason}" for one in dry_run.excluded)
    if dry_run.problems:
        yield ""
        yield "cannot be looked at:"
        yield from (f"  {problem}" for problem in dry_run.problems)
    yield ""
    yield from _time(dry_run)


def _table(rows: tuple[Row, ...], conditions: bool) -> Iterator[str]:
    shown = [name for name in HEADING if conditions or name != "condition"]
    cells = [HEADING, *map(_cells, rows)]
    columns = [[row[HEADING.index(name)] for row in cells] for name in shown]
    widths = [max(map(len, column)) for column in columns]
    for line in zip(*columns, strict=True):
        yield "  ".join(
            cell.rjust(width) if name in ("frames", "time") else cell.ljust(width)
            for name, cell, width in zip(shown, line, widths, strict=True)
        ).rstrip()


def _cells(row: Row) -> tuple[str, ...]:
    time = row.expected.seconds
    return (
        row.subject,
        row.trial,
        row.condition,
        "?" if row.frames is None else str(row.frames),
        " ".join(row.reused) or "-",
        " ".join(row.computed) or "-",
        ("-" if not row.computed else "?") if time is None or not row.computed else in_words(time),
        ", ".join(row.files),
    )


def _reasons(rows: tuple[Row, ...]) -> Iterator[str]:
    """Why results that are there would be computed again, each reason once."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        for step, why in row.reasons.items():
            for text in why:
                if text != NEVER:
                    found.setdefault(text, {}).setdefault(_name(row.subject, row.trial), []).append(step)
    if found:
        yield ""
        yield "computed again, because"
    for text, names in found.items():
        shown = [f"{name} ({' '.join(steps)})" for name, steps in list(names.items())[:MAX_NAMES]]
        rest = f" and {_many(len(names) - MAX_NAMES, 'other')}" if len(names) > MAX_NAMES else ""
        yield f"  {text}: {', '.join(shown)}{rest}"


def _time(dry_run: DryRun) -> Iterator[str]:
    expected = dry_run.expected
    if not any(row.computed for row in dry_run.rows):
        yield "nothing to compute: all results are there and would come out the same"
        return
    seconds = expected.seconds or 0.0
    work = f"{in_words(seconds)} of work and {in_words(dry_run.begins)} to begin and to write the study's page"
    yield f"expected: {in_words(dry_run.lasts)} with {_many(dry_run.side, 'worker')}, {work}"
    if dry_run.compiles:
        yield f"  and {in_words(dry_run.compiles)} more, once on this machine, to compile kernels"
    if expected.measured:
        yield "  by what steps took before on this machine (timings.csv, and step_times.csv in the user's cache folder)"
    else:
        yield "  a guess: steps that did not run here before by the times of another machine and the speed of this one"
    if dry_run.unknown:
        count = len(dry_run.unknown)
        names = ", ".join(dry_run.unknown[:MAX_NAMES]) + (", ..." if count > MAX_NAMES else "")
        yield f"  without {_many(count, 'row')} for which nothing tells: {names}"


def _name(subject: str, trial: str) -> str:
    return f"{subject}/{trial}".rstrip("/") if subject != trial else subject


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")

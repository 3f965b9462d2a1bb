"""What a run would do, as the lines that `myomorph run --dry-run` prints."""

from __future__ import annotations

from collections.abc import Iterator

from myomorph.study.run.dry_run import DryRun, Row
from myomorph.study.run.expected_time import in_words
from myomorph.study.trial.reuse import NEVER

HEADING = ("subject", "trial", "condition", "frames", "reused", "computed", "time", "files")
MAX_NAMES = 4


def dry_run_lines(found: DryRun) -> Iterator[str]:
    """The lines that `myomorph run --dry-run` prints."""
    trials = [row for row in found.rows if row.trial]
    subjects = dict.fromkeys(row.subject for row in found.rows)
    conditions = found.plan.conditions.names
    counts = [_many(len(subjects), "subject"), _many(len(trials), "trial")]
    counts += [f"conditions {', '.join(conditions)}"] if conditions else []
    yield f"{found.plan.name}: {', '.join(counts)}; results go to {found.out}"
    yield ""
    yield from _table(found.rows, bool(conditions))
    yield from _reasons(found.rows)
    if found.excluded:
        yield ""
        yield "left out:"
        yield from (f"  {_name(one.subject, one.trial)}: {one.reason}" for one in found.excluded)
    if found.problems:
        yield ""
        yield "cannot be looked at:"
        yield from (f"  {problem}" for problem in found.problems)
    yield ""
    yield from _time(found)


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


def _time(found: DryRun) -> Iterator[str]:
    expected = found.expected
    if not any(row.computed for row in found.rows):
        yield "nothing to compute: all results are there and would come out the same"
        return
    seconds = expected.seconds or 0.0
    work = f"{in_words(seconds)} of work and {in_words(found.begins)} to begin and to write the study's page"
    yield f"expected: {in_words(found.lasts)} with {_many(found.side, 'worker')}, {work}"
    if found.compiles:
        yield f"  and {in_words(found.compiles)} more, once on this machine, to compile kernels"
    if expected.measured:
        yield "  by what steps took before on this machine (timings.csv, and step_times.csv in the user's cache folder)"
    else:
        yield "  a guess: steps that did not run here before by the times of another machine and the speed of this one"
    if found.unknown:
        count = len(found.unknown)
        names = ", ".join(found.unknown[:MAX_NAMES]) + (", ..." if count > MAX_NAMES else "")
        yield f"  without {_many(count, 'row')} for which nothing tells: {names}"


def _name(subject: str, trial: str) -> str:
    return f"{subject}/{trial}".rstrip("/") if subject != trial else subject


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")

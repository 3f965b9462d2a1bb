"""What a run would do, as the lines that `--dry-run` prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from myomorph.store.outcome import Excluded, Key
from myomorph.study.run.dry_run import DryRun, Row
from myomorph.study.run.step_times import in_words
from myomorph.study.run.watching import named
from myomorph.study.step.job_steps import NEVER

HEADING = ("subject", "trial", "condition", "frames", "reused", "computed", "time", "files")
MAX_NAMES = 4


def dry_run_lines(dry_run: DryRun, excluded: Sequence[Excluded] = (), conditions: Sequence[str] = ()) -> Iterator[str]:
    """The lines that `--dry-run` prints, with what the study file leaves out and the conditions of its trials."""
    outcomes = [row.work.outcome for row in dry_run.rows]
    subjects = dict.fromkeys(outcome.subject for outcome in outcomes)
    counts = [_many(len(subjects), "subject"), _many(sum(1 for outcome in outcomes if outcome.trial), "trial")]
    counts += [f"conditions {', '.join(conditions)}"] if conditions else []
    yield f"{dry_run.name}: {', '.join(counts)}; results go to {dry_run.out}"
    yield ""
    yield from _table(dry_run.rows, bool(conditions))
    yield from _reasons(dry_run.rows)
    if excluded:
        yield ""
        yield "left out:"
        yield from (f"  {_name((trial.subject, trial.trial))}: {trial.reason}" for trial in excluded)
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
    outcome = row.work.outcome
    time = "-" if not row.computed else "?" if row.unknown else in_words(row.seconds)
    return (
        outcome.subject,
        outcome.trial,
        outcome.condition,
        "?" if row.frames is None else str(row.frames),
        " ".join(row.reused) or "-",
        " ".join(row.computed) or "-",
        time,
        ", ".join(row.work.files),
    )


def _reasons(rows: tuple[Row, ...]) -> Iterator[str]:
    """Why results that are there would be computed again, each reason once."""
    jobs: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        for step, why in row.reasons.items():
            for text in why:
                if text != NEVER:
                    jobs.setdefault(text, {}).setdefault(_name(row.work.key), []).append(step)
    if jobs:
        yield ""
        yield "computed again, because"
    for text, names in jobs.items():
        shown = [f"{name} ({' '.join(steps)})" for name, steps in list(names.items())[:MAX_NAMES]]
        rest = f" and {_many(len(names) - MAX_NAMES, 'other')}" if len(names) > MAX_NAMES else ""
        yield f"  {text}: {', '.join(shown)}{rest}"


def _time(dry_run: DryRun) -> Iterator[str]:
    if not any(row.computed for row in dry_run.rows):
        yield "nothing to compute: all results are there and would come out the same"
        return
    if dry_run.seconds:
        yield f"expected: {in_words(dry_run.seconds)} with {_many(dry_run.side, 'worker')}"
        yield "  by what steps took before on this machine (step_times.csv in the user's cache folder)"
    if dry_run.unknown:
        steps = ", ".join(dry_run.unknown)
        yield f"time unknown: {steps}: not run before on this machine with such settings and so many muscles"


def _name(key: Key) -> str:
    return key[0] if key[0] == key[1] else named(key)


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")

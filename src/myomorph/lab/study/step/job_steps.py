"""The steps of one job, in their order.

What an earlier run left is reused unless something changed.
"""

from __future__ import annotations

import json
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import PurePath

from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.provenance import Provenance, Source
from myomorph.lab.store.outcome import Outcome, failed
from myomorph.lab.store.watched import announce

LAST = "report"  # What follows from all steps of a job, as whoever watches hears it.
NEVER = "is not computed yet"  # Why a step is computed of which there is no result.
AFTER_OTHERS = "its inputs are computed again"
"""Why a step is computed that begins with files of one that is computed."""


class JobSteps(AbstractContextManager["JobSteps"]):
    """The steps of a trial, a subject, a specimen or a study, with its inputs opened.

    `outcome` is that before the first. `linked`: a step begins with files that those before it
    write, so that its own inputs are known only then.
    """

    outcome: Outcome
    linked = False

    @abstractmethod
    def provenance(self, step: str) -> Provenance:
        """Return what a step's result would be derived from now."""

    @abstractmethod
    def earlier(self, step: str) -> Provenance | None:
        """Return what an earlier run derived a step's result from, None without a whole result."""

    @abstractmethod
    def compute(self, step: str) -> None:
        """Run a step and store its result."""

    @abstractmethod
    def reuse(self, step: str) -> None:
        """Go on with what an earlier run found."""

    def end(self, outcome: Outcome) -> Outcome:
        """Return the outcome with what follows from all steps that were done.

        These are tables, a page, and what the outcome reports of their results.
        """
        return outcome

    def reasons(self, step: str) -> tuple[str, ...]:
        """Why a step is computed, one line each; () where its result is reused."""
        earlier = self.earlier(step)
        return (NEVER,) if earlier is None else changes(earlier, self.provenance(step))

    def all_reasons(self, steps: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """By step, why a run would compute it; () where it would be reused. Nothing is computed."""
        reasons: dict[str, tuple[str, ...]] = {}
        for step in steps:
            if self.linked and any(reasons.values()):
                reasons[step] = (NEVER if self.earlier(step) is None else AFTER_OTHERS,)
                continue
            reasons[step] = self.reasons(step)
            if not reasons[step]:
                self.reuse(step)
        return reasons

    def unchanged(self, steps: Sequence[str]) -> Outcome | None:
        """Return the outcome of a job whose folder a run would not change, None for any other."""
        if any(self.all_reasons(steps).values()):
            return None
        return self.end(replace(self.outcome, done=tuple(steps), reused=tuple(steps)))

    def __exit__(self, *raised: object) -> None:
        """Let go of what was only needed while steps run.

        An interrupted job keeps what it has found.
        """
        return


def run_steps(
    job: JobSteps, steps: Sequence[str], check: Callable[[], None] = lambda: None
) -> Outcome:
    """Run steps in their order; where one fails, what is before it is kept.

    What `check` raises ends the job.
    """
    outcome = job.outcome
    with job:
        for step in steps:
            try:
                check()
                reasons = job.reasons(step)
                if not reasons:
                    job.reuse(step)
                    outcome = replace(
                        outcome, done=(*outcome.done, step), reused=(*outcome.reused, step)
                    )
                    continue
                changed = dict.fromkeys(
                    (*outcome.changed, *(text for text in reasons if text != NEVER))
                )
                outcome = replace(outcome, changed=tuple(changed))
                started = time.monotonic()
                announce(subject=outcome.subject, trial=outcome.trial, step=step)
                job.compute(step)
                timed = (*outcome.timed, (step, time.monotonic() - started))
                outcome = replace(outcome, done=(*outcome.done, step), timed=timed)
            except Exception as error:
                outcome = failed(outcome, error, step)
                break
        announce(subject=outcome.subject, trial=outcome.trial, step=LAST)
        return job.end(outcome)


LONGEST = 60  # Longest value that is reported whole [characters].


def changes(before: Provenance, after: Provenance) -> tuple[str, ...]:
    """Return why a result that was made one way would come out otherwise the other way.

    There are none, (), where the keys are equal. Examples: "model generic.osim has changed",
    "ik.tolerance 1e-05 -> 0.0001", "version 1.0.0 -> 1.1.0".
    """
    if before.key == after.key:
        return ()
    lines = []
    if before.version != after.version:
        lines.append(f"version {before.version or 'unknown'} -> {after.version or 'unknown'}")
    lines += _sources(before.sources, after.sources)
    names = sorted(before.options.keys() | after.options.keys())
    for name in names:
        old = _option(before.options, name)
        new = _option(after.options, name)
        if old != new:
            short = max(len(old), len(new)) <= LONGEST
            lines.append(f"{name} {old} -> {new}" if short else f"{name} has changed")
    return tuple(dict.fromkeys(lines)) or ("its inputs have changed",)


def _sources(before: Iterable[Source], after: Iterable[Source]) -> list[str]:
    """Name inputs that came, went or hold something else.

    A file that only moved is the same input.
    """
    result = []
    old = grouped((source.role, source) for source in before)
    new = grouped((source.role, source) for source in after)
    for role in dict.fromkeys((*old, *new)):
        gone = _missing_in(new.get(role, []), old.get(role, []))
        come = _missing_in(old.get(role, []), new.get(role, []))
        result += [f"{role} {change}" for change in _changes_of_role(gone, come)]
    return result


def _missing_in(sources: Sequence[Source], others: Sequence[Source]) -> list[Source]:
    """Return those of the others whose content none of the sources has."""
    contents = {source.sha256 for source in sources}
    return [other for other in others if other.sha256 not in contents]


def _changes_of_role(gone: list[Source], come: Sequence[Source]) -> Iterator[str]:
    """Yield what became of the inputs of a role; an input of the same name has changed.

    One that is `gone` and one that has `come` are taken for the same under another name.
    """
    gone = list(gone)
    for source in come:
        same = next((other for other in gone if other.name == source.name), None)
        if same is None and len(gone) == len(come) == 1:
            same = gone[0]
        if same is None:
            yield f"{_name(source)} is new"
            continue
        gone.remove(same)
        if _name(same) == _name(source):
            yield f"{_name(source)} has changed"
        else:
            yield f"{_name(same)} -> {_name(source)}"
    for source in gone:
        yield f"{_name(source)} is no longer used"


def _name(source: Source) -> str:
    return PurePath(source.name.replace("\\", "/")).name or source.name


def _option(options: Mapping[str, object], name: str) -> str:
    """Return a value as text; stored ones were read from JSON, so tuples and lists are the same."""
    return str(json.loads(json.dumps(options.get(name), default=str)))

"""Draws shared by processes, each with one thread."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any, cast

from myomorph.model.arrays import Array
from myomorph.rigid.frames import thread_count
from myomorph.study.inputs.loads import ExternalLoads
from myomorph.study.trial.steps.drawn_trials import Chain
from myomorph.study.workers.jobs import Job
from myomorph.study.workers.local_workers import LocalWorkers
from myomorph.uncertainty.bodies import Draw

Tables = Mapping[str, Array]
WORTH = 8.0
"""Processes are begun where what is left would take longer in this one [s]; to begin one takes two or three."""
AHEAD = 4
"""Results a process may be ahead of the one that is waited for, so that memory does not grow with draws."""
PATIENCE = 1.0
"""Between two looks at processes of which none has answered [s]."""


def attempts(chain: Chain, draws: Sequence[Draw], workers: int | None = None) -> Iterator[Tables | None]:
    """What draws come to, in order, None for no solution; by default on all threads where worth their start."""
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
    """The same by processes; what one of them loses, or cannot do, is done in this one."""
    # What reads the recording's forces is a function of this process; the forces themselves are in the chain.
    sent: Any = replace(chain, trial=replace(chain.trial, inputs=chain.trial.inputs.without(ExternalLoads)))
    works = [cast(Any, partial(_attempt, draw)) for draw in draws]
    jobs = [Job(("draw", str(number)), work) for number, work in enumerate(works)]
    results: dict[int, Tables | None] = {}
    begun, running = 0, 0
    for number in range(len(draws)):
        while number not in results:
            while running < hands.count and begun < min(len(draws), number + AHEAD * hands.count):
                hands.start(jobs[begun], sent)
                begun, running = begun + 1, running + 1
            for ended in hands.ended(PATIENCE):
                running -= 1
                place, outcome = int(ended.job.key[1]), cast(Any, ended.outcome)
                results[place] = chain.attempt(draws[place]) if ended.lost else outcome[0]
        yield results.pop(number)


def _attempt(draw: Draw, chain: Any) -> tuple[Tables | None]:
    """What a draw comes to, in a process that was sent the chain."""
    return (chain.attempt(draw),)

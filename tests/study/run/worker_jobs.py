"""Jobs for tests of workers: functions of a module, so that another process finds them."""

from __future__ import annotations

import errno
import os
import time
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.workers.jobs import Job


def outcome(name, *done):
    return Outcome("s", name, Path(), done=tuple(done))


def about_model(model, name):
    """Which model the process holds, and whether its arrays may be written."""
    return outcome(
        name, str(os.getpid()), str(id(model)), str(model.bodies[0].inertia.flags.writeable)
    )


def leave(model, name, mark):
    """End the process without a word, the first time."""
    if not mark.exists():
        mark.write_text("")
        os._exit(7)
    return outcome(name, "again")


def take_memory(model, name, size):
    taken = np.ones(size // 8)
    time.sleep(30.0)
    return outcome(name, str(taken.sum()))


def sleep(model, name, mark, seconds=60.0):
    """Work for long; tidy up where it is asked to end."""
    mark.write_text(str(os.getpid()))
    try:
        time.sleep(seconds)
    finally:
        mark.with_suffix(".tidied").write_text("")
    return outcome(name)


def speak(model, name):
    """Print, which must not meddle with the answers."""
    print("a word on standard output", flush=True)
    os.write(1, b"and some that no module of Python sees\n")
    return outcome(name, "spoke")


def no_space(model, name):
    error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    from myomorph.lab.store.outcome import failed

    return failed(outcome(name), error, "ik")


def plain(model, name):
    return outcome(name, "done")


def job(work, name, **given):
    return Job(("s", name), partial(work, name=name, **given))

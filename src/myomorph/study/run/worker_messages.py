"""What a process and its workers tell each other, through pipes."""

from __future__ import annotations

import os
import pickle
import struct
from dataclasses import dataclass
from typing import Any

from myomorph.store.outcome import Outcome

LENGTH = struct.Struct("<Q")
BLOCK = 1 << 20
PROTOCOL = 5
"""Of pickle: from this one on, arrays that are read-only stay so, and kernels are not compiled for both kinds."""


@dataclass(frozen=True)
class Begin:
    """The first message: where modules are found."""

    path: tuple[str, ...]


@dataclass(frozen=True)
class Do:
    """A job.

    Attributes
    ----------
    work : `Job.work`, packed
    model : number of the model it is given, 0 for none
    packed : that model, packed, where the process does not hold it yet
    forget : models that it needs no longer
    """

    work: bytes
    model: int = 0
    packed: bytes | None = None
    forget: tuple[int, ...] = ()


@dataclass(frozen=True)
class Stop:
    """The last message: leave what you do, tidy up, end."""


@dataclass(frozen=True)
class Done:
    """The answer to a job: its outcome, or why there is none."""

    outcome: Outcome | None
    broken: str = ""


def pack(value: object) -> bytes:
    """A value as bytes that another process of the same version reads."""
    return pickle.dumps(value, PROTOCOL)


def send(descriptor: int, message: object) -> None:
    """Write a message into a pipe; raises `OSError` where nobody reads it any more."""
    content = pack(message)
    view = memoryview(LENGTH.pack(len(content)) + content)
    while view:
        view = view[os.write(descriptor, view[:BLOCK]) :]


def receive(descriptor: int) -> Any:
    """The next message of a pipe, None at its end."""
    head = _exactly(descriptor, LENGTH.size)
    if head is None:
        return None
    content = _exactly(descriptor, LENGTH.unpack(head)[0])
    return None if content is None else pickle.loads(content)


def _exactly(descriptor: int, size: int) -> bytes | None:
    parts, lacking = [], size
    while lacking:
        part = os.read(descriptor, min(BLOCK, lacking))
        if not part:
            return None
        parts.append(part)
        lacking -= len(part)
    return b"".join(parts)

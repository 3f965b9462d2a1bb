"""A process that draws for another: a chain and draws come in on its input, what they come to goes out on its output.

It is started with `python -m myomorph.study.trial.steps.draw_process` and ends when its input does.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import sys
import warnings
from typing import BinaryIO

PROTOCOL = 5
"""Of pickle: from this one on, arrays that are read-only stay so, and kernels are not compiled for both kinds."""


def main() -> None:
    """Draw until the input ends."""
    warnings.simplefilter("ignore")
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # Whatever else reads or prints must not meddle with the messages.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    with contextlib.suppress(EOFError, OSError):
        sys.path[:] = pickle.load(requests)
        _draw(requests, answers)


def _draw(binary_io: BinaryIO, answers: BinaryIO) -> None:
    # After the path is known, and after what is printed goes elsewhere.
    from myomorph.store.progress import silence

    silence()
    chain = pickle.load(binary_io)
    while True:
        draw = pickle.load(binary_io)
        answer: object
        try:
            answer = chain.attempt(draw)
        except Exception as error:
            answer = error
        pickle.dump(answer, answers, PROTOCOL)
        answers.flush()


if __name__ == "__main__":
    main()

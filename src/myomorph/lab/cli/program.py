"""`myomorph`: the program, its exit statuses, and what it says when something is wrong."""

from __future__ import annotations

import atexit
import gc
import io
import os
import re
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph.core.model.errors import UnknownName, check_name, one_line
from myomorph.core.model.extension import is_own, load
from myomorph.core.model.registry import new_remarks
from myomorph.core.rigid.compile_notices import before_compiling
from myomorph.lab.cli.failures import BAD_INPUT, failure_of
from myomorph.lab.cli.written_methods import keep_written_methods

if TYPE_CHECKING:
    from cyclopts import App

DONE = 0
INTERRUPTED = 130
LINEAR_ALGEBRA = ("OPENBLAS", "MKL", "VECLIB_MAXIMUM")
"""Libraries that get one thread, as in the workers of studies, unless the environment says more:
matrices are small, and threads that wait for the next one took a fifth of the processor time.
"""
GARBAGE_THRESHOLDS = (50_000, 10, 10)
"""New objects after which Python looks for garbage. Imports and readers make many that stay, and
with the usual 700 it goes through them 160 times in the shortest command: 0.06 s of 0.9.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : what follows the program's name; None takes them from the process

    Returns
    -------
    exit status: 0 done; 2 bad input, reported in one line; 1 our fault; 130 interrupted with Ctrl-C
    """
    before_compiling(_say_that_kernels_compile)
    keep_written_methods()
    gc.set_threshold(*GARBAGE_THRESHOLDS)
    # A process that ends looks through all its objects once more, for a sixth of a short command.
    atexit.register(gc.freeze)
    for library in LINEAR_ALGEBRA:
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    # Let names of files be printed where the terminal, or the file that it is sent to, has no such
    # letters.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with warnings.catch_warnings():
            if not debug:
                warnings.simplefilter("ignore")
            return _run([word for word in words if word != "--debug"])
    except KeyboardInterrupt:
        return _say("interrupted: no incomplete files were left", INTERRUPTED)
    except BrokenPipeError:
        # End quietly, as other programs do, where whoever read our output has gone (`| head`).
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except Exception as error:
        failure = failure_of(error)
        text = failure.text
        if failure.status == BAD_INPUT:
            text = f"error: {text}"
        elif not debug:
            text += ", with what the same command prints with --debug"
        return _say(text, failure.status, debug)


def _run(words: list[str]) -> int:
    from cyclopts.exceptions import CycloptsError

    from myomorph.lab.cli.app import commands, new_app
    from myomorph.lab.cli.panels import ALL_FLAG

    command = words[0] if words and not words[0].startswith("-") else ""
    entries = commands()
    _warn(new_remarks())
    if command:
        check_name("command", command, entries, "myomorph")
        if not is_own(entries[command].function):
            # Raises the one line on a package that is broken, before the command line tries.
            load(entries[command].function)
    app = new_app(ALL_FLAG in words)
    words = ["--help" if word == ALL_FLAG else word for word in words]
    try:
        status = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        if command:
            _check_options(app[command], command, words[1:])
        where = " ".join(["myomorph", command, "--help"]).replace("  ", " ")
        return _say(f"error: {str(error).rstrip('.')}; see '{where}'", BAD_INPUT)
    _warn(new_remarks())
    return status if isinstance(status, int) else DONE


def _warn(remarks: Sequence[str]) -> None:
    for text in remarks:
        _say(f"warning: {text}", DONE)


def _check_options(app: App, command: str, words: Sequence[str]) -> None:
    """Raise `UnknownName` for the first word that looks like an option and is no option."""
    names = [name for argument in app.assemble_argument_collection() for name in argument.names]
    options = [name for name in names if name.startswith("--")]
    for word in words:
        name = word.partition("=")[0]
        if re.fullmatch(r"--[a-z][\w-]*", name) and name not in (*options, "--help", "--version"):
            raise UnknownName("option", name, existing=options, where=f"myomorph {command}")


def _say(text: str, status: int, debug: bool = False) -> int:
    """Print one line, whatever the text holds, and return the status."""
    if debug:
        traceback.print_exc()
    sys.stderr.write(one_line(" ".join(text.split())) + "\n")
    sys.stderr.flush()
    return status


def _say_that_kernels_compile(folder: Path, can_keep: bool) -> None:
    text = "compiling, once on this machine: up to half a minute"
    if not can_keep:
        text = (
            f"compiling: up to half a minute, each time: {folder} cannot be written to; set"
            " NUMBA_CACHE_DIR to a folder that can"
        )
    _say(text, DONE)

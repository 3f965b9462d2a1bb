"""What a user reads where something went wrong, and the exit status."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.core.model.errors import MyomorphError

OUR_FAULT = 1
BAD_INPUT = 2


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A sentence on what went wrong, and the exit status of a command."""

    text: str
    status: int


def failure_of(error: Exception) -> Failure:
    """Say what is wrong, and whose fault it is.

    Parameters
    ----------
    error : that ended a piece of work
    """
    if isinstance(error, MyomorphError):
        return Failure(text=str(error), status=BAD_INPUT)
    if isinstance(error, UnicodeEncodeError):
        near = error.object[max(error.start - 40, 0) : error.end + 40]
        text = f"a file's name is not UTF-8 ('{near}'): rename it"
        return Failure(text=text, status=BAD_INPUT)
    if isinstance(error, OSError):
        return Failure(text=_about_file(error), status=BAD_INPUT)
    if isinstance(error, MemoryError):
        text = "not enough memory: cut the recording with --time START END"
        return Failure(text=text, status=BAD_INPUT)
    kind = type(error).__name__
    text = f"this is a fault of Myomorph, not of your files: {kind}: {error}; please report it"
    return Failure(text=text, status=OUR_FAULT)


def _about_file(error: OSError) -> str:
    """Write an operating system's error as one line that names the file."""
    reason = error.strerror or str(error)
    # Of two names the second is the one that could not be written, as where a result is open in
    # another program.
    name = error.filename2 if error.filename2 is not None else error.filename
    return f"{name}: {reason}" if name is not None else reason

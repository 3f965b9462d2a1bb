"""Files that another file names, whose name may be one that no file can have."""

from __future__ import annotations

from pathlib import Path


def is_named_file(path: Path) -> bool:
    """Whether a name that stands in a file, or was typed, is that of a file.

    `Path.is_file` raises an error where a name is longer than the file system allows.

    Parameters
    ----------
    path : the name, below its folder

    Returns
    -------
    False for names that no file can have

    Examples
    --------
    >>> from pathlib import Path
    >>> from myomorph.core.io.parsing.named_file import is_named_file
    >>> is_named_file(Path("x" * 5000))
    False
    """
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False

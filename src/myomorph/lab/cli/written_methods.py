"""Methods that `dataclasses` writes as text, compiled once and kept beside the kernels.

At every start Python writes the methods of some three hundred classes of values as text, and
compiles them: a sixth of the processor time of a short command. The texts are the same each time,
as sources of modules are, which Python keeps compiled too.
"""

from __future__ import annotations

import atexit
import builtins
import dataclasses
import hashlib
import importlib.util
import marshal
import os
from collections.abc import Mapping
from pathlib import Path
from types import CodeType
from typing import Any

from myomorph.core.model.cache_folder import kernel_folder

NAME = "methods-{}.code"
"""Name of the file, with the number of Python's form of compiled code."""
DIGEST_BYTES = 32
MOST_TEXTS = 5000
"""Above this number of texts, which sources under change leave behind, a file begins anew."""


class WrittenMethods:
    """Compiled methods by their text.

    Attributes
    ----------
    file : in which they are kept
    """

    def __init__(self, file: Path):
        self.file = file
        self._marshalled = _kept(file)
        self._known = len(self._marshalled)

    def execute(
        self,
        text: str | CodeType,
        names: dict[str, Any] | None = None,
        local: Mapping[str, object] | None = None,
    ) -> None:
        """Do what `exec` does, and compile only a text that was not compiled before."""
        if isinstance(text, str):
            text = self._code(text)
        builtins.exec(text, names, local)

    def _code(self, text: str) -> CodeType:
        if text in self._marshalled:
            known: CodeType = marshal.loads(self._marshalled[text])
            return known
        code = compile(text, "<string>", "exec", dont_inherit=True)
        self._marshalled[text] = marshal.dumps(code)
        return code

    def keep(self) -> None:
        """Write the file where this process compiled what was not in it, and where that can be."""
        if len(self._marshalled) == self._known:
            return
        if len(self._marshalled) > MOST_TEXTS:
            self._marshalled = {}
        content = marshal.dumps(self._marshalled)
        unfinished = self.file.with_suffix(f".{os.getpid()}")
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            unfinished.write_bytes(hashlib.sha256(content).digest() + content)
            unfinished.replace(self.file)
        except OSError:
            # A folder that cannot be written costs time alone.
            return


def keep_written_methods() -> None:
    """Take compiled methods for all classes of values that this process makes from now on."""
    number = importlib.util.MAGIC_NUMBER.hex()
    methods = WrittenMethods(kernel_folder() / NAME.format(number))
    # `dataclasses` calls `exec` by its name, which is looked for in the module before Python's own.
    vars(dataclasses)["exec"] = methods.execute
    atexit.register(methods.keep)


def _kept(file: Path) -> dict[str, bytes]:
    """Read a file; empty where there is none, or it is damaged."""
    try:
        content = file.read_bytes()
    except OSError:
        return {}
    digest = content[:DIGEST_BYTES]
    marshalled = content[DIGEST_BYTES:]
    if hashlib.sha256(marshalled).digest() != digest:
        return {}
    by_text: dict[str, bytes] = marshal.loads(marshalled)
    return by_text

"""Marker protocols of one's own, from a file."""

from __future__ import annotations

from pathlib import Path

from myomorph.model.errors import BadFile
from myomorph.motion.protocols import ProtocolTable, protocol_table, protocols


def read_protocols(path: Path) -> ProtocolTable:
    """The protocols of the package and those of a table in TOML. Raises `BadFile` or `BadData` where it cannot be read,
    or is wrong.
    """
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise BadFile(
            path, f"cannot be read ({error.strerror or error})", "give a table of protocols (.toml)"
        ) from None
    except UnicodeDecodeError:
        raise BadFile(path, "is not text", "give a table of protocols (.toml)") from None
    return protocol_table(text, str(path), protocols())

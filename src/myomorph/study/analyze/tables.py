"""What a user tells `analyze` beside the recordings: protocols of one's own, and the muscles of EMG channels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from myomorph.model.errors import BadData, BadFile
from myomorph.motion.protocols import ProtocolTable, protocol_table, protocols


def read_protocols(path: Path) -> ProtocolTable:
    """The protocols of the package and those of a table in TOML.

    Raises
    ------
    BadFile, BadData
        where it cannot be read, or is wrong
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


def channel_muscles(texts: Sequence[str]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """EMG channels and their muscles from texts CHANNEL=MUSCLE,MUSCLE.

    Raises
    ------
    BadData
        where a text has no =, or a channel stands twice
    """
    found: dict[str, tuple[str, ...]] = {}
    for text in texts:
        channel, equal, muscles = text.partition("=")
        names = tuple(one.strip() for one in muscles.split(",") if one.strip())
        if not equal or not channel.strip() or not names or channel.strip() in found:
            raise BadData(f"--emg-muscles {text}: expected CHANNEL=MUSCLE,MUSCLE once for each channel")
        found[channel.strip()] = names
    return tuple(found.items())

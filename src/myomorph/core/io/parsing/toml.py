"""Tables as the text of a TOML file, which `tomllib` reads back."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

MAX_LINE = 100  # Characters from which on an array has a line for each of its values.
BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(table: Mapping[str, Any], comments: Sequence[str] = ()) -> str:
    """Write tables as TOML.

    Parameters
    ----------
    table : texts, numbers, switches, sequences of them, mappings of all these (tables of their own)
        and sequences of mappings (arrays of tables)
    comments : lines at the top

    Returns
    -------
    the text; values of a table stand before its tables, as TOML asks for
    """
    head = "".join(f"# {line}\n" for line in comments)
    return head + "\n".join(_blocks(table, ()))


def _blocks(table: Mapping[str, Any], path: tuple[str, ...], head: str = "") -> Iterator[str]:
    """Yield the values of a table, then its tables, each with its own head."""
    values = {key: value for key, value in table.items() if not _is_table(value)}
    if values or head:
        yield head + "".join(_assignment(key, value) for key, value in values.items())
    for key, value in table.items():
        if not _is_table(value):
            continue
        inner = (*path, key)
        name = ".".join(map(_key, inner))
        if not isinstance(value, Mapping):
            for entry in value:
                yield from _blocks(entry, inner, f"[[{name}]]\n")
        elif not value or not all(map(_is_table, value.values())):
            yield from _blocks(value, inner, f"[{name}]\n")
        else:
            yield from _blocks(value, inner)


def _is_table(value: Any) -> bool:
    """Whether a value is written as a table of its own, or as several."""
    if isinstance(value, Mapping):
        return True
    is_array = isinstance(value, Sequence) and not isinstance(value, str)
    return is_array and len(value) > 0 and all(isinstance(entry, Mapping) for entry in value)


def _assignment(key: str, value: Any) -> str:
    line = f"{_key(key)} = {_value(value)}\n"
    if len(line) <= MAX_LINE or isinstance(value, str) or not isinstance(value, Sequence):
        return line
    entries = "".join(f"    {_value(entry)},\n" for entry in value)
    return f"{_key(key)} = [\n{entries}]\n"


def _key(key: str) -> str:
    return key if BARE.fullmatch(key) else _text(key)


def _value(value: Any) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{_key(key)} = {_value(entry)}" for key, entry in value.items())
        return f"{{{pairs}}}"
    if isinstance(value, Sequence):
        return f"[{', '.join(map(_value, value))}]"
    raise TypeError(f"TOML has no value for a {type(value).__name__}")


def _text(text: str) -> str:
    """Write a basic string: the escapes are those of JSON, which leaves DEL as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")

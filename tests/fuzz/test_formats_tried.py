"""Every kind of file of the product's tables is tried with wrong files, from a sound one."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzz_readers import FORMATS, READERS, of_formats

from myomorph.core.model.errors import MyomorphError


@pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.name)
def test_a_sound_file_of_each_format_is_read(tmp_path: Path, kind) -> None:
    readers = [reader for reader in of_formats() if reader.name.startswith(f"{kind.name}, ")]
    assert [reader.ending for reader in readers] == list(kind.endings)
    read = 0
    for reader in readers:
        assert reader in READERS or any(reader.name == other.name for other in READERS)
        for content in reader.seeds():
            path = tmp_path / reader.file_name
            path.write_bytes(content)
            try:
                reader.read(path)
            except MyomorphError:
                # Endings that formats share have the others' files too.
                continue
            read += 1
    assert read, f"no seed of {kind.name} can be read: add one to tests/fuzz"

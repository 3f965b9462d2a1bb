"""The format that docs/adding.md adds as its example is added here, word by word.

Every command takes it.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io import formats
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadFile

PAGE = Path(__file__).resolve().parents[2] / "docs" / "adding.md"


@pytest.fixture
def lin(tmp_path, monkeypatch):
    """Load a module with the page's reader, and the page's line in the list of formats."""
    section = PAGE.read_text(encoding="utf-8").split("## A file format")[1].split("\n## ")[0]
    reader, line = re.findall(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "lin_of_the_page.py").write_text(reader, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path / "modules")
    entry = eval(
        line.strip().replace("myomorph.core.io.lin:", "lin_of_the_page:"),
        {"Format": formats.Format},
    )
    monkeypatch.setattr(formats, "TRIALS", (*formats.TRIALS, entry))
    return entry


def test_inverse_kinematics_of_a_file_of_the_new_format(arm, command, lin):
    markers = read_trc(arm.markers).markers
    lines = [
        f"{time:.6f} {name} " + " ".join(f"{1000.0 * one:.10g}" for one in place)
        for time, frame in zip(markers.time, markers.values, strict=True)
        for name, place in zip(markers.names, frame, strict=True)
    ]
    path = arm.folder / "reach.lin"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = formats.read_trial(path).markers
    assert found.names == markers.names
    np.testing.assert_allclose(found.values, markers.values, atol=1e-9)
    assert "LIN markers" in command("info", path).out
    for source, out in ((path, "lin.mot"), (arm.markers, "trc.mot")):
        ended = command("ik", "--model", arm.model, "--markers", source, "--out", arm.folder / out)
        assert ended.status == 0, ended.err
    by_lin = read_sto(arm.folder / "lin.mot")
    by_trc = read_sto(arm.folder / "trc.mot")
    np.testing.assert_allclose(by_lin.values, by_trc.values, atol=1e-6)


def test_a_bad_file_of_the_new_format_is_named(arm, command, lin):
    path = arm.folder / "reach.lin"
    path.write_text("0.0 UA1 1 2\n", encoding="utf-8")
    with pytest.raises(BadFile, match="three numbers"):
        formats.read_trial(path)
    ended = command("ik", "--model", arm.model, "--markers", path, "--out", arm.folder / "out.mot")
    assert (ended.status, len(ended.err.strip().splitlines())) == (2, 1)


def test_an_unknown_ending_lists_the_formats(tmp_path, lin):
    with pytest.raises(BadFile, match=r"ends in '\.xyz'; expected \.trc, \.c3d, .*, \.lin"):
        formats.read_trial(tmp_path / "a.xyz")


@pytest.mark.parametrize("entry", [*formats.MODELS, *formats.TRIALS], ids=lambda one: one.name)
def test_every_format_has_its_reader_and_endings_of_its_own(entry, tmp_path):
    path = tmp_path / f"a{entry.endings[0]}"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(BadFile):
        entry.read(path)
    others = [one for one in (*formats.MODELS, *formats.TRIALS) if one is not entry]
    assert not {ending for one in others for ending in one.endings} & set(entry.endings)

"""A message names a cell of a table; it does not repeat all of it."""

from __future__ import annotations

import pytest

from myomorph.core.io.channels import read_channels
from myomorph.core.io.contact_events import read_events
from myomorph.core.model.errors import BadFile

LONG = 30_000 * "x"


@pytest.mark.parametrize(
    "text",
    [
        f"site,{LONG}\nheel,1\n",
        f"site,start,stop\nheel,{LONG},1\n",
        f"site,start,stop\nheel,0,1e{LONG}\n",
        f"time,site,event\n0,heel,{LONG}\n",
        "site," * 9000 + "\nheel\n",
    ],
)
def test_of_touches(tmp_path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(BadFile) as caught:
        read_events(tmp_path / "a.csv")
    assert len(str(caught.value)) < 1000 + len(str(tmp_path))


def test_of_channels(tmp_path) -> None:
    (tmp_path / "a.csv").write_text(f"{LONG},{LONG}\n0,1\n", encoding="utf-8")
    with pytest.raises(BadFile) as caught:
        read_channels(tmp_path / "a.csv")
    assert len(str(caught.value)) < 1000 + len(str(tmp_path))
